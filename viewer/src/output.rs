//! Defines the files that the window writes.

use serde::{Deserialize, Serialize};

/// Names of files, and the size of pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Output {
    pub(crate) picture: String,
    pub(crate) function: String,
    /// Width and height in pixels; 0 stands for the window's.
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
