//! How a frame is drawn, as the caller says it.

use crate::constants::{COLUMN_CUTOFF, DEFAULT_LOW_PASS_VARIANCE_PX2, DEFAULT_TOLERANCE};
use crate::scene::{Classification, Lighting};
use crate::simd::SimdLevel;
use crate::splat::{Filter, PIXEL_VARIANCE_PX2, is_of_pixels};
use crate::task::Task;
use crate::view::ClipPlane;

/// How a frame is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The error in linear colour, as a fraction of full scale, that all approximations together
    /// may add to 99.9 % of pixels; [`splat::budget`](crate::splat::budget) says how it is shared
    /// out among them.
    pub tolerance: f32,
    /// Which footprint draws a kernel. Splats that state their opacity are always drawn by the
    /// rule of their format, [`peak_footprint`](crate::splat::peak_footprint).
    pub filter: Filter,
    /// c_min and c_max of eq. 7 of Chen et al. 2004, by hand: under [`Filter::Adaptive`] blocks
    /// nearer than c_min r_k/r_h are drawn by the reconstruction kernel alone, those beyond
    /// c_max (1 + 2 tan²(fov/2)) r_k/r_h by the low-pass filter alone, others by the resampling
    /// filter; none exactly, none merged. `None` follows the tolerance. The paper's: .3 and 2.
    pub thresholds: Option<[f32; 2]>,
    /// Whether particles far below a pixel are drawn merged, under [`Filter::Adaptive`].
    pub level_of_detail: bool,
    /// How many times its share of the tolerance merging may err: 1 keeps the tolerance. More is for pictures of
    /// motion, whose time goes by kernels once pixels are few; an error of many tolerances is a blur of details.
    pub merge_slack: f32,
    /// What the picture shows.
    pub show: Show,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau): off by at most tau²/2 for one kernel, by at
    /// most a share 1/e of the greatest tau for many behind one another.
    pub linear_opacity: bool,
    /// How kernels that lie behind one another become a picture.
    pub composite: Composite,
    /// Over what part of a kernel the transfer function is asked.
    pub classify: Classification,
    /// Planes that keep one side of everything that is drawn; eight at most.
    pub clip: Vec<ClipPlane>,
    /// Variance of the low-pass filter, px²; splats that state their opacity have their own.
    pub low_pass_variance_px2: f32,
    /// Cut-off radius in standard deviations; `None` follows the tolerance.
    pub cutoff: Option<f32>,
    /// The space in which colours are composited.
    pub blend: Blend,
    /// Linear RGB behind everything; `None` leaves the image transparent.
    pub background: Option<[f32; 3]>,
    /// Whether a depth image is wanted.
    pub depth: bool,
    /// Whether the normals of opaque surfels are wanted.
    pub normals: bool,
    /// The instruction set of the rasteriser.
    pub simd: SimdLevel,
    /// Light on surfels and on volumes that have normals; `None` shows colours as they are.
    pub lighting: Option<Lighting>,
    /// Whether kernels smaller than a pixel are as opaque as each would be alone. The filter
    /// spreads optical depths; a kernel that fills a tenth of a pixel and has a depth of 10 hides a
    /// fifth of it and is drawn as hiding more than half
    /// ([`sub_pixel_depth`](crate::splat::sub_pixel_depth)).
    ///
    /// For sparse sets of opaque particles, such as stars or droplets: the error of a hundred of
    /// depth 30 falls from .35 to .014 of full scale (root mean square, sigma .3 px). Where kernels
    /// fill pixels together it makes them too faint, as if light passed between them: one layer of a
    /// lattice with two samples to the pixel loses .04 of opacity at depth 4, eight layers .004, where
    /// depths are right to 1e-5 (`tests/frames/sub_pixel.rs`). Merged particles know of their members'
    /// opacity and stay as they are; so do kernels that reach the eye.
    pub sub_pixel_opacity: bool,
    /// Is told how far the frame is, and may cancel it.
    pub task: Option<Task>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tolerance: DEFAULT_TOLERANCE,
            filter: Filter::Adaptive,
            thresholds: None,
            level_of_detail: true,
            merge_slack: 1.0,
            show: Show::Scene,
            linear_opacity: false,
            composite: Composite::Over,
            classify: Classification::Extent,
            clip: Vec::new(),
            low_pass_variance_px2: DEFAULT_LOW_PASS_VARIANCE_PX2,
            cutoff: None,
            blend: Blend::Auto,
            background: None,
            depth: false,
            normals: false,
            simd: SimdLevel::best(),
            lighting: None,
            sub_pixel_opacity: false,
            task: None,
        }
    }
}

impl Settings {
    /// Whether frames draw merged particles where they fit: a scene that is drawn in no other way needs its levels of
    /// detail ([`SceneOptions::level_of_detail`](crate::SceneOptions::level_of_detail)).
    pub fn draws_merged(&self) -> bool {
        // Slabs cut kernels that stand for many as if these were one.
        self.level_of_detail
            && self.filter == Filter::Adaptive
            && self.thresholds.is_none()
            && !self.composite.accumulate().cuts_slabs()
    }

    /// What lies behind what is shown. Numbers of kernels have black there: it adds nothing to them
    /// and makes them opaque.
    pub(crate) fn shown_background(&self) -> Option<[f32; 3]> {
        match self.show {
            Show::Count => Some([0.0; 3]),
            Show::Scene | Show::Choice => self.background,
        }
    }
}

/// What a picture shows: the scene, or how it is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Show {
    /// The scene.
    #[default]
    Scene = 0,
    /// Each splat in the colour of its path or of its level of detail.
    Choice = 1,
    /// \[n, n, n, 1\] with the number n of kernels that a pixel evaluated within their cut-off; no
    /// background. The sum over the picture is [`FrameCounts::splat_pixels`](crate::render::FrameCounts::splat_pixels), as long as no pixel
    /// has more than 2²⁴.
    Count = 2,
}

/// The space in which colours are composited. Pictures are linear in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Blend {
    /// Encoded where a scene holds splats of radiance fields alone, and all state sRGB codes: what their training
    /// composited, and what viewers show. Linear elsewhere.
    #[default]
    Auto,
    /// In sRGB codes, which are decoded afterwards: splats, surfaces and volumes alike, and the background. Not for slabs
    /// that are classified.
    Encoded,
    /// In linear light.
    Linear,
}

/// How footprints that lie behind one another become a picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Composite {
    /// Each kernel by itself, in the order of the distances of their centres ("splat every sample").
    /// Kernels that overlap in depth do not mix: where their order changes, the picture jumps by at
    /// most alpha1 alpha2 |c1 - c2|.
    #[default]
    Over,
    /// Kernels are summed in sheets parallel to the image, whole, each in the sheet of its centre, and
    /// the sheets composited ("sheet buffer", Mueller and Crawfis 1998; section 2 of Zwicker et al.
    /// 2001).
    Sheets {
        /// World units; `None` for the distance between samples.
        thickness: Option<f64>,
    },
    /// The same in sheets across the axis of the volume that is nearest to the direction of view (Westover
    /// 1990; section 4 of Chen et al. 2004): the picture jumps where that changes.
    AxisSheets {
        /// World units; `None` for the distance between samples.
        thickness: Option<f64>,
    },
    /// Kernels are cut into slabs parallel to the image, of each slab the part of a kernel's optical
    /// depth that lies in it, a difference of two error functions. What lies in a slab mixes. The
    /// picture converges to the true integral with the square of the thickness, and nothing jumps.
    Slabs {
        /// World units; `None` for what the tolerance allows.
        thickness: Option<f64>,
        /// Where the transfer function, and light, are asked.
        classify: ClassifyAt,
    },
    /// A maximum-intensity projection: kernels are cut into slabs, and a pixel has the transfer function's
    /// colour of the greatest mean value that any slab of its ray has, opaque. A slab counts where data fill
    /// half of it. For one volume with a field, without surfaces and light.
    Maximum {
        /// World units; `None` for what the tolerance allows slabs.
        thickness: Option<f64>,
    },
}

/// Where the transfer function, and light, are asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ClassifyAt {
    /// For each particle.
    #[default]
    Particle,
    /// For each slab of each pixel, of the mean value there: sharper where the function is steep and
    /// samples are few. For scenes of one volume with a field (and surfaces).
    Slab,
}

impl Composite {
    /// Sheets parallel to the image, of the default thickness.
    pub const SHEETS: Self = Self::Sheets { thickness: None };
    /// Sheets across an axis of the volume, of the default thickness.
    pub const AXIS_SHEETS: Self = Self::AxisSheets { thickness: None };
    /// Slabs of the default thickness, particles classified.
    pub const SLABS: Self = Self::Slabs {
        thickness: None,
        classify: ClassifyAt::Particle,
    };
    /// The greatest value along each ray, in slabs of the default thickness.
    pub const MAXIMUM: Self = Self::Maximum { thickness: None };
    /// Those that approximate the rendering integral, with their defaults.
    pub const ALL: [Self; 4] = [Self::Over, Self::SHEETS, Self::AXIS_SHEETS, Self::SLABS];

    /// The name that the command line knows it by.
    pub fn name(self) -> &'static str {
        match self {
            Self::Over => "over",
            Self::Sheets { .. } => "sheets",
            Self::AxisSheets { .. } => "axis-sheets",
            Self::Slabs { .. } => "slabs",
            Self::Maximum { .. } => "maximum",
        }
    }

    /// The thickness of its layers, where the caller gave one; world units.
    pub fn thickness(self) -> Option<f64> {
        match self {
            Self::Over => None,
            Self::Sheets { thickness }
            | Self::AxisSheets { thickness }
            | Self::Slabs { thickness, .. }
            | Self::Maximum { thickness } => thickness,
        }
    }

    /// The same with layers of another thickness; `Over` has none.
    #[must_use]
    pub fn with_thickness(self, thickness: Option<f64>) -> Self {
        match self {
            Self::Over => Self::Over,
            Self::Sheets { .. } => Self::Sheets { thickness },
            Self::AxisSheets { .. } => Self::AxisSheets { thickness },
            Self::Slabs { classify, .. } => Self::Slabs {
                thickness,
                classify,
            },
            Self::Maximum { .. } => Self::Maximum { thickness },
        }
    }

    /// Whether slabs are classified by their mean values.
    pub fn classifies_slabs(self) -> bool {
        matches!(
            self,
            Self::Slabs {
                classify: ClassifyAt::Slab,
                ..
            } | Self::Maximum { .. }
        )
    }
}

/// How a column density is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnSettings {
    /// The largest error of one kernel's footprint as a share of its peak, for
    /// [`Filter::Adaptive`] under perspective. Orthographic footprints have no such error.
    pub tolerance: f32,
    /// Which footprint draws a kernel.
    pub filter: Filter,
    /// Variance of the low-pass filter, px². [`PIXEL_VARIANCE_PX2`], the default, stands for the pixel itself: values are
    /// the means over pixels, of kernels of any size, by the adaptive filter and the EWA one; others then
    /// have 1 px². Any other variance is sampled at the pixels' centres. Below about .5 they are too coarse for it, and
    /// with none at all a kernel that falls between centres is missed: mass is then not conserved.
    pub low_pass_variance_px2: f32,
    /// Cut-off radius in standard deviations.
    pub cutoff: f32,
    /// What lies outside any of these planes counts nothing: kernels that they cut do so in part.
    pub clip: Vec<ClipPlane>,
    /// The instruction set of the inner loop.
    pub simd: SimdLevel,
    /// Is told how far the frame is, and may cancel it.
    pub task: Option<Task>,
}

impl Default for ColumnSettings {
    fn default() -> Self {
        Self {
            tolerance: DEFAULT_TOLERANCE,
            filter: Filter::Adaptive,
            low_pass_variance_px2: PIXEL_VARIANCE_PX2,
            cutoff: COLUMN_CUTOFF,
            clip: Vec::new(),
            simd: SimdLevel::best(),
            task: None,
        }
    }
}

impl ColumnSettings {
    /// What the stages that are shared with a picture read.
    pub(super) fn shared(&self) -> Settings {
        let own = self.low_pass_variance_px2;
        // A pixel's variance is given back of kernels that it was added to.
        let is_added = matches!(self.filter, Filter::Adaptive | Filter::Ewa);
        let low_pass_variance_px2 = match is_of_pixels(own) && !is_added {
            true => DEFAULT_LOW_PASS_VARIANCE_PX2,
            false => own,
        };
        Settings {
            tolerance: self.tolerance,
            filter: self.filter,
            low_pass_variance_px2,
            cutoff: Some(self.cutoff),
            clip: self.clip.clone(),
            simd: self.simd,
            task: self.task.clone(),
            ..Settings::default()
        }
    }
}
