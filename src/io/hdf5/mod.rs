//! HDF5 snapshots of particle codes: Phantom's dumps, and those of Gadget and its kin (Gizmo,
//! Arepo, SWIFT).
//!
//! The format itself is decoded by the `hdf5-reader` crate. Of the pure-Rust readers it is the
//! one that takes limits on what a read may allocate; a few hundred bytes of HDF5 can declare
//! gigabytes.

mod gadget;
mod phantom;

use std::cell::{Cell, RefCell};
use std::path::Path;

use glam::DVec3;
use hdf5_reader::attribute_api::Attribute;
use hdf5_reader::group::Group;
use hdf5_reader::{ByteOrder, Datatype, Hdf5File, OpenOptions};

use super::dataset::{Association, Dataset, Field, FieldSource};
use super::file::Input;
use super::particle_type::{ParticleCount, ParticleType};
use super::scalars::{Encoding, ScalarType, Stride, doubles, points, values};
use super::table::list;
use super::unit;
use crate::error::{Error, Parameter, Result};
use crate::scene::Values;

/// The first bytes of every HDF5 file.
pub(crate) const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";

/// All arrays of a file together may have so many times its bytes. Snapshots compress to about
/// half; a lattice of equal particles, to a thirtieth.
const MOST_INFLATION: usize = 32;

/// ... and so many bytes more, for files so small that the ratio says nothing.
const SMALL: usize = 16 << 20;

/// Numbers per particle that an array may have.
const MOST_COMPONENTS: usize = 16;

/// Reads a snapshot.
///
/// # Errors
/// A damaged file, or one that holds no particles under the names these codes use, or none of the type that is asked for.
///
/// - `wanted`: the type of particles; without it what the code's own reader takes.
pub(crate) fn read(input: Input<'_>, wanted: Option<ParticleType>) -> Result<Dataset> {
    let path = input.path;
    let file = SnapshotFile::open(input)?;
    if let Some(particles) = file.group("particles")?
        && file.has(&particles, "xyz")?
    {
        return phantom::read(&file, &particles, wanted);
    }
    if let Some(dataset) = gadget::read(&file, wanted)? {
        return Ok(dataset);
    }
    Err(Error::format(
        path,
        "groups",
        "`PartType0/Coordinates` (Gadget, SWIFT) or `particles/xyz` (Phantom)",
        "neither",
        "export the particles as CSV or NPY",
    ))
}

/// A snapshot while it is read.
struct SnapshotFile<'a> {
    path: &'a Path,
    file: Hdf5File,
    /// Bytes that may still be read into memory.
    budget: Cell<usize>,
    notes: RefCell<Vec<String>>,
}

/// The numbers of a dataset: `components` of them for each of `count` rows.
struct Array {
    name: String,
    count: usize,
    components: usize,
    encoding: Encoding,
    bytes: Vec<u8>,
    unit: Option<String>,
}

impl<'a> SnapshotFile<'a> {
    fn open(input: Input<'a>) -> Result<Self> {
        let path = input.path;
        let bytes = input.read_all()?.into_owned();
        let budget = bytes
            .len()
            .saturating_mul(MOST_INFLATION)
            .saturating_add(SMALL);
        let options = OpenOptions {
            // Every array is read once.
            chunk_cache_bytes: 0,
            max_chunk_bytes: budget,
            max_read_bytes: budget,
            max_object_header_bytes: bytes.len().saturating_add(SMALL / 16),
            ..OpenOptions::default()
        };
        let file = Hdf5File::from_vec_with_options(bytes, options)
            .map_err(|e| broken(path, "file", &e))?;
        Ok(Self {
            path,
            file,
            budget: Cell::new(budget),
            notes: RefCell::default(),
        })
    }

    fn note(&self, note: impl Into<String>) {
        self.notes.borrow_mut().push(note.into());
    }

    /// A group of the root, where there is one of that name.
    fn group(&self, name: &str) -> Result<Option<Group>> {
        let failed = |e| broken(self.path, "root group", &e);
        let root = self.file.root_group().map_err(failed)?;
        let (groups, _) = root.member_names().map_err(failed)?;
        if !groups.iter().any(|group| group == name) {
            return Ok(None);
        }
        let group = root.group(name);
        group.map(Some).map_err(|e| broken(self.path, name, &e))
    }

    /// The names of the datasets of a group.
    fn names(&self, group: &Group) -> Result<Vec<String>> {
        let names = group.member_names();
        names
            .map(|(_, datasets)| datasets)
            .map_err(|e| broken(self.path, group.name(), &e))
    }

    fn has(&self, group: &Group, name: &str) -> Result<bool> {
        Ok(self.names(group)?.iter().any(|n| n == name))
    }

    /// The numbers of a dataset of a group: `None` where there is none of that name, or it
    /// holds no numbers in rows.
    fn array(&self, group: &Group, name: &str) -> Result<Option<Array>> {
        if !self.has(group, name)? {
            return Ok(None);
        }
        self.present_array(group, name)
    }

    /// The same of a dataset that is known to be there.
    fn present_array(&self, group: &Group, name: &str) -> Result<Option<Array>> {
        let place = || format!("dataset `{}/{}`", group.name(), shortened(name));
        let failed = |e| broken(self.path, &place(), &e);
        let dataset = group.dataset(name).map_err(failed)?;
        let Some(encoding) = encoding(dataset.dtype()) else {
            return Ok(None);
        };
        let size = |n: &u64| usize::try_from(*n).ok();
        let (count, components) = match dataset.shape() {
            [] => (Some(1), Some(1)),
            [count] => (size(count), Some(1)),
            [count, components] => (size(count), size(components)),
            _ => return Ok(None),
        };
        let (Some(count), Some(components @ 1..=MOST_COMPONENTS)) = (count, components) else {
            return Ok(None);
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
        let left = count
            .checked_mul(components)
            .and_then(|n| n.checked_mul(encoding.scalar.size()))
            .and_then(|byte_count| self.budget.get().checked_sub(byte_count));
        self.budget.set(left.ok_or_else(too_large)?);
        let bytes = dataset.read_raw_bytes().map_err(failed)?;
        Ok(Some(Array {
            name: name.to_owned(),
            count,
            components,
            encoding,
            bytes,
            unit: stated_unit(&dataset.attributes()),
        }))
    }

    /// How many rows a dataset of a group has, which is not read.
    fn row_count(&self, group: &Group, name: &str) -> Result<usize> {
        let place = format!("dataset `{}/{name}`", group.name());
        let dataset = group.dataset(name);
        let dataset = dataset.map_err(|e| broken(self.path, &place, &e))?;
        let rows = dataset.shape().first().copied().unwrap_or(0);
        Ok(usize::try_from(rows).unwrap_or(usize::MAX))
    }

    /// Positions of N particles from an array of shape (N, 3).
    fn positions(&self, group: &Group, name: &str) -> Result<Vec<DVec3>> {
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

    /// All arrays of a group with one row per particle as fields, but for `except`; what is
    /// left out is noted.
    fn fields(&self, group: &Group, count: usize, except: &[&str]) -> Result<Vec<Field>> {
        let mut fields = Vec::new();
        let mut left_out = Vec::new();
        for name in self.names(group)? {
            if except.contains(&name.as_str()) {
                continue;
            }
            match self.present_array(group, &name)? {
                Some(array) if array.count == count => fields.extend(array.field()),
                _ => left_out.push(format!("`{}`", shortened(&name))),
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

    /// The numbers of an attribute of a group.
    fn attribute(&self, group: &Group, name: &str) -> Option<Vec<f64>> {
        attribute_numbers(&group.attribute(name).ok()?)
    }
}

impl Array {
    fn stride(&self, component: usize) -> Stride {
        let size = self.encoding.scalar.size();
        Stride {
            first: component * size,
            step: self.components * size,
            count: self.count,
        }
    }

    fn doubles(&self, component: usize) -> Option<Vec<f64>> {
        doubles(&self.bytes, self.encoding, self.stride(component))
    }

    fn values(&self, component: usize) -> Option<Values> {
        values(&self.bytes, self.encoding, self.stride(component))
    }

    fn field(self) -> Option<Field> {
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

/// That a file has no particles of a type, and which it has.
fn absent(path: &Path, wanted: ParticleType, present: &[ParticleCount]) -> Error {
    let present = present.iter().filter(|p| p.count > 0);
    let names: Vec<String> = present.map(ParticleCount::to_string).collect();
    Error::format(
        path,
        Parameter::ParticleType,
        format!("one of {}", list(names.iter().map(String::as_str))),
        format!("`{wanted}`, of which there are none"),
        "name one of these",
    )
}

/// The unit of a dataset's numbers as they are stored.
///
/// SWIFT states what the numbers are in once they are converted to cgs (`a^-3 U_M U_L^-3 [ g cm^-3 ]`) beside the factors of
/// the conversion: that is the unit of the numbers themselves only where these factors are 1.
fn stated_unit(attributes: &[Attribute]) -> Option<String> {
    let read = |attribute: &Attribute| attribute.read_string().ok();
    let is_unit = |a: &&Attribute| {
        ["unit", "units"]
            .iter()
            .any(|n| a.name.eq_ignore_ascii_case(n))
    };
    if let Some(attribute) = attributes.iter().find(is_unit) {
        return unit::cleaned(&read(attribute)?);
    }
    let is_factor = |a: &&Attribute| a.name.starts_with("Conversion factor to");
    let mut factors = attributes.iter().filter(is_factor).peekable();
    factors.peek()?;
    let is_one = |a: &Attribute| {
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

/// The numbers of an attribute.
fn attribute_numbers(attribute: &Attribute) -> Option<Vec<f64>> {
    let encoding = encoding(&attribute.datatype)?;
    let stride = Stride {
        first: 0,
        step: encoding.scalar.size(),
        count: attribute.raw_data.len() / encoding.scalar.size(),
    };
    doubles(&attribute.raw_data, encoding, stride)
}

/// How the numbers of a datatype are written, where it is one of numbers.
fn encoding(datatype: &Datatype) -> Option<Encoding> {
    use ScalarType as S;
    let (scalar, order) = match datatype {
        Datatype::FixedPoint {
            size,
            signed,
            byte_order,
        } => {
            let scalar = match (size, signed) {
                (1, true) => S::I8,
                (1, false) => S::U8,
                (2, true) => S::I16,
                (2, false) => S::U16,
                (4, true) => S::I32,
                (4, false) => S::U32,
                (8, true) => S::I64,
                (8, false) => S::U64,
                _ => return None,
            };
            (scalar, byte_order)
        }
        Datatype::FloatingPoint { size, byte_order } => match size {
            4 => (S::F32, byte_order),
            8 => (S::F64, byte_order),
            _ => return None,
        },
        _ => return None,
    };
    Some(Encoding {
        scalar,
        big_endian: matches!(order, ByteOrder::BigEndian),
    })
}

/// What the decoder found wrong, as an error of this library.
fn broken(path: &Path, place: &str, error: &hdf5_reader::error::Error) -> Error {
    Error::format(
        path,
        shortened(place),
        "sound HDF5",
        error.to_string().chars().take(300).collect::<String>(),
        "copy the file again, or rewrite it (h5repack) without unusual filters",
    )
}

fn shortened(name: &str) -> String {
    name.chars().take(60).collect()
}
