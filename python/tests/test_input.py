"""What arrays may be, and what is said of those that will not do."""

from __future__ import annotations

import numpy as np
import pytest

import ewa_splat as es

RANDOM = np.random.default_rng(7)
POSITIONS = RANDOM.normal(size=(200, 3))
VALUES = POSITIONS[:, 0].copy()


def drawn(*things) -> np.ndarray:
    return es.Renderer(*things, backend="cpu").render(size=(48, 36)).numpy()


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">f4", ">i2", "?"])
def test_any_type_of_numbers(dtype):
    values = np.arange(200).astype(dtype)
    positions = np.arange(600).reshape(200, 3) % 7 + np.arange(200)[:, None]
    report = es.Volume.from_points(positions.astype(np.float32), values).report
    assert report.particles == 200
    wanted = values.astype(np.float32)
    assert report.value_range == (wanted.min(), wanted.max())


@pytest.mark.parametrize("layout", ["reversed", "strided", "fortran", "readonly", "list", "memoryview"])
def test_any_layout(layout):
    places, values = POSITIONS, VALUES
    if layout == "reversed":
        places, values = places[::-1][::-1], values[::-1][::-1]
    elif layout == "strided":
        places, values = np.repeat(places, 3, axis=1)[:, ::3], np.repeat(values, 2)[::2]
    elif layout == "fortran":
        places = np.asfortranarray(places)
    elif layout == "readonly":
        places, values = places.copy(), values.copy()
        places.flags.writeable = values.flags.writeable = False
    elif layout == "list":
        places, values = places.tolist(), values.tolist()
    elif layout == "memoryview":
        places, values = memoryview(places), memoryview(values)
    assert np.array_equal(drawn(es.Volume.from_points(places, values)), drawn(es.Volume.from_points(POSITIONS, VALUES)))


def test_grids_of_any_order_are_one():
    values = RANDOM.normal(size=(6, 5, 4)).astype(np.float32)
    of_c = drawn(es.Volume.from_grid(values))
    for other in (np.asfortranarray(values), values[::-1][::-1], values.astype(">f8"), np.repeat(values, 2, 1)[:, ::2]):
        assert np.array_equal(drawn(es.Volume.from_grid(other)), of_c)


def test_the_first_index_is_x():
    values = np.zeros((9, 5, 3), np.float32)
    values[-1] = 1.0
    volume = es.Volume.from_grid(values, spacing=(1, 2, 3), origin=(10, 20, 30))
    assert np.array_equal(volume.bounds, [[10, 20, 30], [18, 28, 36]])
    top = es.TransferFunction.from_points([(0.4, (1, 1, 1), 0.0), (0.6, (1, 1, 1), 0.9)], unit_distance=1)
    picked = es.Renderer(volume, backend="cpu").pick(32, 24, es.Camera.look_at((30, 24, 33), (14, 24, 33)), (64, 48))
    assert picked and all(p.position[0] >= 10 for p in picked)
    image = es.Renderer(volume, backend="cpu").render(es.Camera.look_at((14, -40, 33), (14, 24, 33)), (64, 48), transfer_function=top)
    alpha = image.numpy()[..., 3]
    # Seen along +y with z up, x points to the right.
    assert alpha[:, 32:].sum() > 10 * alpha[:, :32].sum()
    turned = es.Volume.from_grid(values, direction=[[0, 1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.array_equal(turned.bounds[1], [4, 8, 2])


def test_what_is_masked_or_not_finite_is_left_out_and_counted():
    mask = np.zeros(200, bool)
    mask[:10] = True
    masked = es.Volume.from_points(POSITIONS, np.ma.masked_array(VALUES, mask)).report
    assert (masked.samples, masked.particles, masked.left_out) == (200, 190, 10)
    places = np.ma.masked_array(POSITIONS, np.repeat(mask[:, None], 3, axis=1))
    assert es.Volume.from_points(places, VALUES).report.left_out == 10
    values = VALUES.copy()
    values[3], values[4], values[5] = np.nan, np.inf, -np.inf
    report = es.Volume.from_points(POSITIONS, values).report
    assert report.left_out == 3 and "not finite" in report.findings[0]
    whole = np.ma.masked_array(np.arange(200), np.zeros(200, bool))
    assert es.Volume.from_points(POSITIONS, whole).report.left_out == 0
    nodes = np.stack(np.meshgrid(*[np.arange(5.0)] * 3, indexing="ij"), axis=-1)
    field = np.ma.masked_less(nodes[..., 0], 0.5)
    assert es.Volume.from_structured(nodes, field).report.left_out == 25


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_nothing_that_can_be_drawn_is_an_error(poison):
    with pytest.raises(ValueError, match="not finite"):
        drawn(es.Volume.from_points(POSITIONS, np.full(200, poison)))
    with pytest.raises(ValueError):
        drawn(es.Surfels.from_points(POSITIONS, np.full((200, 3), poison), 0.1))


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: es.Volume.from_points(POSITIONS[:, :2]), ValueError, r"positions: .*\(n, 3\).*\(200, 2\)"),
        (lambda: es.Volume.from_points(np.empty((0, 3))), ValueError, "positions: expected at least one"),
        (lambda: es.Volume.from_points(VALUES), ValueError, r"positions: .*\(200,\)"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES[:5]), ValueError, r"values: .*\(200,\).*\(5,\)"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES.astype(object)), TypeError, "values: .*objects"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES * 1j), TypeError, "values: .*complex"),
        (lambda: es.Volume.from_points(POSITIONS, ["a"] * 200), TypeError, "values: .*dtype"),
        (lambda: es.Volume.from_points([[1, 2], [3]]), TypeError, "positions"),
        (lambda: es.Volume.from_points(None), TypeError, "positions"),
        (lambda: es.Volume.from_points(POSITIONS, radius=VALUES, smoothing_length=VALUES), ValueError, "one shape"),
        (lambda: es.Volume.from_points(POSITIONS, scales=POSITIONS), ValueError, "rotations"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES, color=(1, 0, 0)), ValueError, "color"),
        (lambda: es.Volume.from_points(POSITIONS, radius=-1.0), ValueError, "radius: .*above 0"),
        (lambda: es.Volume.from_points(POSITIONS, covariance=np.ones((200, 2, 2))), ValueError, "covariance"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES, kernel="box"), ValueError, "kernel: .*cubic.*box"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES, colour=1), TypeError, "colour"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES, up=(0, 0, 0)), ValueError, "up"),
        (lambda: es.Volume.from_points(POSITIONS, VALUES, range=(2, 1)), ValueError, "range"),
        (lambda: es.Volume.from_grid(np.zeros((2, 2, 2, 2))), ValueError, r"values: .*\(2, 2, 2, 2\)"),
        (lambda: es.Volume.from_grid(np.zeros((0, 2, 2))), ValueError, "values"),
        (lambda: es.Volume.from_grid(np.zeros((2, 2, 2)), spacing=(1, 2)), ValueError, "spacing"),
        (lambda: es.Volume.from_grid(np.zeros((2, 2, 2)), origin=(0, 0, np.nan)), ValueError, "origin"),
        (lambda: es.Volume.from_grid(np.zeros((2, 2, 2)), coordinates=[[0, 1], [0, 1], [1, 0]]), ValueError, "rise"),
        (lambda: es.Volume.from_grid(np.zeros((2, 2, 2)), of="faces"), ValueError, "of: .*faces"),
        (lambda: es.Volume.from_structured(np.zeros((2, 2, 3)), np.zeros((2, 2))), ValueError, "points"),
        (lambda: es.Volume.from_structured(np.zeros((2, 2, 2, 3)), np.zeros(8)), ValueError, r"values: .*\(2, 2, 2\).*\(8,\)"),
        (lambda: es.Volume.from_cells(POSITIONS, [4, 0, 1, 2], [10], VALUES), ValueError, "cell 0"),
        (lambda: es.Volume.from_cells(POSITIONS, [4, 0, 1, 2, 999], [10], VALUES), ValueError, "node 999"),
        (lambda: es.Volume.from_cells(POSITIONS, [4, 0, 1, 2, 3.5], [10], VALUES), TypeError, "cells: .*whole"),
        (lambda: es.Volume.from_cells(POSITIONS, [[0, 1, 2, 3]], 10, VALUES[:3]), ValueError, "values"),
        (lambda: es.Volume.from_cells(POSITIONS, [[0, 1, 2, 3]], 1000, VALUES), ValueError, "cell_types"),
        (lambda: es.Surfels.from_mesh(POSITIONS, [[0, 1, 200]]), ValueError, "faces: .*200"),
        (lambda: es.Surfels.from_mesh(POSITIONS, [[0, 1, -1]]), ValueError, "faces: .*-1"),
        (lambda: es.Surfels.from_mesh(POSITIONS, [[0, 1, 2]], uv=POSITIONS[:, :2]), ValueError, "texture"),
        (lambda: es.Surfels.from_mesh(POSITIONS, [[0, 1, 2]], colors=POSITIONS[:9]), ValueError, "colors"),
        (lambda: es.Surfels.from_points(POSITIONS, POSITIONS[:4], 1.0), ValueError, "normals"),
        (lambda: es.Splats.from_arrays(POSITIONS, POSITIONS, POSITIONS, VALUES, colors=POSITIONS), ValueError, "rotations"),
        (lambda: es.Renderer(), ValueError, "things"),
        (lambda: es.Renderer(3), TypeError, "things: .*int"),
        (lambda: es.Renderer(es.Volume.from_points(POSITIONS), backend="opengl"), ValueError, "backend"),
        (lambda: es.load("no/such/file.vtu"), FileNotFoundError, "no/such/file.vtu"),
        (lambda: es.load(3), TypeError, "source"),
        (lambda: es.Camera.look_at((0, 0, 0), (0, 0, 0)), ValueError, "eye"),
        (lambda: es.Camera.fit(fov=180), ValueError, "fov"),
        (lambda: es.TransferFunction.from_points([(1, None, 0.5), (0, None, 0.5)]), ValueError, "points"),
        (lambda: es.TransferFunction.from_json("{"), ValueError, "JSON"),
    ],
)
def test_errors_name_the_argument_and_what_was_found(make, error, words):
    with pytest.raises(error, match=words):
        drawn(made) if isinstance(made := make(), es.Drawable) else made


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"size": (0, 10)}, ValueError, "size"),
        ({"size": (10,)}, ValueError, "size"),
        ({"size": (1e9, 10)}, ValueError, "size"),
        ({"tolerance": 0}, ValueError, "tolerance"),
        ({"tolerance": np.nan}, ValueError, "tolerance"),
        ({"camera": "front"}, TypeError, "camera"),
        ({"transfer_function": 3}, TypeError, "transfer_function"),
        ({"transfer_function": "no-such-map"}, ValueError, "no-such-map"),
        ({"composite": "add"}, ValueError, "composite: .*slabs.*add"),
        ({"slab_thickness": 1.0}, ValueError, "slab_thickness"),
        ({"post_classification": True}, ValueError, "post_classification"),
        ({"clip": [(0, 0, 1)]}, ValueError, "clip"),
        ({"clip": [(0, 0, 0, 1)]}, ValueError, "plane"),
        ({"background": (1, 2)}, ValueError, "background"),
        ({"lights": [(1, 2)]}, (ValueError, TypeError), "lights"),
        ({"colour": 3}, TypeError, "colour"),
        ({"cutoff": "wide"}, TypeError, "cutoff"),
    ],
)
def test_settings_that_will_not_do(settings, error, words):
    renderer = es.Renderer(es.Volume.from_points(POSITIONS, VALUES), backend="cpu")
    with pytest.raises(error, match=words):
        renderer.render(**{"size": (16, 12), **settings})
    # It draws on.
    assert renderer.render(size=(16, 12), transfer_function=None).size == (16, 12)


def test_names_of_columns_are_no_more_than_names():
    plain = es.Volume.from_points(POSITIONS, VALUES)
    for name in ("mass", "h", "vxx", "R", "rho", "density", "id"):
        named = es.Volume.from_points(POSITIONS, VALUES, name=name)
        assert np.array_equal(drawn(named), drawn(plain)), name
        assert named.report.field.startswith(name)


def test_arrays_are_copied():
    places, values = POSITIONS.astype(np.float32), VALUES.astype(np.float32)
    volume = es.Volume.from_points(places, values)
    places[:], values[:] = np.nan, np.nan
    assert volume.report.particles == 200


def test_dlpack():
    class Tensor:
        """As others' tensors: nothing but the protocol."""

        def __init__(self, array):
            self.array = array

        def __dlpack__(self, **keywords):
            return self.array.__dlpack__(**keywords)

        def __dlpack_device__(self):
            return self.array.__dlpack_device__()

    places = POSITIONS.astype(np.float32)
    ours = drawn(es.Volume.from_points(Tensor(places), Tensor(VALUES.astype(np.float32))))
    assert np.array_equal(ours, drawn(es.Volume.from_points(places, VALUES.astype(np.float32))))


def test_values_are_exchanged():
    random = np.random.default_rng(2)
    first, second = random.random((2, 200)).astype(np.float32)
    function = es.TransferFunction.from_points([(0, (0, 0, 1), 0.1), (1, (1, 0, 0), 0.6)], unit_distance=0.3)
    for keep_shapes in (False, True):

        def of(values, keep_shapes=keep_shapes):
            volume = es.Volume.from_points(POSITIONS, values)
            return es.Renderer(volume, backend="cpu", keep_shapes=keep_shapes)

        expected = of(second).render(size=(48, 36), transfer_function=function).numpy()
        renderer = of(first)
        before = renderer.render(size=(48, 36), transfer_function=function).numpy()
        renderer.set_values(second)
        after = renderer.render(size=(48, 36)).numpy()
        assert np.abs(before - expected).max() > 0.01
        assert np.array_equal(after, expected)
    with pytest.raises(ValueError, match="values"):
        renderer.set_values(second[:5])
    with pytest.raises(ValueError, match="thing"):
        renderer.set_values(second, thing=3)


def renderer_of(values, function) -> np.ndarray:
    renderer = es.Renderer(es.Volume.from_points(POSITIONS, values), backend="cpu")
    return renderer.render(size=(48, 36), transfer_function=function).numpy()


def test_functions_are_exchanged():
    renderer = es.Renderer(es.Volume.from_points(POSITIONS, VALUES), backend="cpu")
    points = [(-2, (0, 0, 1), 0.1), (2, (1, 0, 0), 0.6)]
    for unit in (0.5, None):
        function = es.TransferFunction.from_points(points, unit_distance=unit)
        renderer.render(size=(48, 36), transfer_function="viridis")
        changed = renderer.render(size=(48, 36), transfer_function=function).numpy()
        assert np.array_equal(changed, renderer_of(VALUES, function))
        kept = renderer.render(size=(48, 36)).numpy()
        assert np.array_equal(changed, kept)
    assert np.array_equal(renderer.render(size=(48, 36), transfer_function=None).numpy(), renderer_of(VALUES, None))
    assert len(renderer.transfer_functions) == 1


def test_matplotlib_maps_have_their_colours():
    matplotlib = pytest.importorskip("matplotlib")
    function = es.TransferFunction.from_matplotlib("magma", [0.0, 1.0], vmin=-1, vmax=3)
    points = function._document["points"]
    assert points[0]["value"] == -1 and points[-1]["value"] == 3
    assert np.allclose(points[128]["color"], matplotlib.colormaps["magma"](128 / 255)[:3])
    assert points[0]["opacity"] == 0 and points[-1]["opacity"] == 1
    with pytest.raises(ValueError, match="opacity"):
        es.TransferFunction.from_matplotlib("magma", [], vmin=0, vmax=1)


@pytest.mark.parametrize("package", ["astropy", "unyt"])
def test_volumes_and_variances_come_into_the_unit_of_positions(package):
    if package == "astropy":
        units = pytest.importorskip("astropy.units")
        kpc, pc, sun = units.kpc, units.pc, units.Msun
    else:
        unyt = pytest.importorskip("unyt")
        # `unyt.Msun` is a quantity in kilograms.
        kpc, pc, sun = unyt.kpc, unyt.pc, unyt.unit_symbols.Msun
    positions, lengths = POSITIONS * kpc, np.full(200, 0.2) * kpc
    density, volume = np.full(200, 100.0) * sun / kpc**3, np.full(200, 0.01) * kpc**3
    for own in (volume, volume.to(pc**3)):
        thing = es.Volume.from_points(positions, density, volume=own, smoothing_length=lengths)
        column = es.Renderer(thing, backend="cpu").column_density(size=(32, 32))
        assert column.amplitude_sum == pytest.approx(200.0, rel=1e-5)
    variances = np.tile(0.04 * np.eye(3), (200, 1, 1)) * kpc**2
    pictures = [drawn(es.Volume.from_points(positions, covariance=own)) for own in (variances, variances.to(pc**2))]
    assert np.allclose(*pictures, atol=1e-5)
    with pytest.raises(ValueError, match="expected volumes in kpc"):
        es.Volume.from_points(positions, density, volume=lengths)
