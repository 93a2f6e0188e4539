"""The column density of SPH particles, in matplotlib with axes in the data's units."""

import numpy as np
from _arguments import arguments

import ewa_splat as es

size, out = arguments(__doc__)
random = np.random.default_rng(1)
# A disc of gas: masses and smoothing lengths, as a simulation has them.
radius, angle = random.gamma(2.0, 1.5, 20_000), random.uniform(0, 2 * np.pi, 20_000)
places = np.stack([radius * np.cos(angle), radius * np.sin(angle), random.normal(0, 0.2, radius.size)], axis=1)
lengths = 0.15 + 0.05 * radius

volume = es.Volume.from_points(places, mass=np.full(radius.size, 1e5), smoothing_length=lengths)
column = es.Renderer(volume).column_density(es.Camera.fit(azimuth=0, elevation=90, orthographic=True), size)
print("mass in the picture:", column.sum_times_area(), "of", column.amplitude_sum)

try:
    import matplotlib
except ImportError:
    column.save(out / "column.png")
else:
    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots()
    shown = np.log10(np.maximum(column.values, column.values.max() * 1e-4))
    picture = axes.imshow(shown, extent=column.extent, cmap="inferno")
    axes.set(xlabel="x [kpc]", ylabel="y [kpc]")
    figure.colorbar(picture, label="log column density [Msun / kpc²]")
    figure.savefig(out / "column.png", dpi=size[0] / 6.4)
