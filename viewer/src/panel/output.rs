//! Writes the picture, the transfer function, and the command that makes the picture again.

use std::path::{Path, PathBuf};

use egui::Ui;
use ewa_splat::io::{check_image_path, write_bytes_atomically};

use super::row::{button, group, row, section, text};
use crate::app::App;
use crate::dialogs::Purpose;
use crate::words::{self, State};

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "What is written: the picture, the transfer function, and the command that draws the picture again";
    section(ui, "Output", false, tip, |ui| {
        let tip = "The file of the picture: png, exr, pfm or npy\n--out FILE";
        row(ui, "Picture file", tip, |ui| {
            text(ui, &mut app.output.picture)
        });
        let tip = "Width and height of the picture in pixels; 0: those of the picture in the window\n--size WxH";
        group(ui, "Size", tip, |ui, row| {
            for n in &mut app.output.size {
                row.of(ui.add(egui::DragValue::new(n).range(0..=65_535)));
            }
        });
        ui.horizontal_wrapped(|ui| {
            if button(
                ui,
                "Save picture",
                "Draw the picture and write the file\n--out FILE",
            ) {
                save_picture(app);
            }
            if button(ui, "Save as…", "Choose a name and save the picture") {
                app.dialogs.ask(Purpose::Picture, ui.ctx());
            }
        });
        let tip = "The file of the transfer function, JSON\n--transfer-function FILE";
        row(ui, "Function file", tip, |ui| {
            text(ui, &mut app.output.function)
        });
        ui.horizontal_wrapped(|ui| {
            let tip = "Write the transfer function to the file\n--write-transfer-function FILE";
            if button(ui, "Save function", tip) {
                save_function(app);
            }
            let tip = "Read the transfer function from the file: this program's or ParaView's\n--transfer-function FILE";
            if button(ui, "Load function", tip) {
                load_function(app);
            }
            if button(ui, "Browse…", "Choose a transfer function and load it") {
                app.dialogs.ask(Purpose::Function, ui.ctx());
            }
        });
        let tip = "Put the command on the clipboard that draws this picture; a transfer function that was edited is saved \
                   first, under the name above\newa-splat render";
        if button(ui, "Copy command", tip)
            && let Some(line) = command(app)
        {
            ui.ctx().copy_text(line);
            app.say("the command is on the clipboard".into());
        }
    });
}

/// Draws the picture at the size and tolerance asked for, and writes it.
pub(crate) fn save_picture(app: &mut App) {
    let path = PathBuf::from(&app.output.picture);
    match check_image_path(&path) {
        Ok(()) => app.write(path),
        Err(error) => app.fail(ewa_splat::command::line(&error)),
    }
}

fn save_function(app: &mut App) {
    let path = PathBuf::from(&app.output.function);
    let Some(history) = app.history() else {
        return app.fail("no transfer function".into());
    };
    let text = history.file();
    match write_bytes_atomically(&path, text.as_bytes()) {
        Ok(()) => app.say(format!("{} is written", path.display())),
        Err(error) => app.fail(ewa_splat::command::line(&error)),
    }
}

/// Loads a transfer function of this library or of ParaView.
pub(crate) fn load_function(app: &mut App) {
    use crate::curve::narrowed;
    use ewa_splat::scene::{TransferDefaults, TransferFunction};
    let path = app.output.function.clone();
    let path = Path::new(&path);
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) => return app.fail(format!("{}: {error}", path.display())),
    };
    let Some(history) = app.history() else {
        return app.fail("no transfer function".into());
    };
    let defaults = TransferDefaults {
        range: history.curve().range.map(narrowed),
        unit_distance: history.function().unit_distance(),
    };
    let read = |text: &str| TransferFunction::from_json(path, text, &defaults);
    let loaded = read(&text).and_then(|function| {
        // A file without a unit distance gets that of the previous function, and its text is
        // completed with it.
        let file: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        let text = match file.get("unit_distance") {
            Some(_) => text.clone(),
            None => function.to_json(),
        };
        Ok((read(&text)?, text))
    });
    match loaded {
        Ok((function, text)) => history.load(function, text),
        Err(error) => app.fail(ewa_splat::command::line(&error)),
    }
}

/// Returns the command that makes the picture of the window. An edited transfer function is saved
/// first.
pub(crate) fn command(app: &mut App) -> Option<String> {
    // A single step would choose a transfer function from its own values.
    let is_step = app.time.count() > 1;
    let is_edited = app
        .history()
        .is_some_and(|history| history.can_undo() || is_step);
    if is_edited {
        save_function(app);
    }
    let size = app.picture_size();
    let loaded = app.loaded.as_ref()?;
    let chosen = app.inputs.iter().zip(&app.chosen);
    let state = State {
        request: &app.request,
        inputs: match is_step && app.inputs.len() == app.time.count() {
            true => vec![app.inputs[app.time.step].as_str()],
            false => chosen
                .filter_map(|(input, is_chosen)| is_chosen.then_some(input.as_str()))
                .collect(),
        },
        field: app.field.as_deref(),
        function: is_edited.then_some(app.output.function.as_str()),
        orbit: app.orbit.as_ref()?,
        settings: [&loaded.settings, &app.settings],
        over: app.shown_over(),
        size,
        out: &app.output.picture,
    };
    Some(words::line(&words::words(&state)))
}
