//! Defines the parts of the window, one file each.

pub(crate) mod camera;
pub(crate) mod clip;
pub(crate) mod handles;
pub(crate) mod help;
pub(crate) mod inputs;
pub(crate) mod keys;
pub(crate) mod light;
pub(crate) mod method;
pub(crate) mod numbers;
pub(crate) mod output;
pub(crate) mod over;
pub(crate) mod path;
pub(crate) mod picture;
pub(crate) mod probe;
pub(crate) mod row;
pub(crate) mod statistics;
pub(crate) mod status;
pub(crate) mod time;
pub(crate) mod transfer;

use egui::{Panel, ScrollArea, Ui, UiBuilder};

use crate::app::App;

/// Returns the width of a panel, points: a share of a small window, so that the picture keeps half
/// of it.
fn width(ui: &Ui, share: f32, most: f32) -> f32 {
    (share * ui.ctx().content_rect().width()).clamp(0.65 * most, most)
}

/// Adds the contents of a panel. The user sets the width of the panel, whatever its contents.
fn body(ui: &mut Ui, add: impl FnOnce(&mut Ui)) {
    let rect = ui.available_rect_before_wrap();
    let mut inside = ui.new_child(UiBuilder::new().id_salt("body").max_rect(rect));
    inside.shrink_clip_rect(rect);
    let area = ScrollArea::vertical().auto_shrink(false);
    area.show(&mut inside, add);
    ui.advance_cursor_after_rect(rect);
}

/// Shows the left panel: the inputs, and the settings of the picture.
pub(crate) fn left(app: &mut App, ui: &mut Ui) {
    let width = width(ui, 0.21, 260.0);
    let panel = Panel::left("left").default_size(width);
    panel.min_size(150.0).show(ui, |ui| {
        body(ui, |ui| {
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

/// Shows the right panel: the transfer function, the probe and the statistics.
pub(crate) fn right(app: &mut App, ui: &mut Ui) {
    let width = width(ui, 0.235, 300.0);
    let panel = Panel::right("right").default_size(width);
    panel.min_size(150.0).show(ui, |ui| {
        body(ui, |ui| {
            transfer::show(app, ui);
            probe::show(app, ui);
            statistics::show(app, ui);
        });
    });
}
