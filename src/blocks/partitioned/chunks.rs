//! Finds the chunks of all ranks' points by counting: the chunks of one tree over all of them.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;
use rdst::RadixSort;

use super::super::tree::{CHUNK, Curve};
use super::corners::{NO_CORNERS, extend};
use crate::collective::Collective;
use crate::error::Result;

/// A chunk, or a part that is still to be cut into chunks.
#[derive(Debug, Clone)]
pub(super) struct Chunk {
    /// Points of the chunk that are here, as a run of this rank's points in the order of chunks.
    pub(super) here: Range<usize>,
    /// Number of points in the chunk, on all ranks.
    pub(super) count: u64,
    /// Curve along which the points are sorted; points in one cell are sorted by number.
    pub(super) curve: Curve,
    /// Number of bits of the curve's cells that are not yet used.
    bits: u32,
    is_done: bool,
}

/// Returns this rank's points in the order of chunks, and the chunks of all points, as in
/// [`Tree::over`](super::super::tree::Tree::over).
///
/// - `count`: number of all points, more than [`CHUNK`].
pub(super) fn chunks(
    positions: &[DVec3],
    count: u64,
    ranks: &mut dyn Collective,
) -> Result<(Vec<u32>, Vec<Chunk>)> {
    // The cell on Morton's curve in the upper half, the point's number in the lower half.
    let mut keys: Vec<u64> = (0..positions.len() as u64).collect();
    let mut parts = vec![Chunk {
        here: 0..positions.len(),
        count,
        curve: Curve::through(DVec3::ZERO, DVec3::ZERO),
        bits: 0,
        is_done: false,
    }];
    // Parts in one cell are sorted again, in their own bounds.
    while parts.iter().any(|part| !part.is_done) {
        sort(&mut keys, &mut parts, positions, ranks)?;
        while parts.iter().any(Chunk::is_cut) {
            parts = halved(&keys, parts, ranks)?;
        }
        for part in &mut parts {
            part.is_done |= part.count <= CHUNK as u64;
        }
    }
    let members = keys.into_par_iter().map(|key| key as u32).collect();
    Ok((members, parts))
}

impl Chunk {
    /// Whether it is to be halved.
    fn is_cut(&self) -> bool {
        !self.is_done && self.bits > 0 && self.count > CHUNK as u64
    }
}

/// Sorts each unfinished part along a curve through its own bounds.
fn sort(
    keys: &mut [u64],
    parts: &mut [Chunk],
    positions: &[DVec3],
    ranks: &mut dyn Collective,
) -> Result<()> {
    let at = |key: u64| positions[key as u32 as usize];
    let open = || parts.iter().filter(|part| !part.is_done);
    let corners = open().map(|part| {
        let here = keys[part.here.clone()].par_iter();
        let own = here.fold(
            || NO_CORNERS,
            |mut all, &key| {
                extend(&mut all, &[at(key); 2]);
                all
            },
        );
        own.reduce(
            || NO_CORNERS,
            |mut all, own| {
                extend(&mut all, &own);
                all
            },
        )
    });
    let corners = corners.collect();
    let mut corners = ranks.reduce(Ok(corners), extend)?.into_iter();
    for part in parts.iter_mut().filter(|part| !part.is_done) {
        let Some([lower, upper]) = corners.next() else {
            return Ok(());
        };
        let curve = Curve::through(lower, upper);
        let own = &mut keys[part.here.clone()];
        own.par_iter_mut().for_each(|key| {
            let number = *key & u64::from(u32::MAX);
            *key = u64::from(curve.cell(at(number))) << 32 | number;
        });
        own.radix_sort_unstable();
        part.curve = curve;
        part.bits = 32;
        // Cells ascend along each axis: these two are equal only if all points share one cell.
        part.is_done = curve.cell(lower) == curve.cell(upper);
    }
    Ok(())
}

/// Halves all parts that are to be cut; the later half comes first.
fn halved(keys: &[u64], parts: Vec<Chunk>, ranks: &mut dyn Collective) -> Result<Vec<Chunk>> {
    let half = |part: &Chunk| {
        let here = &keys[part.here.clone()];
        here.partition_point(|key| key >> (31 + part.bits) & 1 == 0)
    };
    let own: Vec<usize> = parts.iter().filter(|p| p.is_cut()).map(half).collect();
    let all = ranks.sums(Ok(own.iter().map(|n| *n as u64).collect()))?;
    let mut halves = own.into_iter().zip(all);
    let mut out = Vec::with_capacity(parts.len() + halves.len());
    for part in parts {
        let Some((own, all)) = part.is_cut().then(|| halves.next()).flatten() else {
            out.push(part);
            continue;
        };
        let middle = part.here.start + own;
        let later = (middle..part.here.end, part.count - all.min(part.count));
        let earlier = (part.here.start..middle, all);
        for (here, count) in [later, earlier] {
            if count > 0 {
                out.push(Chunk {
                    here,
                    count,
                    bits: part.bits - 1,
                    ..part.clone()
                });
            }
        }
    }
    Ok(out)
}
