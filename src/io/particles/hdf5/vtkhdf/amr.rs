//! Reads adaptive mesh refinement: `Level0`, `Level1`, ..., each with boxes of cells.
//!
//! | member of a level | contents |
//! |---|---|
//! | attribute `Spacing` | distance between nodes |
//! | `AMRBox`, (boxes, 6) | first and last cell of each box along each axis, i0 i1 j0 j1 k0 k1; along the missing axis of two-dimensional data, the last precedes the first |
//! | `PointData`, `CellData` | numbers of one box after those of another |
//!
//! The root's attribute `Origin` is the corner of cell 0. At a time step, `NumberOfAMRBox` boxes from `AMRBoxOffset` on
//! are valid. Both arrays are in `Steps/LevelN`, with `PointDataOffset` and `CellDataOffset`.

use std::path::Path;

use glam::DVec3;
use hdf5_reader::group::Group;

use super::{Block, numbers};
use crate::data::association::Association;
use crate::data::dataset::Dataset;
use crate::error::Result;
use crate::io::grid::amr::{self, Level, Patch};
use crate::io::vtk::array::Array;
use crate::io::vtk::pieces::element_of;

/// Greatest number of levels, far more than any code writes.
const MOST_LEVELS: usize = 64;

/// Levels with their boxes.
pub(super) struct Amr {
    levels: Vec<Level>,
    patches: Vec<Patch>,
}

impl Amr {
    /// Returns true if a collection whose first block is of this kind is read as AMR.
    pub(super) fn is_first(&self, kind: &str) -> bool {
        kind == "levels of refinement"
    }

    pub(super) fn dataset(self, path: &Path) -> Result<Dataset> {
        amr::dataset(
            path,
            "VTKHDF levels of refinement",
            self.levels,
            self.patches,
        )
    }
}

impl Block<'_, '_> {
    pub(super) fn amr(&self) -> Result<Amr> {
        let origin = numbers(self, &self.group, "Origin")?.unwrap_or([0.0; 3]);
        let mut found = Amr {
            levels: Vec::new(),
            patches: Vec::new(),
        };
        for level in 0..MOST_LEVELS {
            let name = format!("Level{level}");
            let Some(group) = self.file.child(&self.group, &name)? else {
                break;
            };
            let spacing = numbers(self, &group, "Spacing")?.ok_or_else(|| {
                let place = format!("{name}, attribute `Spacing`");
                self.fault(&place, "three numbers", "none".into())
            })?;
            found.levels.push(Level {
                origin: DVec3::from_array(origin),
                spacing: DVec3::from_array(spacing),
            });
            let steps = match &self.steps {
                Some(steps) => self.file.child(steps, &name)?,
                None => None,
            };
            self.patches(level, &group, steps.as_ref(), &mut found.patches)?;
        }
        Ok(found)
    }

    /// Reads the boxes of a level.
    fn patches(
        &self,
        level: usize,
        group: &Group,
        steps: Option<&Group>,
        patches: &mut Vec<Patch>,
    ) -> Result<()> {
        let rows = match steps {
            None => None,
            Some(steps) => {
                let first = self.start_in(steps, "AMRBoxOffset", 0)?.unwrap_or(0);
                let count = self.start_in(steps, "NumberOfAMRBox", 0)?;
                count.map(|count| first..first.saturating_add(count))
            }
        };
        if rows.as_ref().is_some_and(std::ops::Range::is_empty) {
            return Ok(());
        }
        let boxes = self.needed(group, "AMRBox", rows)?;
        if boxes.components != 6 {
            let found = format!("{} of them", boxes.components);
            return Err(self.fault("AMRBox", "six numbers for each box", found));
        }
        let ends = self.whole_numbers("AMRBox", &boxes, |n| i32::try_from(n).ok())?;
        let first = patches.len();
        for ends in ends.as_chunks::<6>().0 {
            let [i0, i1, j0, j1, k0, k1] = ends.map(i64::from);
            let along = |first: i64, last: i64| usize::try_from(last - first + 1).ok();
            let cells = (|| Some([along(i0, i1)?, along(j0, j1)?, along(k0, k1)?]))();
            let flat = cells.is_none_or(|c| c.iter().filter(|n| **n == 0).count() > 1);
            let Some(cells) = cells.filter(|_| !flat) else {
                let expected = "last cells that are not before the first ones";
                return Err(self.fault("AMRBox", expected, format!("{ends:?}")));
            };
            patches.push(Patch {
                level,
                first: [i0, j0, k0],
                cells,
                node_arrays: Vec::new(),
                cell_arrays: Vec::new(),
            });
        }
        for association in Association::BOTH {
            self.fill(group, steps, association, &mut patches[first..])?;
        }
        Ok(())
    }

    /// Reads the arrays of the boxes of a level.
    fn fill(
        &self,
        group: &Group,
        steps: Option<&Group>,
        association: Association,
        patches: &mut [Patch],
    ) -> Result<()> {
        let Some(data) = self.file.child(group, element_of(association))? else {
            return Ok(());
        };
        let offsets = match steps {
            Some(steps) => {
                let name = format!("{}Offset", element_of(association));
                self.file.child(steps, &name)?
            }
            None => None,
        };
        let counts = patches.iter().map(|p| Patch::count(p.cells, association));
        let counts: Vec<usize> = counts.map(|n| n.unwrap_or(usize::MAX)).collect();
        let total = counts.iter().fold(0_usize, |sum, n| sum.saturating_add(*n));
        for name in self.file.names(&data)? {
            let start = match &offsets {
                Some(offsets) => self.start_in(offsets, &name, 0)?.unwrap_or(0),
                None => 0,
            };
            let rows = start..start.saturating_add(total);
            let Some(array) = self.array(&data, &name, 1, Some(rows))? else {
                continue;
            };
            let mut begin = 0;
            for (patch, count) in patches.iter_mut().zip(&counts) {
                let range = begin..begin + count;
                begin += count;
                let part = |values| crate::scene::Values::part(values, range.clone());
                let part = Array {
                    name: array.name.clone(),
                    components: array.components.iter().map(part).collect(),
                };
                match association {
                    Association::Nodes => patch.node_arrays.push(part),
                    Association::Cells => patch.cell_arrays.push(part),
                }
            }
        }
        Ok(())
    }
}
