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

pub(crate) mod backend;
mod check;
mod column;
#[cfg(feature = "gpu")]
mod device;
pub(crate) mod plan;
mod renderer;
mod settings;
mod uniforms;

pub use crate::blocks::Keep;
pub use crate::stats::{FrameCounts, StageTimes};
pub use backend::Backend;
pub use column::ColumnSettings;
pub use renderer::Renderer;
pub use settings::{ClassifyAt, Composite, Settings, Show};
