//! Opens data files, or bytes in memory in their place.
//!
//! Only regular, non-empty files are opened, and never more bytes are read than the file had when it was opened.

use std::borrow::Cow;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufReader, Cursor, Read};
use std::ops::Deref;
use std::path::{Component, Path, PathBuf};

use crate::error::{Error, Result};
use crate::memory::{left, trying};
use crate::opened;

/// Number of bytes that contain every magic number and a line of column names.
pub(crate) const HEAD: usize = 4096;

/// Returns the length in bytes of a regular, non-empty file.
///
/// Pipes and devices are refused before they are opened: opening a pipe may wait for ever,
/// and a device may never end.
pub(crate) fn regular_len(path: &Path) -> Result<u64> {
    let meta = fs::metadata(path)
        .map_err(|e| Error::io(path, "opening", e, "check the name and the permissions"))?;
    let found = if meta.is_dir() {
        "a directory, and none that is a data set (a DICOM series, a SOG scene with its `meta.json`)"
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
    opened::note(path);
    Ok((file, len))
}

/// Reads all bytes of a regular file: as many as it had when it was opened.
pub(crate) fn read_all(path: &Path) -> Result<Vec<u8>> {
    let (file, len) = open_regular(path)?;
    // A vector of zeros aborts the program if there is no memory, so the size is checked first.
    let has_room = |n: usize| Vec::<u8>::new().try_reserve_exact(n).is_ok();
    let is_left = |n: usize| left().is_none_or(|(left, _)| n as u64 <= left);
    let fits = |n: &usize| is_left(*n) && trying(|| has_room(*n));
    let len = usize::try_from(len).ok().filter(fits).ok_or_else(|| {
        Error::format(
            path,
            "reading",
            "a file that fits into memory",
            format!("{len} bytes"),
            "use a smaller file or a machine with more memory",
        )
    })?;
    let mut bytes = vec![0; len];
    fill(&file, &mut bytes).map_err(|e| Error::io(path, "reading", e, "check the disk"))?;
    Ok(bytes)
}

/// Fills `bytes` with the start of a file on all cores. Half of the time goes to the system's preparation of new
/// memory.
#[cfg(unix)]
fn fill(file: &File, bytes: &mut [u8]) -> io::Result<()> {
    use std::os::unix::fs::FileExt;

    const PIECE: usize = 1 << 20;
    crate::parallel::try_chunks(bytes, PIECE, |i, piece| {
        file.read_exact_at(piece, (i * PIECE) as u64)
    })
}

/// Fills `bytes` with the start of a file.
#[cfg(not(unix))]
fn fill(mut file: &File, bytes: &mut [u8]) -> io::Result<()> {
    file.read_exact(bytes)
}

/// A file on the disk, or named bytes in memory, with access to the files beside it.
#[derive(Clone, Copy)]
pub(crate) struct Input<'a> {
    /// Path of the file, or the name given for the bytes; error messages contain it.
    pub(crate) path: &'a Path,
    memory: Option<Memory<'a>>,
}

/// A file that a caller reads in ranges.
pub trait Ranges {
    /// Returns the length in bytes.
    fn len(&self) -> u64;

    /// Fills `into` with the bytes from byte `from` on.
    ///
    /// # Errors
    /// A file that cannot be read, or ends before.
    fn read_at(&self, from: u64, into: &mut [u8]) -> io::Result<()>;

    /// Returns true if there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Ranges for Vec<u8> {
    fn len(&self) -> u64 {
        self.as_slice().len() as u64
    }

    fn read_at(&self, from: u64, into: &mut [u8]) -> io::Result<()> {
        let from = usize::try_from(from).ok().and_then(|from| self.get(from..));
        from.unwrap_or_default().read_exact(into)
    }
}

/// Returns another file by its path.
pub(crate) type FindRanges<'a> = &'a dyn Fn(&Path) -> Option<Box<dyn Ranges>>;

/// A file in memory or in ranges, with a function that returns others by path.
#[derive(Clone, Copy)]
enum Memory<'a> {
    Bytes(&'a [u8], &'a dyn Fn(&Path) -> Option<Vec<u8>>),
    Ranges(&'a dyn Ranges, FindRanges<'a>),
}

/// Reads a file from its start, a range at a time.
struct InRanges<F> {
    file: F,
    at: u64,
}

impl<F: Deref<Target: Ranges>> InRanges<F> {
    /// Bytes of a range.
    const RANGE: usize = 1 << 20;

    fn open(file: F) -> BufReader<Self> {
        BufReader::with_capacity(Self::RANGE, Self { file, at: 0 })
    }
}

impl<F: Deref<Target: Ranges>> Read for InRanges<F> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.file.len().saturating_sub(self.at);
        let count = usize::try_from(left).map_or(into.len(), |left| left.min(into.len()));
        self.file.read_at(self.at, &mut into[..count])?;
        self.at += count as u64;
        Ok(count)
    }
}

/// Reads all bytes of a file.
fn whole(path: &Path, file: &dyn Ranges) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let len = usize::try_from(file.len()).unwrap_or(usize::MAX);
    let has_room = trying(|| bytes.try_reserve_exact(len).is_ok());
    let read = match has_room {
        true => InRanges::open(file).read_to_end(&mut bytes),
        false => Err(io::ErrorKind::OutOfMemory.into()),
    };
    match read {
        Ok(_) => Ok(bytes),
        Err(e) => Err(Error::io(path, "reading", e, "use a smaller file")),
    }
}

impl<'a> Input<'a> {
    /// Creates an input from a file on the disk.
    pub(crate) fn of_file(path: &'a Path) -> Self {
        Self { path, memory: None }
    }

    /// Creates an input from bytes in memory; `beside` returns the bytes of the files that they name.
    pub(crate) fn of_bytes(
        path: &'a Path,
        bytes: &'a [u8],
        beside: &'a dyn Fn(&Path) -> Option<Vec<u8>>,
    ) -> Self {
        let memory = Some(Memory::Bytes(bytes, beside));
        Self { path, memory }
    }

    /// Creates an input from a file that is read in ranges; `beside` returns the files that it names.
    #[cfg(all(feature = "legend", feature = "prepared"))]
    pub(crate) fn of_ranges(path: &'a Path, file: &'a dyn Ranges, beside: FindRanges<'a>) -> Self {
        let memory = Some(Memory::Ranges(file, beside));
        Self { path, memory }
    }

    /// Returns true for a file on the disk. Its folder can then be listed.
    pub(crate) fn is_on_disk(&self) -> bool {
        self.memory.is_none()
    }

    /// Opens the input for reading from its start, and returns its length in bytes.
    pub(crate) fn open(&self) -> Result<(Box<dyn Read + 'a>, u64)> {
        match self.memory {
            None => {
                let (file, len) = open_regular(self.path)?;
                Ok((Box::new(file), len))
            }
            Some(Memory::Bytes(bytes, _)) => {
                self.check_length(bytes.len() as u64)?;
                Ok((Box::new(bytes), bytes.len() as u64))
            }
            Some(Memory::Ranges(file, _)) => {
                self.check_length(file.len())?;
                Ok((Box::new(InRanges::open(file)), file.len()))
            }
        }
    }

    /// Opens another file as [`Input::open`] does.
    pub(crate) fn open_beside(&self, path: &Path) -> Result<(Box<dyn Read + 'a>, u64)> {
        match self.memory {
            None => {
                let (file, len) = open_regular(path)?;
                Ok((Box::new(file), len))
            }
            Some(Memory::Bytes(..)) => {
                let bytes = self.read_beside(path)?;
                let len = bytes.len() as u64;
                Ok((Box::new(Cursor::new(bytes)), len))
            }
            Some(Memory::Ranges(_, beside)) => {
                let file = beside(path).ok_or_else(|| self.lacks(path))?;
                let len = file.len();
                Ok((Box::new(InRanges::open(file)), len))
            }
        }
    }

    /// Returns the first bytes, at most `count`, and the length of the whole input.
    pub(crate) fn head(&self, count: usize) -> Result<(Vec<u8>, u64)> {
        let (bytes, len) = self.open()?;
        let mut head = Vec::new();
        bytes
            .take(count as u64)
            .read_to_end(&mut head)
            .map_err(|e| Error::io(self.path, "reading the first bytes", e, "check the disk"))?;
        Ok((head, len))
    }

    /// Reads all bytes; from a file, as many as it had when it was opened.
    pub(crate) fn read_all(&self) -> Result<Cow<'a, [u8]>> {
        match self.memory {
            None => read_all(self.path).map(Cow::Owned),
            Some(Memory::Bytes(bytes, _)) => {
                self.check_length(bytes.len() as u64)?;
                Ok(Cow::Borrowed(bytes))
            }
            Some(Memory::Ranges(file, _)) => {
                self.check_length(file.len())?;
                whole(self.path, file).map(Cow::Owned)
            }
        }
    }

    fn check_length(&self, len: u64) -> Result<()> {
        if len == 0 {
            let advice = "give the bytes of a file";
            return Err(Error::format(
                self.path, "opening", "data", "no bytes", advice,
            ));
        }
        Ok(())
    }

    /// Returns the length in bytes of another file, or `None` if there is no file of this path.
    pub(crate) fn len_beside(&self, path: &Path) -> Option<u64> {
        match self.memory {
            None => fs::metadata(path)
                .ok()
                .filter(fs::Metadata::is_file)
                .map(|m| m.len()),
            Some(Memory::Bytes(_, beside)) => beside(path).map(|bytes| bytes.len() as u64),
            Some(Memory::Ranges(_, beside)) => beside(path).map(|file| file.len()),
        }
    }

    /// Returns true if there is a file of this path.
    pub(crate) fn has_beside(&self, path: &Path) -> bool {
        self.len_beside(path).is_some()
    }

    /// Finds a file below this input's folder whose path differs from `path` in upper and lower case only. File systems
    /// that ignore case write such names. Folders in memory cannot be listed, so the result is then `None`.
    pub(crate) fn in_another_case(&self, path: &Path) -> Option<PathBuf> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let within = path
            .strip_prefix(folder)
            .ok()
            .filter(|_| self.is_on_disk())?;
        let mut found = folder.to_path_buf();
        for component in within.components() {
            let exact = found.join(component);
            if exact.exists() {
                found = exact;
                continue;
            }
            let listed = match found.as_os_str().is_empty() {
                true => Path::new("."),
                false => &found,
            };
            let wanted = component.as_os_str().to_str()?.to_lowercase();
            let names = fs::read_dir(listed).ok()?;
            let names = names.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
            // The first of several names in order, so that all machines choose the same one.
            let name = names.filter(|name| name.to_lowercase() == wanted).min()?;
            found = found.join(name);
        }
        self.has_beside(&found).then_some(found)
    }

    /// Reads all bytes of another file.
    pub(crate) fn read_beside(&self, path: &Path) -> Result<Vec<u8>> {
        match self.memory {
            None => read_all(path),
            Some(Memory::Bytes(_, beside)) => beside(path).ok_or_else(|| self.lacks(path)),
            Some(Memory::Ranges(_, beside)) => {
                let file = beside(path).ok_or_else(|| self.lacks(path))?;
                whole(path, &*file)
            }
        }
    }

    /// Returns the error for a file that is not there.
    fn lacks(&self, path: &Path) -> Error {
        Error::format(
            self.path,
            "files that it names",
            format!("`{}`", path.display()),
            "no such file beside bytes in memory",
            "give its bytes, too",
        )
    }

    /// Calls `read` with another file as the input: from the disk, or from the bytes given for it.
    pub(crate) fn with_beside<T>(
        &self,
        path: &Path,
        read: impl FnOnce(Input<'_>) -> Result<T>,
    ) -> Result<T> {
        match self.memory {
            None => read(Input::of_file(path)),
            Some(Memory::Bytes(_, beside)) => {
                let bytes = self.read_beside(path)?;
                read(Input::of_bytes(path, &bytes, beside))
            }
            Some(Memory::Ranges(_, beside)) => {
                let file = beside(path).ok_or_else(|| self.lacks(path))?;
                let memory = Some(Memory::Ranges(&*file, beside));
                read(Input { path, memory })
            }
        }
    }

    /// Returns the same path for all paths to the same file, or `None` if there is no file.
    pub(crate) fn resolved_beside(&self, path: &Path) -> Option<PathBuf> {
        if self.memory.is_none() {
            return path.canonicalize().ok();
        }
        if !self.has_beside(path) {
            return None;
        }
        let mut resolved = PathBuf::new();
        for component in path.components() {
            match component {
                Component::CurDir => {}
                Component::ParentDir if resolved.file_name().is_some() => {
                    resolved.pop();
                }
                other => resolved.push(other),
            }
        }
        Some(resolved)
    }
}

impl fmt::Debug for Input<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bytes = self.memory.map(|memory| match memory {
            Memory::Bytes(bytes, _) => bytes.len() as u64,
            Memory::Ranges(file, _) => file.len(),
        });
        f.debug_struct("Input")
            .field("path", &self.path)
            .field("bytes", &bytes)
            .finish_non_exhaustive()
    }
}

/// Returns the extension in lower case, or an empty string.
pub(in crate::io) fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}
