"""Converts other packages' objects to things. It recognises them by their attributes and imports none of the packages."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._scene import Drawable, Surfels, Volume, is_table, load
from ._units import in_unit_of, unit_text

#: VTK's cell-type numbers for meshio's cell names.
_MESHIO_CELLS = {
    "vertex": 1, "line": 3, "triangle": 5, "polygon": 7, "quad": 9, "tetra": 10, "hexahedron": 12, "wedge": 13,
    "pyramid": 14, "penta_prism": 15, "hexa_prism": 16, "line3": 21, "triangle6": 22, "quad8": 23, "tetra10": 24,
    "hexahedron20": 25, "wedge15": 26, "pyramid13": 27, "quad9": 28, "hexahedron27": 29, "quad6": 30, "wedge12": 31,
    "wedge18": 32, "hexahedron24": 33, "triangle7": 34,
}  # fmt: skip
_SOLID = frozenset(["tetra", "hexahedron", "wedge", "pyramid", "penta_prism", "hexa_prism"])


def adapt(data: Any, field: str | None = None, **options: Any) -> Drawable:
    """Make a thing from another package's object; a `Drawable` is returned unchanged.

    ================================================ ===========================================================
    object                                           becomes
    ================================================ ===========================================================
    PyVista and VTK: image data, rectilinear,        grids with the active scalars, or `field`
    structured and unstructured grids
    PyVista and VTK: poly data with faces            surfels: a field, ``"RGB"`` colours, or white
    PyVista and VTK: poly data of points             particles
    PyVista and VTK: multi-block data                all of its blocks
    meshio meshes                                    cells with a field; triangles alone: surfels
    trimesh meshes and scenes                        surfels with the colours or the texture of their visual
    swiftsimio data sets                             the gas: coordinates, smoothing lengths, masses, `field`
    pynbody snapshots and families                   the same
    yt data containers                               the gas of particle sets; `field` of cells as points with volumes
    xarray data arrays with two-dimensional or       curvilinear grids
    three-dimensional coordinates (ROMS, NEMO)
    xarray data arrays with one-dimensional ones     rectilinear grids
    pandas data frames, astropy tables, structured   particles, as `Volume.from_table`
    arrays
    tensors of (n, 3), by DLPack                     points
    paths                                            results of `load`
    ================================================ ===========================================================

    Parameters
    ----------
    data
        The object.
    field
        Name of the field to show. If two arrays share a name, ``"cells:NAME"`` or ``"nodes:NAME"``.
    **options
        See `Sampling`. For an xarray data array also ``x``, ``y`` and ``z``, the names of its coordinates, and ``depth``,
        the name of a coordinate that points down.

    Raises
    ------
    TypeError
        An object of no known kind.
    """
    if isinstance(data, Drawable):
        if field is not None or options:
            raise TypeError("field: expected an object of another package beside it, found a thing that is made already")
        return data
    if isinstance(data, (str, os.PathLike)):
        return load(data, field, **options)
    if is_table(data):
        return Volume.from_table(data, field, **options)
    for looks_like, make in _KINDS:
        if looks_like(data):
            return make(data, field, options)
    raise TypeError(
        f"things: expected a Volume, Surfels, Splats, a path, or an object of PyVista, VTK, meshio, trimesh, swiftsimio, "
        f"pynbody, yt or xarray, a table, found {type(data).__module__}.{type(data).__name__}"
    )


def _no_field(field: str, names: list[str]) -> ValueError:
    return ValueError(f"field: expected one of {', '.join(names) or 'none, as there is no array'}, found {field!r}")


def _magnitude(array: Any) -> Any:
    """Return one number a sample: a vector's length, in the vector's unit."""
    return array if np.ndim(array) == 1 else np.sqrt((array * array).sum(axis=1))


# PyVista and VTK ------------------------------------------------------------------------------------------------------


def _is_vtk(data: Any) -> bool:
    return callable(getattr(data, "GetClassName", None)) and callable(getattr(data, "IsA", None))


def _vtk_array(array: Any) -> NDArray[Any]:
    """Convert a VTK array to NumPy without a copy, through VTK's bridge."""
    bridge = importlib.import_module("vtkmodules.util.numpy_support")
    return np.asarray(bridge.vtk_to_numpy(array))


def _vtk_fields(data: Any) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for of, attributes in (("nodes", data.GetPointData()), ("cells", data.GetCellData())):
        arrays = (attributes.GetArray(i) for i in range(attributes.GetNumberOfArrays()))
        found[of] = {array.GetName(): array for array in arrays if array is not None and array.GetName()}
    return found


def _vtk_chosen(data: Any, field: str | None) -> tuple[str, str, NDArray[Any]] | None:
    """Return the association, the name and the values of the field to show."""
    found = _vtk_fields(data)
    wanted = [of for of in ("nodes", "cells")]
    name = field
    if field is not None and field.split(":", 1)[0] in found:
        of, name = field.split(":", 1)
        wanted = [of]
    if name is None:
        for of, attributes in (("nodes", data.GetPointData()), ("cells", data.GetCellData())):
            active = attributes.GetScalars()
            if active is not None and active.GetName():
                return of, active.GetName(), _magnitude(_vtk_array(active))
        for of in wanted:
            for name, array in found[of].items():
                if not name.startswith("vtk"):
                    return of, name, _magnitude(_vtk_array(array))
        return None
    for of in wanted:
        if name in found[of]:
            return of, name, _magnitude(_vtk_array(found[of][name]))
    raise _no_field(str(field), [*found["nodes"], *found["cells"]])


def _blanked(data: Any, of: str, values: NDArray[Any]) -> NDArray[Any]:
    """Mask the values that VTK hides."""
    ghosts = (data.GetPointData() if of == "nodes" else data.GetCellData()).GetArray("vtkGhostType")
    if ghosts is None:
        return values
    hidden = (_vtk_array(ghosts) & (2 if of == "nodes" else 32)) != 0
    return np.ma.masked_array(values, hidden) if hidden.any() else values


def _of_vtk(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    if data.IsA("vtkCompositeDataSet"):
        return _of_blocks(data, field, options)
    if not data.IsA("vtkDataSet"):
        raise TypeError(f"things: expected a data set of VTK, found {data.GetClassName()}")
    chosen = _vtk_chosen(data, field)
    if data.IsA("vtkPolyData"):
        return _of_poly_data(data, chosen, options)
    if chosen is None:
        raise ValueError("field: expected an array of points or cells to show, found none")
    of, name, values = chosen
    values = _blanked(data, of, values)
    keywords = {"of": of, "name": name, **options}
    if data.IsA("vtkUnstructuredGrid"):
        points = _vtk_array(data.GetPoints().GetData())
        return Volume.from_cells(points, _vtk_cells(data), _vtk_array(_vtk_types(data)), values, **keywords)
    if data.IsA("vtkImageData") or data.IsA("vtkRectilinearGrid") or data.IsA("vtkStructuredGrid"):
        extent = data.GetExtent()
        dims = [int(extent[2 * axis + 1] - extent[2 * axis] + 1) for axis in range(3)]
        shape = [max(n - 1, 1) if of == "cells" else n for n in dims]
        grid = values.reshape(shape, order="F")
        if data.IsA("vtkStructuredGrid"):
            nodes = _vtk_array(data.GetPoints().GetData()).reshape((*reversed(dims), 3)).transpose(2, 1, 0, 3)
            return Volume.from_structured(nodes, grid, **keywords)
        if data.IsA("vtkRectilinearGrid"):
            axes = (data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates())
            return Volume.from_grid(grid, coordinates=[_vtk_array(axis) for axis in axes], **keywords)
        spacing = np.array(data.GetSpacing())
        turn = np.array([[data.GetDirectionMatrix().GetElement(i, j) for j in range(3)] for i in range(3)])
        first = np.array(extent[::2])
        origin = np.array(data.GetOrigin()) + turn @ (spacing * first)
        return Volume.from_grid(grid, spacing, origin, turn, **keywords)
    raise TypeError(f"things: expected a grid, poly data or an image of VTK, found {data.GetClassName()}")


def _vtk_types(data: Any) -> Any:
    types = getattr(data, "GetCellTypesArray", None)
    found = types() if types is not None else None
    return found if found is not None else data.GetCellTypes()


def _vtk_cells(data: Any) -> NDArray[np.int64]:
    """Return VTK's list of cells, polyhedra by their faces."""
    cells = data.GetCells()
    offsets = _vtk_array(cells.GetOffsetsArray()).astype(np.int64)
    nodes = _vtk_array(cells.GetConnectivityArray()).astype(np.int64)
    counts = np.diff(offsets)
    kinds = _vtk_array(_vtk_types(data))
    if not (kinds == 42).any():
        return np.insert(nodes, offsets[:-1], counts)
    lists: list[int] = []
    for i, kind in enumerate(kinds):
        if kind != 42:
            lists += [int(counts[i]), *(int(n) for n in nodes[offsets[i] : offsets[i + 1]])]
            continue
        cell = data.GetCell(i)
        own = [cell.GetNumberOfFaces()]
        for j in range(own[0]):
            # Each face is read at once, because VTK reuses the object for the next one.
            face = cell.GetFace(j).GetPointIds()
            count = face.GetNumberOfIds()
            own += [count, *(int(face.GetId(k)) for k in range(count))]
        lists += [len(own), *own]
    return np.array(lists, np.int64)


def _of_poly_data(data: Any, chosen: tuple[str, str, NDArray[Any]] | None, options: dict[str, Any]) -> Drawable:
    points = _vtk_array(data.GetPoints().GetData())
    corners, of_cell = _vtk_triangles(data)
    if len(corners) == 0:
        if chosen is None or chosen[0] != "nodes":
            return Volume.from_points(points, **options)
        return Volume.from_points(points, chosen[2], name=chosen[1], **options)
    if chosen is not None:
        of, name, values = chosen
        array = _vtk_fields(data)[of][name]
        if array.GetNumberOfComponents() in (3, 4) and name.lower() in ("rgb", "rgba", "colors", "color"):
            colours = _vtk_array(array)
            colours = colours if of == "nodes" else colours[of_cell]
            return Surfels.from_mesh(points, corners, colors=colours, **options)
        values = values if of == "nodes" else values[of_cell]
        return Surfels.from_mesh(points, corners, values=values, name=name, **options)
    return Surfels.from_mesh(points, corners, **options)


def _vtk_triangles(data: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return triangles from polygons (as fans) and strips, and the number of each one's cell."""
    corners: list[NDArray[np.int64]] = []
    cells: list[NDArray[np.int64]] = []
    first = data.GetVerts().GetNumberOfCells() + data.GetLines().GetNumberOfCells()
    for array, is_strip in ((data.GetPolys(), False), (data.GetStrips(), True)):
        count = array.GetNumberOfCells()
        if count:
            offsets = _vtk_array(array.GetOffsetsArray()).astype(np.int64)
            nodes = _vtk_array(array.GetConnectivityArray()).astype(np.int64)
            sizes = np.diff(offsets)
            for step in range(int(sizes.max()) - 2):
                own = np.flatnonzero(sizes > step + 2)
                start = offsets[own]
                if is_strip:
                    turn = step % 2
                    ends = (start + step, start + step + 1 + turn, start + step + 2 - turn)
                else:
                    ends = (start, start + step + 1, start + step + 2)
                corners.append(np.stack([nodes[end] for end in ends], axis=1))
                cells.append(own + first)
        first += count
    if not corners:
        return np.empty((0, 3), np.int64), np.empty(0, np.int64)
    return np.concatenate(corners), np.concatenate(cells)


def _of_blocks(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    from . import _core

    iterator = data.NewIterator()
    things, missing = [], None
    iterator.InitTraversal()
    while not iterator.IsDoneWithTraversal():
        block = iterator.GetCurrentDataObject()
        if block is not None and block.GetNumberOfPoints() > 0:
            try:
                things.append(_of_vtk(block, field, options))
            except ValueError as error:
                # A field that one block lacks may be in another.
                missing = error
        iterator.GoToNextItem()
    if not things:
        raise missing or ValueError("things: expected blocks with points, found none")
    return Drawable(_core.Drawable.together([thing._core for thing in things]))


# meshio ---------------------------------------------------------------------------------------------------------------


def _is_meshio(data: Any) -> bool:
    return all(hasattr(data, name) for name in ("points", "cells", "point_data", "cell_data"))


def _of_meshio(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    points = np.asarray(data.points)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    names = [*data.point_data, *data.cell_data]
    if field is not None and field not in names:
        raise _no_field(field, names)
    shown = field if field is not None else (names[0] if names else None)
    solid = [i for i, block in enumerate(data.cells) if any(block.type.startswith(kind) for kind in _SOLID)]
    flat = [i for i, block in enumerate(data.cells) if block.type.startswith(("triangle", "quad"))]
    if not solid:
        return _of_flat_meshio(data, points, flat, shown, options)
    lists, kinds, values = [], [], []
    for i in solid:
        block = data.cells[i]
        nodes = np.asarray(block.data)
        if block.type not in _MESHIO_CELLS:
            raise ValueError(f"cells: expected kinds that VTK has, found {block.type}")
        lists.append(np.column_stack([np.full(len(nodes), nodes.shape[1]), nodes]).ravel())
        kinds.append(np.full(len(nodes), _MESHIO_CELLS[block.type], np.uint8))
        if shown in data.cell_data and shown not in data.point_data:
            values.append(_magnitude(np.asarray(data.cell_data[shown][i])))
    if shown is None:
        raise ValueError("field: expected an array of points or cells to show, found none")
    of = "nodes" if shown in data.point_data else "cells"
    shown_values = _magnitude(np.asarray(data.point_data[shown])) if of == "nodes" else np.concatenate(values)
    cells, types = np.concatenate(lists), np.concatenate(kinds)
    return Volume.from_cells(points, cells, types, shown_values, of=of, name=shown, **options)


def _of_flat_meshio(
    data: Any, points: NDArray[Any], flat: list[int], shown: str | None, options: dict[str, Any]
) -> Drawable:
    if not flat:
        if shown in data.point_data:
            return Volume.from_points(points, _magnitude(np.asarray(data.point_data[shown])), name=str(shown), **options)
        return Volume.from_points(points, **options)
    faces, values = [], []
    for i in flat:
        nodes = np.asarray(data.cells[i].data)
        parts = [nodes[:, [0, 1, 2]]]
        if data.cells[i].type.startswith("quad"):
            parts.append(nodes[:, [0, 2, 3]])
        faces += parts
        if shown is not None and shown not in data.point_data:
            values += [_magnitude(np.asarray(data.cell_data[shown][i]))] * len(parts)
    triangles = np.concatenate(faces)
    if shown is None:
        return Surfels.from_mesh(points, triangles, **options)
    field = np.concatenate(values) if values else _magnitude(np.asarray(data.point_data[shown]))
    return Surfels.from_mesh(points, triangles, values=field, name=shown, **options)


# trimesh --------------------------------------------------------------------------------------------------------------


def _is_trimesh(data: Any) -> bool:
    is_mesh = all(hasattr(data, name) for name in ("vertices", "faces", "visual"))
    return is_mesh or (hasattr(data, "geometry") and hasattr(data, "graph") and callable(getattr(data, "dump", None)))


def _of_trimesh(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    from . import _core

    if hasattr(data, "geometry"):
        meshes = [mesh for mesh in data.dump() if hasattr(mesh, "faces")]
        if not meshes:
            raise ValueError("things: expected a scene with meshes, found none")
        parts = [_of_trimesh(mesh, field, options) for mesh in meshes]
        return Surfels(_core.Drawable.together([part._core for part in parts]))
    vertices, faces, visual = np.asarray(data.vertices), np.asarray(data.faces), data.visual
    if field is not None:
        known = {**getattr(data, "vertex_attributes", {}), **getattr(data, "face_attributes", {})}
        if field not in known:
            raise _no_field(field, list(known))
        return Surfels.from_mesh(vertices, faces, values=_magnitude(np.asarray(known[field])), name=field, **options)
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        material = visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if image is not None and visual.uv is not None:
            picture = np.asarray(image.convert("RGBA"))
            return Surfels.from_mesh(vertices, faces, uv=np.asarray(visual.uv), texture=picture, **options)
        main = np.asarray(material.main_color)
        return Surfels.from_mesh(vertices, faces, colors=np.tile(main, (len(vertices), 1)), **options)
    if kind == "vertex":
        return Surfels.from_mesh(vertices, faces, colors=np.asarray(visual.vertex_colors), **options)
    if kind == "face":
        return Surfels.from_mesh(vertices, faces, colors=np.asarray(visual.face_colors), **options)
    return Surfels.from_mesh(vertices, faces, **options)


# Snapshots ------------------------------------------------------------------------------------------------------------


def _is_swiftsimio(data: Any) -> bool:
    whole = hasattr(data, "metadata") and hasattr(data, "gas")
    return whole or (hasattr(data, "coordinates") and hasattr(data, "particle_ids") and hasattr(data, "metadata"))


def _swift_kernel(data: Any) -> str | None:
    """Return the name of the kernel that SWIFT's header states."""
    scheme = getattr(data.metadata, "hydro_scheme", None) or {}
    stated = scheme.get("Kernel function", "")
    if isinstance(stated, np.ndarray) and stated.size == 1:
        stated = stated.item()
    text = stated.decode(errors="replace") if isinstance(stated, bytes) else str(stated)
    text = text.lower().replace(" ", "-")
    names = ("cubic", "quartic", "quintic", "wendland-c2", "wendland-c4", "wendland-c6")
    return next((name for name in names if name in text), None)


def _of_swiftsimio(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    particles = data.gas if hasattr(data, "gas") else data
    positions = particles.coordinates
    keywords: dict[str, Any] = {}
    lengths = getattr(particles, "smoothing_lengths", None)
    if lengths is not None:
        # SWIFT's smoothing lengths are two standard deviations of its kernel.
        keywords["radius"] = 0.5 * lengths
        kernel = _swift_kernel(data)
        if kernel is not None and "kernel" not in options:
            keywords["kernel"] = kernel
    if field is None:
        keywords |= _mass_and_volume(getattr(particles, "masses", None), getattr(particles, "densities", None), positions)
        density = getattr(particles, "densities", None)
        if density is not None:
            return Volume.from_points(positions, density, name="densities", **_without(keywords, "mass"), **options)
        return Volume.from_points(positions, **keywords, **options)
    values = getattr(particles, field, None)
    if values is None:
        raise _no_field(field, [name for name in dir(particles) if not name.startswith("_")][:40])
    keywords |= _mass_and_volume(getattr(particles, "masses", None), getattr(particles, "densities", None), positions)
    return Volume.from_points(positions, _magnitude(values), name=field, **_without(keywords, "mass"), **options)


def _without(keywords: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: value for name, value in keywords.items() if name not in names}


def _mass_and_volume(mass: Any, density: Any, positions: Any) -> dict[str, Any]:
    """Return mass, and volume (mass over density) in cubes of the positions' unit."""
    found: dict[str, Any] = {}
    if mass is not None:
        found["mass"] = mass
    if mass is not None and density is not None:
        volume = mass / density
        unit = getattr(positions, "units", None)
        if unit is not None and hasattr(volume, "to"):
            volume = volume.to(unit**3)
        found["volume"] = np.asarray(volume, dtype=np.float64)
    return found


def _is_pynbody(data: Any) -> bool:
    return type(data).__module__.startswith("pynbody") or (hasattr(data, "loadable_keys") and hasattr(data, "families"))


def _of_pynbody(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    families = [str(family) for family in data.families()]
    gas = data.gas if "gas" in families else data
    keywords: dict[str, Any] = {}
    names = set(gas.loadable_keys()) | set(gas.keys()) | set(gas.all_keys())
    positions = gas["pos"]
    def in_positions(array: Any, power: int) -> NDArray[Any]:
        try:
            return np.asarray(in_unit_of(array, positions, power), np.float64)
        except ValueError:
            # pynbody represents missing units by a unit.
            return np.asarray(array, np.float64)

    if "smooth" in names and "gas" in families:
        keywords["smoothing_length"] = in_positions(gas["smooth"], 1)
    if "gas" in families and "mass" in names and "rho" in names:
        keywords["volume"] = in_positions(gas["mass"] / gas["rho"], 3)
    shown = field if field is not None else ("rho" if "gas" in families and "rho" in names else None)
    if shown is None:
        return Volume.from_points(np.asarray(positions), **keywords, **options)
    if shown not in names:
        raise _no_field(shown, sorted(names))
    values = gas[shown]
    options.setdefault("unit", unit_text(values))
    return Volume.from_points(np.asarray(positions), _magnitude(np.asarray(values)), name=shown, **keywords, **options)


def _is_yt(data: Any) -> bool:
    # Particle containers raise if they are asked for cells, so this looks at the data set.
    return hasattr(getattr(data, "ds", None), "derived_field_list")


#: The command line's names of kernels, by yt's.
_YT_KERNELS = {
    "cubic": "cubic", "quartic": "quartic", "quintic": "quintic", "wendland2": "wendland-c2", "wendland4": "wendland-c4",
    "wendland6": "wendland-c6",
}  # fmt: skip


def _of_yt(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    listed = data.ds.derived_field_list
    known = {name[1]: name for name in listed} | {name[1]: name for name in listed if name[0] == "gas"}
    known |= {name: name for name in listed}
    shown: Any = field if field is not None else "density"
    wanted = known.get(tuple(shown) if isinstance(shown, list) else shown, shown)
    kind = wanted[0] if isinstance(wanted, tuple) else "gas"
    values = data[wanted]
    name = wanted[1] if isinstance(wanted, tuple) else str(wanted)
    is_particle = (kind, "particle_position") in listed and len(data[kind, "particle_position"]) == len(values)
    if is_particle:
        positions = data[kind, "particle_position"].to("code_length")
        keywords: dict[str, Any] = {}
        if (kind, "smoothing_length") in listed:
            keywords["smoothing_length"] = data[kind, "smoothing_length"]
            # yt's smoothing lengths are the radii at which kernels end.
            options.setdefault("length", "support")
            kernel = _YT_KERNELS.get(str(getattr(data.ds, "kernel_name", None)))
            if kernel is not None:
                options.setdefault("kernel", kernel)
        mass, density = (kind, "particle_mass"), (kind, "density")
        if mass in listed and density in listed and len(data[density]) == len(values):
            keywords["volume"] = data[mass] / data[density]
        return Volume.from_points(positions, _magnitude(values), name=name, **keywords, **options)
    # Cells of all refinement levels: each kernel is as wide as its cell.
    positions = np.stack([np.asarray(data["index", axis].to("code_length")) for axis in "xyz"], axis=1)
    widths = np.stack([np.asarray(data["index", f"d{axis}"].to("code_length")) for axis in "xyz"], axis=1)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1))
    return Volume.from_points(
        positions, values, scales=0.6 * widths, rotations=turns, volume=widths.prod(axis=1), name=name, **options
    )


# xarray ---------------------------------------------------------------------------------------------------------------


def _is_xarray(data: Any) -> bool:
    is_array = all(hasattr(data, name) for name in ("coords", "dims", "attrs"))
    return is_array and (hasattr(data, "data") or hasattr(data, "data_vars"))


def _of_xarray(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    if hasattr(data, "data_vars"):
        names = [str(name) for name in data.data_vars]
        if field is None:
            field = next((name for name in names if data[name].ndim >= 2), None)
        if field is None or field not in names:
            raise _no_field(str(field), names)
        data = data[field]
    elif field is not None:
        raise ValueError("field: expected a data set of xarray beside it, found a data array")
    array = data.squeeze()
    if array.ndim not in (2, 3):
        raise ValueError(f"things: expected a data array of two or three dimensions, found {data.dims}; select a time")
    given = {axis: options.pop(axis, None) for axis in "xyz"}
    down = options.pop("depth", None)
    x, y, z = (_coordinate(array, axis, given[axis], down) for axis in "xyz")
    if x is None or y is None:
        raise ValueError(f"x, y: expected names of coordinates, found {', '.join(map(str, array.coords))}")
    name = str(array.name) if array.name is not None else "value"
    options.setdefault("unit", unit_text(array))
    order = tuple(reversed(array.dims))
    values = np.ma.masked_invalid(array.transpose(*order).values)
    axes = [x, y] if z is None else [x, y, z]
    if all(axis.ndim == 1 for axis in axes) and array.ndim == len(axes):
        order = tuple(axis.dims[0] for axis in axes)
        values = array.transpose(*order).values
        lines = [np.asarray(axis.values, float) for axis in axes]
        for i, line in enumerate(lines):
            if len(line) > 1 and line[0] > line[-1]:
                lines[i], values = line[::-1], np.flip(values, i)
        lines += [np.zeros(1)] * (3 - len(lines))
        return Volume.from_grid(values, coordinates=lines, name=name, **options)
    heights = z if z is not None else 0.0
    points = np.stack(_aligned(array, (x, y, heights), order), axis=-1).astype(float)
    if points.ndim == 3:
        points, values = points[:, :, None, :], values[:, :, None]
    return Volume.from_structured(points, values, name=name, **options)


def _aligned(array: Any, axes: tuple[Any, ...], order: tuple[Any, ...]) -> list[NDArray[Any]]:
    """Broadcast coordinates to the data's shape, whatever subset of its dimensions they have."""
    shape = tuple(array.sizes[dim] for dim in order)
    aligned = []
    for axis in axes:
        if isinstance(axis, float):
            aligned.append(np.broadcast_to(axis, shape))
            continue
        own = [dim for dim in order if dim in axis.dims]
        plain = np.asarray(axis.transpose(*own).values)
        index = tuple(slice(None) if dim in axis.dims else None for dim in order)
        aligned.append(np.broadcast_to(plain[index], shape))
    return aligned


_NAMES = {
    "x": ("x", "lon", "longitude", "nav_lon", "lon_rho", "glamt", "x_rho", "xc", "xt"),
    "y": ("y", "lat", "latitude", "nav_lat", "lat_rho", "gphit", "y_rho", "yc", "yt"),
    "z": ("z", "z_rho", "depth", "deptht", "gdept", "lev", "level", "height", "altitude"),
}
_DOWN = frozenset(["depth", "deptht", "gdept"])


def _coordinate(array: Any, axis: str, name: str | None, down: str | None) -> Any:
    """Find a coordinate by its name, by its CF attributes, or by a usual name."""
    coordinates = {str(key): value for key, value in array.coords.items()}
    if name is not None:
        if name not in coordinates:
            raise ValueError(f"{axis}: expected one of {', '.join(coordinates)}, found {name!r}")
        found = coordinates[name]
    else:
        said = [v for v in coordinates.values() if str(v.attrs.get("axis", "")).lower() == axis and v.ndim > 0]
        usual = [v for own in _NAMES[axis] for key, v in coordinates.items() if key.lower() == own and v.ndim > 0]
        # Coordinates of positions come before those that number the array's own axes.
        both = sorted(said + usual, key=lambda v: -v.ndim)
        if not both:
            return None
        found = both[0]
    points_down = found.attrs.get("positive") == "down" or str(found.name).lower() in _DOWN
    if axis == "z" and (down == str(found.name) or (down is None and points_down)) and float(found.max()) > 0:
        return -found
    return found


# Tensors --------------------------------------------------------------------------------------------------------------


def _is_tensor(data: Any) -> bool:
    is_array = hasattr(data, "__dlpack__") or isinstance(data, np.ndarray) or hasattr(data, "__array_interface__")
    return is_array and len(getattr(data, "shape", ())) == 2


def _of_tensor(data: Any, field: str | None, options: dict[str, Any]) -> Drawable:
    if field is not None:
        raise ValueError("field: expected an object with fields beside it, found an array of positions")
    return Volume.from_points(data, **options)


_KINDS: list[tuple[Callable[[Any], bool], Callable[[Any, str | None, dict[str, Any]], Drawable]]] = [
    (_is_vtk, _of_vtk),
    (_is_meshio, _of_meshio),
    (_is_trimesh, _of_trimesh),
    (_is_pynbody, _of_pynbody),
    (_is_yt, _of_yt),
    (_is_swiftsimio, _of_swiftsimio),
    (_is_xarray, _of_xarray),
    (_is_tensor, _of_tensor),
]
