//! Defines the data of merged particles in a level of detail.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use crate::scene::columns::columns;
use crate::scene::{
    Averages, Column, Shared, Slopes, StrengthIn, TransferFunction, ValuesIn, Weighting,
};

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
    pub(super) fn max(self, other: Self) -> Self {
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
