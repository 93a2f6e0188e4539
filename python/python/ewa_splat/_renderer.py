"""Renders things: pictures, column densities, reference images, measurements."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _core
from ._camera import Camera
from ._image import Column, DeepImage, Image
from ._keywords import Drawing, drawing, lights_of
from ._scene import Drawable
from ._transfer import TransferFunction, TransferLike, choice

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: Marks an omitted argument: the transfer function does not change.
_KEPT: Any = type("Kept", (), {"__repr__": lambda self: "..."})()


class Picked(NamedTuple):
    """A particle that a pixel shows.

    Attributes
    ----------
    thing, particle
        The numbers of the thing in the renderer, and of the particle among its samples.
    value
        Its value, if a transfer function shows it.
    position
        Its centre, world units.
    depth
        Its depth along the view, world units.
    share
        Its share of the pixel. All shares add up to the pixel's opacity.
    """

    thing: int
    particle: int
    value: float | None
    position: tuple[float, float, float]
    depth: float
    share: float


class Renderer:
    """Draws things together.

    The things are sampled for the first picture, and kept. One renderer draws one picture at a time, and other threads
    wait. All long work releases the interpreter, and Ctrl-C ends it.

    Parameters
    ----------
    *things
        `Volume`, `Surfels` and `Splats`, results of `load`, or any object that `adapt` accepts: data sets of PyVista and
        VTK, meshes of meshio and trimesh, and others.
    backend
        ``"auto"``, ``"gpu"`` or ``"cpu"``.
    keep_shapes
        Whether to keep everything that does not depend on values, so that `set_values` is fast. This doubles the memory
        for the data. Particles are then classified by their values alone, as with ``classify="particle"``. Lattices are
        not affected.

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
        # Counts changes of values and of transfer functions, for pictures that are kept.
        self._changes = 0

    @property
    def things(self) -> list[Drawable]:
        """The things that it draws."""
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
            By default, it shows all that is visible, from a direction that suits the data.
        size
            Width and height in pixels.
        tolerance
            The error in linear colour that approximations may add to 99.9 % of pixels.
        transfer_function
            A `TransferFunction`, the name of a colour map, the path of a JSON file, or ``None`` to choose one from the
            values. It also applies to later pictures.
        **settings
            See `Drawing`.

        Raises
        ------
        ValueError
            Settings that are out of range or contradict each other; nothing to draw.
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

    def render_deep(
        self,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        tolerance: float = 1 / 255,
        transfer_function: TransferLike = _KEPT,
        **settings: Unpack[Drawing],
    ) -> DeepImage:
        """Draw a deep image: colours and opacities along the ray of each pixel.

        Something that is put at any depth into it looks as if it were drawn with `background_depth`, within about the
        tolerance. This takes some ten to a hundred pictures. Backgrounds, legends, depths and normals are left out.

        Parameters
        ----------
        camera, size, tolerance, transfer_function, **settings
            As in `render`.

        Raises
        ------
        ValueError
            As `render`; a background depth, or splats that are composited in sRGB codes.
        """
        for name in settings:
            if name in ("legend", "depth", "normals", "background", "background_image", "measure_error"):
                raise TypeError(f"{name}: deep images have no such setting")
        said = drawing({"tolerance": tolerance, **settings})
        self._choose(transfer_function)
        deep, camera_told = self._core.render_deep(_view(camera), _size(size), said)
        return DeepImage(deep, Camera({"kind": "calibrated"} | camera_told))

    def column_density(
        self,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        *,
        of: str | None = None,
        slice: float | None = None,
        **settings: Unpack[Drawing],
    ) -> Column:
        """Integrate a density along each pixel's ray, without a transfer function or opacity.

        Parameters
        ----------
        camera, size
            As in `render`; by default, the picture is orthographic, along z.
        of
            What is integrated: ``"mass"``, or the name of a field, as a density. By default mass where it is known,
            whatever field is shown, and otherwise the field that is shown.
        slice
            Coordinate of a plane along the camera's axis (`Camera.along`): pixels then hold the density on the plane
            instead of its integral.
        **settings
            From `Drawing`: clip, low_pass, cutoff, filter.

        Raises
        ------
        TypeError
            Settings that do not apply to column densities.
        ValueError
            Masses or a field that the data do not have; a slice across another camera.
        """
        return self._column(camera, size, of, None, slice, settings)

    def column_mean(
        self,
        field: str,
        camera: Camera | None = None,
        size: tuple[int, int] = (800, 600),
        *,
        weight: str | None = None,
        slice: float | None = None,
        **settings: Unpack[Drawing],
    ) -> Column:
        """Compute the mean of a field along each pixel's ray, or on a slice.

        Parameters
        ----------
        field
            Name of the field.
        camera, size, slice, **settings
            As in `column_density`.
        weight
            ``"mass"``, or the name of a field that weighs as a density; by default as `of` of `column_density`.

        Returns
        -------
        Column
            NaN where no kernel lies within three standard deviations, or where the weights are 0.

        Raises
        ------
        ValueError
            As `column_density`; weights below 0.
        """
        return self._column(camera, size, weight, field, slice, settings)

    def _column(
        self,
        camera: Camera | None,
        size: tuple[int, int],
        of: str | None,
        mean: str | None,
        slice: float | None,
        settings: Any,
    ) -> Column:
        for name in settings:
            if name not in ("clip", "low_pass", "cutoff", "filter", "tolerance"):
                raise TypeError(f"{name}: column densities have no such setting")
            if slice is not None and name in ("low_pass", "filter", "tolerance"):
                raise TypeError(f"{name}: slices have no such setting")
        at = None if slice is None else float(slice)
        told = self._core.column_density(_view(camera), _size(size), drawing(dict(settings)), of, mean, at)
        return Column(told, "mean" if mean is not None else "column" if slice is None else "slice")

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
        """Integrate the reference image in float64, which is slow.

        Parameters
        ----------
        camera, size, transfer_function
            As in `render`.
        of
            ``"kernels"``, or ``"data"``: a grid's own field, interpolated between its samples.
        error
            Target error in linear colour.
        **settings
            From `Drawing`: clip, low_pass, background, classify.
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
        """Return the particles that a pixel shows, front to back.

        Parameters
        ----------
        x, y
            Column and row of the pixel, from the top left.
        camera, size, **settings
            Camera, size and settings of the picture.
        """
        found = self._core.pick([int(x), int(y)], _view(camera), _size(size), drawing(dict(settings)))
        return [Picked(*particle) for particle in found]

    def set_values(self, values: ArrayLike, thing: int = 0) -> None:
        """Replace the values of a thing, for the next time step. Positions, shapes and the transfer function stay.

        Parameters
        ----------
        values
            New values, in the shape that the thing was made with.
        thing
            Number of the thing in the renderer.

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
        self._changes += 1

    def set_transfer_function(self, transfer_function: TransferLike) -> None:
        """Set the transfer function of all classified data; ``None`` chooses one from the values."""
        self._core.set_transfer_function({"transfer_function": choice(transfer_function)})
        self._changes += 1

    @property
    def transfer_functions(self) -> list[TransferFunction | None]:
        """The current transfer function of each volume; ``None`` for volumes with their own colours."""
        texts = self._core.transfer_functions()
        return [None if text is None else TransferFunction.from_json(text) for text in texts]

    @property
    def adapter(self) -> str | None:
        """The device that draws; ``None`` for the CPU, and before anything was drawn."""
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
    """Measure speed against accuracy: time every method, and compare its picture with the reference image.

    Parameters
    ----------
    *things
        As a `Renderer` accepts them.
    camera, size
        As in `Renderer.render`.
    frames
        Number of frames; times are their medians.
    error
        Error of the reference image, in linear colour.

    Returns
    -------
    dict
        The report that ``ewa-splat measure`` writes as JSON: ``rows``, each with its settings, times and errors.
    """
    renderer = Renderer(*things, backend="cpu")
    return dict(json.loads(renderer._core.measure(_view(camera), _size(size), int(frames), float(error))))


def convert(
    things: Any,
    path: str | os.PathLike[str],
    *,
    width: float | None = None,
    lit: bool | None = None,
    lights: Sequence[Sequence[float]] | None = None,
) -> dict[str, Any]:
    """Write splats for viewers of radiance fields: ply, compressed.ply, splat, ksplat, spz, sog, glb, gltf, usda, usdc, usdz, csv or vtu.

    ``meta.json`` is a SOG with its images beside it.

    Parameters
    ----------
    things
        One thing or a list of them, as a `Renderer` accepts them.
    path
        Output file, whose extension determines the format.
    width
        Standard deviation of splats over their spacing: of meshes .55 unless given, of volumes their ``kernel_width``.
    lit, lights
        As in `Renderer.render`, but without light unless asked for: the colours become harmonics of degree 2 that show
        surfaces and fields lit. Lights of the camera move with it.

    Returns
    -------
    dict
        The numbers of ``splats`` and ``bytes``, and ``notes`` on what was lost.
    """
    from ._adapt import adapt

    listed = things if isinstance(things, (list, tuple)) else [things]
    if not listed:
        raise ValueError("things: expected something to convert, found none")
    together = _core.Drawable.together([adapt(thing)._core for thing in listed])
    if width is not None and not 0 < width < float("inf"):
        raise ValueError(f"width: expected a number above 0, found {width!r}")
    coloured = None if lights is None else lights_of(lights)
    splats, size, notes = together.convert(os.fspath(path), width, lit, coloured)
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
