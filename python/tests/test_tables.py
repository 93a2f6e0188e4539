"""Arrays and tables with the same columns are the same picture."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import ewa_splat as es

RANDOM = np.random.default_rng(3)
COUNT = 120
POSITIONS = RANDOM.normal(size=(COUNT, 3)).astype(np.float32)
LENGTHS = RANDOM.uniform(0.2, 0.4, COUNT).astype(np.float32)
FACTORS = RANDOM.normal(scale=0.2, size=(COUNT, 3, 3)) + 0.2 * np.eye(3)
VARIANCES = np.einsum("nij,nkj->nik", FACTORS, FACTORS).astype(np.float32)
SCALES = RANDOM.uniform(0.1, 0.4, (COUNT, 3)).astype(np.float32)
TURNS = RANDOM.normal(size=(COUNT, 4)).astype(np.float32)
COLORS = RANDOM.uniform(size=(COUNT, 3)).astype(np.float32)
STRENGTH = RANDOM.uniform(0.05, 0.3, COUNT).astype(np.float32)
VALUES = RANDOM.uniform(size=COUNT).astype(np.float32)

#: Of each shape the arguments, and the columns of a table.
SHAPES = {
    "none": ({}, {}),
    "radius": ({"radius": LENGTHS}, {"radius": LENGTHS}),
    "smoothing_length": ({"smoothing_length": LENGTHS}, {"h": LENGTHS}),
    "covariance": (
        {"covariance": VARIANCES},
        {f"v{a}{b}": VARIANCES[:, i, j] for (i, a), (j, b) in itertools.combinations_with_replacement(enumerate("xyz"), 2)},
    ),
    "scales": (
        {"scales": SCALES, "rotations": TURNS},
        {f"scale_{i}": SCALES[:, i] for i in range(3)} | {f"rot_{i}": TURNS[:, i] for i in range(4)},
    ),
}


def columns(mass: bool, volume: bool, opacity: bool, look: str) -> tuple[dict, dict]:
    """Arguments beside a shape, and the columns that they stand for."""
    arguments, table = {}, {}
    if mass:
        arguments["mass"] = STRENGTH
        # Beside colours there is nothing that a density could be shown by.
        table["mass" if look == "color" else "m"] = STRENGTH
    if volume:
        arguments["volume"] = table["volume"] = STRENGTH**2
    if opacity:
        arguments["opacity"] = table["opacity"] = STRENGTH
    if look == "color":
        arguments["color"] = COLORS
        table |= {channel: COLORS[:, i] for i, channel in enumerate("rgb")}
    if look == "values":
        arguments["values"] = table["value"] = VALUES
    return arguments, table


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("look", ["none", "color", "values"])
def test_arrays_are_tables_with_the_same_columns(shape, look, tmp_path):
    of_shape, shape_columns = SHAPES[shape]
    for given in itertools.product([False, True], repeat=3):
        if shape == "scales" and given[2]:
            # A table of scales, rotations and opacities is one of splats.
            continue
        arguments, table = columns(*given, look)
        table = dict(zip("xyz", POSITIONS.T)) | shape_columns | table
        path = tmp_path / "table.csv"
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        text = [",".join(table), *(",".join(map(repr, row)) for row in rows)]
        path.write_text("\n".join(text) + "\n")

        def draw(thing):
            return es.Renderer(thing(), backend="cpu").render(size=(48, 36)).numpy()

        def of_arrays():
            return es.Volume.from_points(POSITIONS, **of_shape, **arguments)

        def of_table():
            return es.load(path, "value" if look == "values" else None)

        try:
            wanted = draw(of_table)
        except ValueError as error:
            with pytest.raises(ValueError, match="strength"):
                draw(of_arrays)
            assert "strength" in str(error), error
            continue
        assert np.array_equal(draw(of_arrays), wanted), (shape, look, given)
