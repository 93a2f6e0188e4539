//! Where columns lie while a scene is made: in memory, or in files without a name that are mapped.

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
use crate::scene::Column;

/// Elements that are gathered at a time where they do not lie in memory.
pub(super) const RUN: usize = 1 << 20;

/// Where columns lie.
#[derive(Debug, Clone, Copy)]
pub(super) enum Room<'a> {
    Memory(PhantomData<&'a ()>),
    /// In files in this folder, which have no names and are gone with the columns. The system may take their memory at
    /// any time.
    #[cfg(feature = "prepared")]
    Folder(&'a Path),
}

/// In vectors.
pub(super) const MEMORY: Room<'static> = Room::Memory(PhantomData);

/// A column in the making.
#[derive(Debug)]
pub(super) struct ColumnBuilder<'a, T>(Kind<'a, T>);

#[derive(Debug)]
enum Kind<'a, T> {
    Vector(Vec<T>, PhantomData<&'a ()>),
    #[cfg(feature = "prepared")]
    File {
        folder: &'a Path,
        file: BufWriter<File>,
        bytes: usize,
    },
}

impl<'a> Room<'a> {
    /// An empty column.
    ///
    /// - `count`: how many elements it is going to have.
    pub(super) fn column<T>(self, count: usize) -> Result<ColumnBuilder<'a, T>> {
        Ok(ColumnBuilder(match self {
            Self::Memory(_) => Kind::Vector(Vec::with_capacity(count), PhantomData),
            #[cfg(feature = "prepared")]
            Self::Folder(folder) => Kind::File {
                folder,
                file: BufWriter::new(nameless(folder)?),
                bytes: 0,
            },
        }))
    }

    /// Elements of a column in an order.
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
            Kind::File {
                folder,
                file,
                bytes,
            } => {
                let own = bytemuck::cast_slice(elements);
                file.write_all(own).map_err(|e| failed(folder, e))?;
                *bytes += own.len();
            }
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<Column<T>> {
        match self.0 {
            Kind::Vector(vector, _) => Ok(vector.into()),
            #[cfg(feature = "prepared")]
            Kind::File {
                folder,
                file,
                bytes,
            } => {
                if bytes == 0 {
                    return Ok(Column::default());
                }
                let file = file
                    .into_inner()
                    .map_err(|e| failed(folder, e.into_error()))?;
                let map = crate::scene::map::map_file(&file).map_err(|e| {
                    let advice =
                        "raise the limit of addresses (ulimit -v), which counts what is mapped";
                    Error::io(folder, "mapping temporary files", e, advice)
                })?;
                // Aligned as pages are, and written in whole elements.
                Ok(Column::of_part(map, 0..bytes).unwrap_or_default())
            }
        }
    }
}

/// A file without a name in a folder.
#[cfg(feature = "prepared")]
pub(super) fn nameless(folder: &Path) -> Result<File> {
    tempfile::tempfile_in(folder).map_err(|e| failed(folder, e))
}

#[cfg(feature = "prepared")]
pub(super) fn failed(folder: &Path, error: std::io::Error) -> Error {
    let advice = "check its permissions and the room on its disk";
    Error::io(folder, "writing temporary files", error, advice)
}
