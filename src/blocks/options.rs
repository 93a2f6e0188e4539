//! Defines options for preparing scenes and volumes.

use crate::task::Task;

/// Options for preparing a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneOptions {
    /// Whether to make levels of detail, which [`Settings::level_of_detail`](crate::Settings::level_of_detail) uses for
    /// particles far below a pixel. Making them takes most of the time of preparing a scene. Column densities, slabs,
    /// and explicitly chosen filters never use them.
    pub level_of_detail: bool,
    /// Whether to keep everything that does not depend on values. Values can then be exchanged (the next time step)
    /// while positions and shapes stay. Takes the memory of the data once more.
    pub keep_shapes: bool,
    /// Whether to keep the caller's number of each particle: 4 bytes per particle.
    pub keep_indices: bool,
    /// Task that receives the progress, and may cancel the work.
    pub task: Option<Task>,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            level_of_detail: true,
            keep_shapes: false,
            keep_indices: false,
            task: None,
        }
    }
}

/// Options for building blocks of a volume.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BuildOptions {
    /// Whether to make levels of detail.
    pub(super) detail: bool,
    /// Whether blocks keep the caller's number of each particle.
    pub(super) indices: bool,
}
