//! Points of a file, a run of rows at a time.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::Dataset;
use super::file::open_regular;
use super::npy;
use crate::error::{Error, Result};

/// Bytes of a header at most; longer ones are read with the whole file.
const LONGEST_HEADER: u64 = 1 << 20;

/// A file of points whose rows lie one after another.
#[derive(Debug)]
pub struct RowFile {
    path: PathBuf,
    file: File,
    array: npy::Array<'static>,
    /// Where the first row begins.
    start: u64,
    /// Bytes of a row.
    row: usize,
}

impl RowFile {
    /// Opens a file, of which its header is read; `None` where its format is not read by rows. NPY is, whose arrays lie
    /// row after row.
    ///
    /// # Errors
    /// Those of [`open`](super::open) about the header and the file's length.
    pub fn open(path: &Path) -> Result<Option<Self>> {
        let (mut file, len) = open_regular(path)?;
        let mut head = Vec::new();
        let start = (&mut file).take(LONGEST_HEADER).read_to_end(&mut head);
        start.map_err(|e| Error::io(path, "reading", e, "check the disk"))?;
        if !head.starts_with(npy::MAGIC) {
            return Ok(None);
        }
        // Of a header that is broken or longer the whole file says what is wrong with it.
        let Ok((array, start)) = npy::parse_header(path, &head) else {
            return Ok(None);
        };
        let start = start as u64;
        array.check_len(path, len.saturating_sub(start))?;
        let row = array.row_len().filter(|row| *row > 0);
        Ok(row.map(|row| Self {
            path: path.to_path_buf(),
            file,
            array,
            start,
            row,
        }))
    }

    /// How many rows there are.
    pub fn count(&self) -> usize {
        self.array.shape.first().copied().unwrap_or(0)
    }

    /// Bytes of a row.
    pub fn row_len(&self) -> usize {
        self.row
    }

    /// Some of the rows, as [`open`](super::open) reads all.
    ///
    /// # Errors
    /// Those of [`open`](super::open); rows that are not there.
    pub fn read(&mut self, rows: Range<usize>) -> Result<Dataset> {
        let failed = |e| Error::io(&self.path, "reading", e, "check the disk");
        let mut bytes = vec![0; rows.len() * self.row];
        let place = self.start + rows.start as u64 * self.row as u64;
        self.file
            .seek(SeekFrom::Start(place))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(failed)?;
        let array = self.array.of_rows(rows.len(), &bytes);
        npy::table_of(&self.path, npy::TABLE, &array)
    }
}
