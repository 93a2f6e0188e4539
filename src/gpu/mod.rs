//! The GPU back end, on wgpu: one file per stage with the names of [`crate::cpu`], each with a
//! shader of the same name in `shaders/`.
//!
//! | file | subject |
//! |---|---|
//! | `device.rs` | adapters, limits, errors of the device |
//! | `kernel.rs` | a compute pipeline and the buffers bound to it |
//! | `memory.rs` | buffers: up, down, and how much fits |
//! | `shaders.rs` | shaders composed of the prelude, `shaders/shared/` and a stage's own file |
//! | `scan.rs` | prefix sums, which several stages need |
//! | `radix.rs` | a stable sort of pairs, which sort and bin need |
//! | `sort.rs` | footprints of all parts in depth order |
//! | `gather.rs` | a chunk of them side by side |
//! | `bin.rs` | the chunk's lists per tile |

#![allow(
    clippy::cast_possible_truncation,
    reason = "device memory is counted in 32-bit words by design; sizes are checked against the limits"
)]

mod bin;
mod device;
mod gather;
mod kernel;
mod memory;
mod radix;
mod scan;
mod shaders;
mod sort;

pub use bin::{ChunkBins, MAX_BAND_TILES, bin};
pub use device::{AdapterChoice, Gpu};
pub use scan::exclusive_scan;
pub use shaders::{Shader, prelude};
pub use sort::sort;
