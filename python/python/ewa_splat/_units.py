"""Separates units of unyt, astropy, pint and swiftsimio from numbers, and formats them for legends."""

from __future__ import annotations

from typing import Any

import numpy as np


def unit_of(data: object) -> object | None:
    """Return the unit object of a quantity; ``None`` for plain numbers."""
    # unyt, swiftsimio, pint and yt have `units`, astropy `unit`.
    for name in ("units", "unit"):
        unit = getattr(data, name, None)
        if unit is not None and not isinstance(unit, str) and not callable(unit):
            return unit  # type: ignore[no-any-return]
    # xarray stores the unit among the attributes.
    attributes = getattr(data, "attrs", None)
    text = attributes.get("units") if isinstance(attributes, dict) else None
    return text if isinstance(text, str) else None


def unit_text(data: object) -> str | None:
    """Return a quantity's unit for legends; ``None`` if it has none or is dimensionless."""
    unit = unit_of(data)
    text = "" if unit is None else str(unit).strip()
    return None if text in ("", "1", "dimensionless") else text


def strip_unit(data: object) -> tuple[Any, object | None]:
    """Return the numbers of a quantity, and its unit."""
    unit = unit_of(data)
    if unit is None or isinstance(unit, str):
        return data, unit
    for name in ("value", "magnitude", "v", "d"):
        plain = getattr(data, name, None)
        if plain is not None and not callable(plain):
            return plain, unit
    return np.asarray(data), unit


def in_unit_of(data: object, other: object, power: int = 1) -> object:
    """Convert lengths to the unit of other lengths if both have one; areas and volumes to its powers.

    Raises
    ------
    ValueError
        Units that cannot be converted to each other.
    """
    own, length = unit_of(data), unit_of(other)
    if own is None or length is None or isinstance(own, str) or isinstance(length, str):
        return data
    # pynbody has `in_units`, the others `to`.
    convert: Any = getattr(data, "to", None) or getattr(data, "in_units", None)
    if convert is None:
        return data
    try:
        # The unit may be of any package's class; none is imported here.
        unit: Any = length
        wanted = unit if power == 1 else unit**power
        if own == wanted:
            return data
        converted: object = convert(wanted)
    except Exception as error:
        kind = {1: "lengths", 2: "areas", 3: "volumes"}[power]
        raise ValueError(f"expected {kind} in {length}{'' if power == 1 else f'^{power}'}, found {own} ({error})") from None
    return converted
