//! Runs a pass of the window: receives the worker's messages, lays out the panels, handles input,
//! and sends requests to the worker.

use std::path::PathBuf;

use egui::Ui;

use crate::app::App;
use crate::dialogs::Purpose;
use crate::panel::{self, output, path};

/// Window in the form that eframe expects.
pub(crate) struct Window(pub(crate) App);

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        show(&mut self.0, ui);
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        self.0.keep_in(storage);
    }
}

/// Lays out the window and handles its input.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let context = ui.ctx().clone();
    app.hear(&context);
    let dropped: Vec<PathBuf> = context.input(|input| {
        let files = input.raw.dropped_files.iter();
        files.map(|file| file.path().to_path_buf()).collect()
    });
    if !dropped.is_empty() {
        app.open(dropped);
    }
    take_chosen(app);
    app.follow();
    panel::keys::answer(app, &context);
    panel::path::play(app, &context);
    panel::time::play(app, &context);
    panel::status::show(app, ui);
    if app.shows_panels {
        panel::left(app, ui);
        panel::right(app, ui);
    }
    panel::picture::show(app, ui);
    panel::help::show(app, &context);
    app.show_view();
}

/// Uses the files that were chosen in dialogs.
fn take_chosen(app: &mut App) {
    for (purpose, paths) in app.dialogs.chosen() {
        let name = paths.first().map(|path| path.display().to_string());
        let name = name.unwrap_or_default();
        match purpose {
            Purpose::Open => app.open(paths),
            Purpose::Picture => {
                app.output.picture = name;
                output::save_picture(app);
            }
            Purpose::Function => {
                app.output.function = name;
                output::load_function(app);
            }
            Purpose::Path => {
                app.path.file = name;
                path::load_path(app);
            }
            Purpose::Film => {
                app.path.film = name;
                path::film_path(app);
            }
        }
    }
}
