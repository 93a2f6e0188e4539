//! Reads groups, attributes and arrays of HDF5 files, within limits on memory.

use std::cell::{Cell, RefCell};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use hdf5_reader::attribute_api::Attribute;
use hdf5_reader::group::Group;
use hdf5_reader::storage::DynStorage;
use hdf5_reader::{
    BytesStorage, FileStorage, Hdf5File, OpenOptions, RawAttribute, SliceInfo, SliceInfoElem,
};

use super::layout::{Layout, NotRead};
use crate::data::association::Association;
use crate::data::dataset::{Field, FieldSource};
use crate::data::unit;
use crate::error::{Error, Result};
use crate::io::bytes::file::{Input, open_regular};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles, points, values};
use crate::io::vtk::xml::clip;
use crate::memory::check_room;
use crate::scene::Values;

/// Greatest total size of a file's arrays, as a multiple of its length. Snapshots compress to about half; a lattice of
/// equal particles compresses to a thirtieth.
const MOST_INFLATION: usize = 32;

/// Additional bytes, because the ratio says little about small files.
const SMALL: usize = 16 << 20;

/// Arrays that determine position, size or mass of particles. A file is refused if one of them cannot be read; other
/// arrays are left out with a note.
const DECISIVE: [&str; 10] = [
    "Coordinates",
    "Masses",
    "Mass",
    "Density",
    "Densities",
    "SmoothingLength",
    "SmoothingLengths",
    "xyz",
    "h",
    "itype",
];

/// Advice for numbers that are not read.
const AS_FLOATS: &str = "write it as 32-bit floats (h5py, swiftsimio)";

/// Greatest number of values per particle in an array.
const MOST_COMPONENTS: usize = 16;

/// Snapshot during reading.
pub(super) struct SnapshotFile<'a> {
    pub(super) path: &'a Path,
    pub(super) file: Hdf5File,
    /// Bytes that may still be read into memory.
    pub(super) budget: Cell<usize>,
    pub(super) notes: RefCell<Vec<String>>,
    /// Rows to read, and the total number of rows; `None` reads all.
    pub(super) rows: Option<(Range<usize>, usize)>,
}

/// Numbers of a dataset: `components` of them for each of `count` rows.
pub(super) struct Array {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) components: usize,
    pub(super) encoding: Encoding,
    pub(super) bytes: Vec<u8>,
    pub(super) unit: Option<String>,
}

/// Contents of a dataset.
pub(super) enum Found {
    Numbers(Array),
    /// Not numbers in rows.
    Other,
    /// Numbers in an unsupported layout, described by the text.
    Unreadable(String),
}

/// Returns the bytes of a file and their number. A file on the disk is read in parts on request, and not held in
/// memory.
pub(in crate::io) fn storage(input: Input<'_>) -> Result<(DynStorage, usize)> {
    if input.is_on_disk() {
        let (file, len) = open_regular(input.path)?;
        let file = FileStorage::from_file(file).map_err(|e| broken(input.path, "file", &e))?;
        return Ok((Arc::new(file), usize::try_from(len).unwrap_or(usize::MAX)));
    }
    let bytes = input.read_all()?.into_owned();
    let len = bytes.len();
    Ok((Arc::new(BytesStorage::new(bytes)), len))
}

impl<'a> SnapshotFile<'a> {
    pub(super) fn open(input: Input<'a>) -> Result<Self> {
        let path = input.path;
        let (storage, len) = storage(input)?;
        let budget = len.saturating_mul(MOST_INFLATION).saturating_add(SMALL);
        let options = OpenOptions {
            // Each array is read once, so no cache is needed.
            chunk_cache_bytes: 0,
            max_chunk_bytes: budget,
            max_read_bytes: budget,
            max_object_header_bytes: len.saturating_add(SMALL / 16),
            ..OpenOptions::default()
        };
        let file = Hdf5File::from_storage_with_options(storage, options);
        let file = file.map_err(|e| broken(path, "file", &e))?;
        Ok(Self {
            path,
            file,
            budget: Cell::new(budget),
            notes: RefCell::default(),
            rows: None,
        })
    }

    pub(super) fn note(&self, note: impl Into<String>) {
        self.notes.borrow_mut().push(note.into());
    }

    /// Returns the names of the root's members.
    pub(super) fn members(&self) -> Result<Vec<String>> {
        let fault = |e| broken(self.path, "root group", &e);
        let root = self.file.root_group().map_err(fault)?;
        let (mut names, datasets) = root.member_names().map_err(fault)?;
        names.extend(datasets);
        Ok(names)
    }

    /// Returns the group of the root with this name, if there is one.
    pub(super) fn group(&self, name: &str) -> Result<Option<Group>> {
        let root = self.file.root_group();
        let root = root.map_err(|e| broken(self.path, "root group", &e))?;
        self.child(&root, name)
    }

    /// Returns the group within another with this name, if there is one.
    pub(super) fn child(&self, parent: &Group, name: &str) -> Result<Option<Group>> {
        let groups = parent.member_names().map(|(groups, _)| groups);
        let groups = groups.map_err(|e| broken(self.path, parent.name(), &e))?;
        if !groups.iter().any(|group| group == name) {
            return Ok(None);
        }
        let group = parent.group(name);
        group.map(Some).map_err(|e| broken(self.path, name, &e))
    }

    /// Returns the names of the datasets of a group.
    pub(super) fn names(&self, group: &Group) -> Result<Vec<String>> {
        let names = group.member_names();
        names
            .map(|(_, datasets)| datasets)
            .map_err(|e| broken(self.path, group.name(), &e))
    }

    pub(super) fn has(&self, group: &Group, name: &str) -> Result<bool> {
        Ok(self.names(group)?.iter().any(|n| n == name))
    }

    /// Reads a dataset of a group. Returns `None` if it does not exist or holds no numbers in rows.
    pub(super) fn array(&self, group: &Group, name: &str) -> Result<Option<Array>> {
        if !self.has(group, name)? {
            return Ok(None);
        }
        match self.present_array(group, name)? {
            Found::Numbers(array) => Ok(Some(array)),
            Found::Other => Ok(None),
            Found::Unreadable(layout) => Err(self.unreadable(group, name, layout)),
        }
    }

    /// Reads a dataset that is known to exist.
    pub(super) fn present_array(&self, group: &Group, name: &str) -> Result<Found> {
        let rows = match &self.rows {
            None => None,
            Some((_, count)) if self.row_count(group, name)? != *count => return Ok(Found::Other),
            Some((rows, _)) => Some(rows.clone()),
        };
        self.selected_array(group, name, 1, rows)
    }

    /// Reads some rows of a dataset that is known to exist.
    ///
    /// - `ranks`: number of its leading dimensions that count samples, including that of `rows`. One further dimension
    ///   counts components.
    /// - `rows`: range of the first dimension to read; `None` reads all.
    pub(super) fn selected_array(
        &self,
        group: &Group,
        name: &str,
        ranks: usize,
        rows: Option<Range<usize>>,
    ) -> Result<Found> {
        let place = || format!("dataset `{}/{}`", group.name(), clip(name));
        let failed = |e| broken(self.path, &place(), &e);
        let dataset = group.dataset(name).map_err(failed)?;
        let layout = match Layout::of(&dataset.raw_datatype().map_err(failed)?) {
            Ok(layout) => layout,
            Err(NotRead::NoNumbers) => return Ok(Found::Other),
            Err(NotRead::Layout(layout)) => return Ok(Found::Unreadable(layout)),
        };
        let encoding = layout.encoding();
        let size = |n: &u64| usize::try_from(*n).ok();
        let (samples, components) = match dataset.shape() {
            [] => (&[][..], Some(1)),
            samples if samples.len() == ranks => (samples, Some(1)),
            [samples @ .., components] if samples.len() == ranks => (samples, size(components)),
            _ => return Ok(Found::Other),
        };
        let mut count = samples
            .iter()
            .try_fold(1_usize, |product, n| product.checked_mul(size(n)?));
        let all_rows = samples.first().and_then(size).unwrap_or(1);
        let rows = rows.filter(|rows| *rows != (0..all_rows));
        if let Some(rows) = &rows {
            if rows.start > rows.end || rows.end > all_rows {
                return Err(Error::format(
                    self.path,
                    place(),
                    format!("rows {} to {}", rows.start, rows.end),
                    format!("{all_rows} rows"),
                    "the file is damaged: copy or write it again",
                ));
            }
            count = count.map(|n| n / all_rows.max(1) * rows.len());
        }
        let (Some(count), Some(components @ 1..=MOST_COMPONENTS)) = (count, components) else {
            return Ok(Found::Other);
        };
        let too_large = || {
            Error::format(
                self.path,
                place(),
                format!("arrays of at most {MOST_INFLATION} times the file's bytes in all"),
                format!("{count} x {components} numbers"),
                "the file is damaged, or compressed beyond reason: write it uncompressed",
            )
        };
        // Stored and widened numbers are in memory together, so the larger size counts.
        let size = encoding.scalar.size().max(layout.stored_size());
        let byte_count = count
            .checked_mul(components)
            .and_then(|n| n.checked_mul(size));
        let byte_count = byte_count.ok_or_else(too_large)?;
        let left = self.budget.get().checked_sub(byte_count);
        self.budget.set(left.ok_or_else(too_large)?);
        check_room(self.path, place(), byte_count as u64)?;
        let (bytes, encoding) = match (rows, layout) {
            (None, layout) => (
                layout.widened(read_bytes(&dataset, byte_count).map_err(failed)?),
                encoding,
            ),
            (Some(rows), _) if rows.is_empty() => (Vec::new(), encoding),
            (Some(rows), Layout::Native(stored)) => {
                let bytes = read_rows(&dataset, stored.scalar, &rows).map_err(failed)?;
                // The decoder returns numbers in the byte order of this machine, and `read_rows` writes them as
                // little-endian.
                let big_endian = false;
                (
                    bytes,
                    Encoding {
                        big_endian,
                        ..stored
                    },
                )
            }
            // For other layouts, all rows are read and the wanted ones are taken.
            (Some(rows), layout) => {
                let of_row = count / rows.len() * components * encoding.scalar.size();
                let all = layout.widened(dataset.read_raw_bytes().map_err(failed)?);
                let wanted = all.get(rows.start * of_row..rows.end * of_row);
                (wanted.unwrap_or_default().to_vec(), encoding)
            }
        };
        let factors = dataset.raw_attributes().unwrap_or_default();
        Ok(Found::Numbers(Array {
            name: name.to_owned(),
            count,
            components,
            encoding,
            bytes,
            unit: stated_unit(&dataset.attributes(), &factors),
        }))
    }

    pub(super) fn unreadable(&self, group: &Group, name: &str, layout: String) -> Error {
        Error::format(
            self.path,
            format!("dataset `{}/{}`", group.name(), clip(name)),
            "IEEE numbers, or the shorter ones of SWIFT's lossy compression",
            layout,
            AS_FLOATS,
        )
    }

    /// Returns the number of rows of a dataset, without reading it.
    pub(super) fn row_count(&self, group: &Group, name: &str) -> Result<usize> {
        let place = format!("dataset `{}/{name}`", group.name());
        let dataset = group.dataset(name);
        let dataset = dataset.map_err(|e| broken(self.path, &place, &e))?;
        let rows = dataset.shape().first().copied().unwrap_or(0);
        Ok(usize::try_from(rows).unwrap_or(usize::MAX))
    }

    /// Reads the positions of N particles from an array of shape (N, 3).
    pub(super) fn positions(&self, group: &Group, name: &str) -> Result<Vec<DVec3>> {
        let shape_error = |found: String| {
            Error::format(
                self.path,
                format!("dataset `{}/{name}`", group.name()),
                "numbers of shape (N, 3)",
                found,
                "export the particles as CSV or NPY",
            )
        };
        let Some(array) = self.array(group, name)? else {
            return Err(shape_error("something else".to_owned()));
        };
        let wrong = || shape_error(format!("shape ({}, {})", array.count, array.components));
        if array.components != 3 {
            return Err(wrong());
        }
        points(&array.bytes, array.encoding, array.count).ok_or_else(wrong)
    }

    /// Reads all arrays of a group with one row per particle as fields, except those in `except`. Adds a note on arrays
    /// that are left out.
    pub(super) fn fields(
        &self,
        group: &Group,
        count: usize,
        except: &[&str],
    ) -> Result<Vec<Field>> {
        let mut fields = Vec::new();
        let mut left_out = Vec::new();
        for name in self.names(group)? {
            if except.contains(&name.as_str()) {
                continue;
            }
            match self.present_array(group, &name)? {
                Found::Numbers(array) if array.count == count => fields.extend(array.field()),
                Found::Unreadable(layout) if DECISIVE.contains(&name.as_str()) => {
                    return Err(self.unreadable(group, &name, layout));
                }
                Found::Unreadable(layout) => self.note(format!(
                    "Left out, because numbers are not read that are stored like these: `{}`, {layout}; {AS_FLOATS}.",
                    clip(&name)
                )),
                _ => left_out.push(format!("`{}`", clip(&name))),
            }
        }
        if !left_out.is_empty() {
            let more = left_out.len().saturating_sub(8);
            left_out.truncate(8);
            let more = match more {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            self.note(format!(
                "Left out, because they do not hold numbers for each particle: {}{more}.",
                left_out.join(", ")
            ));
        }
        Ok(fields)
    }

    /// Reads the numbers of an attribute of a group.
    pub(super) fn attribute(&self, group: &Group, name: &str) -> Option<Vec<f64>> {
        let attributes = group.raw_attributes().ok()?;
        attribute_numbers(attributes.iter().find(|a| a.name() == name)?)
    }

    /// Reads a number from an attribute of a dataset in a group.
    pub(super) fn attribute_of(&self, group: &Group, name: &str, attribute: &str) -> Option<f64> {
        let attributes = group.dataset(name).ok()?.raw_attributes().ok()?;
        let found = attributes.iter().find(|a| a.name() == attribute)?;
        attribute_numbers(found)?.first().copied()
    }
}

impl Array {
    pub(super) fn stride(&self, component: usize) -> Stride {
        let size = self.encoding.scalar.size();
        Stride {
            first: component * size,
            step: self.components * size,
            count: self.count,
        }
    }

    pub(super) fn doubles(&self, component: usize) -> Option<Vec<f64>> {
        doubles(&self.bytes, self.encoding, self.stride(component))
    }

    pub(super) fn values(&self, component: usize) -> Option<Values> {
        values(&self.bytes, self.encoding, self.stride(component))
    }

    pub(super) fn field(self) -> Option<Field> {
        let components: Option<Vec<Values>> =
            (0..self.components).map(|i| self.values(i)).collect();
        let mut components = components?;
        let source = if components.len() == 1 {
            FieldSource::Scalar(components.pop()?)
        } else {
            FieldSource::Vector(components)
        };
        Some(Field {
            name: self.name,
            association: Association::Nodes,
            source,
            unit: self.unit,
        })
    }
}

/// Reads all bytes of a dataset; the budget allows `most` bytes.
fn read_bytes(dataset: &hdf5_reader::Dataset, most: usize) -> hdf5_reader::error::Result<Vec<u8>> {
    let len = dataset.raw_byte_len()?;
    if len > most {
        // The decoder's own limit bounds this read or refuses it.
        return dataset.read_raw_bytes();
    }
    // New pages are zero already. If the decoder cleared them first, each would be written twice.
    let mut bytes = vec![0; len];
    dataset.read_raw_bytes_into(&mut bytes)?;
    Ok(bytes)
}

/// Reads the numbers of some rows of a dataset, as little-endian bytes.
fn read_rows(
    dataset: &hdf5_reader::Dataset,
    scalar: ScalarType,
    rows: &Range<usize>,
) -> hdf5_reader::error::Result<Vec<u8>> {
    let mut selection = SliceInfo::all(dataset.ndim());
    if let Some(first) = selection.selections.first_mut() {
        *first = SliceInfoElem::Slice {
            start: rows.start as u64,
            end: rows.end as u64,
            step: 1,
        };
    }
    selected_bytes(dataset, scalar, &selection)
}

/// Reads selected numbers of a dataset, as little-endian bytes.
pub(super) fn selected_bytes(
    dataset: &hdf5_reader::Dataset,
    scalar: ScalarType,
    selection: &SliceInfo,
) -> hdf5_reader::error::Result<Vec<u8>> {
    macro_rules! of {
        ($t:ty) => {{
            let numbers = dataset.read_slice::<$t>(selection)?;
            numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
        }};
    }
    Ok(match scalar {
        ScalarType::I8 => of!(i8),
        ScalarType::U8 => of!(u8),
        ScalarType::I16 => of!(i16),
        ScalarType::U16 => of!(u16),
        ScalarType::I32 => of!(i32),
        ScalarType::U32 => of!(u32),
        ScalarType::I64 => of!(i64),
        ScalarType::U64 => of!(u64),
        // Their layout is not native, so they are read as bits.
        ScalarType::F16 => of!(u16),
        ScalarType::F32 => of!(f32),
        ScalarType::F64 => of!(f64),
    })
}

/// Returns the unit of a dataset's numbers as stored.
///
/// SWIFT states the unit of the numbers after conversion to cgs (`a^-3 U_M U_L^-3 [ g cm^-3 ]`), and the factors of the
/// conversion. It is the unit of the stored numbers only if these factors are 1.
fn stated_unit(attributes: &[Attribute], raw: &[RawAttribute]) -> Option<String> {
    let read = |attribute: &Attribute| attribute.read_string().ok();
    let is_unit = |a: &&Attribute| {
        ["unit", "units"]
            .iter()
            .any(|n| a.name.eq_ignore_ascii_case(n))
    };
    if let Some(attribute) = attributes.iter().find(is_unit) {
        return unit::cleaned(&read(attribute)?);
    }
    let is_factor = |a: &&RawAttribute| a.name().starts_with("Conversion factor to");
    let mut factors = raw.iter().filter(is_factor).peekable();
    factors.peek()?;
    let is_one = |a: &RawAttribute| {
        let numbers = attribute_numbers(a);
        numbers.is_some_and(|n| matches!(n[..], [x] if (x - 1.0).abs() <= 1e-6))
    };
    if !factors.all(is_one) {
        return None;
    }
    let is_expression = |a: &&Attribute| a.name.starts_with("Expression for physical CGS units");
    let expression = read(attributes.iter().find(is_expression)?)?;
    let (_, bracket) = expression.rsplit_once('[')?;
    unit::cleaned(bracket.split_once(']')?.0)
}

/// Returns the numbers of an attribute.
fn attribute_numbers(attribute: &RawAttribute) -> Option<Vec<f64>> {
    let layout = Layout::of(attribute.raw_datatype()).ok()?;
    let encoding = layout.encoding();
    let bytes = layout.widened(attribute.message().raw_data.clone());
    let stride = Stride {
        first: 0,
        step: encoding.scalar.size(),
        count: bytes.len() / encoding.scalar.size(),
    };
    doubles(&bytes, encoding, stride)
}

/// Converts a count or an index that a file stores as a float.
pub(super) fn whole(number: f64) -> Option<usize> {
    let is_whole = number >= 0.0 && number <= 2.0_f64.powi(53) && number.fract() == 0.0;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "it was checked to be whole and in range"
    )]
    is_whole.then_some(number as usize)
}

/// Filters that the decoder does not support, by their registered numbers.
const FILTERS: &[(&str, &str)] = &[
    ("307", "bzip2"),
    ("32000", "LZF"),
    ("32001", "Blosc"),
    ("32008", "bitshuffle"),
    ("32013", "ZFP"),
    ("32015", "Zstandard"),
    ("32017", "SZ"),
    ("32026", "Blosc2"),
];

/// Converts an error of the decoder to an error of this library.
pub(super) fn broken(path: &Path, place: &str, error: &hdf5_reader::error::Error) -> Error {
    let text = error.to_string();
    let number = text.rsplit_once("filter id ").map(|(_, number)| number);
    let filter = FILTERS.iter().find(|(known, _)| number == Some(known));
    let found = match filter {
        Some((number, name)) => {
            format!("compressed by {name} (filter {number}), which is not read")
        }
        None => text.chars().take(300).collect(),
    };
    let advice = match number {
        Some(_) => "rewrite it with another filter: h5repack -f GZIP=4",
        None => "copy the file again",
    };
    Error::format(path, clip(place), "sound HDF5", found, advice)
}
