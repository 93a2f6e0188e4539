//! Axis *interval*: restricts the part of a pixel's ray that counts. The whole ray needs no file: the row
//! of optical depths is used as it is. `cut.rs` takes shares of the row, `domain.rs` cuts each kernel at
//! planes of its own, and `edges.rs` clips surfels.

pub(super) mod cut;
pub(super) mod domain;
pub(super) mod edges;

use super::evaluate::near::NearWalk;
use super::evaluate::{Along, Evaluate, Row};
use super::pixels::{Plane, RowOf};
use crate::constants::TILE_SIZE;
use crate::math::lane::cdf;

/// Returns the share of each pixel's optical depth that lies in front of a depth of that pixel.
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
        // NaN counts as behind.
        shares[lane] = if share > 0.0 { share } else { 0.0 };
    }
    within_domain(row, shares)
}

/// Returns the shares in front of the depths at which the rays of a tile begin (`unmet` 0), are divided
/// or end (1). If the kernel does not reach that far, the result is `unmet` without evaluation.
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

/// Clamps shares to the part of a kernel inside the domain of its data.
#[inline(always)]
fn within_domain(row: &Row, mut shares: RowOf<f32>) -> RowOf<f32> {
    if let Some([from, to]) = &row.domain {
        for lane in 0..TILE_SIZE {
            shares[lane] = shares[lane].max(from[lane]).min(to[lane]);
        }
    }
    shares
}

/// Returns the optical depths of a row for the whole ray.
#[inline(always)]
pub(super) fn whole(row: &Row) -> RowOf<f32> {
    match &row.domain {
        Some([from, to]) => between(row, from, to),
        None => row.tau,
    }
}

/// Returns a row's optical depths between two shares at each pixel.
#[inline(always)]
pub(super) fn between(row: &Row, from: &RowOf<f32>, to: &RowOf<f32>) -> RowOf<f32> {
    let mut taus = [0.0; TILE_SIZE];
    for lane in 0..TILE_SIZE {
        // `max` takes the other argument where one is NaN.
        taus[lane] = row.tau[lane] * (to[lane] - from[lane]).max(0.0);
    }
    taus
}

/// Clamps a depth to the part of a ray that is drawn.
#[inline(always)]
pub(super) fn within(depth: f32, [from, to]: [f32; 2]) -> f32 {
    depth.min(to).max(from)
}
