"""Renderers: what draws things."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _core
from ._camera import Camera
from ._image import Column, Image
from ._keywords import Drawing, drawing
from ._scene import Thing
from ._transfer import TransferFunction, TransferLike, choice

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: Marks an argument that was left out: the transfer function stays what it is.
_KEPT: Any = type("Kept", (), {"__repr__": lambda self: "..."})()


class Picked(NamedTuple):
    """A particle that a pixel shows.

    Attributes
    ----------
    thing, particle
        The numbers of the thing in the renderer, and of the particle among its samples.
    value
        Its value, where a transfer function shows it.
    position
        Its centre, world units.
    depth
        Along the view, world units.
    share
        Of the pixel: all shares add up to its opacity.
    """

    thing: int
    particle: int
    value: float | None
    position: tuple[float, float, float]
    depth: float
    share: float


class Renderer:
    """Draws things together.

    The things are sampled when something is drawn first, and kept ready. One renderer draws one picture at a time: other
    threads wait, with the interpreter released, as it is during all long work; Ctrl-C ends it.

    Parameters
    ----------
    *things
        `Volume`, `Surfels` and `Splats`, what `load` gives, or any object that `adapt` knows: data sets of PyVista and
        VTK, meshes of meshio and trimesh, and others.
    backend
        ``"auto"``, ``"gpu"`` or ``"cpu"``.
    keep_shapes
        Whether all is kept that does not depend on values, so that `set_values` is quick: once more the data's memory.
        Particles are then classified at their values alone, as by ``classify="particle"``; lattices are not concerned.

    Examples
    --------
    >>> import numpy as np, ewa_splat as es
    >>> positions = np.random.default_rng(1).normal(size=(500, 3))
    >>> renderer = es.Renderer(es.Volume.from_points(positions, positions[:, 0]))
    >>> image = renderer.render(size=(64, 48))
    >>> image.numpy().shape, image.numpy().dtype
    ((48, 64, 4), dtype('float32'))
    """

    def __init__(self, *things: Any, backend: str = "auto", keep_shapes: bool = False) -> None:
        from ._adapt import adapt

        if not things:
            raise ValueError("things: expected something to draw, found none")
        self._things = [adapt(thing) for thing in things]
        self._core = _core.Renderer([thing._core for thing in self._things], backend, keep_shapes)

    @property
    def things(self) -> list[Thing]:
        """What it draws."""
        return list(self._things)

    def render(
        self,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        tolerance: float = 1 / 255,
        transfer_function: TransferLike = _KEPT,
        **settings: Unpack[Drawing],
    ) -> Image:
        """Draw a picture.

        Parameters
        ----------
        camera
            Without one all that is visible is shown, from the side that suits the data.
        size
            Width and height in pixels.
        tolerance
            The error in linear colour that approximations may add to 99.9 % of pixels.
        transfer_function
            A `TransferFunction`, the name of a colour map, a path to one in JSON, or ``None`` for one by the values. It
            stays for later pictures.
        **settings
            See `Drawing`.

        Raises
        ------
        ValueError
            Settings that are out of range or do not go together; nothing that can be drawn.
        """
        said = drawing({"tolerance": tolerance, **settings})
        self._choose(transfer_function)
        told = self._core.render(_view(camera), _size(size), said)
        camera = Camera({"kind": "calibrated"} | told["camera"])
        return Image(
            told["pixels"],
            depth=told["depth"],
            normals=told["normals"],
            camera=camera,
            stats=told["stats"],
            error=told["error"],
        )

    def column_density(
        self,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        **settings: Unpack[Drawing],
    ) -> Column:
        """Sum the field along each pixel's ray: no transfer function, no opacity.

        Parameters
        ----------
        camera, size
            As in `render`; without a camera the picture is orthographic.
        **settings
            Of `Drawing`: clip, low_pass, cutoff, filter.

        Raises
        ------
        TypeError
            Settings that say nothing of columns.
        """
        for name in settings:
            if name not in ("clip", "low_pass", "cutoff", "filter", "tolerance"):
                raise TypeError(f"{name}: column densities have no such setting")
        return Column(self._core.column_density(_view(camera), _size(size), drawing(dict(settings))))

    def reference(
        self,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        *,
        of: str = "kernels",
        error: float = 1e-4,
        transfer_function: TransferLike = _KEPT,
        **settings: Unpack[Drawing],
    ) -> Image:
        """Integrate the true picture in float64: slow.

        Parameters
        ----------
        camera, size, transfer_function
            As in `render`.
        of
            ``"kernels"``, or ``"data"``: a grid's own field, interpolated between its samples.
        error
            That is aimed at, in linear colour.
        **settings
            Of `Drawing`: clip, low_pass, background, classify.
        """
        for name in settings:
            if name not in ("clip", "low_pass", "background", "classify"):
                raise TypeError(f"{name}: the true picture has no such setting")
        self._choose(transfer_function)
        said = drawing(dict(settings))
        told = self._core.reference(of, _view(camera), _size(size), float(error), said)
        stats = {"backend": "reference", "error_wanted": error}
        stats |= {"error_estimate": told["error_estimate"], "rays": told["rays"]}
        stats |= {"pixels_above_error_wanted": told["unconverged"]}
        view = Camera({"kind": "calibrated"} | told["camera"])
        return Image(told["pixels"], camera=view, stats=json.dumps(stats))

    def pick(
        self,
        x: int,
        y: int,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        **settings: Unpack[Drawing],
    ) -> list[Picked]:
        """The particles that a pixel shows, front to back.

        Parameters
        ----------
        x, y
            Column and row of the pixel, from the top left.
        camera, size, **settings
            Of the picture.
        """
        found = self._core.pick([int(x), int(y)], _view(camera), _size(size), drawing(dict(settings)))
        return [Picked(*particle) for particle in found]

    def set_values(self, values: ArrayLike, thing: int = 0) -> None:
        """Exchange the values of a thing, for the next step of time: places, shapes and the transfer function stay.

        Parameters
        ----------
        values
            Of the shape that it was made with.
        thing
            Its number in the renderer.

        Raises
        ------
        ValueError
            Another shape; a thing without values.
        """
        if not 0 <= thing < len(self._things):
            raise ValueError(f"thing: expected one of {len(self._things)}, found {thing}")
        convert = self._things[thing]._values
        if convert is None:
            raise ValueError("values: expected a volume of arrays, found a thing of another kind")
        self._core.set_values(thing, convert(values))

    def set_transfer_function(self, transfer_function: TransferLike) -> None:
        """Take a transfer function for all that is classified; ``None`` finds one by the values."""
        self._core.set_transfer_function({"transfer_function": choice(transfer_function)})

    @property
    def transfer_functions(self) -> list[TransferFunction | None]:
        """The functions in use, of each volume; ``None`` of what has colours of its own."""
        texts = self._core.transfer_functions()
        return [None if text is None else TransferFunction.from_json(text) for text in texts]

    @property
    def adapter(self) -> str | None:
        """The device that draws; ``None`` of the processor, and before anything was drawn."""
        return self._core.adapter()

    def _choose(self, function: TransferLike) -> None:
        if function is not _KEPT:
            self.set_transfer_function(function)

    def _repr_png_(self) -> bytes:
        return self.render()._repr_png_()

    def __repr__(self) -> str:
        return f"Renderer({', '.join(repr(thing) for thing in self._things)})"


def measure(
    *things: Any, camera: Camera | None = None, size: tuple[int, int] = (256, 256), frames: int = 5, error: float = 1e-3
) -> dict[str, Any]:
    """Measure speed against accuracy: every method that there is, timed and held against the true picture.

    Parameters
    ----------
    *things
        As a `Renderer` takes them.
    camera, size
        As in `Renderer.render`.
    frames
        Of which times are the medians.
    error
        Of the true picture, in linear colour.

    Returns
    -------
    dict
        The report that ``ewa-splat measure`` writes as JSON: ``rows``, each with its settings, times and errors.
    """
    renderer = Renderer(*things, backend="cpu")
    return dict(json.loads(renderer._core.measure(_view(camera), _size(size), int(frames), float(error))))


def convert(things: Any, path: str | os.PathLike[str]) -> dict[str, Any]:
    """Write splats for viewers of radiance fields: ply, compressed.ply, splat, spz, sog, glb or vtu.

    Parameters
    ----------
    things
        One thing or a list of them, as a `Renderer` takes them.
    path
        Its ending says the format.

    Returns
    -------
    dict
        How many ``splats``, how many ``bytes``, and ``notes`` on what was lost.
    """
    from ._adapt import adapt

    listed = things if isinstance(things, (list, tuple)) else [things]
    if not listed:
        raise ValueError("things: expected something to convert, found none")
    together = _core.Thing.together([adapt(thing)._core for thing in listed])
    splats, size, notes = together.convert(os.fspath(path))
    return {"splats": splats, "bytes": size, "notes": notes}


def _view(camera: Camera | None) -> dict[str, Any] | None:
    if camera is None:
        return None
    if not isinstance(camera, Camera):
        raise TypeError(f"camera: expected a Camera or None, found {type(camera).__name__}")
    return camera._asked()


def _size(size: Sequence[int]) -> list[int]:
    counts: NDArray[Any] = _arrays.numbers(size, "size")
    if counts.shape != (2,) or np.any(counts != np.floor(counts)) or counts.min() < 1 or counts.max() > 65535:
        raise ValueError(f"size: expected a width and a height from 1 to 65535, found {size!r}")
    return [int(counts[0]), int(counts[1])]
