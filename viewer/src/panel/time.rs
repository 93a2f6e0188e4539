//! The steps of a series: a slider, and play.

use egui::{CollapsingHeader, Context, Slider, Ui};

use crate::app::App;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let count = app.time.steps.len();
    if count < 2 {
        return;
    }
    CollapsingHeader::new("Time")
        .default_open(true)
        .show(ui, |ui| {
            let mut step = app.time.step;
            ui.add(Slider::new(&mut step, 0..=count - 1).text("step"));
            if let Some(time) = app.time.steps[app.time.step] {
                ui.label(format!("time {time}"));
            }
            let label = if app.time.plays { "Pause" } else { "Play" };
            if ui.button(label).clicked() {
                app.time.plays = !app.time.plays;
            }
            if step != app.time.step {
                app.go(step);
            }
        });
}

/// Reads the next step once this one has been seen.
pub(crate) fn play(app: &mut App, context: &Context) {
    if app.time.plays && app.progress.is_none() && app.has_drawn() {
        let next = (app.time.step + 1) % app.time.steps.len();
        app.go(next);
        context.request_repaint();
    }
}
