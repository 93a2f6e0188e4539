//! Colours splats by the filter path that draws them, for debugging.

use super::filter::Filter;
use crate::record::{PATH_AFFINE, PATH_EXACT};

/// Linear RGB of the ways to draw a footprint, in the order of [`choice_index`].
pub const CHOICE_COLOURS: [[f32; 3]; 10] = [
    // Exact: red.
    [0.9, 0.05, 0.03],
    // Affine: green.
    [0.05, 0.5, 0.1],
    // The reconstruction kernel alone: blue.
    [0.05, 0.15, 0.9],
    // The low-pass filter alone: yellow.
    [0.9, 0.75, 0.03],
    // Round: cyan.
    [0.03, 0.6, 0.8],
    // Across the plane of the eye, and splats by the rule of their format: white.
    [0.9, 0.9, 0.9],
    // Merged: magenta, the darker the more particles.
    [0.9, 0.1, 0.8],
    [0.55, 0.03, 0.6],
    [0.28, 0.01, 0.4],
    [0.12, 0.0, 0.22],
];

/// Returns the index in [`CHOICE_COLOURS`] of a footprint's colour. It depends on its block's level of
/// detail, its own path and its block's filter. Twin: `choice_index` in `shaders/project.wgsl`.
#[inline]
pub fn choice_index(level: u32, path: u32, filter: Filter) -> usize {
    if level > 0 {
        return 5 + level.min(4) as usize;
    }
    match (path, filter) {
        (PATH_EXACT, _) => 0,
        (PATH_AFFINE, Filter::Reconstruction) => 2,
        (PATH_AFFINE, Filter::LowPass) => 3,
        (PATH_AFFINE, Filter::Isotropic) => 4,
        (PATH_AFFINE, _) => 1,
        _ => 5,
    }
}
