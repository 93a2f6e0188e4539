//! Opening files: only regular, non-empty ones, and never more bytes than they hold.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// The length in bytes of a regular, non-empty file.
///
/// Pipes and devices are refused before they are opened: opening a pipe may wait for ever,
/// and a device may never end.
pub(crate) fn regular_len(path: &Path) -> Result<u64> {
    let meta = fs::metadata(path)
        .map_err(|e| Error::io(path, "opening", e, "check the name and the permissions"))?;
    let found = if meta.is_dir() {
        "a directory"
    } else if !meta.is_file() {
        "a pipe, socket or device"
    } else if meta.len() == 0 {
        "an empty file"
    } else {
        return Ok(meta.len());
    };
    Err(Error::format(
        path,
        "opening",
        "a file with data",
        found,
        "name the data file itself",
    ))
}

/// Opens a regular, non-empty file.
pub(crate) fn open_regular(path: &Path) -> Result<(File, u64)> {
    let len = regular_len(path)?;
    let file =
        File::open(path).map_err(|e| Error::io(path, "opening", e, "check the permissions"))?;
    Ok((file, len))
}

/// The first bytes of a regular file, at most `count`, and the file's length.
pub(crate) fn read_head(path: &Path, count: usize) -> Result<(Vec<u8>, u64)> {
    let (file, len) = open_regular(path)?;
    let mut head = Vec::new();
    file.take(count as u64)
        .read_to_end(&mut head)
        .map_err(|e| Error::io(path, "reading the first bytes", e, "check the disk"))?;
    Ok((head, len))
}

/// All bytes of a regular file: as many as it had when it was opened.
pub(crate) fn read_all(path: &Path) -> Result<Vec<u8>> {
    let (file, len) = open_regular(path)?;
    let mut bytes = Vec::new();
    usize::try_from(len)
        .ok()
        .and_then(|n| bytes.try_reserve_exact(n).ok())
        .ok_or_else(|| {
            Error::format(
                path,
                "reading",
                "a file that fits into memory",
                format!("{len} bytes"),
                "use a smaller file or a machine with more memory",
            )
        })?;
    file.take(len)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, "reading", e, "check the disk"))?;
    Ok(bytes)
}
