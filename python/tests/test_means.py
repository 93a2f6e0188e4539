"""Means, slices, tables, pickles and plots of particles, against sums in numpy."""

import copy
import pickle

import numpy as np
import pytest
from conftest import needs

import ewa_splat as es

RANDOM = np.random.default_rng(5)
COUNT = 60
POSITIONS = RANDOM.uniform(0.0, 1.0, (COUNT, 3))
SIGMAS = RANDOM.uniform(0.03, 0.08, COUNT)
MASSES = RANDOM.uniform(0.5, 1.5, COUNT)
HEAT = RANDOM.uniform(-2.0, 5.0, COUNT)
SIDE = 24
CAMERA = es.Camera.along("z", centre=(0.5, 0.5, 0.5), width=1.2)


def particles():
    return es.Volume.from_points(POSITIONS, HEAT, radius=SIGMAS, mass=MASSES, fields={"wind": HEAT + 3.0}, name="heat")


def renderer():
    return es.Renderer(particles(), backend="cpu")


def pixels():
    """The coordinates of the pixels' centres across and upwards."""
    centres = (np.arange(SIDE) + 0.5) / SIDE * 1.2 - 0.1
    return np.meshgrid(centres, centres[::-1])


def on_plane(amplitudes, z, end=np.inf):
    """The sum of Gaussians on a plane across z, up to a number of standard deviations."""
    x, y = pixels()
    return on_plane_at(np.stack([x, y, np.full_like(x, z)], axis=-1), amplitudes, end)


def on_plane_at(points, amplitudes, end=np.inf):
    """The sum of Gaussians at points, up to a number of standard deviations."""
    offsets = points[..., None, :] - POSITIONS
    squares = (offsets**2).sum(axis=-1) / SIGMAS**2
    kernels = np.exp(-0.5 * squares) / ((2 * np.pi) ** 1.5 * SIGMAS**3)
    return np.where(squares < end**2, kernels, 0.0) @ amplitudes


def test_columns_are_of_mass_whatever_is_shown():
    column = renderer().column_density(CAMERA, (SIDE, SIDE))
    assert column.amplitude_sum == pytest.approx(MASSES.sum(), rel=1e-5)
    assert column.unit is None
    same = renderer().column_density(CAMERA, (SIDE, SIDE), of="mass")
    assert np.array_equal(column.values, same.values)
    of_field = renderer().column_density(CAMERA, (SIDE, SIDE), of="wind")
    assert of_field.title == "column of wind" and of_field.amplitude_sum != pytest.approx(MASSES.sum(), rel=1e-2)
    bare = es.Renderer(es.Volume.from_points(POSITIONS, HEAT, radius=SIGMAS), backend="cpu")
    with pytest.raises(ValueError, match="masses"):
        bare.column_density(CAMERA, (SIDE, SIDE), of="mass")
    with pytest.raises(ValueError, match="no-such"):
        renderer().column_density(CAMERA, (SIDE, SIDE), of="no-such")


def test_slices_are_sums_on_the_plane():
    own = renderer().column_density(CAMERA, (SIDE, SIDE), slice=0.4)
    truth = on_plane(MASSES, 0.4)
    # Gaussians end at 5.5 standard deviations.
    assert np.allclose(own.values, truth, rtol=0, atol=3e-6 * truth.max())
    assert own.title.startswith("density")
    with pytest.raises(ValueError, match="axis"):
        renderer().column_density(es.Camera.look_at((0, -5, 1), (0, 0, 0)), (8, 8), slice=0.4)
    cut = renderer().column_density(CAMERA, (SIDE, SIDE), slice=0.4, clip=[(1, 0, 0, -0.5)])
    assert np.array_equal(cut.values, np.where(pixels()[0] > 0.5, own.values, 0.0))


def test_slices_of_periodic_boxes_end_at_the_faces():
    boxed = es.Volume.from_points(POSITIONS, radius=SIGMAS, mass=MASSES, box=1.0)
    own = es.Renderer(boxed, backend="cpu").column_density(CAMERA, (SIDE, SIDE), slice=0.02)
    shifts = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    x, y = pixels()
    truth = sum(
        on_plane_at(np.stack([x, y, np.full_like(x, 0.02)], axis=-1) + shift, MASSES) for shift in shifts
    )
    inside = (x > 0) & (x < 1) & (y > 0) & (y < 1)
    # Images have kernels that reach 4.5 standard deviations into the box.
    assert np.allclose(own.values, np.where(inside, truth, 0.0), rtol=0, atol=1e-4 * truth.max())
    with pytest.raises(TypeError, match="low_pass"):
        renderer().column_density(CAMERA, (8, 8), slice=0.4, low_pass=1.0)


def test_means_are_weighed_by_mass():
    own = renderer().column_mean("heat", CAMERA, (SIDE, SIDE), slice=0.4)
    # A mean is given where kernels count: within three standard deviations.
    weights = on_plane(MASSES, 0.4, 3.0)
    assert np.array_equal(np.isfinite(own.values), weights > 0)
    there = weights > 0
    assert 50 < there.sum() < there.size
    truth = on_plane(MASSES * HEAT, 0.4, 3.0)[there] / weights[there]
    assert np.allclose(own.values[there], truth, atol=1e-4)
    assert own.title == "mean heat"
    along = renderer().column_mean("heat", CAMERA, (SIDE, SIDE))
    # Means over pixels, of ten places along each side.
    parts = ((np.arange(10) + 0.5) / 10 - 0.5) * 1.2 / SIDE
    x, y = pixels()
    sums = np.zeros((2, SIDE, SIDE))
    for dx in parts:
        for dy in parts:
            squares = (x[..., None] + dx - POSITIONS[:, 0]) ** 2 + (y[..., None] + dy - POSITIONS[:, 1]) ** 2
            kernels = np.exp(-0.5 * squares / SIGMAS**2) / SIGMAS**2
            sums += np.moveaxis(kernels @ np.stack([MASSES * HEAT, MASSES], axis=1), -1, 0)
    there = np.isfinite(along.values) & (sums[1] > 0.05 * sums[1].max())
    assert there.sum() > 100
    # Ten places leave 4e-4 of the narrowest kernel's peak.
    assert np.allclose(along.values[there], (sums[0] / sums[1])[there], atol=0.01)
    with pytest.raises(ValueError, match="below 0"):
        renderer().column_mean("wind", CAMERA, (SIDE, SIDE), weight="heat")


def test_columns_are_saved_in_colours_and_plotted(tmp_path):
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    mean = renderer().column_mean("heat", CAMERA, (SIDE, SIDE))
    mean.save(tmp_path / "a.png", cmap="plasma", range=(0, 5), scale="linear")
    mean.save(tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()
    assert mean._repr_png_()[:4] == b"\x89PNG"
    mean.save(tmp_path / "a.npy")
    assert np.array_equal(np.load(tmp_path / "a.npy"), mean.values, equal_nan=True)
    with pytest.raises(ValueError, match="cmap"):
        mean.save(tmp_path / "c.npy", cmap="plasma")
    with pytest.raises(ValueError, match="scale"):
        mean.save(tmp_path / "c.png", scale="cubic")
    _, axes = plt.subplots()
    picture = mean.plot(axes)
    assert picture.norm.vmin == -picture.norm.vmax and list(picture.get_extent()) == pytest.approx([-0.1, 1.1, -0.1, 1.1])
    assert len(axes.figure.axes) == 2
    column = renderer().column_density(CAMERA, (SIDE, SIDE))
    assert isinstance(column.plot(axes, colorbar=False).norm, matplotlib.colors.LogNorm)
    # Nothing lies on the plane.
    renderer().column_density(CAMERA, (SIDE, SIDE), slice=50.0).plot(axes)
    plt.close("all")


def same(a, b, within=0.0):
    """Whether two things are the same picture."""
    pictures = [es.Renderer(thing, backend="cpu").render(size=(40, 30)).numpy() for thing in (a, b)]
    assert np.abs(pictures[0] - pictures[1]).max() <= within


def test_tables_are_particles():
    table = {"x": POSITIONS[:, 0], "y": POSITIONS[:, 1], "z": POSITIONS[:, 2], "radius": SIGMAS, "m": MASSES, "heat": HEAT}
    expected = es.Volume.from_points(POSITIONS, HEAT, radius=SIGMAS, mass=MASSES, name="heat")
    rows = np.array(list(zip(*table.values(), strict=True)), dtype=[(name, "f8") for name in table])
    tables = [table, rows]
    try:
        import pandas

        tables.append(pandas.DataFrame(table | {"name": ["a"] * COUNT}))
    except ImportError:
        pass
    try:
        import astropy.table
        import astropy.units as u

        units = astropy.table.QTable({name: values.copy() for name, values in table.items()})
        for name in "xyz":
            units[name] = units[name] * u.kpc
        units["radius"] = (SIGMAS * 1000.0) * u.pc
        tables.append(units)
    except ImportError:
        pass
    for own in tables:
        # Tables keep float64, of which arrays are narrowed.
        same(es.Volume.from_table(own, "heat"), expected, 1e-5)
    same(es.adapt(rows, "heat"), expected, 1e-5)
    with pytest.raises(ValueError, match="x, y and z"):
        es.Volume.from_table({"a": HEAT})
    with pytest.raises(ValueError, match="length"):
        es.Volume.from_table({"x": HEAT, "y": HEAT[1:]})
    with pytest.raises(TypeError, match="table"):
        es.Volume.from_table(HEAT)


def test_rows_of_tables_with_missing_numbers_are_left_out():
    xyz = dict(zip("xyz", POSITIONS.T, strict=True))
    hidden = np.arange(COUNT) % 5 == 0
    kept = es.Volume.from_table({name: values[~hidden] for name, values in {**xyz, "heat": HEAT}.items()}, "heat")
    tables = [{**xyz, "heat": np.ma.masked_array(HEAT, hidden)}]
    rounded = (HEAT * 10).astype(int)
    try:
        import pandas

        whole = pandas.array(rounded, dtype="Int64")
        whole[hidden] = pandas.NA
        frame = pandas.DataFrame({**xyz, "heat": whole})
        assert es.Volume.from_table(frame, "heat").report.left_out == hidden.sum()
    except ImportError:
        pass
    try:
        import astropy.table
        import astropy.units as u

        tables.append(astropy.table.Table({**xyz, "heat": np.ma.masked_array(HEAT, hidden)}, masked=True))
        units = astropy.table.QTable(xyz)
        units["heat"] = astropy.utils.masked.Masked(HEAT * u.K, mask=hidden)
        tables.append(units)
        assert es.Volume.from_table(units, "heat").report.unit == "K"
        again = pickle.loads(pickle.dumps(es.Volume.from_table(units)))
        assert again.showing("heat").report.unit == "K"
    except ImportError:
        pass
    for own in tables:
        volume = es.Volume.from_table(own, "heat")
        assert (volume.report.left_out, volume.report.particles) == (hidden.sum(), kept.report.particles)
        assert volume.report.value_range == kept.report.value_range


def test_means_of_masses_are_of_masses():
    # The mean of a field that is 2 everywhere is 2, that of masses of 2 as well: their density is none of it.
    volume = es.Volume.from_points(POSITIONS, HEAT, radius=SIGMAS, mass=np.full(COUNT, 2.0), name="heat")
    for at in (None, 0.5):
        mean = es.Renderer(volume, backend="cpu").column_mean("mass", CAMERA, (SIDE, SIDE), slice=at).values
        assert np.isfinite(mean).any() and np.nanmax(np.abs(mean - 2.0)) < 1e-5


def test_things_are_pickled(tmp_path):
    x, y, z = np.mgrid[-1:1:6j, -1:1:7j, -1:1:8j]
    values = x + 2 * y * z
    np.save(tmp_path / "a.npy", np.concatenate([POSITIONS, HEAT[:, None]], axis=1))
    things = [
        particles(),
        es.Volume.from_grid(values, 0.3, (1, 2, 3)),
        es.Volume.from_grid(values[:-1, :-1, :-1], 0.3, of="cells"),
        es.Volume.from_grid(values, coordinates=[np.arange(n) ** 1.5 for n in values.shape]),
        es.Volume.from_structured(np.stack([x, y, z + 0.1 * x], axis=-1), values),
        es.load(tmp_path / "a.npy"),
        es.Volume.from_table({"x": POSITIONS[:, 0], "y": POSITIONS[:, 1], "z": POSITIONS[:, 2], "heat": HEAT}),
    ]
    for thing in things:
        again = pickle.loads(pickle.dumps(thing))
        assert type(again) is type(thing) and again.report == thing.report
        same(thing, again)
    same(copy.deepcopy(things[0]), things[0])
    again = es.Renderer(pickle.loads(pickle.dumps(things[1])), backend="cpu")
    again.set_values(values * 2)
    with pytest.raises(TypeError, match="pickle"):
        pickle.dumps(es.Surfels.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], count=10))


def test_fields_are_chosen_by_name():
    thing = particles()
    assert set(thing.fields) >= {"heat", "wind"}
    same(thing.showing("wind"), es.Volume.from_points(POSITIONS, HEAT + 3.0, radius=SIGMAS, mass=MASSES, name="wind"))
    same(pickle.loads(pickle.dumps(thing.showing("wind"))), thing.showing("wind"))
    with pytest.raises(ValueError, match="no-such"):
        thing.showing("no-such")
    with pytest.raises(ValueError, match="radius"):
        es.Volume.from_points(POSITIONS, fields={"radius": HEAT})


def test_misspelt_keywords_name_the_nearest():
    with pytest.raises(TypeError, match="did you mean kernel_width"):
        es.Volume.from_points(POSITIONS, HEAT, kernel_widht=0.5)
    with pytest.raises(TypeError, match="did you mean radius"):
        es.Volume.from_points(POSITIONS, HEAT, raduis=0.5)
    with pytest.raises(TypeError, match="did you mean background"):
        renderer().render(backgruond=(0, 0, 0))


def test_cameras_of_pyvista_keep_their_projection():
    theirs = needs("pyvista").Camera()
    es.Camera.look_at((0, -5, 1), (0, 0, 0), ortho_height=3.0).to_pyvista(theirs)
    assert theirs.parallel_projection and theirs.parallel_scale == 1.5
    drawn = renderer().render(CAMERA, (SIDE, SIDE)).camera
    drawn.to_pyvista(theirs)
    assert theirs.parallel_scale == pytest.approx(0.6)
    es.Camera.look_at((0, -5, 1), (0, 0, 0), fov=40.0).to_pyvista(theirs)
    assert not theirs.parallel_projection and theirs.view_angle == 40.0 and theirs.position == (0, -5, 1)
