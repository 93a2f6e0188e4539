//! Picks particles from which a transfer function may be chosen.

use std::ops::Range;

use glam::DVec3;

use crate::scene::{PickedRow, Values};
use crate::scene::{PointVolume, Strength};

/// The picked rows, among `count`, that have a particle.
///
/// - `place`: returns the number of a row's particle, if it has one.
pub(in crate::sample) fn picked_rows(
    count: usize,
    place: impl Fn(usize) -> Option<usize>,
    volumes: &[f32],
    positions: &[DVec3],
    values: &Values,
) -> Vec<PickedRow> {
    let row = |row: usize| {
        let i = place(row)?;
        Some(PickedRow {
            row: row as u64,
            position: positions[i].to_array(),
            volume: volumes[i].into(),
            value: values.wide(i),
        })
    };
    PickedRow::picked(count)
        .into_iter()
        .filter_map(row)
        .collect()
}

/// The picked rows among some particles of a volume of kernels.
///
/// - `own`: the local particles.
/// - `first`: how many of all `count` particles precede them on other ranks.
pub(in crate::sample) fn picked_of(
    volume: &PointVolume,
    own: &Range<usize>,
    first: usize,
    count: usize,
) -> Vec<PickedRow> {
    let (Some(values), Strength::Classified { volumes }) = (&volume.values, &volume.strength)
    else {
        return Vec::new();
    };
    let place = |row: usize| {
        let i = row.checked_sub(first).filter(|&i| i < own.len())?;
        Some(own.start + i)
    };
    picked_rows(count, place, volumes, volume.particles.positions(), values)
}
