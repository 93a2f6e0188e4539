//! Sorts points on disk that arrive a part at a time. Memory holds no more than a part during its sort, and the tree
//! over all points.
//!
//! 1. Survey: finds the box of the points and takes a sample. The sample cuts Morton's curve through the box into
//!    buckets of about equal size.
//! 2. Fill: writes each point's row to its bucket in a temporary file.
//! 3. Sort: reads one bucket after another, sorts it along the curve, and appends it to the columns. The columns are
//!    then in the order of the tree's chunks. The tree and its blocks read from disk what they otherwise read from
//!    memory, and are the same to the last bit.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use super::build::{Ordered, Sorted, block_order, build_sorted, check_count};
use super::options::BuildOptions;
use super::points::{Points, PointsBuilder};
use super::room::{MEMORY, Room, failed, nameless};
use super::tree::{CHUNK, Curve};
use crate::blocks::volume::BlockedVolume;
use crate::error::{Error, Result};
use crate::parallel;
use crate::scene::rows::{kind_of, row_len, rows_of, volume_of};
use crate::scene::{Particles, PointVolume};
use crate::task::{Stage, Task};

/// Points that arrive a part at a time, in their order, and can be read repeatedly.
pub trait ParticleStream {
    /// Number of points, for progress; some may be left out.
    fn len(&self) -> usize;

    /// Whether there are no points.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Calls `each` with all points, in parts: volumes of one kind, which differ in their particles only. Every call
    /// must give the same.
    ///
    /// # Errors
    /// The errors of `each`, and of the source of the particles.
    fn for_each(&mut self, each: &mut dyn FnMut(PointVolume) -> Result<()>) -> Result<()>;
}

/// Amounts of data that memory holds at a time.
#[derive(Debug, Clone, Copy)]
struct Sizes {
    /// Number of points in a bucket, about.
    bucket: usize,
    /// Sampling stride: one of so many points is used to cut the curve.
    stride: usize,
    /// Bytes of a bucket that are written at a time, about.
    piece: usize,
}

const SIZES: Sizes = Sizes {
    bucket: 1 << 20,
    stride: 64,
    piece: 1 << 17,
};

/// Builds blocks of points, and their levels of detail: the same that [`build`](super::build::build) makes of all of
/// them.
///
/// - `folder`: folder for temporary files, some 80 bytes for each point.
///
/// # Errors
/// Parts of several kinds; particles that cannot be streamed ([`check`]); the errors of the stream; a full disk;
/// cancelled work.
pub(super) fn build_stream(
    stream: &mut dyn ParticleStream,
    options: BuildOptions,
    folder: &Path,
    task: Option<&Task>,
) -> Result<Vec<BlockedVolume>> {
    let sorted = sorted(stream, SIZES, folder, task)?;
    build_sorted(sorted, options, Room::Folder(folder), task)
}

fn sorted(
    stream: &mut dyn ParticleStream,
    sizes: Sizes,
    folder: &Path,
    task: Option<&Task>,
) -> Result<Sorted> {
    let room = Room::Folder(folder);
    let survey = Survey::of(stream, sizes, task)?;
    let curve = Curve::through(survey.lower, survey.upper);
    let cuts = survey.cuts(&curve, sizes);
    let buckets = Buckets::fill(stream, &survey.like, curve, cuts, (sizes, folder), task)?;
    let like = survey.like;
    // Streams of lattices are refused.
    let Some((mut points, transfer_function)) = Points::of(like.emptied()) else {
        return Err(refused("points", "a lattice"));
    };
    let mut builder = PointsBuilder::new(&points, folder)?;
    let stage = Stage::new(task, "sorting along a curve", survey.count);
    buckets.for_each(&like, |volume, numbers, is_one_cell| {
        stage.check()?;
        let order: Vec<u32> = if is_one_cell {
            (0..numbers.len() as u32).collect()
        } else {
            let positions = volume.particles.positions().par_iter();
            let mut keys: Vec<(u32, u32)> = positions
                .zip(0..numbers.len() as u32)
                .map(|(p, i)| (curve.cell(*p), i))
                .collect();
            keys.par_sort_unstable();
            keys.into_iter().map(|(_, i)| i).collect()
        };
        let Some((points, _)) = Points::of(volume) else {
            return Ok(());
        };
        let numbers: Vec<u32> = order.iter().map(|&i| numbers[i as usize]).collect();
        builder.extend(&points.gather(&order, MEMORY)?, &numbers)?;
        stage.advance(order.len());
        Ok(())
    })?;
    let numbers = builder.finish(&mut points)?;
    let stage = Stage::new(task, "sorting into blocks", 1);
    let Ordered { order, runs, tree } = block_order(&points.positions, &numbers);
    stage.advance(1);
    stage.check()?;
    Ok(Sorted {
        points: points.gather(&order, room)?,
        numbers: room.pick(numbers, &order)?,
        runs,
        tree,
        transfer_function,
    })
}

/// Summary of the points after a first reading.
struct Survey {
    /// A volume of their kind without particles.
    like: PointVolume,
    /// Number of points with finite positions.
    count: usize,
    lower: DVec3,
    upper: DVec3,
    /// Some of their positions.
    sample: Vec<DVec3>,
}

impl Survey {
    fn of(stream: &mut dyn ParticleStream, sizes: Sizes, task: Option<&Task>) -> Result<Self> {
        let stage = Stage::new(task, "looking at all particles", stream.len());
        let mut like: Option<(PointVolume, u64)> = None;
        let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut count, mut sample) = (0, Vec::new());
        stream.for_each(&mut |part| {
            stage.check()?;
            part.validate()?;
            check(&part)?;
            let kind = kind_of(&part);
            if like.as_ref().is_some_and(|(_, own)| *own != kind) {
                return Err(refused("parts of one kind", "parts of several kinds"));
            }
            for p in part.particles.positions() {
                if p.is_finite() {
                    (lower, upper) = (lower.min(*p), upper.max(*p));
                    if count % sizes.stride == 0 {
                        sample.push(*p);
                    }
                    count += 1;
                }
            }
            stage.advance(part.particles.len());
            if like.is_none() {
                like = Some((part.emptied(), kind));
            }
            Ok(())
        })?;
        let Some((like, _)) = like else {
            return Err(refused("particles", "none"));
        };
        check_count(count)?;
        Ok(Self {
            like,
            count,
            lower,
            upper,
            sample,
        })
    }

    /// Returns the first cells of all buckets along the curve, ascending; the first of them is 0.
    fn cuts(&self, curve: &Curve, sizes: Sizes) -> Vec<u32> {
        let mut cuts = vec![0];
        // The tree leaves few points in the order of their arrival.
        if self.count <= CHUNK {
            return cuts;
        }
        let mut cells: Vec<u32> = self.sample.par_iter().map(|p| curve.cell(*p)).collect();
        cells.par_sort_unstable();
        let mut since = 0;
        for cell in cells.chunk_by(|a, b| a == b) {
            // A cell that alone fills a bucket gets one of its own, which needs no sorting.
            let own = cell.len() * sizes.stride;
            let is_full = own >= sizes.bucket;
            if (is_full || since + own > sizes.bucket) && since > 0 && cuts.last() != Some(&cell[0])
            {
                cuts.push(cell[0]);
                since = 0;
            }
            since += own;
            if is_full && cell[0] < u32::MAX {
                cuts.push(cell[0] + 1);
                since = 0;
            }
        }
        cuts
    }
}

/// Rows of points in a file, those of each bucket in pieces.
struct Buckets<'a> {
    folder: &'a Path,
    file: File,
    curve_buckets: Vec<Bucket>,
    row: usize,
    /// Number of rows, about, that are read together if they need no sorting.
    batch: usize,
}

struct Bucket {
    /// Whether all its points lie in one cell, or stay in the order of their arrival.
    is_one_cell: bool,
    /// Rows that are not yet written.
    rest: Vec<u8>,
    /// Offsets of the pieces in the file, and their lengths.
    pieces: Vec<(u64, usize)>,
}

impl<'a> Buckets<'a> {
    /// Reads all points a second time, and writes them to their buckets.
    fn fill(
        stream: &mut dyn ParticleStream,
        like: &PointVolume,
        curve: Curve,
        cuts: Vec<u32>,
        (sizes, folder): (Sizes, &'a Path),
        task: Option<&Task>,
    ) -> Result<Self> {
        let stage = Stage::new(task, "writing them near to one another", stream.len());
        let ends = cuts.iter().skip(1).copied().map(Some).chain([None]);
        let bucket = |(first, end): (&u32, Option<u32>)| Bucket {
            is_one_cell: cuts.len() == 1 || end.is_some_and(|end| end == first + 1),
            rest: Vec::new(),
            pieces: Vec::new(),
        };
        let mut own = Self {
            folder,
            file: nameless(folder)?,
            curve_buckets: cuts.iter().zip(ends).map(bucket).collect(),
            row: row_len(like),
            batch: sizes.bucket,
        };
        let (mut number, mut end) = (0, 0);
        stream.for_each(&mut |part| {
            stage.check()?;
            let positions = part.particles.positions();
            // Points without a finite position are in no block, and get no number.
            let numbers = positions.iter().map(|p| {
                let own = number;
                number += u64::from(p.is_finite());
                own
            });
            let rows = rows_of(&part, &numbers.collect::<Vec<u64>>());
            let bucket_of = |p: &DVec3| {
                let is_there = p.is_finite();
                is_there.then(|| cuts.partition_point(|cut| *cut <= curve.cell(*p)) - 1)
            };
            let places: Vec<Option<usize>> =
                parallel::map(positions.len(), |i| bucket_of(&positions[i]));
            for (row, place) in rows.chunks_exact(own.row).zip(places) {
                let Some(place) = place else {
                    continue;
                };
                let bucket = &mut own.curve_buckets[place];
                bucket.rest.extend_from_slice(row);
                if bucket.rest.len() >= sizes.piece {
                    own.file
                        .write_all(&bucket.rest)
                        .map_err(|e| failed(folder, e))?;
                    bucket.pieces.push((end, bucket.rest.len()));
                    end += bucket.rest.len() as u64;
                    bucket.rest.clear();
                }
            }
            stage.advance(part.particles.len());
            Ok(())
        })?;
        Ok(own)
    }

    /// Calls `each` with the points of one bucket after another in the order of their arrival, with their numbers, and
    /// with whether they need no sorting. A bucket that needs none is passed a part at a time.
    fn for_each(
        mut self,
        like: &PointVolume,
        mut each: impl FnMut(PointVolume, &[u32], bool) -> Result<()>,
    ) -> Result<()> {
        let mut rows = Vec::new();
        for bucket in std::mem::take(&mut self.curve_buckets) {
            rows.clear();
            let mut hand_over = |rows: &mut Vec<u8>| {
                if rows.is_empty() {
                    return Ok(());
                }
                let number = |row: &[u8]| row.first_chunk().map_or(0, |n| u64::from_le_bytes(*n));
                // The survey counted fewer than 2^32.
                let of_rows = rows.par_chunks_exact(self.row);
                let numbers: Vec<u32> = of_rows.map(|row| number(row) as u32).collect();
                let volume = volume_of(&[rows], like)?;
                rows.clear();
                each(volume, &numbers, bucket.is_one_cell)
            };
            for (place, len) in bucket.pieces {
                let start = rows.len();
                rows.resize(start + len, 0);
                let file = &mut self.file;
                file.seek(SeekFrom::Start(place))
                    .and_then(|_| file.read_exact(&mut rows[start..]))
                    .map_err(|e| failed(self.folder, e))?;
                if bucket.is_one_cell && rows.len() >= self.batch * self.row {
                    hand_over(&mut rows)?;
                }
            }
            rows.extend_from_slice(&bucket.rest);
            hand_over(&mut rows)?;
        }
        Ok(())
    }
}

/// Refuses particles with columns that are not written to disk.
fn check(part: &PointVolume) -> Result<()> {
    let found = if matches!(part.particles, Particles::Lattice { .. }) {
        "a lattice"
    } else if part.boundary.is_some() {
        "particles that a boundary cuts"
    } else if part.local_models.is_some() {
        "particles with local models"
    } else if part.normals.is_some() {
        "particles with normals"
    } else {
        return Ok(());
    };
    let expected = "points with shapes, strengths, colours and values alone";
    Err(refused(expected, found))
}

fn refused(expected: &str, found: &str) -> Error {
    let advice = "make the scene of all of them at once";
    Error::invalid("scene", "stream of particles", expected, found, advice)
}

#[cfg(test)]
mod tests {
    use super::super::BlockedParticles;
    use super::super::build::build;
    use super::*;
    use crate::scene::{Colour, Strength, Values};

    /// Parts of a volume, of varying lengths.
    struct Parts(PointVolume);

    impl ParticleStream for Parts {
        fn len(&self) -> usize {
            self.0.particles.len()
        }

        fn for_each(&mut self, each: &mut dyn FnMut(PointVolume) -> Result<()>) -> Result<()> {
            let (mut first, mut len) = (0, 1);
            while first < self.len() {
                let end = self.len().min(first + len);
                let numbers: Vec<u64> = (0..self.len() as u64).collect();
                let rows = rows_of(&self.0, &numbers);
                let row = row_len(&self.0);
                each(volume_of(&[&rows[first * row..end * row]], &self.0)?)?;
                first = end;
                len = 7 * len % 90_001 + 30_000;
            }
            Ok(())
        }
    }

    /// Returns a pseudo-random number from 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    fn scattered(count: usize) -> Vec<DVec3> {
        let at = |n: usize| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2));
        (0..count).map(at).collect()
    }

    fn some(count: usize, k: usize) -> Vec<f32> {
        (0..count).map(|n| number(5 * n + k) as f32).collect()
    }

    /// Spheres with masses.
    fn spheres(positions: Vec<DVec3>) -> PointVolume {
        let count = positions.len();
        let sigmas: Vec<f32> = some(count, 1).iter().map(|s| 0.001 + 0.01 * s).collect();
        PointVolume::spheres(positions, sigmas).with_masses(some(count, 2))
    }

    fn volumes() -> Vec<PointVolume> {
        let crowd = |len: usize| {
            let mut all = scattered(90_000);
            all.splice(1_000..1_000, vec![DVec3::new(0.3, 0.4, 0.5); len]);
            all
        };
        let mut cluster: Vec<DVec3> = scattered(100_000).iter().map(|p| *p * 1e-5).collect();
        cluster.splice(500..500, scattered(3_000).iter().map(|p| *p * 1e3 - 7.0));
        let mut placeless = scattered(80_000);
        for i in [0, 7, 40_000, 79_999] {
            placeless[i].y = f64::NAN;
        }
        let count = 120_000;
        let shapes = |k: usize| -> Vec<[f32; 6]> {
            let all = some(count, k).into_iter().zip(some(count, k + 1));
            all.map(|(a, b)| [a, b, b, 0.1, a - b, 0.2].map(|l| 0.01 * l))
                .collect()
        };
        let colours: Vec<[f32; 3]> = some(count, 3).iter().map(|c| [*c, 1.0 - c, 0.5]).collect();
        let coloured = PointVolume {
            particles: Particles::Anisotropic {
                positions: scattered(count),
                factors: shapes(6),
            },
            strength: Strength::Classified {
                volumes: some(count, 9),
            },
            colour: Colour::PerParticle(colours),
            // Many values are equal: within their block, such particles are in the order of their numbers.
            values: Some(Values::U8((0..count).map(|n| (n % 7) as u8).collect())),
            transfer_function: Some(
                crate::scene::TransferFunction::from_curves(|_| [1.0; 3], |v| v, [0.0, 7.0], 1.0)
                    .unwrap(),
            ),
            boundary: None,
            normals: None,
            local_models: None,
        };
        let surfels = PointVolume {
            colour: Colour::Harmonics {
                degree: 1,
                coefficients: some(12 * count, 13),
                is_linear: false,
            },
            ..PointVolume::new(
                Particles::Surfels {
                    positions: scattered(count),
                    tangents: shapes(11),
                    is_one_sided: true,
                },
                Strength::Surface(some(count, 12)),
            )
        };
        vec![
            spheres(scattered(200_000)),
            spheres(crowd(CHUNK + 20_000)),
            spheres(crowd(9_000)),
            spheres(cluster),
            spheres(placeless),
            spheres(scattered(10_000)),
            spheres(scattered(100)),
            coloured,
            surfels,
        ]
    }

    fn assert_same(own: &[BlockedVolume], all: &[BlockedVolume]) {
        assert_eq!(own.len(), all.len());
        for (a, b) in own.iter().zip(all) {
            assert_eq!(a.blocks, b.blocks);
            match (&a.particles, &b.particles) {
                (
                    BlockedParticles::Isotropic { offsets, sigmas },
                    BlockedParticles::Isotropic {
                        offsets: o,
                        sigmas: s,
                    },
                ) => assert!(offsets == o && sigmas == s),
                (
                    BlockedParticles::Anisotropic { offsets, factors }
                    | BlockedParticles::Surfels {
                        offsets,
                        tangents: factors,
                        ..
                    },
                    BlockedParticles::Anisotropic {
                        offsets: o,
                        factors: f,
                    }
                    | BlockedParticles::Surfels {
                        offsets: o,
                        tangents: f,
                        ..
                    },
                ) => assert!(offsets == o && factors == f),
                _ => panic!("particles of two kinds"),
            }
            assert!(a.strength == b.strength && a.colour == b.colour && a.values == b.values);
            assert_eq!(a.indices, b.indices);
            assert_eq!(a.transfer_function, b.transfer_function);
            let (a, b) = (a.merged.as_ref(), b.merged.as_ref());
            assert_eq!(a.map(|m| &m.spreads), b.map(|m| &m.spreads));
            assert_eq!(a.map(|m| &m.member_depths), b.map(|m| &m.member_depths));
            let bounds = |m: Option<&crate::blocks::Merged>| {
                m.map(|m| bytemuck::cast_slice::<_, u32>(&m.bounds).to_vec())
            };
            assert_eq!(bounds(a), bounds(b));
        }
    }

    #[test]
    fn a_stream_makes_the_blocks_that_all_particles_make_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let options = BuildOptions {
            detail: true,
            indices: true,
        };
        let sizes = Sizes {
            bucket: 7_000,
            stride: 16,
            piece: 1_000,
        };
        for volume in volumes() {
            // Only points with a finite position are numbered.
            let indices = volume.particles.positions().iter().all(|p| p.is_finite());
            let options = BuildOptions { indices, ..options };
            let all = build(volume.clone(), options, None).unwrap();
            let room = Room::Folder(folder.path());
            let sorted = sorted(&mut Parts(volume), sizes, folder.path(), None).unwrap();
            let own = build_sorted(sorted, options, room, None).unwrap();
            assert_same(&own, &all);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn buckets_are_runs_of_cells_and_full_cells_lie_alone() {
        let mut positions = scattered(60_000);
        positions.extend(vec![DVec3::splat(0.25); 20_000]);
        let sizes = Sizes {
            bucket: 5_000,
            stride: 8,
            piece: 1_000,
        };
        let survey = Survey::of(&mut Parts(spheres(positions)), sizes, None).unwrap();
        assert_eq!(survey.count, 80_000);
        let curve = Curve::through(survey.lower, survey.upper);
        let cuts = survey.cuts(&curve, sizes);
        assert!(cuts[0] == 0 && cuts.windows(2).all(|w| w[0] < w[1]));
        assert!((13..30).contains(&cuts.len()), "{}", cuts.len());
        let full = curve.cell(DVec3::splat(0.25));
        assert!(cuts.windows(2).any(|w| w == [full, full + 1]));
    }

    #[test]
    fn what_is_not_carried_is_refused_and_so_are_several_kinds() {
        struct Two(Vec<PointVolume>);
        impl ParticleStream for Two {
            fn len(&self) -> usize {
                2
            }

            fn for_each(&mut self, each: &mut dyn FnMut(PointVolume) -> Result<()>) -> Result<()> {
                self.0.iter().cloned().try_for_each(each)
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let said = |volumes: Vec<PointVolume>| {
            let made = build_stream(
                &mut Two(volumes),
                BuildOptions::default(),
                folder.path(),
                None,
            );
            made.unwrap_err().to_string()
        };
        let ball = spheres(scattered(3));
        let coloured = ball.clone().with_colour([0.5; 3]);
        assert!(said(vec![ball.clone(), coloured]).contains("several kinds"));
        let lit = PointVolume {
            normals: Some(vec![0; 3]),
            ..ball
        };
        assert!(said(vec![lit]).contains("normals"));
        assert!(said(vec![]).contains("none"));
    }
}
