"""An opaque surface in a translucent volume: a vase in smoke."""

import numpy as np
from _arguments import FIXTURES, arguments

import ewa_splat as es

size, out = arguments(__doc__)
vase = es.load(FIXTURES / "vase.obj", count=60_000)
low, high = vase.bounds

# Smoke that winds around it, on a lattice.
axes = [np.linspace(a - 0.6, b + 0.6, 48) for a, b in zip(low, high, strict=True)]
x, y, z = np.meshgrid(*axes, indexing="ij")
turn = np.arctan2(z, x) + 4 * y
smoke = np.exp(-(((np.hypot(x, z) - 1.1) / 0.25) ** 2)) * (1 + np.cos(2 * turn))
volume = es.Volume.from_grid(smoke, coordinates=axes, up=(0, 1, 0))

function = es.TransferFunction.from_points(
    [(0.2, (0.7, 0.8, 1.0), 0.0), (2.0, (1.0, 1.0, 1.0), 0.25)], unit_distance=0.1
)
renderer = es.Renderer(vase, volume)
renderer.render(es.Camera.fit(elevation=20), size, transfer_function=function).save(out / "hybrid.png")
print(renderer)
