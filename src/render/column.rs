//! Draws column densities: the line integral of the field along each pixel's ray.

use super::renderer::Renderer;
use crate::blocks::{AmplitudeSummary, BlockedParticles, BlockedVolume};
use crate::cpu::{Plane, slice};
use crate::error::{Error, Hint, Result};
use crate::frame::backend::FrameReport;
use crate::frame::check::check;
use crate::frame::plan::FramePlan;
use crate::frame::settings::ColumnSettings;
use crate::image::ColumnImage;
use crate::math::narrowed;
use crate::stats::Stopwatch;
use crate::view::{Camera, Projection};
use glam::DVec3;

impl Renderer {
    /// Draws the column density: the sum over the particles of amplitude x (line integral of the
    /// unit-integral kernel along the pixel's ray), low-passed; \[field x length\].
    ///
    /// The amplitude is value x volume if the strength is classified, and the mass otherwise; it may be
    /// negative. Transfer functions, depth order and occlusion play no part. Values that are not finite
    /// contribute nothing ([`Renderer::amplitudes`] counts them).
    ///
    /// In an orthographic view that contains the whole scene, the sum of the pixels times their area
    /// equals the sum of the amplitudes within 1e-5. This includes sub-pixel kernels and requires a
    /// low-pass variance of 1 px² or more (`tests/frames/column_density.rs`).
    ///
    /// A kernel that crosses the plane of the eye or a clip plane contributes only the part in front of
    /// it, or inside it. The part is computed per ray: the integral of the kernel (without its low-pass
    /// filter) up to the plane.
    ///
    /// With [`ColumnSettings::slice`] the pixels hold the field on a plane instead of its integral.
    ///
    /// After this call [`Renderer::counts`] and [`Renderer::times`] describe this frame.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; a result beyond f32; splats that state a peak opacity; a slice across a
    /// perspective view, of kernels without a thickness or on ranks.
    pub fn column_density(
        &mut self,
        camera: &Camera,
        settings: &ColumnSettings,
    ) -> Result<&ColumnImage> {
        let plan = self.column_plan(camera, settings)?;
        let report = match settings.slice {
            Some(through) => self.draw_slice(&plan, settings, through)?,
            None => self.draw(&plan)?,
        };
        self.column_drawn(report)
    }

    /// Sums the kernels on a plane.
    fn draw_slice(
        &mut self,
        plan: &FramePlan,
        settings: &ColumnSettings,
        through: DVec3,
    ) -> Result<FrameReport> {
        let fault = |place: &str, expected: &str, found: String, advice: &str| {
            Err(Error::invalid("slice", place, expected, found, advice))
        };
        if plan.camera.projection != Projection::Orthographic {
            let found = "one with perspective".into();
            return fault("camera", "an orthographic one", found, "look along an axis");
        }
        if !through.is_finite() {
            let found = through.to_string();
            return fault("point", "finite coordinates", found, "correct it");
        }
        if self.rank().is_some() {
            let found = "several".into();
            return fault("processes", "one", found, "draw it without ranks");
        }
        let plane = Plane {
            camera: &plan.camera,
            through,
            smoothing: settings.smoothing,
            cutoff: f64::from(settings.cutoff),
            clip: &settings.clip,
            task: settings.task.as_ref(),
        };
        let mut whole = Stopwatch::start();
        let sums = slice(&self.scene, &plane)?;
        if sums.flat > 0 {
            let found = format!("{} without", sums.flat);
            let advice = "shift the plane, or draw columns";
            return fault("kernels at the plane", "a thickness", found, advice);
        }
        let images = plan.target(&mut self.images, &mut self.samples);
        images.resize_column(plan);
        images.largest = sums
            .values
            .iter()
            .fold(0.0, |most, value| value.abs().max(most));
        for (pixel, value) in images.column.values.iter_mut().zip(&sums.values) {
            *pixel = narrowed(*value);
        }
        let mut report = FrameReport::default();
        report.counts.blocks = self.scene.block_count();
        (report.counts.classified, report.counts.footprints) = (sums.cut, sums.cut);
        report.counts.narrow = sums.narrow;
        report.times.frame = whole.lap();
        Ok(report)
    }

    /// Checks the settings and returns the plan of a column density.
    pub(super) fn column_plan(
        &mut self,
        camera: &Camera,
        settings: &ColumnSettings,
    ) -> Result<FramePlan> {
        check(camera, &settings.shared())?;
        let states_opacity = |volume: &BlockedVolume| {
            use crate::scene::StrengthIn::{PeakOpacity, Surface, Translucent};
            matches!(
                volume.strength,
                PeakOpacity { .. } | Surface(_) | Translucent(_)
            )
        };
        if self.scene.volumes().iter().any(states_opacity) {
            return Err(Error::invalid(
                "scene",
                "column density",
                "masses, or values with volumes",
                "splats or surfels that state an opacity",
                Hint::DrawPicture,
            ));
        }
        let is_round =
            |volume: &BlockedVolume| matches!(volume.particles, BlockedParticles::Isotropic { .. });
        if settings.smoothing.is_some() && !self.scene.data().all(is_round) {
            return Err(Error::invalid(
                "scene",
                "smoothing kernel of columns",
                "round particles",
                "particles of other shapes",
                "leave the kernel out",
            ));
        }
        let largest = self.amplitudes().largest;
        let scene = &self.scene;
        Ok(FramePlan::of_columns(scene, camera, settings, largest))
    }

    /// Stores the report of a column density's frame.
    pub(super) fn column_drawn(&mut self, report: FrameReport) -> Result<&ColumnImage> {
        let largest = self.images.largest;
        if !(largest <= f64::from(f32::MAX)) {
            return Err(Error::invalid(
                "column density",
                "pixel values",
                "at most 3.4e38, which is what the 32-bit numbers of an image hold",
                format!("{largest:e}"),
                "give the data in larger units",
            ));
        }
        self.report = report;
        Ok(&self.images.column)
    }

    /// Returns the last column density.
    pub fn column(&self) -> &ColumnImage {
        &self.images.column
    }

    /// Returns a summary of the amplitudes that [`Renderer::column_density`] sums. It is computed once.
    pub fn amplitudes(&mut self) -> AmplitudeSummary {
        *self
            .amplitudes
            .get_or_insert_with(|| AmplitudeSummary::joined(self.scene.amplitudes_of_volumes()))
    }
}
