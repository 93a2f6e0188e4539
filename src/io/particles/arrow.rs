//! Recognises prepared scenes. They are not data, so the reader refuses them with an explanation.

use crate::error::{Error, Result};

use crate::data::dataset::Dataset;
use crate::io::bytes::file::Input;

/// First bytes of a file in Arrow's IPC format.
const MAGIC: &[u8] = b"ARROW1\0\0";

pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// # Errors
/// Always: a prepared scene is drawn without conversion and cannot be sampled.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    Err(Error::format(
        input.path,
        "contents",
        "data to be sampled",
        "a table of Arrow, as prepared scenes are, which are drawn as they are",
        "name the data that it was made of",
    ))
}
