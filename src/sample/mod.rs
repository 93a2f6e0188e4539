//! From a data set and a field to a point volume: kernels whose shapes follow the local
//! spacing, and cell volumes that add up to the volume of the grid. Splats come with their shapes.

mod cells;
#[cfg(feature = "cli")]
mod cells_apart;
mod choice;
mod convert;
mod covered;
mod curvilinear;
#[cfg(feature = "cli")]
mod curvilinear_apart;
mod cut_faces;
mod discs;
mod doubts;
mod duals;
mod even;
mod even_grid;
mod factor;
mod fit;
mod flat_grid;
mod gradient;
mod hull;
mod incidence;
mod iso_surface;
mod kernel_sums;
mod kernels;
mod lattice;
mod left_out;
mod levels;
mod local_models;
pub mod mesh;
mod mesh_field;
mod neighbours;
mod overlap;
mod picked;
mod points;
mod positions;
#[cfg(feature = "cli")]
mod reach;
mod report;
mod rest;
mod seam;
mod sharp;
mod sharp_cells;
mod shepard;
mod sph;
mod splats;
mod statistics;
mod structured;
mod together;
mod window;
mod yu_turk;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{Advice, Error, Hint, Parameter, Place, Result};
#[cfg(feature = "prepared")]
use crate::io::ColourNumbers;
use crate::io::{
    Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry, LengthMeaning, SphKernel,
    is_of_higher_order, to_first_order,
};
#[cfg(feature = "prepared")]
use crate::math::ExactSum;
use crate::scene::{
    AutomaticOptions, Colour, FileFunction, Particles, PointVolume, ScaleName, Strength,
    Surroundings, TransferDefaults, TransferFunction, ValueSample, ValueScale, Values,
};
use crate::task::Task;

pub use crate::constants::DEFAULT_KERNEL_WIDTH;
use crate::constants::FAINT_SHARE;
#[cfg(feature = "cli")]
pub(crate) use cells::CellField;
#[cfg(feature = "cli")]
pub(crate) use cells_apart::CellsApart;
use choice::has_choice;
pub use choice::{FieldChoice, field_choices, shared_fields};
pub(crate) use choice::{describes_the_grid, shown_field};
pub use convert::{CLOSED_WIDTH, ConversionReport, LEAST_OPACITY, sound_splats, splat_cloud};
#[cfg(feature = "cli")]
pub(crate) use curvilinear_apart::{GridPlanes, planes_around};
pub use cut_faces::cut_faces;
pub use discs::discs;
pub use doubts::doubts;
#[cfg(feature = "cli")]
pub(crate) use duals::turned;
#[cfg(feature = "cli")]
pub(crate) use incidence::CellsAround;
use kernels::Kernels;
#[cfg(feature = "cli")]
pub(crate) use lattice::{PlaneValues, lattice_of_planes};
use mesh::{MeshOptions, SampledMesh, Spread};
#[cfg(feature = "cli")]
pub(crate) use neighbours::Elsewhere;
#[cfg(feature = "cli")]
pub(crate) use points::{
    FITTED_NEIGHBOURS, Fitted, Neighbourhoods, RowsApart, Surrounded, fit_apart, function_apart,
    sample_apart, scalars, without_spacing,
};
#[cfg(feature = "cli")]
pub(crate) use positions::{compare, is_same, sort_by_position};
#[cfg(feature = "cli")]
pub(crate) use reach::{Boxes, Leaf, Near, Reach};
pub use report::{Finding, SampleReport};
#[cfg(feature = "cli")]
pub(crate) use rest::Rest;
#[cfg(feature = "cli")]
pub(crate) use seam::{Seam, seam};
pub use statistics::{PERCENTILES, ShapeStatistics};
#[cfg(feature = "cli")]
pub(crate) use together::automatic;
pub use together::shared_functions;
#[cfg(feature = "cli")]
pub(crate) use window::Window;

/// Corrections of cell volumes at most ([`SampleOptions::shepard_passes`]).
pub const MOST_SHEPARD_PASSES: u32 = 100;

/// How far a field may be from what elements of higher order say of it, as a share of its range: two to three grey levels of a
/// transfer function over the whole range, and less than kernels err by where a field bends that much within a cell.
const ELEMENT_SLACK: f64 = 0.01;

/// What to sample, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleOptions {
    /// The scalar to show ([`Dataset::scalar`]'s selector); `None` chooses one.
    pub field: Option<String>,
    /// The scalar that is chosen where none is named, if the data have it and would show any: what data sets that are
    /// drawn together have in common ([`shared_fields`]).
    pub preferred_field: Option<String>,
    /// Standard deviation of a kernel over the local spacing; see [`DEFAULT_KERNEL_WIDTH`].
    pub kernel_width: f64,
    /// The transfer function.
    pub transfer: TransferChoice,
    /// The length \[world units\] over which opacities are stated. `None` takes the transfer
    /// function file's own, and where there is none, the mean spacing of the samples.
    pub unit_distance: Option<f64>,
    /// The range of an automatic transfer function, whether it has a colour map of its own or a named one; `None`
    /// looks at the values.
    pub range: Option<[f64; 2]>,
    /// The scale of an automatic transfer function; `None` looks at the values, as the program does. On another scale than
    /// a linear one the volume's values are no longer the data's but their positions on it
    /// ([`ValueScale`](crate::scene::ValueScale)), which functions that take the place of the sampled one must know.
    pub scale: Option<ScaleName>,
    /// What the extinction of any transfer function is multiplied by.
    pub opacity_scale: f64,
    /// What the lengths of particles mean, where the data's own convention does not hold.
    pub length: Option<LengthMeaning>,
    /// The smoothing kernel that lengths belong to, where the data's own does not hold; the cubic
    /// spline where they name none.
    pub kernel: Option<SphKernel>,
    /// One length \[world units\] for all particles instead of what the data say; a standard
    /// deviation unless `length` says otherwise.
    pub radius: Option<f64>,
    /// The shape of particles that state none.
    pub shape: ParticleShape,
    /// How many times cell volumes are corrected to reproduce a uniform field at the particles.
    /// That evens out irregular samples; it shifts mass between neighbours. At most
    /// [`MOST_SHEPARD_PASSES`].
    pub shepard_passes: u32,
    /// Whether column densities are wanted: particles with nothing but positions then show their
    /// number density itself, whose columns count particles, instead of its logarithm.
    pub for_columns: bool,
    /// Whether columns of particles are to weigh a mean: without a field that is named they are then of masses, of a
    /// density, or of the particles' number, whichever is known first.
    pub for_means: bool,
    /// A value of the field whose iso-surface is drawn, opaque, in place of the volume ([`scene`]): of each kernel over
    /// whose extent the field has it the disc in which it does, a surfel. Of lattices, grids, cells and particles
    /// with a field.
    pub flatten: Option<f64>,
    /// Whether light is to fall on the volume: then each sample gets the direction of its field's
    /// gradient ([`PointVolume::normals`]), four bytes more.
    pub normals: bool,
    /// Whether volumes that are classified by a field are to know it over each kernel's extent
    /// ([`PointVolume::local_models`]), six bytes for each particle. Lattices need none.
    pub local_models: bool,
    /// Whether the report keeps what an automatic transfer function is chosen from
    /// ([`SampleReport::value_sample`]), for one function of several data sets.
    pub keeps_value_sample: bool,
    /// How the data end: [`PointVolume::boundary`].
    pub boundary: BoundaryChoice,
    /// Meshes: how many surfels.
    pub spread: Spread,
    /// Meshes: another number gives another spread of surfels, as even.
    pub seed: u64,
    /// Is told how far the work is, and may cancel it.
    pub task: Option<Task>,
}

/// How data end at the boundary of their domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BoundaryChoice {
    /// Sharp where the transfer function shows any sample on the boundary (by more than a hundredth of its
    /// greatest extinction), otherwise soft: what is transparent there needs no cut. Soft for column
    /// densities, whose sums are those of the samples.
    Automatic,
    /// Kernels are cut at the domain ([`PointVolume::boundary`]), so that density is that of the data up to
    /// the boundary: grids of any kind with values at nodes. Other data have no boundary, and nor has
    /// what is flattened or has its volumes corrected.
    Sharp,
    /// Kernels run out beyond the domain, and density falls to half at its faces.
    #[default]
    Soft,
}

/// The shape of kernels whose particles state a length at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ParticleShape {
    /// Spheres; ellipsoids where particles without lengths are truly stretched or layered.
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

/// Where the transfer function comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum TransferChoice {
    /// From the values: [`TransferFunction::automatic`].
    Automatic,
    /// From a JSON file: [`TransferFunction::from_json`].
    File(PathBuf),
    /// From the text of such a file.
    Text(String),
    /// The same in the colours of a named map: [`AutomaticOptions::colour_map`].
    Named(String),
    /// This one; the unit distance is its own, unless the options state one.
    Given(TransferFunction),
    /// The same, chosen automatically of several data sets ([`shared_functions`]): it leaves surfaces opaque, as one that
    /// is chosen of one data set does.
    Shared(TransferFunction),
}

/// A point volume and how it came about.
#[derive(Debug, Clone)]
pub struct Sampled {
    /// The volume.
    pub volume: PointVolume,
    /// What was chosen and what was left out.
    pub report: SampleReport,
}

/// The volumes of a data set and how they came about.
#[derive(Debug, Clone)]
pub struct SampledScene {
    /// At least one; a mesh gives one for each kind of surface it has.
    pub volumes: Vec<PointVolume>,
    /// What was chosen and what was left out.
    pub report: SampleReport,
}

/// Whether [`scene`] makes surfels of a data set: of a mesh, and of grids of one layer.
pub fn is_surface(dataset: &Dataset) -> bool {
    matches!(dataset.geometry, Geometry::Mesh(_)) || flat_grid::is_flat(dataset)
}

/// Turns a data set into the mesh of which [`scene`] makes surfels: grids of one layer, and the outside of cells without any
/// field. Other data sets stay as they are.
///
/// # Errors
/// The errors of [`Dataset::validate`]; fields that state hidden cells or nodes and cannot be read.
pub fn as_surface(dataset: Dataset, options: &SampleOptions) -> Result<Dataset> {
    // Column densities are sums of values, which a layer of kernels has.
    if options.for_columns {
        return Ok(dataset);
    }
    let is_of_cells = matches!(dataset.geometry, Geometry::Cells(_));
    match is_of_cells && options.field.is_none() && !has_choice(&dataset) {
        true => hull::as_mesh(dataset),
        false => flat_grid::as_surface(dataset),
    }
}

/// The report of [`scene`] on the values of a mesh, without its surfels: the field, its unit, and the sample from which an
/// automatic function is chosen. It is empty if the mesh shows no field.
///
/// # Errors
/// A field that is not there or has the wrong length; a transfer function that cannot be read.
pub fn surface_report(dataset: &Dataset, options: &SampleOptions) -> Result<SampleReport> {
    match mesh_field::shown(dataset, options)? {
        Some(field) => mesh_field::report(dataset, &field, options),
        None => Ok(SampleReport::default()),
    }
}

/// Makes what is drawn of any data set: surfels of a mesh ([`mesh::surfels`]), the one point volume
/// of all others ([`volume`]).
///
/// Surfaces show a field by a transfer function where one is named, or where they have no colours of their own: each surfel
/// has a value, the mean over its part of the surface. An automatic function, or a named colour map, leaves the surface
/// opaque; another gives its opacities, too. Grids of one layer are surfaces.
///
/// # Errors
/// Those of the two.
pub fn scene(dataset: Dataset, options: &SampleOptions) -> Result<SampledScene> {
    let dataset = as_surface(dataset, options)?;
    let Geometry::Mesh(mesh) = &dataset.geometry else {
        let path = dataset.path.clone();
        let Sampled { mut volume, report } = volume(dataset, options)?;
        if let Some(value) = options.flatten {
            let surface = iso_surface::iso_surface(&volume, value, options.task.as_ref());
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
    if let Some(field) = mesh_field::shown(&dataset, options)? {
        let path = dataset.path.clone();
        let unit = dataset.unit(&field).map(str::to_owned);
        let scene = mesh_field::scene(dataset, &field, &mesh_options, options);
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

/// An error of the mesh itself with the name of its file.
fn named(error: Error, file: &Path) -> Error {
    match error {
        Error::Invalid {
            what: Place::Text(ref what),
            ..
        } if **what == *mesh::THE_MESH => error.in_file(file),
        other => other,
    }
}

/// Makes a point volume of a data set; values are moved, not copied, and keep their type.
///
/// - A lattice stays a lattice: no positions are stored. Cell values become a lattice of cell
///   centres.
/// - A curvilinear grid gives one anisotropic kernel per node (or cell): variance
///   kernel_width² F Fᵀ with F = ∂x/∂(i, j, k), volume that of its part of the grid.
/// - An unstructured grid gives one anisotropic kernel per node, from its share of the cells around
///   it, or one per cell.
/// - Points take shape, strength and colour from their columns: `sigma` | `radius` | `h` |
///   `vxx,vxy,vxz,vyy,vyz,vzz` | `scale_0..2,rot_0..3`, or what [`Dataset::smoothing`] names;
///   `mass` | `extinction` with `volume` | `opacity` | a scalar with a transfer function, whose
///   volumes are `volume` or `m` over `rho`; `r,g,b`. Without shape columns kernels are spheres
///   sized by the distances to the nearest neighbours, or discs where the points make up a surface; where nothing is known but
///   colours, they are opaque.
/// - Splats keep their shapes, opacities and colours, and their format's own rule of drawing;
///   a named field replaces the colours. [`Blend`](crate::render::Blend) says in which space their colours
///   are composited.
///
/// With no field named, PLOT3D data and particles show their density, others their first scalar that
/// is not constant, nodes before cells; particles with neither lengths nor densities show how
/// densely they lie.
///
/// [`crate::irregular`] has the formulas, with how evenly each draws a uniform field.
///
/// Samples that cannot be drawn (positions, values or shapes that are not finite, cells
/// without volume, blanked nodes) are left out and counted in the report; on a lattice a value
/// that is not finite stays and is transparent if NaN.
///
/// # Errors
/// Those of [`Dataset::validate`]; a field that is not there or has the wrong length, no samples or none that can be drawn,
/// columns that contradict each other, a kernel width that is not positive, a transfer
/// function that cannot be read; work that was cancelled.
pub fn volume(dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    check_options(options)?;
    dataset.validate()?;
    // Nothing of the data set is left when its field is known.
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
        shepard::even_out(&mut sampled.volume, options.shepard_passes, task)?;
    }
    if options.normals {
        gradient::complete(&mut sampled.volume, options.task.as_ref())?;
    }
    local_models::complete(&mut sampled.volume, options)?;
    Ok(sampled)
}

/// Refuses a width of kernels that is none.
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

/// What is made of points of which each becomes a particle of its own row alone, so that some of the rows of a data set
/// give some of its volume's particles.
#[cfg(feature = "prepared")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum OfRows {
    /// They state shapes and strengths, and show no field.
    Stated,
    /// Column densities sum this field of smoothed particles.
    Summed(String),
}

/// What is made of some rows of a data set; `None` where a particle depends on others than its own row.
#[cfg(feature = "prepared")]
pub(crate) fn of_rows(dataset: &Dataset, options: &SampleOptions) -> Option<OfRows> {
    let is_alone = options.flatten.is_none() && options.shepard_passes == 0 && !options.normals;
    points::kind_of_rows(dataset, options).filter(|_| is_alone)
}

/// The numbers of the colours of some rows of such a data set, from which with those of all others follows how they are
/// stored; `None` where that depends on no numbers.
///
/// # Errors
/// Columns of another length.
#[cfg(feature = "prepared")]
pub(crate) fn colour_numbers(dataset: &Dataset) -> Result<Option<ColourNumbers>> {
    points::colour_numbers(dataset)
}

/// The same as [`volume`] of some of the rows of such a data set, of which none may be left, but for the function of those
/// that column densities sum ([`summed_function`]).
///
/// - `colours`: of all rows ([`colour_numbers`]).
/// - `volume_sum`: of the particles before them, and then of these too \[length³\].
///
/// # Errors
/// Those of [`volume`].
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

/// The length of a cube of the mean volume of particles; 1 where these have none.
pub(crate) fn mean_spacing(volume_sum: f64, count: usize) -> f64 {
    let spacing = Some((volume_sum / count as f64).cbrt());
    spacing.filter(|s| *s > 0.0).unwrap_or(1.0)
}

/// The function of values of which column densities are sums, which classify nothing.
///
/// - `range`: of the values.
///
/// # Errors
/// A range or a distance that is none.
pub(crate) fn summed_function(
    range: Option<[f64; 2]>,
    unit_distance: f64,
) -> Result<TransferFunction> {
    let range = range.unwrap_or([0.0, 1.0]).map(narrowed);
    TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, range, unit_distance)
}

/// A point volume of a curvilinear grid in memory, as [`volume`] makes it of a file's.
///
/// - `dims`: nodes along i, j and k.
/// - `nodes`: their positions, i fastest, then j, then k.
/// - `values`: one for each node.
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
/// As [`volume`].
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

/// A point volume of points in memory that have a value each and no shape: kernels are sized by
/// their neighbours, as [`volume`] makes them of a table.
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
/// As [`volume`].
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

/// Bytes that a node of a curvilinear grid or of cells takes at the least while it is sampled and sorted, beyond what was
/// read: three million nodes, 28 bytes each once they are read, take 179 at the peak, with local models.
#[cfg(feature = "cli")]
pub(crate) const LEAST_PER_NODE: usize = 60;

/// The field to show and its values, taken out of the data set.
pub(crate) struct TakenScalar {
    pub(crate) name: String,
    pub(crate) association: Association,
    pub(crate) values: Values,
}

/// The scalar of a selector ([`Dataset::scalar`]); moved where the data set stores it.
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

/// A value per sample, or the error that says so.
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

/// The error for a data set without anything to draw.
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

/// Values as differences are taken of them.
fn differences(values: &Values) -> Cow<'_, Values> {
    let is_wide = matches!(values, Values::F64(_));
    let range = values.finite_range().filter(|_| is_wide);
    ValueScale::of_differences(range, is_wide).seen(values)
}

/// The values' positions on the scale of the transfer function that is asked for, with the function.
///
/// - `sample`: what an automatic one is chosen from, noted in the report if that is wanted.
/// - `mean_spacing`: stands in for the unit distance.
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

/// The transfer function that is asked for, of values whose range the report has.
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
            // A preset from 0 to 1 is made to be stretched.
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

/// The transfer function of a file or text.
///
/// - `range`: what a preset is stretched over, unless the options state a range.
///
/// # Errors
/// A file that cannot be read; a scale, or a range of a function that has its own.
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

/// A volume whose strength and colour are to be classified from `values`, without a function.
fn unclassified(particles: Particles, volumes: Vec<f32>, values: Values) -> PointVolume {
    PointVolume {
        particles,
        strength: Strength::Classified { volumes },
        colour: Colour::Classified,
        values: Some(values),
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// A volume whose strength and colour are classified from `values`.
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
    /// Whether the boundary of what has one is sharp, whatever the transfer function shows there.
    pub(crate) fn is_sharp_anyway(&self) -> bool {
        self.boundary == BoundaryChoice::Sharp
    }

    /// Whether the boundary of what has one is to be sharp.
    pub(crate) fn is_sharp(&self) -> bool {
        let is_wanted = match self.boundary {
            BoundaryChoice::Sharp => true,
            BoundaryChoice::Automatic => !self.for_columns,
            BoundaryChoice::Soft => false,
        };
        is_wanted && self.flatten.is_none() && self.shepard_passes == 0
    }

    /// Whether that of a volume is, of whose samples these lie on it.
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

/// A volume of `kernels` whose strength and colour are classified from the kept ones of `values`.
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

/// The values of the kept samples: moved where all are kept in order.
fn keep(values: Values, kept: &[u32]) -> Values {
    if kept.len() == values.len() {
        values
    } else {
        values.gather(kept)
    }
}

/// An index for [`Values::gather`]. Data sets of 2³² samples are refused before.
#[expect(
    clippy::cast_possible_truncation,
    reason = "sample counts are checked against u32 first"
)]
fn index_u32(i: usize) -> u32 {
    i as u32
}

/// At least one sample and fewer than 2³².
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

/// To single precision; too great or too small numbers become infinite or zero, which their
/// callers count and leave out.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
fn narrowed(x: f64) -> f32 {
    x as f32
}
