//! Reads the pieces of an unstructured grid that an index (`.pvtu`) names, some of them at a time.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::array::Array;
use super::meshes::{Part, append_arrays, arrays_of, mesh_of};
use super::pieces::{self, ArraysSeen, element_of, to_fields};
use super::vtu;
use crate::data::association::Association;
use crate::data::cells::CellMesh;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::Result;
use crate::io::bytes::file::Input;

/// The files of a grid, each with pieces of it.
#[derive(Debug)]
pub(crate) struct VtuPieces {
    path: PathBuf,
    /// Files in the index's order, each with its length in bytes.
    files: Vec<(PathBuf, u64)>,
}

/// Some of the pieces, one after another.
#[derive(Debug, Default)]
pub(crate) struct SomePieces {
    parts: Vec<Part>,
    arrays: [Vec<Vec<Array>>; 2],
    /// Arrays that the pieces have, of nodes and of cells.
    pub(crate) seen: [ArraysSeen; 2],
}

impl VtuPieces {
    /// Opens an index and looks for the files that it names; `None` for any other file.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open) for an index; a piece's missing file.
    pub(crate) fn open(path: &Path) -> Result<Option<Self>> {
        pieces::in_index(path, vtu::KIND, |input, element| {
            Ok(Self {
                path: path.to_path_buf(),
                files: pieces::sources_with_lengths(input, element)?,
            })
        })
    }

    /// Path of the index.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The lengths of the files, in bytes.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = u64> {
        self.files.iter().map(|(_, length)| *length)
    }

    /// Reads the pieces of some of the files.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open).
    pub(crate) fn read(&self, files: Range<usize>) -> Result<SomePieces> {
        let input = Input::of_file(&self.path);
        let files = self.files[files].iter().map(|(file, _)| file);
        let mut parts = pieces::read_files(input, files, vtu::KIND, vtu::read_part)?;
        let arrays = Association::BOTH.map(|association| arrays_of(&mut parts, association));
        Ok(SomePieces {
            seen: arrays.each_ref().map(|arrays| ArraysSeen::of(arrays)),
            parts,
            arrays,
        })
    }
}

impl SomePieces {
    /// The cells of each piece.
    pub(crate) fn meshes(&self) -> impl Iterator<Item = &CellMesh> {
        self.parts.iter().map(Part::mesh)
    }

    /// Joins the pieces to a data set with the arrays that all pieces have; notes name the other arrays.
    ///
    /// - `path`: path of the index.
    /// - `all`: arrays of nodes and of cells that all pieces have.
    ///
    /// # Errors
    /// More nodes or entries than `u32` counts.
    pub(crate) fn dataset(self, path: &Path, all: &[ArraysSeen; 2]) -> Result<Dataset> {
        let mut fields = Vec::new();
        let mut notes = Vec::new();
        let each = Association::BOTH.into_iter().zip(self.arrays).zip(all);
        for ((association, mut arrays), seen) in each {
            arrays.iter_mut().for_each(|arrays| seen.keep(arrays));
            notes.extend(seen.note(element_of(association)));
            let joined = arrays.into_iter().reduce(append_arrays);
            let joined = joined.unwrap_or_else(|| seen.common().map(Array::none_of).collect());
            fields.extend(to_fields(joined, association));
        }
        let mesh = mesh_of(path, self.parts)?;
        let mut data = Dataset::new(path, vtu::FORMAT, Geometry::Cells(mesh), fields);
        data.name_units();
        Ok(Dataset { notes, ..data })
    }
}
