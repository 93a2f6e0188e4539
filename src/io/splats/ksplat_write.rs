//! Writes KSPLAT, without packing: one section of mode 0. `ksplat.rs` describes the format.

use std::path::Path;

use super::encoded_splats::{
    Encoded, colour_bytes, note_cut, note_cut_colours, note_faint, note_mark_lost, opacity_byte,
    single_precision_quantum,
};
use super::ksplat::{HEADER, MAX_DEGREE, SECTION_HEADER};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::math::{harmonics_count, narrowed};

/// Encodes splats in the given order. Harmonics beyond degree 2 are lost.
///
/// # Errors
/// More splats than a file can count.
pub(in crate::io) fn encode(path: &Path, cloud: &SplatCloud) -> Result<Encoded> {
    let count = u32::try_from(cloud.positions.len()).map_err(|_| {
        let (expected, found) = (format!("at most {}", u32::MAX), cloud.positions.len());
        let advice = "split the scene";
        Error::format(path, "splats", expected, found.to_string(), advice)
    })?;
    let degree = cloud.harmonics_degree.min(MAX_DEGREE);
    let mut bytes = vec![0; HEADER + SECTION_HEADER];
    let mut put = |at: usize, word: u32| bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
    // Version 0.1; one section, and storage for one; the number of splats, and storage for them.
    for (at, word) in [(0, 1 << 8), (4, 1), (8, 1), (12, count), (16, count)] {
        put(at, word);
    }
    for (at, word) in [(0, count), (4, count), (40, u32::from(degree))] {
        put(HEADER + at, word);
    }
    let [mut cut_colours, mut faint] = [0; 2];
    for (i, position) in cloud.positions.iter().enumerate() {
        let rotation = cloud.unit_rotation(i).map(narrowed);
        let scales = cloud.thick_scales(i);
        let coefficients = cloud.coefficients(i);
        for x in position
            .as_vec3()
            .to_array()
            .into_iter()
            .chain(scales)
            .chain(rotation)
        {
            bytes.extend(x.to_le_bytes());
        }
        bytes.extend(colour_bytes(cloud, i, &mut cut_colours));
        bytes.push(opacity_byte(cloud, i, &mut faint));
        for degree in 1..=usize::from(degree) {
            // All coefficients of a degree for red, then for green, then for blue.
            let of_degree = &coefficients[3 * degree * degree..3 * (degree + 1).pow(2)];
            for channel in 0..3 {
                for c in of_degree.iter().skip(channel).step_by(3) {
                    bytes.extend(c.to_le_bytes());
                }
            }
        }
    }
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    let lost = harmonics_count(cloud.harmonics_degree) - harmonics_count(degree);
    let what = "harmonics of each colour channel are lost: the format ends at degree 2";
    note_cut(&mut notes, lost, what);
    note_cut_colours(&mut notes, cut_colours);
    note_faint(&mut notes, faint);
    Ok(Encoded {
        bytes,
        beside: Vec::new(),
        position_quantum: single_precision_quantum(cloud.positions.iter().copied()),
        order: Vec::new(),
        notes,
    })
}
