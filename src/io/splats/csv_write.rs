//! Writes splats as a table: a row for each, with the columns and the numbers of PLY in INRIA's layout.

use super::encoded_splats::{Encoded, note_mark_lost};
use crate::data::splats::SplatCloud;
use crate::io::ply::splats::{columns, row};

/// Returns a table of text, with commas between columns. Positions keep double precision, all else single.
pub(in crate::io) fn encode(cloud: &SplatCloud) -> Encoded {
    let places = ["x", "y", "z"].map(str::to_owned);
    let mut text = [places.to_vec(), columns(cloud, 3)].concat().join(",");
    for (i, position) in cloud.positions.iter().enumerate() {
        let mut words = position.to_array().map(|x| x.to_string()).to_vec();
        row(cloud, 3, i, |number| words.push(number.to_string()));
        text += "\n";
        text += &words.join(",");
    }
    text += "\n";
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    let farthest = cloud.positions.iter().map(|p| p.abs().max_element());
    let farthest = farthest.fold(f64::MIN_POSITIVE, f64::max);
    Encoded {
        bytes: text.into_bytes(),
        beside: Vec::new(),
        position_quantum: farthest.next_up() - farthest,
        order: Vec::new(),
        notes,
    }
}
