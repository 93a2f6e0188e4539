//! The one place where a file becomes memory.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use memmap2::{Mmap, MmapMut, MmapOptions};

use super::storage::SharedBytes;

/// Maps a file that somebody wrote. An empty one has no bytes to map and is an error of the system.
pub(crate) fn map(path: &Path) -> io::Result<SharedBytes> {
    let file = File::open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other(
            "not a regular file, which alone can be mapped",
        ));
    }
    let map = mapped(&file)?;
    // Blocks that a frame looks at lie in many places: reading on beyond each would read most of a file.
    #[cfg(unix)]
    map.advise(memmap2::Advice::Random)?;
    Ok(Arc::new(map))
}

/// Maps a file of this process, which nobody changes any more.
pub(crate) fn map_file(file: &File) -> io::Result<SharedBytes> {
    Ok(Arc::new(mapped(file)?))
}

fn mapped(file: &File) -> io::Result<Mmap> {
    #[allow(
        unsafe_code,
        reason = "a mapped file is a slice only as long as nobody changes the file, which no check can promise: \
                  callers are told so"
    )]
    // SAFETY: the map is read only and private to this process, lives as long as what refers to it (`Column`), and its
    // bytes are taken as numbers of which every pattern is one. What is outside of this program's power is another
    // process that cuts the file: reading beyond its end is SIGBUS. That files must not change is said where they are
    // opened; a temporary file has no name by which another process would find it.
    unsafe {
        Mmap::map(file)
    }
}

/// Bytes in memory, all 0, which the system lends page by page as they are written: however many there are.
pub(crate) fn lent(bytes: usize) -> io::Result<MmapMut> {
    MmapOptions::new().len(bytes).no_reserve_swap().map_anon()
}

/// Bytes that begin at a multiple of 8, as those of a map do.
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
