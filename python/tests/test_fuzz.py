"""Whatever constructors are given they make something that is drawn, or raise one of two exceptions."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import ewa_splat as es

TYPES = st.sampled_from(["f2", "f4", "f8", ">f8", "i1", "u1", "i2", "u2", "i4", "i8", "u8", "?"])
SMALL = st.integers(0, 6)


@st.composite
def anything(draw):
    """Arrays of any shape, type and order, masked or not; and what are no arrays."""
    kind = draw(st.integers(0, 9))
    if kind == 0:
        return draw(st.sampled_from([None, "text", 3, 2.5, float("nan"), [], [[]], {}, object(), [1, "a"], b"x", 1j]))
    shape = draw(st.one_of(
        st.tuples(SMALL, st.just(3)), st.tuples(SMALL), st.tuples(SMALL, SMALL, SMALL), st.tuples(SMALL, SMALL, SMALL, st.just(3)),
        st.lists(SMALL, max_size=5).map(tuple),
    ))  # fmt: skip
    array = draw(arrays.arrays(draw(TYPES), shape))
    if kind == 1 and array.ndim:
        array = np.asfortranarray(array)
    elif kind == 2 and array.ndim:
        array = array[::-2]
    elif kind == 3:
        array = np.ma.masked_array(array, draw(arrays.arrays("?", array.shape)))
    elif kind == 4:
        array.flags.writeable = False
    elif kind == 5:
        array = array.astype(object)
    return array


def tried(make) -> None:
    try:
        thing = make()
    except (ValueError, TypeError) as error:
        assert str(error)
        return
    try:
        image = es.Renderer(thing, backend="cpu").render(size=(8, 6))
    except ValueError as error:
        assert str(error)
        return
    assert image.numpy().shape == (6, 8, 4)
    assert np.isfinite(image.numpy()).all()


FUZZ = settings(max_examples=120, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


@FUZZ
@given(st.data())
def test_points(data):
    names = ["values", "radius", "smoothing_length", "covariance", "scales", "rotations", "mass", "volume", "opacity", "color"]
    chosen = data.draw(st.lists(st.sampled_from(names), unique=True, max_size=3))
    keywords = {name: data.draw(anything()) for name in chosen}
    positions = data.draw(anything())
    tried(lambda: es.Volume.from_points(positions, **keywords))


@FUZZ
@given(st.data())
def test_points_that_fit(data):
    count = data.draw(st.integers(1, 8))
    floats = st.floats(width=32)
    positions = data.draw(arrays.arrays("f4", (count, 3), elements=floats))
    values = data.draw(st.one_of(st.none(), arrays.arrays("f4", count, elements=floats)))
    shape = data.draw(st.sampled_from(["radius", "smoothing_length", "mass", "volume", "opacity"]))
    numbers = data.draw(arrays.arrays("f4", count, elements=floats))
    tried(lambda: es.Volume.from_points(positions, values, **{shape: numbers}))


@FUZZ
@given(anything(), anything(), anything(), st.sampled_from(["nodes", "cells", "edges"]))
def test_grids(values, spacing, points, of):
    tried(lambda: es.Volume.from_grid(values, spacing, of=of))
    tried(lambda: es.Volume.from_grid(values, of=of))
    tried(lambda: es.Volume.from_structured(points, values, of=of))


@FUZZ
@given(anything(), anything(), anything(), anything())
def test_cells_and_meshes(points, lists, kinds, values):
    tried(lambda: es.Volume.from_cells(points, lists, kinds, values))
    tried(lambda: es.Surfels.from_mesh(points, lists, values=values, count=50))
    tried(lambda: es.Surfels.from_mesh(points, lists, colors=values, count=50))
    tried(lambda: es.Surfels.from_points(points, lists, kinds, values))


@FUZZ
@given(st.data())
def test_cells_that_nearly_fit(data):
    points = data.draw(arrays.arrays("f8", (8, 3), elements=st.floats(-2, 2)))
    cells = data.draw(st.lists(st.integers(-1, 9), max_size=24))
    kinds = data.draw(arrays.arrays("u1", st.integers(0, 4), elements=st.sampled_from([1, 5, 10, 12, 13, 14, 24, 42, 99])))
    tried(lambda: es.Volume.from_cells(points, cells, kinds, np.arange(8.0)))


@FUZZ
@given(st.binary(max_size=200), st.sampled_from(["a.csv", "a.vtu", "a.npy", "a.ply", "a.obj", "data"]))
def test_bytes(data, name):
    import io

    tried(lambda: es.load(io.BytesIO(data), name=name))
