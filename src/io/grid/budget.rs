//! Limits the memory of arrays that may be larger than their file.

use std::cell::Cell;
use std::fmt::Display;
use std::path::Path;

use crate::error::{Error, Result};

/// Greatest number of bytes of all arrays per byte read.
const MOST_INFLATION: usize = 8;

/// Additional bytes that arrays may use in any case.
const SMALL: usize = 16 << 20;

/// Bytes that arrays may still use.
pub(super) struct Budget<'a> {
    path: &'a Path,
    left: Cell<usize>,
}

impl<'a> Budget<'a> {
    /// - `byte_count`: number of bytes read.
    pub(super) fn new(path: &'a Path, byte_count: usize) -> Self {
        let left = byte_count
            .saturating_mul(MOST_INFLATION)
            .saturating_add(SMALL);
        let left = Cell::new(left);
        Self { path, left }
    }

    /// Adds the bytes of a further file.
    pub(super) fn add(&self, byte_count: usize) {
        let more = byte_count.saturating_mul(MOST_INFLATION);
        self.left.set(self.left.get().saturating_add(more));
    }

    /// Subtracts `count` numbers of `size` bytes each.
    ///
    /// - `place`: is formatted for the error alone.
    ///
    /// # Errors
    /// They are more than are left.
    pub(super) fn spend(&self, place: impl Display, count: usize, size: usize) -> Result<()> {
        let wanted = count.checked_mul(size);
        let left = wanted.and_then(|wanted| self.left.get().checked_sub(wanted));
        let left = left.ok_or_else(|| {
            Error::format(
                self.path,
                place.to_string(),
                format!("arrays of at most {MOST_INFLATION} times the bytes of the files in all"),
                format!("{count} numbers more"),
                "the file is damaged, or packs equal numbers: save it again, its results in several files",
            )
        })?;
        self.left.set(left);
        Ok(())
    }
}
