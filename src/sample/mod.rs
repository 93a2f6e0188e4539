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
//! Further modules serve several kinds of data:
//!
//! - `options` and `report` define what is asked and what is found; `scalar` takes the field that is shown.
//! - `field` chooses the field to show (`choice`), and one transfer function for several data sets (`together`). It
//!   computes normals for shading (`gradient`), and models of the field over each kernel (`local_models`). `function`
//!   makes volumes that a transfer function shows.
//! - `curvilinear::sharp` and `cells::sharp` cut kernels at the boundary of the data and add ghosts beyond it.
//!   `kernels::even` and `curvilinear::even_grid` then correct the volumes. `kernels::levels` and `points::shepard`
//!   correct volumes elsewhere.
//! - `surface` and `splats::convert` make surfels and splats.
//! - `curvilinear::partitioned`, `cells::partitioned` and `points::partitioned` sample data that are partitioned over
//!   ranks. A rank makes kernels for its own samples (`own`); neighbouring samples are ghosts.

pub(crate) mod cells;
pub(crate) mod curvilinear;
pub(crate) mod field;
mod function;
pub(crate) mod kernels;
mod lattice;
mod left_out;
pub mod mesh;
mod options;
mod own;
mod pairs;
pub(crate) mod points;
mod positions;
pub(crate) mod refine;
mod report;
mod sampled;
mod scalar;
pub(crate) mod splats;
pub(crate) mod surface;

use crate::data::association::Association;
use std::path::Path;

use glam::DVec3;

#[cfg(feature = "prepared")]
use crate::data::colour_columns::ColourNumbers;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::data::first_order::{is_of_higher_order, to_first_order};
use crate::error::{Error, Place, Result};
#[cfg(feature = "prepared")]
use crate::math::ExactSum;
use crate::scene::{Particles, Values};

pub(crate) use self::cells::duals::turned;
pub(crate) use self::cells::incidence::CellsAround;
pub(crate) use self::cells::partitioned::PartitionedCells;
pub(crate) use self::cells::{may_be_refined, may_refine};
pub(crate) use self::curvilinear::partitioned::{GridPlanes, planes_around};
pub(crate) use self::curvilinear::seam::{Seam, seam};
pub(crate) use self::curvilinear::window::Window;
use self::field::choice::has_choice;
pub(crate) use self::field::choice::shown_field;
pub use self::field::choice::{field_choices, shared_fields};
pub use self::field::field_choice::FieldChoice;
pub use self::field::statistics::{PERCENTILES, ShapeStatistics};
#[cfg(feature = "prepared")]
pub(crate) use self::field::together::automatic;
pub use self::field::together::shared_functions;
#[cfg(feature = "prepared")]
pub(crate) use self::function::function_of_file;
#[cfg(feature = "prepared")]
pub(crate) use self::function::summed_function;
use self::options::check_options;
pub use self::options::{
    BoundaryChoice, FunctionOptions, KernelOptions, MOST_SHEPARD_PASSES, MeanPart, ParticleShape,
    PurposeOptions, SampleOptions, TransferChoice,
};
pub use self::points::accuracy_warnings::accuracy_warnings;
pub(crate) use self::points::neighbours::Remote;
pub(crate) use self::points::reach::{Boxes, Leaf, Near, Reach};
pub use self::refine::Refinement;
pub use self::sampled::Sampled;
pub use self::sampled::SampledScene;
pub(crate) use self::scalar::LEAST_PER_NODE;
pub(crate) use self::scalar::check_count;
pub(crate) use self::scalar::check_len;
pub(crate) use self::scalar::nothing_left;
pub(crate) use self::scalar::take_scalar;
pub use self::splats::convert::{ConversionReport, LEAST_OPACITY, sound_splats, splat_cloud};
pub use self::splats::fewer::fewer_splats;
pub use self::surface::cut_faces::cut_faces;
pub use self::surface::discs::discs;
pub use crate::constants::DEFAULT_KERNEL_WIDTH;
pub(crate) use cells::CellField;
pub(crate) use lattice::{PlaneValues, lattice_of_planes};
use mesh::{MeshOptions, SampledMesh};
#[cfg(feature = "prepared")]
pub(crate) use points::OfRows;
pub use points::periodic::PeriodicBox;
pub use points::streaks::Motion;
pub(crate) use points::{
    FITTED_NEIGHBOURS, Fitted, Neighbourhoods, PartitionedRows, Surrounded, fit_partition,
    function_of_all, sample_partition, scalars, without_spacing,
};
#[cfg(feature = "cli")]
pub(crate) use positions::index_u32;
pub(crate) use positions::{compare, is_same, mean_spacing, sort_by_position};
pub(crate) use report::Found;
pub use report::{Finding, SampleReport, common_smoothing};

/// Greatest error of a field on cells of higher order once they are cut into cells of first order, as a share
/// of the field's range. It is two to three grey levels of a transfer function over the whole range. Kernels
/// err by more where a field bends that much within a cell.
const ELEMENT_SLACK: f64 = 0.01;

/// Returns true if [`scene`] makes surfels of a data set by default: a mesh or a grid of one layer.
pub fn is_surface(dataset: &Dataset) -> bool {
    matches!(dataset.geometry, Geometry::Mesh(_)) || self::surface::flat_grid::is_flat(dataset)
}

/// Returns true if [`scene`] draws the outside of cells, which have no field to show.
pub(crate) fn shows_outside(dataset: &Dataset, options: &SampleOptions) -> bool {
    let is_of_cells = matches!(dataset.geometry, Geometry::Cells(_));
    is_of_cells && options.field.is_none() && !has_choice(dataset)
}

/// Turns a grid of one layer, or cells without any field, into a mesh, of which [`scene`] makes surfels. Cells
/// become their outer surface. If the options ask for the boundary ([`SampleOptions::surface`]), a grid of any kind
/// becomes its boundary. Other data sets are returned unchanged.
///
/// # Errors
/// A boundary of data without cells, or in column densities; the errors of [`Dataset::validate`]; fields that state hidden cells or nodes and cannot be read.
pub fn as_surface(dataset: Dataset, options: &SampleOptions) -> Result<Dataset> {
    if let Some(opacity) = options.surface {
        return self::surface::boundary::as_mesh(dataset, opacity, options);
    }
    // Column densities are sums of values, and a layer of kernels has values.
    if options.purpose.for_columns {
        return Ok(dataset);
    }
    match shows_outside(&dataset, options) {
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
/// the surface opaque; other functions set its opacity, too. The boundary of a grid has the opacity of the options
/// ([`SampleOptions::surface`]) under any function.
///
/// # Errors
/// The errors of [`mesh::surfels`] and of [`volume`].
pub fn scene(dataset: Dataset, options: &SampleOptions) -> Result<SampledScene> {
    check_points(&dataset, options)?;
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
        spread: options.kernels.spread,
        kernel_width: options.kernels.composited.unwrap_or(options.kernels.width),
        composited: options.kernels.composited.is_some(),
        seed: options.kernels.seed,
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
    self::surface::boundary::check_colours(&dataset, options)?;
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
    check_points(&dataset, options)?;
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
    let (mut groups, mut ways) = (None, Vec::new());
    let mut sampled = match &dataset.geometry {
        Geometry::Lattice(_) => lattice::volume(dataset, options),
        Geometry::Curvilinear { .. } => curvilinear::volume(dataset, options),
        Geometry::Cells(_) => cells::volume(dataset, options),
        Geometry::Points { .. } => {
            points::volume(dataset, options).map(|(sampled, own, own_ways)| {
                (groups, ways) = (own, own_ways);
                sampled
            })
        }
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
    if options.kernels.shepard_passes > 0 {
        let task = options.task.as_ref();
        let passes = options.kernels.shepard_passes;
        self::points::shepard::even_out(&mut sampled.volume, &mut groups, passes, task)?;
    }
    if options.purpose.normals {
        self::field::gradient::complete(&mut sampled.volume, &mut groups, options.task.as_ref())?;
    }
    self::field::local_models::complete(&mut sampled.volume, groups, options)?;
    if options.motion.is_some() {
        self::points::streaks::draw_out(&mut sampled, &ways)?;
        if let (Some(periodic), Particles::Anisotropic { positions, .. }) =
            (&options.periodic, &mut sampled.volume.particles)
        {
            self::points::periodic::wrap(positions, periodic);
        }
    }
    if let Some(periodic) = &options.periodic {
        self::points::periodic::add_images(&mut sampled, periodic)?;
    }
    Ok(sampled)
}

/// Refuses a periodic box that has no volume, and a box or a motion of other data than particles.
fn check_points(dataset: &Dataset, options: &SampleOptions) -> Result<()> {
    if let Some(motion) = &options.motion {
        let refuse = |place: &'static str, expected: &str, found: &str| {
            let advice = "leave the shutter out";
            Err(Error::format(&dataset.path, place, expected, found, advice))
        };
        if !matches!(dataset.geometry, Geometry::Points { .. }) {
            return refuse("velocity", "particles, which move", "other data");
        }
        if options.makes_surface() {
            return refuse("velocity", "a volume", "a surface");
        }
        if !(motion.time > 0.0 && motion.time.is_finite()) {
            let found = motion.time.to_string();
            return refuse("shutter", "a finite number above 0", &found);
        }
    }
    let Some(periodic) = &options.periodic else {
        return Ok(());
    };
    periodic.check()?;
    match dataset.geometry {
        Geometry::Points { .. } => Ok(()),
        _ => Err(Error::format(
            &dataset.path,
            "periodic box",
            "particles",
            "other data",
            "leave the box out",
        )),
    }
}

/// Returns the kind of particles if each depends on its own row alone; otherwise `None`.
#[cfg(feature = "prepared")]
pub(crate) fn of_rows(dataset: &Dataset, options: &SampleOptions) -> Option<OfRows> {
    let is_alone =
        !options.makes_surface() && options.kernels.shepard_passes == 0 && !options.purpose.normals;
    points::kind_of_rows(dataset, options).filter(|_| is_alone)
}

/// Returns the facts about the colours of some rows (whole numbers, greatest number) that determine how colours are
/// scaled. The scale follows from the facts about all rows. Returns `None` if the type of the columns determines
/// it alone.
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
/// - `volume_sum`: total volume of the preceding particles, to which the volumes of these are added \[length³\].
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
