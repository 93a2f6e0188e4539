"""Things in scenes of VTK and PyVista, off screen."""

from __future__ import annotations

import gc
import re
import warnings
import weakref
from pathlib import Path

import numpy as np
import pytest
from conftest import needs

import ewa_splat as es

pv = needs("pyvista")
vtk = needs("vtk")

import ewa_splat.pyvista  # noqa: E402
import ewa_splat.vtk  # noqa: E402
from ewa_splat import _vtk  # noqa: E402

DOCS = Path(__file__).resolve().parents[2] / "docs"
SIZE = (200, 150)
AXIS = np.linspace(-1, 1, 16)
#: Values from 0 in the middle to 3 at the corners.
VALUES = sum(axis**2 for axis in np.meshgrid(AXIS, AXIS, AXIS, indexing="ij"))
FOG = es.TransferFunction.from_points([(0, (0.2, 0.9, 0.4), 0.3), (3, (0.2, 0.9, 0.4), 0.3)], unit_distance=0.5)


def cube(values=VALUES) -> es.Renderer:
    """A cube from -1 to 1."""
    return es.Renderer(es.Volume.from_grid(values, AXIS[1] - AXIS[0], (-1, -1, -1), name="s"), backend="cpu")


def plotter(**keywords):
    made = pv.Plotter(off_screen=True, window_size=SIZE, **keywords)
    made.background_color = (0.1, 0.2, 0.3)
    return made


def picture(made, **keywords) -> np.ndarray:
    """A new picture of a plotter: PyVista repeats the last one of a window at rest."""
    made.screenshot(return_img=True, **keywords)
    made.render()
    return made.screenshot(return_img=True, **keywords).astype(int)


# Light ----------------------------------------------------------------------------------------------------------------


def rays(view) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions of pixels, with depth 1 along the camera's axis."""
    (width, height), focal, centre = view["size"], view["focal_px"], view["centre_px"]
    right, down, forward = np.array(view["rotation"])
    x = ((np.arange(width) + 0.5 - centre[0]) / focal[0])[None, :, None] * right
    y = ((np.arange(height) + 0.5 - centre[1]) / focal[1])[:, None, None] * down
    eye = np.array(view["eye"])
    if view["orthographic"]:
        return eye + x + y, np.broadcast_to(forward, (height, width, 3))
    return np.broadcast_to(eye, (height, width, 3)), x + y + forward


def depths_of_triangles(origins, directions, corners) -> np.ndarray:
    """The nearest triangle of each ray, by Möller and Trumbore."""
    nearest = np.full(origins.shape[:2], np.inf)
    for a, b, c in corners:
        first, second = b - a, c - a
        across = np.cross(directions, second)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / (across @ first)
            u = ((origins - a) * across).sum(-1) * scale
            turned = np.cross(origins - a, first)
            v = (directions * turned).sum(-1) * scale
            depth = (turned @ second) * scale
        is_hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 0)
        nearest = np.where(is_hit, np.minimum(nearest, depth), nearest)
    return nearest


def truth(view, corners, colour, background, fog=(0.2, 0.9, 0.4), extinction=-np.log(0.7) / 0.5) -> tuple[np.ndarray, np.ndarray]:
    """sRGB codes of triangles in a cube of fog, in float64, and the triangles' depths."""
    origins, directions = rays(view)
    solid = depths_of_triangles(origins, directions, corners)
    with np.errstate(divide="ignore"):
        ends = np.stack([(-1 - origins) / directions, (1 - origins) / directions])
    enter, leave = ends.min(0).max(-1), ends.max(0).min(-1)
    length = np.maximum(np.minimum(leave, solid) - np.maximum(enter, 0), 0) * np.linalg.norm(directions, axis=-1)
    through = np.exp(-extinction * length)[..., None]
    behind = np.where(np.isfinite(solid)[..., None], _vtk._decoded(np.array(colour)), _vtk._decoded(np.array(background)))
    light = (1 - through) * _vtk._decoded(np.array(fog)) + through * behind
    return 255 * _vtk.encoded(light), solid


def beside(mask: np.ndarray) -> np.ndarray:
    """A mask and the pixels around it."""
    wide = np.pad(mask, 1)
    height, width = mask.shape
    return np.any([wide[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)


@pytest.mark.parametrize("is_parallel", [False, True])
def test_a_cone_stands_half_in_a_cube_of_fog(is_parallel):
    """Colours of VTK's geometry under our fog against rays in numpy.

    Pixels on the cone's outline and on the cube's are left out: VTK blends the samples of a pixel there, which has one
    depth, and the cube's kernels fade over a part of a pixel.
    """
    made = plotter()
    cone = pv.Cone(center=(0.6, 0.2, 0.1), direction=(1, 0.3, 0.2), height=1.6, radius=0.7, resolution=24)
    made.add_mesh(cone, color=(0.9, 0.5, 0.1), lighting=False)
    es.pyvista.add(made, cube(np.ones_like(VALUES)), transfer_function=FOG)
    made.camera_position = [(3.2, -4.1, 2.3), (0.2, 0, 0), (0, 0, 1)]
    if is_parallel:
        made.enable_parallel_projection()
        made.camera.parallel_scale = 1.9
    found = picture(made)
    triangles = cone.triangulate()
    corners = triangles.points[triangles.regular_faces].astype(float)
    view = es.vtk.camera_of(made.renderer)._asked()
    expected, solid = truth(view, corners, (0.9, 0.5, 0.1), (0.1, 0.2, 0.3))
    empty, _ = truth(view, corners[:0], (0, 0, 0), (0.1, 0.2, 0.3))
    is_solid = np.isfinite(solid)
    flat = beside(beside(is_solid) & beside(~is_solid))
    is_cube = np.abs(empty - empty[0, 0]).max(-1) > 0.5
    flat |= beside(beside(is_cube) & beside(~is_cube))
    differ = np.abs(found - expected).max(-1)
    print(is_parallel, differ[~flat].max(), np.percentile(differ[~flat], 99), flat.mean())
    assert flat.mean() < 0.15
    inside = is_solid & ~flat & (np.abs(expected - 255 * np.array([0.9, 0.5, 0.1])).max(-1) > 4)
    assert inside.sum() > 500, "a part of the cone is in the fog"
    # Two codes in nearly all pixels: the library's tolerance of one, of 99.9 % of pixels, and rounding of the scene's
    # colours before and after.
    assert np.percentile(differ[~flat], 99.9) <= 2.0 and differ[~flat].max() <= 3.0
    # On the cone's outline, colours lie between those beside it, up to the part of a pixel's background that no fog
    # covers: less than half of it. With any sample's depth this is 57.
    edge = beside(is_solid) & beside(~is_solid)
    wide = np.pad(expected, ((1, 1), (1, 1), (0, 0)), mode="edge")
    near = np.stack([wide[i : i + SIZE[1], j : j + SIZE[0]] for i in range(3) for j in range(3)])
    beyond = np.maximum(near.min(0) - found, found - near.max(0)).max(-1)
    assert beyond[edge].max() < 45


def test_splats_and_volumes_blend_as_before_an_image():
    """What scenes show is `background_image` under the picture, in the things' own space of colours."""
    turns = [[1.0, 0, 0, 0]] * 20
    random = np.random.default_rng(2)
    centres, colours = random.uniform(-0.7, 0.7, (20, 3)), random.uniform(0, 1, (20, 3))
    splats = es.Splats.from_arrays(centres, [[0.2] * 3] * 20, turns, [0.6] * 20, colors=colours)
    for thing, is_encoded in [(es.Renderer(splats, backend="cpu"), True), (cube(), False)]:
        made = plotter()
        made.render_window.SetMultiSamples(0)
        made.add_mesh(pv.Cone(), color="tan")
        handle = es.pyvista.add(made, thing)
        found = picture(made)
        handle.visible = False
        behind = _vtk.linear_of(picture(made).astype(np.uint8))
        camera = es.vtk.camera_of(made.renderer)
        image = thing.render(camera, SIZE, background_depth=depths_in(made), background_image=behind)
        expected = _vtk.codes_of(image.numpy()[..., :3]).astype(int)
        assert handle._is_encoded is is_encoded
        assert (expected != _vtk.codes_of(behind)).any(-1).mean() > 0.05
        # Rounding to codes.
        assert np.abs(found - expected).max() <= 1


def depths_in(made) -> np.ndarray:
    """Depths of a plotter's meshes by VTK's own filter."""
    filter_ = vtk.vtkWindowToImageFilter()
    filter_.SetInput(made.render_window)
    filter_.SetInputBufferTypeToZBuffer()
    filter_.ReadFrontBufferOff()
    filter_.Update()
    buffer = pv.wrap(filter_.GetOutput()).active_scalars.reshape(SIZE[::-1])[::-1]
    return _vtk.depths_of(buffer, _vtk.view_of(made.renderer)[1])


def test_the_scene_is_as_before_where_no_fog_is():
    bare, made = plotter(), plotter()
    for one in (bare, made):
        one.add_mesh(pv.Sphere(radius=3), color="tan")
        one.camera_position = [(0, -9, 0), (0, 0, 0), (0, 0, 1)]
    es.pyvista.add(made, cube())
    assert np.array_equal(picture(bare), picture(made)), "the sphere hides the cube"


# Cameras --------------------------------------------------------------------------------------------------------------


def pixel_in_vtk(renderer, point) -> np.ndarray:
    """The pixel of a point, from the top left, by VTK."""
    renderer.SetWorldPoint(*point, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    left, bottom = renderer.GetOrigin()
    return np.array([x - left, renderer.GetSize()[1] - (y - bottom)])


def pixel_of_ours(camera, point) -> np.ndarray:
    view = camera._asked()
    x, y, z = np.array(view["rotation"]) @ (np.array(point) - view["eye"])
    scale = 1.0 if view["orthographic"] else 1 / z
    return np.array([x, y]) * scale * view["focal_px"] + view["centre_px"]


def window_of(*renderers, size=SIZE):
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetSize(*size)
    for renderer in renderers:
        window.AddRenderer(renderer)
    return window


@pytest.mark.parametrize("is_parallel", [False, True])
@pytest.mark.parametrize("middle", [(0.0, 0.0), (0.25, -0.4)])
def test_cameras_go_to_ours_and_back(is_parallel, middle):
    renderer = vtk.vtkRenderer()
    renderer.SetViewport(0.1, 0.2, 0.9, 0.7)
    window = window_of(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(3, -4, 2)
    camera.SetFocalPoint(0.1, 0.2, 0.3)
    camera.SetViewUp(0.1, 0.2, 1)
    camera.SetViewAngle(41)
    camera.SetParallelScale(1.7)
    camera.SetParallelProjection(is_parallel)
    camera.SetWindowCenter(*middle)
    camera.SetClippingRange(1, 20)
    ours = es.vtk.camera_of(renderer)
    points = np.random.default_rng(3).uniform(-1, 1, (20, 3))
    seen = [pixel_in_vtk(renderer, point) for point in points]
    # Rounding in VTK's single-precision coordinates of the view, at most.
    assert np.abs([pixel_of_ours(ours, point) - at for point, at in zip(points, seen, strict=True)]).max() < 1e-3
    other = vtk.vtkCamera()
    ours.to_pyvista(other)
    other.SetClippingRange(1, 20)
    renderer.SetActiveCamera(other)
    assert np.abs([pixel_in_vtk(renderer, point) - at for point, at in zip(points, seen, strict=True)]).max() < 1e-3
    if middle == (0.0, 0.0):
        placed = es.Camera.from_pyvista(camera)
        assert np.allclose(placed.to_pyvista()[0], (3, -4, 2))
    del window


def test_depths_are_those_of_the_camera():
    for is_parallel in (False, True):
        renderer = vtk.vtkRenderer()
        window = window_of(renderer)
        camera = renderer.GetActiveCamera()
        camera.SetParallelProjection(is_parallel)
        camera.SetClippingRange(2.0, 9.0)
        _, matrix = _vtk.view_of(renderer)
        ends = _vtk.depths_of(np.array([0.0, 0.5, 1 - 1e-7, 1.0], np.float32), matrix)
        middle = 5.5 if is_parallel else 2 * 2 * 9 / (2 + 9)
        assert np.allclose(ends[:3], [2.0, middle, 9.0], rtol=1e-5) and np.isinf(ends[3])
        del window


def test_bounds_are_part_of_the_scene():
    made = plotter()
    es.pyvista.add(made, cube())
    assert np.allclose(made.bounds, (-1, 1) * 3)
    near, far = made.camera.clipping_range
    distance = np.linalg.norm(np.array(made.camera.position) - made.camera.focal_point)
    assert near < distance < far and np.isclose(made.camera.focal_point, 0).all()
    assert (picture(made) != picture(made)[0, 0]).any(-1).mean() > 0.1


# Windows --------------------------------------------------------------------------------------------------------------


def test_pictures_follow_size_and_scale():
    made = plotter()
    es.pyvista.add(made, cube())
    first = picture(made)
    made.window_size = (120, 130)
    small = picture(made)
    assert first.shape == (150, 200, 3) and small.shape == (130, 120, 3)
    assert (small[:, 60] != small[0, 0]).any(), "the cube is in the small picture"
    made.window_size = SIZE
    assert np.array_equal(picture(made), first)
    large = made.screenshot(return_img=True, scale=2).astype(int)
    assert large.shape == (300, 400, 3)
    # Tiles of the large picture fit together: its means are the small picture, up to kernels' edges within a pixel.
    means = large.reshape(150, 2, 200, 2, 3).mean((1, 3))
    assert np.percentile(np.abs(means - first), 99) <= 4


def test_each_subplot_has_its_own():
    made = plotter(shape=(1, 2))
    made.subplot(0, 0)
    es.pyvista.add(made, cube(), transfer_function="plasma")
    made.subplot(0, 1)
    made.background_color = (0.1, 0.2, 0.3)
    handle = es.pyvista.add(made, cube(), transfer_function="viridis")
    both = picture(made)
    left, right = both[5:-5, 5:95], both[5:-5, 105:195]
    assert (left != left[0, 0]).any(-1).mean() > 0.1 and (right != right[0, 0]).any(-1).mean() > 0.1
    assert np.abs(left - right).max() > 20, "the colours differ"
    handle.remove()
    one = picture(made)
    assert np.array_equal(one[5:-5, 5:95], left) and (one[5:-5, 105:195] == one[5, 105]).all()


def test_text_and_scalar_bars_are_above():
    made = plotter()
    handle = es.pyvista.add(made, cube(np.ones_like(VALUES)), transfer_function=FOG)
    made.camera.zoom(6)
    covered = picture(made)
    handle.scalar_bar()
    bar = handle.scalar_bar()
    made.add_text("text", position=(90, 70), color="red", font_size=12)
    drawn = picture(made)
    is_red = (drawn[..., 0] > 200) & (drawn[..., 1] < 60)
    assert is_red.sum() > 20 and not ((covered[..., 0] > 200) & (covered[..., 1] < 60)).any()
    assert bar.GetTitle() == "s" and bar.GetLookupTable() is handle.lookup_table
    handle.remove()
    assert "s" not in made.scalar_bars


def test_transparent_pictures_have_the_cubes_opacity():
    made = plotter()
    es.pyvista.add(made, cube(np.ones_like(VALUES)), transfer_function=FOG)
    seen = made.screenshot(return_img=True, transparent_background=True)
    assert seen[0, 0, 3] == 0
    # Two units of fog and more through the cube's middle.
    assert 255 * (1 - 0.7**4) - 2 <= seen[75, 100, 3] < 255


def test_removed_hidden_and_changed():
    made = plotter()
    made.add_mesh(pv.Cone(), color="tan")
    made.camera_position = [(3, -4, 2), (0, 0, 0), (0, 0, 1)]
    bare = picture(made)
    handle = es.pyvista.add(made, cube(), transfer_function="plasma")
    shown = picture(made)
    assert not np.array_equal(bare, shown)
    handle.visible = False
    assert np.array_equal(picture(made), bare)
    handle.visible = True
    assert np.array_equal(picture(made), shown)
    handle.update(transfer_function="viridis")
    green = picture(made)
    assert not np.array_equal(green, shown)
    handle.renderer.set_values(0.3 * VALUES)
    assert not np.array_equal(picture(made), green), "new values are drawn"
    handle.remove()
    assert np.array_equal(picture(made), bare)
    made.clear()
    again = es.pyvista.add(made, cube())
    made.clear()
    picture(made)
    again.remove()


def test_movement_is_coarse_and_ends_fine():
    renderer = vtk.vtkRenderer()
    window = window_of(renderer)
    actor = es.vtk.Actor(cube(), transfer_function="plasma").add_to(renderer)
    renderer.ResetCamera()
    sizes = []
    render = actor.renderer.render

    def noted(camera, size, **settings):
        sizes.append(size)
        return render(camera, size, **settings)

    actor._renderer.render = noted
    interactor = vtk.vtkGenericRenderWindowInteractor()
    interactor.SetRenderWindow(window)
    interactor.SetInteractorStyle(vtk.vtkInteractorStyleTrackballCamera())
    window.Render()
    interactor.Initialize()
    for name, x in [("LeftButtonPress", 60), ("MouseMove", 70), ("MouseMove", 80), ("LeftButtonRelease", 80)]:
        interactor.SetEventInformation(x, 40, 0, 0)
        interactor.InvokeEvent(f"{name}Event")
    assert sizes[0] == SIZE and sizes[-1] == SIZE
    assert sizes[1:-1] and set(sizes[1:-1]) == {(100, 75)}


def resident() -> int:
    """Bytes of memory in use."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 if Path("/proc/self/statm").exists() else 0


def test_interactions_leave_nothing_behind():
    made = plotter()
    made.add_mesh(pv.Cone(), color="tan")
    handle = es.pyvista.add(made, cube())

    def turn() -> None:
        made.camera.azimuth += 7
        made.render()

    for _ in range(3):
        turn()
    gc.collect()
    before, memory = len(gc.get_objects()), resident()
    for _ in range(20):
        turn()
    gc.collect()
    assert len(gc.get_objects()) - before < 50
    # 20 frames that were kept would be 20 x 200 x 150 x (4 + 4 + 4 + 16) bytes, 17 MB.
    assert resident() - memory < 10 << 20
    handle.remove()


def test_scenes_keep_actors_and_free_them():
    def scene():
        renderer = vtk.vtkRenderer()
        actor = es.vtk.Actor(cube()).add_to(renderer)
        renderer.ResetCamera()
        return window_of(renderer), weakref.ref(actor)

    window, actor = scene()
    gc.collect()
    window.Render()
    assert actor() is not None, "the scene keeps it"
    del window
    gc.collect()
    assert actor() is None, "it goes with the scene"
    window, actor = scene()
    actor().remove()
    assert actor() is None, "nothing else keeps it"
    window.Render()
    made = plotter()
    handle = weakref.ref(es.pyvista.add(made, cube()))
    picture(made)
    assert handle() is not None
    made.clear()
    gc.collect()
    assert handle() is None
    made.close()


# Colours --------------------------------------------------------------------------------------------------------------


def shown(function: es.TransferFunction, values) -> np.ndarray:
    """Encoded colours and opacities of a transfer function, by way of its table."""
    table = vtk.vtkLookupTable()
    renderer = cube()
    renderer.set_transfer_function(function)
    _vtk.fill(table, renderer.transfer_functions[0])
    return np.array([[*table_colour(table, value), table.GetOpacity(value)] for value in values])


def table_colour(table, value) -> list[float]:
    colour = [0.0, 0.0, 0.0]
    table.GetColor(value, colour)
    return colour


def functions():
    colours = vtk.vtkColorTransferFunction()
    colours.AddRGBPoint(0, 0.1, 0.2, 0.9)
    colours.AddRGBPoint(1, 0.9, 0.9, 0.8)
    colours.AddRGBPoint(3, 0.8, 0.1, 0.0)
    opacities = vtk.vtkPiecewiseFunction()
    opacities.AddPoint(0, 0.0)
    opacities.AddPoint(2, 0.4)
    opacities.AddPoint(3, 0.6)
    return colours, opacities


@pytest.mark.parametrize("space", ["RGB", "Lab", "HSV", "Diverging"])
def test_transfer_functions_of_vtk(space):
    colours, opacities = functions()
    getattr(colours, f"SetColorSpaceTo{space}")()
    values = np.linspace(0.05, 2.95, 30)
    expected = np.array([[*colours.GetColor(v), opacities.GetValue(v)] for v in values])
    ours = shown(_vtk.function_of((colours, opacities)), values)
    # Half an entry of the table of 256, whose steepest colour changes by 1 over a third of it, and rounding to codes.
    assert np.abs(ours - expected).max() < 0.5 / 256 * 3 + 1 / 255


def test_volume_properties_and_their_unit():
    colours, opacities = functions()
    volume = vtk.vtkVolumeProperty()
    volume.SetColor(colours)
    volume.SetScalarOpacity(opacities)
    volume.SetScalarOpacityUnitDistance(0.25)
    function = _vtk.function_of(volume)
    assert '"unit_distance": 0.25' in function.to_json()


def test_lookup_tables_are_shared():
    table = pv.LookupTable("plasma", n_values=6, scalar_range=(0, 3), alpha_range=(0.0, 0.5))
    values = np.linspace(0.05, 2.95, 30)
    values = values[np.abs(values / 0.5 - np.rint(values / 0.5)) > 0.05]
    expected = np.array([[*table_colour(table, v), table.GetOpacity(v)] for v in values])
    ours = shown(_vtk.function_of(table), values)
    assert np.abs(ours - expected).max() < 2 / 255
    made = plotter()
    handle = es.pyvista.add(made, cube(), transfer_function=table)
    assert handle.lookup_table is table
    first = picture(made)
    table.apply_cmap("viridis", n_values=6)
    table.alpha_range = (0.0, 0.5)
    assert np.abs(picture(made) - first).max() > 20, "a changed table is drawn"
    bar = handle.scalar_bar()
    assert bar.GetLookupTable() is table
    handle.update(transfer_function="magma")
    assert bar.GetLookupTable() is handle.lookup_table is not table


def test_tables_follow_the_function():
    made = plotter()
    handle = es.pyvista.add(made, cube(), transfer_function="plasma")
    before = [handle.lookup_table.GetTableValue(i) for i in (10, 200)]
    assert isinstance(handle.lookup_table, pv.LookupTable)
    table = handle.lookup_table
    handle.update(transfer_function="viridis")
    assert table is handle.lookup_table and [table.GetTableValue(i) for i in (10, 200)] != before


# Errors ---------------------------------------------------------------------------------------------------------------


def test_errors_name_what_is_wrong():
    made = plotter()
    with pytest.raises(TypeError, match="background: no such setting"):
        es.pyvista.add(made, cube(), background=(0, 0, 0))
    with pytest.raises(TypeError, match="plotters"):
        es.pyvista.add(made, cube(), plotters=1)
    with pytest.raises(ValueError, match="without opacities"):
        es.pyvista.add(made, cube(), transfer_function=functions()[0])
    with pytest.raises(TypeError, match="vtkSphereSource"):
        es.pyvista.add(made, cube(), transfer_function=vtk.vtkSphereSource())
    assert len(made.renderer.actors) == 0
    handle = es.pyvista.add(made, cube())
    with pytest.raises(ValueError, match="slab_thickness"):
        handle.update(composite="slabs", slab_thickness=-1.0)
    with pytest.raises(ValueError, match="in no scene"):
        handle.add_to(made.renderer)
    coloured = es.Splats.from_arrays(np.eye(3), [[0.3] * 3] * 3, [[1, 0, 0, 0]] * 3, [0.5] * 3, colors=[[1.0, 0, 0]] * 3)
    with pytest.raises(ValueError, match="own colours"):
        es.pyvista.add(made, es.Renderer(coloured, backend="cpu")).scalar_bar()


def test_what_cannot_be_drawn_is_said_once():
    for change in (
        lambda made: made.enable_anti_aliasing("ssaa"),
        lambda made: made.set_scale(zscale=2),
        lambda made: made.camera.SetViewShear(0.2, 0.1, 1.0),
    ):
        made = plotter()
        es.pyvista.add(made, cube())
        change(made)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            picture(made)
        said = [str(warning.message) for warning in caught if "ewa_splat" in str(warning.message)]
        assert len(said) == 1 and re.search("passes|scaled|shears", said[0]), said


def test_the_page_runs(monkeypatch, tmp_path):
    text = (DOCS / "pyvista.md").read_text(encoding="utf-8")
    monkeypatch.setattr(pv, "OFF_SCREEN", True)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) >= 2
    for block in blocks:
        exec(compile(block, "pyvista.md", "exec"), {})
    assert (tmp_path / "scene.png").stat().st_size > 1000
