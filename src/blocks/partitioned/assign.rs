//! Redistributes particles to the ranks that build blocks of them.

use std::ops::Range;

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::super::build::check_count;
use super::super::tree::{CHUNK, PartialTree, Subtree, Tree, Units};
use super::chunks::{Chunk, chunks};
use super::corners::{NO_CORNERS, extend};
use super::numbers::without_gaps;
use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::scene::PointVolume;
use crate::scene::rows::{Rows, append, number_of, position_of, row_len, volume_in_order};
use crate::task::{Stage, Task};

/// A subtree of the tree over chunks that one rank builds; partitions are listed in block order.
#[derive(Debug)]
pub(super) struct Partition {
    /// Chunks, by their places in that tree.
    pub(super) chunks: Subtree,
    /// Particles: a run of block order.
    pub(super) run: Range<usize>,
    pub(super) owner: usize,
}

/// Number of particles that each rank receives in a round, about.
const BATCH: u64 = 1 << 19;

/// Particles of which a rank builds blocks.
#[derive(Debug)]
pub(super) struct Assigned {
    /// Particles in the order of the trees.
    pub(super) volume: PointVolume,
    /// Number of each particle among those of all ranks.
    pub(super) numbers: Vec<u32>,
    /// Trees over runs of the particles, one after the other.
    pub(super) trees: Vec<OwnTree>,
    /// Partition: all subtrees that are assigned, whichever rank builds them.
    pub(super) partitions: Vec<Partition>,
    /// Top tree, whose leaves are the partitions.
    pub(super) top_tree: Tree,
}

/// A tree over particles that are here.
#[derive(Debug)]
pub(super) struct OwnTree {
    pub(super) tree: Tree,
    at: usize,
    /// Index of the tree's partition.
    pub(super) partition: usize,
    start: usize,
}

impl OwnTree {
    pub(super) fn partial(&self) -> PartialTree<'_> {
        PartialTree {
            tree: &self.tree,
            at: self.at,
            start: self.start,
        }
    }
}

/// Redistributes the particles of all ranks.
pub(super) fn assign(
    volume: PointVolume,
    given: Option<Vec<u64>>,
    task: Option<&Task>,
    ranks: &mut dyn Collective,
) -> Result<Assigned> {
    let all = volume.particles.positions();
    let kept: Vec<u32> = (0..)
        .zip(all)
        .filter(|(_, p)| p.is_finite())
        .map(|(i, _)| i)
        .collect();
    let given = given.map(|given| kept.iter().map(|&i| given[i as usize]).collect());
    let numbers = without_gaps(kept.len(), given, ranks)?;
    let positions: Vec<DVec3> = kept.iter().map(|&i| all[i as usize]).collect();
    let mut corners = NO_CORNERS;
    positions
        .iter()
        .for_each(|p| extend(&mut corners, &[*p; 2]));
    let corners = ranks.reduce(Ok(vec![corners]), extend)?;
    let count = ranks.sum(Ok(kept.len() as u64))?;
    // The count is the same on all ranks.
    check_count(usize::try_from(count).unwrap_or(usize::MAX))?;
    let [lower, upper] = corners.first().copied().unwrap_or(NO_CORNERS);
    if count <= CHUNK as u64 {
        let expected = format!("more than {CHUNK} points together");
        return Err(refused(&expected, &count.to_string()));
    }
    let units = Units::of(lower, upper);
    let (members, chunks) = chunks(&positions, count, ranks)?;
    let point = |i: u32| units.point(positions[i as usize], numbers[i as usize] as u32);
    let boxes = chunks.par_iter().map(|chunk| {
        let here = members[chunk.here.clone()].iter().map(|&i| point(i));
        here.fold(Aabb::empty(), |all, p| all.union(&p))
    });
    let boxes: Vec<[[f32; 3]; 2]> = boxes.map(|b| [b.min.into(), b.max.into()]).collect();
    let boxes = ranks.reduce(Ok(boxes), |all, own| {
        for axis in 0..3 {
            all[0][axis] = all[0][axis].min(own[0][axis]);
            all[1][axis] = all[1][axis].max(own[1][axis]);
        }
    })?;
    let boxes: Vec<Aabb> = boxes
        .into_iter()
        .map(|[min, max]| Aabb::new(Vec3A::from(min), Vec3A::from(max)))
        .collect();
    let (top, places) = Tree::over_boxes(&boxes, units);
    let of_place = |place: usize| &chunks[places[place] as usize];
    let partitions = partitions(&top, |place| of_place(place).count, ranks.size());
    let runs: Vec<Range<usize>> = partitions.iter().map(|own| own.chunks.run()).collect();
    let top_tree = top.above(&runs);
    drop(positions);
    // Members are indices into the volume from here on.
    let members: Vec<(u32, u32)> = members
        .into_iter()
        .map(|i| (kept[i as usize], numbers[i as usize] as u32))
        .collect();
    drop((kept, numbers));
    let like = volume.emptied();
    let sorting = Sorting {
        members: &members,
        partitions: &partitions,
        of_place: &of_place,
    };
    let rows = sorting.exchange(&volume, task, ranks)?;
    drop(volume);
    let (volume, numbers, trees) = sorting.build(&rows, &like, (&top, units))?;
    Ok(Assigned {
        volume,
        numbers,
        trees,
        partitions,
        top_tree,
    })
}

fn refused(expected: &str, found: &str) -> Error {
    let advice = "give every rank a share of the same volumes";
    Error::invalid("scene", "shares of ranks", expected, found, advice)
}

/// Cuts the tree over chunks into subtrees of at most [`CHUNK`] points, or of one chunk. Assigns each to the rank with
/// the least points so far.
fn partitions(top: &Tree, count: impl Fn(usize) -> u64, size: usize) -> Vec<Partition> {
    let sum = |places: Range<usize>| places.map(&count).sum::<u64>();
    let subtrees = top.largest(|places| sum(places) <= CHUNK as u64);
    let mut loads = vec![0; size];
    let mut end = 0;
    let partition = |chunks: Subtree| {
        let start = end;
        let count = sum(chunks.run());
        end += count as usize;
        let least = loads.iter().enumerate().min_by_key(|(_, load)| **load);
        let owner = least.map_or(0, |(owner, _)| owner);
        loads[owner] += count;
        Partition {
            chunks,
            run: start..end,
            owner,
        }
    };
    subtrees.into_iter().map(partition).collect()
}

/// Assignment of points to ranks.
struct Sorting<'a, F> {
    /// Points that are here, in the order of chunks: their indices in the volume, and their numbers.
    members: &'a [(u32, u32)],
    partitions: &'a [Partition],
    /// Returns the chunk at a place of the tree over chunks.
    of_place: &'a F,
}

/// Rows of the points in some partitions, in one allocation, which is freed as a whole.
struct OwnRows {
    rows: Vec<u8>,
    partitions: Vec<PartitionRows>,
}

/// Position of a partition's rows.
struct PartitionRows {
    partition: usize,
    run: Range<usize>,
    /// Number of rows of each chunk.
    counts: Vec<usize>,
}

/// Number of partitions that are built at a time.
const AT_A_TIME: usize = 32;

impl<'a, F: Fn(usize) -> &'a Chunk + Sync> Sorting<'a, F> {
    /// Exchanges rows, a few partitions at a time; returns the rows of this rank's partitions.
    fn exchange(
        &self,
        volume: &PointVolume,
        task: Option<&Task>,
        ranks: &mut dyn Collective,
    ) -> Result<OwnRows> {
        let stage = Stage::new(task, "sorting into blocks", self.partitions.len());
        let (rank, size) = (ranks.rank(), ranks.size());
        let (columns, row) = (Rows::of(volume), row_len(volume));
        let all = self
            .partitions
            .iter()
            .filter(|partition| partition.owner == rank);
        let count: usize = all.map(|partition| partition.run.len()).sum();
        let mut own = OwnRows {
            rows: Vec::with_capacity(count * row),
            partitions: Vec::new(),
        };
        let mut next = 0;
        while next < self.partitions.len() {
            let first = next;
            let mut count = 0;
            while next < self.partitions.len() && count < BATCH * size as u64 {
                count += self.partitions[next].run.len() as u64;
                next += 1;
            }
            let round = || (first..next).map(|b| (b, &self.partitions[b]));
            // Number of rows of each chunk, and the rows.
            let mut parts = vec![(Vec::new(), Vec::new()); size];
            for (_, partition) in round() {
                let (counts, rows) = &mut parts[partition.owner];
                for place in partition.chunks.run() {
                    let here = &self.members[(self.of_place)(place).here.clone()];
                    counts.push(here.len() as u64);
                    let some = here.iter();
                    columns.append(rows, some.map(|&(i, n)| (i as usize, u64::from(n))));
                }
            }
            let parts = parts.into_iter().map(|(counts, rows)| {
                let mut part = bytemuck::cast_slice(&counts).to_vec();
                part.extend(rows);
                part
            });
            // A rank that is cancelled sends that to the others.
            let parts = ranks.exchange(stage.check().map(|()| parts.collect()))?;
            stage.advance(next - first);
            let mine = || round().filter(|(_, partition)| partition.owner == rank);
            let chunks: usize = mine()
                .map(|(_, partition)| partition.chunks.run().len())
                .sum();
            let mut parts: Vec<(Vec<u64>, &[u8])> = parts
                .iter()
                .map(|part| {
                    let (counts, rows) = part.split_at((8 * chunks).min(part.len()));
                    let counts = counts.as_chunks().0.iter();
                    (counts.map(|n| u64::from_ne_bytes(*n)).collect(), rows)
                })
                .collect();
            let mut chunk = 0;
            for (number, partition) in mine() {
                let start = own.rows.len();
                let mut of_chunks = Vec::new();
                for _ in partition.chunks.run() {
                    let before = own.rows.len();
                    for (counts, rows) in &mut parts {
                        let count = counts.get(chunk).map_or(0, |n| *n as usize);
                        let (chunk, rest) = rows.split_at((count * row).min(rows.len()));
                        own.rows.extend_from_slice(chunk);
                        *rows = rest;
                    }
                    chunk += 1;
                    of_chunks.push((own.rows.len() - before) / row);
                }
                own.partitions.push(PartitionRows {
                    partition: number,
                    run: start..own.rows.len(),
                    counts: of_chunks,
                });
            }
        }
        Ok(own)
    }

    /// Builds a tree over the points of each of this rank's partitions; returns these trees and the points in their order.
    fn build(
        &self,
        own: &OwnRows,
        like: &PointVolume,
        (top, units): (&Tree, Units),
    ) -> Result<(PointVolume, Vec<u32>, Vec<OwnTree>)> {
        let row = row_len(like);
        let build = |of: &PartitionRows| {
            let partition = &self.partitions[of.partition];
            let mut all: Vec<&[u8]> = own.rows[of.run.clone()].chunks_exact(row).collect();
            let mut runs = Vec::with_capacity(of.counts.len());
            let mut end = 0;
            for (place, count) in partition.chunks.run().zip(&of.counts) {
                let run = end..end + count;
                end = run.end;
                // The order of the chunk's points if one rank had all.
                let curve = (self.of_place)(place).curve;
                let key = |row: &&[u8]| (curve.cell(position_of(row)), number_of(row));
                all[run.clone()].sort_by_cached_key(key);
                runs.push(run);
            }
            let members: Vec<u32> = (0..all.len() as u32).collect();
            let first = partition.chunks.run().start;
            let chunk = |place: usize| &members[runs[place - first].clone()];
            let point = |i: u32| {
                let row = all[i as usize];
                units.point(position_of(row), number_of(row) as u32)
            };
            let (tree, order) = Tree::over_chunks(top, partition.chunks, chunk, point);
            let ordered: Vec<&[u8]> = order.iter().map(|&i| all[i as usize]).collect();
            let numbers: Vec<u32> = ordered.iter().map(|row| number_of(row) as u32).collect();
            (tree, numbers, volume_in_order(ordered, like))
        };
        let mut trees = Vec::with_capacity(own.partitions.len());
        let mut all = like.emptied();
        let mut numbers = Vec::new();
        for some in own.partitions.chunks(AT_A_TIME) {
            let built: Vec<(Tree, Vec<u32>, PointVolume)> = some.par_iter().map(build).collect();
            for (of, (tree, of_bundle, volume)) in some.iter().zip(built) {
                trees.push(OwnTree {
                    tree,
                    at: numbers.len(),
                    partition: of.partition,
                    start: self.partitions[of.partition].run.start,
                });
                numbers.extend(of_bundle);
                append(&mut all, volume);
            }
        }
        Ok((all, numbers, trees))
    }
}
