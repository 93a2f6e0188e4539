//! Tests the overlays, and the handles in the picture.

use egui_kittest::kittest::NodeT as _;
use glam::DVec3;

use super::*;
use crate::clip::Clip;
use crate::panel::output::command;

/// Returns the picture that the window writes.
fn saved(window: &mut Harness<'_, App>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("saved.png");
    window.state_mut().message = None;
    window.state_mut().write(path.clone());
    let begun = Instant::now();
    while window.state().message.is_none() {
        window.step();
        assert!(begun.elapsed() < LONGEST);
    }
    read(&path)
}

/// Reads a picture without transparency, four bytes a pixel.
fn read(path: &std::path::Path) -> Vec<u8> {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    let opaque = |rgb: &[u8]| [rgb[0], rgb[1], rgb[2], 255];
    pixels.chunks(3).flat_map(opaque).collect()
}

/// Projects a point of the world to a pixel by the camera's projection.
fn projected(window: &Harness<'_, App>, world: DVec3) -> Vec2 {
    let app = window.state();
    let camera = app.orbit.as_ref().unwrap().camera(app.size);
    let pixel = camera.project(world).unwrap();
    #[expect(clippy::cast_possible_truncation, reason = "within the window")]
    let pixel = Vec2::new(pixel.x as f32, pixel.y as f32);
    pixel
}

/// Returns the position of a point of the world in the window, relative to that of a handle.
fn place(window: &Harness<'_, App>, world: DVec3) -> Pos2 {
    let [low, high] = corners(window);
    let mut known = (low + high) / 2.0;
    known.z = high.z;
    let handle = window.get_by_label("upper z face").rect().center();
    handle + projected(window, world) - projected(window, known)
}

fn corners(window: &Harness<'_, App>) -> [DVec3; 2] {
    Clip::of(&window.state().settings.clip).corners.unwrap()
}

fn click(window: &mut Harness<'_, App>, name: &str) {
    window.get_by_label(name).click();
    window.step();
    window.step();
}

#[test]
fn saved_pictures_have_what_is_over_them() {
    let (grid, function) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let words = [
        &grid,
        "--transfer-function",
        &function,
        "--legend",
        "--axes",
        "--outline",
        "--refine",
        "off",
    ];
    let mut window = window(&words);
    let over = window.state().shown_over();
    assert!(over.legend && over.axes && over.outline);
    let with_all = saved(&mut window);
    assert!(with_all == of_command(&mut window));
    let changed = { with_all.iter().zip(pixels(&window)) }
        .filter(|(a, b)| **a != *b)
        .count();
    assert!(changed > 5000, "{changed}");
    // Changes the lens, edits the function, and switches on two of the three overlays.
    window.state_mut().orbit.as_mut().unwrap().change_lens();
    let point = window
        .get_by_label_contains("opacity 0.350")
        .rect()
        .center();
    drag(
        &mut window,
        point,
        point + Vec2::new(9.0, -30.0),
        PointerButton::Primary,
    );
    window.state_mut().over.axes = false;
    rest(&mut window);
    assert!(saved(&mut window) == of_command(&mut window));
    // Counts have no overlays.
    window.state_mut().settings.show = ewa_splat::Show::Count;
    rest(&mut window);
    let line = command(window.state_mut()).unwrap();
    assert!(
        !line.contains("--legend") && !line.contains("--outline"),
        "{line}"
    );
    assert!(saved(&mut window) == pixels(&window));
}

/// The first view shows the whole outline, as the first picture of `render` does.
#[test]
fn the_first_view_is_that_of_render_with_an_outline() {
    let (grid, function) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let words = [
        &grid,
        "--transfer-function",
        &function,
        "--outline",
        "--refine",
        "off",
    ];
    let mut window = window(&words);
    let [width, height] = window.state().size;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let status = std::process::Command::new(ewa_splat_program())
        .arg("render")
        .args(words)
        .args(["--size", &format!("{width}x{height}"), "--backend", "cpu"])
        // Uses the window's background, since none was asked for.
        .args(["--background", &background(&window), "--out"])
        .arg(&path)
        .status();
    assert!(status.unwrap().success());
    let (own, of_render) = (saved(&mut window), read(&path));
    // The window converts the camera to eye and target and back, so its numbers differ in the last
    // digits.
    let worst = own
        .iter()
        .zip(&of_render)
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    assert!(
        own.len() == of_render.len() && worst <= Some(1),
        "{worst:?}"
    );
}

fn background(window: &Harness<'_, App>) -> String {
    let [r, g, b] = window.state().settings.background.unwrap();
    format!("{r},{g},{b}")
}

#[test]
fn what_is_over_the_picture_is_switched() {
    let mut window = wake();
    click(&mut window, "Annotations");
    for (name, is_on) in [
        ("Axes", (|app| app.over.axes) as fn(&App) -> bool),
        ("Outline", |app| app.over.outline),
        ("Legend", |app| app.over.legend),
    ] {
        assert!(!is_on(window.state()), "{name}");
        click(&mut window, name);
        assert!(is_on(window.state()), "{name}");
    }
    rest(&mut window);
    let vase = fixture("vase.glb");
    let mut window = super::window(&[&vase, "--count", "5000", "--legend"]);
    click(&mut window, "Annotations");
    assert!(
        window
            .get_by_role_and_label(egui::accesskit::Role::CheckBox, "Legend")
            .accesskit_node()
            .is_disabled()
    );
    assert!(!window.state().shown_over().legend);
}

/// A face dragged by the projection of a displacement moves by that displacement; the camera stays.
#[test]
fn faces_of_the_clip_box_are_dragged() {
    let mut window = wake();
    click(&mut window, "Clip");
    click(&mut window, "Box");
    rest(&mut window);
    for is_flat in [false, true] {
        if is_flat {
            window.state_mut().orbit.as_mut().unwrap().change_lens();
            rest(&mut window);
        }
        let before = window.state().orbit.clone();
        for (name, axis, is_upper) in [("upper x face", 0, true), ("lower y face", 1, false)] {
            let old = corners(&window);
            let mut from = (old[0] + old[1]) / 2.0;
            from[axis] = old[usize::from(is_upper)][axis];
            let step = (old[1][axis] - old[0][axis]) * if is_upper { -0.3 } else { 0.25 };
            let to = from + DVec3::AXES[axis] * step;
            let at = place(&window, from);
            // The picture has a whole number of pixels, so positions in the window differ by up to
            // half a pixel.
            let found = window.get_by_label(name).rect().center();
            assert!((found - at).length() < 0.6, "{found} {at}");
            let to = place(&window, to);
            drag(&mut window, at, to, PointerButton::Primary);
            rest(&mut window);
            let new = corners(&window);
            let mut wanted = old;
            wanted[usize::from(is_upper)][axis] += step;
            // Tolerance of about one pixel in thirty. The tests of `clip.rs` check the mathematics
            // exactly.
            let off = (new[0] - wanted[0]).length() + (new[1] - wanted[1]).length();
            assert!(off < 0.03 * step.abs(), "{name}: {new:?} {wanted:?}");
        }
        assert_eq!(window.state().orbit, before);
        assert!(pixels(&window) == of_command(&mut window));
    }
    // A drag beside the handles turns the camera.
    let before = window.state().orbit.clone();
    let beside = place(&window, corners(&window)[1]) + Vec2::new(0.0, -40.0);
    drag(
        &mut window,
        beside,
        beside + Vec2::new(40.0, 0.0),
        PointerButton::Primary,
    );
    assert_ne!(window.state().orbit, before);
    window.get_by_label("Clip nothing").scroll_to_me();
    window.run_steps(5);
    click(&mut window, "Clip nothing");
    assert!(window.state().settings.clip.is_empty());
}

/// A plane is moved along its normal and rotated, and its command makes its picture.
#[test]
fn the_clip_plane_is_dragged() {
    let mut window = wake();
    click(&mut window, "Clip");
    click(&mut window, "Plane");
    rest(&mut window);
    let camera = window.state().orbit.clone();
    let plane = |window: &Harness<'_, App>| window.state().settings.clip[0];
    let first = plane(&window);
    let at = window.get_by_label("clip plane").rect().center();
    let tip = window
        .get_by_label("normal of the clip plane")
        .rect()
        .center();
    let along = (tip - at).normalized();
    drag(&mut window, at, at + along * 25.0, PointerButton::Primary);
    let moved = plane(&window);
    assert_eq!(moved.normal, first.normal);
    // Moved towards the kept side, the plane keeps less.
    assert!(moved.distance < first.distance, "{first:?} {moved:?}");
    let now = window.get_by_label("clip plane").rect().center();
    assert!((now - (at + along * 25.0)).length() < 0.5, "{now}");
    let tip = window
        .get_by_label("normal of the clip plane")
        .rect()
        .center();
    let aside = tip + Vec2::new(12.0, -18.0);
    drag(&mut window, tip, aside, PointerButton::Primary);
    rest(&mut window);
    let turned = plane(&window);
    assert!((turned.normal.length() - 1.0).abs() < 1e-12);
    assert!(turned.normal.dot(moved.normal) < 0.999, "{turned:?}");
    let found = window
        .get_by_label("normal of the clip plane")
        .rect()
        .center();
    assert!((found - aside).length() < 0.5, "{found} {aside}");
    // It turned around the handle.
    let still = window.get_by_label("clip plane").rect().center();
    assert!((still - now).length() < 0.5, "{still} {now}");
    assert_eq!(window.state().orbit, camera);
    assert!(pixels(&window) == of_command(&mut window));
}

#[test]
fn boundaries_are_chosen_where_there_are_any() {
    use egui::accesskit::Role;
    use ewa_splat::sample::BoundaryChoice;

    let mut window = wake();
    let first = pixels(&window);
    for choice in ["soft", "sharp"] {
        let row = window.get_by_role_and_label(Role::ComboBox, "Boundary");
        row.click();
        window.step();
        window.step();
        click(&mut window, choice);
        rest(&mut window);
        let line = command(window.state_mut()).unwrap();
        assert!(line.contains(&format!("--boundary={choice}")), "{line}");
        let now = pixels(&window);
        assert!(now == of_command(&mut window));
        let is_sharp = window.state().request.boundary() == BoundaryChoice::Sharp;
        assert_eq!(is_sharp, choice == "sharp");
        // The function shows some of the boundary, so the default is sharp.
        assert_eq!(now == first, is_sharp);
    }
    let vase = fixture("vase.glb");
    let window = super::window(&[&vase, "--count", "5000"]);
    let row = window.get_by_role_and_label(Role::ComboBox, "Boundary");
    assert!(row.accesskit_node().is_disabled());
}
