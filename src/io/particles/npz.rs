//! Reads NumPy archives: ZIP files of NPY arrays, as written by `numpy.savez` and `savez_compressed`.
//!
//! A table is one array, as in an NPY file. Or it has an array of positions of shape (N, 3), or (N, 2) in a
//! plane, named `positions`, `pos`, `xyz`, `coordinates` or `points`. Or it has one-dimensional arrays `x`, `y`
//! and `z`. Other arrays become fields if they have N rows.

use std::path::Path;

use glam::DVec3;

use super::npy::{self, Array};
use super::table::{PositionColumns, dataset, position_columns};
use crate::data::dataset::{Dataset, Field};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::file::extension;
use crate::io::bytes::scalars::{doubles, values};
use crate::io::bytes::zip;
use crate::io::volume::raw::DEFLATE_RATIO;

const FORMAT: &str = "NPZ particle table";

const POSITIONS: [&str; 5] = ["positions", "pos", "xyz", "coordinates", "points"];

/// Greatest number of an array's columns in a field.
const MOST_COMPONENTS: usize = 16;

/// Reads a particle table.
///
/// # Errors
/// A broken archive, one that claims more than its bytes can hold, or no positions.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let members = members(input)?;
    if let [(_, only)] = members.as_slice() {
        return npy::table(path, FORMAT, only);
    }
    let mut arrays = Vec::with_capacity(members.len());
    for (name, bytes) in &members {
        arrays.push((name.as_str(), npy::parse(path, bytes)?));
    }

    let is_positions = |name: &str| POSITIONS.iter().any(|p| name.eq_ignore_ascii_case(p));
    let of_columns = |columns: usize| {
        let mut arrays = arrays.iter();
        arrays.position(|(name, array)| is_positions(name) && array.columns() == Some(columns))
    };
    // Two columns are positions in a plane.
    let whole = of_columns(3).map(|i| (i, 2));
    let whole = whole.or_else(|| of_columns(2).map(|i| (i, 0)));
    let flat;
    let (positions, taken) = match whole {
        Some((index, column_of_z)) => {
            let (name, array) = &arrays[index];
            let axes = [axis(path, name, array, 0)?, axis(path, name, array, 1)?];
            let z = axis(path, name, array, column_of_z)?;
            let mut positions = zipped(axes, &z);
            let xyz = PositionColumns {
                x: 0,
                y: 1,
                z: (column_of_z == 2).then_some(2),
            };
            flat = xyz.flatten(&mut positions);
            (positions, vec![index])
        }
        None => {
            let xyz = position_columns(path, arrays.iter().map(|(name, _)| *name))?;
            let of = |column: usize| {
                let (name, array) = &arrays[column];
                axis(path, name, array, 0)
            };
            let [x, y, z] = xyz.axes();
            let (x, y, z) = (of(x)?, of(y)?, of(z)?);
            if x.len() != y.len() || x.len() != z.len() {
                return Err(Error::format(
                    path,
                    "arrays x, y and z",
                    "equally many numbers",
                    format!("{}, {} and {}", x.len(), y.len(), z.len()),
                    "save the archive again",
                ));
            }
            let mut positions = zipped([x, y], &z);
            flat = xyz.flatten(&mut positions);
            (positions, xyz.axes().to_vec())
        }
    };

    let count = positions.len();
    let mut fields: Vec<Field> = Vec::new();
    let mut left_out = Vec::new();
    for (i, (name, array)) in arrays.iter().enumerate() {
        if taken.contains(&i) {
            continue;
        }
        match components(array, count) {
            Some(components) => fields.push(npy::field((*name).to_owned(), components)),
            None => left_out.push(*name),
        }
    }
    let mut data = dataset(path, FORMAT, positions, fields)?;
    data.notes.extend(flat);
    if !left_out.is_empty() {
        let shown: Vec<String> = left_out
            .iter()
            .take(8)
            .map(|name| format!("`{}`", name.chars().take(40).collect::<String>()))
            .collect();
        data.notes.push(format!(
            "{} arrays do not hold numbers for each of the {count} particles and are left out: \
             {}.",
            left_out.len(),
            shown.join(", ")
        ));
    }
    Ok(data)
}

/// The arrays of an archive: their names without `.npy`, and their bytes.
fn members(input: Input<'_>) -> Result<Vec<(String, Vec<u8>)>> {
    let path = input.path;
    let bytes = input.read_all()?;
    let len = bytes.len() as u64;
    let broken = |found: String| {
        // A file with another extension may be any archive that is read.
        let (expected, advice) = match extension(path).as_str() {
            "npz" => (
                "a sound NPZ archive of arrays",
                "save it again with numpy.savez",
            ),
            _ => (
                "a sound archive of one of the formats that are ZIP archives: NPZ, SOG, 3MF, OpenFOAM cases",
                "check that the file is whole, and name it .npz, .sog, .3mf or .foam.zip as what it is",
            ),
        };
        Error::format(path, "ZIP archive", expected, found, advice)
    };
    let mut packed_total: u64 = 0;
    let mut members = Vec::new();
    for entry in zip::entries(&bytes).map_err(broken)? {
        let Some(name) = entry.name.strip_suffix(".npy") else {
            continue;
        };
        let shown: String = name.chars().take(40).collect();
        // Members that share their bytes would multiply them.
        let packed = entry.packed.len() as u64;
        packed_total = packed_total.saturating_add(packed);
        let size = entry.size;
        if packed_total > len || size > packed.saturating_mul(DEFLATE_RATIO) {
            return Err(broken(format!(
                "`{shown}` with {size} bytes packed into {packed}"
            )));
        }
        let unpacked = entry
            .unpack()
            .map_err(|e| broken(format!("`{shown}`: {e}")))?;
        members.push((name.to_owned(), unpacked));
    }
    if members.is_empty() {
        return Err(broken("no arrays (.npy) in it".to_owned()));
    }
    Ok(members)
}

/// One column of an array of numbers in double precision.
fn axis(path: &Path, name: &str, array: &Array<'_>, column: usize) -> Result<Vec<f64>> {
    let encoding = array.plain_encoding(path)?;
    array
        .column(column, encoding)
        .and_then(|stride| doubles(array.data, encoding, stride))
        .ok_or_else(|| {
            Error::format(
                path,
                format!("array `{}`", name.chars().take(40).collect::<String>()),
                "shape (N, 3), or (N,) for x, y and z",
                format!("shape {:?}", array.shape),
                "save the archive again",
            )
        })
}

/// The columns of an array of `count` rows; `None` if it has no numbers, or another number of rows.
fn components(array: &Array<'_>, count: usize) -> Option<Vec<crate::scene::Values>> {
    let encoding = array.encoding()?;
    let columns = array
        .columns()
        .filter(|n| (1..=MOST_COMPONENTS).contains(n))?;
    if array.shape.first() != Some(&count) {
        return None;
    }
    (0..columns)
        .map(|c| values(array.data, encoding, array.column(c, encoding)?))
        .collect()
}

fn zipped([x, y]: [Vec<f64>; 2], z: &[f64]) -> Vec<DVec3> {
    npy::zip_positions(x, &y, z)
}
