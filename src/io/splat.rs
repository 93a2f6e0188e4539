//! .splat: 32 bytes per splat, no header, little-endian.
//!
//! | bytes | what |
//! |---|---|
//! | 0..12 | position, three f32 |
//! | 12..24 | standard deviations, three f32 |
//! | 24..28 | red, green, blue and peak opacity, 0 to 255 |
//! | 28..32 | quaternion w, x, y, z, each (byte - 128) / 128 |
//!
//! Colours do not depend on the view. Nothing in the format says whether splats are made for an
//! anti-aliasing filter; they are taken not to be.

use std::array;
use std::path::Path;

use glam::DVec3;

use super::dataset::Dataset;
use super::file::read_all;
use super::splats::{SplatCloud, constant_of_colour};
use crate::error::{Error, Result};

/// Bytes of a splat.
const RECORD: usize = 32;

/// Reads splats.
///
/// # Errors
/// A length that is not a whole number of splats.
pub(crate) fn read(path: &Path) -> Result<Dataset> {
    let bytes = read_all(path)?;
    if bytes.len() % RECORD != 0 {
        return Err(Error::format(
            path,
            "size",
            "a multiple of 32 bytes",
            format!("{} bytes", bytes.len()),
            "the file is cut off or is no .splat file: get it again",
        ));
    }
    let count = bytes.len() / RECORD;
    let mut cloud = SplatCloud {
        positions: Vec::with_capacity(count),
        scales: Vec::with_capacity(count),
        rotations: Vec::with_capacity(count),
        opacities: Vec::with_capacity(count),
        harmonics: Vec::with_capacity(3 * count),
        ..SplatCloud::default()
    };
    for record in bytes.chunks_exact(RECORD) {
        let float = |i: usize| {
            let at = 4 * i;
            f32::from_le_bytes(array::from_fn(|b| record[at + b]))
        };
        let [x, y, z] = array::from_fn(|i| f64::from(float(i)));
        cloud.positions.push(DVec3::new(x, y, z));
        cloud.scales.push(array::from_fn(|i| float(3 + i)));
        let code = |i: usize| f32::from(record[i]) / 255.0;
        cloud
            .harmonics
            .extend((24..27).map(|i| constant_of_colour(code(i))));
        cloud.opacities.push(code(27));
        cloud.rotations.push(array::from_fn(|i| {
            (f32::from(record[28 + i]) - 128.0) / 128.0
        }));
    }
    cloud.dataset(path, "splat records", Vec::new())
}
