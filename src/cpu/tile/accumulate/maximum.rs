//! Of each pixel's layers the one with the greatest mean value: a maximum-intensity projection.
//!
//! Kernels are cut into slabs and summed there as [`slabs`](super::slabs) does; a layer that is closed is
//! compared instead of composited. While a tile is drawn its pixels keep the greatest value in `red` and
//! whether there was any in `green`; opacities stay zero, so that nothing ends a ray early.
//!
//! Twin: `shaders/tile/accumulate/maximum.wgsl`.

use super::ring::layer_start;
use crate::cpu::tile::classify::slab::PostClassification;
use crate::cpu::tile::pixels::{Plane, Tile};
use crate::record::ViewUniform;

/// Compares a layer with what its pixels have. Of two alike the nearer counts.
///
/// - `lengths`, `carried`: W and N of [`classify::slab`](crate::cpu::tile::classify::slab).
pub(super) fn take(
    view: &ViewUniform,
    number: u32,
    lengths: &Plane,
    carried: &Plane,
    tile: &mut Tile,
) {
    let depth = 0.5 * (layer_start(view, number) + layer_start(view, number + 1));
    for (i, (length, carried)) in lengths.iter().zip(carried).enumerate() {
        let mean = carried / length;
        // Phrased so that NaN is left out.
        let counts = *length >= view.least_length && (tile.green[i] == 0.0 || mean > tile.red[i]);
        if counts {
            (tile.red[i], tile.green[i], tile.depth[i]) = (mean, 1.0, depth.max(0.0));
        }
    }
}

/// The transfer function's colours of the greatest values.
pub(super) fn colour(tile: &mut Tile, post: &PostClassification<'_>, is_count: bool) {
    if is_count {
        return;
    }
    for i in 0..tile.alpha.len() {
        if tile.green[i] == 0.0 {
            continue;
        }
        let [red, green, blue, _] = post.transfer.classify_share(tile.red[i]);
        (tile.red[i], tile.green[i], tile.blue[i]) = (red, green, blue);
        tile.alpha[i] = 1.0;
    }
}
