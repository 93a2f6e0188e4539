#![doc = include_str!("../../docs/gpu.md")]
//!
//! # Modules
//!
//! The stages of [`crate::cpu`] under the same names, each with its own shader in `shaders/`:
//!
//! | stage | reads | writes |
//! |---|---|---|
//! | `cull.rs` | blocks, camera, rules for filters | blocks in view, their filters, the range of depth keys |
//! | `classify.rs` | blocks in view, values, transfer function | visible particles; for column densities all, with their amplitudes |
//! | `shade.rs` | visible particles whose colours depend on the view | their colours |
//! | `project.rs` | visible particles, camera | footprints |
//! | `sort.rs` | footprints | their order, front to back |
//! | `gather.rs` | order, footprints | a chunk of footprints in consecutive memory, in order |
//! | `bin.rs` | the chunk | lists per tile |
//! | `rasterise.rs` | lists, the chunk | pixels |
//! | `surface.rs` | lists, the chunk, of opaque surfels | pixels of the surface |
//! | `compose.rs` | pixels, the surface's | pixels with the surface behind them |
//! | `resolve.rs` | pixels | pixels before a background |
//! | `present.rs` | pixels | a texture of the caller's |
//!
//! | file | subject |
//! |---|---|
//! | `scene.rs`, `particles.rs` | the upload: a volume as parts |
//! | `frame.rs` | a frame: its passes, and reading it back |
//! | `pass/` | the stages of a pass in order; their memory |
//! | `tile.rs` | code that both rasterisers share |
//! | `radix.rs`, `scan.rs` | a stable sort of pairs and prefix sums, which several stages need |
//! | `f64.rs` | double precision in integers, for its test |
//! | `merged.rs` | functions of merged particles, for their test |
//! | `device.rs` | adapters, limits, errors of the device |
//! | `kernel.rs` | a compute pipeline and the buffers bound to it |
//! | `kinds.rs` | kinds of data of a volume, for which shaders are specialised |
//! | `memory.rs` | buffers: allocation, upload, read-back |
//! | `constants.rs`, `packed.rs` | numbers that the host and the shaders share; how they are packed |
//! | `shader.rs` | shaders composed of the prelude, `shaders/shared/` and a stage's own files |
//! | `shaders.rs` | a list of all shaders |
//! | `timer.rs` | times by the device's own clock |
//!
//! Two tests look at the shaders as text: `reflection.rs` with naga, `browser.rs` with Chromium.
//!
//! Each stage is also a function from slices to slices, by which tests compare it with its twin.

#![allow(
    clippy::cast_possible_truncation,
    reason = "device memory is counted in 32-bit words by design; sizes are checked against the limits"
)]

mod bin;
#[cfg(test)]
mod browser;
mod classify;
mod compose;
mod constants;
mod cull;
mod device;
mod f64;
mod frame;
mod gather;
mod kernel;
mod kinds;
mod light;
mod memory;
mod merged;
mod packed;
mod particles;
mod pass;
mod present;
mod project;
mod radix;
mod rasterise;
#[cfg(test)]
mod reflection;
mod resolve;
mod scan;
mod scene;
mod shade;
mod shader;
mod shaders;
mod sort;
mod surface;
mod tile;
mod timer;

pub use bin::{ChunkBins, MAX_BAND_TILES, bin};
pub use classify::{Classified, classify};
pub use cull::{CullOutput, camera_uniform, cull};
pub use device::{AdapterChoice, Gpu, device_descriptor};
pub use f64::{F64Results, f64_operations};
pub(crate) use frame::DeviceScene;
pub use light::light;
pub use merged::{MergedNumbers, merged_numbers};
pub use project::{Projected, project};
pub use radix::radix_sort;
pub use rasterise::{RasterSpec, rasterise};
pub use scan::exclusive_scan;
pub use shade::shade;
pub use shader::{Shader, prelude};
pub use sort::sort;
pub use surface::{SurfacePixels, SurfaceSpec, rasterise_surface};
