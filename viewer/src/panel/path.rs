//! Key frames.

use std::path::{Path, PathBuf};

use egui::{CollapsingHeader, Context, DragValue, TextEdit, Ui};
use ewa_splat::command::{Animation, line};
use ewa_splat::io::write_bytes_atomically;
use ewa_splat::view::CameraPath;

use crate::app::App;
use crate::dialogs::Purpose;
use crate::orbit::Orbit;
use crate::path::{key_of, orbit_of};

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Key frames").show(ui, |ui| {
        keys(app, ui);
        let has_path = app.path.keys.len() > 1;
        ui.horizontal(|ui| {
            let frames = DragValue::new(&mut app.path.frames).range(2..=10_000);
            let frames = ui.add(frames);
            frames.labelled_by(ui.label("pictures").id);
            let is_playing = app.path.playing.is_some();
            let label = if is_playing { "Stop" } else { "Show path" };
            let tip = "along the keys, as --camera-path draws them";
            let button = ui.add_enabled(has_path, egui::Button::new(label));
            if button.on_hover_text(tip).clicked() {
                match is_playing {
                    true => app.path.playing = None,
                    false => app.path.play(ui.input(|input| input.time)),
                }
            }
        });
        ui.horizontal(|ui| {
            ui.add(TextEdit::singleline(&mut app.path.file).desired_width(90.0));
            let save = ui.add_enabled(has_path, egui::Button::new("Save path"));
            if save.on_hover_text("a file of --camera-path").clicked() {
                save_path(app);
            }
            if ui.button("Load path").clicked() {
                load_path(app);
            }
            let tip = "choose a path and load it";
            if ui.button("...").on_hover_text(tip).clicked() {
                app.dialogs.ask(Purpose::Path, ui.ctx());
            }
        });
        ui.horizontal(|ui| {
            ui.add(TextEdit::singleline(&mut app.path.film).desired_width(90.0));
            let tip =
                "an .apng, a .gif, or pictures: film_%04d.png (exr, pfm, npy); Escape cancels";
            let film = ui.add_enabled(has_path, egui::Button::new("Film"));
            if film.on_hover_text(tip).clicked() {
                film_path(app);
            }
            let tip = "choose a name and write the film";
            let choose = ui.add_enabled(has_path, egui::Button::new("..."));
            if choose.on_hover_text(tip).clicked() {
                app.dialogs.ask(Purpose::Film, ui.ctx());
            }
        });
    });
}

/// The keys: each can be looked at, and left out.
fn keys(app: &mut App, ui: &mut Ui) {
    if ui
        .button("Add key")
        .on_hover_text("this view (K)")
        .clicked()
    {
        add(app);
    }
    let (mut taken, mut left) = (None, None);
    for (i, key) in app.path.keys.iter().enumerate() {
        ui.horizontal(|ui| {
            if ui.button(format!("Key {}", i + 1)).clicked() {
                taken = Some(*key);
            }
            if ui.small_button("x").clicked() {
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

/// Adds the view that is shown.
pub(crate) fn add(app: &mut App) {
    match app.orbit.as_ref().map(key_of) {
        Some(Some(key)) => app.path.keys.push(key),
        Some(None) => app.fail("a key has perspective: O changes the lens".into()),
        None => {}
    }
}

/// Shows the path where one is being shown, unless the view was changed otherwise.
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

/// A file of `--camera-path`.
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

/// Keys from a file of `--camera-path`, in place of those that are there.
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
