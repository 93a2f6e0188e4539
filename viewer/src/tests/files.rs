//! Tests the files that the window reads and writes beside the data.

use std::collections::HashMap;
use std::path::PathBuf;

use egui::Key;

use super::*;
use crate::dialogs::Purpose;

/// Sends a choice, as if the user had made it in a dialog.
fn choose(window: &mut Harness<'_, App>, purpose: Purpose, path: PathBuf) {
    let sender = window.state().dialogs.sender();
    sender.send((purpose, vec![path])).unwrap();
    window.step();
}

/// ParaView's colour maps are read as the command line reads them.
#[test]
fn maps_of_paraview_are_loaded() {
    let mut window = wake();
    let [low, high] = window.state_mut().history().unwrap().function().range();
    let middle = (low + high) / 2.0;
    let text = format!(
        "[{{\"ColorSpace\": \"Lab\", \"Name\": \"mine\", \"RGBPoints\": [{low}, 0.1, 0.2, 0.9, {middle}, 0.9, 0.9, 0.9, \
         {high}, 0.9, 0.1, 0.1], \"Points\": [{low}, 0, 0.5, 0, {high}, 0.3, 0.4, 0.2]}}]"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("paraview.json");
    std::fs::write(&path, text).unwrap();
    let before = pixels(&window);
    choose(&mut window, Purpose::Function, path.clone());
    rest(&mut window);
    assert!(window.state_mut().history().unwrap().can_undo());
    let loaded = pixels(&window);
    assert_ne!(before, loaded);
    assert_eq!(loaded, of_command(&mut window));
    // A file that holds no function causes an error message and changes nothing.
    std::fs::write(&path, "[{\"RGBPoints\": [1, 2]}]").unwrap();
    choose(&mut window, Purpose::Function, path);
    assert!(window.state().message.as_ref().unwrap().is_error);
    rest_in_spite_of_errors(&mut window);
    assert_eq!(loaded, pixels(&window));
}

/// The film of key frames equals the command line's, byte by byte.
#[test]
fn key_frames_are_filmed() {
    let mut window = wake();
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name);
    for _ in 0..3 {
        window.key_press(Key::K);
        window.step();
        let orbit = window.state_mut().orbit.as_mut().unwrap();
        orbit.turn(0.6, 0.1);
        window.step();
    }
    let app = window.state_mut();
    assert_eq!(app.path.keys.len(), 3);
    app.path.frames = 4;
    app.path.file = name("path.json").display().to_string();
    app.output.size = [72, 48];
    // Commands have this background.
    app.settings.background = Some([0.25, 0.5, 0.125]);
    crate::panel::path::save_path(window.state_mut());
    window.step();
    rest(&mut window);
    choose(&mut window, Purpose::Film, name("a.apng"));
    assert!(window.state().progress.is_some());
    rest(&mut window);
    let said = window.state().message.clone().unwrap();
    assert!(said.text.ends_with("a.apng is written"), "{said:?}");
    let status = std::process::Command::new(ewa_splat_program())
        .args(["render", &fixture("wake.xyz"), "--transfer-function"])
        .arg(fixture("wake_transfer.json"))
        .args([
            "--size=72x48",
            "--background=0.25,0.5,0.125",
            "--backend=cpu",
        ])
        .arg("--camera-path")
        .arg(name("path.json"))
        .arg("--out")
        .arg(name("b.apng"))
        .status();
    assert!(status.unwrap().success());
    let [a, b] = ["a.apng", "b.apng"].map(|file| std::fs::read(name(file)).unwrap());
    assert!(a == b, "{} and {} bytes", a.len(), b.len());

    // Keys can be read back from their file. A broken file leaves the keys.
    let keys = window.state().path.keys.clone();
    window.state_mut().path.keys.clear();
    choose(&mut window, Purpose::Path, name("path.json"));
    assert_eq!(window.state().path.keys, keys);
    std::fs::write(name("path.json"), "{\"frames\": 4, \"keys\": []}").unwrap();
    choose(&mut window, Purpose::Path, name("path.json"));
    assert_eq!(window.state().path.keys, keys);
    assert!(window.state().message.as_ref().unwrap().is_error);
    // Orthographic views cannot be keys.
    window.state_mut().message = None;
    window.key_press(Key::O);
    window.step();
    window.key_press(Key::K);
    window.step();
    assert_eq!(window.state().path.keys, keys);
    assert!(window.state().message.as_ref().unwrap().is_error);
}

/// A cancelled film is not written.
#[test]
fn films_are_cancelled() {
    let mut window = wake();
    let folder = tempfile::tempdir().unwrap();
    for _ in 0..2 {
        window.key_press(Key::K);
        window.step();
        window.state_mut().orbit.as_mut().unwrap().turn(0.5, 0.0);
        window.step();
    }
    window.state_mut().path.frames = 10_000;
    choose(&mut window, Purpose::Film, folder.path().join("a.gif"));
    assert!(window.state().progress.is_some());
    window.key_press(Key::Escape);
    window.step();
    rest(&mut window);
    assert!(!folder.path().join("a.gif").exists());
    // The worker refuses a path that is no film.
    choose(&mut window, Purpose::Film, folder.path().join("a.png"));
    assert!(window.state().message.as_ref().unwrap().is_error);
}

#[derive(Default)]
struct Storage(HashMap<String, String>);

impl eframe::Storage for Storage {
    fn get_string(&self, key: &str) -> Option<String> {
        self.0.get(key).cloned()
    }

    fn set_string(&mut self, key: &str, value: String) {
        self.0.insert(key.into(), value);
    }

    fn remove_string(&mut self, key: &str) {
        self.0.remove(key);
    }

    fn flush(&mut self) {}
}

#[test]
fn choices_are_remembered() {
    let path = fixture("vase.glb");
    let words = [path.as_str(), "--count", "2000"];
    let mut storage = Storage::default();
    let mut first = window(&words);
    let app = first.state_mut();
    app.output.size = [300, 200];
    app.output.picture = "mine.exr".into();
    (app.logarithmic_counts, app.follows) = (false, false);
    app.orbit.as_mut().unwrap().turn(0.4, 0.1);
    app.saved.extend(app.orbit.clone());
    app.keep_in(&mut storage);

    let mut again = window(&words);
    again.state_mut().recall_from(Some(&storage));
    let app = again.state();
    assert_eq!(app.output, first.state().output);
    assert!(!app.logarithmic_counts && !app.follows);
    assert_eq!(app.saved, first.state().saved);
    assert_eq!(app.message, None);

    // Saved views apply only to the data for which they were saved.
    let other = fixture("wake.xyz");
    let request = ViewRequest::of_files(vec![other.into()]).unwrap();
    let mut other = App::new(request, &egui::Context::default(), Canvas::default());
    other.recall_from(Some(&storage));
    assert_eq!(other.output.size, [300, 200]);
    assert!(other.saved.is_empty());

    // A broken entry causes a message.
    storage.0.insert("choices".into(), "{\"output\": 3}".into());
    let request = ViewRequest::of_files(vec![path.into()]).unwrap();
    let mut broken = App::new(request, &egui::Context::default(), Canvas::default());
    broken.recall_from(Some(&storage));
    let said = broken.message.clone().unwrap();
    assert!(!said.is_error && said.text.starts_with("the last choices"));
    assert_eq!(broken.output, crate::output::Output::default());
}

/// Data files that change are read again, and the camera stays.
#[test]
fn files_that_change_are_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vti");
    std::fs::write(&path, grid(1.0)).unwrap();
    let name = path.display().to_string();
    let mut window = window(&[&name]);
    let context = window.ctx.clone();
    window.state().watch.start(context);
    let orbit = window.state().orbit.clone();
    let range = |window: &mut Harness<'_, App>| {
        let history = window.state_mut().history().unwrap();
        history.function().range()
    };
    let before = range(&mut window);
    std::fs::write(&path, grid(3.0) + "\n").unwrap();
    let begun = Instant::now();
    while range(&mut window) == before {
        window.step();
        assert!(begun.elapsed() < LONGEST);
        std::thread::sleep(Duration::from_millis(20));
    }
    let after = range(&mut window);
    assert!((after[1] / before[1] - 3.0).abs() < 0.01, "{after:?}");
    assert_eq!(window.state().orbit, orbit);
}
