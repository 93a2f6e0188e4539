//! Draws frames on the CPU: one file per stage, each a function from slices to slices.
//!
//! | stage | reads | writes |
//! |---|---|---|
//! | `classify.rs` | blocks in view, values, transfer function | visible particles |
//! | `extent.rs` | the same, and the local models of the field | pieces of visible particles |
//! | `shade.rs` | visible particles whose colours depend on the view | their colours |
//! | `light.rs` | visible particles with normals, lights, shadows | their colours |
//! | `project/` | visible particles, camera | footprints |
//! | `sort.rs` | footprints | their order, front to back |
//! | `bin.rs` | footprints in order | lists per tile |
//! | `tile/` | lists, footprints of opaque surfels | tiles of the surface |
//! | `tile/` | lists, footprints | tiles |
//! | `resolve.rs` | tiles | image, depth |
//! | `pick.rs` | all of these, for one pixel | the particles that it shows |
//!
//! A column density has two stages of its own, in place of `classify.rs` and of `sort.rs` to
//! `resolve.rs`:
//!
//! | stage | reads | writes |
//! |---|---|---|
//! | `amplitude.rs` | blocks in view, values | particles with signed amplitudes |
//! | `tile/` | lists, footprints | sums per pixel |
//!
//! A slice sums the same amplitudes on a plane: `slice.rs`.
//!
//! If a frame's particles exceed its memory, `strips.rs` runs these stages for one strip of the picture
//! after the other.
//!
//! `shadow/` makes the shadows that the stage `light` reads, for both back ends, and keeps none.
//!
//! Culling comes first and is shared: [`crate::blocks::cull`]. `tile/` has a file for each way to
//! evaluate, cut, accumulate and classify kernels on the pixels of a tile.

#![allow(
    clippy::cast_possible_truncation,
    reason = "stages work in f32 and u32 by design; the renderer has checked counts and image sizes"
)]

mod amplitude;
mod bin;
mod classify;
mod extent;
mod frame;
mod light;
mod pass;
mod pick;
mod project;
mod resolve;
mod shade;
mod shadow;
mod slice;
mod sort;
mod strips;
mod tile;

pub use crate::simd::SimdLevel;
pub use amplitude::{count_amplitudes, fill_amplitudes};
pub use bin::{Bins, bin, for_each_tile};
pub use classify::{classify, count_classified};
pub use extent::Pieces;
pub(crate) use frame::CpuFrames;
pub(crate) use light::smooth_normal;
pub use light::{Shadowing, Sides, light, lit};
pub(crate) use pass::{MOST_ENTRIES, tile_size};
pub(crate) use pick::shares;
pub use project::{ProjectInput, ProjectOutput, project};
pub use resolve::{resolve, resolve_depth, resolve_normals};
pub use shade::{encode, shade};
pub(crate) use shadow::{
    GREATEST_LEAN, SHADOW_DIRECTIONS, SHADOW_TAPS, STEEPEST_SHADOW, ShadowRequest, make_shadows,
};
pub(crate) use slice::{Plane, slice};
pub use sort::{footprint_index, list_visible, sort};
pub(crate) use tile::TileSums;
pub use tile::{
    ColumnInput, ColumnSums, NormalTile, PostClassification, RasteriseSettings, Tile, bin_columns,
    rasterise, rasterise_surface,
};
