//! The parts of the window, one file each.

pub(crate) mod camera;
pub(crate) mod clip;
pub(crate) mod handles;
pub(crate) mod inputs;
pub(crate) mod keys;
pub(crate) mod light;
pub(crate) mod method;
pub(crate) mod output;
pub(crate) mod over;
pub(crate) mod path;
pub(crate) mod picture;
pub(crate) mod probe;
pub(crate) mod statistics;
pub(crate) mod status;
pub(crate) mod time;
pub(crate) mod transfer;

use egui::{Panel, ScrollArea, Ui};

use crate::app::App;

/// What is drawn, and how.
pub(crate) fn left(app: &mut App, ui: &mut Ui) {
    Panel::left("left").default_size(230.0).show(ui, |ui| {
        ScrollArea::vertical().show(ui, |ui| {
            inputs::show(app, ui);
            time::show(app, ui);
            method::show(app, ui);
            clip::show(app, ui);
            over::show(app, ui);
            light::show(app, ui);
            camera::show(app, ui);
            path::show(app, ui);
            output::show(app, ui);
        });
    });
}

/// What it is coloured by, and what it costs.
pub(crate) fn right(app: &mut App, ui: &mut Ui) {
    Panel::right("right").default_size(310.0).show(ui, |ui| {
        ScrollArea::vertical().show(ui, |ui| {
            transfer::show(app, ui);
            probe::show(app, ui);
            statistics::show(app, ui);
        });
    });
}
