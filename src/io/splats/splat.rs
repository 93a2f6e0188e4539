//! Reads and writes .splat: 32 bytes per splat, no header, little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 0..12 | position, three f32 |
//! | 12..24 | standard deviations, three f32 |
//! | 24..28 | red, green, blue and peak opacity, 0 to 255 |
//! | 28..32 | quaternion w, x, y, z, each (byte - 128) / 128 |
//!
//! Colours do not depend on the view. The format does not mark splats made for an anti-aliasing filter; they
//! are taken not to be.

use std::array;

use glam::DVec3;

use super::encoded_splats::{
    Encoded, byte, colour_bytes, note_cut_colours, note_faint, note_harmonics_lost, note_mark_lost,
    opacity_byte, single_precision_quantum,
};
use crate::data::dataset::Dataset;
use crate::data::splats::{SplatCloud, constant_of_colour};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::scene::SplatRule;

/// Bytes of a splat.
const RECORD: usize = 32;

/// Reads splats.
///
/// # Errors
/// A length that is not a whole number of splats.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
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
        rule: SplatRule::Inria,
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

/// Encodes splats, the important ones first: by size times opacity, as the format's first tool orders them for
/// viewers that draw while they load.
pub(in crate::io) fn encode(cloud: &SplatCloud) -> Encoded {
    let importance = |i: usize| {
        let volume: f64 = cloud.thick_scales(i).map(f64::from).iter().product();
        volume * f64::from(cloud.opacities[i])
    };
    let mut order: Vec<(f64, usize)> = (0..cloud.positions.len())
        .map(|i| (importance(i), i))
        .collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));

    let mut bytes = Vec::with_capacity(RECORD * order.len());
    let [mut cut_colours, mut faint] = [0; 2];
    for &(_, i) in &order {
        let floats = cloud.positions[i].as_vec3().to_array();
        for value in floats.into_iter().chain(cloud.thick_scales(i)) {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(colour_bytes(cloud, i, &mut cut_colours));
        bytes.push(opacity_byte(cloud, i, &mut faint));
        // q and -q are one rotation. A byte reaches -1 but not 1, so the largest component is made negative.
        let q = cloud.unit_rotation(i);
        let largest = q
            .into_iter()
            .fold(0.0_f64, |m, c| if c.abs() > m.abs() { c } else { m });
        let sign = -largest.signum();
        bytes.extend(q.map(|c| byte(128.0 + 128.0 * sign * c, &mut 0)));
    }
    let mut notes = Vec::new();
    note_harmonics_lost(&mut notes, cloud);
    note_mark_lost(&mut notes, cloud);
    note_cut_colours(&mut notes, cut_colours);
    note_faint(&mut notes, faint);
    Encoded {
        bytes,
        beside: Vec::new(),
        position_quantum: single_precision_quantum(cloud.positions.iter().copied()),
        order: order.into_iter().map(|(_, i)| i).collect(),
        notes,
    }
}
