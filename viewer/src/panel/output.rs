//! What is written: the picture, the function, the command that makes the picture again.

use std::path::{Path, PathBuf};

use egui::{CollapsingHeader, TextEdit, Ui};
use ewa_splat::io::{check_image_path, write_bytes_atomically};

use crate::app::App;
use crate::dialogs::Purpose;
use crate::words::{self, State};

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Output").show(ui, |ui| {
        ui.horizontal(|ui| {
            ui.add(TextEdit::singleline(&mut app.output.picture).desired_width(110.0));
            if ui
                .button("Save picture")
                .on_hover_text("png, exr, pfm or npy")
                .clicked()
            {
                save_picture(app);
            }
            let tip = "choose a name and save the picture";
            if ui.button("...").on_hover_text(tip).clicked() {
                app.dialogs.ask(Purpose::Picture, ui.ctx());
            }
        });
        ui.horizontal(|ui| {
            let label = ui.label("size");
            for n in &mut app.output.size {
                let field = ui.add(egui::DragValue::new(n).range(0..=65_535));
                field.labelled_by(label.id);
            }
            ui.label("0: the window's");
        });
        ui.horizontal(|ui| {
            ui.add(TextEdit::singleline(&mut app.output.function).desired_width(110.0));
            if ui
                .button("Save")
                .on_hover_text("the transfer function")
                .clicked()
            {
                save_function(app);
            }
            if ui.button("Load").clicked() {
                load_function(app);
            }
            let tip = "choose a transfer function and load it: a file of --transfer-function, or ParaView's";
            if ui.button("...").on_hover_text(tip).clicked() {
                app.dialogs.ask(Purpose::Function, ui.ctx());
            }
        });
        let tip = "the line that makes this picture; a function that was edited is saved first";
        if ui.button("Copy command").on_hover_text(tip).clicked()
            && let Some(line) = command(app)
        {
            ui.ctx().copy_text(line);
            app.say("the command is on the clipboard".into());
        }
    });
}

/// Draws the picture at the size that is asked for, by the tolerance that is asked for.
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

/// A file of this library's or of ParaView's.
pub(crate) fn load_function(app: &mut App) {
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
        range: history.curve().range,
        unit_distance: history.function().unit_distance(),
    };
    let read = |text: &str| TransferFunction::from_json(path, text, &defaults);
    let loaded = read(&text).and_then(|function| {
        // A file that leaves its unit to the data has the one of the function before it, and says so from now on.
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

/// The command that makes the picture of the window; a function that was edited is saved first.
pub(crate) fn command(app: &mut App) -> Option<String> {
    // A step by itself would have a function of its own.
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
        asked: &app.asked,
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
