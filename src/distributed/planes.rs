//! A lattice whose planes ranks read together, each those that it is going to draw.

use super::message::{put, take};
use super::ranks::Ranks;
use super::share::Share;
use crate::blocks::{Held, PlaneRuns};
use crate::constants::FAINT_SHARE;
use crate::error::Result;
use crate::io::Planes;
use crate::sample::{PlaneValues, SampleOptions, SampleReport, lattice_of_planes};
use crate::scene::{Boundary, PointVolume, TransferFunction, ValueSample, Values};

/// Reads this rank's planes, and those beside that their neighbours are asked for: its share of the lattice, and what was
/// found of all of it.
///
/// # Errors
/// What reading says, on any rank; too little memory for a rank's planes; a rank that is gone.
pub(crate) fn read_planes(
    file: &Planes,
    options: &SampleOptions,
    ranks: &mut Ranks,
) -> Result<(Share, SampleReport)> {
    let lattice = file.lattice();
    let [x, y, count] = lattice.dims;
    let dealt = PlaneRuns::new(count, ranks.size());
    let read = || {
        lattice.validate()?;
        let mut held = Held {
            runs: Vec::new(),
            values: file.empty_values(),
        };
        let wanted = dealt.wanted(ranks.rank());
        let planes: usize = wanted.iter().map(std::ops::Range::len).sum();
        // As they are read, and in the order of the whole lattice.
        let each = 2 * held.values.bytes_per_value();
        crate::memory::check(planes * x * y, each).map_err(|e| e.in_file(&file.head().path))?;
        for run in wanted {
            let values = file.read(run.clone())?;
            held.push(run, values);
        }
        Ok(held)
    };
    let held = read();
    let Held { runs, values } = ranks.agree(held)?;
    let held = Held { runs, values };
    let own: Vec<usize> = dealt.own(ranks.rank()).flatten().collect();
    let known = known_of_all(&held, x * y, count, &own, ranks)?;
    let made = lattice_of_planes(lattice.clone(), file.field(), file.unit(), known, options);
    let (mut volume, report) = ranks.agree(made)?;
    let Held { runs, values } = held;
    let values = match &volume.transfer_function {
        Some(function) => {
            let scale = function.value_scale();
            let least = scale.lowest(&values);
            let least = least_of_all(least, ranks)?;
            scale.positions_from(values, least)
        }
        None => values,
    };
    let held = Held { runs, values };
    if options.is_sharp() {
        let is_shown = options.is_sharp_anyway()
            || volume
                .transfer_function
                .as_ref()
                .is_some_and(|function| shows_faces(&held, [x, y, count], &own, function));
        if ranks.sums(Ok(vec![u64::from(is_shown)]))? != [0] {
            volume.boundary = Some(Boundary::Lattice);
        }
    }
    let volume = PointVolume {
        values: Some(held.values),
        ..volume
    };
    let share = Share {
        planes: Some(vec![held.runs]),
        ..Share::from(vec![volume])
    };
    Ok((share, report))
}

/// What all values are: each rank looks at its own planes.
fn known_of_all(
    held: &Held,
    samples: usize,
    planes: usize,
    own: &[usize],
    ranks: &mut Ranks,
) -> Result<PlaneValues> {
    let (mut range, mut not_finite) = (None, 0);
    for &plane in own {
        let values = plane_of(held, samples, plane);
        range = joined(range, values.finite_range());
        not_finite += values.non_finite_count();
    }
    let at = |i: &usize| {
        let place = held
            .place(i / samples)
            .filter(|_| own.binary_search(&(i / samples)).is_ok());
        place.map(|place| held.values.get(place * samples + i % samples))
    };
    let picked = ValueSample::picked(samples * planes);
    let picked: Vec<f32> = picked.iter().filter_map(at).collect();
    let mut part = Vec::new();
    put(&mut part, range.as_slice());
    put(&mut part, &[not_finite as u64]);
    put(&mut part, &picked);
    let mut known = PlaneValues::default();
    for part in ranks.gather_to_all(Ok(part))? {
        let mut part = part.as_slice();
        known.range = joined(known.range, take::<[f32; 2]>(&mut part)?.first().copied());
        let count: u64 = take::<u64>(&mut part)?.iter().sum();
        known.not_finite += usize::try_from(count).unwrap_or(usize::MAX);
        known.picked.extend(take::<f32>(&mut part)?);
    }
    Ok(known)
}

fn plane_of(held: &Held, samples: usize, plane: usize) -> Values {
    let place = held.place(plane).unwrap_or(0);
    held.values.part(place * samples..(place + 1) * samples)
}

fn joined(a: Option<[f32; 2]>, b: Option<[f32; 2]>) -> Option<[f32; 2]> {
    match (a, b) {
        (Some([a, b]), Some([c, d])) => Some([a.min(c), b.max(d)]),
        (a, b) => a.or(b),
    }
}

/// The least number that any rank gives.
fn least_of_all(own: f32, ranks: &mut Ranks) -> Result<f32> {
    let all = ranks.gather_records(Ok(vec![own]))?;
    Ok(all.into_iter().flatten().fold(f32::INFINITY, f32::min))
}

/// Whether a function shows any of the samples on a lattice's faces that lie in planes of this rank.
fn shows_faces(held: &Held, dims: [usize; 3], own: &[usize], function: &TransferFunction) -> bool {
    let [x, y, z] = dims;
    let [lowest, highest] = function.range();
    let least = FAINT_SHARE * function.max_extinction(lowest, highest);
    let is_shown = |i: usize| function.classify(held.values.get(i))[3] > least;
    own.iter().any(|&plane| {
        let first = held.place(plane).unwrap_or(0) * x * y;
        let is_face = plane == 0 || plane + 1 == z;
        let on_face = |n: &usize| {
            let (i, j) = (n % x, n / x);
            is_face || i == 0 || i + 1 == x || j == 0 || j + 1 == y
        };
        (0..x * y).filter(on_face).any(|n| is_shown(first + n))
    })
}
