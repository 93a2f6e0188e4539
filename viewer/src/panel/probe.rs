//! What lies under a pixel.

use egui::{CollapsingHeader, Ui};

use crate::app::App;

pub(crate) fn show(app: &App, ui: &mut Ui) {
    CollapsingHeader::new("Probe")
        .default_open(true)
        .show(ui, |ui| {
            let Some(probe) = &app.probe else {
                ui.label("click in the picture");
                return;
            };
            let [x, y] = probe.pixel;
            ui.label(format!("pixel {x}, {y}"));
            let Some(found) = &probe.found else {
                ui.label("nothing");
                return;
            };
            let p = found.position;
            ui.label(format!("{:.6} {:.6} {:.6}", p.x, p.y, p.z));
            let volumes = app.loaded.as_ref().map(|loaded| &loaded.volumes);
            let title = volumes.and_then(|volumes| volumes.get(found.volume));
            let title = title.map_or("particle", |volume| &volume.title);
            let value = found.value.map(|value| format!(" {value}"));
            let value = value.unwrap_or_default();
            ui.label(format!("{title}{value}: particle {}", found.particle));
            ui.label(format!(
                "{:.1} % of the pixel, which shows {} particles",
                100.0 * found.share,
                found.count
            ));
        });
}
