//! Where pictures and functions are written.

use serde::{Deserialize, Serialize};

/// The names of files, and the size of pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Output {
    pub(crate) picture: String,
    pub(crate) function: String,
    /// Width and height in pixels; those of the window where they are 0.
    pub(crate) size: [usize; 2],
}

impl Default for Output {
    fn default() -> Self {
        Self {
            picture: "picture.png".into(),
            function: "function.json".into(),
            size: [0, 0],
        }
    }
}
