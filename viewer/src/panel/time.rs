//! Shows the steps of a series: a slider, and play.

use egui::{Context, Slider, Ui};

use super::numbers::short;
use super::row::{button, fact, row, section, slide};
use crate::app::App;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let count = app.time.steps.len();
    if count < 2 {
        return;
    }
    let tip = "The time steps of a series, all by one transfer function\n--series";
    section(ui, "Time", true, tip, |ui| {
        let mut step = app.time.step;
        row(
            ui,
            "Step",
            "The time step that is shown, from 0\n--series",
            |ui| slide(ui, Slider::new(&mut step, 0..=count - 1)),
        );
        if let Some(time) = app.time.steps[app.time.step] {
            fact(ui, "Time", short(time), "The time that the file states");
        }
        let label = if app.time.plays { "Pause" } else { "Play" };
        if button(
            ui,
            label,
            "Show the steps one after another, and over again",
        ) {
            app.time.plays = !app.time.plays;
        }
        if step != app.time.step {
            app.go(step);
        }
    });
}

/// Reads the next step once the current one has been shown.
pub(crate) fn play(app: &mut App, context: &Context) {
    if app.time.plays && app.progress.is_none() && app.has_drawn() {
        let next = (app.time.step + 1) % app.time.steps.len();
        app.go(next);
        context.request_repaint();
    }
}
