"""A curvilinear grid of arrays: tip vortices behind a rotor, under a function of one's own."""

import numpy as np
from _arguments import FIXTURES, arguments

import ewa_splat as es

size, out = arguments(__doc__)

# A PLOT3D file is three counts, then x, y and z of all nodes, i fastest: arrays in Fortran's order pass through.
with open(FIXTURES / "wake.xyz", "rb") as file:
    dims = np.fromfile(file, np.int32, 3)
    points = np.fromfile(file, np.float32).reshape(*dims, 3, order="F")
with open(FIXTURES / "wake.q", "rb") as file:
    file.seek(12 + 16)
    density = np.fromfile(file, np.float32, dims.prod()).reshape(dims, order="F")

volume = es.Volume.from_structured(points, density, name="density")
print(volume.report)
renderer = es.Renderer(volume)
image = renderer.render(size=size, transfer_function=FIXTURES / "wake_transfer.json", measure_error=True)
image.save(out / "curvilinear.png")
print("99.9 % of the picture err by less than", image.measured_error["percentile_999"])
