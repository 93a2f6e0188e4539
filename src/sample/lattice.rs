//! Samples regular and rectilinear lattices.

use glam::DVec3;

use super::curvilinear::sharp::face_nodes;
use super::left_out::LeftOut;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::error::Result;
use crate::sample::field::choice::shown_field;
use crate::sample::field::gradient::Samples;
use crate::sample::function::classified;
use crate::sample::options::{FunctionOptions, SampleOptions, TransferChoice};
use crate::sample::refine;
use crate::sample::refine::Refinement;
use crate::sample::refine::rule::ShownValues;
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::sample::scalar::{check_count, check_len, take_scalar};
use crate::scene::{Boundary, LONE_CELL_WIDTH, Lattice, LatticeSpacing, Particles, Surroundings};
use crate::scene::{Colour, PointVolume, Strength, ValueSample, Values};

const NOT_FINITE: &str =
    "not finite; NaN is drawn as transparent, infinity as the end of the range";

/// Least memory \[bytes\] per node that a lattice takes as a curvilinear grid.
const LEAST_PER_GRID_NODE: u64 = 100;

/// Turns a lattice with hidden cells or nodes into a curvilinear grid, if the values belong to nodes. Each node
/// of the grid has the part of its cells that is not hidden. Other data sets are returned unchanged. A lattice
/// stays whole if memory does not suffice for the grid: nodes beside hidden cells then reach half a cell too
/// far.
///
/// # Errors
/// Arrays that state hidden cells or nodes and cannot be read.
pub(super) fn without_hidden(mut dataset: Dataset, options: &SampleOptions) -> Result<Dataset> {
    let Geometry::Lattice(lattice) = &dataset.geometry else {
        return Ok(dataset);
    };
    let is_solid = lattice.dims.iter().all(|&n| n > 1);
    let has_told = |field: &Field| Blanking::is_told_by(&field.name);
    if !is_solid || !dataset.fields.iter().any(has_told) {
        return Ok(dataset);
    }
    let name = shown_field(&dataset, options)?;
    let is_of_nodes = dataset
        .selected(&name)
        .is_none_or(|(field, _)| field.association == Association::Nodes);
    let count = lattice.len();
    if !is_of_nodes
        || !Blanking::of(&dataset)?.hides_any()
        || crate::memory::no_room(count as u64 * LEAST_PER_GRID_NODE).is_some()
    {
        return Ok(dataset);
    }
    let blocks = vec![CurvilinearBlock::of_lattice(lattice)];
    dataset.geometry = Geometry::Curvilinear { blocks };
    Ok(dataset)
}

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let blanking = Blanking::of(&dataset)?;
    let shown = shown_field(&dataset, options)?;
    let mut taken = take_scalar(&mut dataset, &shown)?;
    let Geometry::Lattice(nodes) = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let lattice = match taken.association {
        Association::Nodes => nodes.clone(),
        Association::Cells => cell_centres(nodes),
    };
    check_count(&dataset, lattice.len())?;
    check_len(&dataset, &taken, lattice.len())?;
    let mut report = SampleReport {
        field: Some(taken.name),
        sample_count: lattice.len(),
        ..SampleReport::default()
    };
    report.note(taken.values.non_finite_count(), "values", NOT_FINITE);
    let blanking = blanking.of_lattice(nodes.dims);
    let mask = blanking.mask(taken.association).unwrap_or(&[]);
    let blank = mask.iter().take(lattice.len()).filter(|blank| **blank);
    let blank_count = blank.count();
    if blank_count > 0 {
        // NaN is the only way for a lattice to leave samples out. Hidden samples are rare, so the wider type is
        // acceptable.
        let mut values: Vec<f64> = (0..lattice.len()).map(|i| taken.values.wide(i)).collect();
        for (value, _) in values.iter_mut().zip(mask).filter(|(_, blank)| **blank) {
            *value = f64::NAN;
        }
        taken.values = values.into();
        report.leave_out(blank_count, "samples", LeftOut::Blanked.reason());
    }
    let mean_spacing = mean_spacing(&lattice);
    let dims = lattice.dims;
    report.may_refine = may_refine(&lattice, taken.association);
    let refinement = options
        .refinement
        .as_ref()
        .filter(|_| report.may_refine && !taken.values.has_infinite());
    let kept = refinement.map(|_| (taken.values.clone(), lattice.clone()));
    let particles = Particles::Lattice {
        lattice,
        kernel_width: options.kernels.width,
    };
    let mut sampled = classified(
        particles,
        Vec::new(),
        taken.values,
        report,
        (mean_spacing, Surroundings::Included),
        options,
    )?;
    if let (Some(refinement), Some((values, lattice))) = (refinement, kept)
        && asks(&sampled.volume, &lattice, refinement, options)
    {
        let blocks = vec![CurvilinearBlock::of_lattice(&lattice)];
        dataset.geometry = Geometry::Curvilinear { blocks };
        return as_grid(dataset, values, sampled, options);
    }
    let may_be_sharp = options.is_sharp() && taken.association == Association::Nodes;
    if may_be_sharp && options.cuts(&sampled.volume, on_faces(dims)) {
        sampled.volume.boundary = Some(Boundary::Lattice);
    }
    Ok(sampled)
}

/// Greatest number of samples of a lattice whose kernels are refined. The spacing of larger ones is about a pixel of a
/// picture that shows them whole, and ranks read these in parts.
const MOST_REFINED: usize = 1 << 21;

/// Returns true if kernels of a lattice may be refined.
pub(crate) fn may_refine(lattice: &Lattice, association: Association) -> bool {
    let is_solid = lattice.dims.iter().all(|&n| n > 1);
    is_solid && association == Association::Nodes && lattice.len() <= MOST_REFINED
}

/// Returns true if what the pictures show of the field asks for parts of any cell.
fn asks(
    volume: &PointVolume,
    lattice: &Lattice,
    refinement: &Refinement,
    options: &SampleOptions,
) -> bool {
    let (Some(values), Some(shown)) = (&volume.values, ShownValues::new(volume, options.flatten))
    else {
        return false;
    };
    let [x, y, _] = lattice.dims;
    let samples = Samples {
        dims: lattice.dims,
        periods: [None; 3],
        at: |node: [usize; 3]| {
            let value = values.wide(node[0] + x * (node[1] + y * node[2]));
            value.is_finite().then(|| (lattice.position(node), value))
        },
    };
    refine::asks(&samples, &shown, refinement, options.kernels.width)
}

/// Samples a lattice as a curvilinear grid, whose kernels can be refined.
///
/// - `dataset`: data set with the geometry of that grid.
/// - `sampled`: the lattice's own volume, of which the function and the findings are kept.
fn as_grid(
    dataset: Dataset,
    values: Values,
    sampled: Sampled,
    options: &SampleOptions,
) -> Result<Sampled> {
    const NAME: &str = "values";
    let field = Field {
        name: NAME.into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(values),
        unit: None,
    };
    let Sampled { volume, report } = sampled;
    let function = volume.transfer_function.clone();
    drop(volume);
    let options = SampleOptions {
        field: Some(NAME.into()),
        function: FunctionOptions {
            transfer: function.map_or(TransferChoice::Automatic, TransferChoice::Given),
            ..FunctionOptions::default()
        },
        ..options.clone()
    };
    let dataset = Dataset {
        fields: vec![field],
        ..dataset
    };
    let Sampled { volume, report: of } = super::curvilinear::volume(dataset, &options)?;
    let report = SampleReport {
        particle_count: of.particle_count,
        ghost_count: of.ghost_count,
        refined_count: of.refined_count,
        refined_level: of.refined_level,
        ..report
    };
    Ok(Sampled { volume, report })
}

/// Statistics of the values of a lattice that is partitioned over ranks.
#[derive(Debug, Default)]
pub(crate) struct PlaneValues {
    /// Least and greatest finite value.
    pub(crate) range: Option<[f64; 2]>,
    /// Number of values that are not finite.
    pub(crate) not_finite: usize,
    /// The values that [`ValueSample::picked`] takes, in any order.
    pub(crate) picked: Vec<f64>,
}

/// Makes the volume of a lattice whose values at nodes are partitioned over ranks. The result is that of
/// [`volume`] without values and boundary.
pub(crate) fn lattice_of_planes(
    lattice: Lattice,
    field: &str,
    unit: Option<&str>,
    known: PlaneValues,
    options: &SampleOptions,
) -> Result<(PointVolume, SampleReport)> {
    super::check_options(options)?;
    let count = lattice.len();
    let mut report = SampleReport {
        field: Some(field.to_owned()),
        unit: unit.map(str::to_owned),
        sample_count: count,
        particle_count: count,
        value_range: known.range,
        may_refine: may_refine(&lattice, Association::Nodes),
        ..SampleReport::default()
    };
    report.note(known.not_finite, "values", NOT_FINITE);
    let mean_spacing = mean_spacing(&lattice);
    let spacing = options.function.unit_distance.unwrap_or(mean_spacing);
    let sample = || ValueSample::of_picked(&known.picked, &lattice, spacing);
    let function = super::function::function_of(sample, mean_spacing, &mut report, options)?;
    let volume = PointVolume {
        colour: Colour::Classified,
        transfer_function: Some(function),
        ..PointVolume::new(
            Particles::Lattice {
                lattice,
                kernel_width: options.kernels.width,
            },
            Strength::Classified {
                volumes: Vec::new(),
            },
        )
    };
    Ok((volume, report))
}

/// Returns the samples on the faces of a lattice, those on edges more than once. An axis of one sample has no
/// faces.
fn on_faces(dims: [usize; 3]) -> impl Iterator<Item = usize> {
    let axes = (0..3).filter(move |&a| dims[a] > 1);
    axes.flat_map(move |a| face_nodes(dims, a))
}

/// Returns the lattice of cell centres. An axis of one node has one layer of cells, at the node.
fn cell_centres(nodes: &Lattice) -> Lattice {
    let dims = nodes.dims.map(|n| n.max(2) - 1);
    let spacing = match &nodes.spacing {
        LatticeSpacing::Uniform { origin, step } => {
            let half = |n: usize| if n > 1 { 0.5 } else { 0.0 };
            let [i, j, k] = nodes.dims.map(half);
            LatticeSpacing::Uniform {
                origin: *origin + *step * DVec3::new(i, j, k),
                step: *step,
            }
        }
        LatticeSpacing::Rectilinear { coordinates } => LatticeSpacing::Rectilinear {
            coordinates: coordinates.each_ref().map(|c| match c.as_slice() {
                [one] => vec![*one],
                many => many.windows(2).map(|w| 0.5 * (w[0] + w[1])).collect(),
            }),
        },
    };
    Lattice { dims, spacing }
}

/// Returns the cube root of the mean cell volume.
fn mean_spacing(lattice: &Lattice) -> f64 {
    let volume = match &lattice.spacing {
        LatticeSpacing::Uniform { step, .. } => step.determinant().abs(),
        LatticeSpacing::Rectilinear { coordinates } => coordinates
            .iter()
            .map(|c| match c.as_slice() {
                [first, .., last] => (last - first) / (c.len() - 1) as f64,
                _ => LONE_CELL_WIDTH,
            })
            .product(),
    };
    if volume > 0.0 && volume.is_finite() {
        volume.cbrt()
    } else {
        1.0
    }
}
