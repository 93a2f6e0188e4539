//! The line at the bottom: what the picture's error is, and what went wrong.

use egui::{Color32, Panel, Ui};

use crate::app::App;

pub(crate) fn show(app: &App, ui: &mut Ui) {
    Panel::bottom("status").show(ui, |ui| {
        ui.horizontal(|ui| {
            if let Some(drawn) = &app.drawn {
                ui.label(said(app, drawn));
            }
            if let Some(message) = &app.message {
                ui.separator();
                let colour = match message.is_error {
                    true => Color32::from_rgb(240, 120, 110),
                    false => Color32::LIGHT_GRAY,
                };
                ui.colored_label(colour, &message.text);
            }
        });
    });
}

fn said(app: &App, drawn: &crate::worker::Drawn) -> String {
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
