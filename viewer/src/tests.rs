//! Tests the window by simulated input, without a display.

#[path = "../../src/breadth.rs"]
mod breadth;
mod device;
mod editor;
mod files;
mod over;
mod panels;

use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{Event, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

use ewa_splat::command::{ViewArguments, ViewRequest};

use self::breadth::some;
use crate::app::App;
use crate::canvas::Canvas;
use crate::instead::Instead;
use crate::worker::Picture;

const LONGEST: Duration = Duration::from_secs(120);

fn fixture(name: &str) -> String {
    format!("{}/../fixtures/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn window(words: &[&str]) -> Harness<'static, App> {
    let words = std::iter::once("ewa-splat-view").chain(words.iter().copied());
    let arguments = ViewArguments::parse(words.map(Into::into)).unwrap();
    let mut app = App::new(
        arguments.request,
        &egui::Context::default(),
        Canvas::default(),
    );
    // Pictures are compared without the overlays that the window shows by default.
    app.over = app.request.over();
    let size = Vec2::new(960.0, 640.0);
    let mut window = Harness::builder()
        .with_size(size)
        .build_ui_state(|ui, app: &mut App| crate::window::show(app, ui), app);
    rest(&mut window);
    window
}

/// Opens a window on the README's fixture. It is read again for each view at rest, with refined kernels, only if
/// `refine` is "auto".
fn wake_refined(refine: &str) -> Harness<'static, App> {
    let (grid, function) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    window(&[&grid, "--transfer-function", &function, "--refine", refine])
}

/// Opens a window on the README's fixture, without refining.
fn wake() -> Harness<'static, App> {
    wake_refined("off")
}

/// Runs passes until no work is left.
fn rest(window: &mut Harness<'_, App>) {
    let begun = Instant::now();
    let mut passes = 0;
    while passes < 3 {
        window.step();
        passes = if window.state().is_at_rest() {
            passes + 1
        } else {
            0
        };
        assert!(
            begun.elapsed() < LONGEST,
            "no rest: {:?}",
            window.state().message
        );
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Runs passes until no work is left, whatever error was shown before.
fn rest_in_spite_of_errors(window: &mut Harness<'_, App>) {
    window.state_mut().message = None;
    rest(window);
}

fn drag(window: &mut Harness<'_, App>, from: Pos2, to: Pos2, button: PointerButton) {
    let press = |pos, pressed| Event::PointerButton {
        pos,
        button,
        pressed,
        modifiers: egui::Modifiers::NONE,
    };
    window.event(Event::PointerMoved(from));
    window.step();
    window.event(press(from, true));
    window.step();
    for i in 1..=4 {
        window.event(Event::PointerMoved(from + (to - from) * (i as f32 / 4.0)));
        window.step();
    }
    window.event(press(to, false));
    window.step();
}

fn image(window: &Harness<'_, App>) -> Arc<ewa_splat::Image> {
    match &window.state().drawn.as_ref().unwrap().picture {
        Picture::Pixels(image) => Arc::clone(image),
        Picture::Texture(_) => panic!("no device was given"),
    }
}

fn pixels(window: &Harness<'_, App>) -> Vec<u8> {
    let image = image(window);
    assert_eq!([image.width, image.height], window.state().size);
    image.to_srgb8()
}

/// Returns the picture that a window's command makes.
fn of_command(window: &mut Harness<'_, App>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).display().to_string();
    let output = &mut window.state_mut().output;
    output.picture = name("a.png");
    output.function = name("f.json");
    let line = crate::panel::output::command(window.state_mut()).unwrap();
    let program = ewa_splat_program();
    let words = line.split(' ').skip(1).map(|word| word.trim_matches('\''));
    let status = std::process::Command::new(program)
        .args(words)
        .args(["--backend", "cpu"])
        .status();
    assert!(status.unwrap().success(), "{line}");
    let file = std::fs::File::open(folder.path().join("a.png")).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    let opaque = |rgb: &[u8]| [rgb[0], rgb[1], rgb[2], 255];
    pixels.chunks(3).flat_map(opaque).collect()
}

/// Returns the path of this build's command line: cargo builds it beside this test's program.
fn ewa_splat_program() -> std::path::PathBuf {
    let own = std::env::current_exe().unwrap();
    let folder = own.parent().unwrap().parent().unwrap();
    let program = folder.join(format!("ewa-splat{}", std::env::consts::EXE_SUFFIX));
    assert!(program.is_file(), "build it first: cargo build");
    program
}

#[test]
fn pictures_are_those_of_the_command_line() {
    let mut refined = wake_refined("auto");
    assert_eq!(pixels(&refined), of_command(&mut refined));
    drop(refined);
    for refine in some(vec!["off", "auto"], 1) {
        let mut window = wake_refined(refine);
        // Drags an opacity point and turns the camera.
        let point = window
            .get_by_label_contains("opacity 0.350")
            .rect()
            .center();
        let centre = Pos2::new(450.0, 250.0);
        drag(
            &mut window,
            point,
            point + Vec2::new(12.0, -40.0),
            PointerButton::Primary,
        );
        drag(
            &mut window,
            centre,
            centre + Vec2::new(90.0, -35.0),
            PointerButton::Primary,
        );
        rest(&mut window);
        assert!(window.state_mut().history().unwrap().can_undo());
        assert_eq!(pixels(&window), of_command(&mut window));
    }
}

#[test]
fn turns_lead_back_and_undo_restores() {
    let mut window = wake();
    let before = pixels(&window);
    let step = |window: &mut Harness<'_, App>, degrees: f64| {
        window
            .state_mut()
            .orbit
            .as_mut()
            .unwrap()
            .turn(degrees.to_radians(), 0.0);
        window.step();
    };
    for _ in 0..8 {
        step(&mut window, 45.0);
    }
    rest(&mut window);
    let apart = |a: &[u8], b: &[u8]| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
    // Eight steps turn the picture full circle.
    assert!(apart(&before, &pixels(&window)) <= Some(1));
    step(&mut window, 45.0);
    rest(&mut window);
    assert!(apart(&before, &pixels(&window)) > Some(30));
    step(&mut window, -45.0);

    let point = window
        .get_by_label_contains("opacity 0.350")
        .rect()
        .center();
    drag(
        &mut window,
        point,
        point - Vec2::new(0.0, 60.0),
        PointerButton::Primary,
    );
    rest(&mut window);
    assert!(apart(&before, &pixels(&window)) > Some(30));
    window.get_by_label("Undo").click();
    window.step();
    rest(&mut window);
    assert!(apart(&before, &pixels(&window)) <= Some(1));
}

#[test]
fn what_cannot_be_read_is_told_and_leaves_the_scene() {
    let mut window = wake();
    let before = pixels(&window);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.vtu");
    std::fs::write(&path, "<VTKFile type=\"UnstructuredGrid\">").unwrap();
    window.state_mut().open(vec![path]);
    rest(&mut window);
    let message = window.state().message.clone().unwrap();
    assert!(
        message.is_error && message.text.contains("broken.vtu"),
        "{message:?}"
    );
    assert_eq!(before, pixels(&window));
    // The old scene is still the window's: its name is shown and it can be turned.
    assert!(window.state().inputs[0].ends_with("wake.xyz"));
    let orbit = window.state_mut().orbit.as_mut().unwrap();
    orbit.turn(0.7, 0.0);
    window.step();
    rest_in_spite_of_errors(&mut window);
    assert_ne!(before, pixels(&window));
    assert_eq!(pixels(&window), of_command(&mut window));
}

/// The user cancels a reading, and the old scene stays.
#[test]
fn reading_is_cancelled() {
    let mut window = wake();
    let before = pixels(&window);
    let other = fixture("vase.glb");
    window.state_mut().open(vec![other.into()]);
    window.state_mut().cancel();
    let begun = Instant::now();
    while window.state().progress.is_some() {
        window.step();
        assert!(begun.elapsed() < LONGEST);
    }
    // A cancellation that comes too late leaves the complete other scene.
    if window.state().inputs[0].ends_with("wake.xyz") {
        rest(&mut window);
        assert_eq!(before, pixels(&window));
    }
}

/// Depths and normals match those of the command line.
#[test]
fn depths_and_normals_are_shown() {
    let vase = fixture("vase.glb");
    let mut window = window(&[&vase, "--count", "20000"]);
    let is_black = |p: &&[f32; 4]| p[0] == 0.0 && p[1] == 0.0 && p[2] == 0.0;
    let mut counts = Vec::new();
    for instead in [Instead::Depth, Instead::Normals] {
        window.state_mut().instead = Some(instead);
        window.step();
        rest(&mut window);
        let image = image(&window);
        assert!(image.pixels.iter().any(|p| p[0] > 0.9), "{instead:?}");
        counts.push(image.pixels.iter().filter(is_black).count());
    }
    let all = image(&window).pixels.len();
    assert!(
        counts[0] > all / 4 && counts[0] < all * 9 / 10,
        "{counts:?} of {all}"
    );
    // Both images show the same surface. Its rim has normals, but absorbs too little light for a
    // depth.
    assert!(
        counts[1] <= counts[0] && counts[0] - counts[1] < all / 25,
        "{counts:?} of {all}"
    );
}

/// The reference image is near the splatted picture, and the message reports the difference.
#[test]
fn truth_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("three.csv");
    // Every kernel is integrated along every ray, so the scene and picture are small. Two kernels
    // overlap.
    let rows = "x,y,z,vxx,vxy,vxz,vyy,vyz,vzz,opacity,r,g,b\n\
        0,0,0,.04,0,0,.04,0,.04,.7,1,.2,.2\n\
        .1,.1,0,.04,.01,0,.02,0,.04,.7,.2,1,.2\n\
        .6,0,.3,.01,0,0,.02,0,.01,.7,.2,.2,1\n";
    std::fs::write(&path, rows).unwrap();
    let mut window = window(&[&path.display().to_string()]);
    window.set_size(Vec2::new(600.0, 200.0));
    window.step();
    rest(&mut window);
    let before = pixels(&window);
    window.state_mut().ask_truth();
    assert!(window.state().progress.is_some());
    rest(&mut window);
    let message = window.state().message.clone().unwrap();
    assert!(
        message.text.starts_with("the reference image"),
        "{message:?}"
    );
    let after = pixels(&window);
    let apart = before.iter().zip(&after).map(|(a, b)| a.abs_diff(*b)).max();
    // Kernels that overlap in depth do not mix when they are composited one by one.
    assert!(apart > Some(0) && apart < Some(100), "{apart:?}");
}

#[test]
fn a_click_tells_what_is_there() {
    let mut window = wake();
    let centre = Pos2::new(450.0, 300.0);
    for pressed in [true, false] {
        window.event(Event::PointerMoved(centre));
        window.event(Event::PointerButton {
            pos: centre,
            button: PointerButton::Primary,
            pressed,
            modifiers: egui::Modifiers::NONE,
        });
        window.step();
    }
    let begun = Instant::now();
    while window.query_by_label_contains("of the pixel").is_none() {
        window.step();
        assert!(begun.elapsed() < LONGEST);
    }
    let app = window.state_mut();
    let found = app.probe.clone().unwrap().found.unwrap();
    let range = app.history().unwrap().function().range();
    let value = found.value.unwrap();
    assert!(value > range[0] && value < range[1], "{value} of {range:?}");
}

#[test]
fn every_panel_opens() {
    let mut window = wake();
    for name in [
        "Data",
        "Method",
        "Clip",
        "Annotations",
        "Light",
        "Camera",
        "Camera path",
        "Output",
        "Transfer function",
        "Probe",
        "Statistics",
    ] {
        window.get_by_label(name).click();
        window.step();
        window.step();
        window.get_by_label(name).click();
        window.step();
    }
    rest(&mut window);
}

/// Dragging the light lights surfaces as `--light` does.
#[test]
fn lights_are_dragged() {
    let vase = fixture("vase.glb");
    let mut window = window(&[&vase, "--count", "20000"]);
    let before = pixels(&window);
    window.get_by_label("Light").click();
    window.step();
    window.step();
    let ball = window.get_by_label_contains("light from").rect().center();
    drag(
        &mut window,
        ball,
        ball + Vec2::new(25.0, 10.0),
        PointerButton::Primary,
    );
    rest(&mut window);
    let after = pixels(&window);
    assert_ne!(before, after);
    assert_eq!(after, of_command(&mut window));
}

/// The image of errors is dark where pictures are near the reference, and of a thousand pixels at
/// most one exceeds the tolerance.
#[test]
fn errors_are_shown() {
    let mut window = wake();
    window.state_mut().instead = Some(Instead::Error);
    window.step();
    rest(&mut window);
    let drawn = window.state().drawn.as_ref().unwrap();
    // Yellow stands for the tolerance, and red for errors beyond it.
    let is_bad = |p: &&[f32; 4]| p[0] > 0.91 || (p[0] > 0.8 && p[1] < 0.6);
    let image = image(&window);
    let bad = image.pixels.iter().filter(is_bad).count();
    assert!(1000 * bad <= image.pixels.len(), "{bad}");
    let is_seen = |p: &&[f32; 4]| p[0] + p[1] + p[2] > 0.05;
    assert!(image.pixels.iter().any(|p| is_seen(&p)));
    assert!(drawn.error.unwrap().percentile_999 < 1.0 / 255.0);
}

/// Returns an image data file of four by four by four values.
fn grid(factor: f64) -> String {
    let value = |i: i32| f64::from(i % 4 + i / 4 % 4 + i / 16) * factor;
    let values: Vec<String> = (0..64).map(|i| value(i).to_string()).collect();
    format!(
        "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 3 0 3 0 3\" Origin=\"0 0 0\" Spacing=\"1 1 1\">\
         <Piece Extent=\"0 3 0 3 0 3\"><PointData><DataArray type=\"Float32\" Name=\"a\" format=\"ascii\">{}\
         </DataArray></PointData></Piece></ImageData></VTKFile>",
        values.join(" ")
    )
}

/// Time steps share one transfer function, and each gives the picture of its command.
#[test]
fn steps_of_time_are_gone_through() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for factor in [1.0, 3.0] {
        let path = folder.path().join(format!("{factor}.vti"));
        std::fs::write(&path, grid(factor)).unwrap();
        files.push(path.display().to_string());
    }
    for refine in some(vec!["off", "auto"], 1) {
        let mut window = window(&[&files[0], &files[1], "--series", "--refine", refine]);
        let function = |window: &mut Harness<'_, App>| {
            window.state_mut().history().unwrap().function().clone()
        };
        let (first, of_first) = (pixels(&window), function(&mut window));
        assert!(of_first.range()[1] > 20.0, "{:?}", of_first.range());
        window.state_mut().go(1);
        rest(&mut window);
        assert_eq!(of_first, function(&mut window));
        let second = pixels(&window);
        assert_ne!(first, second);
        // The file of an unedited function reproduces it approximately.
        let again = of_command(&mut window);
        assert!(second.iter().zip(&again).all(|(a, b)| a.abs_diff(*b) <= 2));
    }
}

/// Keys change the lens, the view and the panels.
#[test]
fn keys_are_answered() {
    use crate::orbit::Lens;
    use egui::Key;

    let mut window = wake();
    let press = |window: &mut Harness<'_, App>, key| {
        window.key_press(key);
        window.step();
        window.step();
    };
    let home = window.state().orbit.clone();
    press(&mut window, Key::O);
    let lens = window.state().orbit.as_ref().unwrap().lens;
    assert!(matches!(lens, Lens::Orthographic(_)));
    press(&mut window, Key::Num5);
    let orbit = window.state().orbit.clone().unwrap();
    let forward = (orbit.target - orbit.eye).normalize();
    assert!((forward - glam::DVec3::Z).length() < 1e-9);
    press(&mut window, Key::H);
    assert_eq!(window.state().orbit, home);
    press(&mut window, Key::F);
    assert!(window.state().flies);
    press(&mut window, Key::Tab);
    assert!(!window.state().shows_panels);
}
