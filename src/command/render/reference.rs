//! Integrates and writes the reference image.

use std::time::Instant;

use super::ending::Facts;
use super::options::Arguments;
use super::tiles::Drawn;
use crate::Result;
use crate::command::annotations::Overlays;
use crate::command::outputs::warn_unconverged;
use crate::command::progress::with_bar;
use crate::command::statistics::{Prepared, write_stats};
use crate::command::truth::Truth;
use crate::reference::ReferenceSettings;
use crate::view::Camera;
use serde_json::json;

impl Arguments {
    /// Writes the reference image, and adds its stated error to the statistics.
    pub(in crate::command) fn integrate(
        &self,
        truth: Truth,
        camera: &Camera,
        low_pass: f32,
        overlays: &Overlays,
        prepared: Prepared,
    ) -> Result<()> {
        if let Some(comparison) = self.ending.comparison() {
            comparison.check_size([camera.width, camera.height])?;
        }
        let backdrop = self.backdrop.given.seen_by(camera)?;
        let colours = backdrop.as_ref().and_then(|backdrop| backdrop.colours());
        let truth = truth.ended(backdrop.as_ref().map(|backdrop| backdrop.depth()));
        let defaults = ReferenceSettings::default();
        let mut settings = ReferenceSettings {
            error: self.method.tolerance.map_or(defaults.error, f64::from),
            low_pass_variance_px2: low_pass.into(),
            // Colours of a backdrop stand in front of it.
            background: self.background().filter(|_| colours.is_none()),
            ..defaults
        };
        let start = Instant::now();
        let mut frame = with_bar("integrating", |task| {
            settings.task = Some(task);
            truth.render(camera, &settings)
        })?;
        let frame_ms = start.elapsed().as_secs_f64() * 1e3;
        if let Some(backdrop) = &backdrop {
            backdrop.lay_under(&mut frame.image, self.background());
        }
        let facts = Facts::of_reference(settings.error, frame.error);
        self.end(&Drawn::Picture(&*overlays.drawn(&frame.image)?), &facts)?;
        if let Some(path) = self.beside(self.output.stats.as_ref()) {
            let stats = json!({
                "particles": truth.particle_count(),
                "cells_left_out": truth.cells_left_out(),
                "backend": "reference",
                "adapter": format!("{} threads, f64", rayon::current_num_threads()),
                "error_wanted": settings.error,
                "error_estimate": frame.error,
                "pixels_above_error_wanted": frame.unconverged,
                "rays": frame.rays,
                "times_ms": {
                    "read": prepared.read_ms,
                    "prepare": prepared.prepare_ms,
                    "frame": frame_ms,
                },
                "time_to_picture_ms": prepared.begun.elapsed().as_secs_f64() * 1e3,
                "frames": 1,
            });
            write_stats(path, &stats)?;
        }
        warn_unconverged(&frame, settings.error);
        Ok(())
    }
}
