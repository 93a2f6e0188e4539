//! Maps files into memory; no other module does.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use memmap2::{Mmap, MmapMut, MmapOptions};

use super::storage::SharedBytes;

/// Maps an existing file. An empty file has no bytes to map and gives an error of the operating system.
pub(crate) fn map(path: &Path) -> io::Result<SharedBytes> {
    let file = File::open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other(
            "not a regular file, which alone can be mapped",
        ));
    }
    let map = mapped(&file)?;
    crate::opened::note(path);
    // A frame reads blocks at scattered offsets: reading ahead of each would read most of a file.
    #[cfg(unix)]
    map.advise(memmap2::Advice::Random)?;
    Ok(Arc::new(map))
}

/// Maps a file of this process that is no longer written.
pub(crate) fn map_file(file: &File) -> io::Result<SharedBytes> {
    Ok(Arc::new(mapped(file)?))
}

fn mapped(file: &File) -> io::Result<Mmap> {
    #[allow(
        unsafe_code,
        reason = "a mapped file is a slice only as long as nobody changes the file, which no check can promise: \
                  callers are told so"
    )]
    // SAFETY: the map is read only and private to this process, lives as long as all references to it
    // (`Column`), and every bit pattern of its bytes is a valid number. Another process may truncate the file,
    // which this program cannot prevent: reading beyond the end is then SIGBUS. The functions that open files
    // document that these must not change. A temporary file has no name by which another process would find it.
    unsafe {
        Mmap::map(file)
    }
}

/// Zeroed bytes in memory, of any number: the system allocates each page when it is first written.
pub(crate) fn lent(bytes: usize) -> io::Result<MmapMut> {
    MmapOptions::new().len(bytes).no_reserve_swap().map_anon()
}

/// Copies bytes to a buffer aligned to 8 bytes, as maps are.
pub(crate) fn aligned(bytes: &[u8]) -> SharedBytes {
    let mut words = vec![0_u64; bytes.len().div_ceil(8)];
    bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
    Arc::new(Words {
        words,
        len: bytes.len(),
    })
}

struct Words {
    words: Vec<u64>,
    len: usize,
}

impl AsRef<[u8]> for Words {
    fn as_ref(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }
}
