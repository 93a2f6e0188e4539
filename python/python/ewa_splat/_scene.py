"""Defines things to draw: volumes, surfaces and splats from arrays, and the contents of files."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _core
from ._keywords import Sampling, sampling
from ._units import in_unit_of, strip_unit, unit_text

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: The constant spherical harmonic: a colour is 1/2 plus its coefficient times this.
HARMONIC_0 = 0.28209479177387814

#: The default name of values.
VALUE = "value"


class Report(NamedTuple):
    """Result of sampling a thing.

    Attributes
    ----------
    samples, particles, left_out
        Numbers of samples, of kernels made from them, and of samples that could not be drawn.
    field, unit
        The field that is shown, and its unit.
    value_range
        Its least and greatest finite value.
    lengths
        The meaning of the particles' lengths.
    findings
        Notes on the data, a line each.
    """

    samples: int
    particles: int
    left_out: int
    field: str | None
    unit: str | None
    value_range: tuple[float, float] | None
    lengths: str | None
    findings: list[str]


class Drawable:
    """Object that a renderer draws; the base of `Volume`, `Surfels` and `Splats`."""

    def __init__(
        self,
        core: _core.Drawable,
        values: Callable[[object], NDArray[Any]] | None = None,
        made: tuple[Any, ...] | None = None,
    ) -> None:
        self._core = core
        # Converts new values to the thing's layout.
        self._values = values
        # How it was made, for pickles: the compiled part's call and its options, or the arguments of `load`.
        self._made = made
        #: File that the thing was loaded from.
        self.path: str | None = None

    @property
    def report(self) -> Report:
        """The result of sampling. The thing is sampled now if it was not sampled before."""
        told = self._core.report()
        value_range = told["value_range"]
        told["value_range"] = None if value_range is None else tuple(value_range)
        return Report(**told)

    @property
    def fields(self) -> list[str]:
        """Names of the fields and vector components that can be shown."""
        return self._core.fields()

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The least and the greatest coordinates, world units; ``None`` if nothing has a position."""
        ends = self._core.bounds()
        return None if ends is None else (np.array(ends[0]), np.array(ends[1]))

    @property
    def notes(self) -> list[str]:
        """Notes on data that the reader of a file left out, and on its assumptions."""
        return self._core.notes()

    def showing(self, field: str) -> Drawable:
        """Return the same thing with another of its fields to show. The arrays are shared, not copied.

        Raises
        ------
        ValueError
            A field that it does not have.
        """
        core = self._core.showing(field)
        made = None
        if self._made is not None:
            made = (*self._made[:-1], self._made[-1] | {"field": field})
        thing = type(self)(core, self._values, made)
        thing.path = self.path
        return thing

    def __reduce__(self) -> tuple[Any, ...]:
        if self._made is None:
            raise TypeError(f"pickle: expected a volume of arrays or the contents of a file, found {type(self).__name__}")
        kind, options = self._made[0], self._made[-1]
        if kind == "load":
            return _loaded, (*self._made[1:-1], options)
        return _remade, (type(self), kind, self._core.parts(), options)

    def _repr_png_(self) -> bytes:
        from ._renderer import Renderer

        return Renderer(self).render()._repr_png_()

    def __repr__(self) -> str:
        said = [] if self.path is None else [os.path.basename(self.path)]
        if self.fields:
            said.append("fields " + ", ".join(self.fields))
        ends = self.bounds
        if ends is not None:
            said.append("from " + " ".join(f"{x:.4g}" for x in ends[0]) + " to " + " ".join(f"{x:.4g}" for x in ends[1]))
        return f"{type(self).__name__}({'; '.join(said)})"


class Volume(Drawable):
    """Transparent data: particles, grids, cells.

    Make one with `from_points`, `from_grid`, `from_structured` or `from_cells`. A transfer function shows the values: see
    `Renderer.render`.
    """

    @classmethod
    def from_points(
        cls,
        positions: ArrayLike,
        values: ArrayLike | None = None,
        *,
        radius: ArrayLike | None = None,
        smoothing_length: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        scales: ArrayLike | None = None,
        rotations: ArrayLike | None = None,
        mass: ArrayLike | None = None,
        volume: ArrayLike | None = None,
        opacity: ArrayLike | None = None,
        color: ArrayLike | None = None,
        fields: Mapping[str, ArrayLike] | None = None,
        name: str = VALUE,
        **options: Unpack[Sampling],
    ) -> Volume:
        """Make a volume of particles.

        Parameters
        ----------
        positions : (n, 3)
            Centres, world units.
        values : (n,)
            Values that the transfer function shows. By default, it shows the density: mass over volume, or the number
            density of the points.
        radius : (n,) or one number
            Standard deviations of round kernels, world units.
        smoothing_length : (n,)
            SPH smoothing lengths. `kernel` and `length` state their meaning; the default is the cubic spline's h.
        covariance : (n, 3, 3) or (n, 6)
            Variance matrices, or their elements xx, xy, xz, yy, yz, zz, world units squared.
        scales, rotations : (n, 3), (n, 4)
            Standard deviations along a kernel's own axes, and the quaternions w, x, y, z that turn x, y, z to them.
        mass : (n,)
            Masses in any unit. The density is mass over `volume`, or over the space that each particle has among its
            neighbours. With `color` and no values, they are extinction times volume, world units squared, as the column
            ``mass`` of a table is.
        volume : (n,)
            The space that each particle stands for, world units cubed.
        opacity : (n,) or one number
            Opacity of each kernel, seen along its shortest axis, in place of a transfer function's.
        color : (3,) or (n, 3)
            Colours in place of values: linear if floats, sRGB-encoded if integers.
        fields : names and arrays (n,)
            Further values, which `showing`, `Renderer.column_density` and `Renderer.column_mean` choose by name.
        name
            Name of the values in legends.
        **options
            See `Sampling`.

        Returns
        -------
        Volume
            Particles without any of the four shapes get their size from their neighbours. Particles that cannot be drawn
            (masked, or with numbers that are not finite) are left out and counted in `Drawable.report`.

        Raises
        ------
        ValueError
            Arrays whose shapes do not fit, several kernel shapes, values beside colours.
        TypeError
            Data that are no numbers.

        Examples
        --------
        >>> import numpy as np, ewa_splat as es
        >>> positions = np.random.default_rng(1).normal(size=(500, 3)).astype(np.float32)
        >>> volume = es.Volume.from_points(positions, positions[:, 2], name="height")
        >>> volume.report.particles
        500
        """
        places = _arrays.positions(positions)
        count = len(places)
        columns: list[tuple[str, NDArray[Any]]] = []

        def add(column: str, data: object, name: str) -> None:
            columns.append((column, _arrays.column(data, name, count)))

        shapes = {"radius": radius, "smoothing_length": smoothing_length, "covariance": covariance, "scales": scales}
        given = [shape for shape, data in shapes.items() if data is not None]
        if len(given) > 1:
            raise ValueError(f"{given[1]}: expected one shape, found {given[0]} beside it")
        if (scales is None) != (rotations is None):
            raise ValueError("scales, rotations: expected both or neither, found one of them")
        if values is not None and color is not None:
            raise ValueError("color: expected either values or colours, found both")
        said = sampling(dict(options))
        if values is not None:
            if name.lower() in _RESERVED:
                # A column of this name would have a meaning beyond that of a field.
                name = f"{name} (value)"
            add(name, values, "values")
            said.setdefault("unit", unit_text(values))
            said["field"] = name
        if radius is not None:
            lengths = _arrays.numbers(in_unit_of(radius, positions), "radius")
            if lengths.ndim == 0:
                said["one_radius"] = float(lengths)
            else:
                add("radius", lengths, "radius")
        if smoothing_length is not None:
            add("h", in_unit_of(smoothing_length, positions), "smoothing_length")
        if covariance is not None:
            for column, data in zip(_VARIANCE, _variances(in_unit_of(covariance, positions, 2), count), strict=True):
                add(column, data, "covariance")
        if scales is not None and rotations is not None:
            sizes = _arrays.rows(in_unit_of(scales, positions), "scales", 3, count)
            turns = _arrays.rows(rotations, "rotations", 4, count)
            for i in range(3):
                add(f"scale_{i}", sizes[:, i], "scales")
            for i in range(4):
                add(f"rot_{i}", turns[:, i], "rotations")
        if mass is not None:
            # With colours, no transfer function shows the density. Masses are then strengths, the column `mass`, not `m`.
            if color is None:
                add("m", mass, "mass")
            else:
                add("mass", in_unit_of(mass, positions, 2), "mass")
        if volume is not None:
            add("volume", in_unit_of(volume, positions, 3), "volume")
        if opacity is not None:
            add("opacity", opacity, "opacity")
        if color is not None:
            for i, channel in enumerate(_arrays.colours(color, "color", count, 3).T):
                add("rgb"[i], channel, "color")
        known = {column.lower() for column, _ in columns}
        for field, further in (fields or {}).items():
            if field.lower() in _RESERVED | known:
                raise ValueError(f"fields: expected a name without a meaning of its own, found {field!r}")
            add(field, further, f"fields[{field!r}]")
            known.add(field.lower())
        return cls(_core.Drawable.points(places, columns, said), _column_converter(count), ("points", said))

    @classmethod
    def from_table(cls, table: Any, field: str | None = None, **options: Unpack[Sampling]) -> Volume:
        """Make a volume of a table with one particle in each row.

        Parameters
        ----------
        table
            A data frame of pandas, a table of astropy, a structured array, or a dictionary of arrays. Columns mean what
            their names say, as in CSV files: x, y and z are positions, h, radius or sigma lengths, m masses, and others
            fields. Columns that are no numbers are left out. Lengths with units are converted to that of x. Rows with
            masked or missing numbers are left out where these are needed.
        field
            Column to show.
        **options
            See `Sampling`.

        Raises
        ------
        ValueError
            A table without columns x and y, or without the field; columns of different lengths.
        """
        names = [str(name) for name in _column_names(table)]
        first = next((name for name in names if name.lower() == "x"), None)
        columns: dict[str, NDArray[Any]] = {}
        units: dict[str, str] = {}
        for name, key in zip(names, _column_names(table), strict=True):
            column = table[key]
            if first is not None and name.lower() in _POWERS:
                column = in_unit_of(column, table[first], _POWERS[name.lower()])
            try:
                array = _arrays.numbers(column, name)
            except TypeError:
                continue
            if array.ndim == 1:
                columns[name] = array.astype(np.uint8) if array.dtype.kind == "b" else array
                text = unit_text(column)
                if text is not None:
                    units[name] = text
        counts = {len(array) for array in columns.values()}
        if len(counts) != 1:
            raise ValueError(f"table: expected columns of one length, found {', '.join(map(str, sorted(counts))) or 'none'}")
        rows = np.empty(counts.pop(), dtype=[(name, array.dtype) for name, array in columns.items()])
        for name, array in columns.items():
            rows[name] = array
        packed = io.BytesIO()
        np.save(packed, rows)
        said = sampling(dict(options))
        if field is not None:
            said["field"] = field
        said["units"] = units
        made = ("read", said)
        return cls(_core.Drawable.read("table.npy", packed.getvalue(), said, {}), None, made)

    @classmethod
    def from_grid(
        cls,
        values: ArrayLike,
        spacing: ArrayLike = (1.0, 1.0, 1.0),
        origin: ArrayLike = (0.0, 0.0, 0.0),
        direction: ArrayLike | None = None,
        *,
        coordinates: Sequence[ArrayLike] | None = None,
        of: str = "nodes",
        name: str = VALUE,
        **options: Unpack[Sampling],
    ) -> Volume:
        """Make a volume of values on a lattice.

        Parameters
        ----------
        values : (nx, ny, nz), or of fewer dimensions
            ``values[i, j, k]`` lies at origin + direction @ (spacing * (i, j, k)). Arrays in Fortran order are not
            copied. Cells' values lie half a step further.
        spacing : (3,) or one number
            Distances between neighbours along the array's axes, world units.
        origin : (3,)
            The position of the first value, or of the first cell's corner.
        direction : (3, 3)
            Matrix whose columns are the directions of the array's axes; by default x, y and z.
        coordinates : three of (nx,), (ny,), (nz,)
            Strictly increasing coordinates along x, y and z, in place of the three above.
        of
            ``"nodes"`` or ``"cells"``.
        name
            Name of the values in legends.
        **options
            See `Sampling`.

        Raises
        ------
        ValueError
            No values, more than three dimensions, numbers that are not finite.

        Examples
        --------
        >>> import numpy as np, ewa_splat as es
        >>> x, y, z = np.mgrid[-1:1:16j, -1:1:16j, -1:1:16j]
        >>> volume = es.Volume.from_grid(x**2 + y**2 + z**2, spacing=2 / 15, origin=(-1, -1, -1))
        >>> volume.bounds[1]
        array([1., 1., 1.])
        """
        array = _grid_values(values, "values")
        _one_of(of, "of", "nodes", "cells")
        said = sampling(dict(options))
        said.setdefault("unit", unit_text(values))
        said["field"] = name
        extra = 1 if of == "cells" else 0
        dims = [n + extra for n in _arrays.dims3(array.shape)]
        flat = _arrays.fortran(array)
        if coordinates is not None:
            if len(coordinates) != 3:
                raise ValueError(f"coordinates: expected three arrays, found {len(coordinates)}")
            axes = [np.atleast_1d(_arrays.numbers(axis, "coordinates")).astype(float) for axis in coordinates]
            if [len(axis) for axis in axes] != dims or any(axis.ndim != 1 for axis in axes):
                found = ", ".join(_arrays.shape_text(axis) for axis in axes)
                raise ValueError(f"coordinates: expected {dims[0]}, {dims[1]} and {dims[2]} numbers, found {found}")
            lists = [[float(x) for x in axis] for axis in axes]
            core = _core.Drawable.rectilinear(lists, name, flat, of, said)
        else:
            step = _arrays.numbers(in_unit_of(spacing, origin), "spacing").astype(float)
            step = np.broadcast_to(step, (3,)) if step.ndim == 0 else step
            sizes = np.array(_arrays.vector(step, "spacing"))
            turn = np.eye(3) if direction is None else _arrays.rows(direction, "direction", 3, 3).astype(float)
            start = _arrays.vector(origin, "origin")
            core = _core.Drawable.grid(dims, start, (turn * sizes).T.tolist(), name, flat, of, said)
        return cls(core, _grid_converter(array.shape), ("rectilinear" if coordinates is not None else "grid", said))

    @classmethod
    def from_structured(
        cls,
        points: ArrayLike,
        values: ArrayLike,
        *,
        of: str = "nodes",
        name: str = VALUE,
        **options: Unpack[Sampling],
    ) -> Volume:
        """Make a volume of a curvilinear grid.

        Parameters
        ----------
        points : (ni, nj, nk, 3)
            Nodes, world units. Nodes that are masked or not finite are left out.
        values : (ni, nj, nk), or one fewer along each axis
            Values at the nodes, or of the cells.
        of
            ``"nodes"`` or ``"cells"``.
        name
            Name of the values in legends.
        **options
            See `Sampling`.

        Raises
        ------
        ValueError
            Shapes that do not fit.

        Examples
        --------
        >>> import numpy as np, ewa_splat as es
        >>> r, a, z = np.meshgrid(np.linspace(1, 2, 8), np.linspace(0, 3, 24), np.linspace(0, 1, 6), indexing="ij")
        >>> points = np.stack([r * np.cos(a), r * np.sin(a), z], axis=-1)
        >>> es.Volume.from_structured(points, r + z).report.samples
        1152
        """
        nodes = _arrays.numbers(points, "points")
        if nodes.ndim != 4 or nodes.shape[3] != 3 or nodes.size == 0:
            raise ValueError(f"points: expected an array of shape (ni, nj, nk, 3), found {_arrays.shape_text(nodes)}")
        _one_of(of, "of", "nodes", "cells")
        dims = list(nodes.shape[:3])
        expected = tuple(n - 1 for n in dims) if of == "cells" else tuple(dims)
        array = _arrays.numbers(values, "values")
        if array.shape != expected:
            raise ValueError(f"values: expected an array of shape {expected}, found {_arrays.shape_text(array)}")
        said = sampling(dict(options))
        said.setdefault("unit", unit_text(values))
        said["field"] = name
        places = _arrays.positions(nodes.transpose(2, 1, 0, 3).reshape(-1, 3), "points")
        core = _core.Drawable.structured(dims, places, name, _arrays.fortran(array), of, said)
        return cls(core, _grid_converter(expected), ("structured", said))

    @classmethod
    def from_cells(
        cls,
        points: ArrayLike,
        cells: ArrayLike,
        cell_types: ArrayLike,
        values: ArrayLike,
        *,
        of: str | None = None,
        name: str = VALUE,
        **options: Unpack[Sampling],
    ) -> Volume:
        """Make a volume of an unstructured grid.

        Parameters
        ----------
        points : (n, 3)
            Nodes, world units.
        cells : (m,) or (c, k)
            VTK's list: for each cell, the number of its nodes, then the nodes. If all cells have the same number of
            nodes, a row of nodes for each cell.
        cell_types : (c,) or one number
            VTK's numbers: 10 tetrahedron, 12 hexahedron, 13 wedge, 14 pyramid, 42 polyhedron, ... For a polyhedron,
            `cells` lists its faces: their number, then for each face the number of its nodes and the nodes.
        values : (n,) or (c,)
            Values at the nodes, or of the cells.
        of
            ``"nodes"`` or ``"cells"``, needed if there are as many of both.
        name
            Name of the values in legends.
        **options
            See `Sampling`.

        Raises
        ------
        ValueError
            Lists that end too soon, absent nodes, another number of values.

        Examples
        --------
        >>> import ewa_splat as es
        >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]
        >>> es.Volume.from_cells(corners, [[0, 1, 2, 3]], 10, [0.0, 1.0, 2.0, 3.0]).report.particles
        4
        """
        places = _arrays.positions(points, "points")
        lists = _indices(cells, "cells", np.int64)
        if lists.ndim == 2:
            lists = np.column_stack([np.full(len(lists), lists.shape[1], np.int64), lists]).ravel()
            count = lists.size // (int(lists[0]) + 1) if lists.size else 0
        elif lists.ndim != 1:
            raise ValueError(f"cells: expected an array of one or two dimensions, found {_arrays.shape_text(lists)}")
        kinds = _indices(cell_types, "cell_types", np.uint8)
        if kinds.ndim == 0:
            if np.ndim(cells) != 2:
                raise ValueError("cell_types: expected one for each cell, found one number beside a list of cells")
            kinds = np.full(count, kinds)
        if kinds.ndim != 1:
            raise ValueError(f"cell_types: expected an array of one dimension, found {_arrays.shape_text(kinds)}")
        array = _arrays.numbers(values, "values")
        sizes = {"nodes": len(places), "cells": len(kinds)}
        if of is None:
            of = "nodes" if array.shape == (sizes["nodes"],) else "cells"
        _one_of(of, "of", "nodes", "cells")
        if array.shape != (sizes[of],):
            raise ValueError(
                f"values: expected an array of shape ({sizes['nodes']},), one for each node, or ({sizes['cells']},), one for "
                f"each cell, found {_arrays.shape_text(array)}"
            )
        said = sampling(dict(options))
        said.setdefault("unit", unit_text(values))
        said["field"] = name
        core = _core.Drawable.cells(
            places, np.ascontiguousarray(lists), np.ascontiguousarray(kinds), name, _arrays.kept(array), of, said
        )
        return cls(core, lambda data: _arrays.column(data, "values", sizes[of]))


class Surfels(Drawable):
    """Flat kernels of a surface, opaque or translucent.

    Make them with `from_mesh` or `from_points`.
    """

    @classmethod
    def from_mesh(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        colors: ArrayLike | None = None,
        uv: ArrayLike | None = None,
        texture: ArrayLike | None = None,
        values: ArrayLike | None = None,
        name: str = VALUE,
        **options: Unpack[Sampling],
    ) -> Surfels:
        """Make surfels from triangles.

        Parameters
        ----------
        vertices : (n, 3)
            Corners, world units.
        faces : (m, 3)
            Corners of each triangle, counter-clockwise seen from the front.
        colors : (n, 3), (n, 4) or (m, 3), (m, 4)
            Colours of corners, or of faces: linear if floats, sRGB-encoded if integers.
        uv : (n, 2)
            Texture coordinates of corners; (0, 0) is the bottom left.
        texture : (height, width, 3) or (height, width, 4)
            An sRGB-encoded picture: bytes, floats from 0 to 1, or a PIL image.
        values : (n,) or (m,)
            Field that a transfer function shows in place of colours.
        name
            Name of the values in legends.
        **options
            See `Sampling`; `count`, `density` and `surfel_spacing` set the number of surfels.

        Raises
        ------
        ValueError
            Shapes that do not fit, absent corners, a texture without uv.

        Examples
        --------
        >>> import ewa_splat as es
        >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
        >>> es.Surfels.from_mesh(corners, [[0, 1, 2]], count=100).report.particles
        100
        """
        corners = _arrays.positions(vertices, "vertices")
        triangles = _indices(faces, "faces", np.uint32)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
            raise ValueError(f"faces: expected an array of shape (m, 3), found {_arrays.shape_text(triangles)}")
        if int(triangles.max()) >= len(corners):
            raise ValueError(f"faces: expected corners among {len(corners)}, found number {int(triangles.max())}")
        if (uv is None) != (texture is None):
            raise ValueError("uv, texture: expected both or neither, found one of them")
        if values is not None and (colors is not None or texture is not None):
            raise ValueError("values: expected either values or colours, found both")
        said = sampling(dict(options))
        places = image = None
        if uv is not None:
            places = _arrays.rows(uv, "uv", 2, len(corners), np.float64).copy()
            places[:, 1] = 1.0 - places[:, 1]
            image = _texture(texture)
        tint = None
        if colors is not None:
            paint = _arrays.numbers(colors, "colors")
            if paint.ndim == 2 and len(paint) == len(triangles) and len(paint) != len(corners):
                # Each face gets corners of its own.
                of_faces = triangles.ravel()
                corners, places = corners[of_faces], None if places is None else places[of_faces]
                triangles = np.arange(triangles.size, dtype=np.uint32).reshape(-1, 3)
                paint = np.repeat(paint, 3, axis=0)
            tint = _arrays.colours(paint, "colors", len(corners), 4)
        field, of = None, "nodes"
        if values is not None:
            array = _arrays.numbers(values, "values")
            of = "nodes" if array.shape == (len(corners),) else "cells"
            if array.shape not in ((len(corners),), (len(triangles),)):
                raise ValueError(
                    f"values: expected an array of shape ({len(corners)},) or ({len(triangles)},), "
                    f"found {_arrays.shape_text(array)}"
                )
            field = (name, _arrays.kept(array))
            said.setdefault("unit", unit_text(values))
            said["field"] = name
        triangles = np.ascontiguousarray(triangles)
        return cls(_core.Drawable.mesh(corners, triangles, tint, places, image, field, of, said))

    @classmethod
    def from_points(
        cls,
        positions: ArrayLike,
        normals: ArrayLike,
        radii: ArrayLike,
        colors: ArrayLike | None = None,
        *,
        up: Sequence[float] | None = None,
    ) -> Surfels:
        """Make opaque surfels from points with normals.

        Parameters
        ----------
        positions : (n, 3)
            Centres, world units.
        normals : (n, 3)
            Normals towards the front, of any length but zero.
        radii : (n,) or one number
            Radii of the discs that the points stand for, world units. Their areas should add up to the surface's.
        colors : (3,) or (n, 3)
            Colours: linear if floats, sRGB-encoded if integers; white by default.
        up
            Default direction up of pictures.

        Raises
        ------
        ValueError
            Shapes that do not fit; nothing to draw.

        Examples
        --------
        >>> import numpy as np, ewa_splat as es
        >>> positions = np.random.default_rng(1).normal(size=(2000, 3))
        >>> positions /= np.linalg.norm(positions, axis=1, keepdims=True)
        >>> es.Surfels.from_points(positions, positions, 0.045, (0.8, 0.2, 0.1)).report.particles
        2000
        """
        places = _arrays.positions(positions)
        count = len(places)
        directions = _arrays.rows(normals, "normals", 3, count)
        lengths = _arrays.numbers(in_unit_of(radii, positions), "radii")
        if lengths.ndim == 0:
            lengths = np.full(count, lengths)
        if lengths.shape != (count,):
            raise ValueError(f"radii: expected an array of shape ({count},), found {_arrays.shape_text(lengths)}")
        tint = None if colors is None else _arrays.colours(colors, "colors", count, 3)
        top = None if up is None else _arrays.vector(up, "up")
        return cls(_core.Drawable.surfels(places, directions, _arrays.narrowed(lengths, np.float64), tint, top))


class Splats(Drawable):
    """Splats of a radiance field, whose opacities apply on the image. Make them with `from_arrays`."""

    @classmethod
    def from_arrays(
        cls,
        positions: ArrayLike,
        scales: ArrayLike,
        rotations: ArrayLike,
        opacities: ArrayLike,
        *,
        colors: ArrayLike | None = None,
        harmonics: ArrayLike | None = None,
        **options: Unpack[Sampling],
    ) -> Splats:
        """Make splats from a training's result, after the activations.

        Parameters
        ----------
        positions, scales : (n, 3)
            Centres, and standard deviations along a splat's own axes, world units.
        rotations : (n, 4)
            Quaternions w, x, y, z of any length but zero.
        opacities : (n,)
            Peak opacities, 0 to 1.
        colors : (n, 3)
            sRGB-encoded colours: floats from 0 to 1, or integers.
        harmonics : (n, k, 3), k 1, 4, 9 or 16
            Coefficients of spherical harmonics, the constant one first, in place of `colors`.
        **options
            See `Sampling`.

        Raises
        ------
        ValueError
            Shapes that do not fit; both colours and harmonics, or neither.

        Examples
        --------
        >>> import numpy as np, ewa_splat as es
        >>> one = es.Splats.from_arrays([[0, 0, 0]], [[1, 1, 0.1]], [[1, 0, 0, 0]], [0.9], colors=[[1.0, 0.5, 0.0]])
        >>> one.report.particles
        1
        """
        places = _arrays.positions(positions)
        count = len(places)
        sizes = _arrays.rows(in_unit_of(scales, positions), "scales", 3, count, np.float32)
        turns = _arrays.rows(rotations, "rotations", 4, count, np.float32)
        peaks = _arrays.narrowed(_arrays.column(opacities, "opacities", count), np.float32)
        if (colors is None) == (harmonics is None):
            raise ValueError("colors, harmonics: expected one of them, found " + ("none" if colors is None else "both"))
        if harmonics is not None:
            series = _arrays.numbers(harmonics, "harmonics")
            degrees = {1: 0, 4: 1, 9: 2, 16: 3}
            if series.ndim != 3 or len(series) != count or series.shape[1] not in degrees or series.shape[2] != 3:
                raise ValueError(
                    f"harmonics: expected an array of shape ({count}, 1, 4, 9 or 16, 3), found {_arrays.shape_text(series)}"
                )
            degree = degrees[series.shape[1]]
        else:
            paint = _arrays.numbers(colors, "colors")
            if paint.shape != (count, 3):
                raise ValueError(f"colors: expected an array of shape ({count}, 3), found {_arrays.shape_text(paint)}")
            if paint.dtype.kind in "ui":
                paint = paint / (65535 if paint.dtype == np.uint16 else 255)
            series, degree = (paint - 0.5) / HARMONIC_0, 0
        flat = _arrays.narrowed(series, np.float32).ravel()
        return cls(_core.Drawable.splats(places, sizes, turns, peaks, degree, flat, sampling(dict(options))))


def load(
    source: str | os.PathLike[str] | IO[bytes],
    field: str | None = None,
    *,
    name: str | None = None,
    time_step: int | None = None,
    time: float | None = None,
    particle_type: str | int | Sequence[str | int] | None = None,
    solution: str | os.PathLike[str] | None = None,
    texture: str | os.PathLike[str] | None = None,
    read_as: str | None = None,
    scales: str | None = None,
    dims: Sequence[int] | None = None,
    type: str | None = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    big_endian: bool | None = None,
    **options: Unpack[Sampling],
) -> Drawable:
    """Read a file of any of the formats that the command line reads.

    Parameters
    ----------
    source
        A path, or a file-like object of bytes.
    field
        Field to show. A vector field gives its magnitude, ``"name:x"`` a component. The default is the file's first.
    name
        File name for a file-like object. Its extension determines the format if the contents do not.
    time_step
        Number of the time step, counted from 0; -1 is the last.
    time
        Time in place of `time_step`: the step whose time is nearest, between the first and the last.
    particle_type
        Particles to draw from a snapshot: ``"gas"``, ``"dark-matter"``, ``"stars"``, ... or a number. Several are drawn
        together.
    solution, texture
        The solution of a PLOT3D grid; an image for a mesh that has texture coordinates and no texture.
    read_as
        ``"points"`` or ``"mesh"``: the reading of points with faces.
    scales
        ``"linear"`` or ``"log"``: the meaning of splats' scales.
    dims, type, spacing, origin, big_endian
        The layout of a raw volume; `type` is ``"u8"``, ``"i16"``, ``"u16"`` or ``"f32"``.
    **options
        See `Sampling`.

    Raises
    ------
    OSError
        A file that cannot be read.
    ValueError
        A file of unknown format, that breaks its format's rules, or without the field.
    """
    said = sampling(dict(options))
    if field is not None:
        said["field"] = field
    types = particle_type
    if isinstance(types, (str, int)):
        types = [types]
    how: dict[str, Any] = {
        "time_step": time_step,
        "time": time,
        "particle_types": None if types is None else [str(t) for t in types],
        "read_as": read_as,
        "scales": scales,
        "solution": None if solution is None else os.fspath(solution),
        "texture": None if texture is None else os.fspath(texture),
        "dims": None if dims is None else list(dims),
        "type": type,
        "spacing": None if spacing is None else list(spacing),
        "origin": None if origin is None else list(origin),
        "big_endian": big_endian,
    }
    if isinstance(source, (str, os.PathLike)):
        if name is not None:
            raise ValueError("name: expected a file-like object beside it, found a path, which has a name")
        path = os.fspath(source)
        thing = Drawable(_core.Drawable.open(path, said, how), None, ("load", path, how, said))
        thing.path = path
        return thing
    read = getattr(source, "read", None)
    if read is None:
        raise TypeError(f"source: expected a path or a file-like object, found {source.__class__.__name__}")
    data = read()
    if not isinstance(data, bytes):
        raise TypeError(f"source: expected a file of bytes, found one of {data.__class__.__name__}; open it as 'rb'")
    own = getattr(source, "name", None)
    called = name or (own if isinstance(own, str) else "data")
    return Drawable(_core.Drawable.read(os.path.basename(called), data, said, how))


def _loaded(path: str, how: dict[str, Any], said: dict[str, Any]) -> Drawable:
    """Return the contents of a file that a pickle names."""
    thing = Drawable(_core.Drawable.open(path, said, how), None, ("load", path, how, said))
    thing.path = path
    return thing


def _remade(cls: type[Drawable], kind: str, parts: tuple[Any, ...], said: dict[str, Any]) -> Drawable:
    """Return a thing of the arrays that a pickle holds."""
    made, *arguments = parts
    core = getattr(_core.Drawable, made)(*arguments, said)
    converter = None
    if made == "points" and kind == "points":
        converter = _column_converter(len(arguments[0]))
    elif made != "points":
        dims = arguments[0] if made != "rectilinear" else [len(axis) for axis in arguments[0]]
        converter = _grid_converter(tuple(n - 1 for n in dims) if arguments[-1] == "cells" else tuple(dims))
    return cls(core, converter, (made, said))


#: Column names with a fixed meaning.
_RESERVED = frozenset("x y z sigma h radius mass m extinction volume opacity id r g b red green blue".split()) | {
    "vxx", "vxy", "vxz", "vyy", "vyz", "vzz", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
}  # fmt: skip
_VARIANCE = ("vxx", "vxy", "vxz", "vyy", "vyz", "vzz")


#: Columns of tables with lengths, and the powers of the unit of length in columns.
_POWERS = {name: 1 for name in ("y", "z", "h", "radius", "sigma", "scale_0", "scale_1", "scale_2")}
_POWERS |= dict.fromkeys(_VARIANCE, 2) | {"volume": 3}


def _column_names(table: Any) -> list[Any]:
    """Return the keys of a table's columns."""
    if isinstance(table, Mapping):
        return list(table)
    names = getattr(table, "colnames", None)
    if names is None and hasattr(table, "iloc"):
        names = table.columns
    if names is None:
        names = getattr(getattr(table, "dtype", None), "names", None)
    if names is None:
        raise TypeError(f"table: expected a data frame, a table or a structured array, found {type(table).__name__}")
    return list(names)


def is_table(data: Any) -> bool:
    """Return whether an object is a table with named columns."""
    is_frame = hasattr(data, "iloc") and hasattr(data, "columns")
    is_array = isinstance(data, np.ndarray) and data.dtype.names is not None
    return is_frame or is_array or (hasattr(data, "colnames") and hasattr(data, "itercols"))


def _column_converter(count: int) -> Callable[[object], NDArray[Any]]:
    return lambda data: _arrays.column(data, "values", count)


def _one_of(value: str, name: str, *choices: str) -> None:
    if value not in choices:
        raise ValueError(f"{name}: expected one of {', '.join(choices)}, found {value!r}")


def _variances(data: object, count: int) -> list[NDArray[Any]]:
    """Return the elements xx, xy, xz, yy, yz, zz."""
    array = _arrays.numbers(data, "covariance")
    if array.shape == (count, 6):
        return list(array.T)
    if array.shape != (count, 3, 3):
        raise ValueError(
            f"covariance: expected an array of shape ({count}, 3, 3) or ({count}, 6), found {_arrays.shape_text(array)}"
        )
    with np.errstate(invalid="ignore"):
        uneven = np.abs(array - array.transpose(0, 2, 1)) > 1e-5 * np.abs(array).max(axis=(1, 2), keepdims=True)
    if uneven.any():
        first = int(np.argwhere(uneven)[0][0])
        raise ValueError(f"covariance: expected symmetric matrices, found number {first}: {array[first].tolist()}")
    return [array[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]


def _indices(data: object, name: str, dtype: Any) -> NDArray[Any]:
    """Return whole numbers within the range of a type."""
    array = _arrays.numbers(data, name)
    if array.dtype.kind == "f" and (not np.all(np.isfinite(array)) or np.any(array != np.floor(array))):
        raise TypeError(f"{name}: expected whole numbers, found dtype {array.dtype} with others among them")
    limits = np.iinfo(dtype)
    if array.size and (array.min() < limits.min or array.max() > limits.max):
        wrong = array.min() if array.min() < limits.min else array.max()
        raise ValueError(f"{name}: expected numbers from {limits.min} to {limits.max}, found {wrong}")
    return array.astype(dtype, copy=False)


def _grid_values(data: object, name: str) -> NDArray[Any]:
    array = _arrays.numbers(data, name)
    if array.ndim not in (1, 2, 3) or array.size == 0:
        raise ValueError(f"{name}: expected an array of shape (nx, ny, nz), found {_arrays.shape_text(array)}")
    return array


def _grid_converter(shape: tuple[int, ...]) -> Callable[[object], NDArray[Any]]:
    def convert(data: object) -> NDArray[Any]:
        array = _arrays.numbers(data, "values")
        if array.shape != shape:
            raise ValueError(f"values: expected an array of shape {shape}, found {_arrays.shape_text(array)}")
        return _arrays.fortran(array)

    return convert


def _texture(picture: object) -> tuple[int, int, NDArray[np.uint8]]:
    """Return width, height and four bytes a pixel."""
    array = _arrays.numbers(picture, "texture")
    if array.ndim != 3 or array.shape[2] not in (3, 4) or array.size == 0:
        raise ValueError(f"texture: expected an array of shape (height, width, 3 or 4), found {_arrays.shape_text(array)}")
    if array.dtype.kind == "f":
        array = (np.clip(np.nan_to_num(array), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    elif array.dtype != np.uint8:
        raise TypeError(f"texture: expected bytes or floats, found dtype {array.dtype}")
    if array.shape[2] == 3:
        array = np.concatenate([array, np.full((*array.shape[:2], 1), 255, np.uint8)], axis=2)
    height, width = array.shape[:2]
    return width, height, np.ascontiguousarray(array).ravel()
