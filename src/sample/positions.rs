//! Sorts positions and finds those that coincide.

use std::cmp::Ordering;

use glam::DVec3;
use rayon::prelude::*;

/// Returns the coordinates for comparison: adding 0.0 turns -0 into 0.
fn key(p: DVec3) -> [f64; 3] {
    (p + DVec3::ZERO).to_array()
}

/// Sorts indices so that those of one position are adjacent and ascending.
pub(crate) fn sort_by_position(positions: &[DVec3], order: &mut [u32]) {
    order.par_sort_unstable_by(|&i, &j| {
        compare(positions[i as usize], positions[j as usize]).then(i.cmp(&j))
    });
}

/// Compares positions by x, then y, then z.
pub(crate) fn compare(a: DVec3, b: DVec3) -> Ordering {
    let [a, b] = [a, b].map(key);
    a[0].total_cmp(&b[0])
        .then(a[1].total_cmp(&b[1]))
        .then(a[2].total_cmp(&b[2]))
}

/// Returns true if two positions are equal, bit by bit apart from the sign of zero.
pub(crate) fn is_same(a: DVec3, b: DVec3) -> bool {
    key(a).map(f64::to_bits) == key(b).map(f64::to_bits)
}

/// Narrows an index for [`Values::gather`]. Data sets of 2³² samples or more are refused before.
#[expect(
    clippy::cast_possible_truncation,
    reason = "sample counts are checked against u32 first"
)]
pub(crate) fn index_u32(i: usize) -> u32 {
    i as u32
}

/// Returns the least and the greatest corner of a box around positions; infinite and in reverse order without any.
#[inline(always)]
pub(super) fn around(positions: impl Iterator<Item = DVec3>) -> [DVec3; 2] {
    let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    positions.fold(none, |[low, high], p| [low.min(p), high.max(p)])
}

/// Edge of a cube with the mean volume of particles; 1 if the particles have no volume.
pub(crate) fn mean_spacing(volume_sum: f64, count: usize) -> f64 {
    let spacing = Some((volume_sum / count as f64).cbrt());
    spacing.filter(|s| *s > 0.0).unwrap_or(1.0)
}
