"""Draws things in scenes of VTK: behind and before its meshes, under its axes, scalar bars and texts.

`Actor` is added to a `vtkRenderer` and drawn with every frame of it. `ewa_splat.pyvista` does the same for plotters of
PyVista. Tested with VTK 9.7.

Examples
--------
>>> from ewa_splat.vtk import Actor  # doctest: +SKIP
>>> actor = Actor(volume, transfer_function="plasma").add_to(renderer)  # doctest: +SKIP
>>> window.Render()  # doctest: +SKIP
"""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _vtk
from ._camera import Camera
from ._keywords import Drawing
from ._renderer import Renderer
from ._transfer import TransferFunction
from ._vtk import camera_of

__all__ = ["Actor", "camera_of"]

#: Frames per second that a window asks for from which on it is in motion. VTK asks for less than one at rest.
MOVING_RATE = 1.0
#: Pixels along an edge of a coarse picture's pixels, and its least tolerance.
COARSE_STEP = 2
COARSE_TOLERANCE = 8 / 255
#: Size of a picture that is drawn to learn something.
PROBE = (16, 16)

#: Beginnings of the names of settings that the scene decides.
_OF_SCENE = ("background", "legend", "depth", "normals", "measure_error", "show")


class Actor:
    """Things in a scene of VTK.

    They end at the depths of the scene's opaque geometry and are composited over its colours in linear light, before
    axes, scalar bars and texts are drawn. While the window is in motion, pictures have half the resolution. Things that
    penetrate each other belong into one actor: a second one is drawn over the first.

    Parameters
    ----------
    *things
        Things that a `Renderer` accepts, or one renderer.
    **settings
        ``tolerance``, ``transfer_function`` and `Drawing`, without ``background``, ``legend``, ``depth``, ``normals``,
        ``measure_error`` and ``show``. ``transfer_function`` may also be a `vtkLookupTable` with opacities, a
        `vtkVolumeProperty`, or a pair of a `vtkColorTransferFunction` and a `vtkPiecewiseFunction`; later changes of
        them are drawn.

    Raises
    ------
    TypeError
        Settings that do not exist here.
    ValueError
        As `Renderer.render`.
    """

    def __init__(self, *things: Any, **settings: Any) -> None:
        is_renderer = len(things) == 1 and isinstance(things[0], Renderer)
        self._renderer: Renderer = things[0] if is_renderer else Renderer(*things)
        self._settings: dict[str, Any] = {}
        # A transfer function of VTK, and the time of its last change that was drawn.
        self._source: Any = None
        self._drawn_time = -1
        self._table: Any = None
        self._bar: Any = None
        self._last: tuple[Any, ...] | None = None
        self._warned: set[str] = set()
        self._observer = 0
        self._visible = True
        self._is_encoded = False
        # The renderer, an invisible actor with the bounds, and a 2D actor that draws. The scene owns them and this.
        self._where, self._box, self._hook = (_vtk.classes("vtkCommonCore").vtkWeakReference() for _ in range(3))
        self._set(settings, is_first=True)

    # The scene's parts ------------------------------------------------------------------------------------------------

    def _new_box(self) -> Any:
        core = _vtk.classes("vtkRenderingCore")
        mapper = core.vtkPolyDataMapper()
        mapper.SetInputData(self._bounding_triangle())
        mapper.ScalarVisibilityOff()
        box = core.vtkActor()
        box.SetMapper(mapper)
        box.PickableOff()
        box.SetUseBounds(self.bounds is not None)
        box.SetVisibility(self._visible)
        self._box.Set(box)
        return box

    def _bounding_triangle(self) -> Any:
        """Return a triangle of no area between the corners of the bounds: nothing is drawn of it."""
        data = _vtk.classes("vtkCommonDataModel")
        points = _vtk.classes("vtkCommonCore").vtkPoints()
        points.SetDataTypeToDouble()
        bounds = self.bounds or (0.0,) * 6
        points.InsertNextPoint(bounds[::2])
        points.InsertNextPoint(bounds[1::2])
        cells = data.vtkCellArray()
        cells.InsertNextCell(3)
        for node in (0, 1, 1):
            cells.InsertCellPoint(node)
        triangle = data.vtkPolyData()
        triangle.SetPoints(points)
        triangle.SetPolys(cells)
        return triangle

    def add_to(self, renderer: Any) -> Actor:
        """Add the things to a `vtkRenderer`. The scene keeps this actor until it is removed.

        Raises
        ------
        ValueError
            An actor that is in a scene.
        """
        if self._where.Get() is not None:
            raise ValueError("renderer: expected an actor that is in no scene, found one that is; remove it first")
        renderer.AddActor(self._new_box())
        self._enter(renderer)
        return self

    def _enter(self, renderer: Any) -> None:
        """Add the 2D actor that draws when its data are updated."""
        core = _vtk.classes("vtkRenderingCore")
        trigger = _vtk.classes("vtkFiltersSources").vtkProgrammableSource()
        trigger.SetExecuteMethod(self._drawn)
        mapper = core.vtkPolyDataMapper2D()
        mapper.SetInputConnection(trigger.GetOutputPort(0))
        hook = core.vtkActor2D()
        hook.SetMapper(mapper)
        hook.PickableOff()
        hook.SetVisibility(self._visible)
        renderer.AddViewProp(hook)
        # 2D actors are drawn in their order, so that this one, drawn first, is under all others.
        props = renderer.GetViewProps()
        props.RemoveItem(hook)
        props.InsertItem(-1, hook)
        self._hook.Set(hook)
        self._where.Set(renderer)
        weak = _vtk.classes("vtkCommonCore").vtkWeakReference()
        weak.Set(trigger)

        def started(*_: object) -> None:
            source = weak.Get()
            if source is not None:
                source.Modified()

        self._observer = renderer.AddObserver("StartEvent", started)

    def remove(self) -> None:
        """Take the things out of their scene."""
        renderer = self._where.Get()
        if renderer is not None:
            for prop in (self._box.Get(), self._hook.Get(), self._bar):
                if prop is not None:
                    renderer.RemoveViewProp(prop)
            renderer.RemoveObserver(self._observer)
        self._bar, self._last = None, None
        for part in (self._where, self._box, self._hook):
            part.Set(None)

    # Settings ---------------------------------------------------------------------------------------------------------

    def update(self, **settings: Any) -> None:
        """Change settings. They are checked now, and drawn with the next frame.

        Raises
        ------
        TypeError, ValueError
            As the constructor; the settings before remain.
        """
        self._set(settings)
        self._changed()

    def _set(self, settings: dict[str, Any], *, is_first: bool = False) -> None:
        of_pictures = [name for name in Drawing.__annotations__ if not name.startswith(_OF_SCENE)]
        known = ["tolerance", "transfer_function", *of_pictures]
        for name in settings:
            if name not in known:
                raise TypeError(f"{name}: no such setting in a scene; expected one of {', '.join(known)}")
        changed = self._settings | settings
        function = changed.pop("transfer_function", ...)
        is_foreign = _vtk.is_function(function)
        given = _vtk.converted(function)
        is_given = function is not ...
        # The first function comes before the first sampling, later ones after what may be refused.
        if is_given and is_first:
            self._renderer.set_transfer_function(given)
        is_encoded = self._blends_encoded(changed)
        if is_given and not is_first:
            self._renderer.set_transfer_function(given)
        self._settings, self._is_encoded = changed, is_encoded
        if is_given:
            self._source = function if is_foreign else None
            self._drawn_time = _vtk.time_of(function) if is_foreign else -1
        self._last = None
        if self._table is not None:
            self._fill_table()
        if self._bar is not None:
            self._bar.SetLookupTable(self.lookup_table)

    def _blends_encoded(self, settings: dict[str, Any]) -> bool:
        """Return whether colours are composited as sRGB codes. Settings that contradict each other are found by this.

        Small pictures before grey show it where the data decide.
        """
        settings = settings | {"background": (0.5, 0.5, 0.5)}
        first = self._renderer.render(None, PROBE, **settings)
        if settings.get("blend", "auto") != "auto":
            return bool(settings["blend"] == "encoded")
        second = self._renderer.render(None, PROBE, **settings | {"blend": "linear"})
        return not np.array_equal(first.numpy(), second.numpy())

    def _changed(self) -> None:
        """Act on a change of what is drawn: windows of bare VTK are rendered by their owners."""

    @property
    def renderer(self) -> Renderer:
        """The renderer, whose values can be set for a next time step."""
        return self._renderer

    @property
    def bounds(self) -> tuple[float, ...] | None:
        """The bounds in VTK's order, x, y, z from and to; ``None`` if nothing has a position."""
        ends = [thing.bounds for thing in self._renderer.things]
        known = [end for end in ends if end is not None]
        if not known:
            return None
        low, high = np.min([end[0] for end in known], axis=0), np.max([end[1] for end in known], axis=0)
        return tuple(float(x) for pair in zip(low, high, strict=True) for x in pair)

    @property
    def visible(self) -> bool:
        """Whether the things are drawn."""
        return self._visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._visible = bool(visible)
        for prop in (self._box.Get(), self._hook.Get()):
            if prop is not None:
                prop.SetVisibility(self._visible)
        self._changed()

    # Colours ----------------------------------------------------------------------------------------------------------

    @property
    def lookup_table(self) -> Any:
        """The transfer function as a `vtkLookupTable`, which follows later changes; the given one if that is a table."""
        if self._source is not None and not isinstance(self._source, (tuple, list)) and self._source.IsA("vtkLookupTable"):
            return self._source
        if self._table is None:
            self._table = self._new_table()
            self._fill_table()
        return self._table

    def _new_table(self) -> Any:
        return _vtk.classes("vtkCommonCore").vtkLookupTable()

    def _function(self) -> TransferFunction:
        functions = [function for function in self._renderer.transfer_functions if function is not None]
        if not functions:
            raise ValueError("scalar_bar: expected values under a transfer function, found things with their own colours")
        return functions[0]

    def _fill_table(self) -> None:
        _vtk.fill(self._table, self._function())

    def _title(self) -> str:
        reports = [thing.report for thing in self._renderer.things]
        field, unit = next(((r.field, r.unit) for r in reports if r.field is not None), ("", None))
        return f"{field} [{unit}]" if unit else str(field)

    def scalar_bar(self, title: str | None = None) -> Any:
        """Add a scalar bar of the transfer function to the scene, and return its `vtkScalarBarActor`.

        Parameters
        ----------
        title
            By default the field and its unit.

        Raises
        ------
        ValueError
            Things with their own colours; an actor that is in no scene.
        """
        renderer = self._where.Get()
        if renderer is None:
            raise ValueError("scalar_bar: expected an actor in a scene, found one that was not added")
        bar = _vtk.classes("vtkRenderingAnnotation").vtkScalarBarActor()
        bar.SetLookupTable(self.lookup_table)
        bar.SetTitle(self._title() if title is None else title)
        if self._bar is not None:
            renderer.RemoveViewProp(self._bar)
        renderer.AddViewProp(bar)
        self._bar = bar
        return bar

    # Pictures ---------------------------------------------------------------------------------------------------------

    def _warn(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            try:
                warnings.warn(f"ewa_splat: {text}", RuntimeWarning, stacklevel=2)
            except RuntimeWarning as warning:
                # Where warnings are errors: VTK would end the process.
                print(warning, file=sys.stderr)

    def _drawn(self) -> None:
        """Draw into the frame. VTK ends the process if this raises, or prints and goes on, so that errors are warnings."""
        try:
            self._draw()
        except KeyboardInterrupt:
            self._warn("the picture was interrupted; this frame is without it")
        except Exception as error:
            self._warn(f"{type(error).__name__}: {error}; this frame is without it")

    def _draw(self) -> None:
        renderer = self._where.Get()
        if renderer is None:
            return
        window = renderer.GetRenderWindow()
        if renderer.GetPass() is not None:
            name = renderer.GetPass().GetClassName()
            raise ValueError(f"expected a renderer without passes, found {name}; multi-sampling (MSAA) works")
        if not self._is_in_place():
            raise ValueError("expected an actor in its place, found one that was moved, turned or scaled")
        width, height, left, bottom = _vtk.region_of(renderer)
        if width < 1 or height < 1:
            return
        corners = (left, bottom, left + width - 1, bottom + height - 1)
        common, bridge = _vtk.classes("vtkCommonCore"), _vtk.classes("util.numpy_support")
        buffer, colours = common.vtkFloatArray(), common.vtkUnsignedCharArray()
        window.GetZbufferData(*corners, buffer)
        window.GetRGBACharPixelData(*corners, 0, colours, 0)
        view, projection = _vtk.view_of(renderer)
        # Rows of VTK begin at the bottom.
        near = bridge.vtk_to_numpy(buffer).reshape(height, width)[::-1]
        codes = bridge.vtk_to_numpy(colours).reshape(height, width, 4)[::-1]
        if self._source is not None and _vtk.time_of(self._source) != self._drawn_time:
            self._set({"transfer_function": self._source})
        is_coarse = window.GetDesiredUpdateRate() >= MOVING_RATE
        state = (view, is_coarse, self._renderer._changes)
        if self._last is not None and self._last[0] == state:
            _, last_near, last_codes, picture, is_drawn = self._last
            if np.array_equal(near, last_near) and np.array_equal(codes, last_codes):
                self._put(window, corners, picture, is_drawn)
                return
        depths = _vtk.of_outlines(_vtk.depths_of(near, projection), codes)
        light = self._light(view, depths, COARSE_STEP if is_coarse else 1)
        picture = _vtk.composited(light, codes, in_codes=self._is_encoded)
        is_drawn = np.asarray(light.any(axis=-1))
        self._last = (state, near.copy(), codes.copy(), picture, is_drawn)
        self._put(window, corners, picture, is_drawn)

    def _is_in_place(self) -> bool:
        box = self._box.Get()
        if box is None:
            return True
        matrix = box.GetMatrix()
        return all(matrix.GetElement(i, j) == (i == j) for i in range(4) for j in range(4))

    @staticmethod
    def _put(window: Any, corners: tuple[int, ...], picture: NDArray[np.uint8], is_drawn: NDArray[np.bool_]) -> None:
        """Write a picture into the frame.

        Colours are written where something was drawn alone: a pixel with several samples keeps them elsewhere.
        """
        bridge = _vtk.classes("util.numpy_support")
        masked = np.concatenate([picture[..., :3], np.where(is_drawn[..., None], 255, 0).astype(np.uint8)], axis=-1)
        # The library's own device may have had another context.
        window.MakeCurrent()
        state = window.GetState()
        for pixels, blends, channels in ((masked, 1, (1, 1, 1, 0)), (picture, 0, (0, 0, 0, 1))):
            state.vtkglColorMask(*channels)
            array = bridge.numpy_to_vtk(pixels[::-1].reshape(-1, 4), deep=True)
            window.SetRGBACharPixelData(*corners, array, 0, blends, 0)
        state.vtkglColorMask(1, 1, 1, 1)

    def _light(self, view: dict[str, Any], depths: NDArray[np.float32], step: int) -> NDArray[np.float32]:
        """Draw the things up to depths, premultiplied. Pixels are `step` wide, so that the scene itself remains sharp."""
        settings = dict(self._settings)
        if step > 1:
            settings["tolerance"] = max(COARSE_TOLERANCE, settings.get("tolerance", 0.0))
        width, height = view["size"]
        ends = np.ascontiguousarray(depths[::step, ::step])
        size = (ends.shape[1], ends.shape[0])
        view = view | {
            "focal_px": [f / step for f in view["focal_px"]],
            "centre_px": [c / step for c in view["centre_px"]],
            "size": list(size),
        }
        pixels = self._renderer.render(Camera(view), size, background_depth=ends, **settings).numpy()
        return pixels.repeat(step, 0)[:height].repeat(step, 1)[:, :width] if step > 1 else pixels

    def __repr__(self) -> str:
        return f"Actor({', '.join(repr(thing) for thing in self._renderer.things)})"

