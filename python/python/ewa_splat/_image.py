"""Defines pictures and column densities."""

from __future__ import annotations

import json
import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _core
from ._camera import Camera

if TYPE_CHECKING:
    import PIL.Image


class Image:
    """A picture: float32, linear, premultiplied RGBA, rows from the top.

    Attributes
    ----------
    depth : (height, width) or None
        Depth at which half of the light is absorbed, world units along the view; infinite where it never is.
    normals : (height, width, 3) or None
        Normals of opaque surfaces, world space.
    camera
        Camera of the picture.
    """

    def __init__(
        self,
        pixels: NDArray[np.float32],
        *,
        depth: NDArray[np.float32] | None = None,
        normals: NDArray[np.float32] | None = None,
        camera: Camera | None = None,
        stats: str | None = None,
        error: str | None = None,
    ) -> None:
        self._pixels = pixels
        self._stats = stats
        self._error = error
        self.depth = depth
        self.normals = normals
        self.camera = camera

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Image:
        """Read a picture: png, exr, pfm or npy."""
        return cls(_core.read_image(os.fspath(path)))

    def numpy(self) -> NDArray[np.float32]:
        """Return the pixels (height, width, 4), linear and premultiplied, without a copy."""
        return self._pixels

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self._pixels, dtype=dtype) if copy else np.asarray(self._pixels, dtype=dtype)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = self._pixels.shape[:2]
        return width, height

    def png(self, *, transparent: bool = False) -> bytes:
        """Return the bytes of a PNG file. The background is dark grey, #1c1c21, unless `transparent`."""
        data = _core.write_image(np.ascontiguousarray(self._pixels), None, transparent)
        assert data is not None
        return data

    def _repr_png_(self) -> bytes:
        return self.png()

    def to_pil(self, *, transparent: bool = False) -> PIL.Image.Image:
        """Return an sRGB-encoded picture for display, over dark grey unless `transparent`. Needs Pillow."""
        import io

        import PIL.Image

        return PIL.Image.open(io.BytesIO(self.png(transparent=transparent)))

    def save(self, path: str | os.PathLike[str], *, transparent: bool = False) -> None:
        """Write the picture: png as `png` returns it; exr, pfm and npy store the linear numbers.

        Raises
        ------
        ValueError
            Another extension, or an absent folder.
        OSError
            A file that cannot be written; no incomplete file is left behind.
        """
        _core.write_image(np.ascontiguousarray(self._pixels), os.fspath(path), transparent)

    @cached_property
    def stats(self) -> dict[str, Any]:
        """Counts and times, as in the command line's ``--stats``."""
        return {} if self._stats is None else dict(json.loads(self._stats))

    @cached_property
    def measured_error(self) -> dict[str, float] | None:
        """The picture's error, measured in a sample of its tiles: p999, max, tiles and pixels.

        It is ``None`` unless the picture was rendered with ``measure_error=True``.
        """
        return None if self._error is None else dict(json.loads(self._error))

    def __repr__(self) -> str:
        width, height = self.size
        return f"Image({width} x {height})"


class DeepImage:
    """Colours and opacities along the ray of each pixel, in samples of depth.

    Depths are world units along the view. Within a sample the optical depth is spread evenly.

    Attributes
    ----------
    camera
        Camera of the picture.
    """

    def __init__(self, deep: _core.Deep, camera: Camera) -> None:
        self._deep = deep
        self.camera = camera

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of samples of each pixel, (height, width)."""
        return self._deep.counts()

    @cached_property
    def samples(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Fronts (n,), backs (n,) and linear RGBA (n, 4), premultiplied, of all samples: row by row, front to back."""
        return self._deep.samples()

    def before(self, depth: ArrayLike | None = None) -> Image:
        """Return the picture in front of the depths of another renderer, (height, width); the whole one without them."""
        ends = None if depth is None else _arrays.pixels(depth, "depth", ())
        return Image(self._deep.before(ends), camera=self.camera)

    def transmittance(self, depth: float) -> NDArray[np.float32]:
        """Return the share of light that reaches the eye from a depth, (height, width)."""
        return self._deep.transmittance(depth)

    def depth(self, of: str) -> NDArray[np.float32]:
        """Return a depth of each pixel, infinite where it is transparent.

        Parameters
        ----------
        of
            "half", where half of the light from behind is lost; "entry" and "exit", where all but a 256th of the pixel's
            opacity lies behind and in front; "median", where half of it is reached; "mean", weighted by opacity.
        """
        return self._deep.depth(of)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a deep OpenEXR 2 file (.exr) with the channels A, B, G, R, Z and ZBack."""
        self._deep.write(os.fspath(path))


class Column:
    """A column density, the mean of a field along each pixel's ray, or a slice through a field.

    Attributes
    ----------
    values : (height, width) float32
        Field times length, the mean, or the field; rows from the top. Means are NaN where there is nothing.
    pixel_area
        Area of a pixel, world units squared; ``None`` under perspective, where it varies.
    amplitude_sum
        The sum of what is summed over all particles: their masses, or value times volume.
    not_finite
        The number of values that are not finite; they add nothing.
    camera
        Camera of the column density.
    title
        What the values are of, for labels.
    unit
        Unit of the values of means and slices of a field, if the data have it; ``None`` for integrals, whose unit is that
        of the field times that of the positions.
    """

    def __init__(self, told: dict[str, Any], what: str = "column") -> None:
        self.values: NDArray[np.float32] = told["values"]
        self.pixel_area: float | None = told["pixel_area"]
        self.amplitude_sum: float = told["amplitude_sum"]
        self.not_finite: int = told["not_finite"]
        self.camera = Camera({"kind": "calibrated"} | told["camera"])
        field = told["field"]
        self.title: str = {
            "column": "column density" if field is None else f"column of {field}",
            "mean": f"mean {field}",
            "slice": "density" if field is None else field,
        }[what]
        self.unit: str | None = None if what == "column" else told["unit"]
        self._scale = "linear" if what == "mean" else None

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top for ``plt.imshow(column, extent=column.extent)``.

        The unit is the world's, measured along the camera's right and up directions from the world's origin. If the
        camera looks along an axis, these are the data's coordinates, which fall to the right if it looks from behind
        (`Camera.along("-z")`). Under perspective, the unit is pixels.
        """
        height, width = self.values.shape
        if self.pixel_area is None:
            return 0.0, float(width), float(height), 0.0
        view = self.camera._asked()
        right, down = np.array(view["rotation"][0]), np.array(view["rotation"][1])
        eye, focal, centre = np.array(view["eye"]), view["focal_px"], view["centre_px"]
        x, y = float(right @ eye), float(-down @ eye)
        left, top = x - centre[0] / focal[0], y + centre[1] / focal[1]
        sign = -1.0 if right.min() == -1.0 else 1.0
        return sign * left, sign * (left + width / focal[0]), top - height / focal[1], top

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.values.shape[0], self.values.shape[1]

    def sum_times_area(self) -> float | None:
        """Return the sum of the pixels times their area: for a density, the visible mass. ``None`` under perspective."""
        if self.pixel_area is None:
            return None
        return float(self.values.sum(dtype=np.float64)) * self.pixel_area

    def _pixels(self, cmap: str | None, range: tuple[float, float] | None, scale: str | None) -> NDArray[np.float32]:
        values = np.ascontiguousarray(self.values)
        ends = None if range is None else [float(end) for end in range]
        return _core.column_colours(values, cmap, ends, scale or self._scale)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        cmap: str | None = None,
        range: tuple[float, float] | None = None,
        scale: str | None = None,
    ) -> None:
        """Write the values to npy, pfm or exr, or their colours to png.

        Parameters
        ----------
        path
            File to write; its extension chooses the format.
        cmap
            Colour map of a png; by default viridis, or coolwarm about 0 for values of both signs.
        range
            Values at the ends of the map; by default those of the picture.
        scale
            ``"log"``, ``"linear"`` or ``"symlog"``; by default log, but linear for means and for values of both signs.

        Raises
        ------
        ValueError
            Another extension; colours of a file that holds the values.
        """
        name = os.fspath(path)
        if name.lower().endswith(".png"):
            _core.write_image(self._pixels(cmap, range, scale), name, True)
            return
        said = {"cmap": cmap, "range": range, "scale": scale}
        given = [key for key, value in said.items() if value is not None]
        if given:
            raise ValueError(f"{given[0]}: expected a png, which has colours, found {os.path.basename(name)}")
        _core.write_column(np.ascontiguousarray(self.values), self.pixel_area, name)

    def plot(
        self,
        ax: Any = None,
        *,
        cmap: Any = None,
        range: tuple[float, float] | None = None,
        scale: str | None = None,
        colorbar: bool = True,
    ) -> Any:
        """Draw the values with matplotlib, with coordinates at the axes and a colour bar.

        Parameters
        ----------
        ax
            Axes to draw on; by default the current ones.
        cmap, range, scale
            As in `save`; `cmap` may be a colour map of matplotlib.
        colorbar
            Whether a colour bar is added.

        Returns
        -------
        matplotlib.image.AxesImage
        """
        import matplotlib.colors
        import matplotlib.pyplot

        axes = matplotlib.pyplot.gca() if ax is None else ax
        values = np.ascontiguousarray(self.values)
        # A colour map of matplotlib is not one of ours, whose names decide whether values lie about 0.
        map, scale, ends = _core.column_look(values, None, scale or self._scale)
        low, high = range or ends or (1.0, 10.0)
        norm: Any
        if scale == "log":
            values = np.where(values > 0, values, np.nan).astype(np.float32)
            norm = matplotlib.colors.LogNorm(low, high)
        elif scale == "symlog":
            norm = matplotlib.colors.SymLogNorm(1e-3 * max(abs(low), abs(high)), vmin=low, vmax=high)
        else:
            norm = matplotlib.colors.Normalize(low, high)
        picture = axes.imshow(values, extent=self.extent, norm=norm, cmap=cmap or map, interpolation="none")
        if colorbar:
            label = self.title if self.unit is None else f"{self.title} [{self.unit}]"
            axes.figure.colorbar(picture, ax=axes, label=label)
        return picture

    def _repr_png_(self) -> bytes:
        data = _core.write_image(self._pixels(None, None, None), None, False)
        assert data is not None
        return data

    def __repr__(self) -> str:
        height, width = self.shape
        return f"Column({self.title}, {width} x {height})"


def picture(image: Image | ArrayLike | str | os.PathLike[str], name: str) -> NDArray[np.float32]:
    """Return the pixels of a picture, an array or a file."""
    if isinstance(image, (str, os.PathLike)):
        image = Image.open(image)
    if isinstance(image, Image):
        return np.ascontiguousarray(image.numpy())
    array = _arrays.numbers(image, name)
    if array.ndim != 3 or array.shape[2] != 4:
        raise ValueError(f"{name}: expected an array of shape (height, width, 4), found {_arrays.shape_text(array)}")
    return _arrays.narrowed(array, np.float32)


def compare(a: Image | ArrayLike | str, b: Image | ArrayLike | str) -> dict[str, float | None]:
    """Compute the difference of two pictures.

    Parameters
    ----------
    a, b
        Pictures, arrays (height, width, 4) of linear premultiplied colours, or files; `a` is the reference.

    Returns
    -------
    dict
        rmse, max, p999 (the 99.9th percentile), psnr (``None`` for equal pictures), mean_difference, ssim, flip.

    Examples
    --------
    >>> import numpy as np, ewa_splat as es
    >>> es.compare(np.zeros((16, 16, 4)), np.full((16, 16, 4), 0.25))["rmse"]
    0.25
    """
    return dict(json.loads(_core.compare(picture(a, "a"), picture(b, "b"))))
