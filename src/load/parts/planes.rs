//! Reads the planes of a lattice on all ranks: each rank reads the planes that it draws.

use crate::blocks::{Held, PlaneRuns, check_count};
use crate::collective::Collective;
use crate::constants::FAINT_SHARE;
use crate::error::Result;
use crate::io::Planes;
use crate::message::{put, take};
use crate::ranks::{SMALL, Share, is_small};
use crate::sample::{PlaneValues, SampleOptions, SampleReport, lattice_of_planes};
use crate::scene::{Boundary, PointVolume, TransferFunction, ValueSample, Values};

/// Reads this rank's planes, and the adjacent planes that its neighbours need. Returns its share of the lattice, and
/// the report of the whole lattice.
///
/// # Errors
/// The errors of reading, on any rank; too little memory for a rank's planes; a rank that is gone.
pub(crate) fn read_planes(
    file: &Planes,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<(Share, SampleReport)> {
    let lattice = file.lattice();
    let [x, y, count] = lattice.dims;
    let runs_of = PlaneRuns::new(count, ranks.size());
    let read = || {
        lattice.validate()?;
        check_count(lattice.len())?;
        let wanted = runs_of.wanted(ranks.rank());
        let planes: usize = wanted.iter().map(std::ops::Range::len).sum();
        // Memory for the values as read, and in the order of the whole lattice. If the lattice is small, every rank
        // holds all of it.
        let each = 2 * file.empty_values().bytes_per_value();
        let cells = match is_small(lattice, SMALL, ranks.size()) {
            true => lattice.len(),
            false => planes * x * y,
        };
        crate::memory::check(cells, each).map_err(|e| e.in_file(&file.head().path))?;
        let values = file.read_runs(&wanted)?;
        Ok(Held {
            runs: wanted,
            values,
        })
    };
    let held = read();
    let held = ranks.agree(held)?;
    let own: Vec<usize> = runs_of.own(ranks.rank()).flatten().collect();
    let known = known_of_all(&held, x * y, count, &own, ranks)?;
    let made = lattice_of_planes(lattice.clone(), file.field(), file.unit(), known, options);
    let (mut volume, report) = ranks.agree(made)?;
    let Held { runs, values } = held;
    let values = match &volume.transfer_function {
        Some(function) => {
            let scale = function.value_scale();
            let least = scale.lowest(&values);
            let least = ranks.min(least)?;
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
        if ranks.any(is_shown)? {
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

/// Summarises the values of the whole lattice: each rank contributes its own planes.
fn known_of_all(
    held: &Held,
    samples: usize,
    planes: usize,
    own: &[usize],
    ranks: &mut dyn Collective,
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
        place.map(|place| held.values.wide(place * samples + i % samples))
    };
    let picked = ValueSample::picked(samples * planes);
    let picked: Vec<f64> = picked.iter().filter_map(at).collect();
    let mut part = Vec::new();
    put(&mut part, range.as_slice());
    put(&mut part, &[not_finite as u64]);
    put(&mut part, &picked);
    let mut known = PlaneValues::default();
    for part in ranks.gather_parts(Ok(part))? {
        let mut part = part.as_slice();
        known.range = joined(known.range, take::<[f64; 2]>(&mut part)?.first().copied());
        let count: u64 = take::<u64>(&mut part)?.iter().sum();
        known.not_finite += usize::try_from(count).unwrap_or(usize::MAX);
        known.picked.extend(take::<f64>(&mut part)?);
    }
    Ok(known)
}

fn plane_of(held: &Held, samples: usize, plane: usize) -> Values {
    let place = held.place(plane).unwrap_or(0);
    held.values.part(place * samples..(place + 1) * samples)
}

pub(super) fn joined(a: Option<[f64; 2]>, b: Option<[f64; 2]>) -> Option<[f64; 2]> {
    match (a, b) {
        (Some([a, b]), Some([c, d])) => Some([a.min(c), b.max(d)]),
        (a, b) => a.or(b),
    }
}

/// Returns true if a function shows any sample that lies on the lattice's faces and in this rank's planes.
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

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;
    use crate::io::{OpenOptions, RawLayout, RawType, open};
    use crate::ranks::ThreadRank;
    use crate::sample::{BoundaryChoice, TransferChoice, scene};
    use crate::sample::{FunctionOptions, KernelOptions, PurposeOptions};
    use crate::scene::ScaleName;

    const DIMS: [usize; 3] = [20, 18, 150];

    /// Returns the bits of values, so that NaN equals itself.
    fn bits(values: &Values, run: std::ops::Range<usize>) -> Vec<u32> {
        run.map(|i| values.get(i).to_bits()).collect()
    }

    #[test]
    fn planes_that_ranks_read_are_sampled_as_the_whole() {
        let [x, y, z] = DIMS;
        let value = |n: usize| match n {
            777 => f32::NAN,
            40_001 => f32::NEG_INFINITY,
            n => {
                let [i, j, k] = [n % x, n / x % y, n / (x * y)].map(|i| i as f32);
                // Above and below 0, and 0 on most faces.
                let inside = (i - 1.0).min(j - 1.0).min(18.0 - i).min(16.0 - j).max(0.0);
                inside * (0.9 + (0.3 * i + 0.04 * k).sin()) - 0.05 * inside * (0.2 * j).cos()
            }
        };
        let bytes: Vec<u8> = (0..x * y * z)
            .flat_map(|n| value(n).to_le_bytes())
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.raw");
        std::fs::write(&path, bytes).unwrap();
        let open_options = OpenOptions {
            raw: Some(RawLayout::new(DIMS, RawType::F32)),
            ..OpenOptions::default()
        };
        let automatic = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Automatic,
                ..KernelOptions::default()
            },
            function: FunctionOptions {
                scale: None,
                ..FunctionOptions::default()
            },
            ..SampleOptions::default()
        };
        let cases = [
            automatic.clone(),
            SampleOptions {
kernels: KernelOptions {
boundary: BoundaryChoice::Sharp,
..automatic.kernels
},
function: FunctionOptions {
scale: Some(ScaleName::Log),
..automatic.function.clone()
},
                ..automatic.clone()

},
            SampleOptions {
function: FunctionOptions {
transfer: TransferChoice::Named("plasma".into()),
range: Some([-1.0, 4.0]),
scale: Some(ScaleName::Symlog),
unit_distance: Some(0.3),
opacity_scale: 2.0
},
                ..automatic.clone()

},
            // All faces are shown.
            SampleOptions {
function: FunctionOptions {
transfer: TransferChoice::Text(
                    r#"{"range": [-5, 20], "points": [{"value": -5, "color": [1, 1, 1], "opacity": 0.9},
                        {"value": 20, "color": [1, 0, 0], "opacity": 0.9}]}"#
                        .into(),
                ),
scale: Some(ScaleName::Linear),
..automatic.function.clone()
},
                ..automatic.clone()

},
            SampleOptions {
purpose: PurposeOptions {
for_columns: true,
..automatic.purpose
},
kernels: KernelOptions {
width: 0.8,
..automatic.kernels
},
                ..automatic

},
        ];
        let mut sharp = Vec::new();
        for (n, options) in cases.iter().enumerate() {
            let whole = scene(open(&path, &open_options).unwrap(), options);
            if let Err(error) = &whole {
                panic!("{n}: {error}");
            }
            let whole = whole.unwrap();
            let expected = &whole.volumes[0];
            sharp.push(expected.boundary.is_some());
            for size in [1, 2, 3, 7] {
                let found: Vec<(Share, SampleReport)> = thread::scope(|scope| {
                    let ranks = ThreadRank::group(size).into_iter();
                    let read = |own| {
                        let mut ranks = own;
                        let file = Planes::open(&path, &open_options, None).unwrap().unwrap();
                        read_planes(&file, options, &mut ranks).unwrap()
                    };
                    let threads: Vec<_> = ranks.map(|own| scope.spawn(move || read(own))).collect();
                    threads.into_iter().map(|t| t.join().unwrap()).collect()
                });
                let mut is_held = vec![false; z];
                for (share, report) in found {
                    assert_eq!(report, whole.report, "{n}, {size} ranks");
                    let own = &share.volumes[0];
                    let without = |volume: &PointVolume| PointVolume {
                        values: None,
                        ..volume.clone()
                    };
                    assert!(without(own) == without(expected), "{n}, {size} ranks");
                    let (values, all) = (
                        own.values.as_ref().unwrap(),
                        expected.values.as_ref().unwrap(),
                    );
                    let mut at = 0;
                    for run in share.planes.unwrap().concat() {
                        let count = run.len() * x * y;
                        let cells = run.start * x * y..run.end * x * y;
                        assert_eq!(
                            bits(values, at..at + count),
                            bits(all, cells),
                            "{n}, {size}"
                        );
                        at += count;
                        run.for_each(|plane| is_held[plane] = true);
                    }
                    assert_eq!(at, values.len());
                }
                assert!(is_held.iter().all(|held| *held));
            }
        }
        assert!(sharp[1] && sharp[3] && !sharp[4], "{sharp:?}");
    }
}
