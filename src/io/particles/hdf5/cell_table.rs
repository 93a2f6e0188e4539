//! Reads SWIFT's table of cells, which states the rows and the bounds of the particles of each cell.
//!
//! ```text
//! Cells/Counts/PartType0         particles of each cell
//! Cells/OffsetsInFile/PartType0  the first row of each (`Offsets` of older files)
//! Cells/MinPositions/PartType0   the least and the greatest coordinates of its particles, wherever they have
//! Cells/MaxPositions/PartType0   drifted to since they were sorted into cells
//! ```

use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use super::super::types::choose;
use super::file::{Array, SnapshotFile, whole};
use super::gadget;
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::error::Result;
use crate::io::bytes::file::Input;

/// Rows of a cell's particles, at least one, and their bounding box.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CellRows {
    pub(crate) rows: Range<usize>,
    pub(crate) lower: DVec3,
    pub(crate) upper: DVec3,
}

/// Returns the cells of the particles to read from a file, in the order of their rows. Returns `None` if the file does
/// not place all particles in cells, or contradicts itself.
///
/// # Errors
/// The file is damaged, or has no such particles.
pub(crate) fn cell_rows(
    path: &Path,
    wanted: Option<ParticleType>,
) -> Result<Option<Vec<CellRows>>> {
    let file = SnapshotFile::open(Input::of_file(path))?;
    let Some(cells) = file.group("Cells")? else {
        return Ok(None);
    };
    let present = gadget::present(&file)?;
    let mut counts: Vec<ParticleCount> = present.iter().map(|(.., c)| c.clone()).collect();
    let numbers: Vec<usize> = present.iter().map(|(kind, ..)| *kind).collect();
    if counts.is_empty() {
        return Ok(None);
    }
    let (at, _) = choose(path, &mut counts, &numbers, wanted)?;
    let (name, _) = gadget::TYPES[numbers[at]];
    let array = |group: &str, components: usize| -> Result<Option<Array>> {
        let Some(group) = file.child(&cells, group)? else {
            return Ok(None);
        };
        if !file.has(&group, name)? {
            return Ok(None);
        }
        let array = file.array(&group, name)?;
        Ok(array.filter(|array| array.components == components))
    };
    let offsets = match array("OffsetsInFile", 1)? {
        None => array("Offsets", 1)?,
        offsets => offsets,
    };
    let found = (
        array("Counts", 1)?,
        offsets,
        array("MinPositions", 3)?,
        array("MaxPositions", 3)?,
    );
    let (Some(lengths), Some(offsets), Some(least), Some(greatest)) = found else {
        return Ok(None);
    };
    Ok(table(
        &lengths,
        &offsets,
        [&least, &greatest],
        counts[at].count,
    ))
}

/// - `count`: total number of particles.
fn table(
    lengths: &Array,
    offsets: &Array,
    corners: [&Array; 2],
    count: usize,
) -> Option<Vec<CellRows>> {
    let (lengths, offsets) = (lengths.doubles(0)?, offsets.doubles(0)?);
    let corner = |array: &Array| -> Option<Vec<DVec3>> {
        let [x, y, z] = [array.doubles(0)?, array.doubles(1)?, array.doubles(2)?];
        let each = x.into_iter().zip(y).zip(z);
        Some(each.map(|((x, y), z)| DVec3::new(x, y, z)).collect())
    };
    let [lower, upper] = [corner(corners[0])?, corner(corners[1])?];
    let all = [offsets.len(), lower.len(), upper.len()];
    if all.iter().any(|len| *len != lengths.len()) {
        return None;
    }
    let mut cells = Vec::new();
    for (i, (length, offset)) in lengths.into_iter().zip(offsets).enumerate() {
        let (length, first) = (whole(length)?, whole(offset)?);
        if length > 0 {
            let (lower, upper) = (lower[i], upper[i]);
            let is_box = lower.is_finite() && upper.is_finite() && lower.cmple(upper).all();
            cells.push(CellRows {
                rows: first..first.checked_add(length).filter(|_| is_box)?,
                lower,
                upper,
            });
        }
    }
    cells.sort_unstable_by_key(|cell| cell.rows.start);
    // Each particle must be in exactly one cell.
    let mut next = 0;
    for cell in &cells {
        if cell.rows.start != next {
            return None;
        }
        next = cell.rows.end;
    }
    (next == count).then_some(cells)
}
