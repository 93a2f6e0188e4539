//! Defines the options of a renderer, and the scenes that it takes.

use crate::blocks::SceneOptions;
use crate::frame::backend::Backend;
#[cfg(feature = "prepared")]
use crate::prepared::PreparedScene;
use crate::scene::PointVolume;

/// Options of a renderer. A [`Backend`] or [`SceneOptions`] alone convert to them.
#[derive(Debug, Clone, PartialEq)]
pub struct RendererOptions {
    /// The data to keep for later changes and queries, and a task that reports progress and can cancel.
    /// Scenes that were prepared before have their own, and ignore these.
    pub scene: SceneOptions,
    /// The back end that draws the frames; by default the CPU.
    pub backend: Backend,
}

impl Default for RendererOptions {
    fn default() -> Self {
        Self {
            scene: SceneOptions::default(),
            backend: Backend::Cpu,
        }
    }
}

impl From<Backend> for RendererOptions {
    fn from(backend: Backend) -> Self {
        Self {
            backend,
            ..Self::default()
        }
    }
}

impl From<&SceneOptions> for RendererOptions {
    fn from(scene: &SceneOptions) -> Self {
        Self {
            scene: scene.clone(),
            ..Self::default()
        }
    }
}

/// Contents of a scene: volumes, or scenes that were prepared before.
#[derive(Debug)]
pub enum Contents {
    /// Volumes, whose particles are sorted into blocks.
    Volumes(Vec<PointVolume>),
    /// Prepared scenes, drawn together in this order. Data in files are read only when a frame needs them.
    #[cfg(feature = "prepared")]
    Prepared(Vec<PreparedScene>),
}

impl From<Vec<PointVolume>> for Contents {
    fn from(volumes: Vec<PointVolume>) -> Self {
        Self::Volumes(volumes)
    }
}

#[cfg(feature = "prepared")]
impl From<Vec<PreparedScene>> for Contents {
    fn from(scenes: Vec<PreparedScene>) -> Self {
        Self::Prepared(scenes)
    }
}
