"""Volume rendering of irregular data by EWA splatting, without resampling: arrays in, pictures out.

Volumes, surfaces and splats are made from arrays (`Volume`, `Surfels`, `Splats`), from files (`load`) and from other
packages' objects (`adapt`). A `Renderer` draws them together.

Examples
--------
>>> import numpy as np, ewa_splat as es
>>> x, y, z = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
>>> volume = es.Volume.from_grid(np.exp(-4 * (x**2 + y**2 + z**2)), spacing=2 / 23, origin=(-1, -1, -1))
>>> es.Renderer(volume).render(es.Camera.fit(azimuth=60), size=(160, 120), transfer_function="magma")
Image(160 x 120)
"""

from ._adapt import adapt
from ._camera import Camera
from ._driver import quiet as _quiet
from ._image import Column, DeepImage, Image, compare
from ._keywords import Drawing, Sampling
from ._notebook import view
from ._renderer import Picked, Renderer, convert, measure
from ._scene import Drawable, Report, Splats, Surfels, Volume, load
from ._transfer import TransferFunction

_quiet()

#: Older name of `Drawable`.
Thing = Drawable

__all__ = [
    "Camera",
    "Column",
    "DeepImage",
    "Drawable",
    "Drawing",
    "Image",
    "Picked",
    "Renderer",
    "Report",
    "Sampling",
    "Splats",
    "Surfels",
    "Thing",
    "TransferFunction",
    "Volume",
    "adapt",
    "compare",
    "convert",
    "load",
    "measure",
    "view",
]
