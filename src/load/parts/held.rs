//! Samples data in memory of which each rank holds a part: the particles are those of the whole in one process, one
//! rank's part after another.

use std::borrow::Cow;
use std::hash::{DefaultHasher, Hash, Hasher};

use super::function::found_by_all;
use super::halo::{send, send_values};
use super::metadata::{Metadata, decode, encode};
use super::pieces::held_cells;
use super::rows::{held_rows, without_rows};
use super::scatter::scatter;
use crate::collective::Collective;
use crate::data::association::Association;
use crate::data::cells::CellMesh;
use crate::data::colour_columns::ColourNumbers;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::data::first_order::is_of_higher_order;
use crate::data::smoothing::SphKernel;
use crate::error::{Error, Result};
use crate::message::unknown;
use crate::ranks::Share;
use crate::sample::{
    Found, OfRows, PartitionedRows, PurposeOptions, SampleOptions, SampleReport, colour_numbers,
    of_rows, rows, summed_function,
};
use crate::scene::Values;

/// Samples points or cells of which each rank holds a part, as one process samples the whole. The numbers of particles
/// are those of one process.
///
/// Points whose particles depend on more than neighbours are gathered and sampled on the first rank, and scattered.
///
/// Returns `None` if the parts are sampled as data sets of their own: grids with a structure, meshes and splats; cells
/// that the ranks cannot sample together ([`read_pieces`](super::read_pieces)).
///
/// - `dataset`: this rank's part, empty or not; all are points, or all are cells, with the same fields.
///
/// # Errors
/// The errors of sampling, on any rank; other fields on other ranks; a rank that is gone.
pub(crate) fn held_together(
    dataset: &Dataset,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<Option<(Share, SampleReport)>> {
    let (mut share, report) = match &dataset.geometry {
        Geometry::Points { .. } => {
            let dataset = alike(dataset, ranks)?;
            points(&dataset, options, ranks)?
        }
        Geometry::Cells(mesh) => {
            let dataset = alike(dataset, ranks)?;
            if !are_plain(mesh, ranks)? || options.makes_surface() {
                return Ok(None);
            }
            if options.kernels.shepard_passes > 0 {
                return Ok(None);
            }
            let Some(part) = held_cells(dataset.into_owned(), options, ranks)? else {
                return Ok(None);
            };
            (part.share, part.report)
        }
        _ => return Ok(None),
    };
    if share.numbers.is_none() {
        let mut numbers = Vec::with_capacity(share.volumes.len());
        for volume in &share.volumes {
            let count = volume.particles.len() as u64;
            let first = ranks.sum_before(Ok(count))?;
            numbers.push((first..first + count).collect());
        }
        share.numbers = Some(numbers);
    }
    Ok(Some((share, report)))
}

/// Checks that all ranks have the same fields, and returns them with floating-point values in double precision where any
/// rank has them so. (Values are stored in single precision if that keeps them.)
fn alike<'a>(dataset: &'a Dataset, ranks: &mut dyn Collective) -> Result<Cow<'a, Dataset>> {
    let kinds = |field: &Field| -> Vec<&str> {
        let arrays = field.arrays();
        arrays.iter().map(Values::kind_name).collect()
    };
    let mut hasher = DefaultHasher::new();
    for field in &dataset.fields {
        (&field.name, field.association == Association::Nodes).hash(&mut hasher);
        kinds(field).hash(&mut hasher);
    }
    if let Some(rank) = ranks.first_other(hasher.finish())? {
        return Err(Error::invalid(
            "scene",
            "fields of ranks",
            "the same names and types of numbers on every rank",
            format!("others on rank {rank} than on rank 0"),
            "give every rank the same fields, empty ones to a rank without data",
        ));
    }
    let is_wide = |field: &Field| field.arrays().iter().any(|v| matches!(v, Values::F64(_)));
    let own = dataset.fields.iter().map(|field| u64::from(is_wide(field)));
    let all = ranks.sums(Ok(own.collect()))?;
    let differs = |(field, count): (&Field, &u64)| *count > 0 && !is_wide(field);
    if !dataset.fields.iter().zip(&all).any(differs) {
        return Ok(Cow::Borrowed(dataset));
    }
    let mut own = dataset.clone();
    for (field, _) in own.fields.iter_mut().zip(all).filter(|(_, n)| *n > 0) {
        match &mut field.source {
            FieldSource::Scalar(values) => *values = wide(values),
            FieldSource::Vector(all) => all.iter_mut().for_each(|values| *values = wide(values)),
            FieldSource::Derived(_) => {}
        }
    }
    Ok(Cow::Owned(own))
}

/// Returns floating-point values in double precision.
fn wide(values: &Values) -> Values {
    match values {
        Values::F32(own) => Values::F64(own.iter().copied().map(f64::from).collect()),
        other => other.clone(),
    }
}

/// Returns true if some rank has solid cells, and none has cells of higher order.
fn are_plain(mesh: &CellMesh, ranks: &mut dyn Collective) -> Result<bool> {
    let is_solid = mesh.kinds.iter().any(|kind| kind.is_solid());
    let own = [is_solid, is_of_higher_order(mesh)].map(u64::from);
    let sums = ranks.sums(Ok(own.to_vec()))?;
    Ok(sums[0] > 0 && sums[1] == 0)
}

fn points(
    dataset: &Dataset,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<(Share, SampleReport)> {
    let head = without_rows(dataset);
    if let Some(kind) = of_rows(&head, options) {
        return row_by_row(dataset, &head, kind, options, ranks);
    }
    let without_sample = SampleOptions {
        purpose: PurposeOptions {
            keeps_value_sample: false,
            ..options.purpose
        },
        ..options.clone()
    };
    match PartitionedRows::of(&head, &without_sample) {
        Some(kind) if options.preferred_field.is_none() => {
            let part = held_rows(dataset, kind, options, ranks)?;
            Ok((part.share, part.report))
        }
        _ => on_first(dataset, &head, options, ranks),
    }
}

/// Samples points that each become a particle by themselves.
fn row_by_row(
    dataset: &Dataset,
    head: &Dataset,
    kind: OfRows,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<(Share, SampleReport)> {
    let mut options = options.clone();
    let is_summed = matches!(kind, OfRows::Summed(_));
    if let OfRows::Summed(name) = kind {
        options.field = Some(name);
    }
    let colours = ranks.agree(colour_numbers(dataset))?;
    let colours = ranks.gather_values(colours)?.into_iter().flatten();
    let colours = colours.reduce(ColourNumbers::and);
    let mut found = Found::default();
    if let Some(corners) = dataset.bounds() {
        found.extend(corners);
    }
    let sampled = rows(dataset.clone(), &options, colours, &mut found.volume_sum);
    let sampled = ranks.agree(sampled)?;
    let mut volume = sampled.volume;
    found.report = sampled.report;
    // Without rows, nothing tells the kind of the particles: it is that of the first rank with some.
    let counts = ranks.gather_one(Ok(found.report.sample_count as u64))?;
    if let Some(holder) = counts.iter().position(|count| *count > 0) {
        let metadata = (ranks.rank() == holder).then(|| encode(&[Metadata::of(&volume)]));
        let metadata = decode(&ranks.broadcast(holder, metadata.transpose())?)?;
        if counts[ranks.rank()] == 0 {
            let of_holder = metadata.first().map(Metadata::volume);
            volume = of_holder.ok_or_else(|| unknown("no volume"))??;
        }
    }
    let (found, _) = found_by_all(&found, head, &head.path, &options, ranks)?;
    let report = found.report;
    if is_summed {
        let function = summed_function(report.value_range, report.unit_distance)?;
        volume.transfer_function = Some(function);
    }
    Ok((Share::from(vec![volume]), report))
}

/// Gathers points on the first rank, samples them there, and scatters the particles.
fn on_first(
    dataset: &Dataset,
    head: &Dataset,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<(Share, SampleReport)> {
    let Geometry::Points { positions } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let of = |field: &Field| match &field.source {
        FieldSource::Scalar(values) if values.len() == positions.len() => Ok(values.clone()),
        _ => Err(Error::invalid(
            "scene",
            format!("column {}", field.name),
            "a number for each point, because sizes need more than neighbours",
            "vectors, or a column of another one",
            "give sizes and volumes, or leave the column out",
        )),
    };
    let columns: Result<Vec<_>> = dataset.fields.iter().map(of).collect();
    let gathered = columns.and_then(|columns| {
        let count = u32::try_from(positions.len()).map_err(|_| {
            let (expected, found) = ("at most 4,294,967,295 on a rank", positions.len());
            let advice = "give sizes and volumes";
            Error::invalid("scene", "points", expected, found.to_string(), advice)
        })?;
        Ok((columns, count))
    });
    let (columns, count) = ranks.agree(gathered)?;
    let mut to = vec![Vec::new(); ranks.size()];
    to[0] = (0..count).collect();
    let positions = send(positions, &to, ranks)?;
    let mut fields = head.fields.clone();
    for (field, values) in fields.iter_mut().zip(columns) {
        field.source = FieldSource::Scalar(send_values(&values, &to, ranks)?);
    }
    let sampled = (ranks.rank() == 0).then(|| {
        let whole = Dataset {
            smoothing: head.smoothing.clone(),
            volume_scale: head.volume_scale,
            ..Dataset::new(
                &head.path,
                head.format,
                Geometry::Points { positions },
                fields,
            )
        };
        crate::sample::scene(whole, options)
    });
    let sampled = ranks.agree(sampled.transpose())?;
    let (volumes, report) =
        sampled.map_or((None, None), |own| (Some(own.volumes), Some(own.report)));
    type Sent = (Option<String>, Option<String>, Option<SphKernel>, u64);
    let sent = report.as_ref().map(|own| -> Sent {
        let (field, unit) = (own.field.clone(), own.unit.clone());
        (field, unit, own.smoothing, own.unit_distance.to_bits())
    });
    let (field, unit, smoothing, unit_distance) = ranks.broadcast_value(Ok(sent))?;
    let share = scatter(volumes, ranks)?;
    let report = report.unwrap_or_else(|| SampleReport {
        field,
        unit,
        smoothing,
        unit_distance: f64::from_bits(unit_distance),
        ..SampleReport::default()
    });
    Ok((share, report))
}
