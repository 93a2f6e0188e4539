//! Makes point volumes of data sets: one kernel for every sample of a field.
//!
//! A kernel is a Gaussian with a centre, a variance and a volume. Its shape follows the local spacing of the
//! samples. The volumes of all kernels add up to the volume of the grid. [`scene`] is the entry point for any
//! data set, [`volume`] for all but meshes, [`mesh::surfels`] for meshes.
//!
//! | data set | kernels | modules |
//! |---|---|---|
//! | lattice | one per sample; only values are stored | `lattice` |
//! | curvilinear grid | one per node or cell | `curvilinear` |
//! | unstructured grid | one per node or cell | `cells` |
//! | points | one per row of a table | `points` |
//! | splats | one per splat, with the shapes that the file states | `splats` |
//! | mesh, grid of one layer | surfels, spread over the surface | [`mesh`], `surface::flat_grid` |
//!
//! Further modules complete a volume:
//!
//! - `field` chooses the field to show (`choice`), and one transfer function for several data sets (`together`). It
//!   computes normals for shading (`gradient`), and models of the field over each kernel (`local_models`).
//! - `curvilinear::sharp` and `cells::sharp` cut kernels at the boundary of the data and add ghosts beyond it.
//!   `kernels::even` and `curvilinear::even_grid` then correct the volumes. `kernels::levels` and `points::shepard`
//!   correct volumes elsewhere.
//! - `surface` and `splats::convert` make surfels and splats.
//! - `curvilinear::partitioned`, `cells::partitioned` and `points::partitioned` sample data that are partitioned over
//!   ranks. A rank makes kernels for its own samples (`own`); neighbouring samples are ghosts.

pub(crate) mod cells;
pub(crate) mod curvilinear;
pub(crate) mod field;
pub(crate) mod kernels;
mod lattice;
mod left_out;
pub mod mesh;
mod own;
pub(crate) mod points;
mod positions;
mod report;
pub(crate) mod splats;
pub(crate) mod surface;

use crate::data::association::Association;
use crate::math::narrowed;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

use glam::DVec3;

#[cfg(feature = "prepared")]
use crate::data::colour_columns::ColourNumbers;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::data::first_order::{is_of_higher_order, to_first_order};
use crate::data::smoothing::{LengthMeaning, SphKernel};
use crate::error::{Advice, Error, Hint, Parameter, Place, Result};
#[cfg(feature = "prepared")]
use crate::math::ExactSum;
use crate::scene::{
    AutomaticOptions, Colour, FileFunction, Particles, PointVolume, ScaleName, Strength,
    Surroundings, TransferDefaults, TransferFunction, ValueSample, ValueScale, Values,
};
use crate::task::Task;

pub(crate) use self::cells::duals::turned;
pub(crate) use self::cells::incidence::CellsAround;
pub(crate) use self::cells::partitioned::PartitionedCells;
pub(crate) use self::curvilinear::partitioned::{GridPlanes, planes_around};
pub(crate) use self::curvilinear::seam::{Seam, seam};
pub(crate) use self::curvilinear::window::Window;
use self::field::choice::has_choice;
pub(crate) use self::field::choice::shown_field;
pub use self::field::choice::{FieldChoice, field_choices, shared_fields};
pub use self::field::statistics::{PERCENTILES, ShapeStatistics};
#[cfg(feature = "prepared")]
pub(crate) use self::field::together::automatic;
pub use self::field::together::shared_functions;
pub use self::points::doubts::doubts;
pub(crate) use self::points::neighbours::Remote;
pub(crate) use self::points::reach::{Boxes, Leaf, Near, Reach};
pub use self::splats::convert::{
    CLOSED_WIDTH, ConversionReport, LEAST_OPACITY, sound_splats, splat_cloud,
};
pub use self::surface::cut_faces::cut_faces;
pub use self::surface::discs::discs;
pub use crate::constants::DEFAULT_KERNEL_WIDTH;
use crate::constants::FAINT_SHARE;
pub(crate) use cells::CellField;
use kernels::Kernels;
pub(crate) use lattice::{PlaneValues, lattice_of_planes};
use mesh::{MeshOptions, SampledMesh, Spread};
pub(crate) use points::{
    FITTED_NEIGHBOURS, Fitted, Neighbourhoods, PartitionedRows, Surrounded, fit_partition,
    function_of_all, sample_partition, scalars, without_spacing,
};
pub(crate) use positions::{compare, is_same, sort_by_position};
pub(crate) use report::Found;
pub use report::{Finding, SampleReport};

/// Greatest number of corrections of cell volumes ([`SampleOptions::shepard_passes`]).
pub const MOST_SHEPARD_PASSES: u32 = 100;

/// Greatest error of a field on cells of higher order once they are cut into cells of first order, as a share
/// of the field's range. It is two to three grey levels of a transfer function over the whole range. Kernels
/// err by more where a field bends that much within a cell.
const ELEMENT_SLACK: f64 = 0.01;

/// Options of sampling: the field to show, its transfer function, and the shapes of kernels.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleOptions {
    /// The scalar to show ([`Dataset::scalar`]'s selector); `None` chooses one.
    pub field: Option<String>,
    /// The scalar to choose if no field is named, provided that the data set has it and would show a field at
    /// all. Data sets that are drawn together share it ([`shared_fields`]).
    pub preferred_field: Option<String>,
    /// Standard deviation of a kernel over the local spacing; see [`DEFAULT_KERNEL_WIDTH`].
    pub kernel_width: f64,
    /// The transfer function.
    pub transfer: TransferChoice,
    /// The length \[world units\] over which opacities are stated. `None` takes the length in the transfer
    /// function's file; without one, the mean spacing of the samples.
    pub unit_distance: Option<f64>,
    /// The range of an automatic transfer function, in its own colour map or a named one. `None` chooses a
    /// range from the values.
    pub range: Option<[f64; 2]>,
    /// The scale of an automatic transfer function. `None` chooses one from the values, as the program does. On
    /// a scale other than linear, the volume stores positions on the scale instead of the data's values
    /// ([`ValueScale`]). A function that replaces the sampled one must have the same
    /// scale.
    pub scale: Option<ScaleName>,
    /// Factor of the extinction of any transfer function.
    pub opacity_scale: f64,
    /// The meaning of the particles' lengths; overrides the convention of the data's format.
    pub length: Option<LengthMeaning>,
    /// The smoothing kernel that lengths belong to; overrides the data's own. Default if the data name none:
    /// the cubic spline.
    pub kernel: Option<SphKernel>,
    /// One length \[world units\] for all particles, in place of the data's lengths. It is a standard deviation
    /// unless `length` says otherwise.
    pub radius: Option<f64>,
    /// The shape of particles whose data state none.
    pub shape: ParticleShape,
    /// Number of times that cell volumes are corrected to reproduce a uniform field at the particles.
    /// Corrections even out irregular samples and shift mass between neighbours. At most
    /// [`MOST_SHEPARD_PASSES`].
    pub shepard_passes: u32,
    /// True for column densities. Particles with nothing but positions then show their number density, whose
    /// columns count particles, instead of its logarithm.
    pub for_columns: bool,
    /// True if columns of particles are to weigh a mean. If no field is named, the columns then sum masses, a
    /// density or the number of particles, whichever is known first.
    pub for_means: bool,
    /// A value of the field whose opaque iso-surface is drawn in place of the volume ([`scene`]). Each kernel
    /// over whose extent the field takes the value becomes a surfel: the disc on which the field has it.
    /// Lattices, grids, cells and particles with a field allow it.
    pub flatten: Option<f64>,
    /// True for volumes that are to be lit. Each sample then stores the direction of its field's gradient
    /// ([`PointVolume::normals`]), four bytes.
    pub normals: bool,
    /// True to store a model of the field over each kernel's extent, for volumes that are classified by a field
    /// ([`PointVolume::local_models`]): six bytes per particle. Lattices need none.
    pub local_models: bool,
    /// True to keep in the report the values from which an automatic transfer function is chosen
    /// ([`SampleReport::value_sample`]), for one function of several data sets.
    pub keeps_value_sample: bool,
    /// Treatment of the data's boundary: [`PointVolume::boundary`].
    pub boundary: BoundaryChoice,
    /// Number and spread of surfels, for meshes.
    pub spread: Spread,
    /// Seed of the spread of surfels, for meshes. Another seed gives another spread, as even.
    pub seed: u64,
    /// Receives the progress of the work, and may cancel it.
    pub task: Option<Task>,
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

impl Default for SampleOptions {
    fn default() -> Self {
        Self {
            field: None,
            preferred_field: None,
            kernel_width: DEFAULT_KERNEL_WIDTH,
            transfer: TransferChoice::Automatic,
            unit_distance: None,
            range: None,
            scale: Some(ScaleName::Linear),
            opacity_scale: 1.0,
            length: None,
            kernel: None,
            radius: None,
            shape: ParticleShape::Automatic,
            shepard_passes: 0,
            for_columns: false,
            for_means: false,
            flatten: None,
            normals: false,
            local_models: true,
            keeps_value_sample: false,
            boundary: BoundaryChoice::default(),
            spread: Spread::Automatic,
            seed: 0,
            task: None,
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
    /// The automatic function in the colours of a named map: [`AutomaticOptions::colour_map`].
    Named(String),
    /// This function, with its own unit distance unless the options state one.
    Given(TransferFunction),
    /// This function, chosen automatically from several data sets ([`shared_functions`]). It leaves surfaces
    /// opaque, as a function chosen from one data set does.
    Shared(TransferFunction),
}

/// A point volume and a report on its sampling.
#[derive(Debug, Clone)]
pub struct Sampled {
    /// The volume.
    pub volume: PointVolume,
    /// The choices made, and the samples left out.
    pub report: SampleReport,
}

/// The volumes of a data set and a report on their sampling.
#[derive(Debug, Clone)]
pub struct SampledScene {
    /// At least one volume; a mesh gives one for each kind of surface that it has.
    pub volumes: Vec<PointVolume>,
    /// The choices made, and the samples left out.
    pub report: SampleReport,
}

/// Returns true if [`scene`] makes surfels of a data set: a mesh or a grid of one layer.
pub fn is_surface(dataset: &Dataset) -> bool {
    matches!(dataset.geometry, Geometry::Mesh(_)) || self::surface::flat_grid::is_flat(dataset)
}

/// Turns a grid of one layer, or cells without any field, into a mesh, of which [`scene`] makes surfels. Cells
/// become their outer surface. Other data sets are returned unchanged.
///
/// # Errors
/// The errors of [`Dataset::validate`]; fields that state hidden cells or nodes and cannot be read.
pub fn as_surface(dataset: Dataset, options: &SampleOptions) -> Result<Dataset> {
    // Column densities are sums of values, and a layer of kernels has values.
    if options.for_columns {
        return Ok(dataset);
    }
    let is_of_cells = matches!(dataset.geometry, Geometry::Cells(_));
    match is_of_cells && options.field.is_none() && !has_choice(&dataset) {
        true => self::surface::hull::as_mesh(dataset),
        false => self::surface::flat_grid::as_surface(dataset),
    }
}

/// Returns the report of [`scene`] on the values of a mesh without making surfels: the field, its unit, and the
/// sample of values from which an automatic function is chosen. The report is empty if the mesh shows no field.
///
/// # Errors
/// A field that is not there or has the wrong length; a transfer function that cannot be read.
pub fn surface_report(dataset: &Dataset, options: &SampleOptions) -> Result<SampleReport> {
    match self::surface::mesh_field::shown(dataset, options)? {
        Some(field) => self::surface::mesh_field::report(dataset, &field, options),
        None => Ok(SampleReport::default()),
    }
}

/// Makes the volumes to draw of any data set: surfels of a mesh ([`mesh::surfels`]), one point volume of any
/// other data set ([`volume`]). Grids of one layer become surfaces.
///
/// A surface shows a field if the options name one, or if the surface has no colours of its own. Each surfel
/// then has a value, the mean over its part of the surface. An automatic function or a named colour map leaves
/// the surface opaque; other functions set its opacity, too.
///
/// # Errors
/// The errors of [`mesh::surfels`] and of [`volume`].
pub fn scene(dataset: Dataset, options: &SampleOptions) -> Result<SampledScene> {
    let dataset = as_surface(dataset, options)?;
    let Geometry::Mesh(mesh) = &dataset.geometry else {
        let path = dataset.path.clone();
        let Sampled { mut volume, report } = volume(dataset, options)?;
        if let Some(value) = options.flatten {
            let surface =
                self::surface::iso_surface::iso_surface(&volume, value, options.task.as_ref());
            volume = surface.map_err(|error| error.in_file(&path))?;
        }
        let volumes = vec![volume];
        return Ok(SampledScene { volumes, report });
    };
    let mesh_options = MeshOptions {
        spread: options.spread,
        kernel_width: options.kernel_width,
        seed: options.seed,
        task: options.task.clone(),
    };
    if let Some(field) = self::surface::mesh_field::shown(&dataset, options)? {
        let path = dataset.path.clone();
        let unit = dataset.unit(&field).map(str::to_owned);
        let scene = self::surface::mesh_field::scene(dataset, &field, &mesh_options, options);
        let mut scene = scene.map_err(|error| named(error, &path))?;
        scene.report.unit = unit;
        return Ok(scene);
    }
    let SampledMesh { volumes, report } =
        mesh::surfels(mesh, &mesh_options).map_err(|error| named(error, &dataset.path))?;
    Ok(SampledScene {
        volumes,
        report: SampleReport {
            sample_count: report.triangle_count,
            particle_count: report.surfel_count + report.mark_count,
            findings: report.findings.clone(),
            mesh: Some(report),
            ..SampleReport::default()
        },
    })
}

/// Adds the file's name to an error of the mesh itself.
fn named(error: Error, file: &Path) -> Error {
    match error {
        Error::Invalid {
            what: Place::Text(ref what),
            ..
        } if **what == *mesh::THE_MESH => error.in_file(file),
        other => other,
    }
}

/// Makes a point volume of a data set. Values are moved, not copied, and keep their type.
///
/// - A lattice stays a lattice: no positions are stored. Cell values become a lattice of cell centres.
/// - A curvilinear grid gives one anisotropic kernel per node (or cell). Its variance is kernel_width² F Fᵀ with
///   F = ∂x/∂(i, j, k); its volume is that of its part of the grid.
/// - An unstructured grid gives one anisotropic kernel per node, from the node's share of the cells around it, or
///   one per cell.
/// - Points take shape, strength and colour from their columns. Shape: `sigma` | `radius` | `h` |
///   `vxx,vxy,vxz,vyy,vyz,vzz` | `scale_0..2,rot_0..3`, or the columns that [`Dataset::smoothing`] names.
///   Strength: `mass` | `extinction` with `volume` | `opacity` | a scalar with a transfer function, whose volumes
///   are `volume` or `m` over `rho`. Colour: `r,g,b`. Without shape columns, kernels are spheres sized by the
///   distances to the nearest neighbours, or discs if the points lie on a surface. If only colours are known, the
///   points are opaque.
/// - Splats keep their shapes, opacities and colours, and the rule of drawing that their format defines. A named
///   field replaces the colours. [`Blend`](crate::render::Blend) states the space in which their colours are
///   composited.
///
/// If no field is named, PLOT3D data and particles show their density. Other data show their first scalar that
/// is not constant, nodes before cells. Particles with neither lengths nor densities show their number density.
///
/// [`crate::irregular`] has the formulas, and how evenly each draws a uniform field.
///
/// Samples that cannot be drawn (positions, values or shapes that are not finite, cells without volume, blanked
/// nodes) are left out and counted in the report. On a lattice, a value that is not finite stays; NaN is
/// transparent.
///
/// # Errors
/// The errors of [`Dataset::validate`]; a field that is missing or has the wrong length; no samples, or none that
/// can be drawn; columns that contradict each other; a kernel width that is not positive; a transfer function
/// that cannot be read; work that was cancelled.
pub fn volume(dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    check_options(options)?;
    dataset.validate()?;
    // Sampling consumes the data set: keep the units until the shown field is known.
    let asked = options.field.as_ref();
    let asked = asked.map(|name| (name.clone(), dataset.unit(name).map(str::to_owned)));
    let fields = dataset.fields.iter();
    let units = fields.map(|f| (dataset.selector_of(f), f.unit.clone()));
    let units: Vec<(String, Option<String>)> = asked.into_iter().chain(units).collect();
    let (dataset, cut_count) = match &dataset.geometry {
        Geometry::Cells(mesh) if is_of_higher_order(mesh) => {
            let shown = shown_field(&dataset, options)?;
            to_first_order(dataset, &shown, ELEMENT_SLACK)?
        }
        _ => (dataset, 0),
    };
    let dataset = lattice::without_hidden(dataset, options)?;
    let mut sampled = match &dataset.geometry {
        Geometry::Lattice(_) => lattice::volume(dataset, options),
        Geometry::Curvilinear { .. } => curvilinear::volume(dataset, options),
        Geometry::Cells(_) => cells::volume(dataset, options),
        Geometry::Points { .. } => points::volume(dataset, options),
        Geometry::Splats(_) => splats::volume(dataset, options),
        Geometry::Mesh(_) => Err(Error::format(
            &dataset.path,
            "mesh",
            "a volume or particles",
            "a mesh",
            "sample it into surfels, by `sample::scene`",
        )),
    }?;
    let what = "of higher order: cut into cells whose corners say the same";
    sampled.report.note(cut_count, "cells", what);
    if let Some(shown) = &sampled.report.field {
        let found = units.into_iter().find(|(name, _)| name == shown);
        sampled.report.unit = found.and_then(|(_, unit)| unit);
    }
    if options.shepard_passes > 0 {
        let task = options.task.as_ref();
        self::points::shepard::even_out(&mut sampled.volume, options.shepard_passes, task)?;
    }
    if options.normals {
        self::field::gradient::complete(&mut sampled.volume, options.task.as_ref())?;
    }
    self::field::local_models::complete(&mut sampled.volume, options)?;
    Ok(sampled)
}

/// Refuses a kernel width that is not positive and finite.
fn check_kernel_width(width: f64, advice: impl FnOnce() -> String) -> Result<()> {
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

fn check_options(options: &SampleOptions) -> Result<()> {
    let advice = || format!("{DEFAULT_KERNEL_WIDTH} is the default");
    check_kernel_width(options.kernel_width, advice)?;
    if options.shepard_passes > MOST_SHEPARD_PASSES {
        return Err(Error::invalid(
            "sample",
            "corrections of cell volumes",
            format!("at most {MOST_SHEPARD_PASSES}"),
            options.shepard_passes.to_string(),
            "a few are enough",
        ));
    }
    Ok(())
}

/// Kinds of points whose particles each depend on one row alone, so that a part of the rows gives a part of the
/// volume's particles.
#[cfg(feature = "prepared")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum OfRows {
    /// Points that state shapes and strengths, and show no field.
    Stated,
    /// Smoothed particles whose column densities sum this field.
    Summed(String),
}

/// Returns the kind of particles if each depends on its own row alone; otherwise `None`.
#[cfg(feature = "prepared")]
pub(crate) fn of_rows(dataset: &Dataset, options: &SampleOptions) -> Option<OfRows> {
    let is_alone = options.flatten.is_none() && options.shepard_passes == 0 && !options.normals;
    points::kind_of_rows(dataset, options).filter(|_| is_alone)
}

/// Returns the numbers of the colours of some rows. Together with the numbers of all other rows they determine
/// how the colours are stored. Returns `None` if the storage depends on no numbers.
///
/// # Errors
/// Columns of another length.
#[cfg(feature = "prepared")]
pub(crate) fn colour_numbers(dataset: &Dataset) -> Result<Option<ColourNumbers>> {
    points::colour_numbers(dataset)
}

/// Makes the part of the point volume that belongs to some of the rows ([`of_rows`]); there may be no rows. The
/// result is that of [`volume`], except for the function of column densities ([`summed_function`]).
///
/// - `colours`: the numbers of the colours of all rows ([`colour_numbers`]).
/// - `volume_sum`: the volume of the preceding particles; returns with these added \[length³\].
///
/// # Errors
/// The errors of [`volume`].
#[cfg(feature = "prepared")]
pub(crate) fn rows(
    dataset: Dataset,
    options: &SampleOptions,
    colours: Option<ColourNumbers>,
    volume_sum: &mut ExactSum,
) -> Result<Sampled> {
    check_options(options)?;
    dataset.validate()?;
    let shown = options.field.as_ref();
    let unit = shown.and_then(|name| dataset.unit(name).map(str::to_owned));
    let mut sampled = points::of_rows(dataset, options, colours, volume_sum)?;
    sampled.report.unit = unit;
    Ok(sampled)
}

/// Edge of a cube with the mean volume of particles; 1 if the particles have no volume.
pub(crate) fn mean_spacing(volume_sum: f64, count: usize) -> f64 {
    let spacing = Some((volume_sum / count as f64).cbrt());
    spacing.filter(|s| *s > 0.0).unwrap_or(1.0)
}

/// Returns a placeholder function for volumes whose values are summed to column densities, not classified.
///
/// - `range`: the range of the values.
///
/// # Errors
/// A range or a unit distance that is invalid.
pub(crate) fn summed_function(
    range: Option<[f64; 2]>,
    unit_distance: f64,
) -> Result<TransferFunction> {
    let range = range.unwrap_or([0.0, 1.0]).map(narrowed);
    TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, range, unit_distance)
}

/// Makes a point volume of a curvilinear grid in memory, as [`volume`] does of a grid in a file.
///
/// - `dims`: nodes along i, j and k.
/// - `nodes`: positions of the nodes, i fastest, then j, then k.
/// - `values`: one value for each node.
///
/// ```
/// use ewa_splat::sample::{SampleOptions, grid};
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// // A sector of a ring, 5 x 8 x 3 nodes.
/// let ring = |n: usize| {
///     let (radius, turn) = (1.0 + 0.2 * (n % 5) as f64, 0.3 * (n / 5 % 8) as f64);
///     DVec3::new(radius * turn.cos(), radius * turn.sin(), 0.2 * (n / 40) as f64)
/// };
/// let nodes: Vec<DVec3> = (0..120).map(ring).collect();
/// let values: Vec<f32> = nodes.iter().map(|node| node.x as f32).collect();
/// let sampled = grid([5, 8, 3], nodes, values, &SampleOptions::default())?;
/// assert_eq!(sampled.volume.particles.len(), 120);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// The errors of [`volume`].
pub fn grid(
    dims: [usize; 3],
    nodes: impl Into<Vec<DVec3>>,
    values: impl Into<Values>,
    options: &SampleOptions,
) -> Result<Sampled> {
    let nodes = nodes.into();
    let blocks = vec![CurvilinearBlock { dims, nodes }];
    in_memory("grid", Geometry::Curvilinear { blocks }, values, options)
}

/// Makes a point volume of points in memory with one value each and no shape. The distances to neighbours set
/// the sizes of kernels, as [`volume`] does for a table.
///
/// ```
/// use ewa_splat::sample::{SampleOptions, points};
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// let spiral = |i| {
///     let turn = 0.3 * f64::from(i);
///     DVec3::new(turn.cos(), turn.sin(), 0.03 * turn)
/// };
/// let positions: Vec<DVec3> = (0..200).map(spiral).collect();
/// let values: Vec<f32> = (0..200).map(|i| i as f32).collect();
/// let sampled = points(positions, values, &SampleOptions::default())?;
/// assert_eq!(sampled.volume.particles.len(), 200);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// The errors of [`volume`].
pub fn points(
    positions: impl Into<Vec<DVec3>>,
    values: impl Into<Values>,
    options: &SampleOptions,
) -> Result<Sampled> {
    let positions = positions.into();
    in_memory("points", Geometry::Points { positions }, values, options)
}

fn in_memory(
    name: &'static str,
    geometry: Geometry,
    values: impl Into<Values>,
    options: &SampleOptions,
) -> Result<Sampled> {
    let field = Field {
        name: "value".into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(values.into()),
        unit: None,
    };
    volume(
        Dataset::new(Path::new(name), name, geometry, vec![field]),
        options,
    )
}

/// Least memory \[bytes\] per node of a curvilinear grid or of cells during sampling and sorting, beyond the
/// data read. Measured with local models: three million nodes, 28 bytes each once read, take 179 bytes each at
/// the peak.
pub(crate) const LEAST_PER_NODE: usize = 60;

/// The field to show and its values, taken out of the data set.
pub(crate) struct TakenScalar {
    pub(crate) name: String,
    pub(crate) association: Association,
    pub(crate) values: Values,
}

/// Takes the scalar of a selector ([`Dataset::scalar`]); moves it if the data set stores it.
pub(crate) fn take_scalar(dataset: &mut Dataset, selector: &str) -> Result<TakenScalar> {
    let whole = match dataset.selected(selector) {
        Some((field, None)) => {
            let mut fields = dataset.fields.iter();
            fields.position(|other| std::ptr::eq(other, field))
        }
        _ => None,
    };
    let stored = whole.and_then(|i| match &mut dataset.fields[i] {
        Field {
            association,
            source: FieldSource::Scalar(values),
            ..
        } => Some((*association, values)),
        _ => None,
    });
    let (association, values) = match stored {
        Some((association, values)) => (
            association,
            std::mem::replace(values, Values::U8(Vec::new())),
        ),
        None => dataset.scalar(selector)?,
    };
    Ok(TakenScalar {
        name: selector.to_owned(),
        association,
        values,
    })
}

/// Checks that there is one value per sample.
pub(crate) fn check_len(dataset: &Dataset, taken: &TakenScalar, expected: usize) -> Result<()> {
    if taken.values.len() == expected {
        return Ok(());
    }
    Err(Error::format(
        &dataset.path,
        format!("field `{}`", taken.name),
        format!("{expected} values"),
        format!("{} values", taken.values.len()),
        "the file is damaged",
    ))
}

/// Returns the error for a data set without anything to draw.
pub(crate) fn nothing_left(path: &Path, report: &SampleReport) -> Error {
    let found = report.warnings().join(", ");
    Error::format(
        path,
        "samples",
        "at least one that can be drawn",
        if found.is_empty() {
            "none".into()
        } else {
            found
        },
        Hint::LookAtFile,
    )
}

/// Maps values for taking differences of them: 64-bit values on a scale that keeps small differences.
fn differences(values: &Values) -> Cow<'_, Values> {
    let is_wide = matches!(values, Values::F64(_));
    let range = values.finite_range().filter(|_| is_wide);
    ValueScale::of_differences(range, is_wide).seen(values)
}

/// Returns the values' positions on the scale of the transfer function, and the function, chosen by the
/// options.
///
/// - `sample`: returns the values from which an automatic function is chosen. The report keeps them if the
///   options say so.
/// - `mean_spacing`: the unit distance if the options state none.
fn under_function(
    values: Values,
    sample: impl FnOnce(&Values) -> ValueSample,
    mean_spacing: f64,
    report: &mut SampleReport,
    options: &SampleOptions,
) -> Result<(Values, TransferFunction)> {
    report.value_range = values.finite_range();
    let function = function_of(|| sample(&values), mean_spacing, report, options)?;
    Ok((function.value_scale().positions(values), function))
}

/// Returns the transfer function that the options choose, for values whose range is in the report.
fn function_of(
    sample: impl FnOnce() -> ValueSample,
    mean_spacing: f64,
    report: &mut SampleReport,
    options: &SampleOptions,
) -> Result<TransferFunction> {
    let unit_distance = options.unit_distance.unwrap_or(mean_spacing);
    if options.for_columns {
        let function = summed_function(report.value_range, unit_distance)?;
        report.unit_distance = unit_distance;
        return Ok(function);
    }
    let of_own = |colour_map: Option<&str>, report: &mut SampleReport| {
        let automatic = AutomaticOptions {
            colour_map,
            range: options.range,
            scale: options.scale,
            unit_distance,
        };
        let sample = sample();
        let function = TransferFunction::automatic(&sample, &automatic);
        report.value_sample = options.keeps_value_sample.then_some(sample);
        function
    };
    let restated = |function: TransferFunction| match options.unit_distance {
        Some(length) => function.with_unit_distance(length),
        None => Ok(function),
    };
    let function = match &options.transfer {
        TransferChoice::Automatic => of_own(None, report),
        TransferChoice::Named(name) => of_own(Some(name), report),
        TransferChoice::Given(function) | TransferChoice::Shared(function) => {
            restated(function.clone())
        }
        TransferChoice::File(_) | TransferChoice::Text(_) => {
            let range = report.value_range.unwrap_or([0.0, 1.0]);
            let read = function_of_file(options, range, unit_distance)?;
            // A preset that spans 0 to 1 is meant to be stretched.
            if let (Some([from, to]), None) = (read.stretched, options.range)
                && [from, to] != [0.0, 1.0]
            {
                let [lo, hi] = range;
                let reason = format!(
                    "of values from {from} to {to}, stretched over the data's, {lo} to {hi} (a range or opacities say otherwise)"
                );
                report.findings.push(Finding {
                    count: 1,
                    noun: "colour map".into(),
                    reason: reason.into(),
                    left_out: false,
                });
            }
            restated(read.function)
        }
    }?;
    let unit_distance = function.unit_distance() / options.opacity_scale;
    let function = function.with_unit_distance(unit_distance)?;
    report.unit_distance = unit_distance;
    Ok(function)
}

/// Reads the transfer function of a file or text.
///
/// - `range`: the range over which a preset is stretched unless the options state one.
///
/// # Errors
/// A file that cannot be read; a scale in the options; a range in the options for a function that has its own.
pub(crate) fn function_of_file(
    options: &SampleOptions,
    range: [f64; 2],
    unit_distance: f64,
) -> Result<FileFunction> {
    let fault = |place: &str, own: &str| {
        Error::invalid(
            "transfer function",
            place,
            "an automatic transfer function, or a named colour map",
            format!("a file, which has {own} of its own"),
            format!("change the file, or leave the {place} out"),
        )
    };
    let is_scaled = |scale: ScaleName| scale != ScaleName::Linear;
    if options.scale.is_some_and(is_scaled) {
        return Err(fault("scale", "a scale"));
    }
    let text;
    let (path, text) = match &options.transfer {
        TransferChoice::File(path) => {
            text = std::fs::read_to_string(path).map_err(|e| {
                Error::io(path, "opening", e, "name a transfer function that exists")
            })?;
            (path.as_path(), text.as_str())
        }
        TransferChoice::Text(text) => (Path::new("transfer function"), text.as_str()),
        _ => unreachable!("the caller looks"),
    };
    let defaults = TransferDefaults {
        range: options.range.unwrap_or(range).map(narrowed),
        unit_distance,
    };
    let read = TransferFunction::from_file(path, text, &defaults)?;
    match options.range.is_some() && read.stretched.is_none() {
        true => Err(fault("range", "a range")),
        false => Ok(read),
    }
}

/// Returns a volume whose strength and colour are to be classified from `values`, without a function yet.
fn unclassified(particles: Particles, volumes: Vec<f32>, values: Values) -> PointVolume {
    PointVolume {
        colour: Colour::Classified,
        values: Some(values),
        ..PointVolume::new(particles, Strength::Classified { volumes })
    }
}

/// Returns a volume whose strength and colour are classified from `values`.
fn classified(
    particles: Particles,
    volumes: Vec<f32>,
    values: Values,
    mut report: SampleReport,
    (mean_spacing, surroundings): (f64, Surroundings),
    options: &SampleOptions,
) -> Result<Sampled> {
    let sample = |values: &Values| match &particles {
        Particles::Lattice { lattice, .. } => {
            let spacing = options.unit_distance.unwrap_or(mean_spacing);
            ValueSample::of_lattice(values, lattice, spacing)
        }
        _ => ValueSample::of_cells(values, &volumes, particles.positions(), surroundings),
    };
    let (values, transfer_function) =
        under_function(values, sample, mean_spacing, &mut report, options)?;
    report.particle_count = particles.len();
    Ok(Sampled {
        volume: PointVolume {
            transfer_function: Some(transfer_function),
            ..unclassified(particles, volumes, values)
        },
        report,
    })
}

impl SampleOptions {
    /// Returns true if a boundary is sharp whatever the transfer function shows there.
    pub(crate) fn is_sharp_anyway(&self) -> bool {
        self.boundary == BoundaryChoice::Sharp
    }

    /// Returns true if a boundary may be sharp under these options.
    pub(crate) fn is_sharp(&self) -> bool {
        let is_wanted = match self.boundary {
            BoundaryChoice::Sharp => true,
            BoundaryChoice::Automatic => !self.for_columns,
            BoundaryChoice::Soft => false,
        };
        is_wanted && self.flatten.is_none() && self.shepard_passes == 0
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
        self.boundary == BoundaryChoice::Sharp
            || on_boundary.any(|i| transfer.classify(values.get(i))[3] > least)
    }
}

/// Returns a volume of `kernels` whose strength and colour are classified from the kept ones of `values`.
fn classified_kernels(
    kernels: Kernels,
    values: Values,
    report: SampleReport,
    surroundings: Surroundings,
    options: &SampleOptions,
) -> Result<Sampled> {
    let mean_spacing = kernels.mean_spacing();
    let values = keep(values, &kernels.kept);
    let particles = Particles::Anisotropic {
        positions: kernels.positions,
        factors: kernels.factors,
    };
    classified(
        particles,
        kernels.volumes,
        values,
        report,
        (mean_spacing, surroundings),
        options,
    )
}

/// Returns the values of the kept samples; moves them if all are kept.
fn keep(values: Values, kept: &[u32]) -> Values {
    if kept.len() == values.len() {
        values
    } else {
        values.gather(kept)
    }
}

/// Narrows an index for [`Values::gather`]. Data sets of 2³² samples or more are refused before.
#[expect(
    clippy::cast_possible_truncation,
    reason = "sample counts are checked against u32 first"
)]
fn index_u32(i: usize) -> u32 {
    i as u32
}

/// Checks that there is at least one sample and fewer than 2³².
pub(crate) fn check_count(dataset: &Dataset, count: usize) -> Result<()> {
    if count == 0 || u32::try_from(count).is_err() {
        return Err(Error::format(
            &dataset.path,
            "samples",
            "between 1 and 2^32 - 1 samples",
            count.to_string(),
            match count {
                0 => Advice::no_data("the file holds no data: save another"),
                _ => "split the data set".into(),
            },
        ));
    }
    Ok(())
}
