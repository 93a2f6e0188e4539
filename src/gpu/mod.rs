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
//! | `f64.rs` | the test of f64 in integers |
//! | `scene.rs`, `blocks.rs` | a scene on the device |
//! | `cull.rs`, `classify.rs`, `shade.rs` | the stages |

#![allow(
    clippy::cast_possible_truncation,
    reason = "device memory is counted in 32-bit words by design; sizes are checked against the limits"
)]

mod blocks;
mod classify;
mod cull;
mod device;
mod f64;
mod kernel;
mod memory;
mod scan;
mod scene;
mod shade;
mod shaders;

pub use classify::{Classified, classify};
pub use cull::{CullOutput, camera_uniform, cull};
pub use device::{AdapterChoice, Gpu};
pub use f64::{F64Results, f64_operations};
pub use scan::exclusive_scan;
pub use shade::shade;
pub use shaders::{Shader, prelude};
