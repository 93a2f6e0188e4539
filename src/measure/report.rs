//! Defines the results of a sweep as plain data, and writes them to files.

use serde::Serialize;

use super::variants::simd_name;
use crate::cpu::SimdLevel;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::measure::errors::ImageErrors;
use crate::render::{Settings, StageTimes};
use crate::view::{Camera, Projection};

/// A sweep's results. Times are milliseconds, errors linear colour of full scale 1.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Scene and command of the sweep.
    pub about: About,
    /// The machine.
    pub machine: Machine,
    /// The camera.
    pub camera: CameraSummary,
    /// Number of particles in the scene.
    pub particles: usize,
    /// Number of timed frames, after one that warms up; times are their medians.
    pub frames: usize,
    /// One row per variant.
    pub rows: Vec<Row>,
    /// Error and time of each approximation.
    pub budget: Budget,
    /// Reference image, for pages.
    #[serde(skip)]
    pub reference_image: Image,
    /// Image of the data's own field, for pages.
    #[serde(skip)]
    pub reference_data_image: Option<Image>,
    /// Renderings of some variants, for pages.
    #[serde(skip)]
    pub pictures: Vec<Picture>,
}

/// Facts that the caller knows and the sweep does not.
#[derive(Debug, Clone, Serialize, Default)]
pub struct About {
    /// Names of the data.
    pub inputs: Vec<String>,
    /// Command line of the measurement.
    pub command: String,
    /// Origin of the reference image.
    pub reference: ReferenceSummary,
    /// Origin of the image of the data's own field, if there is one.
    pub reference_data: Option<ReferenceSummary>,
}

/// Provenance of a reference image.
#[derive(Debug, Clone, Serialize, Default)]
pub struct ReferenceSummary {
    /// Origin: `integrated`, or a file's name.
    pub origin: String,
    /// Stated greatest error of a pixel, linear colour; `None` if unknown.
    pub error: Option<f64>,
    /// Number of pixels whose estimated error stayed above the target.
    pub unconverged: Option<usize>,
    /// Number of rays integrated.
    pub rays: Option<u64>,
    /// Time of the integration in seconds.
    pub seconds: Option<f64>,
}

/// The machine of the measurement.
#[derive(Debug, Clone, Serialize)]
pub struct Machine {
    /// Name of the processor, if the system reports it.
    pub cpu: Option<String>,
    /// Number of threads that draw.
    pub threads: usize,
    /// The best instruction set of the rasteriser.
    pub simd: &'static str,
    /// Operating system and architecture.
    pub system: String,
    /// This library's version.
    pub version: &'static str,
    /// True for a build without optimisation, whose times mean nothing.
    pub debug_build: bool,
}

impl Machine {
    /// Describes this machine.
    pub fn here() -> Self {
        let cpu = std::fs::read_to_string("/proc/cpuinfo")
            .ok()
            .and_then(|text| {
                let line = text.lines().find(|l| l.starts_with("model name"))?;
                Some(line.split_once(':')?.1.trim().to_owned())
            });
        Self {
            cpu,
            threads: rayon::current_num_threads(),
            simd: simd_name(SimdLevel::best()),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            version: env!("CARGO_PKG_VERSION"),
            debug_build: cfg!(debug_assertions),
        }
    }
}

/// Numbers of a camera.
#[derive(Debug, Clone, Serialize)]
pub struct CameraSummary {
    /// `perspective` or `orthographic`.
    pub projection: &'static str,
    /// The eye, world units.
    pub eye: [f64; 3],
    /// The direction of view, unit length.
    pub forward: [f64; 3],
    /// Focal lengths: pixels per unit of slope, or per world unit.
    pub focal_px: [f64; 2],
    /// Width and height in pixels.
    pub size: [usize; 2],
}

impl From<&Camera> for CameraSummary {
    fn from(camera: &Camera) -> Self {
        Self {
            projection: match camera.projection {
                Projection::Perspective => "perspective",
                Projection::Orthographic => "orthographic",
            },
            eye: camera.eye.into(),
            forward: camera.camera_from_world.row(2).into(),
            focal_px: camera.focal_px.into(),
            size: [camera.width, camera.height],
        }
    }
}

/// Measurement of one variant.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// As [`super::Variant::id`].
    pub id: String,
    /// As [`super::Variant::label`].
    pub label: String,
    /// As [`super::Variant::mark`].
    pub mark: String,
    /// As [`super::Variant::group`].
    pub group: &'static str,
    /// Settings of the rendering.
    pub settings: SettingsSummary,
    /// As [`super::Variant::kernel_width`].
    pub kernel_width: Option<f64>,
    /// As [`super::Variant::changes_signal`]: such a row is not on the front.
    pub changes_signal: bool,
    /// As [`super::Variant::changes_pixels`]: such a row is not on the data's front.
    pub changes_pixels: bool,
    /// Times and counts of a frame.
    pub cost: Cost,
    /// Difference from the reference.
    pub errors: ImageErrors,
    /// Difference from the picture of the data's own field, if there is one.
    pub from_data: Option<ImageErrors>,
    /// Difference from the budget's baseline, the most accurate splatting.
    pub from_baseline: ImageErrors,
    /// True if no other variant of the same signal is both faster and closer (time and RMSE).
    pub on_front: bool,
    /// True if no other variant is both faster and closer to the data, whatever its kernels.
    pub on_data_front: bool,
}

/// Settings under the names of their options.
#[derive(Debug, Clone, Serialize)]
#[allow(missing_docs, reason = "each is the setting of its name")]
pub struct SettingsSummary {
    pub tolerance: f32,
    pub filter: &'static str,
    pub thresholds: Option<[f32; 2]>,
    pub level_of_detail: bool,
    pub cutoff: Option<f32>,
    pub opacity: &'static str,
    pub low_pass_variance_px2: f32,
    pub simd: &'static str,
}

impl From<&Settings> for SettingsSummary {
    fn from(settings: &Settings) -> Self {
        Self {
            tolerance: settings.tolerance,
            filter: settings.filter.name(),
            thresholds: settings.advanced.thresholds,
            level_of_detail: settings.level_of_detail,
            cutoff: settings.cutoff,
            opacity: if settings.advanced.linear_opacity {
                "linear"
            } else {
                "exponential"
            },
            low_pass_variance_px2: settings.low_pass_variance_px2,
            simd: simd_name(settings.advanced.simd),
        }
    }
}

/// Times and counts of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Median times, milliseconds.
    pub times_ms: StageTimes,
    /// Number of kernel evaluations at pixel centres.
    pub splat_pixels: u64,
    /// Number of footprints drawn.
    pub footprints: usize,
    /// Number of affine footprints.
    pub footprints_affine: usize,
    /// Number of exact footprints.
    pub footprints_exact: usize,
    /// Number of footprints whose kernels cross the camera plane.
    pub footprints_near: usize,
    /// Bytes of the scene per particle.
    pub bytes_per_particle: f64,
    /// Splat-pixels per second of rasterising and per thread; `None` if no time was measured.
    pub splat_pixels_per_core_second: Option<f64>,
}

/// Error and saving of time for each approximation alone.
#[derive(Debug, Clone, Serialize)]
pub struct Budget {
    /// Id of the row to which approximations are added one by one.
    pub baseline: String,
    /// Frame time of the baseline, milliseconds.
    pub baseline_frame_ms: f64,
    /// Difference of the baseline from the reference: the error that no setting of splatting removes.
    pub baseline_errors: ImageErrors,
    /// The approximations.
    pub rows: Vec<BudgetRow>,
}

/// An approximation.
#[derive(Debug, Clone, Serialize)]
pub struct BudgetRow {
    /// A name that stays the same between versions.
    pub id: String,
    /// Name of the approximation, for people.
    pub label: String,
    /// Error that this alone adds: the difference between the images with and without it.
    pub alone: ImageErrors,
    /// The images that `alone` compares, in words.
    pub compares: String,
    /// Difference from the reference; `None` for rows about the reference itself.
    pub against_reference: Option<ImageErrors>,
    /// Time saved against the baseline; `None` if nothing is drawn.
    pub saving: Option<Saving>,
}

/// Time saved by an approximation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Saving {
    /// Frame time, milliseconds.
    pub frame_ms: f64,
    /// Milliseconds less than the baseline; negative if slower.
    pub saved_ms: f64,
    /// The same as a share of the baseline's frame time; 0 if that is 0.
    pub saved_share: f64,
}

impl Saving {
    /// Compares a frame time with the baseline's.
    pub fn new(frame_ms: f64, baseline_ms: f64) -> Self {
        let saved_ms = baseline_ms - frame_ms;
        Self {
            frame_ms,
            saved_ms,
            saved_share: if baseline_ms > 0.0 {
                saved_ms / baseline_ms
            } else {
                0.0
            },
        }
    }
}

/// Rendering of a variant.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Id of the variant's row.
    pub id: String,
    /// The rendering.
    pub image: Image,
}

impl Report {
    /// Returns the row with an id.
    pub fn row(&self, id: &str) -> Option<&Row> {
        self.rows.iter().find(|row| row.id == id)
    }

    /// Returns all figures as JSON.
    ///
    /// # Errors
    /// Errors of the JSON writer; none is known to occur.
    pub fn json(&self) -> Result<Vec<u8>> {
        let mut bytes =
            serde_json::to_vec_pretty(self).map_err(|e| not_written("report.json", &e))?;
        bytes.push(b'\n');
        Ok(bytes)
    }

    /// Returns the variants as CSV: one row each, flat columns, empty where there is no figure.
    ///
    /// # Errors
    /// Errors of the CSV writer; none is known to occur.
    pub fn csv(&self) -> Result<Vec<u8>> {
        let failed = |e: &dyn std::fmt::Display| not_written("report.csv", e);
        let mut writer = csv::Writer::from_writer(Vec::new());
        for (i, row) in self.rows.iter().enumerate() {
            let cells = row.cells();
            if i == 0 {
                let names = cells.iter().map(|(name, _)| *name);
                writer.write_record(names).map_err(|e| failed(&e))?;
            }
            let values = cells.iter().map(|(_, value)| value);
            writer.write_record(values).map_err(|e| failed(&e))?;
        }
        writer.into_inner().map_err(|e| failed(&e))
    }
}

impl Row {
    /// Returns the difference from the data that counts for the data's front.
    pub(super) fn data_rmse(&self) -> Option<f64> {
        let errors = self.from_data.filter(|_| !self.changes_pixels);
        errors.map(|errors| errors.rmse)
    }

    /// Returns names and values of the flat columns.
    fn cells(&self) -> Vec<(&'static str, String)> {
        fn or_empty<T: ToString>(value: Option<T>) -> String {
            value.map_or_else(String::new, |v| v.to_string())
        }
        let (s, c, t, e) = (
            &self.settings,
            &self.cost,
            &self.cost.times_ms,
            &self.errors,
        );
        vec![
            ("id", self.id.clone()),
            ("group", self.group.into()),
            ("label", self.label.clone()),
            ("tolerance", s.tolerance.to_string()),
            ("filter", s.filter.into()),
            ("c_min", or_empty(s.thresholds.map(|c| c[0]))),
            ("c_max", or_empty(s.thresholds.map(|c| c[1]))),
            ("level_of_detail", s.level_of_detail.to_string()),
            ("cutoff", or_empty(s.cutoff)),
            ("opacity", s.opacity.into()),
            ("low_pass_variance_px2", s.low_pass_variance_px2.to_string()),
            ("simd", s.simd.into()),
            ("kernel_width", or_empty(self.kernel_width)),
            ("changes_signal", self.changes_signal.to_string()),
            ("on_front", self.on_front.to_string()),
            ("on_data_front", self.on_data_front.to_string()),
            ("rmse", e.rmse.to_string()),
            ("max", e.max.to_string()),
            ("p999", e.p999.to_string()),
            ("psnr", or_empty(e.psnr)),
            ("mean_difference", e.mean_difference.to_string()),
            ("ssim", or_empty(e.ssim)),
            ("flip", or_empty(e.flip)),
            ("data_rmse", or_empty(self.from_data.map(|e| e.rmse))),
            ("data_max", or_empty(self.from_data.map(|e| e.max))),
            ("data_p999", or_empty(self.from_data.map(|e| e.p999))),
            ("baseline_rmse", self.from_baseline.rmse.to_string()),
            ("baseline_max", self.from_baseline.max.to_string()),
            ("baseline_p999", self.from_baseline.p999.to_string()),
            ("cull_ms", t.cull.to_string()),
            ("classify_ms", t.classify.to_string()),
            ("project_ms", t.project.to_string()),
            ("sort_ms", t.sort.to_string()),
            ("bin_ms", t.bin.to_string()),
            ("rasterise_ms", t.rasterise.to_string()),
            ("resolve_ms", t.resolve.to_string()),
            ("frame_ms", t.frame.to_string()),
            ("splat_pixels", c.splat_pixels.to_string()),
            ("footprints", c.footprints.to_string()),
            ("footprints_affine", c.footprints_affine.to_string()),
            ("footprints_exact", c.footprints_exact.to_string()),
            ("footprints_near", c.footprints_near.to_string()),
            ("bytes_per_particle", c.bytes_per_particle.to_string()),
            (
                "splat_pixels_per_core_second",
                or_empty(c.splat_pixels_per_core_second),
            ),
        ]
    }
}

fn not_written(name: &str, error: &dyn std::fmt::Display) -> Error {
    Error::format(
        name,
        "writing",
        "figures that can be written",
        error.to_string(),
        "report it with the data",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn savings_are_against_the_baseline() {
        let saving = Saving::new(30.0, 40.0);
        assert_eq!((saving.saved_ms, saving.saved_share), (10.0, 0.25));
        let slower = Saving::new(50.0, 40.0);
        assert_eq!((slower.saved_ms, slower.saved_share), (-10.0, -0.25));
        assert_eq!(Saving::new(0.0, 0.0).saved_share, 0.0);
    }
}
