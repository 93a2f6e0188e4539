//! Scene + camera + settings -> frame.
//!
//! | file | subject |
//! |---|---|
//! | `settings.rs` | what the caller says of a frame |
//! | `check.rs` | what is refused, in words |
//! | `plan.rs` | `FramePlan`: what is drawn, in which passes, and how |
//! | `uniforms.rs` | what stages read of camera and settings, in f32 |
//! | `backend.rs` | what a back end is |
//! | `renderer.rs` | a scene, its back ends and its images |
//! | `column.rs` | column densities |
//! | `device.rs` | devices and textures of the caller's; frames without waiting |
//! | `pick.rs` | which particles a pixel shows |

pub(crate) mod backend;
mod check;
mod column;
#[cfg(feature = "gpu")]
mod device;
mod pick;
pub(crate) mod plan;
mod renderer;
mod settings;
mod uniforms;

pub use crate::blocks::{LayerKind, Layers, SceneOptions};
#[cfg(feature = "gpu")]
pub use crate::gpu::{AdapterChoice, Gpu, device_descriptor};
pub use crate::scene::Classification;
pub use crate::simd::SimdLevel;
pub use crate::splat::Filter;
pub use crate::splat::PIXEL_VARIANCE_PX2;
pub use crate::stats::{FrameCounts, StageTimes};
pub use backend::{Backend, OpenBackend};
pub use pick::Picked;
pub use renderer::Renderer;
pub use settings::{Blend, ClassifyAt, ColumnSettings, Composite, Settings, Show};
