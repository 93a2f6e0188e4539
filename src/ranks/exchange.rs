//! Sends footprints from the rank that projects a particle to the ranks that draw it.
//!
//! Each rank puts the footprints that it receives into the order of a single machine: the order of the blocks in view.
//! Every rank knows that order, whichever rank holds the blocks' particles.

use rayon::prelude::*;

use super::tiles::TileShares;
use crate::cpu::{CpuFrames, ProjectOutput};
use crate::error::Result;
use crate::message::{put, take};
use crate::record::{BlockView, ExactTerms, Footprint, NearTerms, SurfelTerms};

/// Number of blocks in view that one task sorts by their destinations.
const GRAIN: usize = 64;

/// Footprints of one block: the volume, the block's number among the volume's blocks in view, and their count.
type Run = [u32; 3];

/// Footprints that one rank sends to another.
#[derive(Debug, Default)]
struct Parcel {
    runs: Vec<Run>,
    footprints: Vec<Footprint>,
    /// One for each footprint, or none at all.
    exact: Vec<ExactTerms>,
    surfels: Vec<SurfelTerms>,
    near: Vec<NearTerms>,
}

impl Parcel {
    fn put(&self, bytes: &mut Vec<u8>) {
        put(bytes, &self.runs);
        put(bytes, &self.footprints);
        put(bytes, &self.exact);
        put(bytes, &self.surfels);
        put(bytes, &self.near);
    }

    fn take(bytes: &mut &[u8]) -> Result<Self> {
        Ok(Self {
            runs: take(bytes)?,
            footprints: take(bytes)?,
            exact: take(bytes)?,
            surfels: take(bytes)?,
            near: take(bytes)?,
        })
    }
}

/// Parameters that decide which ranks a footprint is sent to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sorting<'a> {
    /// Tiles that each rank draws.
    pub(super) shares: &'a TileShares,
    /// Number of ranks.
    pub(super) ranks: usize,
    /// Whether the footprints are surfels of opaque surfaces.
    pub(super) is_opaque: bool,
}

/// Packs a frame's footprints as bytes for each rank that draws them. Also returns how many footprints reach the image,
/// and how many are sent: one that reaches the tiles of several ranks is sent to each.
///
/// - `frames`: footprints of the blocks in its `views`.
/// - `numbers`: for each volume and each of those views, the block's number among all blocks of the volume in view.
pub(super) fn parcels(
    frames: &mut CpuFrames,
    numbers: &[Vec<u32>],
    sorting: Sorting<'_>,
) -> (Vec<Vec<u8>>, [usize; 2]) {
    let near = frames.project_output.near().to_vec();
    let mut firsts = Vec::with_capacity(frames.totals.len());
    let mut first = 0;
    for total in &frames.totals {
        firsts.push(first);
        first += total;
    }
    let frames = &*frames;
    let blocks: Vec<(u32, u32, &BlockView)> = (0..)
        .zip(numbers.iter().zip(&frames.views))
        .flat_map(|(volume, (numbers, views))| {
            let own = numbers.iter().zip(views);
            own.map(move |(number, view)| (volume, *number, view))
        })
        .collect();
    let sorted: Vec<(Vec<Parcel>, [usize; 2])> = blocks
        .par_chunks(GRAIN)
        .map(|blocks| {
            let mut parcels = Vec::new();
            parcels.resize_with(sorting.ranks, Parcel::default);
            let mut counts = [0; 2];
            for &(volume, number, view) in blocks {
                let first = firsts[volume as usize] + view.first as usize;
                for i in first..first + view.count as usize {
                    let of = (i, [volume, number]);
                    sort_one(frames, &near, of, sorting, &mut parcels, &mut counts);
                }
            }
            (parcels, counts)
        })
        .collect();
    let parts = (0..sorting.ranks).into_par_iter().map(|rank| {
        let mut bytes = Vec::new();
        for (parcels, _) in &sorted {
            if !parcels[rank].runs.is_empty() {
                parcels[rank].put(&mut bytes);
            }
        }
        bytes
    });
    let counts = sorted.iter().map(|(_, counts)| counts);
    let sum = counts.fold([0; 2], |sum, own| [sum[0] + own[0], sum[1] + own[1]]);
    (parts.collect(), sum)
}

/// Puts a footprint of a block in view into the parcels of the ranks that draw it.
fn sort_one(
    frames: &CpuFrames,
    near: &[NearTerms],
    (i, [volume, number]): (usize, [u32; 2]),
    sorting: Sorting<'_>,
    parcels: &mut [Parcel],
    counts: &mut [usize; 2],
) {
    let footprint = &frames.footprints[i];
    if !footprint.is_visible() {
        return;
    }
    counts[0] += 1;
    sorting.shares.for_each_rank(footprint, |rank| {
        counts[1] += 1;
        let parcel = &mut parcels[rank];
        match parcel.runs.last_mut() {
            Some([v, n, count]) if [*v, *n] == [volume, number] => *count += 1,
            _ => parcel.runs.push([volume, number, 1]),
        }
        let mut own = *footprint;
        if let Some(place) = own.near_place(sorting.is_opaque) {
            own = own.with_near_place(parcel.near.len() as u32, sorting.is_opaque);
            parcel.near.extend(near.get(place as usize));
        }
        parcel.footprints.push(own);
        parcel.surfels.extend(frames.surfels.get(i));
        if let Some(exact) = frames.exact.get(i) {
            let mut exact = *exact;
            let edges = (exact.edges as usize).checked_sub(1);
            if let Some(edges) = edges.and_then(|place| near.get(place)) {
                parcel.near.push(*edges);
                exact.edges = parcel.near.len() as u32;
            }
            parcel.exact.push(exact);
        }
    });
}

/// Footprints of a pass that this rank received.
#[derive(Debug, Default)]
pub(super) struct Arrived {
    parcels: Vec<Parcel>,
}

impl Arrived {
    /// Adds the bytes that one rank sent.
    pub(super) fn add(&mut self, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            self.parcels.push(Parcel::take(&mut bytes)?);
        }
        Ok(())
    }

    /// Number of footprints.
    pub(super) fn len(&self) -> usize {
        self.parcels.iter().map(|p| p.footprints.len()).sum()
    }

    /// Replaces a frame's footprints by these, in the order of a single machine.
    ///
    /// - `exact_count`: number of footprints of all ranks on the exact path.
    pub(super) fn put(self, frames: &mut CpuFrames, exact_count: usize, is_opaque: bool) {
        /// A run: its volume and block, its parcel, the place of its first footprint there, and their number.
        type Place = (u32, u32, usize, usize, usize);
        let mut runs: Vec<Place> = Vec::new();
        let mut near_firsts = Vec::with_capacity(self.parcels.len());
        let mut near = Vec::new();
        for (p, parcel) in self.parcels.iter().enumerate() {
            let mut first = 0;
            for &[volume, number, count] in &parcel.runs {
                runs.push((volume, number, p, first, count as usize));
                first += count as usize;
            }
            near_firsts.push(near.len() as u32);
            near.extend_from_slice(&parcel.near);
        }
        runs.par_sort_unstable();
        let count = self.len();
        frames.footprints.clear();
        frames.exact.clear();
        frames.surfels.clear();
        frames.footprints.reserve(count);
        for (_, _, p, first, count) in runs {
            let parcel = &self.parcels[p];
            let run = first..first + count;
            let moved = near_firsts[p];
            for footprint in &parcel.footprints[run.clone()] {
                let place = footprint.near_place(is_opaque);
                let place = place.map(|place| footprint.with_near_place(moved + place, is_opaque));
                frames.footprints.push(place.unwrap_or(*footprint));
            }
            let exact = parcel.exact.get(run.clone()).unwrap_or_default();
            frames.exact.extend(exact.iter().map(|terms| ExactTerms {
                edges: if terms.edges > 0 {
                    moved + terms.edges
                } else {
                    0
                },
                ..*terms
            }));
            let surfels = parcel.surfels.get(run).unwrap_or_default();
            frames.surfels.extend_from_slice(surfels);
        }
        let tile_count = frames
            .footprints
            .par_iter()
            .map(Footprint::tile_count)
            .sum();
        frames.project_output = ProjectOutput::of(near, exact_count, tile_count);
    }
}
