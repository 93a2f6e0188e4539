//! Finds the layer with the greatest mean value on each pixel's ray: a maximum-intensity projection.
//!
//! Kernels are cut into slabs and summed as in [`slabs`](super::slabs). A finished layer is compared
//! instead of composited. While a tile is drawn, its pixels keep the greatest value in `red` and a flag
//! in `green` that tells if there was any. Opacities stay zero, so that no ray ends early.
//!
//! Twin: `shaders/tile/accumulate/maximum.wgsl`.

use super::ring::layer_start;
use crate::cpu::tile::classify::slab::PostClassification;
use crate::cpu::tile::pixels::{Plane, Tile};
use crate::record::ViewUniform;

/// Compares a layer with the greatest value of each pixel. Of equal values the nearer counts.
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

/// Applies the transfer function to the greatest values.
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
