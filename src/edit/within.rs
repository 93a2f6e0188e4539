//! Reads the part of a file in a box. If the file states where its particles lie, no more than that part is read.

use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use super::crop::{Whole, crop, crop_of};
use crate::data::dataset::{Dataset, Field, Geometry};
use crate::data::up::Up;
use crate::error::Result;
use crate::io::{CellRows, OpenOptions, RowFile, cell_rows, open};
use crate::scene::Values;

/// Greatest gap of rows between two runs that is read rather than skipped. Each separate run costs a search in the
/// file's tables.
const GAP: usize = 1 << 16;

/// Margin around the boxes of cells: fractions of their size and of their coordinates. Positions may be stored with
/// fewer digits than the boxes.
const SLACK: [f64; 2] = [1e-2, 1e-6];

/// Reads a file and crops it to a box: the result is [`crop`] of [`open`]. SWIFT's snapshots have a table of cells,
/// which states the bounds of the particles in each range of rows. From these, only cells that meet the box are read.
///
/// # Errors
/// The errors of [`open`] and of [`crop`].
pub fn open_within(
    path: &Path,
    options: &OpenOptions,
    lower: DVec3,
    upper: DVec3,
) -> Result<Dataset> {
    let is_sound = lower.is_finite() && upper.is_finite() && lower.cmplt(upper).all();
    let part = match is_sound {
        true => part_of(path, options, [lower, upper], GAP)?,
        false => None,
    };
    match part {
        Some((dataset, whole)) => crop_of(dataset, lower, upper, Some(whole)),
        None => crop(open(path, options)?, lower, upper),
    }
}

/// Reads the particles of the cells that meet a box, in the order of the file. Returns `None` if the whole file is to
/// be read.
///
/// - `gap`: greatest gap of rows between two runs that is read along with them.
fn part_of(
    path: &Path,
    options: &OpenOptions,
    [lower, upper]: [DVec3; 2],
    gap: usize,
) -> Result<Option<(Dataset, Whole)>> {
    let is_plain = options.read_as.is_none() && options.scales.is_none();
    let is_one = options.time_step.is_none() && path.is_file();
    if !(is_plain && is_one) {
        return Ok(None);
    }
    let Some(mut file) = RowFile::open(path, options.particle_type)? else {
        return Ok(None);
    };
    let cells = match file.is_one_snapshot() {
        true => cell_rows(path, options.particle_type)?,
        false => None,
    };
    let Some(cells) = cells.filter(|cells| !cells.is_empty()) else {
        return Ok(None);
    };
    let meets = |cell: &&CellRows| {
        let [of_box, of_place] = SLACK;
        let far = cell.lower.abs().max(cell.upper.abs());
        let around = (cell.upper - cell.lower) * of_box + far * of_place;
        (cell.lower - around).cmple(upper).all() && (cell.upper + around).cmpge(lower).all()
    };
    let corners = cells
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), cell| {
            (a.min(cell.lower), b.max(cell.upper))
        });
    let mut runs: Vec<Range<usize>> = Vec::new();
    for cell in cells.iter().filter(meets) {
        match runs.last_mut() {
            Some(last) if cell.rows.start - last.end <= gap => last.end = cell.rows.end,
            _ => runs.push(cell.rows.clone()),
        }
    }
    // If no cell meets the box, the caller reads the whole file, which gives the error. If most do, reading the whole
    // is faster.
    let read: usize = runs.iter().map(Range::len).sum();
    if read == 0 || read > file.count() / 2 {
        return Ok(None);
    }
    let mut all: Option<Dataset> = None;
    for run in runs {
        let own = file.read(run)?;
        let Some(all) = &mut all else {
            all = Some(own);
            continue;
        };
        if !append(all, own) {
            return Ok(None);
        }
    }
    let whole = Whole {
        up: Up::of_points(Some(corners)),
        bounds: Some(corners),
    };
    Ok(all.map(|all| (all, whole)))
}

/// Appends further rows; returns false if they have other columns.
fn append(all: &mut Dataset, own: Dataset) -> bool {
    let (Geometry::Points { positions }, Geometry::Points { positions: more }) =
        (&mut all.geometry, own.geometry)
    else {
        return false;
    };
    positions.extend(more);
    let is_alike =
        |(all, own): (&Field, &Field)| all.name == own.name && types_of(all).eq(types_of(own));
    if all.fields.len() != own.fields.len() || !all.fields.iter().zip(&own.fields).all(is_alike) {
        return false;
    }
    for (all, mut own) in all.fields.iter_mut().zip(own.fields) {
        let own = own.arrays_mut().iter_mut();
        for (all, own) in all.arrays_mut().iter_mut().zip(own) {
            all.append(std::mem::replace(own, Values::U8(Vec::new())));
        }
    }
    true
}

/// Returns the types of a field's components. Both floating-point precisions count as the same type.
fn types_of(field: &Field) -> impl Iterator<Item = &'static str> {
    field.arrays().iter().map(Values::kind_name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fixture(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("fixtures")
            .join(name)
    }

    fn count_of(dataset: &Dataset) -> usize {
        match &dataset.geometry {
            Geometry::Points { positions } => positions.len(),
            _ => 0,
        }
    }

    fn check(part: &Dataset, whole: &Dataset) {
        let (Geometry::Points { positions: a }, Geometry::Points { positions: b }) =
            (&part.geometry, &whole.geometry)
        else {
            panic!("particles are points");
        };
        assert_eq!(a, b);
        assert_eq!(part.fields.len(), whole.fields.len());
        for (a, b) in part.fields.iter().zip(&whole.fields) {
            assert_eq!(format!("{a:?}"), format!("{b:?}"));
        }
        let head = |d: &Dataset| {
            let of = (
                d.notes.clone(),
                d.particle_types.clone(),
                d.smoothing.clone(),
                d.up(),
            );
            format!("{of:?}")
        };
        assert_eq!(head(part), head(whole));
    }

    #[test]
    fn a_box_of_a_snapshot_is_read_alone() {
        let path = fixture("swift_cells.h5");
        let options = OpenOptions::default();
        let boxes = [
            [DVec3::splat(0.1), DVec3::splat(2.4)],
            // Some particles have drifted into this box from neighbouring cells.
            [DVec3::new(4.0, 1.0, 6.5), DVec3::new(6.1, 3.9, 9.0)],
            [DVec3::new(-9.0, 5.2, 5.2), DVec3::new(99.0, 6.8, 7.2)],
        ];
        for [lower, upper] in boxes {
            let whole = open(&path, &options).unwrap();
            let count = count_of(&whole);
            let whole = crop(whole, lower, upper).unwrap();
            check(&open_within(&path, &options, lower, upper).unwrap(), &whole);
            // With a gap of 0, each run is read alone.
            let part = part_of(&path, &options, [lower, upper], 0).unwrap();
            let (part, of_whole) = part.unwrap();
            let read = count_of(&part);
            assert!(read < count / 2, "{read} of {count}");
            check(
                &crop_of(part, lower, upper, Some(of_whole)).unwrap(),
                &whole,
            );
        }
        // Empty and invalid boxes give the same error as reading the whole file.
        for [lower, upper] in [[20.0, 30.0], [3.0, 2.0], [f64::NAN, 4.0]] {
            let [lower, upper] = [lower, upper].map(DVec3::splat);
            let part = open_within(&path, &options, lower, upper).unwrap_err();
            let whole = crop(open(&path, &options).unwrap(), lower, upper).unwrap_err();
            assert_eq!(part.to_string(), whole.to_string());
        }
        let [lower, upper] = [DVec3::ZERO, DVec3::splat(9.0)];
        let all = part_of(&path, &options, [lower, upper], 0).unwrap();
        assert!(all.is_none(), "most is read as the whole");
    }

    #[test]
    fn tables_that_contradict_themselves_are_not_believed() {
        for name in [
            "swift_cells_broken.h5",
            "swift.h5",
            "dark_matter.h5",
            "particles.csv",
        ] {
            let path = fixture(name);
            let options = OpenOptions::default();
            let whole = open(&path, &options).unwrap();
            let (lower, upper) = whole.bounds().unwrap();
            let upper = lower + 0.8 * (upper - lower);
            let part = part_of(&path, &options, [lower, upper], 0).unwrap();
            assert!(part.is_none(), "{name}");
            let whole = crop(whole, lower, upper).unwrap();
            check(&open_within(&path, &options, lower, upper).unwrap(), &whole);
        }
    }

    #[test]
    fn damaged_files_end_in_data_or_in_an_error() {
        let sound = std::fs::read(fixture("swift_cells.h5")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("damaged.h5");
        let (lower, upper) = (DVec3::splat(0.1), DVec3::splat(4.4));
        let mut state = 11_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as usize
        };
        let mut read = 0;
        for _ in 0..300 {
            let mut bytes = sound.clone();
            for _ in 0..1 + next() % 3 {
                let at = next() % bytes.len();
                bytes[at] = next().to_le_bytes()[0];
            }
            std::fs::write(&path, &bytes).unwrap();
            let found = open_within(&path, &OpenOptions::default(), lower, upper);
            read += usize::from(found.is_ok());
        }
        // Most of a file is packed columns, whose faults are detected, or plain numbers.
        assert!((1..300).contains(&read), "{read}");
    }
}
