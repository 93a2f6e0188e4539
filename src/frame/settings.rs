//! Defines the caller's settings of a frame.

use std::sync::Arc;

use glam::DVec3;

use super::backdrop::Backdrop;
use crate::constants::{COLUMN_CUTOFF, DEFAULT_LOW_PASS_VARIANCE_PX2, DEFAULT_TOLERANCE};
use crate::data::smoothing::SphKernel;
use crate::error::{Error, Result};
use crate::scene::{Classification, Lighting};
use crate::simd::SimdLevel;
use crate::splat::{Filter, PIXEL_VARIANCE_PX2, is_of_pixels};
use crate::task::Task;
use crate::view::{Aperture, ClipPlane};

/// Settings of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The error in linear colour, as a fraction of full scale, that all approximations together may add
    /// to 99.9 % of pixels. [`splat::budget`](crate::splat::budget) divides it among them.
    pub tolerance: f32,
    /// The footprint that draws a kernel. Splats that state their opacity are always drawn by the rule of
    /// their format, [`peak_footprint`](crate::splat::peak_footprint).
    pub filter: Filter,
    /// True if particles far smaller than a pixel are drawn merged, under [`Filter::Adaptive`].
    pub level_of_detail: bool,
    /// The quantity that the picture shows.
    pub show: Show,
    /// Rule that composites kernels which lie behind one another.
    pub composite: Composite,
    /// The place at which the transfer function is evaluated; [`Composite::Maximum`] ignores it.
    pub classify: Classification,
    /// Planes that clip everything that is drawn; eight at most.
    pub clip: Vec<ClipPlane>,
    /// Variance of the low-pass filter, px²; splats that state their opacity have their own.
    pub low_pass_variance_px2: f32,
    /// Cut-off radius in standard deviations; `None` follows the tolerance.
    pub cutoff: Option<f32>,
    /// The space in which colours are composited.
    pub blend: Blend,
    /// The order in which kernels hide one another.
    pub order: Order,
    /// Linear RGB of the background; `None` leaves the image transparent.
    pub background: Option<[f32; 3]>,
    /// Another renderer's picture: depths at which rays end, and colours in front of [`Self::background`].
    pub backdrop: Option<Arc<Backdrop>>,
    /// True if to return a depth image.
    pub depth: bool,
    /// True if to return the normals of opaque surfels.
    pub normals: bool,
    /// Light on surfels and on volumes that have normals; `None` shows colours as they are.
    pub lighting: Option<Lighting>,
    /// The opening of the lens; `None` has all depths in focus.
    pub aperture: Option<Aperture>,
    /// Settings that few pictures need.
    pub advanced: Advanced,
    /// Receives the progress of the frame, and may cancel it.
    pub task: Option<Task>,
}

/// Settings that few pictures need: the papers' own rules, opacities of sparse particles, and work per frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Advanced {
    /// c_min and c_max of eq. 7 of Chen et al. 2004; `None` follows the tolerance. The paper's values are
    /// .3 and 2.
    ///
    /// They apply to [`Filter::Adaptive`]. Blocks nearer than c_min r_k/r_h are drawn by the
    /// reconstruction kernel alone. Blocks beyond c_max (1 + 2 tan²(fov/2)) r_k/r_h are drawn by the
    /// low-pass filter alone, and others by the resampling filter. With thresholds no kernel is exact,
    /// and none is merged.
    pub thresholds: Option<[f32; 2]>,
    /// Factor on the error that merging may use of the tolerance; 1 keeps the tolerance. Larger values
    /// suit pictures in motion, whose time depends on the number of kernels when pixels are few. An error
    /// of many tolerances blurs details.
    pub merge_slack: f32,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau). The error is at most tau²/2 for one kernel, and at
    /// most 1/e of the greatest tau for many kernels behind one another.
    pub linear_opacity: bool,
    /// True if a kernel smaller than a pixel is as opaque as it would be alone.
    ///
    /// The low-pass filter spreads optical depths. A kernel that fills a tenth of a pixel with a depth of
    /// 10 hides a fifth of the pixel, but is drawn as hiding more than half
    /// ([`sub_pixel_depth`](crate::splat::sub_pixel_depth)).
    ///
    /// Use this for sparse sets of opaque particles, such as stars or droplets. The error of a hundred of
    /// depth 30 falls from .35 to .014 of full scale (root mean square, sigma .3 px).
    ///
    /// Kernels that fill pixels together become too faint, as if light passed between them.
    /// One layer of a lattice with two samples to the pixel loses .04 of opacity at depth 4, and eight
    /// layers lose .004; without it the optical depths are right to 1e-5 (`tests/frames/sub_pixel.rs`).
    /// Merged particles already account for their members' opacity and do not change; nor do kernels that
    /// reach the eye.
    pub sub_pixel_opacity: bool,
    /// True if tiles with opaque edges are drawn at four samples a pixel, on which the low-pass filter acts: the
    /// default. It applies to filters up to .3 px². Otherwise opaque silhouettes are wider than the data's by a
    /// part of a pixel.
    pub opaque_edges: bool,
    /// The instruction set of the rasteriser.
    pub simd: SimdLevel,
}

impl Default for Advanced {
    fn default() -> Self {
        Self {
            thresholds: None,
            merge_slack: 1.0,
            linear_opacity: false,
            sub_pixel_opacity: false,
            opaque_edges: true,
            simd: SimdLevel::best(),
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tolerance: DEFAULT_TOLERANCE,
            filter: Filter::Adaptive,
            level_of_detail: true,
            show: Show::Scene,
            composite: Composite::Over,
            classify: Classification::Extent,
            clip: Vec::new(),
            low_pass_variance_px2: DEFAULT_LOW_PASS_VARIANCE_PX2,
            cutoff: None,
            blend: Blend::Auto,
            order: Order::Auto,
            background: None,
            backdrop: None,
            depth: false,
            normals: false,
            lighting: None,
            aperture: None,
            advanced: Advanced::default(),
            task: None,
        }
    }
}

impl Settings {
    /// Returns whether frames draw merged particles. Only scenes that such frames draw need levels of
    /// detail ([`SceneOptions::level_of_detail`](crate::SceneOptions::level_of_detail)).
    pub fn draws_merged(&self) -> bool {
        // Slabs would cut a merged particle as if it were a single kernel.
        self.level_of_detail
            && self.filter == Filter::Adaptive
            && self.advanced.thresholds.is_none()
            && !self.composite.accumulate().cuts_slabs()
    }

    /// Refuses an aperture for what is drawn with all depths in focus.
    ///
    /// - `what`: the use of the picture, for the error.
    pub(crate) fn refuse_aperture(&self, what: &'static str) -> Result<()> {
        match self.aperture {
            None => Ok(()),
            Some(_) => Err(Error::invalid(
                what,
                "settings",
                "all depths in focus",
                "an aperture",
                "leave the aperture out",
            )),
        }
    }

    /// Returns whether slabs are classified by their mean values: if [`Self::classify`] says so, and for
    /// every maximum.
    pub fn classifies_slabs(&self) -> bool {
        self.classify == Classification::Slab || matches!(self.composite, Composite::Maximum { .. })
    }

    /// Returns the background of the picture that is shown. A picture of kernel counts has a black
    /// background: it adds nothing to the counts and makes them opaque.
    pub(crate) fn shown_background(&self) -> Option<[f32; 3]> {
        match self.show {
            Show::Count => Some([0.0; 3]),
            Show::Scene | Show::Choice => self.background,
        }
    }
}

/// The quantity that a picture shows: the scene, or how it is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Show {
    /// The scene.
    #[default]
    Scene = 0,
    /// Each splat in the colour of its evaluation path or of its level of detail.
    Choice = 1,
    /// \[n, n, n, 1\] with the number n of kernels that a pixel evaluated within their cut-off; no
    /// background. The sum over the picture is
    /// [`FrameCounts::splat_pixels`](crate::render::FrameCounts::splat_pixels), if no pixel has more than
    /// 2²⁴.
    Count = 2,
}

/// The space in which colours are composited. Pictures are linear in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Blend {
    /// Encoded if the scene consists of splats of radiance fields alone and all of them state sRGB codes,
    /// linear otherwise. Their training composited in sRGB codes, and viewers do so too.
    #[default]
    Auto,
    /// In sRGB codes, which are decoded afterwards. This applies to splats, surfaces, volumes and the
    /// background alike, but not to classified slabs.
    Encoded,
    /// In linear light.
    Linear,
}

/// The order in which kernels are composited, each by itself ([`Composite::Over`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Order {
    /// By depth if the scene consists of splats of radiance fields alone, as their training and most viewers sort them,
    /// unless their file states otherwise. By distance in other scenes.
    #[default]
    Auto,
    /// By the distance of the centre from the eye: the order stays if the camera turns. glTF calls it `cameraDistance`.
    Distance,
    /// By the depth of the centre along the camera's axis. glTF calls it `zDepth`.
    Depth,
}

/// Rules that composite footprints which lie behind one another.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Composite {
    /// Each kernel by itself, in the order of the distances of their centres ("splat every sample").
    /// Kernels that overlap in depth do not mix. If their order changes, the picture jumps by at most
    /// alpha1 alpha2 |c1 - c2|.
    #[default]
    Over,
    /// Whole kernels are summed in sheets parallel to the image, each in the sheet of its centre. The
    /// sheets are composited ("sheet buffer", Mueller and Crawfis 1998; section 2 of Zwicker et al.
    /// 2001).
    Sheets {
        /// World units; `None` for the distance between samples.
        thickness: Option<f64>,
    },
    /// As `Sheets`, with sheets across the axis of the volume that is nearest to the direction of view
    /// (Westover 1990; section 4 of Chen et al. 2004). The picture jumps when that axis changes.
    AxisSheets {
        /// World units; `None` for the distance between samples.
        thickness: Option<f64>,
    },
    /// Kernels are cut into slabs parallel to the image. Each slab receives the part of a kernel's
    /// optical depth that lies in it, a difference of two error functions. Kernels in one slab mix. The
    /// picture converges to the true integral with the square of the thickness, and nothing jumps.
    Slabs {
        /// World units; `None` for the thickness that the tolerance allows.
        thickness: Option<f64>,
    },
    /// A maximum-intensity projection. Kernels are cut into slabs, and a pixel has the transfer
    /// function's colour of the greatest mean value of any slab on its ray, opaque. A slab counts if data
    /// fill half of it. For one volume with a field, without surfaces and light.
    Maximum {
        /// World units; `None` for the thickness that the tolerance allows slabs.
        thickness: Option<f64>,
    },
}

impl Composite {
    /// Sheets parallel to the image, of the default thickness.
    pub const SHEETS: Self = Self::Sheets { thickness: None };
    /// Sheets across an axis of the volume, of the default thickness.
    pub const AXIS_SHEETS: Self = Self::AxisSheets { thickness: None };
    /// Slabs of the default thickness.
    pub const SLABS: Self = Self::Slabs { thickness: None };
    /// The greatest value along each ray, in slabs of the default thickness.
    pub const MAXIMUM: Self = Self::Maximum { thickness: None };
    /// The composites that approximate the rendering integral, with their defaults.
    pub const ALL: [Self; 4] = [Self::Over, Self::SHEETS, Self::AXIS_SHEETS, Self::SLABS];

    /// Returns its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Over => "over",
            Self::Sheets { .. } => "sheets",
            Self::AxisSheets { .. } => "axis-sheets",
            Self::Slabs { .. } => "slabs",
            Self::Maximum { .. } => "maximum",
        }
    }

    /// Returns the thickness of its layers, if the caller gave one; world units.
    pub fn thickness(self) -> Option<f64> {
        match self {
            Self::Over => None,
            Self::Sheets { thickness }
            | Self::AxisSheets { thickness }
            | Self::Slabs { thickness }
            | Self::Maximum { thickness } => thickness,
        }
    }

    /// Returns the same composite with layers of another thickness; `Over` has none.
    #[must_use]
    pub fn with_thickness(self, thickness: Option<f64>) -> Self {
        match self {
            Self::Over => Self::Over,
            Self::Sheets { .. } => Self::Sheets { thickness },
            Self::AxisSheets { .. } => Self::AxisSheets { thickness },
            Self::Slabs { .. } => Self::Slabs { thickness },
            Self::Maximum { .. } => Self::Maximum { thickness },
        }
    }
}

/// Settings of a column density.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnSettings {
    /// The largest error of one kernel's footprint as a share of its peak, for
    /// [`Filter::Adaptive`] under perspective. Orthographic footprints have no such error.
    pub tolerance: f32,
    /// The footprint that draws a kernel.
    pub filter: Filter,
    /// Variance of the low-pass filter, px².
    ///
    /// The default, [`PIXEL_VARIANCE_PX2`], stands for the pixel itself: values are means over pixels,
    /// for kernels of any size. This holds for the adaptive and the EWA filter; other filters then use 1
    /// px². Any other variance is sampled at the pixels' centres. Below about .5 px² the samples are too
    /// coarse for it. With 0, kernels that fall between centres are missed, and mass is not conserved.
    pub low_pass_variance_px2: f32,
    /// Cut-off radius in standard deviations.
    pub cutoff: f32,
    /// The SPH kernel that is drawn in place of its Gaussian: its projection, with compact support, within 5e-5 of a
    /// particle's greatest pixel. Particles must be round. Gaussians remain where the support is below
    /// .25 px, where footprints are exact or near, with another filter or low-pass variance, and with a cut-off below the
    /// default. `None` draws Gaussians.
    pub smoothing: Option<SphKernel>,
    /// A point of a plane across the view, world units: instead of line integrals, pixels hold the sums of the kernels
    /// there, at their centres \[field\]. This needs an orthographic camera. The CPU computes it in f64, whatever the back
    /// end; tolerance, filter and low-pass variance have no meaning then, nor has the cut-off of SPH kernels. `None` draws
    /// columns.
    pub slice: Option<DVec3>,
    /// Planes outside which nothing counts. Kernels that a plane cuts count in part.
    pub clip: Vec<ClipPlane>,
    /// The instruction set of the inner loop.
    pub simd: SimdLevel,
    /// Receives the progress of the frame, and may cancel it.
    pub task: Option<Task>,
}

impl Default for ColumnSettings {
    fn default() -> Self {
        Self {
            tolerance: DEFAULT_TOLERANCE,
            filter: Filter::Adaptive,
            low_pass_variance_px2: PIXEL_VARIANCE_PX2,
            cutoff: COLUMN_CUTOFF,
            smoothing: None,
            slice: None,
            clip: Vec::new(),
            simd: SimdLevel::best(),
            task: None,
        }
    }
}

impl ColumnSettings {
    /// Returns the settings of the stages that columns share with pictures.
    pub(crate) fn shared(&self) -> Settings {
        let own = self.low_pass_variance_px2;
        // The pixel's variance is subtracted again from kernels that it was added to.
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
            advanced: Advanced {
                simd: self.simd,
                ..Advanced::default()
            },
            task: self.task.clone(),
            ..Settings::default()
        }
    }
}
