"""Converts cameras, depths, colours and transfer functions of VTK. Foreign classes are recognised by their names."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._camera import Camera
from ._transfer import TransferFunction, TransferLike

#: Number of samples of a colour function that is not linear between its points.
SAMPLES = 257
#: Number of entries of a lookup table made of a transfer function.
ENTRIES = 256
#: Number of linear values in the table of sRGB codes. One step at black is a twentieth of a code.
LINEAR_STEPS = 65_535


def classes(module: str) -> Any:
    """Return a module of VTK."""
    import importlib

    return importlib.import_module(f"vtkmodules.{module}")


# Cameras --------------------------------------------------------------------------------------------------------------


def view_of(renderer: Any) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Return the calibrated view of a VTK renderer at its present size, and the matrix of its projection.

    Raises
    ------
    ValueError
        A camera that shears.
    """
    camera = renderer.GetActiveCamera()
    width, height, _, _ = region_of(renderer)
    world = _matrix(camera.GetModelViewTransformMatrix())
    turn = world[:3, :3]
    projection = _matrix(camera.GetProjectionTransformMatrix(renderer.GetTiledAspectRatio(), -1.0, 1.0))
    is_parallel = projection[3, 2] == 0.0
    # Shifts of the picture's middle, in halves of its size: a window centre, or a tile of a larger picture.
    shift, shear = projection[:2, 3], projection[:2, 2]
    if not is_parallel:
        shift, shear = -shear, shift
    is_sheared = bool(shear.any() or projection[0, 1] or projection[1, 0])
    if is_sheared or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-9):
        raise ValueError("camera: expected a view that turns and moves, found one that shears or scales")
    view = {
        "kind": "calibrated",
        "eye": (-turn.T @ world[:3, 3]).tolist(),
        "rotation": [turn[0].tolist(), (-turn[1]).tolist(), (-turn[2]).tolist()],
        "focal_px": [projection[0, 0] * width / 2.0, projection[1, 1] * height / 2.0],
        "centre_px": [(1.0 + shift[0]) * width / 2.0, (1.0 - shift[1]) * height / 2.0],
        "size": [width, height],
        "orthographic": bool(is_parallel),
    }
    return view, projection


def region_of(renderer: Any) -> tuple[int, int, int, int]:
    """Return the width and height of a renderer in pixels, and its lower left corner in the window."""
    numbers: list[list[int]] = [[0], [0], [0], [0]]
    renderer.GetTiledSizeAndOrigin(*numbers)
    width, height, left, bottom = (int(number[0]) for number in numbers)
    return width, height, left, bottom


def _matrix(matrix: Any) -> NDArray[np.float64]:
    return np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])


def depths_of(buffer: NDArray[np.float32], projection: NDArray[np.float64]) -> NDArray[np.float32]:
    """Convert a depth buffer (0 near, 1 far) to depths along the camera's axis; infinite where it is 1."""
    device = 2.0 * buffer.astype(np.float64) - 1.0
    if projection[3, 2] == 0.0:
        depths = (projection[2, 3] - device) / projection[2, 2]
    else:
        depths = projection[2, 3] / (device + projection[2, 2])
    return np.where(buffer < 1.0, depths, np.inf).astype(np.float32)


def of_outlines(depths: NDArray[np.float32], codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return depths that suit the colours of pixels with several samples, of which a depth buffer holds any one.

    A pixel that a mesh covers in part has a part of its opacity. It gets the depth of what covers most of it.
    """
    coverage = codes[..., 3]
    is_behind = (coverage < 128) & (coverage > 0)
    is_before = (coverage >= 128) & (coverage < 255) & np.isinf(depths)
    if not (is_behind.any() or is_before.any()):
        return depths
    height, width = depths.shape
    wide = np.pad(depths, 1, constant_values=np.inf)
    nearest = np.min([wide[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)
    return np.where(is_behind, np.inf, np.where(is_before, nearest, depths)).astype(np.float32)


# Colours --------------------------------------------------------------------------------------------------------------


def encoded(linear: NDArray[Any]) -> NDArray[np.float64]:
    """Return sRGB-encoded numbers from 0 to 1 of linear ones."""
    light = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def _decoded(codes: NDArray[Any]) -> NDArray[np.float64]:
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


_DECODED = _decoded(np.arange(256) / 255.0).astype(np.float32)
_ENCODED = np.rint(255.0 * encoded(np.arange(LINEAR_STEPS + 1) / LINEAR_STEPS)).astype(np.uint8)


def linear_of(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return linear colours of sRGB codes."""
    return _DECODED[codes]


def codes_of(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return sRGB codes of linear colours."""
    return _ENCODED[np.rint(np.clip(linear, 0.0, 1.0) * LINEAR_STEPS).astype(np.uint16)]


def composited(light: NDArray[np.float32], codes: NDArray[np.uint8], *, in_codes: bool) -> NDArray[np.uint8]:
    """Return codes of a picture, linear and premultiplied, over codes.

    The colours of `codes` count as opaque. Its opacities are those of what was drawn on them, as a window without a
    background has them.
    """
    through = 1.0 - light[..., 3:]
    if in_codes:
        share = np.where(light[..., 3:] > 0, light[..., 3:], 1.0)
        rgb = 255.0 * share * encoded(light[..., :3] / share) + through * codes[..., :3]
        colours = np.rint(np.clip(rgb, 0.0, 255.0)).astype(np.uint8)
    else:
        colours = codes_of(light[..., :3] + through * linear_of(codes[..., :3]))
    opacities = np.rint(255.0 * np.clip(light[..., 3:], 0.0, 1.0) + np.clip(through, 0.0, 1.0) * codes[..., 3:])
    return np.concatenate([colours, opacities.astype(np.uint8)], axis=-1)


# Transfer functions ---------------------------------------------------------------------------------------------------


def is_function(source: Any) -> bool:
    """Whether an object is a transfer function of VTK, or a pair of colours and opacities."""
    parts = source if isinstance(source, (tuple, list)) else (source,)
    return len(parts) in (1, 2) and all(callable(getattr(part, "IsA", None)) for part in parts)


def time_of(source: Any) -> int:
    """Return the time at which a transfer function of VTK was last changed."""
    parts = source if isinstance(source, (tuple, list)) else (source,)
    return max(int(part.GetMTime()) for part in parts)


def function_of(source: Any) -> TransferFunction:
    """Convert a transfer function of VTK.

    Parameters
    ----------
    source
        A `vtkLookupTable` with opacities, a pair of a `vtkColorTransferFunction` and a `vtkPiecewiseFunction`, or a
        `vtkVolumeProperty`, which also has the length over which opacities are stated.

    Raises
    ------
    ValueError
        Colours without opacities, a table of categories.
    TypeError
        Another object.
    """
    parts = list(source) if isinstance(source, (tuple, list)) else [source]
    if len(parts) == 1:
        (only,) = parts
        if only.IsA("vtkLookupTable"):
            return _of_table(only)
        if only.IsA("vtkVolumeProperty"):
            colours, opacities = only.GetRGBTransferFunction(0), only.GetScalarOpacity(0)
            return _of_pair(colours, opacities, only.GetScalarOpacityUnitDistance(0))
        if only.IsA("vtkDiscretizableColorTransferFunction") and only.GetEnableOpacityMapping():
            return _of_pair(only, only.GetScalarOpacityFunction(), None)
        if only.IsA("vtkColorTransferFunction"):
            raise ValueError(
                "transfer_function: expected a pair of a vtkColorTransferFunction and a vtkPiecewiseFunction, found colours "
                "without opacities"
            )
    elif parts[0].IsA("vtkColorTransferFunction") and parts[1].IsA("vtkPiecewiseFunction"):
        return _of_pair(parts[0], parts[1], None)
    found = ", ".join(part.GetClassName() for part in parts)
    raise TypeError(
        "transfer_function: expected a vtkLookupTable, a vtkVolumeProperty, or a pair of a vtkColorTransferFunction and a "
        f"vtkPiecewiseFunction, found {found}"
    )


def _of_table(table: Any) -> TransferFunction:
    """Convert a lookup table: a step for each entry."""
    if table.GetIndexedLookup():
        raise ValueError("transfer_function: expected a lookup table of a range, found one of categories")
    table.Build()
    low, high = table.GetTableRange()
    count = table.GetNumberOfTableValues()
    is_log = table.GetScale() == 1
    if not low < high or (is_log and low <= 0):
        raise ValueError(f"transfer_function: expected a lookup table over a range, found {low:g} to {high:g}")
    edges = np.geomspace(low, high, count + 1) if is_log else np.linspace(low, high, count + 1)
    entries = [table.GetTableValue(i) for i in range(count)]
    points: list[tuple[float, Any, Any]] = []
    # Values beyond the ends get the first and the last point's colour.
    if table.GetUseBelowRangeColor():
        points.append((float(edges[0]), *_parted(table.GetBelowRangeColor())))
    for i, entry in enumerate(entries):
        points += [(float(edge), *_parted(entry)) for edge in edges[i : i + 2]]
    if table.GetUseAboveRangeColor():
        points.append((float(edges[-1]), *_parted(table.GetAboveRangeColor())))
    return TransferFunction.from_points(points, scale="log" if is_log else "linear")


def _parted(colour: Any) -> tuple[list[float], float]:
    return list(colour[:3]), colour[3]


def _of_pair(colours: Any, opacities: Any, unit: float | None) -> TransferFunction:
    """Convert colours and opacities: their own points if both are linear between them, samples otherwise."""
    is_log = colours.GetScale() == 1
    nodes, is_plain = [], colours.GetColorSpace() == 0 and not is_log
    for function, size in ((colours, 6), (opacities, 4)):
        for i in range(function.GetSize()):
            node = [0.0] * size
            function.GetNodeValue(i, node)
            nodes.append(node[0])
            is_plain = is_plain and node[-2:] == [0.5, 0.0]
    if len(nodes) == 0 or colours.GetSize() == 0 or opacities.GetSize() == 0:
        raise ValueError("transfer_function: expected colours and opacities with points, found none")
    is_plain = is_plain and not getattr(colours, "GetDiscretize", int)()
    values = np.unique(nodes)
    low, high = float(values[0]), float(values[-1])
    if not is_plain and low < high:
        log = is_log and low > 0
        between = np.geomspace(low, high, SAMPLES) if log else np.linspace(low, high, SAMPLES)
        values = np.unique(np.concatenate([values, between]))
    points: list[tuple[float, Any, Any]] = []
    if not opacities.GetClamping():
        points.append((low, list(colours.GetColor(low)), 0.0))
    points += [(float(v), list(colours.GetColor(v)), opacities.GetValue(v)) for v in values]
    if not opacities.GetClamping():
        points.append((high, list(colours.GetColor(high)), 0.0))
    return TransferFunction.from_points(points, unit_distance=unit)


def converted(function: Any) -> TransferLike:
    """Return a transfer function that a renderer accepts."""
    given: TransferLike = function_of(function) if is_function(function) else function
    return given


def fill(table: Any, function: TransferFunction) -> None:
    """Fill a lookup table of VTK with the colours and opacities of a transfer function in its own form."""
    document = json.loads(function.to_json())
    points = document["points"]
    scale = document.get("scale", "linear")
    low, high = document["range"]
    is_log = scale == "log" and low > 0
    shares = (np.arange(ENTRIES) + 0.5) / ENTRIES
    values = low * (high / low) ** shares if is_log else low + (high - low) * shares

    def position(value: Any) -> Any:
        if scale == "log":
            return np.log(np.maximum(value, np.finfo(float).tiny))
        if scale == "symlog":
            return np.sign(value) * np.log1p(np.abs(value) / document["linear_within"])
        return np.asarray(value)

    at, own = position(values), position(np.array([point["value"] for point in points]))
    columns = np.array([[*point["color"], point["opacity"]] for point in points]).T
    rgba = np.stack([np.interp(at, own, column) for column in columns], axis=1)
    if document.get("color_space") == "linear":
        rgba[:, :3] = encoded(rgba[:, :3])
    table.SetNumberOfTableValues(ENTRIES)
    table.SetTableRange(low, high)
    table.SetScale(1 if is_log else 0)
    for i, entry in enumerate(rgba):
        table.SetTableValue(i, *(float(x) for x in entry))


def camera_of(renderer: Any) -> Camera:
    """Return the camera of a VTK renderer at its present size."""
    return Camera(view_of(renderer)[0])
