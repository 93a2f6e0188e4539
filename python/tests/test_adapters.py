"""Objects of the real packages, held to what the same arrays give."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import FIXTURES, needs

import ewa_splat as es

SIZE = (48, 36)
X, Y, Z = np.mgrid[0:5, 0:6, 0:7].astype(np.float64)
FIELD = (X * Y + Z).astype(np.float32)


def drawn(*things) -> np.ndarray:
    return es.Renderer(*things, backend="cpu").render(size=SIZE).numpy()


def same(a, b) -> None:
    a, b = drawn(a), drawn(b)
    assert a[..., 3].max() > 0.05, "something is seen"
    assert np.array_equal(a, b), np.abs(a - b).max()


class TestPyVista:
    @pytest.fixture
    def pv(self):
        return needs("pyvista")

    def test_images(self, pv):
        image = pv.ImageData(dimensions=X.shape, spacing=(1, 2, 0.5), origin=(3, 4, 5))
        image["heat"] = FIELD.ravel(order="F")
        expected = es.Volume.from_grid(FIELD, (1, 2, 0.5), (3, 4, 5))
        same(image, expected)
        assert es.adapt(image).fields == ["heat"]
        with pytest.raises(ValueError, match="field: .*heat.*cold"):
            es.adapt(image, "cold")
        cells = pv.ImageData(dimensions=(5, 6, 7))
        cells.cell_data["rank"] = FIELD[:4, :5, :6].ravel(order="F")
        same(cells, es.Volume.from_grid(FIELD[:4, :5, :6], of="cells"))

    def test_rectilinear_and_structured_grids(self, pv):
        axes = [np.cumsum(np.arange(1, n + 1)) * 0.3 for n in X.shape]
        grid = pv.RectilinearGrid(*axes)
        grid["v"] = FIELD.ravel(order="F")
        same(grid, es.Volume.from_grid(FIELD, coordinates=axes))
        nodes = np.stack([X + 0.1 * Y, Y, Z + 0.2 * X], axis=-1)
        structured = pv.StructuredGrid(*(np.ascontiguousarray(nodes[..., i]) for i in range(3)))
        structured["v"] = FIELD.ravel(order="F")
        same(structured, es.Volume.from_structured(nodes, FIELD))
        vectors = np.stack([FIELD, 2 * FIELD, 2 * FIELD], axis=-1).reshape(-1, 3, order="F")
        structured["velocity"] = vectors
        same(es.adapt(structured, "velocity"), es.Volume.from_structured(nodes, 3 * FIELD))

    def test_unstructured_grids(self, pv):
        image = pv.ImageData(dimensions=X.shape)
        image["v"] = FIELD.ravel(order="F")
        grid = image.cast_to_unstructured_grid()
        same(grid, es.Volume.from_cells(grid.points, grid.cells, grid.celltypes, grid["v"]))
        tetrahedra = image.to_tetrahedra()
        same(tetrahedra, es.Volume.from_cells(tetrahedra.points, tetrahedra.cells, tetrahedra.celltypes, tetrahedra["v"]))

    def test_polyhedra(self, pv):
        loaded = pv.read(FIXTURES / "solids.vtkhdf")
        assert 42 in loaded.celltypes
        same(es.adapt(loaded, "T"), es.load(FIXTURES / "solids.vtkhdf", "T"))

    def test_poly_data(self, pv):
        sphere = pv.Sphere(theta_resolution=12, phi_resolution=9)
        faces = sphere.faces.reshape(-1, 4)[:, 1:]
        bare = sphere.copy()
        bare.clear_data()
        same(bare, es.Surfels.from_mesh(sphere.points, faces))
        sphere["height"] = sphere.points[:, 2]
        same(sphere, es.Surfels.from_mesh(sphere.points, faces, values=sphere.points[:, 2]))
        strips = pv.Plane(i_resolution=3, j_resolution=2)
        strips.clear_data()
        quads = strips.faces.reshape(-1, 5)[:, 1:]
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        same(strips, es.Surfels.from_mesh(strips.points, triangles))
        cloud = pv.PolyData(sphere.points)
        cloud["height"] = sphere.points[:, 2]
        same(cloud, es.Volume.from_points(sphere.points, sphere.points[:, 2]))

    def test_blocks_and_cameras(self, pv):
        first = pv.ImageData(dimensions=X.shape)
        first["v"] = FIELD.ravel(order="F")
        second = pv.ImageData(dimensions=X.shape, origin=(10, 0, 0))
        second["v"] = 2 * FIELD.ravel(order="F")
        blocks = pv.MultiBlock([first, second])
        both = [es.Volume.from_grid(FIELD), es.Volume.from_grid(2 * FIELD, origin=(10, 0, 0))]
        assert np.array_equal(drawn(blocks), drawn(*both))
        plotter = pv.Plotter(off_screen=True)
        plotter.camera_position = [(9.0, 8.0, 7.0), (1.0, 2.0, 3.0), (0.0, 0.0, 1.0)]
        camera = es.Camera.from_pyvista(plotter.camera_position)
        assert camera.eye == (9, 8, 7) and camera.fov == 30
        assert np.allclose(camera.to_pyvista(), [tuple(v) for v in plotter.camera_position])
        assert np.allclose(es.Camera.from_pyvista(plotter.camera).to_pyvista(), camera.to_pyvista())


class TestMeshio:
    @pytest.fixture
    def meshio(self):
        return needs("meshio")

    def test_cells(self, meshio):
        points = np.random.default_rng(1).random((30, 3))
        from itertools import pairwise

        quads = [[a, a + 1, a + 2, a + 3] for a, _ in pairwise(range(0, 27))]
        values = points[:, 0]
        mesh = meshio.Mesh(points, [("tetra", np.array(quads))], point_data={"v": values})
        same(mesh, es.Volume.from_cells(points, quads, 10, values))
        of_cells = meshio.Mesh(points, [("tetra", np.array(quads))], cell_data={"c": [np.arange(len(quads)) * 1.0]})
        same(of_cells, es.Volume.from_cells(points, quads, 10, np.arange(len(quads)) * 1.0, of="cells"))

    def test_triangles(self, meshio):
        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1.0]])
        faces = np.array([[0, 1, 2], [1, 3, 2]])
        same(meshio.Mesh(points, [("triangle", faces)]), es.Surfels.from_mesh(points, faces))
        with pytest.raises(ValueError, match="field"):
            es.adapt(meshio.Mesh(points, [("triangle", faces)]), "p")


class TestTrimesh:
    @pytest.fixture
    def trimesh(self):
        return needs("trimesh")

    def test_colours(self, trimesh):
        box = trimesh.creation.box()
        same(box, es.Surfels.from_mesh(box.vertices, box.faces))
        paint = np.arange(48).reshape(12, 4).astype(np.uint8) * 4 + 20
        paint[:, 3] = 255
        box.visual.face_colors = paint
        same(box, es.Surfels.from_mesh(box.vertices, box.faces, colors=paint))
        box.visual.vertex_colors = np.tile([[200, 40, 40, 255]], (8, 1))
        same(box, es.Surfels.from_mesh(box.vertices, box.faces, colors=np.tile([[200, 40, 40, 255]], (8, 1))))

    def test_textures_and_scenes(self, trimesh, tmp_path):
        pil = needs("PIL.Image")
        pil = __import__("PIL.Image").Image
        corners = np.array([[0, 0, 0], [2, 0, 0], [2, 0, 1], [0, 0, 1.0]])
        faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
        paint = np.random.default_rng(1).integers(0, 255, (8, 16, 3)).astype(np.uint8)
        expected = es.Surfels.from_mesh(corners, faces, uv=uv, texture=paint, up=(0, 1, 0))
        visual = trimesh.visual.TextureVisuals(uv=uv, image=pil.fromarray(paint))
        mesh = trimesh.Trimesh(corners, faces, visual=visual, process=False)
        same(es.adapt(mesh, up=(0, 1, 0)), expected)
        # The right way up: as a file has it.
        pil.fromarray(paint).save(tmp_path / "paint.png")
        (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd paint.png\n")
        lines = ["mtllib a.mtl", "usemtl m"]
        lines += [f"v {x} {y} {z}" for x, y, z in corners] + [f"vt {u} {v}" for u, v in uv]
        lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in faces + 1]
        (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
        same(es.load(tmp_path / "a.obj"), expected)
        together = trimesh.Scene([trimesh.creation.box(), trimesh.creation.icosphere()])
        assert drawn(together)[..., 3].max() > 0.9


class TestSnapshots:
    def test_swiftsimio(self, tmp_path):
        swiftsimio, unyt = needs("swiftsimio"), needs("unyt")
        random = np.random.default_rng(4)

        def physical(values, unit, exponent):
            return swiftsimio.cosmo_array(values, unit, comoving=True, scale_factor=1.0, scale_exponent=exponent)

        writer = swiftsimio.Writer(unit_system="galactic", boxsize=physical(np.full(3, 10.0), unyt.kpc, 1), scale_factor=1.0)
        writer.gas.coordinates = physical(random.random((200, 3)) * 10, unyt.kpc, 1)
        writer.gas.velocities = physical(random.random((200, 3)), unyt.km / unyt.s, 1)
        writer.gas.masses = physical(np.ones(200), unyt.Msun, 0)
        writer.gas.internal_energy = physical(random.random(200) + 1, unyt.km**2 / unyt.s**2, -2)
        writer.gas.smoothing_lengths = physical(np.full(200, 0.8), unyt.kpc, 1)
        writer.write(str(tmp_path / "snapshot.hdf5"))
        data = swiftsimio.load(str(tmp_path / "snapshot.hdf5"))
        thing = es.adapt(data, "internal_energies")
        assert thing.report.samples == 200 and thing.report.unit
        places, energies = np.asarray(data.gas.coordinates), np.asarray(data.gas.internal_energies)
        same(thing, es.Volume.from_points(places, energies, radius=0.5 * np.asarray(data.gas.smoothing_lengths)))
        # Masses alone: columns are of mass.
        column = es.Renderer(es.adapt(data), backend="cpu").column_density(size=(32, 24))
        assert np.isclose(column.amplitude_sum, np.asarray(data.gas.masses).sum(), rtol=1e-5)

    def test_pynbody(self):
        pynbody = needs("pynbody")
        random = np.random.default_rng(4)
        snapshot = pynbody.new(gas=300)
        snapshot["pos"] = random.normal(size=(300, 3))
        snapshot["mass"] = np.ones(300)
        snapshot["rho"] = random.random(300) + 1
        snapshot["smooth"] = np.full(300, 0.4)
        expected = es.Volume.from_points(
            np.asarray(snapshot["pos"]), np.asarray(snapshot["rho"]),
            smoothing_length=np.asarray(snapshot["smooth"]), volume=1.0 / np.asarray(snapshot["rho"]),
        )
        same(snapshot, expected)
        same(es.adapt(snapshot, "mass"), es.Volume.from_points(
            np.asarray(snapshot["pos"]), np.asarray(snapshot["mass"]),
            smoothing_length=np.asarray(snapshot["smooth"]), volume=1.0 / np.asarray(snapshot["rho"]),
        ))

    def test_yt(self):
        yt = needs("yt")
        yt.set_log_level(50)
        data = {"density": (FIELD.astype(float) + 1, "g/cm**3")}
        box = yt.load_uniform_grid(data, FIELD.shape, length_unit="cm", bbox=np.array([[0, 5], [0, 6], [0, 7.0]]))
        thing = es.adapt(box.all_data(), "density")
        report = thing.report
        assert report.samples == FIELD.size and report.unit == "g/cm**3"
        column = es.Renderer(thing, backend="cpu").column_density(size=(64, 48))
        # The integral of the field over all: its sum, as cells have unit volume; to the rounding of float32.
        assert np.isclose(column.amplitude_sum, (FIELD + 1).sum(dtype=float), rtol=1e-6)

    def test_particles_of_yt(self):
        yt = needs("yt")
        yt.set_log_level(50)
        random, count = np.random.default_rng(1), 100
        data = {("io", f"particle_position_{axis}"): random.random(count) for axis in "xyz"}
        density = random.uniform(50.0, 150.0, count)
        data |= {("io", "particle_mass"): np.ones(count), ("io", "density"): density}
        data[("io", "smoothing_length")] = np.full(count, 0.1)
        particles = yt.load_particles(data, bbox=np.array([[0, 1]] * 3)).all_data()
        for field in (None, ("io", "density"), "density", ("gas", "density")):
            thing = es.adapt(particles, field)
            column = es.Renderer(thing, backend="cpu").column_density(size=(64, 48))
            # The mass, as that of yt's own projection.
            assert np.isclose(column.amplitude_sum, count, rtol=1e-5), field
            assert "support radius" in thing.report.lengths
        # Lengths are told otherwise where they are.
        assert "smoothing length" in es.adapt(particles, "density", length="h").report.lengths


class TestXarray:
    @pytest.fixture
    def xr(self):
        return needs("xarray")

    def test_curvilinear_coordinates_of_nemo(self, xr):
        y, x = np.mgrid[0:6, 0:8].astype(float)
        lon, lat = x + 0.2 * y, y + 0.1 * x
        depth = np.array([0.5, 2.0, 5.0, 9.0])
        values = np.random.default_rng(2).random((4, 6, 8))
        values[:, 2, 3] = np.nan
        array = xr.DataArray(
            values, dims=("deptht", "y", "x"), name="votemper", attrs={"units": "degC"},
            coords={"nav_lon": (("y", "x"), lon), "nav_lat": (("y", "x"), lat), "deptht": ("deptht", depth)},
        )
        nodes = np.stack([
            np.broadcast_to(lon.T[:, :, None], (8, 6, 4)),
            np.broadcast_to(lat.T[:, :, None], (8, 6, 4)),
            np.broadcast_to(-depth, (8, 6, 4)),
        ], axis=-1)
        same(array, es.Volume.from_structured(nodes, values.transpose(2, 1, 0)))
        report = es.adapt(array).report
        assert (report.unit, report.left_out) == ("degC", 4)
        same(es.adapt(xr.Dataset({"votemper": array}), "votemper"), array)

    def test_depths_of_roms_that_follow_the_ground(self, xr):
        y, x = np.mgrid[0:5, 0:6].astype(float)
        s = np.linspace(-1, 0, 4)
        height = s[:, None, None] * (3 + x * y)[None]
        values = np.random.default_rng(2).random((4, 5, 6))
        array = xr.DataArray(
            values, dims=("s_rho", "eta_rho", "xi_rho"),
            coords={
                "lon_rho": (("eta_rho", "xi_rho"), x), "lat_rho": (("eta_rho", "xi_rho"), y),
                "z_rho": (("s_rho", "eta_rho", "xi_rho"), height),
            },
        )
        nodes = np.stack(np.broadcast_arrays(x.T[:, :, None], y.T[:, :, None], height.transpose(2, 1, 0)), axis=-1)
        same(array, es.Volume.from_structured(nodes, values.transpose(2, 1, 0)))

    def test_straight_coordinates(self, xr):
        array = xr.DataArray(FIELD, dims=("x", "y", "z"), coords={"x": np.arange(5.0) ** 2, "y": np.arange(6.0), "z": -np.arange(7.0)})
        flipped = FIELD[:, :, ::-1]
        axes = [np.arange(5.0) ** 2, np.arange(6.0), np.arange(-6.0, 1.0)]
        same(array, es.Volume.from_grid(flipped, coordinates=axes))


class TestUnits:
    def test_unyt(self):
        unyt = needs("unyt")
        places = np.random.default_rng(1).normal(size=(100, 3))
        volume = es.Volume.from_points(
            unyt.unyt_array(places, "kpc"), unyt.unyt_array(places[:, 0], "K"), radius=unyt.unyt_array(np.full(100, 1e-4), "Mpc")
        )
        assert volume.report.unit == "K"
        same(volume, es.Volume.from_points(places, places[:, 0], radius=np.full(100, 0.1)))
        with pytest.raises(ValueError, match="kpc"):
            es.Volume.from_points(unyt.unyt_array(places, "kpc"), radius=unyt.unyt_array(np.ones(100), "K"))

    def test_astropy(self):
        units = needs("astropy.units")
        units = __import__("astropy.units").units
        places = np.random.default_rng(1).normal(size=(100, 3))
        volume = es.Volume.from_points(places * units.m, places[:, 0] * units.Pa, radius=np.full(100, 10.0) * units.cm)
        assert volume.report.unit == "Pa"
        same(volume, es.Volume.from_points(places, places[:, 0], radius=np.full(100, 0.1)))


def test_torch_tensors():
    # Too large to be required.
    torch = pytest.importorskip("torch")
    places = torch.rand((100, 3), dtype=torch.float32)
    same(es.Volume.from_points(places, places[:, 0]), es.Volume.from_points(places.numpy(), places[:, 0].numpy()))
    same(places, es.Volume.from_points(places.numpy()))
