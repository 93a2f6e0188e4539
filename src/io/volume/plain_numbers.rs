//! Reads runs of numbers stored one after the other in a file, neither packed nor in text.

use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::io::bytes::file::open_regular;
use crate::io::bytes::scalars::{Encoding, Stride, scaled};
use crate::scene::{Values, of_any_type};

/// Numbers of a file, in the order of their samples.
#[derive(Debug, Clone)]
pub(in crate::io) struct PlainNumbers {
    pub(in crate::io) path: PathBuf,
    /// Offset of the first number.
    pub(in crate::io) start: u64,
    pub(in crate::io) encoding: Encoding,
    /// Factor and offset of every number.
    pub(in crate::io) scale: Option<[f64; 2]>,
}

impl PlainNumbers {
    /// No numbers, of the type in which they are read.
    pub(in crate::io) fn no_values(&self) -> Values {
        converted(&[], self.encoding, 0, self.scale)
    }

    /// Reads a run of numbers, which was checked to lie in the file.
    ///
    /// # Errors
    /// A file that cannot be read, or has become shorter.
    pub(in crate::io) fn read(&self, run: Range<usize>) -> Result<Values> {
        /// Number of bytes that is worth more than one thread.
        const CHUNK: usize = 1 << 22;
        let failed = |e| {
            Error::io(
                &self.path,
                "reading the numbers",
                e,
                "check the file and the disk",
            )
        };
        let size = self.encoding.scalar.size();
        let (mut file, _) = open_regular(&self.path)?;
        let place = self.start + run.start as u64 * size as u64;
        file.seek(SeekFrom::Start(place)).map_err(failed)?;
        let mut all = self.no_values();
        of_any_type!(&mut all, all => all.reserve_exact(run.len()));
        let mut chunk = Vec::new();
        let mut left = run.len();
        while left > 0 {
            let count = left.min(CHUNK / size);
            chunk.resize(count * size, 0);
            file.read_exact(&mut chunk).map_err(failed)?;
            let more = converted(&chunk, self.encoding, count, self.scale);
            all.append(more);
            left -= count;
        }
        Ok(all)
    }
}

/// Converts `count` numbers from the start of `bytes`.
fn converted(bytes: &[u8], encoding: Encoding, count: usize, scale: Option<[f64; 2]>) -> Values {
    let stride = Stride {
        first: 0,
        step: encoding.scalar.size(),
        count,
    };
    scaled(bytes, encoding, stride, scale)
}
