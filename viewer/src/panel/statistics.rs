//! Shows the counts and times of the picture.

use egui::{ProgressBar, Ui};

use super::numbers::grouped;
use super::row::{fact, row, section};
use crate::app::App;

pub(crate) fn show(app: &App, ui: &mut Ui) {
    let tip = "What the last picture took\n--stats FILE";
    section(ui, "Statistics", false, tip, |ui| {
        let Some(drawn) = &app.drawn else {
            ui.label("no picture yet");
            return;
        };
        let times = &drawn.times;
        let stages = [
            (
                "Choose",
                times.choose,
                "Choosing the level of detail of lattices",
            ),
            (
                "Shadows",
                times.shadow,
                "Transmittance toward the lights, made again when they, the scene or the clip planes change",
            ),
            ("Cull", times.cull, "Leaving out blocks that are not seen"),
            (
                "Classify",
                times.classify,
                "Colours and opacities from values",
            ),
            (
                "Project",
                times.project,
                "Footprints of kernels on the picture",
            ),
            ("Sort", times.sort, "Ordering by depth"),
            ("Bin", times.bin, "Assigning footprints to tiles"),
            (
                "Rasterise",
                times.rasterise,
                "Compositing footprints into pixels",
            ),
            ("Resolve", times.resolve, "The picture from its tiles"),
        ];
        let whole = times.frame.max(1e-6);
        for (name, ms, tip) in stages {
            #[expect(clippy::cast_possible_truncation, reason = "a share")]
            let share = (ms / whole) as f32;
            row(ui, name, tip, |ui| {
                let bar = ProgressBar::new(share).text(format!("{ms:.1} ms"));
                ui.add(bar.desired_width(ui.available_width()))
            });
        }
        fact(
            ui,
            "Frame",
            format!("{:.1} ms", times.frame),
            "All stages together",
        );
        let counts = &drawn.counts;
        let tip = "Kernels that touch the picture";
        fact(ui, "Footprints", grouped(counts.footprints), tip);
        let text = format!("{:.1} million", counts.splat_pixels as f64 / 1e6);
        fact(
            ui,
            "Splat-pixels",
            text,
            "Pixels of all footprints together",
        );
        let drawn_blocks = counts.blocks - counts.blocks_culled;
        let text = format!("{drawn_blocks} of {}", counts.blocks);
        fact(
            ui,
            "Blocks",
            text,
            "Blocks of at most 256 particles that are seen",
        );
        if let Some(loaded) = &app.loaded {
            let tip = "What draws\n--backend auto|gpu|cpu";
            fact(ui, "Device", &loaded.device, tip);
            let text = format!("{:.2} s", loaded.seconds);
            fact(ui, "Read in", text, "Reading and preparing the data");
        }
    });
}
