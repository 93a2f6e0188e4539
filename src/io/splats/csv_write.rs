//! Writes splats as a table: a row for each, with the columns and the numbers of PLY in INRIA's layout.

use super::encoded_splats::{Encoded, note_mark_lost};
use crate::data::splats::SplatCloud;
use crate::io::ply::splats::{columns, row};

/// Returns a table of text, with commas between columns. Positions keep double precision, all else single.
pub(in crate::io) fn encode(cloud: &SplatCloud) -> Encoded {
    let mut text = ["x", "y", "z"].join(",");
    for name in columns(cloud, 3) {
        text += ",";
        text += &name;
    }
    text += "\n";
    let mut bytes = text.into_bytes();
    for (i, position) in cloud.positions.iter().enumerate() {
        let places = position.to_array().map(|x| x.to_string());
        let mut words = places.to_vec();
        row(cloud, 3, i, |number| words.push(number.to_string()));
        bytes.extend(words.join(",").into_bytes());
        bytes.push(b'\n');
    }
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    let farthest = cloud.positions.iter().map(|p| p.abs().max_element());
    let farthest = farthest.fold(f64::MIN_POSITIVE, f64::max);
    Encoded {
        bytes,
        position_quantum: farthest.next_up() - farthest,
        order: Vec::new(),
        notes,
    }
}
