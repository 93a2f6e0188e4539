//! The steps of a series: a slider, and play.

use egui::{CollapsingHeader, Context, Slider, Ui};

use crate::app::App;

/// Which step of a series is shown.
#[derive(Debug, Clone, Default)]
pub(crate) struct Time {
    /// The time of each step, where a file states it; empty without a series.
    steps: Vec<Option<f64>>,
    pub(crate) step: usize,
    plays: bool,
    /// Whether the step that is read is another of the same series.
    is_next: bool,
}

impl Time {
    /// How many steps there are; 0 without a series.
    pub(crate) fn count(&self) -> usize {
        self.steps.len()
    }

    /// Whether the functions of so many volumes hold for the step that was read.
    pub(crate) fn keeps(&mut self, before: usize, now: usize) -> bool {
        std::mem::take(&mut self.is_next) && before == now
    }
}

/// Takes the steps of what was asked for.
pub(crate) fn begin(app: &mut App) {
    // What cannot be read says so where it is read.
    app.time = Time {
        steps: app.asked.steps().unwrap_or_default(),
        ..Time::default()
    };
}

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
                go(app, step);
            }
        });
}

pub(crate) fn go(app: &mut App, step: usize) {
    app.time.step = step;
    app.time.is_next = true;
    app.load();
}

/// Reads the next step once this one has been seen.
pub(crate) fn play(app: &mut App, context: &Context) {
    if app.time.plays && app.progress.is_none() && app.has_drawn() {
        let next = (app.time.step + 1) % app.time.steps.len();
        go(app, next);
        context.request_repaint();
    }
}
