//! Column densities: the line integral of the field along each pixel's ray.

use std::time::Instant;

use super::{Clock, FrameCounts, Pass, Renderer, Settings, StageTimes, frustum, view_uniform};
use crate::blocks::{BlockedVolume, cull_outside, distance_interval};
use crate::constants::{COLUMN_CUTOFF, DEFAULT_LOW_PASS_VARIANCE_PX2, DEFAULT_TOLERANCE};
use crate::cpu::{self, AmplitudeSummary, Bins, ColumnInput, ColumnSums, SimdLevel};
use crate::error::{Error, Result};
use crate::image::ColumnImage;
use crate::splat::Filter;
use crate::view::{Camera, Projection};

/// How a column density is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnSettings {
    /// The largest error of one kernel's footprint as a share of its peak, for
    /// [`Filter::Adaptive`] under perspective. Orthographic footprints have no such error.
    pub tolerance: f32,
    /// Which footprint draws a kernel.
    pub filter: Filter,
    /// Variance of the low-pass filter, px². Below about .5 pixels are too coarse to sample it, and
    /// with none at all a kernel that falls between pixel centres is missed: mass is then
    /// not conserved.
    pub low_pass_variance_px2: f32,
    /// Cut-off radius in standard deviations.
    pub cutoff: f32,
    /// The instruction set of the inner loop.
    pub simd: SimdLevel,
}

impl Default for ColumnSettings {
    fn default() -> Self {
        Self {
            tolerance: DEFAULT_TOLERANCE,
            filter: Filter::Adaptive,
            low_pass_variance_px2: DEFAULT_LOW_PASS_VARIANCE_PX2,
            cutoff: COLUMN_CUTOFF,
            simd: SimdLevel::best(),
        }
    }
}

impl ColumnSettings {
    /// What the stages that are shared with a picture read.
    fn shared(&self) -> Settings {
        Settings {
            tolerance: self.tolerance,
            filter: self.filter,
            low_pass_variance_px2: self.low_pass_variance_px2,
            cutoff: Some(self.cutoff),
            simd: self.simd,
            ..Settings::default()
        }
    }
}

/// What column densities keep between frames.
#[derive(Debug, Default)]
pub(super) struct ColumnMemory {
    amplitudes: Option<AmplitudeSummary>,
    bins: Bins,
    sums: ColumnSums,
    image: ColumnImage,
}

/// Under perspective the footprints' peaks are held below one by this factor, for kernels down to
/// a thousandth of the farthest one's distance: where a footprint's peak is below one, `choose_exact`
/// compares errors with the tolerance relative to it.
const PERSPECTIVE_HEADROOM: f64 = 1.0 / (1 << 20) as f64;

/// Masses in f32 leave this much room on either side for what multiplies them.
const MASS_RANGE: [f64; 2] = [1e-30, 1e30];

impl Renderer {
    /// Draws the column density: the sum over the particles of amplitude x (line integral of the
    /// unit-integral kernel along the pixel's ray), low-passed; \[field x length\].
    ///
    /// The amplitude is value x volume where the strength is classified, the mass otherwise; it
    /// may be negative. No transfer function is asked, nothing is sorted, nothing hides anything.
    /// Values that are not finite contribute nothing ([`Renderer::amplitudes`] counts them).
    ///
    /// In an orthographic view that holds everything the pixels times their area sum to the
    /// sum of the amplitudes within 1e-5, sub-pixel kernels included, for a low-pass variance of
    /// 1 px² or more (`tests/column_density.rs`). Kernels that cross the eye's plane count as far
    /// as they lie in front of it. [`Renderer::counts`] and [`Renderer::times`] hold
    /// this frame's figures then.
    ///
    /// # Errors
    /// As [`Renderer::render`]; a result beyond f32; splats that state a peak opacity.
    pub fn column_density(
        &mut self,
        camera: &Camera,
        settings: &ColumnSettings,
    ) -> Result<&ColumnImage> {
        let shared = settings.shared();
        super::check(camera, &shared)?;
        let states_opacity = |volume: &BlockedVolume| {
            use crate::scene::Strength::{Pane, PeakOpacity, Surface};
            matches!(volume.strength, PeakOpacity { .. } | Surface(_) | Pane(_))
        };
        if self.volumes.iter().any(states_opacity) {
            return Err(Error::format(
                "scene",
                "column density",
                "masses, or values with volumes",
                "splats or surfels that state an opacity",
                "render them without --column-density",
            ));
        }
        let amplitudes = self.amplitudes();
        let frame_start = Instant::now();
        let mut times = StageTimes::default();
        let mut counts = FrameCounts {
            blocks: self.volumes.iter().map(|v| v.blocks.len()).sum(),
            ..FrameCounts::default()
        };
        let mut clock = Clock(Instant::now());

        let frustum = frustum(camera, shared.low_pass_variance_px2);
        let cull_by = (settings.filter != Filter::UniformScaling).then_some(&frustum);
        let mut farthest = 0.0_f64;
        self.views.iter_mut().for_each(Vec::clear);
        for family in &self.families {
            let (volume, views) = (&self.volumes[family.start], &mut self.views[family.start]);
            cull_outside(volume, camera, cull_by, views);
            for view in views {
                view.filter_kind = settings.filter as u32;
                let block = &volume.blocks[view.block as usize];
                let (distance, radius) = distance_interval(camera, block);
                farthest = farthest.max(distance + radius);
            }
        }
        counts.blocks_culled = counts.blocks - self.views.iter().map(Vec::len).sum::<usize>();
        // Depths order nothing here.
        let uniform = view_uniform(camera, &shared, None, 0.0);
        times.cull = clock.lap();

        // Masses relative to the largest, such that footprints come out near one: f32 holds
        // neither 1e43 g nor the square of an image in parsecs.
        let pixels_per_area = camera.focal_px.element_product();
        let unit = match camera.projection {
            Projection::Orthographic => 1.0 / pixels_per_area,
            Projection::Perspective => {
                PERSPECTIVE_HEADROOM * farthest * (farthest / pixels_per_area)
            }
        };
        let unit = unit.clamp(MASS_RANGE[0], MASS_RANGE[1]);
        // A scene without any amplitude is drawn as nothing.
        let scale = match amplitudes.largest {
            0.0 => 0.0,
            largest => unit / largest,
        };
        let totals = self.fill_classified(
            |volume, views| cpu::count_amplitudes(volume, views, scale),
            |volume, views, out| cpu::fill_amplitudes(volume, views, scale, out),
        );
        counts.classified = self.classified.len();
        times.classify = clock.lap();

        self.project(
            Pass::Volumes { is_cut: false },
            camera,
            &shared,
            &uniform,
            &totals,
        );
        times.project = clock.lap();

        let memory = &mut self.column;
        cpu::list_visible(&self.footprints, &mut self.order);
        cpu::bin_columns(
            &uniform,
            &self.footprints,
            &self.exact,
            &self.order,
            &mut memory.bins,
        );
        counts.footprints = self.order.len();
        counts.tile_entries = memory.bins.len();
        times.bin = clock.lap();

        let near = self.project_output.near();
        counts.footprints_near = near.len();
        counts.splat_pixels = memory.sums.add_all(&ColumnInput {
            view: &uniform,
            footprints: &self.footprints,
            exact: &self.exact,
            near,
            bins: &memory.bins,
            level: settings.simd,
        });
        times.rasterise = clock.lap();

        let image = &mut memory.image;
        (image.width, image.height) = (camera.width, camera.height);
        image.values.resize(camera.width * camera.height, 0.0);
        image.pixel_area =
            (camera.projection == Projection::Orthographic).then_some(1.0 / pixels_per_area);
        let largest = memory
            .sums
            .write(&uniform, amplitudes.largest / unit, &mut image.values);
        times.resolve = clock.lap();
        times.frame = frame_start.elapsed().as_secs_f64() * 1e3;
        if !(largest <= f64::from(f32::MAX)) {
            return Err(Error::format(
                "column density",
                "pixel values",
                "at most 3.4e38, which is what the 32-bit numbers of an image hold",
                format!("{largest:e}"),
                "give the data in larger units",
            ));
        }
        counts.footprints_exact = self.count_exact();
        self.counts = counts;
        self.times = times;
        Ok(&self.column.image)
    }

    /// The last column density.
    pub fn column(&self) -> &ColumnImage {
        &self.column.image
    }

    /// The amplitudes of the scene, of which [`Renderer::column_density`] makes columns; found once.
    pub fn amplitudes(&mut self) -> AmplitudeSummary {
        *self.column.amplitudes.get_or_insert_with(|| {
            let data = self
                .families
                .iter()
                .map(|family| &self.volumes[family.start]);
            AmplitudeSummary::of(data)
        })
    }
}
