//! Draws a frame of a scene, given a camera and settings.
//!
//! | file | subject |
//! |---|---|
//! | `settings.rs` | settings of a frame, as the caller gives them |
//! | `check.rs` | checks of settings and cameras |
//! | `plan.rs` | `FramePlan`: what is drawn, in which passes, and how |
//! | `uniforms.rs` | camera and settings in f32, for the stages |
//! | `backend.rs` | the interface of back ends |
//! | `options.rs` | options of a renderer |
//! | `baked.rs` | light in the colours of particles |
//! | `shadows.rs` | the shadows of a frame, kept while nothing they depend on changes |
//! | `renderer.rs` | a scene, its back ends and its images |
//! | `levels.rs` | the choice of coarser lattices |
//! | `column.rs` | column densities |
//! | `deep.rs` | deep images |
//! | `panorama.rs` | panoramas: pictures of all directions around an eye |
//! | `stereo.rs` | pictures for two eyes |
//! | `device.rs` | the caller's devices and textures; frames without waiting |
//! | `pick.rs` | the particles that a pixel shows |

mod baked;
mod column;
mod column_mean;
mod deep;
#[cfg(feature = "gpu")]
mod device;
mod exposure;
mod levels;
mod options;
mod panorama;
mod pick;
mod renderer;
mod shadows;
mod stereo;

pub use crate::blocks::{LayerKind, Layers, SceneOptions};
pub use crate::constants::{DEFAULT_LOW_PASS_VARIANCE_PX2, DEFAULT_TOLERANCE};
pub use crate::frame::backdrop::{Backdrop, DepthKind, GivenBackdrop};
pub use crate::frame::backend::{Backend, OpenBackend};
pub use crate::frame::settings::{
    Advanced, Blend, ColumnSettings, Composite, Order, Settings, Show,
};
#[cfg(feature = "gpu")]
pub use crate::gpu::{AdapterChoice, Gpu, device_descriptor};
pub use crate::scene::Classification;
pub use crate::simd::SimdLevel;
pub use crate::splat::Filter;
pub use crate::splat::PIXEL_VARIANCE_PX2;
pub use crate::stats::{FrameCounts, StageTimes};
pub use baked::{bake_light, nothing_lit};
pub use column_mean::ColumnMeans;
pub use options::{Contents, RendererOptions};
pub use pick::Picked;
pub use renderer::Renderer;
