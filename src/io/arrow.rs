//! Prepared scenes, which are no data: recognised, so that what is asked of data says so.

use crate::error::{Error, Result};

use super::Dataset;
use super::file::Input;

/// What a file of Arrow's IPC format begins with.
const MAGIC: &[u8] = b"ARROW1\0\0";

pub(super) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// # Errors
/// Always: particles in blocks are drawn as they are, and not sampled.
pub(super) fn read(input: Input<'_>) -> Result<Dataset> {
    Err(Error::format(
        input.path,
        "contents",
        "data to be sampled",
        "a table of Arrow, as prepared scenes are, which are drawn as they are",
        "name the data that it was made of",
    ))
}
