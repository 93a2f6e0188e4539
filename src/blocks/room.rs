//! Stores columns while a scene is made: in memory, or in mapped files without a name.

#[cfg(feature = "prepared")]
use std::fs::File;
#[cfg(feature = "prepared")]
use std::io::{BufWriter, Write};
use std::marker::PhantomData;
#[cfg(feature = "prepared")]
use std::path::Path;

use bytemuck::Pod;
use rayon::prelude::*;

#[cfg(feature = "prepared")]
use crate::error::Error;
use crate::error::Result;
use crate::scene::{Column, Shared, Values, ValuesIn, of_any_type, of_same_type};

/// Number of elements that are gathered at a time if they are not stored in memory.
pub(super) const RUN: usize = 1 << 20;

/// Storage of columns.
#[derive(Debug, Clone, Copy)]
pub(super) enum Room<'a> {
    Memory(PhantomData<&'a ()>),
    /// Files in this folder, which have no names and disappear with the columns. The system may reclaim their memory at
    /// any time.
    #[cfg(feature = "prepared")]
    Folder(&'a Path),
}

/// Storage in vectors.
pub(super) const MEMORY: Room<'static> = Room::Memory(PhantomData);

/// Builds a column.
#[derive(Debug)]
pub(super) struct ColumnBuilder<'a, T>(Kind<'a, T>);

#[derive(Debug)]
enum Kind<'a, T> {
    Vector(Vec<T>, PhantomData<&'a ()>),
    #[cfg(feature = "prepared")]
    File(ColumnFile<'a>),
}

/// Builds a column in a file without a name.
#[cfg(feature = "prepared")]
#[derive(Debug)]
pub(super) struct ColumnFile<'a> {
    folder: &'a Path,
    file: BufWriter<File>,
    bytes: usize,
}

impl<'a> Room<'a> {
    /// Starts an empty column.
    ///
    /// - `count`: number of its elements in the end.
    pub(super) fn column<T>(self, count: usize) -> Result<ColumnBuilder<'a, T>> {
        Ok(ColumnBuilder(match self {
            Self::Memory(_) => Kind::Vector(Vec::with_capacity(count), PhantomData),
            #[cfg(feature = "prepared")]
            Self::Folder(folder) => Kind::File(ColumnFile::new(folder)?),
        }))
    }

    /// Picks elements of a column in an order.
    pub(super) fn pick<T: Pod + Send + Sync>(
        self,
        elements: Column<T>,
        order: &[u32],
    ) -> Result<Column<T>> {
        let at = |&i: &u32| elements[i as usize];
        match self {
            Self::Memory(_) => Ok(order.par_iter().map(at).collect::<Vec<T>>().into()),
            #[cfg(feature = "prepared")]
            Self::Folder(_) => {
                let mut picked = self.column(order.len())?;
                let mut run = Vec::new();
                for of_run in order.chunks(RUN) {
                    of_run.par_iter().map(at).collect_into_vec(&mut run);
                    picked.extend(&run)?;
                }
                picked.finish()
            }
        }
    }
}

impl<T: Pod + Send + Sync> ColumnBuilder<'_, T> {
    pub(super) fn extend(&mut self, elements: &[T]) -> Result<()> {
        match &mut self.0 {
            Kind::Vector(vector, _) => vector.extend_from_slice(elements),
            #[cfg(feature = "prepared")]
            Kind::File(file) => file.extend(bytemuck::cast_slice(elements))?,
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<Column<T>> {
        match self.0 {
            Kind::Vector(vector, _) => Ok(vector.into()),
            #[cfg(feature = "prepared")]
            Kind::File(file) => file.finish(),
        }
    }
}

#[cfg(feature = "prepared")]
impl<'a> ColumnFile<'a> {
    pub(super) fn new(folder: &'a Path) -> Result<Self> {
        Ok(Self {
            folder,
            file: BufWriter::new(nameless(folder)?),
            bytes: 0,
        })
    }

    /// Appends whole elements.
    pub(super) fn extend(&mut self, bytes: &[u8]) -> Result<()> {
        self.bytes += bytes.len();
        let written = self.file.write_all(bytes);
        written.map_err(|e| failed(self.folder, e))
    }

    pub(super) fn finish<T: Pod>(self) -> Result<Column<T>> {
        if self.bytes == 0 {
            return Ok(Column::default());
        }
        let file = self.file.into_inner();
        let file = file.map_err(|e| failed(self.folder, e.into_error()))?;
        let map = crate::scene::map::map_file(&file).map_err(|e| {
            let advice = "raise the limit of addresses (ulimit -v), which counts what is mapped";
            Error::io(self.folder, "mapping temporary files", e, advice)
        })?;
        // Aligned as pages are, and written in whole elements.
        Ok(Column::of_part(map, 0..self.bytes).unwrap_or_default())
    }
}

/// Values that are stored in parts, in any order. Values that are never stored are 0, and take no memory.
#[derive(Debug)]
pub(super) struct Sparse {
    /// No values, of the right type.
    kind: Values,
    count: usize,
    /// `None` if there are no values.
    #[cfg(feature = "prepared")]
    bytes: Option<memmap2::MmapMut>,
    #[cfg(not(feature = "prepared"))]
    bytes: Vec<u8>,
}

impl Sparse {
    /// Makes room for `count` values.
    ///
    /// - `like`: values of the same type.
    pub(super) fn new(count: usize, like: &Values) -> Result<Self> {
        let bytes = count * like.bytes_per_value();
        Ok(Self {
            kind: like.part(0..0),
            count,
            #[cfg(feature = "prepared")]
            bytes: match bytes {
                0 => None,
                _ => Some(crate::scene::map::lent(bytes).map_err(|e| {
                    let advice =
                        "raise the limit of addresses (ulimit -v), which counts what is never used";
                    Error::io(Path::new("memory"), "making room for a lattice", e, advice)
                })?),
            },
            #[cfg(not(feature = "prepared"))]
            bytes: vec![0; bytes],
        })
    }

    /// Stores a run of values of the same type.
    ///
    /// - `at`: index of the first of them.
    pub(super) fn put(&mut self, at: usize, values: &Values) {
        let own: &[u8] = of_any_type!(values, v => bytemuck::cast_slice(v));
        let at = at * self.kind.bytes_per_value();
        #[cfg(feature = "prepared")]
        let bytes = self.bytes.as_deref_mut().unwrap_or_default();
        #[cfg(not(feature = "prepared"))]
        let bytes = &mut *self.bytes;
        bytes[at..at + own.len()].copy_from_slice(own);
    }

    /// Returns all values.
    pub(super) fn finish(self) -> Result<ValuesIn<Shared>> {
        Ok(of_same_type!(self.kind, _ => self.column()?))
    }

    #[cfg(feature = "prepared")]
    fn column<T: Pod>(self) -> Result<Column<T>> {
        let Some(bytes) = self.bytes else {
            return Ok(Column::default());
        };
        let part = 0..self.count * size_of::<T>();
        let bytes = bytes.make_read_only().map_err(|e| {
            let advice = "this is the system's";
            Error::io(Path::new("memory"), "keeping a lattice", e, advice)
        })?;
        Ok(Column::of_part(std::sync::Arc::new(bytes), part).unwrap_or_default())
    }

    #[cfg(not(feature = "prepared"))]
    fn column<T: Pod>(self) -> Result<Column<T>> {
        debug_assert_eq!(self.bytes.len(), self.count * size_of::<T>());
        Ok(bytemuck::pod_collect_to_vec::<u8, T>(&self.bytes).into())
    }
}

/// Creates a file without a name in a folder.
#[cfg(feature = "prepared")]
pub(super) fn nameless(folder: &Path) -> Result<File> {
    tempfile::tempfile_in(folder).map_err(|e| failed(folder, e))
}

#[cfg(feature = "prepared")]
pub(super) fn failed(folder: &Path, error: std::io::Error) -> Error {
    let advice = "check its permissions and the room on its disk";
    Error::io(folder, "writing temporary files", error, advice)
}
