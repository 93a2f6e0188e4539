//! Reads the points of a file, a run of rows at a time.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::data::dataset::Dataset;
use crate::data::particle_type::ParticleType;
use crate::error::{Error, Result};
use crate::io::bytes::file::{Input, open_regular};
use crate::io::particles::{hdf5, npy};

/// Number of rows that are read at a time.
pub(crate) const ROWS: usize = 1 << 18;

/// Greatest length of a header; a file with a longer one is read whole.
const LONGEST_HEADER: u64 = 1 << 20;

/// Approximate number of bytes read at a time.
const BYTES: usize = 1 << 26;

/// A file of points whose rows can be read in runs.
#[derive(Debug)]
pub struct RowFile {
    path: PathBuf,
    rows: Rows,
}

#[derive(Debug)]
enum Rows {
    Npy(NpyRows),
    Snapshot {
        wanted: Option<ParticleType>,
        /// Each file of the snapshot, with its number of rows.
        pieces: Vec<(PathBuf, usize)>,
    },
}

#[derive(Debug)]
struct NpyRows {
    file: File,
    array: npy::Array<'static>,
    /// Offset of the first row.
    start: u64,
    /// Bytes per row.
    len: usize,
}

impl RowFile {
    /// Opens a file and reads its header; `None` if the format cannot be read by rows. NPY can, because its
    /// arrays store row after row, and so can snapshots of Gadget's family in HDF5, in one file or several.
    ///
    /// - `particle_type`: type of a snapshot's particles; without it, the particles that [`open`](crate::io::open)
    ///   reads.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open) for headers, lengths and missing files.
    pub fn open(path: &Path, particle_type: Option<ParticleType>) -> Result<Option<Self>> {
        let (mut file, len) = open_regular(path)?;
        let mut head = Vec::new();
        let start = (&mut file).take(LONGEST_HEADER).read_to_end(&mut head);
        start.map_err(|e| Error::io(path, "reading", e, "check the disk"))?;
        let rows = if head.starts_with(hdf5::MAGIC) {
            let pieces = hdf5::row_pieces(Input::of_file(path), particle_type)?;
            pieces.map(|(wanted, pieces)| Rows::Snapshot { wanted, pieces })
        } else if head.starts_with(npy::MAGIC) && particle_type.is_none() {
            NpyRows::of(path, file, &head, len)?.map(Rows::Npy)
        } else {
            None
        };
        let path = path.to_path_buf();
        Ok(rows.map(|rows| Self { path, rows }))
    }

    /// Path of the opened file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the file is a snapshot in one file.
    pub(crate) fn is_one_snapshot(&self) -> bool {
        matches!(&self.rows, Rows::Snapshot { pieces, .. } if pieces.len() == 1)
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        match &self.rows {
            Rows::Npy(rows) => rows.array.shape.first().copied().unwrap_or(0),
            Rows::Snapshot { pieces, .. } => pieces.iter().map(|(_, count)| count).sum(),
        }
    }

    /// Divides all rows into runs, each within one file and some tens of megabytes long.
    ///
    /// - `most`: greatest number of rows per run.
    pub fn runs(&self, most: usize) -> Vec<Range<usize>> {
        let (most, pieces) = match &self.rows {
            Rows::Npy(rows) => ((BYTES / rows.len).clamp(1, most), vec![self.count()]),
            // Packed chunks of some hundred thousand rows are unpacked as a whole.
            Rows::Snapshot { pieces, .. } => (
                most.saturating_mul(4),
                pieces.iter().map(|(_, count)| *count).collect(),
            ),
        };
        let mut runs = Vec::new();
        let mut first = 0;
        for count in pieces {
            let end = first + count;
            let starts = (first..end).step_by(most.max(1));
            runs.extend(starts.map(|start| start..end.min(start.saturating_add(most))));
            first = end;
        }
        runs
    }

    /// The parts of runs that lie in a range of rows.
    pub(crate) fn runs_within(&self, most: usize, part: &Range<usize>) -> Vec<Range<usize>> {
        let runs = self.runs(most).into_iter();
        let within = runs.map(|run| run.start.max(part.start)..run.end.min(part.end));
        within.filter(|run| !run.is_empty()).collect()
    }

    /// Reads one of [`Self::runs`], or a part of it, as [`open`](crate::io::open) reads the whole. But columns
    /// `scale_0..2` keep the file's numbers: whether they are logarithms depends on all rows.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open); rows that do not exist, or lie in several files.
    pub fn read(&mut self, run: Range<usize>) -> Result<Dataset> {
        let mut data = self.read_run(run)?;
        data.name_units();
        Ok(data)
    }

    fn read_run(&mut self, run: Range<usize>) -> Result<Dataset> {
        let refused = || {
            Error::format(
                &self.path,
                "rows",
                "a run of one file",
                format!("{} to {}", run.start, run.end),
                "read one of its runs",
            )
        };
        match &mut self.rows {
            Rows::Npy(rows) => rows.read(&self.path, run),
            Rows::Snapshot { wanted, pieces } => {
                let mut first = 0;
                for (path, count) in pieces {
                    if (first..first + *count).contains(&run.start) {
                        if run.end > first + *count {
                            break;
                        }
                        let own = run.start - first..run.end - first;
                        return hdf5::read_rows_of(Input::of_file(path), *wanted, *count, own);
                    }
                    first += *count;
                }
                Err(refused())
            }
        }
    }
}

impl NpyRows {
    fn of(path: &Path, file: File, head: &[u8], len: u64) -> Result<Option<Self>> {
        // If the header is damaged or too long, reading the whole file reports the error.
        let Ok((array, start)) = npy::parse_header(path, head) else {
            return Ok(None);
        };
        let start = start as u64;
        array.check_len(path, len.saturating_sub(start))?;
        let row = array.row_len().filter(|row| *row > 0);
        Ok(row.map(|len| Self {
            file,
            array,
            start,
            len,
        }))
    }

    fn read(&mut self, path: &Path, run: Range<usize>) -> Result<Dataset> {
        let mut bytes = vec![0; run.len() * self.len];
        let place = self.start + run.start as u64 * self.len as u64;
        self.file
            .seek(SeekFrom::Start(place))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(|e| Error::io(path, "reading", e, "check the disk"))?;
        npy::table_of(path, npy::TABLE, &self.array.of_rows(run.len(), &bytes))
    }
}
