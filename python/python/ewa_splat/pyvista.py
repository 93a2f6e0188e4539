"""Draws things in plotters of PyVista: behind and before its meshes, under its axes, scalar bars and texts.

Tested with PyVista 0.49. `ewa_splat.vtk` does the same for renderers of bare VTK.

Examples
--------
>>> import ewa_splat.pyvista  # doctest: +SKIP
>>> handle = ewa_splat.pyvista.add(plotter, volume, transfer_function="plasma")  # doctest: +SKIP
>>> handle.scalar_bar()  # doctest: +SKIP
>>> plotter.show()  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
import weakref
from typing import Any

from . import vtk

__all__ = ["Actor", "add"]


def add(plotter: Any, data: Any, *, renderer: Any = None, **settings: Any) -> Actor:
    """Add things to a plotter, and return the handle that changes and removes them.

    Parameters
    ----------
    plotter
        A `pyvista.Plotter`.
    data
        A thing, an object that `adapt` accepts, a list of them, or a `Renderer`.
    renderer
        The plotter's renderer to draw in; by default that of the active subplot.
    **settings
        As in `ewa_splat.vtk.Actor`. ``transfer_function`` may also be a `pyvista.LookupTable`.

    Raises
    ------
    TypeError, ValueError
        As `ewa_splat.vtk.Actor`.
    """
    things = data if isinstance(data, (list, tuple)) else [data]
    return Actor(*things, **settings)._add(plotter, plotter.renderer if renderer is None else renderer)


class Actor(vtk.Actor):
    """Things in a plotter of PyVista; see `ewa_splat.vtk.Actor`."""

    _plotter: Any = None
    _bar_title = ""

    def _add(self, plotter: Any, renderer: Any) -> Actor:
        self._plotter = weakref.ref(plotter)
        # As a mesh does, this sets the camera unless it has been set.
        renderer.add_actor(self._new_box(), reset_camera=None, pickable=False, render=False)
        self._enter(renderer)
        return self

    def remove(self) -> None:
        """Take the things out of their plotter, and their scalar bar."""
        self._remove_bar()
        super().remove()
        self._changed()

    def _remove_bar(self) -> None:
        plotter = self._known_plotter()
        # The user may have removed it.
        if plotter is not None and self._bar is not None and self._bar_title in plotter.scalar_bars:
            plotter.remove_scalar_bar(self._bar_title, render=False)
        self._bar = None

    def _known_plotter(self) -> Any:
        return self._plotter() if self._plotter is not None else None

    def _changed(self) -> None:
        plotter = self._known_plotter()
        if plotter is not None and plotter.render_window is not None:
            # Before the first picture this does nothing.
            plotter.render()

    def _new_table(self) -> Any:
        return importlib.import_module("pyvista").LookupTable()

    def scalar_bar(self, title: str | None = None, **settings: Any) -> Any:
        """Add a scalar bar of the transfer function to the plotter, and return its `vtkScalarBarActor`.

        Parameters
        ----------
        title
            By default the field and its unit.
        **settings
            As in `pyvista.Plotter.add_scalar_bar`.

        Raises
        ------
        ValueError
            Things with their own colours.
        """
        plotter = self._known_plotter()
        if plotter is None or self._where.Get() is None:
            raise ValueError("scalar_bar: expected a handle in a plotter, found one that was not added")
        title = self._title() if title is None else title
        mapper = importlib.import_module("pyvista").DataSetMapper()
        mapper.lookup_table = self.lookup_table
        mapper.scalar_range = self.lookup_table.GetTableRange()
        self._remove_bar()
        self._bar = plotter.add_scalar_bar(title=title, mapper=mapper, **settings)
        self._bar_title = title
        return self._bar
