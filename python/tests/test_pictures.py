"""Pictures of arrays and of loaded files are those of the command line, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import FIXTURES, needs

import ewa_splat as es

SIZE = (96, 72)

#: Of each kind of file one at least; of what is in several files the one that is opened.
FILES = sorted(
    str(path.relative_to(FIXTURES))
    for path in FIXTURES.rglob("*")
    if path.is_file()
    and not path.name.endswith((".json", ".mtl", ".png", ".q", ".ktx2"))
    and "plt00010" not in path.parts
    and "dicom" not in path.parts
) + ["plt00010", "dicom"]


def drawn(*things, **settings) -> np.ndarray:
    return es.Renderer(*things, backend="cpu").render(size=SIZE, **settings).numpy()


def same(a: np.ndarray, b: np.ndarray) -> None:
    assert a.shape == b.shape
    assert np.array_equal(a, b), f"{np.count_nonzero(a != b)} numbers differ, by {np.abs(a - b).max()} at most"


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_loaded_looks_as_the_program_draws_it(name, run, tmp_path):
    path = FIXTURES / name
    out = tmp_path / "program.npy"
    done = run("render", path, "--out", out, "--backend", "cpu", "--size", "96x72", "--refine", "off")
    if done.returncode != 0:
        # What the one refuses the other does, too.
        with pytest.raises((ValueError, OSError)):
            drawn(es.load(path))
        return
    same(drawn(es.load(path)), np.load(out))


@pytest.fixture(scope="module")
def wake() -> tuple[np.ndarray, np.ndarray]:
    """Nodes (ni, nj, nk, 3) and densities of the grid of one block, as its files hold them: i fastest."""
    with open(FIXTURES / "wake.xyz", "rb") as file:
        head = np.fromfile(file, np.int32, 3)
        rest = np.fromfile(file, np.float32)
    ni, nj, nk = map(int, head)
    nodes = rest.reshape(3, nk, nj, ni).transpose(3, 2, 1, 0)
    with open(FIXTURES / "wake.q", "rb") as file:
        assert np.array_equal(np.fromfile(file, np.int32, 3), head)
        np.fromfile(file, np.float32, 4)
        density = np.fromfile(file, np.float32, ni * nj * nk).reshape(nk, nj, ni).transpose(2, 1, 0)
    return nodes, density


@pytest.mark.parametrize("order", ["F", "C", "strided", "double"])
def test_a_curvilinear_grid_of_arrays(wake, order, rendered):
    nodes, density = wake
    if order == "C":
        nodes, density = np.ascontiguousarray(nodes), np.ascontiguousarray(density)
    elif order == "strided":
        nodes = np.repeat(nodes, 2, axis=0)[::2]
        density = np.repeat(density, 2, axis=1)[:, ::2]
        density.flags.writeable = False
    elif order == "double":
        nodes, density = nodes.astype(">f8"), density.astype(np.float64)
    same(drawn(es.Volume.from_structured(nodes, density)), rendered(FIXTURES / "wake.xyz"))


def test_the_boundary_of_a_grid_alone_and_around_its_volume(wake, rendered):
    path = FIXTURES / "wake.xyz"
    alone, around = rendered(path, "--surface"), rendered(path, "--surface-opacity", ".3")
    assert not np.array_equal(alone, around)
    same(drawn(es.Volume.from_structured(*wake, surface=True)), alone)
    same(drawn(es.load(path, surface=True)), alone)
    same(drawn(es.load(path, surface_opacity=0.3)), around)
    with pytest.raises(ValueError, match="above 0 and below 1"):
        es.load(path, surface_opacity=1.5)
    points = es.Volume.from_points(np.eye(3), surface=True)
    with pytest.raises(ValueError, match="expected cells, found particles"):
        drawn(points)


def test_functions_and_settings_mean_what_they_do_on_the_command_line(wake, rendered):
    volume = es.Volume.from_structured(*wake)
    path, function = FIXTURES / "wake.xyz", FIXTURES / "wake_transfer.json"
    of_file = rendered(path, "--transfer-function", function)
    same(drawn(volume, transfer_function=function), of_file)
    same(drawn(volume, transfer_function=es.TransferFunction.from_json(function)), of_file)
    same(drawn(volume, transfer_function="plasma"), rendered(path, "--transfer-function", "plasma"))
    lit = rendered(path, "--lit", "--clip", "0,0,-1,0", "--tolerance", "0.01", "--background", "0.1,0.2,0.3")
    same(drawn(volume, lit=True, clip=[(0, 0, -1, 0)], tolerance=0.01, background=(0.1, 0.2, 0.3)), lit)
    slabs = rendered(path, "--composite", "slabs", "--post-classification", "--low-pass", "0.5")
    same(drawn(volume, composite="slabs", post_classification=True, low_pass=0.5), slabs)
    box = rendered(path, "--clip=-1,-1,-1,1,1,1", "--classify", "particle", "--filter", "exact")
    same(drawn(volume, clip=[(-1, -1, -1, 1, 1, 1)], classify="particle", filter="exact"), box)
    ranged = rendered(path, "--range", "0.6,1.1", "--scale", "log", "--opacity-scale", "2", "--boundary", "soft")
    options = {"range": (0.6, 1.1), "scale": "log", "opacity_scale": 2, "boundary": "soft"}
    same(drawn(es.Volume.from_structured(*wake, **options)), ranged)


def test_cameras_are_those_of_the_command_line(wake, rendered):
    renderer = es.Renderer(es.Volume.from_structured(*wake), backend="cpu")
    path = FIXTURES / "wake.xyz"

    def of(camera: es.Camera) -> np.ndarray:
        return renderer.render(camera, SIZE).numpy()

    same(of(es.Camera.fit(azimuth=70, elevation=-10, zoom=1.5, fov=50)),
         rendered(path, "--azimuth", 70, "--elevation=-10", "--zoom", 1.5, "--fov", 50))
    same(of(es.Camera.look_at((4, -5, 3), (0, 0, 1), fov=30)), rendered(path, "--eye", "4,-5,3", "--target", "0,0,1", "--fov", 30))
    same(of(es.Camera.look_at((4, -5, 3), (0, 0, 1), (0, 1, 0), ortho_height=6)),
         rendered(path, "--eye", "4,-5,3", "--target", "0,0,1", "--up", "0,1,0", "--ortho", 6))
    same(of(es.Camera.fit(around=True, up=(0, 1, 0))), rendered(path, "--fit", "all", "--up", "0,1,0"))
    # A picture's camera takes it again.
    image = renderer.render(size=SIZE)
    same(of(image.camera), image.numpy())


def test_particles_of_arrays(rendered):
    with open(FIXTURES / "particles.csv", encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    columns = np.loadtxt(FIXTURES / "particles.csv", delimiter=",", skiprows=1).T
    table = dict(zip(names, columns, strict=True))
    positions = np.stack([table[axis] for axis in "xyz"], axis=1)
    xx, xy, xz, yy, yz, zz = (table[name] for name in ("vxx", "vxy", "vxz", "vyy", "vyz", "vzz"))
    matrices = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    colours = np.stack([table[c] for c in "rgb"], axis=1)
    known = {"opacity": table["opacity"], "color": colours}
    of_file = rendered(FIXTURES / "particles.csv")
    same(drawn(es.Volume.from_points(positions, covariance=matrices, **known)), of_file)
    listed = np.stack([xx, xy, xz, yy, yz, zz], axis=1)
    same(drawn(es.Volume.from_points(positions, covariance=listed, **known)), of_file)


def test_a_lattice_of_arrays_is_its_file(tmp_path, rendered):
    values = np.random.default_rng(3).integers(0, 255, (12, 10, 8)).astype(np.uint8)
    path = tmp_path / "box_12x10x8_uint8.raw"
    path.write_bytes(values.tobytes(order="F"))
    of_file = rendered(path, "--dims", "12,10,8", "--spacing", "1,2,0.5", "--origin", "3,4,5")
    volume = es.Volume.from_grid(values, (1, 2, 0.5), (3, 4, 5))
    same(drawn(volume), of_file)
    loaded = es.load(path, dims=(12, 10, 8), spacing=(1, 2, 0.5), origin=(3, 4, 5))
    same(drawn(loaded), of_file)
    with open(path, "rb") as file:
        same(drawn(es.load(file, dims=(12, 10, 8), spacing=(1, 2, 0.5), origin=(3, 4, 5))), of_file)


def test_cells_of_arrays_are_their_file(rendered):
    h5py = needs("h5py")
    path = FIXTURES / "solids.vtkhdf"
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        points, types = root["Points"][:], root["Types"][:]
        offsets, nodes = root["Offsets"][:], root["Connectivity"][:]
        name = "T"
        values = root["PointData"][name][:]
        sides, corners = root["FaceOffsets"][:], root["FaceConnectivity"][:]
        of_cell, faces = root["PolyhedronOffsets"][:], root["PolyhedronToFaces"][:]
    cells = []
    for i, kind in enumerate(types):
        own = list(nodes[offsets[i] : offsets[i + 1]])
        if kind == 42:
            own = [of_cell[i + 1] - of_cell[i]]
            for face in faces[of_cell[i] : of_cell[i + 1]]:
                ring = corners[sides[face] : sides[face + 1]]
                own += [len(ring), *ring]
        cells += [len(own), *own]
    assert 42 in types
    same(drawn(es.Volume.from_cells(points, cells, types, values)), rendered(path, "--field", name))


def test_meshes_of_arrays_are_their_file(tmp_path, rendered):
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2.0]])
    # In the order in which faces name them, as readers keep corners.
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path = tmp_path / "tetrahedron.obj"
    path.write_text("\n".join(lines) + "\n")
    # OBJ says that y is up.
    same(drawn(es.Surfels.from_mesh(corners, faces, up=(0, 1, 0))), rendered(path))
    same(drawn(es.Surfels.from_mesh(corners, faces, up=(0, 1, 0)), lit=False), rendered(path, "--unlit"))


def test_things_together_share_a_function_as_files_do(tmp_path, rendered):
    random = np.random.default_rng(5)
    volumes, paths = [], []
    for i in range(2):
        positions = random.normal(size=(300, 3)).astype(np.float32) + 3 * i
        values = (positions[:, 0] + 10 * i).astype(np.float32)
        path = tmp_path / f"part{i}.npy"
        table = np.zeros(300, [(name, "<f4") for name in ("x", "y", "z", "heat")])
        for j, axis in enumerate("xyz"):
            table[axis] = positions[:, j]
        table["heat"] = values
        np.savez(path.with_suffix(".npz"), **{name: table[name] for name in table.dtype.names})
        paths.append(path.with_suffix(".npz"))
        volumes.append(es.Volume.from_points(positions, values, name="heat"))
    of_files = rendered(*paths, "--field", "heat")
    same(drawn(*volumes), of_files)
    same(drawn(*(es.load(path, "heat") for path in paths)), of_files)


def test_column_densities_are_the_command_lines(wake, rendered):
    volume = es.Volume.from_structured(*wake)
    column = es.Renderer(volume, backend="cpu").column_density(size=SIZE)
    same(column.values, rendered(FIXTURES / "wake.xyz", "--column-density"))
    left, right, bottom, top = column.extent
    height, width = column.shape
    # Square pixels of the area that is said.
    assert np.isclose((right - left) / width * (top - bottom) / height, column.pixel_area)


def test_pictures_along_axes_are_the_command_lines(wake, rendered):
    renderer = es.Renderer(es.Volume.from_structured(*wake), backend="cpu")
    path = FIXTURES / "wake.xyz"
    for axis, centre, across in (("x", (0, 1, 2), (1, 2)), ("-y", (1, 0, 2), (0, 2)), ("z", (1, 1, 0), (0, 1))):
        camera = es.Camera.along(axis, centre=centre, width=2)
        column = renderer.column_density(camera, size=SIZE)
        height = 2 * SIZE[1] / SIZE[0]
        (left, right), (low, high) = (
            (centre[a] - half, centre[a] + half) for a, half in zip(across, (1, height / 2), strict=True)
        )
        words = (f"--along={axis}", f"--window={left},{right},{low},{high}")
        expected = (right, left, low, high) if axis.startswith("-") else (left, right, low, high)
        assert np.allclose(column.extent, expected, rtol=0, atol=1e-12)
        assert np.allclose(column.values, rendered(path, "--column-density", *words), rtol=1e-5)
    same(renderer.render(es.Camera.along("z"), size=SIZE).numpy(), rendered(path, "--along", "z"))
    for wrong in ({"axis": "w"}, {"axis": "x", "width": 0}, {"axis": "x", "centre": (1, 2)}):
        with pytest.raises(ValueError):
            es.Camera.along(**wrong)
    with pytest.raises(ValueError, match="along an axis"):
        es.Camera.along("x").orbit(3)
    assert repr(es.Camera.along("-x", width=3).zoomed(2)) == "Camera.along('-x', width=1.5)"


def test_the_true_picture_is_the_command_lines(tmp_path, run):
    values = np.random.default_rng(3).integers(0, 255, (4, 4, 4)).astype(np.uint8)
    path, out = tmp_path / "box.raw", tmp_path / "program.npy"
    path.write_bytes(values.tobytes(order="F"))
    renderer = es.Renderer(es.Volume.from_grid(values), backend="cpu")
    for of in ("kernels", "data"):
        image = renderer.reference(size=(12, 9), of=of, error=0.05)
        words = ("--dims", "4,4,4", "--tolerance", "0.05", "--size", "12x9", f"--reference={of}")
        done = run("render", path, "--out", out, *words, "--refine", "off")
        assert done.returncode == 0, done.stderr
        # Threads add to pixels' sums in another order: a rounding of float32 at most.
        assert np.abs(image.numpy() - np.load(out)).max() < 2e-7
        assert image.stats["rays"] > 0


def test_pngs_are_the_command_lines(wake, run, tmp_path):
    pil = needs("PIL.Image")
    image = es.Renderer(es.Volume.from_structured(*wake), backend="cpu").render(size=SIZE)
    image.save(tmp_path / "ours.png")
    words = ("--out", tmp_path / "theirs.png", "--backend", "cpu", "--size", "96x72", "--refine", "off", "--no-provenance")
    done = run("render", FIXTURES / "wake.xyz", *words)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "ours.png").read_bytes() == (tmp_path / "theirs.png").read_bytes() == image._repr_png_()
    assert image.to_pil().size == SIZE and image.to_pil(transparent=True).mode == "RGBA"
    assert pil is not None


def test_legends_are_drawn_and_name_the_unit(wake, run, tmp_path):
    nodes, density = wake
    volume = es.Volume.from_structured(nodes, density, name="density")
    image = es.Renderer(volume, backend="cpu").render(size=(480, 360), legend=True)
    image.save(tmp_path / "ours.png")
    words = ("--out", tmp_path / "theirs.png", "--backend", "cpu", "--size", "480x360", "--legend", "--field", "density")
    done = run("render", FIXTURES / "wake.xyz", *words, "--refine", "off")
    assert done.returncode == 0, done.stderr
    same(es.Image.open(tmp_path / "ours.png").numpy(), es.Image.open(tmp_path / "theirs.png").numpy())
    named = es.Volume.from_structured(nodes, density, name="density", unit="kg/m^3")
    other = es.Renderer(named, backend="cpu").render(size=(480, 360), legend=True)
    assert not np.array_equal(other.numpy(), image.numpy())


def test_volumes_end_at_depths_of_other_renderers(wake):
    nodes, density = wake
    renderer = es.Renderer(es.Volume.from_structured(nodes, density), backend="cpu")
    whole = renderer.render(size=SIZE)
    camera = whole.camera
    width, height = SIZE
    middle = float(np.linalg.norm(np.asarray(camera.eye) - nodes.reshape(-1, 3).mean(0)))
    depth = np.full((height, width), np.inf)
    depth[:, width // 2 :] = middle
    wall = np.zeros((height, width, 3))
    wall[..., 1] = 0.5
    ended = renderer.render(camera, SIZE, background_depth=depth)
    over = renderer.render(camera, SIZE, background_depth=depth, background_image=wall)
    bare = ended.numpy()
    same(bare[:, : width // 2], whole.numpy()[:, : width // 2])
    assert bare[..., 3].sum() < whole.numpy()[..., 3].sum()
    expected = bare + (1 - bare[..., 3:]) * np.concatenate([wall, np.ones((height, width, 1))], 2)
    assert np.allclose(over.numpy(), expected, atol=1e-6)
    near, far = 0.01 * middle, 10 * middle
    buffer = np.where(np.isinf(depth), 1, (far - near * far / depth) / (far - near))
    kinds = dict(background_depth_is="opengl", background_depth_range=(near, far))
    other = renderer.render(camera, SIZE, background_depth=buffer, **kinds)
    assert np.allclose(other.numpy(), bare, atol=1e-4)
    for wrong, word in [
        (dict(background_depth=depth[1:]), "96 x 72"),
        (dict(background_depth=np.full((height, width), np.nan)), "NaN"),
        (dict(background_depth=wall), "height, width"),
        (dict(background_depth_is="opengl"), "background_depth_range"),
        (dict(background_depth_is="distance"), "backdrop"),
        (dict(background_image=wall[..., 0]), "3 or 4"),
    ]:
        with pytest.raises(ValueError, match=word):
            renderer.render(camera, SIZE, **wrong)
    with pytest.raises(TypeError, match="linear"):
        renderer.render(camera, SIZE, background_image=(wall * 255).astype(np.uint8))
    with pytest.raises(TypeError, match="column densities"):
        renderer.column_density(background_depth=depth)


def test_deep_images_are_those_that_openexr_reads(wake, tmp_path):
    OpenEXR = needs("OpenEXR")
    nodes, density = wake
    renderer = es.Renderer(es.Volume.from_structured(nodes, density), backend="cpu")
    size = (48, 36)
    tolerance = 1 / 64
    deep = renderer.render_deep(size=size, tolerance=tolerance, opaque_edges=False)
    camera = deep.camera
    whole = renderer.render(camera, size, tolerance, opaque_edges=False)
    assert np.allclose(deep.before().numpy(), whole.numpy(), atol=1e-5)
    deep.save(tmp_path / "deep.exr")
    part = OpenEXR.File(str(tmp_path / "deep.exr")).parts[0]
    channels = part.channels
    front, back, rgba = deep.samples
    first = 0
    middle = np.full((size[1], size[0]), np.inf, np.float32)
    for y in range(size[1]):
        for x in range(size[0]):
            count = deep.counts[y, x]
            own = slice(first, first + count)
            first += count
            z = channels["Z"].pixels[y, x]
            if count == 0:
                assert z is None or len(z) == 0
                continue
            assert np.array_equal(z, front[own])
            assert np.array_equal(channels["ZBack"].pixels[y, x], back[own])
            assert np.array_equal(channels["RGBA"].pixels[y, x], rgba[own])
            # As OpenEXR composites: depths of a sample's parts are even.
            middle[y, x] = 0.5 * (front[own][0] + back[own][-1])
    assert first == len(front) > 1000
    drawn = renderer.render(camera, size, tolerance, background_depth=middle, opaque_edges=False).numpy()
    off = np.abs(drawn - deep.before(middle).numpy()).max(axis=2)
    assert np.quantile(off, 0.999) < tolerance
    median, mean = deep.depth("median"), deep.depth("mean")
    seen = np.isfinite(median)
    assert (deep.depth("entry")[seen] <= median[seen]).all() and (median[seen] <= deep.depth("exit")[seen]).all()
    assert np.array_equal(seen, np.isfinite(mean))
    left = deep.transmittance(float(np.median(mean[seen])))
    assert ((left >= 1 - whole.numpy()[..., 3] - 1e-5) & (left <= 1)).all()
    with pytest.raises(ValueError, match="median"):
        deep.depth("nearest")
    with pytest.raises(TypeError, match="legend"):
        renderer.render_deep(legend=True)
    with pytest.raises(ValueError, match="backdrop"):
        renderer.render_deep(camera, size, background_depth=middle)
