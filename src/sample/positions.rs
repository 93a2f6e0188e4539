//! Positions that are one.

use std::cmp::Ordering;

use glam::DVec3;
use rayon::prelude::*;

/// The coordinates that tell positions apart: + 0.0 makes -0 and 0 one.
fn key(p: DVec3) -> [f64; 3] {
    (p + DVec3::ZERO).to_array()
}

/// Sorts indices so that those at one position are beside one another, rising.
pub(crate) fn sort_by_position(positions: &[DVec3], order: &mut [u32]) {
    order.par_sort_unstable_by(|&i, &j| {
        compare(positions[i as usize], positions[j as usize]).then(i.cmp(&j))
    });
}

/// Positions along x, those of one x along y, those of one y along z.
pub(crate) fn compare(a: DVec3, b: DVec3) -> Ordering {
    let [a, b] = [a, b].map(key);
    a[0].total_cmp(&b[0])
        .then(a[1].total_cmp(&b[1]))
        .then(a[2].total_cmp(&b[2]))
}

/// Whether two positions are one, bit by bit but for the sign of zero.
pub(crate) fn is_same(a: DVec3, b: DVec3) -> bool {
    key(a).map(f64::to_bits) == key(b).map(f64::to_bits)
}
