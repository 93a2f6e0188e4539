//! Defines options for sampling.

use std::path::PathBuf;

use crate::constants::{DEFAULT_KERNEL_WIDTH, FAINT_SHARE};
use crate::data::smoothing::{LengthMeaning, SphKernel};
use crate::error::{Error, Parameter, Result};
use crate::sample::mesh::{SPLAT_WIDTH, Spread};
use crate::sample::points::periodic::PeriodicBox;
use crate::sample::points::streaks::Motion;
use crate::sample::refine::Refinement;
use crate::scene::{PointVolume, ScaleName, SplatRule, TransferFunction};
use crate::task::Task;

/// Greatest number of corrections of cell volumes ([`KernelOptions::shepard_passes`]).
pub const MOST_SHEPARD_PASSES: u32 = 100;

/// Options of sampling: the field to show, its transfer function, the shapes of kernels, and the purpose.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SampleOptions {
    /// The scalar to show ([`Dataset::scalar`](crate::io::Dataset::scalar)'s selector); `None` chooses one.
    pub field: Option<String>,
    /// The scalar to choose if no field is named, provided that the data set has it and would show a field at
    /// all. Data sets that are drawn together share it ([`shared_fields`](super::shared_fields)).
    pub preferred_field: Option<String>,
    /// Iso-value: [`scene`](super::scene) makes the opaque iso-surface of the field in place of the volume. If the
    /// field takes the value within a kernel's extent, the kernel becomes a surfel on the iso-surface. Lattices,
    /// grids, cells and particles with a field have iso-surfaces.
    pub flatten: Option<f64>,
    /// Opacity of the boundary seen head-on, above 0 and at most 1: [`scene`](super::scene) makes the boundary of
    /// a grid in place of the volume. The boundary consists of the faces that belong to one cell alone, and of
    /// surface cells. A transfer function gives its colours, but not its opacity. Draw the boundary beside the
    /// volume of the same data set to see both.
    pub surface: Option<f64>,
    /// The transfer function.
    pub function: FunctionOptions,
    /// The shapes of kernels and surfels.
    pub kernels: KernelOptions,
    /// The use of the volumes.
    pub purpose: PurposeOptions,
    /// Pictures for which kernels are refined; `None` leaves one kernel per sample. A refined volume belongs to
    /// its transfer function and these pictures.
    pub refinement: Option<Refinement>,
    /// The periodic box of particles: these are moved into it, and images of kernels that cross its faces are added.
    /// Pictures of the box are cut at its faces ([`ClipPlane::of_box`](crate::view::ClipPlane::of_box)).
    pub periodic: Option<PeriodicBox>,
    /// The motion of particles while a shutter is open: a moving particle is drawn out along its way.
    pub motion: Option<Motion>,
    /// Receives the progress of the work, and may cancel it.
    pub task: Option<Task>,
}

/// Options of the transfer function.
#[derive(Debug, Clone, PartialEq)]
pub struct FunctionOptions {
    /// The source of the function.
    pub transfer: TransferChoice,
    /// The length \[world units\] over which opacities are stated. `None` takes the length in the transfer
    /// function's file; without one, the mean spacing of the samples.
    pub unit_distance: Option<f64>,
    /// The range of an automatic transfer function, in its own colour map or a named one. `None` chooses a
    /// range from the values.
    pub range: Option<[f64; 2]>,
    /// The scale of an automatic transfer function. `None` chooses one from the values, as the program does. On
    /// a scale other than linear, the volume stores positions on the scale instead of the data's values
    /// ([`ValueScale`](crate::scene::ValueScale)). A function that replaces the sampled one must have the same
    /// scale.
    pub scale: Option<ScaleName>,
    /// Factor of the extinction of any transfer function.
    pub opacity_scale: f64,
}

/// Options of kernels, of the particles' lengths, and of surfels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelOptions {
    /// Standard deviation of a kernel over the local spacing; see [`DEFAULT_KERNEL_WIDTH`].
    pub width: f64,
    /// The meaning of the particles' lengths; overrides the convention of the data's format.
    pub length: Option<LengthMeaning>,
    /// The smoothing kernel that lengths belong to; overrides the data's own. Default if the data name none:
    /// the cubic spline.
    pub smoothing: Option<SphKernel>,
    /// True if columns of particles are those of Gaussians, whatever kernel their lengths belong to.
    pub gaussian: bool,
    /// One length \[world units\] for all particles, in place of the data's lengths. It is a standard deviation
    /// unless `length` says otherwise.
    pub radius: Option<f64>,
    /// The shape of particles whose data state none.
    pub shape: ParticleShape,
    /// Number of times that cell volumes are corrected to reproduce a uniform field at the particles.
    /// Corrections even out irregular samples and shift mass between neighbours. At most
    /// [`MOST_SHEPARD_PASSES`].
    pub shepard_passes: u32,
    /// Treatment of the data's boundary: [`PointVolume::boundary`].
    pub boundary: BoundaryChoice,
    /// Number and spread of surfels, for meshes.
    pub spread: Spread,
    /// For surfels of meshes that viewers composite as splats
    /// ([`MeshOptions::composited`](super::mesh::MeshOptions::composited)): their standard deviation over the spacing.
    pub composited: Option<f64>,
    /// Rule by which splats of radiance fields are drawn; `None` takes that of the data
    /// ([`SplatCloud::rule`](crate::io::SplatCloud::rule)).
    pub splat_rule: Option<SplatRule>,
    /// Seed of the spread of surfels, for meshes. Another seed gives another spread, as even.
    pub seed: u64,
}

/// The use of sampled volumes: in pictures or column densities, and what is stored for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PurposeOptions {
    /// True for column densities. Particles with nothing but positions then show their number density, whose
    /// columns count particles, instead of its logarithm.
    pub for_columns: bool,
    /// The part of a mean that columns serve.
    pub mean: MeanPart,
    /// True for volumes that are to be lit. Each sample then stores the direction of its field's gradient
    /// ([`PointVolume::normals`]), four bytes.
    pub normals: bool,
    /// True to store a model of the field over each kernel's extent, for volumes that are classified by a field
    /// ([`PointVolume::local_models`]): six bytes per particle. Lattices need none.
    pub local_models: bool,
    /// True to keep in the report the values from which an automatic transfer function is chosen
    /// ([`SampleReport::value_sample`](super::SampleReport::value_sample)), for one function of several data sets.
    pub keeps_value_sample: bool,
}

/// The part that columns of particles have in a mean along rays: the sum of weight x field over the sum of weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeanPart {
    /// None: columns are drawn by themselves.
    #[default]
    None,
    /// The weights. If no field is named, the columns sum masses, a density or the number of particles, whichever is
    /// known first.
    Weights,
    /// The field. Masses that are named are then values as others, whereas columns of them are those of the density.
    Field,
}

/// Treatment of data at the boundary of their domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BoundaryChoice {
    /// Sharp if the transfer function shows any sample on the boundary (by more than a hundredth of its
    /// greatest extinction), otherwise soft: transparent samples need no cut. Soft for column densities, whose
    /// sums are those of the samples.
    Automatic,
    /// Kernels are cut at the domain ([`PointVolume::boundary`]), so that the density equals the data's up to
    /// the boundary. Grids of any kind with values at nodes allow it. Other data have no boundary; neither have
    /// iso-surfaces nor data whose volumes are corrected.
    Sharp,
    /// Kernels extend beyond the domain, and the density falls to half at the faces of the domain.
    #[default]
    Soft,
}

/// The shape of kernels whose particles state no more than a length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ParticleShape {
    /// Spheres; ellipsoids if particles without lengths are truly stretched or layered.
    #[default]
    Automatic,
    /// Spheres.
    Isotropic,
    /// Ellipsoids after the covariance of the nearest neighbours; for particles without lengths.
    Covariance,
    /// Ellipsoids after Yu and Turk (2013); for particles with lengths.
    YuTurk,
}

impl Default for FunctionOptions {
    fn default() -> Self {
        Self {
            transfer: TransferChoice::Automatic,
            unit_distance: None,
            range: None,
            scale: Some(ScaleName::Linear),
            opacity_scale: 1.0,
        }
    }
}

impl SampleOptions {
    /// Returns the options for splats in a file, which nothing cuts at a boundary and which state no rule of drawing but a mark.
    ///
    /// - `width`: standard deviation of splats over their spacing, if it is given.
    /// - `is_lit`: true if light is baked into them ([`bake_light`](crate::render::bake_light)).
    #[must_use]
    pub fn for_splats(self, width: Option<f64>, is_lit: bool) -> Self {
        Self {
            kernels: KernelOptions {
                width: width.unwrap_or(self.kernels.width),
                composited: Some(width.unwrap_or(SPLAT_WIDTH)),
                boundary: BoundaryChoice::Soft,
                splat_rule: None,
                ..self.kernels
            },
            purpose: PurposeOptions {
                normals: is_lit,
                ..self.purpose
            },
            ..self
        }
    }
}

impl Default for KernelOptions {
    fn default() -> Self {
        Self {
            width: DEFAULT_KERNEL_WIDTH,
            length: None,
            smoothing: None,
            gaussian: false,
            radius: None,
            shape: ParticleShape::Automatic,
            shepard_passes: 0,
            boundary: BoundaryChoice::default(),
            spread: Spread::Automatic,
            composited: None,
            splat_rule: None,
            seed: 0,
        }
    }
}

impl Default for PurposeOptions {
    fn default() -> Self {
        Self {
            for_columns: false,
            mean: MeanPart::None,
            normals: false,
            local_models: true,
            keeps_value_sample: false,
        }
    }
}

/// Source of the transfer function.
#[derive(Debug, Clone, PartialEq)]
pub enum TransferChoice {
    /// From the values: [`TransferFunction::automatic`].
    Automatic,
    /// From a JSON file: [`TransferFunction::from_json`].
    File(PathBuf),
    /// From the text of such a file.
    Text(String),
    /// The automatic function in the colours of a named map:
    /// [`AutomaticOptions::colour_map`](crate::scene::AutomaticOptions::colour_map).
    Named(String),
    /// This function, with its own unit distance unless the options state one.
    Given(TransferFunction),
    /// This function, chosen automatically from several data sets
    /// ([`shared_functions`](super::shared_functions)). It leaves surfaces
    /// opaque, as a function chosen from one data set does.
    Shared(TransferFunction),
}

/// Refuses a kernel width that is not positive and finite.
pub(super) fn check_kernel_width(width: f64, advice: impl FnOnce() -> String) -> Result<()> {
    if width > 0.0 && width.is_finite() {
        return Ok(());
    }
    let (expected, found) = ("a positive number", width.to_string());
    Err(Error::invalid(
        Parameter::KernelWidth,
        "value",
        expected,
        found,
        advice(),
    ))
}

pub(super) fn check_options(options: &SampleOptions) -> Result<()> {
    let advice = || format!("{DEFAULT_KERNEL_WIDTH} is the default");
    check_kernel_width(options.kernels.width, advice)?;
    if options.kernels.shepard_passes > MOST_SHEPARD_PASSES {
        return Err(Error::invalid(
            "sample",
            "corrections of cell volumes",
            format!("at most {MOST_SHEPARD_PASSES}"),
            options.kernels.shepard_passes.to_string(),
            "a few are enough",
        ));
    }
    Ok(())
}

impl SampleOptions {
    /// Returns true if a surface replaces the volume: an iso-surface or the boundary.
    pub(crate) fn makes_surface(&self) -> bool {
        self.flatten.is_some() || self.surface.is_some()
    }

    /// Returns true if a boundary is sharp whatever the transfer function shows there.
    pub(crate) fn is_sharp_anyway(&self) -> bool {
        self.kernels.boundary == BoundaryChoice::Sharp
    }

    /// Returns true if a boundary may be sharp under these options.
    pub(crate) fn is_sharp(&self) -> bool {
        let is_wanted = match self.kernels.boundary {
            BoundaryChoice::Sharp => true,
            BoundaryChoice::Automatic => !self.purpose.for_columns,
            BoundaryChoice::Soft => false,
        };
        is_wanted && !self.makes_surface() && self.kernels.shepard_passes == 0
    }

    /// Returns true if the boundary of `volume` is to be sharp.
    ///
    /// - `on_boundary`: the samples that lie on the boundary.
    pub(crate) fn cuts(
        &self,
        volume: &PointVolume,
        mut on_boundary: impl Iterator<Item = usize>,
    ) -> bool {
        let (Some(values), Some(transfer)) = (&volume.values, &volume.transfer_function) else {
            return true;
        };
        let [lowest, highest] = transfer.range();
        let least = FAINT_SHARE * transfer.max_extinction(lowest, highest);
        self.kernels.boundary == BoundaryChoice::Sharp
            || on_boundary.any(|i| transfer.classify(values.get(i))[3] > least)
    }
}
