//! Builds levels of detail: clusters of particles that are drawn as one particle each where they lie far below a pixel.
//!
//! A cluster's particle has the mass (or volume) of its members, their centre and their mean colour. Its variance is
//! the mean of their variances plus the variance of their positions (the law of total variance). All means are weighted
//! by strength. The error begins with the third moments, on which each block keeps bounds ([`MergeBounds`]).
//!
//! Values are kept as mean and spread, and a transfer function is averaged over the interval that they fill
//! ([`TransferFunction::classify_spread`]). An edit of the transfer function changes no particle, merged or not.
//!
//! [`TransferFunction::classify_spread`]: crate::scene::TransferFunction::classify_spread

mod coarse;
mod distribution;
mod fine;
mod lattice;
mod levels;
mod moments;
mod source;
mod sums;

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::overlap::OverlapCounts;
use super::tree::{PartialTree, Tree};
use super::{Block, BlockedVolume};
use crate::constants::BLOCK_CAPACITY;
use crate::error::Result;
use crate::scene::columns::columns;
use crate::scene::{
    Averages, ColourIn, Column, Shared, Slopes, StrengthIn, TransferFunction, ValuesIn, Weighting,
};
use crate::task::Task;

pub(super) use coarse::{Atoms, coarse_levels};
pub(super) use fine::fine_levels;
pub(super) use lattice::{
    CubeMoments, LONGEST_COPIED, LongCube, WholeCube, adopted, is_large, levels_of, merge_lattice,
};
pub(super) use levels::{Head, Level, Levels};
pub(super) use source::{Shapes, Source};
pub(super) use sums::Cluster;

/// Number of particles in a cluster of the first level, and of clusters in one of the next.
pub(super) const MERGE_RATIO: usize = 16;

/// Number of levels whose clusters are merged from particles; later levels are merged from clusters. A cluster of the
/// last fine level takes more memory than a particle, and represents 256.
const FINE_LEVELS: u32 = 2;

/// Most particles of the block at which levels end.
const LAST_LEVEL: usize = 16;

/// Merges particles level by level. Returns `None` if they cannot be merged ([`is_mergeable`]), or if all are in one
/// block.
pub(super) fn merge_points(
    source: &Source<'_>,
    tree: &Tree,
    overlaps: &OverlapCounts,
    task: Option<&Task>,
) -> Result<Option<Levels>> {
    if !is_mergeable(source) || source.positions.len() <= BLOCK_CAPACITY {
        return Ok(None);
    }
    let all = PartialTree {
        tree,
        at: 0,
        start: 0,
    };
    let (mut levels, clusters) = fine_levels(source, &[all], overlaps, true, task)?;
    if let Some(last) = levels.last().filter(|last| !levels::is_last(&last.heads)) {
        let runs: Vec<_> = clusters.iter().map(Cluster::run).collect();
        let atoms = Atoms {
            tree: tree.above(&runs),
            clusters,
            heads: last.heads.clone(),
        };
        let places = &mut |asked: &[Cluster]| Ok(source.places_of(asked));
        let places = source.values.is_some().then_some(places as _);
        levels.extend(coarse_levels(&atoms, overlaps, places, task)?);
    }
    Ok(Some(Levels(levels)))
}

/// Whether particles can be merged. Splats that state opacities cannot, nor can particles with infinite values or with
/// colours that depend on the view.
pub(super) fn is_mergeable(source: &Source<'_>) -> bool {
    !matches!(source.strength, StrengthIn::PeakOpacity { .. })
        && !matches!(source.colour, ColourIn::Harmonics { .. })
        && source.values.is_none_or(|v| !v.has_infinite())
}

/// Data of merged particles beyond those of other particles.
#[derive(Debug, Clone, Default)]
pub struct Merged {
    /// Bounds of each block.
    pub bounds: Vec<MergeBounds>,
    /// Half widths of the intervals that the members' values fill evenly, per particle; empty without values.
    pub spreads: Column<f32>,
    /// Transfer function over intervals of values; present with values and a transfer function.
    pub transfer: Option<Arc<MergedTransfer>>,
    /// Peak optical depth of a single member before any filter, over the optical depth of the cluster's mass
    /// \[1/length²\]. Scaled by how far the members' kernels lie apart. Per particle; empty where kernels overlap.
    pub member_depths: Column<f32>,
}

columns! { [] Shared, Merged {
    Self { spreads, member_depths, .. } => {
        "spread": [f32; 1] in spreads;
        "member_depth": [f32; 1] in member_depths;
    }
} }

/// Averages of a transfer function over intervals of values, and its slopes, weighted to suit the strength of a volume.
#[derive(Debug)]
pub struct MergedTransfer {
    /// Averages.
    pub averages: Averages,
    /// Slopes.
    pub slopes: Slopes,
}

impl MergedTransfer {
    /// Tabulates a transfer function; colours are averaged with this weighting.
    pub fn new(transfer: &TransferFunction, weighting: Weighting) -> Self {
        Self {
            averages: transfer.averages(weighting),
            slopes: transfer.slopes(weighting),
        }
    }
}

/// Returns the weighting of colours in merged particles.
pub(super) fn weighting(strength: &StrengthIn<Shared>) -> Weighting {
    match strength {
        StrengthIn::Classified { .. } => Weighting::Extinction,
        _ => Weighting::Even,
    }
}

impl Merged {
    /// Linear RGB and extinction of particle `i`; `values`: the means.
    #[inline]
    pub(crate) fn classify(&self, values: Option<&ValuesIn<Shared>>, i: usize) -> [f32; 4] {
        match (&self.transfer, values) {
            (Some(transfer), Some(values)) => {
                let averages = &transfer.averages;
                averages.classify_spread(values.get(i), self.spreads[i])
            }
            _ => [0.0; 4],
        }
    }
}

/// Bounds on the difference between merged particles and their members, for a block: the greatest over its clusters
/// unless stated otherwise. Lengths in world units.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct MergeBounds {
    /// Cube root of the norm of the third central moments, root mean square over clusters.
    pub third_mean: f32,
    /// Cube root of the norm of the third central moments, greatest over clusters.
    pub third: f32,
    /// Fourth root of the norm of the fourth cumulants.
    pub fourth: f32,
    /// Square root of the excess of the variance over that of the narrowest member.
    pub second: f32,
    /// Half width of the interval that the members' values fill.
    pub spread: f32,
    /// Standard deviation of the members' colours.
    pub colour: f32,
    /// Unevenness of the members' values over that interval, root mean square over clusters. It is the mean distance by
    /// which values must move to be spread evenly.
    pub uneven: f32,
}

impl MergeBounds {
    /// Returns the greater of each bound.
    fn max(self, other: Self) -> Self {
        Self {
            third_mean: self.third_mean.max(other.third_mean),
            third: self.third.max(other.third),
            fourth: self.fourth.max(other.fourth),
            second: self.second.max(other.second),
            spread: self.spread.max(other.spread),
            colour: self.colour.max(other.colour),
            uneven: self.uneven.max(other.uneven),
        }
    }
}

/// Returns the unevenness of values: the Wasserstein distance of first order from values spread evenly over `mean -
/// spread ..= mean + spread`. It is the mean distance by which the values must move to be spread evenly.
///
/// The averages over both of a function with slope at most 1 differ by no more than this.
///
/// - `members`: the share and the value of each; the shares add up to 1.
fn unevenness(members: impl Iterator<Item = (f64, f64)>, mean: f64, spread: f64) -> f64 {
    let mut places = Places::new(mean, spread);
    members.for_each(|(share, value)| places.add(share, value));
    places.unevenness()
}

/// Number of points at which cumulative shares are compared.
const BINS: usize = 32;

/// Unit in which shares are counted, so that their sums do not depend on an order.
const SHARE: f64 = 1.0 / (1_u64 << 52) as f64;

/// Greatest distance of a value beyond the interval that counts, in units of the half width. Values lie closer to their
/// mean than half the width on average, so that the sum of the excess fits 63 bits.
const FARTHEST: f64 = 1024.0;

/// Distribution of values about their mean, which [`unevenness`] sums.
#[derive(Debug, Clone, Copy)]
pub(super) struct Places {
    mean: f64,
    spread: f64,
    sums: PlaceSums,
}

/// Sums in units of [`SHARE`]: the share of the members in each bin, then the sum of distances beyond the interval.
pub(super) type PlaceSums = [i64; BINS + 1];

impl Places {
    /// Starts without values.
    fn new(mean: f64, spread: f64) -> Self {
        Self {
            mean,
            spread,
            sums: [0; BINS + 1],
        }
    }

    #[inline]
    fn add(&mut self, share: f64, value: f64) {
        let place = (value - self.mean) / self.spread;
        let inside = place.clamp(-1.0, 1.0);
        let beyond = (place - inside).abs().min(FARTHEST);
        let share = share / SHARE;
        let bin = (0.5 * (inside + 1.0) * BINS as f64) as usize;
        self.sums[bin.min(BINS - 1)] += share as i64;
        self.sums[BINS] += (share * beyond) as i64;
    }

    /// Adds another distribution.
    fn and(self, other: &Self) -> Self {
        self.with(&other.sums)
    }

    /// Adds the sums of another distribution.
    pub(super) fn with(mut self, others: &PlaceSums) -> Self {
        for (own, other) in self.sums.iter_mut().zip(others) {
            *own += other;
        }
        self
    }

    /// Sums in units of [`SHARE`].
    pub(super) fn sums(&self) -> &PlaceSums {
        &self.sums
    }

    fn unevenness(&self) -> f64 {
        if !(self.spread > 0.0) {
            return 0.0;
        }
        let [shares @ .., beyond] = self.sums.map(|sum| sum as f64 * SHARE);
        let mut below = 0.0;
        let mut between = 0.0;
        for (i, share) in shares.iter().enumerate() {
            below += share;
            between += (below - (i + 1) as f64 / BINS as f64).abs();
        }
        self.spread * (beyond + between * 2.0 / BINS as f64)
    }
}

/// Gives the blocks of a volume and its levels the ranges and bounds of all their members. `volumes` are listed from
/// the finest to the coarsest, and parents are counted from the first merged block.
pub(super) fn widen_to_members(volumes: &mut [BlockedVolume]) {
    let Some((base, merged)) = volumes.split_first_mut() else {
        return;
    };
    let mut first = 0;
    let firsts: Vec<usize> = merged
        .iter()
        .map(|volume| {
            let own = first;
            first += volume.blocks.len();
            own
        })
        .collect();
    let mut bounds = vec![None; first];
    for block in &base.blocks {
        widen(&mut bounds, block);
    }
    for (volume, &first) in merged.iter_mut().zip(&firsts) {
        // Children come before their parents: the finer volumes first, and within one volume the last blocks first.
        for (i, block) in volume.blocks.iter_mut().enumerate().rev() {
            if let Some(Members {
                values,
                around,
                spread,
                sigmas,
            }) = bounds[first + i]
            {
                block.value_range = values;
                block.values_around = around;
                block.greatest_spread = spread;
                block.min_sigma = block.min_sigma.min(sigmas[0]);
                block.max_sigma = block.max_sigma.max(sigmas[1]);
            }
            widen(&mut bounds, block);
        }
    }
}

/// Bounds on all members of a merged block.
#[derive(Debug, Clone, Copy)]
struct Members {
    values: [f32; 2],
    around: [f32; 2],
    spread: f32,
    sigmas: [f32; 2],
}

/// Adds a block to the bounds of its parent.
fn widen(bounds: &mut [Option<Members>], block: &Block) {
    let union = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    let own = Members {
        values: block.value_range,
        around: block.values_around,
        spread: block.greatest_spread,
        sigmas: [block.min_sigma, block.max_sigma],
    };
    if let Some(of_parent) = bounds.get_mut(block.parent as usize) {
        *of_parent = Some(of_parent.map_or(own, |b| Members {
            values: union(b.values, own.values),
            around: union(b.around, own.around),
            spread: b.spread.max(own.spread),
            sigmas: union(b.sigmas, own.sigmas),
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> f64 {
        let share = 1.0 / values.len() as f64;
        let mean = values.iter().sum::<f64>() * share;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() * share;
        let members = values.iter().map(|&v| (share, v));
        unevenness(members, mean, (3.0 * variance).sqrt())
    }

    #[test]
    fn what_is_even_moves_nowhere_and_what_is_not_as_far_as_it_must() {
        assert!(of(&[7.0; 64]).abs() < 1e-12);
        let ramp: Vec<f64> = (0..4096).map(f64::from).collect();
        // Less than a bin of 32 over both ends.
        assert!(of(&ramp) < 4096.0 / 32.0, "{}", of(&ramp));
        // Two values, 2 apart: by quantiles, the integral of |sqrt(3) t - 1| over 0..1 is (1/2 + (sqrt(3) - 1)²/2) /
        // sqrt(3) = .443, to a bin's width.
        let halves: Vec<f64> = (0..64).map(|i| f64::from(i % 2) * 2.0).collect();
        assert!((of(&halves) - 0.443).abs() < 0.06, "{}", of(&halves));
        // One value of many differs: mostly its distance.
        let lone: Vec<f64> = (0..4096).map(|i| f64::from(u8::from(i == 9))).collect();
        let deviation = (1.0 / 4096.0_f64).sqrt();
        assert!(of(&lone) > 0.7 * deviation && of(&lone) < deviation);
        // NaN has no unevenness.
        assert!(unevenness([(1.0, f64::NAN)].into_iter(), 0.0, f64::NAN) == 0.0);
    }
}
