"""Defines keyword arguments that several calls share."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from ._transfer import TransferLike


class Sampling(TypedDict, total=False):
    """Options that turn samples into kernels; names and defaults are the command line's.

    ================== ==========================================================================================
    keyword            meaning
    ================== ==========================================================================================
    unit               the unit of the values, for legends; by default that of the quantity
    up                 default direction up of pictures, three numbers
    kernel_width       standard deviation of a kernel over the spacing
    transfer_function  as in `Renderer.render`, for this thing alone
    range              two values that an automatic function or a named colour map spans
    scale              "linear", "log" or "symlog": the scale of values within the range
    opacity_scale      factor of opacities, as extinctions
    unit_distance      the length over which a function's opacities are stated, world units
    boundary           grids: "auto", "sharp" or "soft"
    flatten            the value whose iso-surface is drawn in place of the volume
    surface            grids: True for the boundary alone, opaque and lit, in the colours of the values
    surface_opacity    grids: opacity of the boundary around the volume, seen head-on, above 0 and below 1
    shape              points: "auto", "isotropic", "covariance" or "yu-turk"
    length             points: the meaning of lengths, "h", "support", "sigma" or "fwhm"
    kernel             points: the smoothing kernel that lengths belong to, "cubic", "quartic", "quintic",
                       "wendland-c2", "wendland-c4" or "wendland-c6"; "gaussian" is the data's, drawn in columns as a Gaussian
    splat_rule         "khr", "inria", "mip" or "exact": the rule of splats; by default the file's, "exact" for arrays
    box                points: edges of the periodic box from the origin on, three numbers or one; kernels that cross a face
                       come in at the opposite one, and pictures end at the faces
    centre             points: the point in the middle of the box, by default half of its edges
    shepard            number of corrections of cell volumes
    count              meshes: surfels in all
    density            meshes: surfels per unit area
    surfel_spacing     meshes: mean distance between surfels
    ================== ==========================================================================================
    """

    unit: str | None
    up: Sequence[float] | None
    kernel_width: float
    transfer_function: TransferLike
    range: tuple[float, float]
    scale: Literal["linear", "log", "symlog"]
    opacity_scale: float
    unit_distance: float
    boundary: Literal["auto", "sharp", "soft"]
    flatten: float
    surface: bool
    surface_opacity: float
    shape: Literal["auto", "isotropic", "covariance", "yu-turk"]
    length: Literal["h", "support", "sigma", "fwhm"]
    kernel: Literal["cubic", "quartic", "quintic", "wendland-c2", "wendland-c4", "wendland-c6", "gaussian"]
    splat_rule: Literal["khr", "inria", "mip", "exact"]
    box: float | Sequence[float]
    centre: Sequence[float]
    shepard: int
    count: int
    density: float
    surfel_spacing: float


class Drawing(TypedDict, total=False):
    """Settings of a picture; names and defaults are the command line's.

    ================== ==========================================================================================
    keyword            meaning
    ================== ==========================================================================================
    composite          "over", "sheets", "axis-sheets", "slabs" or "maximum"
    slab_thickness     thickness of slabs and sheets, world units
    post_classification whether slabs are classified by their mean values
    classify           "extent" or "particle": whether kernels are classified over their extent or by their value alone
    lit                True lights volumes, too; False lights nothing; by default surfaces are lit
    lights             directional lights: (x, y, z) towards each, or (x, y, z, r, g, b)
    shadows            whether everything that is shown casts shadows of the lights; implies `lit`
    shadow_softness    size of the lights, 0 to 15 degrees (a standard deviation); implies `shadows`
    aperture           diameter of the lens's opening, world units; takes `focus`, the depth that is sharp
    focus              depth in focus, world units along the direction of view
    exposures          pictures of parts of the opening that are averaged (16; 64 suits opaque surfaces)
    blend              "auto", "encoded" or "linear": the space in which colours are composited
    order              "auto", "distance" or "depth": the order in which kernels hide one another
    clip               planes (nx, ny, nz, d) that keep nx x + ny y + nz z + d >= 0, or boxes (x0, y0, z0, x1, y1, z1)
    background         linear (r, g, b) behind everything
    background_depth   depths of what another renderer drew from the same camera, (height, width): volumes and splats
                       end there; infinite where nothing stands
    background_depth_is "z", "distance" (along each ray) or "opengl" (0 to 1): what these depths are
    background_depth_range (near, far): the planes of an OpenGL depth
    background_image   what it drew, behind the scene: (height, width, 3 or 4), linear, premultiplied
    legend             whether a colour bar is drawn into the picture
    depth, normals     whether `Image.depth` and `Image.normals` are wanted
    measure_error      whether the error is measured in a hundredth of the picture
    low_pass           variance of the low-pass filter, px²
    cutoff             cut-off radius, standard deviations
    filter             "adaptive", "exact", "ewa", "reconstruction", "low-pass", "isotropic" or "uniform-scaling"
    thresholds         (c_min, c_max) of Chen et al. 2004
    level_of_detail    whether particles far below a pixel may be merged
    linear_opacity     min(tau, 1) in place of 1 - exp(-tau)
    sub_pixel_opacity  whether kernels smaller than a pixel keep the opacity that each has alone
    opaque_edges       whether tiles with opaque edges are drawn at four samples a pixel
    show               "scene", "choice" or "count"
    ================== ==========================================================================================
    """

    composite: Literal["over", "sheets", "axis-sheets", "slabs", "maximum"]
    slab_thickness: float
    post_classification: bool
    classify: Literal["extent", "particle"]
    lit: bool
    lights: Sequence[Sequence[float]]
    shadows: bool
    shadow_softness: float
    aperture: float
    focus: float
    exposures: int
    blend: Literal["auto", "encoded", "linear"]
    order: Literal["auto", "distance", "depth"]
    clip: Sequence[Sequence[float]]
    background: Sequence[float]
    background_depth: npt.ArrayLike
    background_depth_is: Literal["z", "distance", "opengl"]
    background_depth_range: tuple[float, float]
    background_image: npt.ArrayLike
    legend: bool
    depth: bool
    normals: bool
    measure_error: bool
    low_pass: float
    cutoff: float
    filter: Literal["adaptive", "exact", "ewa", "reconstruction", "low-pass", "isotropic", "uniform-scaling"]
    thresholds: tuple[float, float]
    level_of_detail: bool
    linear_opacity: bool
    sub_pixel_opacity: bool
    opaque_edges: bool
    show: Literal["scene", "choice", "count"]


def sampling(keywords: dict[str, Any]) -> dict[str, Any]:
    """Convert the keywords of sampling to the form that the compiled part accepts."""
    from ._arrays import vector
    from ._transfer import choice

    said = dict(keywords)
    _known(said, [*Sampling.__annotations__, *_ARRAYS])
    if said.get("up") is not None:
        said["up"] = vector(said["up"], "up")
    if said.get("box") is not None:
        edges = said["box"]
        said["box"] = vector([edges] * 3 if np.ndim(edges) == 0 else edges, "box")
    if said.get("centre") is not None:
        said["centre"] = vector(said["centre"], "centre")
    if "transfer_function" in said:
        said["transfer_function"] = choice(said["transfer_function"])
    return said


def drawing(keywords: dict[str, Any]) -> dict[str, Any]:
    """Convert the keywords of pictures to the form that the compiled part accepts."""
    from ._arrays import pixels, vector
    from ._transfer import choice

    said = dict(keywords)
    _known(said, [*Drawing.__annotations__, "tolerance", "transfer_function", "camera", "size", "of", "slice"])
    if "transfer_function" in said:
        said["transfer_function"] = choice(said["transfer_function"])
    if said.get("background") is not None:
        said["background"] = vector(said["background"], "background")
    if said.get("background_depth") is not None:
        said["background_depth"] = pixels(said["background_depth"], "background_depth", ())
    if said.get("background_image") is not None:
        said["background_image"] = pixels(said["background_image"], "background_image", (3, 4))
    if said.get("lights") is not None:
        said["lights"] = lights_of(said["lights"])
    if said.get("clip") is not None:
        planes: list[list[float]] = []
        for plane in said["clip"]:
            if len(plane) == 6:
                lower, upper = vector(plane[:3], "clip"), vector(plane[3:], "clip")
                for axis in range(3):
                    unit = [0.0] * 3
                    unit[axis] = 1.0
                    planes.append([*unit, -lower[axis]])
                    planes.append([-u for u in unit] + [upper[axis]])
            else:
                planes.append(vector(plane, "clip", 4))
        said["clip"] = planes
    return said


#: Arguments of constructors, for which a misspelt keyword may stand.
_ARRAYS = (
    "values radius smoothing_length covariance scales rotations mass volume opacity color colors fields name spacing origin "
    "direction coordinates of uv texture harmonics field time_step time particle_type solution read_as dims"
).split()


def _known(keywords: dict[str, Any], names: Sequence[str]) -> None:
    """Refuse a keyword that is none of `names` but nearly one."""
    for keyword in keywords:
        if keyword in names:
            continue
        near = difflib.get_close_matches(keyword, names, 1, 0.7)
        if near:
            raise TypeError(f"{keyword}: no such keyword argument here; did you mean {near[0]}?")


def lights_of(lights: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return six numbers a light: the direction towards it and its colour, white if only the direction is given."""
    listed = [list(light) for light in lights]
    return [light + [1.0] * 3 if len(light) == 3 else light for light in listed]
