//! Reads VTKHDF files (`.vtkhdf`, `.hdf`): VTK's data sets in HDF5, as VTK's documentation describes them ("VTKHDF File
//! Format", versions 1.0 to 2.5).
//!
//! | member of the group `VTKHDF` | contents |
//! |---|---|
//! | attribute `Type` | `ImageData`, `UnstructuredGrid`, `PolyData`, `OverlappingAMR`, `MultiBlockDataSet`, `PartitionedDataSetCollection` |
//! | `PointData`, `CellData` | an array for each field; `FieldData` is not read |
//! | `Steps` | if there are time steps: the attribute `NSteps`, `Values`, and the position of each step's numbers |
//!
//! | type | contents | read by |
//! |---|---|---|
//! | `ImageData` | attributes `WholeExtent`, `Origin`, `Spacing`, `Direction`; arrays (z, y, x) | [`image`] |
//! | `UnstructuredGrid`, `PolyData` | parts one after another, each with its own numbers of points and cells | [`cells`] |
//! | `OverlappingAMR` | `Level0`, `Level1`, ... with `AMRBox` and the attribute `Spacing` | [`amr`] |
//! | the last two | a group with its own type for each block, with the attribute `Index`; `Assembly` links to them | this module |

mod amr;
mod cells;
mod image;

use std::ops::Range;

use hdf5_reader::group::Group;

use super::file::{Array, Found, SnapshotFile, broken, whole};
use crate::data::association::Association;
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::scalars;
use crate::io::options::ReadAs;
use crate::io::vtk::meshes::Part;
use crate::io::vtk::pieces::element_of;
use crate::io::vtk::xml::clip;
use crate::io::{time_steps, vtk};

/// Name of the file's top group.
pub(super) const ROOT: &str = "VTKHDF";

const DAMAGED: &str = "the file is damaged: save it again";

/// Greatest number of blocks of a collection, far more than any code writes.
const MOST_BLOCKS: usize = 1 << 16;

/// Reads a VTKHDF file.
///
/// - `root`: the group `VTKHDF`.
/// - `time_step`: index of the time step, from 0; if absent, the first is read with a note.
///
/// # Errors
/// The type is not supported, arrays are damaged or missing, or the time step does not exist.
pub(super) fn read(
    file: &SnapshotFile<'_>,
    root: Group,
    read_as: Option<ReadAs>,
    time_step: Option<usize>,
) -> Result<Dataset> {
    let mut found = Vec::new();
    let all = times(file, &root)?.unwrap_or_default();
    let (step, note) = time_steps::chosen(file.path, &all, time_step)?;
    if let Some(note) = note {
        file.note(note);
    }
    let block = Block::new(file, root, step)?;
    match block.kind()?.as_str() {
        "MultiBlockDataSet" | "PartitionedDataSetCollection" => {
            let blocks = block.blocks()?;
            if blocks.len() > 1 {
                file.note(format!("Blocks put together: {}.", blocks.len()));
            }
            for block in blocks {
                found.extend(block.read()?);
            }
        }
        _ => found.extend(block.read()?),
    }
    let mut data = together(file, found, read_as)?;
    let mut notes = file.notes.take();
    notes.append(&mut data.notes);
    data.notes = notes;
    Ok(data)
}

/// Contents of a group with a type.
enum Piece {
    Cells(&'static str, Vec<Part>),
    Image(image::Image),
    Amr(Box<amr::Amr>),
}

impl Piece {
    fn name(&self) -> &'static str {
        match self {
            Self::Cells(..) => "cells",
            Self::Image(_) => "images",
            Self::Amr(_) => "levels of refinement",
        }
    }
}

/// Joins all blocks to one data set. It keeps the blocks of the same kind as the first.
fn together(
    file: &SnapshotFile<'_>,
    found: Vec<Piece>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let path = file.path;
    let Some(kind) = found.first().map(Piece::name) else {
        let advice = "save the data set with its data";
        return Err(Error::format(
            path,
            ROOT,
            "at least one block",
            "none",
            advice,
        ));
    };
    let others = found.iter().filter(|piece| piece.name() != kind).count();
    if others > 0 {
        file.note(format!(
            "Blocks of other kinds than the first one's ({kind}), left out: {others}."
        ));
    }
    let (mut parts, mut images) = (Vec::new(), Vec::new());
    let mut format = "VTKHDF unstructured grid";
    for piece in found {
        match piece {
            Piece::Cells(name, of_block) if kind == "cells" => {
                if parts.is_empty() {
                    format = name;
                }
                parts.extend(of_block);
            }
            Piece::Image(image) if kind == "images" => images.push(image),
            Piece::Amr(amr) if amr.is_first(kind) => return amr.dataset(path),
            _ => {}
        }
    }
    match kind {
        "images" => image::dataset(path, images),
        _ => vtk::meshes::join(path, format, parts, read_as),
    }
}

/// Group with a type, at one time step.
struct Block<'f, 'a> {
    file: &'f SnapshotFile<'a>,
    group: Group,
    steps: Option<Group>,
    step: usize,
    /// Requested time step.
    wanted: usize,
}

impl<'f, 'a> Block<'f, 'a> {
    /// Opens a group at a time step. If it has fewer time steps, its last one is used.
    fn new(file: &'f SnapshotFile<'a>, group: Group, step: usize) -> Result<Self> {
        let steps = file.child(&group, "Steps")?;
        let mut block = Self {
            file,
            group,
            steps,
            step,
            wanted: step,
        };
        let count = block.times()?.map_or(1, |times| times.len());
        block.step = step.min(count.saturating_sub(1));
        Ok(block)
    }

    fn fault(&self, place: &str, expected: &str, found: String) -> Error {
        let place = format!("{}/{place}", clip(self.group.name()));
        Error::format(self.file.path, place, expected, found, DAMAGED)
    }

    /// Returns the times in the group, if there are any.
    fn times(&self) -> Result<Option<Vec<f64>>> {
        let Some(steps) = &self.steps else {
            return Ok(None);
        };
        let Some(times) = self.file.array(steps, "Values")? else {
            return Err(self.fault("Steps/Values", "the times", "none".into()));
        };
        Ok(times.doubles(0).filter(|times| !times.is_empty()))
    }

    fn kind(&self) -> Result<String> {
        let attribute = self.group.attribute("Type");
        let kind = attribute.and_then(|a| a.read_string());
        kind.map(|kind| kind.trim_end_matches(['\0', ' ']).to_owned())
            .map_err(|e| broken(self.file.path, "VTKHDF, attribute `Type`", &e))
    }

    /// Returns the blocks of a collection, in the order of their indices.
    fn blocks(&self) -> Result<Vec<Self>> {
        let names = self.group.member_names();
        let (names, _) = names.map_err(|e| broken(self.file.path, ROOT, &e))?;
        let mut blocks = Vec::new();
        for name in names.iter().take(MOST_BLOCKS) {
            let Some(group) = self.file.child(&self.group, name)? else {
                continue;
            };
            // `Assembly` has no type.
            if group.attribute("Type").is_err() {
                continue;
            }
            let index = self.file.attribute(&group, "Index");
            let index = index.and_then(|n| n.first().copied()).unwrap_or(f64::MAX);
            blocks.push((index, Self::new(self.file, group, self.wanted)?));
        }
        blocks.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(blocks.into_iter().map(|(_, block)| block).collect())
    }

    fn read(&self) -> Result<Option<Piece>> {
        let kind = self.kind()?;
        Ok(match kind.as_str() {
            "UnstructuredGrid" => Some(Piece::Cells("VTKHDF unstructured grid", self.solids()?)),
            "PolyData" => Some(Piece::Cells("VTKHDF polygonal data", self.polygons()?)),
            "ImageData" => Some(Piece::Image(self.image()?)),
            "OverlappingAMR" => Some(Piece::Amr(Box::new(self.amr()?))),
            other => {
                return Err(Error::format(
                    self.file.path,
                    format!("{}, attribute `Type`", clip(self.group.name())),
                    "ImageData, UnstructuredGrid, PolyData, OverlappingAMR, MultiBlockDataSet or \
                     PartitionedDataSetCollection",
                    format!("`{}`, which is not read yet", clip(other)),
                    "save it as one of these",
                ));
            }
        })
    }

    /// Returns the start of the step's numbers, which `Steps` states under `name`; 0 without time steps.
    fn start(&self, name: &str, column: usize) -> Result<usize> {
        match &self.steps {
            None => Ok(0),
            Some(steps) => Ok(self.start_in(steps, name, column)?.unwrap_or(0)),
        }
    }

    /// Returns the start that another group states; `None` if it states none.
    fn start_in(&self, group: &Group, name: &str, column: usize) -> Result<Option<usize>> {
        let Some(array) = self.file.array(group, name)? else {
            return Ok(None);
        };
        let numbers = array.doubles(column.min(array.components - 1));
        let start = numbers.and_then(|n| n.get(self.step).copied());
        let start = start.and_then(whole);
        start.map(Some).ok_or_else(|| {
            let place = format!("Steps/{}", clip(name));
            self.fault(&place, "where each step begins", "something else".into())
        })
    }

    /// Returns the start of an array of nodes or cells at the step, if `Steps` states it.
    fn data_start(&self, association: Association, name: &str) -> Result<Option<usize>> {
        let Some(steps) = &self.steps else {
            return Ok(None);
        };
        let offsets = format!("{}Offsets", element_of(association));
        match self.file.child(steps, &offsets)? {
            None => Ok(None),
            Some(offsets) => self.start_in(&offsets, name, 0),
        }
    }

    /// Reads the arrays of nodes or cells. `rows` are relative to the start of the step's numbers.
    ///
    /// - `start`: start of the step's numbers in arrays for which `Steps` states none.
    fn arrays(
        &self,
        group: &Group,
        association: Association,
        start: usize,
        rows: Range<usize>,
    ) -> Result<Vec<vtk::array::Array>> {
        let Some(data) = self.file.child(group, element_of(association))? else {
            return Ok(Vec::new());
        };
        let mut arrays = Vec::new();
        if rows.is_empty() {
            return Ok(arrays);
        }
        for name in self.file.names(&data)? {
            let start = self.data_start(association, &name)?.unwrap_or(start);
            let rows = start.saturating_add(rows.start)..start.saturating_add(rows.end);
            arrays.extend(self.array(&data, &name, 1, Some(rows))?);
        }
        Ok(arrays)
    }

    /// Reads an array of numbers of a group. Other arrays are left out with a note.
    fn array(
        &self,
        group: &Group,
        name: &str,
        ranks: usize,
        rows: Option<Range<usize>>,
    ) -> Result<Option<vtk::array::Array>> {
        let array = match self.file.selected_array(group, name, ranks, rows)? {
            Found::Numbers(array) => array,
            Found::Other | Found::Unreadable(_) => {
                let name = clip(name);
                self.file.note(format!(
                    "Left out, because it does not hold numbers that are read: `{name}`."
                ));
                return Ok(None);
            }
        };
        let components: Option<Vec<_>> = (0..array.components).map(|i| array.values(i)).collect();
        Ok(components.map(|components| vtk::array::Array {
            name: array.name,
            components,
        }))
    }

    /// Reads an array that must exist.
    fn needed(&self, group: &Group, name: &str, rows: Option<Range<usize>>) -> Result<Array> {
        if !self.file.has(group, name)? {
            return Err(self.fault(&clip(name), "this array", "none".into()));
        }
        match self.file.selected_array(group, name, 1, rows)? {
            Found::Numbers(array) => Ok(array),
            Found::Other | Found::Unreadable(_) => {
                Err(self.fault(&clip(name), "numbers in rows", "something else".into()))
            }
        }
    }

    /// Reads the counts of a group, one for each part.
    fn counts(&self, group: &Group, name: &str) -> Result<Vec<usize>> {
        let array = self.needed(group, name, None)?;
        self.whole_numbers(name, &array, |n| usize::try_from(n).ok())
    }

    /// Reads indices from 0 to 4294967295, or kinds of cells.
    fn indices<T: Copy + Default + Send>(
        &self,
        group: &Group,
        name: &str,
        rows: Range<usize>,
        convert: impl Fn(i128) -> Option<T> + Sync,
    ) -> Result<Vec<T>> {
        let array = self.needed(group, name, Some(rows))?;
        self.whole_numbers(name, &array, convert)
    }

    fn whole_numbers<T: Copy + Default + Send>(
        &self,
        name: &str,
        array: &Array,
        convert: impl Fn(i128) -> Option<T> + Sync,
    ) -> Result<Vec<T>> {
        let numbers = scalars::integers(&array.bytes, array.encoding, convert);
        numbers.map_err(|fault| {
            let found = match fault {
                scalars::NotIntegers::Fractions => "fractions".to_owned(),
                scalars::NotIntegers::Refused(at, n) => format!("{n} as number {at}"),
            };
            self.fault(&clip(name), "whole numbers that fit", found)
        })
    }
}

/// Reads exactly `N` numbers of an attribute.
fn numbers<const N: usize>(
    block: &Block<'_, '_>,
    group: &Group,
    name: &str,
) -> Result<Option<[f64; N]>> {
    let Some(found) = block.file.attribute(group, name) else {
        return Ok(None);
    };
    <[f64; N]>::try_from(found.as_slice())
        .map(Some)
        .map_err(|_| {
            let expected = format!("{N} numbers");
            let place = format!("attribute `{name}`");
            block.fault(&place, &expected, format!("{} of them", found.len()))
        })
}

/// Returns the times of a file, if it has any.
///
/// # Errors
/// The file is damaged.
pub(super) fn times(file: &SnapshotFile<'_>, root: &Group) -> Result<Option<Vec<f64>>> {
    let block = Block::new(file, root.clone(), 0)?;
    if let Some(times) = block.times()? {
        return Ok(Some(times));
    }
    // In a collection, each block has its own times.
    let blocks = block.blocks()?;
    match blocks.first() {
        Some(first) => first.times(),
        None => Ok(None),
    }
}
