//! Shows the panel of key frames.

use std::path::{Path, PathBuf};

use egui::{Context, DragValue, Ui};
use ewa_splat::command::{Animation, line};
use ewa_splat::io::write_bytes_atomically;
use ewa_splat::view::CameraPath;

use super::row::{button, button_if, row, section, text};
use crate::app::App;
use crate::dialogs::Purpose;
use crate::orbit::Orbit;
use crate::path::{key_of, orbit_of};

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "Views that the camera passes, shown one after another and written as an animation\n--camera-path FILE";
    section(ui, "Camera path", false, tip, |ui| {
        keys(app, ui);
        let has_path = app.path.keys.len() > 1;
        let tip = "How many pictures the whole path has, 25 in a second";
        row(ui, "Frames", tip, |ui| {
            ui.add(DragValue::new(&mut app.path.frames).range(2..=10_000))
        });
        let is_playing = app.path.playing.is_some();
        let label = if is_playing { "Stop" } else { "Play path" };
        let tip = "Move the camera along the key frames, of which there are two at least\n--camera-path FILE";
        if button_if(ui, has_path, label, tip) {
            match is_playing {
                true => app.path.playing = None,
                false => app.path.play(ui.input(|input| input.time)),
            }
        }
        let tip = "The file of the path, JSON\n--camera-path FILE";
        row(ui, "Path file", tip, |ui| text(ui, &mut app.path.file));
        ui.horizontal_wrapped(|ui| {
            let tip = "Write the key frames to the file\n--camera-path FILE";
            if button_if(ui, has_path, "Save path", tip) {
                save_path(app);
            }
            let tip = "Read key frames from the file, in place of these\n--camera-path FILE";
            if button(ui, "Load path", tip) {
                load_path(app);
            }
            if button(ui, "Browse…", "Choose a path and load it") {
                app.dialogs.ask(Purpose::Path, ui.ctx());
            }
        });
        let tip = "The file of the animation: an .mp4, an .apng, a .gif, or pictures: film_%04d.png (exr, pfm, npy)\n--out FILE";
        row(ui, "Animation file", tip, |ui| text(ui, &mut app.path.film));
        ui.horizontal_wrapped(|ui| {
            let tip = "Draw all pictures of the path and write them; Escape cancels\n--camera-path FILE --out FILE";
            if button_if(ui, has_path, "Save animation", tip) {
                film_path(app);
            }
            let tip = "Choose a name and write the animation";
            if button_if(ui, has_path, "Save as…", tip) {
                app.dialogs.ask(Purpose::Film, ui.ctx());
            }
        });
    });
}

/// Lists the keys, each of which can be shown or removed.
fn keys(app: &mut App, ui: &mut Ui) {
    if button(ui, "Add key frame", "Add this view to the path (K)") {
        add(app);
    }
    let (mut taken, mut left) = (None, None);
    for (i, key) in app.path.keys.iter().enumerate() {
        ui.horizontal(|ui| {
            if button(ui, &format!("Key {}", i + 1), "Go to this key frame") {
                taken = Some(*key);
            }
            if button(ui, "×", "Take this key frame out") {
                left = Some(i);
            }
        });
    }
    if let (Some(key), Some(orbit)) = (taken, &app.orbit) {
        app.orbit = Some(orbit_of(&key, orbit.world_up));
    }
    if let Some(i) = left {
        app.path.keys.remove(i);
    }
}

/// Adds the current view as a key.
pub(crate) fn add(app: &mut App) {
    match app.orbit.as_ref().map(key_of) {
        Some(Some(key)) => app.path.keys.push(key),
        Some(None) => {
            app.fail("a key frame has perspective: press O to change the projection".into())
        }
        None => {}
    }
}

/// Advances the animation of the path, unless the view was changed otherwise.
pub(crate) fn play(app: &mut App, context: &Context) {
    let now = context.input(|input| input.time);
    if app.path.playing.is_some()
        && let Some(orbit) = &app.orbit
        && let Some(camera) = app.path.camera(now)
    {
        app.orbit = Some(Orbit::of(&camera, orbit.world_up, orbit.distance()));
        context.request_repaint();
    }
}

/// Writes a file for `--camera-path`.
pub(crate) fn save_path(app: &mut App) {
    let Some(path) = app.path.path() else {
        return;
    };
    let file = PathBuf::from(&app.path.file);
    let text = path.to_json();
    match text.and_then(|text| write_bytes_atomically(&file, text.as_bytes())) {
        Ok(()) => app.say(format!("{} is written", file.display())),
        Err(error) => app.fail(line(&error)),
    }
}

/// Replaces the keys by those from a file of `--camera-path`.
pub(crate) fn load_path(app: &mut App) {
    match CameraPath::read(Path::new(&app.path.file)) {
        Ok(path) => (app.path.keys, app.path.frames) = (path.keys, path.frames),
        Err(error) => app.fail(line(&error)),
    }
}

/// Draws all pictures of the path and writes them.
pub(crate) fn film_path(app: &mut App) {
    let file = PathBuf::from(&app.path.film);
    match Animation::check_path(&file) {
        Ok(()) => app.film(file),
        Err(error) => app.fail(line(&error)),
    }
}
