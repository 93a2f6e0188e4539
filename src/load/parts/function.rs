//! Chooses the transfer function of a field whose values are partitioned over ranks, from the values of all ranks.

use std::path::Path;
#[cfg(test)]
use std::thread;

use glam::DVec3;

use super::found::found_on_all;
use crate::collective::Collective;
use crate::data::dataset::Dataset;
use crate::data::up::in_end_planes;
use crate::error::Result;
#[cfg(test)]
use crate::io::{OpenOptions, open};
use crate::ranks::Share;
#[cfg(test)]
use crate::ranks::ThreadRank;
use crate::sample::Found;
use crate::sample::{SampleOptions, SampleReport, function_of_all, mean_spacing, nothing_left};
#[cfg(test)]
use crate::sample::{Sampled, volume};
#[cfg(test)]
use crate::scene::rows::{rows_of, volume_of};
use crate::scene::{
    LocalModel, LocalModels, PickedRow, PointVolume, Surroundings, Tiling, ValueScale, Values,
};

/// A file that all ranks have read, each a part.
pub(crate) struct PartRead {
    /// The part of this rank.
    pub(crate) share: Share,
    /// The report on the whole file.
    pub(crate) report: SampleReport,
    /// The header of the whole file: a data set with a few nodes in place of all ([`outline_of_all`]).
    pub(crate) head: Dataset,
    /// The least and the greatest coordinates of all ranks; `None` if none is finite.
    pub(crate) corners: Option<(DVec3, DVec3)>,
}

/// Sums the findings of all ranks, and returns them with the mean spacing of the particles.
///
/// - `head`: the header of the data, with the unit of the field that is shown.
///
/// # Errors
/// No particle on any rank; a rank that is gone.
pub(super) fn found_by_all(
    own: &Found,
    head: &Dataset,
    path: &Path,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<(Found, f64)> {
    let mut all = found_on_all(own, ranks)?;
    let report = &mut all.report;
    if report.particle_count == 0 {
        return Err(nothing_left(path, report));
    }
    let field = report.field.as_deref();
    report.unit = field.and_then(|name| head.unit(name)).map(str::to_owned);
    let spacing = mean_spacing(all.volume_sum.value(), report.particle_count);
    report.unit_distance = options.function.unit_distance.unwrap_or(spacing);
    Ok((all, spacing))
}

/// Chooses a transfer function from the values of all ranks, and stores it in this rank's volume. A volume without
/// values stays as it is.
///
/// - `picked`: particles of this rank from which the function may be chosen.
/// - `count`: number of rows of all ranks among which particles were picked.
/// - `kind`: whether the data include an object's surroundings, and whether the particles tile space.
/// - `found`: findings of all ranks, to which the choice is added; `spacing`: mean spacing of the particles.
///
/// # Errors
/// A function that cannot be read, or does not fit what is asked for; a rank that is gone.
pub(super) fn show(
    volume: &mut PointVolume,
    picked: Vec<PickedRow>,
    (count, kind): (usize, (Surroundings, Tiling)),
    (found, spacing): (&mut Found, f64),
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<()> {
    let mut picked = ranks.gather_records(Ok(picked))?.concat();
    if volume.values.is_none() {
        return Ok(());
    }
    picked.sort_unstable_by_key(|own| own.row);
    let function = function_of_all(&picked, count, kind, spacing, &mut found.report, options);
    let function = ranks.agree(function)?;
    let scale = function.value_scale();
    let values = volume.values.take().unwrap_or(Values::U8(Vec::new()));
    let least = ranks.min(scale.lowest(&values))?;
    volume.values = Some(scale.positions_from(values, least));
    volume.transfer_function = Some(function);
    Ok(())
}

/// Returns a few nodes with the same bounding box and the same direction up as the nodes of all ranks: the corners of
/// the box. If some nodes lie between the two end planes of an axis, one node between these planes is added.
pub(crate) fn outline_of_all(own: &[DVec3], ranks: &mut dyn Collective) -> Result<Vec<DVec3>> {
    let finite = || own.iter().copied().filter(|p| p.is_finite());
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let joined = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
    let (low, high) = finite().fold(none, joined);
    let ends = match low.is_finite() {
        true => vec![low.to_array(), high.to_array()],
        false => Vec::new(),
    };
    let ends = ranks.gather_records(Ok(ends))?.concat();
    let ends = ends.into_iter().map(DVec3::from);
    let (low, high) = ends.fold(none, joined);
    if !low.is_finite() {
        return Ok(Vec::new());
    }
    let outside = in_end_planes(finite(), (low, high)).map(|is_in| u64::from(!is_in));
    let sums = ranks.sums(Ok([&outside[..], &[own.len() as u64]].concat()))?;
    let [x, y, z, count] = sums[..] else {
        return Ok(vec![low, high]);
    };
    // Few nodes are not a layer, whatever planes they lie in.
    if count <= 8 {
        return Ok(vec![low, high]);
    }
    let ends = [low, high];
    let corner = |i: usize| DVec3::new(ends[i & 1].x, ends[i >> 1 & 1].y, ends[i >> 2 & 1].z);
    let mut nodes: Vec<DVec3> = (0..8).chain([0]).map(corner).collect();
    for (axis, _) in [x, y, z].iter().enumerate().filter(|(_, n)| **n > 0) {
        let mut between = low;
        between[axis] = low[axis].midpoint(high[axis]);
        nodes.push(between);
    }
    Ok(nodes)
}

/// Encodes a rank's local models, on one scale for all ranks.
pub(super) fn models_of_all(own: &[LocalModel], ranks: &mut dyn Collective) -> Result<LocalModels> {
    let scales = ranks.max(LocalModels::scales_of(own))?;
    Ok(LocalModels::with(own, scales))
}

/// The scale on which all ranks take differences of a field.
pub(super) fn differences_of_all(own: &Values, ranks: &mut dyn Collective) -> Result<ValueScale> {
    let is_wide = matches!(own, Values::F64(_));
    let range = own.finite_range();
    let [lo, hi] = range.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
    let own = [lo, hi, f64::from(u8::from(is_wide))];
    let all = ranks.gather_one(Ok(own))?;
    let joined = |a: [f64; 3], b: [f64; 3]| [a[0].min(b[0]), a[1].max(b[1]), a[2].max(b[2])];
    let all = all.into_iter().fold(own, joined);
    let range = (all[0] <= all[1]).then_some([all[0], all[1]]);
    Ok(ValueScale::of_differences(range, all[2] > 0.0))
}

/// Checks that several ranks make the same of a file as one rank does.
///
/// - `sizes`: numbers of ranks; `read`: reads a rank's part.
#[cfg(test)]
pub(super) fn check_file(
    path: &Path,
    options: &SampleOptions,
    sizes: &[usize],
    read: impl Fn(&mut dyn Collective) -> PartRead + Sync,
) -> Sampled {
    let dataset = open(path, &OpenOptions::default()).unwrap();
    let (corners, notes, up) = (dataset.bounds(), dataset.notes.clone(), dataset.up());
    let whole = volume(dataset, options).unwrap();
    for &size in sizes {
        check_parts(&whole, size, |ranks| {
            let own = read(ranks);
            assert_eq!((own.corners, &own.head.notes), (corners, &notes));
            assert_eq!(own.head.up(), up);
            (own.share, own.report)
        });
    }
    whole
}

/// Checks that several ranks make the same of data as one rank does: particles, bit for bit, and reports.
///
/// - `read`: returns a rank's share, and its report on all data.
#[cfg(test)]
fn check_parts(
    whole: &Sampled,
    size: usize,
    read: impl Fn(&mut dyn Collective) -> (Share, SampleReport) + Sync,
) {
    let all: Vec<u64> = (0..whole.volume.particles.len() as u64).collect();
    let found: Vec<(Share, SampleReport)> = thread::scope(|scope| {
        let ranks = ThreadRank::group(size).into_iter();
        let read = |mut own: ThreadRank| read(&mut own);
        let threads: Vec<_> = ranks.map(|own| scope.spawn(move || read(own))).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    });
    let without = PointVolume::emptied;
    // Several ranks find things in another order.
    let sorted = |report: &SampleReport| {
        let mut report = report.clone();
        report.findings.sort_by_key(|f| (f.reason.clone(), f.count));
        report
    };
    let (mut parts, mut first) = (Vec::new(), 0);
    for (share, report) in &found {
        assert_eq!(sorted(report), sorted(&whole.report), "{size} ranks");
        let volume = &share.volumes[0];
        assert!(without(volume) == without(&whole.volume), "{size} ranks");
        let count = volume.particles.len();
        assert!(size == 1 || count < all.len());
        let numbers = match &share.numbers {
            Some(numbers) => numbers[0].clone(),
            None => (first..first + count as u64).collect(),
        };
        first += count as u64;
        parts.push(rows_of(volume, &numbers));
    }
    let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let joined = volume_of(&parts, &whole.volume).unwrap();
    // Particles in the order of one rank.
    assert_eq!(joined.particles.len(), all.len(), "{size} ranks");
    let rows = [&joined, &whole.volume].map(|volume| rows_of(volume, &all));
    let stride = rows[0].len() / all.len();
    let mut pairs = rows[0]
        .chunks(stride)
        .zip(rows[1].chunks(stride))
        .enumerate();
    let other = pairs.find(|(_, (a, b))| a != b);
    assert!(other.is_none(), "{size} ranks: {other:?}");
}
