//! Shows the bottom line: the picture's accuracy, the last action, and errors.

use egui::{Align, Color32, Label, Layout, Panel, Ui};

use super::row::button;
use crate::app::App;

/// Width from which the line shows a hint, points.
const ROOMY: f32 = 950.0;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    Panel::bottom("status").show(ui, |ui| {
        ui.horizontal(|ui| {
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let tip = "What keys and the mouse do (?)";
                if button(ui, "?", tip) {
                    app.shows_help = !app.shows_help;
                }
                if ui.available_width() > ROOMY {
                    ui.weak("drag: turn, wheel: zoom, click: read a value");
                }
                ui.with_layout(Layout::left_to_right(Align::Center), |ui| said(app, ui));
            });
        });
    });
}

fn said(app: &App, ui: &mut Ui) {
    if let Some(message) = &app.message {
        let colour = match message.is_error {
            true => Color32::from_rgb(240, 120, 110),
            false => Color32::LIGHT_GRAY,
        };
        let text = egui::RichText::new(&message.text).color(colour);
        ui.add(Label::new(text).truncate())
            .on_hover_text(&message.text);
        ui.separator();
    }
    if let Some(drawn) = &app.drawn {
        let tip = "Size of the picture in pixels; the tolerance in force, an error in linear colour; the error that was \
                   measured: what 99.9 % of the pixels stay below, and the worst\n--size, --tolerance, --measure-error";
        ui.add(Label::new(exactness(app, drawn)).truncate())
            .on_hover_text(tip);
    }
}

fn exactness(app: &App, drawn: &crate::worker::Drawn) -> String {
    let [width, height] = drawn.coarseness.size(app.size);
    let tolerance = drawn.coarseness.tolerance;
    let mut text = format!("{width} x {height}, tolerance {tolerance:.1e}");
    let slack = drawn.coarseness.merge_slack;
    if slack > 1.0 {
        text += &format!(" ({:.1e} for what is merged)", tolerance * slack);
    }
    if let Some(error) = &drawn.error {
        text += &format!(
            ", measured error {:.1e} (worst {:.1e})",
            error.percentile_999, error.greatest
        );
    }
    if !drawn.is_final {
        text += ", refining";
    }
    text
}
