//! Sorts points along a Morton curve, so that successive points lie close together.

use glam::DVec3;

/// Number of bits per axis on the curve.
const BITS: u32 = 21;

/// Returns the indices of the points in their order along a Morton curve through their bounding box.
pub(in crate::io) fn morton_order(positions: &[DVec3]) -> Vec<usize> {
    let least = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let most = (positions.iter().copied()).fold(DVec3::NEG_INFINITY, DVec3::max);
    let extent = most - least;
    let code = |p: &DVec3| {
        (0..3).fold(0_u64, |code, axis| {
            let share = (p[axis] - least[axis]) / extent[axis];
            // The quotient is not finite along an axis without extent.
            let share = if share.is_finite() { share } else { 0.0 };
            code | spread(share) << axis
        })
    };
    let mut order: Vec<(u64, usize)> = positions.iter().map(code).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

/// Converts a fraction to [`BITS`] bits, each three places from the next.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of 2^21 steps"
)]
fn spread(share: f64) -> u64 {
    let steps = f64::from((1_u32 << BITS) - 1);
    let whole = (steps * share) as u64;
    (0..BITS).fold(0, |bits, k| bits | (whole >> k & 1) << (3 * k))
}
