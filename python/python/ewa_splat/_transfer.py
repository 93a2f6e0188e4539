"""Defines transfer functions, which map values to colours and opacities."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Union

import numpy as np

from . import _core
from ._arrays import numbers

#: Accepted forms of a transfer function: an object, the name of a colour map, the path of a JSON file, or ``None`` for an
#: automatic one.
TransferLike = Union["TransferFunction", str, "os.PathLike[str]", None]


class TransferFunction:
    """Function from values to colours and opacities.

    Make one with `from_points`, `from_matplotlib` or `from_json`. A renderer also accepts names of colour maps
    (``"plasma"``) and paths. By default, it chooses a function from the values.

    Examples
    --------
    >>> import ewa_splat as es
    >>> es.TransferFunction.from_points([(0.0, (0, 0, 1), 0.0), (1.0, (1, 0.5, 0), 0.8)], unit_distance=0.1)
    TransferFunction(2 points from 0 to 1)
    """

    def __init__(self, document: dict[str, Any]) -> None:
        self._text = json.dumps(document)
        self._document = document
        _core.check_transfer_function(self._text)

    @classmethod
    def from_points(
        cls,
        points: Iterable[tuple[float, Sequence[float] | None, float | None]],
        *,
        unit_distance: float | None = None,
        range: tuple[float, float] | None = None,
        scale: str = "linear",
        color_space: str = "srgb",
    ) -> TransferFunction:
        """Make a function that is linear between points.

        Parameters
        ----------
        points
            Tuples (value, (r, g, b), opacity), values not decreasing. Colour and opacity may be ``None`` if other points
            give them. Two points at one value make a step.
        unit_distance
            The length over which opacities are stated, world units; by default the mean spacing of the data.
        range
            The values between which the function is tabulated; by default from the first point to the last.
        scale
            ``"linear"``, ``"log"`` or ``"symlog"``: the scale on which points are interpolated.
        color_space
            ``"srgb"`` or ``"linear"``: the space of the colours and of their interpolation.

        Raises
        ------
        ValueError
            Points out of order, numbers that are not finite, colours or opacities outside 0 to 1.
        """
        document: dict[str, Any] = {"color_space": color_space, "scale": scale}
        if unit_distance is not None:
            document["unit_distance"] = float(unit_distance)
        if range is not None:
            document["range"] = [float(range[0]), float(range[1])]
        listed = []
        for value, color, opacity in points:
            point: dict[str, Any] = {"value": float(value)}
            if color is not None:
                point["color"] = [float(c) for c in color]
            if opacity is not None:
                point["opacity"] = float(opacity)
            listed.append(point)
        document["points"] = listed
        return cls(document)

    @classmethod
    def from_matplotlib(
        cls,
        cmap: Any,
        opacity: float | Sequence[float] | Callable[[float], float] = 0.5,
        *,
        vmin: float,
        vmax: float,
        unit_distance: float | None = None,
        samples: int = 256,
    ) -> TransferFunction:
        """Make a function with the colours of a matplotlib colour map.

        Parameters
        ----------
        cmap
            A colour map, or its name.
        opacity
            One opacity for all, several spaced evenly from `vmin` to `vmax`, or a function of the position from 0 to 1.
        vmin, vmax
            The values at the map's ends.
        unit_distance
            As in `from_points`.
        samples
            Number of points taken from the map.
        """
        if isinstance(cmap, str):
            import matplotlib

            cmap = matplotlib.colormaps[cmap]
        shares = np.linspace(0.0, 1.0, samples)
        colours = np.asarray(cmap(shares), dtype=float)[:, :3]
        if callable(opacity):
            opacities = np.array([float(opacity(float(share))) for share in shares])
        else:
            given = np.atleast_1d(numbers(opacity, "opacity")).astype(float)
            if given.ndim != 1 or len(given) == 0:
                raise ValueError(f"opacity: expected one number or several in a row, found {given.shape}")
            opacities = np.interp(shares, np.linspace(0.0, 1.0, len(given)), given)
        values = vmin + (vmax - vmin) * shares
        points = zip(values, colours, opacities, strict=True)
        return cls.from_points(points, unit_distance=unit_distance)

    @classmethod
    def from_json(cls, source: str | os.PathLike[str] | dict[str, Any]) -> TransferFunction:
        """Read a function from JSON (a path, text or parsed text) in this library's form or ParaView's."""
        if isinstance(source, dict):
            return cls(source)
        if isinstance(source, str) and source.lstrip().startswith(("{", "[")):
            text = source
        else:
            with open(source, encoding="utf-8") as file:
                text = file.read()
        try:
            document = json.loads(text)
        except json.JSONDecodeError as error:
            raise ValueError(f"transfer function: expected JSON, found {error}") from None
        return cls(document)

    def to_json(self) -> str:
        """Return the function as JSON, which `from_json` and the command line read."""
        return self._text

    def __repr__(self) -> str:
        points = self._document.get("points") if isinstance(self._document, dict) else None
        if not points:
            return "TransferFunction(of ParaView)"
        first, last = points[0]["value"], points[-1]["value"]
        return f"TransferFunction({len(points)} points from {first:g} to {last:g})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TransferFunction) and self._text == other._text

    def __hash__(self) -> int:
        return hash(self._text)


def choice(function: TransferLike) -> tuple[str, str] | None:
    """Convert a transfer function to the form that the compiled part accepts."""
    if function is None:
        return None
    if isinstance(function, TransferFunction):
        return ("text", function.to_json())
    if isinstance(function, str):
        is_path = any(c in function for c in "./\\") or os.path.exists(function)
        return ("path" if is_path else "name", function)
    if isinstance(function, os.PathLike):
        return ("path", os.fspath(function))
    raise TypeError(
        "transfer_function: expected a TransferFunction, the name of a colour map, a path or None, "
        f"found {type(function).__name__}"
    )
