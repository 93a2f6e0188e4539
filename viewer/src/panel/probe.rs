//! Shows what lies under the probed pixel.

use egui::Ui;

use super::numbers::{grouped, short};
use super::row::{fact, section};
use crate::app::App;

pub(crate) fn show(app: &App, ui: &mut Ui) {
    let tip = "The value and the place of what lies under a click in the picture";
    section(ui, "Probe", true, tip, |ui| {
        let Some(probe) = &app.probe else {
            ui.label("Click in the picture to read a value");
            return;
        };
        let Some(found) = &probe.found else {
            ui.label("Nothing is there");
            return;
        };
        let volumes = app.loaded.as_ref().map(|loaded| &loaded.volumes);
        let title = volumes.and_then(|volumes| volumes.get(found.volume));
        let title = title.map_or("Value", |volume| &volume.title);
        let value = found.value.map(|value| short(value.into()));
        let tip = "The field and its value at the particle that the pixel shows most of";
        fact(ui, title, value.unwrap_or_else(|| "none".into()), tip);
        let tip = "Where half of that particle's light is gone, in the data's units of length";
        for (name, coordinate) in ["x", "y", "z"].into_iter().zip(found.position.to_array()) {
            fact(ui, name, short(coordinate), tip);
        }
        let tip = "The number of that particle, from 0";
        fact(ui, "Particle", grouped(found.particle), tip);
        let share = format!("{:.1} % of the pixel", 100.0 * found.share);
        fact(ui, "Share", share, "How much of the pixel that particle is");
        let tip = "How many particles the pixel shows";
        fact(
            ui,
            "Along the ray",
            format!("{} particles", grouped(found.count)),
            tip,
        );
        let [x, y] = probe.pixel;
        let tip = "Column and row of the picture, from its upper left corner";
        fact(ui, "Pixel", format!("{x}, {y}"), tip);
    });
}
