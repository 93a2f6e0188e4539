//! What a picture costs.

use egui::{CollapsingHeader, ProgressBar, Ui};

use crate::app::App;

pub(crate) fn show(app: &App, ui: &mut Ui) {
    CollapsingHeader::new("Cost")
        .default_open(true)
        .show(ui, |ui| {
            let Some(drawn) = &app.drawn else {
                ui.label("no picture");
                return;
            };
            let times = &drawn.times;
            let stages = [
                ("cull", times.cull),
                ("classify", times.classify),
                ("project", times.project),
                ("sort", times.sort),
                ("bin", times.bin),
                ("rasterise", times.rasterise),
                ("resolve", times.resolve),
            ];
            let whole = times.frame.max(1e-6);
            for (name, ms) in stages {
                #[expect(clippy::cast_possible_truncation, reason = "a share")]
                let share = (ms / whole) as f32;
                ui.add(ProgressBar::new(share).text(format!("{name} {ms:.1} ms")));
            }
            ui.label(format!("frame {:.1} ms", times.frame));
            let counts = &drawn.counts;
            ui.label(format!(
                "{} footprints, {:.1} M splat-pixels",
                counts.footprints,
                counts.splat_pixels as f64 / 1e6
            ));
            let drawn_blocks = counts.blocks - counts.blocks_culled;
            ui.label(format!("{drawn_blocks} of {} blocks", counts.blocks));
            if let Some(loaded) = &app.loaded {
                ui.label(format!("drawn by the {}", loaded.device));
                ui.label(format!("read in {:.2} s", loaded.seconds));
            }
        });
}
