//! The order of points along a Morton curve, on which those that follow one another lie close together.

use glam::DVec3;

/// Bits of an axis on the curve.
const BITS: u32 = 21;

/// Points in their order along a Morton curve through the box of all.
pub(super) fn morton_order(positions: &[DVec3]) -> Vec<usize> {
    let least = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let most = (positions.iter().copied()).fold(DVec3::NEG_INFINITY, DVec3::max);
    let extent = most - least;
    let code = |p: &DVec3| {
        (0..3).fold(0_u64, |code, axis| {
            let share = (p[axis] - least[axis]) / extent[axis];
            // None of a layer without thickness.
            let share = if share.is_finite() { share } else { 0.0 };
            code | spread(share) << axis
        })
    };
    let mut order: Vec<(u64, usize)> = positions.iter().map(code).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

/// A share of [`BITS`] bits, each three places from the next.
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
