"""Converts arrays of any kind to one of the layouts that the compiled part accepts.

Contiguous float32 arrays are passed on unchanged; others are copied once. Samples with masked entries are left out: the
entries become NaN, which the library counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._units import strip_unit

#: Types that values keep. Others become float32 if it represents all their numbers, and else float64.
KEPT = (np.dtype(np.uint8), np.dtype(np.int16), np.dtype(np.uint16), np.dtype(np.float32))


def shape_text(array: NDArray[Any]) -> str:
    """Describe the shape of an array in words."""
    return f"an array of shape {array.shape}"


def numbers(data: object, name: str) -> NDArray[Any]:
    """Return an array of real numbers without its unit and its mask.

    Raises
    ------
    TypeError
        Of what is no array of numbers: objects, text, complex numbers.
    """
    plain, _ = strip_unit(data)
    data = plain
    if hasattr(data, "unmasked") and hasattr(data, "mask"):
        # Masked quantities of astropy.
        data = np.ma.masked_array(np.asarray(data.unmasked), np.asarray(data.mask))
    if isinstance(data, np.ma.MaskedArray):
        if np.ma.is_masked(data):
            masked: Any = data.astype(np.float32 if data.dtype in KEPT else np.float64)
            data = masked.filled(np.nan)
        else:
            data = data.data
    kind = getattr(getattr(data, "dtype", None), "kind", None)
    if hasattr(data, "isna") and kind in ("b", "u", "i", "f"):
        # Columns of pandas, perhaps with missing numbers.
        column: Any = data
        data = column.to_numpy(dtype=np.float64, na_value=np.nan) if column.isna().any() else column
    if not isinstance(data, np.ndarray) and hasattr(data, "__dlpack__"):
        data = np.from_dlpack(data)
    try:
        array = np.asarray(data)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected an array of numbers, found {type(data).__name__} ({error})") from None
    if array.dtype == object:
        raise TypeError(f"{name}: expected numbers, found an array of Python objects; give it a dtype")
    if array.dtype.kind not in "buif":
        raise TypeError(f"{name}: expected real numbers, found dtype {array.dtype}")
    return array


def narrowed(array: NDArray[Any], dtype: Any) -> NDArray[Any]:
    """Return a contiguous array of a type, without a copy if it is one already."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.ascontiguousarray(array, dtype=dtype)


def rows(data: object, name: str, width: int, count: int | None = None, dtype: Any = None) -> NDArray[Any]:
    """Return an array of shape (n, `width`), float32 or float64 unless `dtype` is given.

    Raises
    ------
    ValueError
        Of another shape, or of other than `count` rows.
    """
    array = numbers(data, name)
    rows = "n" if count is None else str(count)
    if array.ndim != 2 or array.shape[1] != width or (count is not None and len(array) != count):
        raise ValueError(f"{name}: expected an array of shape ({rows}, {width}), found {shape_text(array)}")
    if dtype is None:
        dtype = np.float32 if array.dtype == np.float32 else np.float64
    return narrowed(array, dtype)


def positions(data: object, name: str = "positions") -> NDArray[Any]:
    """Return positions (n, 3), at least one."""
    array = rows(data, name, 3)
    if len(array) == 0:
        raise ValueError(f"{name}: expected at least one point, found {shape_text(array)}")
    return array


def column(data: object, name: str, count: int) -> NDArray[Any]:
    """Return `count` numbers in a type that the library keeps; a single number is repeated."""
    array = numbers(data, name)
    if array.ndim == 0:
        array = np.full(count, array)
    if array.shape != (count,):
        raise ValueError(f"{name}: expected an array of shape ({count},), found {shape_text(array)}")
    return kept(array)


def kept(array: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous array in a type that the library keeps."""
    native = array.dtype.newbyteorder("=")
    if native.kind == "b":
        native = np.dtype(np.uint8)
    wider = np.float32 if np.can_cast(native, np.float32) else np.float64
    return narrowed(array, native if native in KEPT else wider)


def fortran(array: NDArray[Any]) -> NDArray[Any]:
    """Flatten an array, its first index running fastest, in a type that the library keeps."""
    return kept(array.ravel(order="F"))


def colours(data: object, name: str, count: int, channels: int) -> NDArray[np.float32]:
    """Return linear colours (n, 3) or (n, 4). Integers are sRGB-encoded, as in pictures, and are decoded.

    If four `channels` are wanted, alpha is 1 unless given.
    """
    array = numbers(data, name)
    if array.shape in ((3,), (4,)):
        array = np.broadcast_to(array, (count, len(array)))
    if array.ndim != 2 or len(array) != count or array.shape[1] not in (3, 4):
        raise ValueError(f"{name}: expected an array of shape ({count}, 3) or ({count}, 4), found {shape_text(array)}")
    if array.dtype.kind in "ui":
        # Integers of any type are bytes, except uint16, which 16-bit pictures use.
        full = 65535 if array.dtype == np.uint16 else 255
        if array.size and (array.min() < 0 or array.max() > full):
            raise ValueError(f"{name}: expected integers from 0 to {full}, found {array.min()} to {array.max()}")
        encoded = array.astype(np.float32) / np.float32(full)
        low = encoded / np.float32(12.92)
        high = ((encoded + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
        linear = np.where(encoded <= 0.04045, low, high)
        linear[:, 3:] = encoded[:, 3:]
        array = linear
    if array.shape[1] < channels:
        array = np.column_stack([array, np.ones(count, array.dtype)])
    return narrowed(array[:, :channels], np.float32)


def vector(data: object, name: str, length: int = 3) -> list[float]:
    """Return a list of `length` finite numbers."""
    array = numbers(data, name)
    if array.shape != (length,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: expected {length} finite numbers, found {np.asarray(data)!r}")
    return [float(x) for x in array]


def dims3(shape: Sequence[int]) -> list[int]:
    """Return the shape of a grid of up to three dimensions as three numbers."""
    return [*shape, 1, 1][:3]


def pixels(data: object, name: str, channels: tuple[int, ...]) -> NDArray[np.float32]:
    """Return float32 of shape (height, width), or (height, width, 4) if there are channels; opaque without a fourth.

    Raises
    ------
    ValueError
        Of another shape.
    """
    array = numbers(data, name)
    if not channels:
        if array.ndim != 2:
            raise ValueError(f"{name}: expected an array of shape (height, width), found {shape_text(array)}")
        return narrowed(array, np.float32)
    if array.ndim != 3 or array.shape[2] not in channels:
        count = " or ".join(map(str, channels))
        raise ValueError(f"{name}: expected an array of shape (height, width, {count}), found {shape_text(array)}")
    if array.dtype.kind in "ui":
        raise TypeError(f"{name}: expected linear colours from 0 to 1, found {array.dtype}; decode sRGB codes first")
    if array.shape[2] == 3:
        array = np.concatenate([array, np.ones_like(array[..., :1])], axis=2)
    return narrowed(array, np.float32)
