//! Reads DICOM: images from scanners, with a file for each slice of a series, or all slices as frames of one file.
//!
//! | bytes | contents |
//! |---|---|
//! | 0..128 | anything; some files lack all bytes before the data set |
//! | 128..132 | `DICM` |
//! | from there | elements of group 2, always explicit and little-endian; among them the transfer syntax ([`syntax`]) |
//! | then | the data set ([`data_set`]), whose last element is the pixels ([`pixels`], [`packed`]) |
//!
//! A file represents all files in its folder that state its series ([`series`]). [`geometry`] computes positions. They
//! are those of the patient as the file states them (+x left, +y to the back, +z up), without any rotation. Numbers are
//! scaled by `RescaleSlope` and shifted by `RescaleIntercept` ([`scale`]).
//!
//! <https://www.dicomstandard.org/current>: parts 3 (attributes of images), 5 (data structures) and 10 (files).

mod data_set;
mod geometry;
mod groups;
mod image;
mod packed;
mod pixels;
mod scale;
mod series;
mod syntax;
mod tags;

use std::path::{Path, PathBuf};

use self::geometry::Placed;
use self::image::{Budget, Image, Slice};
use super::voxels;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::scene::Values;

pub(in crate::io) use self::image::{looks_bare, looks_like};

/// Returns a file of the largest series in a folder, if there is a series.
pub(in crate::io) fn series_in(folder: &Path) -> Option<PathBuf> {
    series::largest_in(folder)
}

/// Reads the series that a file belongs to.
///
/// # Errors
/// A file contains no image or breaks the format's rules, or the compression of its pixels is not supported.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let series = series::of(input)?;
    let mut notes: Vec<String> = series.note.into_iter().collect();
    let mut budget = Budget::new();
    let mut slices: Vec<Slice> = Vec::new();
    let mut unit = None;
    let mut without_pixels = 0;
    for (number, file) in series.files.iter().enumerate() {
        // The given file may be bytes in memory.
        let is_given = file.file_name() == path.file_name();
        let bytes = match is_given {
            true => input.read_all()?,
            false => input.read_beside(file)?.into(),
        };
        match image::read(file, &bytes, number, &mut budget)? {
            Some(image) => {
                let Image {
                    slices: more,
                    unit: own,
                    notes: own_notes,
                } = image;
                slices.extend(more);
                unit = unit.or(own);
                for note in own_notes {
                    if !notes.contains(&note) {
                        notes.push(note);
                    }
                }
            }
            None if is_given => return Err(image::no_image(path, &bytes)),
            None => without_pixels += 1,
        }
    }
    if without_pixels > 0 {
        notes.push(format!(
            "{without_pixels} files of the series hold no image."
        ));
    }
    let bytes_read = slices.iter().map(bytes_of).sum();
    let Placed {
        slices,
        geometry,
        notes: more,
    } = geometry::place(path, slices, bytes_read)?;
    notes.extend(more);
    let components = put_together(path, slices)?;
    let name = match components.len() {
        3 => "rgb",
        _ => "value",
    };
    let field = voxels::field(name, components, unit);
    if let Geometry::Lattice(lattice) = &geometry {
        lattice.validate().map_err(|e| e.in_file(path))?;
    }
    Ok(Dataset {
        notes,
        ..Dataset::new(path, "DICOM series", geometry, vec![field])
    })
}

fn bytes_of(slice: &Slice) -> usize {
    let of = |values: &Values| values.len() * values.bytes_per_value();
    slice.components.iter().map(of).sum()
}

/// Concatenates the numbers of all slices. They keep their type, or become floats if slices have several types.
fn put_together(path: &Path, slices: Vec<Slice>) -> Result<Vec<Values>> {
    let kinds = |slice: &Slice| -> Vec<_> {
        let values = slice.components.iter();
        values.map(std::mem::discriminant).collect()
    };
    let first = slices.first().map(kinds);
    let is_one_kind = slices.iter().all(|slice| Some(kinds(slice)) == first);
    let count: usize = slices
        .iter()
        .filter_map(|slice| slice.components.first())
        .map(Values::len)
        .sum();
    let mut all: Vec<Option<Values>> = vec![None; first.map_or(0, |kinds| kinds.len())];
    for slice in slices {
        for (all, values) in all.iter_mut().zip(slice.components) {
            let values = match is_one_kind {
                true => values,
                false => {
                    let floats: Vec<f64> = (0..values.len()).map(|i| values.wide(i)).collect();
                    floats.into()
                }
            };
            if all.is_none() {
                *all = Some(with_room(path, &values, count)?);
            }
            voxels::append(all, values);
        }
    }
    Ok(all.into_iter().flatten().collect())
}

/// Returns an empty array of the same type, with capacity for `count` values.
fn with_room(path: &Path, like: &Values, count: usize) -> Result<Values> {
    fn room<T>(count: usize) -> Option<Vec<T>> {
        let mut values = Vec::new();
        crate::memory::trying(|| values.try_reserve_exact(count)).ok()?;
        Some(values)
    }
    let empty = match like {
        Values::U8(_) => room(count).map(Values::U8),
        Values::I16(_) => room(count).map(Values::I16),
        Values::U16(_) => room(count).map(Values::U16),
        Values::F32(_) => room(count).map(Values::F32),
        Values::F64(_) => room(count).map(Values::F64),
    };
    empty.ok_or_else(|| {
        let expected = "a series that fits into memory";
        let advice = "use a machine with more memory";
        Error::format(path, "pixels", expected, format!("{count} numbers"), advice)
    })
}
