//! The CPU back end: one file per stage, each a function from slices to slices.
//!
//! | stage | reads | writes |
//! |---|---|---|
//! | `classify.rs` | blocks in view, values, transfer function | visible particles |
//! | `shade.rs` | visible particles, where colours depend on the view | their colours |
//! | `project.rs` | visible particles, camera | footprints |
//! | `sort.rs` | footprints | their order, front to back |
//! | `bin.rs` | footprints in order | lists per tile |
//! | `surface.rs` | lists, footprints of opaque surfels | tiles of the surface |
//! | `rasterise.rs` | lists, footprints | tiles |
//! | `resolve.rs` | tiles | image, depth |
//!
//! A column density has two stages of its own, in place of `classify.rs` and of `sort.rs` to
//! `resolve.rs`:
//!
//! | stage | reads | writes |
//! |---|---|---|
//! | `amplitude.rs` | blocks in view, values | particles with signed amplitudes |
//! | `column.rs` | footprints | sums per pixel |
//!
//! Cull comes first and is shared: [`crate::blocks::cull`]. `lanes.rs` is the rasteriser's inner
//! loop, and the dispatch of instruction sets; `cut.rs` cuts kernels at surfaces and clip planes,
//! `layers.rs` sums them in sheets and slabs, `row.rs` is what these two need of a footprint.

#![allow(
    clippy::cast_possible_truncation,
    reason = "stages work in f32 and u32 by design; the renderer has checked counts and image sizes"
)]

mod amplitude;
mod bin;
mod classify;
mod column;
mod cut;
mod lanes;
mod layers;
mod light;
mod post;
mod project;
mod rasterise;
mod resolve;
mod row;
mod shade;
mod sort;
mod surface;

pub use amplitude::{AmplitudeSummary, count_amplitudes, fill_amplitudes};
pub use bin::{Bins, bin, for_each_tile};
pub use classify::{classify, count_classified};
pub use column::{ColumnInput, ColumnSums, bin_columns, list_visible};
pub use lanes::{SimdLevel, Tile};
pub use light::{Sides, light, lit};
pub use post::PostClassification;
#[cfg(feature = "gpu")]
pub(crate) use project::Rule;
pub use project::{ProjectOutput, project};
pub use rasterise::{RasteriseSettings, rasterise};
pub use resolve::{resolve, resolve_depth, resolve_normals};
pub use shade::shade;
pub use sort::{footprint_index, sort};
pub use surface::{NormalTile, rasterise_surface};
