//! Axis *interval*: which part of a pixel's ray counts. All of it needs no file: the row of optical
//! depths is taken as it is. `cut.rs` takes shares of it, `domain.rs` cuts each kernel at planes of its
//! own, `edges.rs` says what clip planes leave of a
//! surfel.

pub(super) mod cut;
pub(super) mod domain;
pub(super) mod edges;

use super::evaluate::near::NearWalk;
use super::evaluate::{Along, Evaluate, Row};
use super::pixels::{Plane, RowOf};
use crate::constants::TILE_SIZE;
use crate::math::lane::cdf;

/// The share of each pixel's optical depth that lies in front of a depth of its own.
#[inline(always)]
pub(super) fn shares_up_to<const FMA: bool>(
    evaluate: &Evaluate<'_>,
    row: &Row,
    depths: &[f32],
) -> RowOf<f32> {
    let mut shares = [0.0; TILE_SIZE];
    let Some(depths) = depths.first_chunk::<TILE_SIZE>() else {
        return shares;
    };
    let along = evaluate.along();
    if along == Along::HalfGaussian {
        return within_domain(row, NearWalk::shares_up_to::<FMA>(row, depths));
    }
    let is_point = along == Along::Point;
    for lane in 0..TILE_SIZE {
        let ahead = row.ahead(lane, depths[lane]);
        let share = if is_point {
            f32::from(u8::from(ahead > 0.0))
        } else {
            cdf::<FMA>(ahead)
        };
        // NaN lies behind.
        shares[lane] = if share > 0.0 { share } else { 0.0 };
    }
    within_domain(row, shares)
}

/// The shares that lie in front of where the rays of a tile begin (`unmet` 0), are divided or end (1): no
/// question where the kernel does not reach that far.
#[inline(always)]
pub(super) fn shares_at<const FMA: bool>(
    evaluate: &Evaluate<'_>,
    row: &Row,
    plane: &Plane,
    meets: bool,
    unmet: f32,
) -> RowOf<f32> {
    if meets {
        shares_up_to::<FMA>(evaluate, row, &plane[row.first()..])
    } else {
        within_domain(row, [unmet; TILE_SIZE])
    }
}

/// Shares held to the part of a kernel that lies in the domain of its data.
#[inline(always)]
fn within_domain(row: &Row, mut shares: RowOf<f32>) -> RowOf<f32> {
    if let Some([from, to]) = &row.domain {
        for lane in 0..TILE_SIZE {
            shares[lane] = shares[lane].max(from[lane]).min(to[lane]);
        }
    }
    shares
}

/// The optical depths of a row of which all of the ray counts.
#[inline(always)]
pub(super) fn whole(row: &Row) -> RowOf<f32> {
    match &row.domain {
        Some([from, to]) => between(row, from, to),
        None => row.tau,
    }
}

/// A row's optical depths between two shares of each.
#[inline(always)]
pub(super) fn between(row: &Row, from: &RowOf<f32>, to: &RowOf<f32>) -> RowOf<f32> {
    let mut taus = [0.0; TILE_SIZE];
    for lane in 0..TILE_SIZE {
        // `max` takes the other argument where one is NaN.
        taus[lane] = row.tau[lane] * (to[lane] - from[lane]).max(0.0);
    }
    taus
}

/// A depth held to the part of a ray that is drawn.
#[inline(always)]
pub(super) fn within(depth: f32, [from, to]: [f32; 2]) -> f32 {
    depth.min(to).max(from)
}
