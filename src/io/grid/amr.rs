//! Converts adaptive mesh refinement (AMR) data, boxes of several levels, to one data set. The readers of AMR formats
//! share it.
//!
//! Each level is a lattice with its own spacing; each box holds a part of its level. A cell is covered if a finer box
//! contains its centre. If boxes of one level overlap, the cell belongs to the first. Covered and duplicate cells are
//! marked in a cell field `vtkGhostType`, as VTK marks them. A box without valid cells is left out.
//!
//! Boxes become separate curvilinear grids. Kernels lie at cell centres and are as wide as their level's cells. Boxes
//! of one level join without a seam. Two-dimensional data become a layer as thick as the shorter step of the coarsest
//! level.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;

use crate::data::association::Association;
use crate::data::blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::vtk::array::Array;
use crate::io::vtk::meshes::append_arrays;
use crate::io::vtk::pieces::{element_of, keep_common, to_fields};
use crate::scene::Values;

/// VTK's mark for cells that finer ones replace.
const REFINED: u8 = blanking::REFINED_CELL;
/// VTK's mark for cells that another box owns.
const DUPLICATE: u8 = 1;

/// Least budget for comparing boxes and marking cells; it bounds the work that a damaged file can cause.
const LEAST_WORK: usize = 1 << 24;

/// Lattice of a level.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct Level {
    /// Lower corner of cell (0, 0, 0).
    pub(in crate::io) origin: DVec3,
    pub(in crate::io) spacing: DVec3,
}

/// Box: a part of a level's lattice.
#[derive(Debug)]
pub(in crate::io) struct Patch {
    pub(in crate::io) level: usize,
    /// Index of the box's first cell.
    pub(in crate::io) first: [i64; 3],
    /// Cells along each axis; 0 along the missing axis of two-dimensional data.
    pub(in crate::io) cells: [usize; 3],
    pub(in crate::io) node_arrays: Vec<Array>,
    pub(in crate::io) cell_arrays: Vec<Array>,
}

impl Patch {
    /// Returns the number of nodes or cells; `None` if it overflows.
    pub(in crate::io) fn count(cells: [usize; 3], association: Association) -> Option<usize> {
        let [x, y, z] = match association {
            Association::Nodes => [0, 1, 2].map(|axis| cells[axis].checked_add(1)),
            Association::Cells => cells.map(|n| Some(n.max(1))),
        };
        x?.checked_mul(y?)?.checked_mul(z?)
    }
}

/// Returns the boxes of all levels as one data set.
///
/// - `levels`: coarsest first.
///
/// # Errors
/// A spacing is not positive and finite or is wider than that of the level before; a box has no array; boxes overlap
/// too often for their sizes.
pub(in crate::io) fn dataset(
    path: &Path,
    format: &'static str,
    mut levels: Vec<Level>,
    mut patches: Vec<Patch>,
) -> Result<Dataset> {
    let level_count = levels.len();
    thicken(&mut levels, &mut patches);
    check(path, &levels, &patches)?;
    let has_arrays = |patch: &Patch, association| match association {
        Association::Nodes => !patch.node_arrays.is_empty(),
        Association::Cells => !patch.cell_arrays.is_empty(),
    };
    let box_count = patches.len();
    let mut marks = marks(path, &levels, &patches)?;
    let covered = |bit: u8| {
        let all = marks.iter().flatten();
        all.filter(|mark| **mark & bit != 0).count()
    };
    let (refined, doubled) = (covered(REFINED), covered(DUPLICATE));
    // Boxes without a valid cell draw nothing.
    let is_left: Vec<bool> = marks.iter().map(|m| m.contains(&0)).collect();
    let mut kept = is_left.iter();
    patches.retain(|_| kept.next() == Some(&true));
    let mut kept = is_left.iter();
    marks.retain(|_| kept.next() == Some(&true));

    let mut notes = vec![format!(
        "Levels of refinement: {level_count}; boxes: {box_count}; cells that lie under finer ones, left out: {refined}."
    )];
    if doubled > 0 {
        notes.push(format!(
            "Cells in several boxes of one level, drawn once: {doubled}."
        ));
    }
    let mut fields = Vec::new();
    for association in Association::BOTH {
        if !patches.iter().any(|patch| has_arrays(patch, association)) {
            continue;
        }
        let arrays = patches.iter_mut().map(|patch| match association {
            Association::Nodes => std::mem::take(&mut patch.node_arrays),
            Association::Cells => std::mem::take(&mut patch.cell_arrays),
        });
        let mut arrays: Vec<Vec<Array>> = arrays.collect();
        if association == Association::Cells {
            for (arrays, marks) in arrays.iter_mut().zip(&mut marks) {
                join_ghosts(arrays, marks);
            }
        }
        keep_common(&mut arrays, element_of(association), &mut notes);
        let arrays = arrays.into_iter().reduce(append_arrays).unwrap_or_default();
        fields.extend(to_fields(arrays, association));
    }
    if refined + doubled > 0 || marks.iter().flatten().any(|mark| *mark != 0) {
        let array = Array {
            name: blanking::GHOST_TYPE.to_owned(),
            components: vec![Values::U8(marks.concat())],
        };
        fields.extend(to_fields(vec![array], Association::Cells));
    }
    let blocks = patches.iter().map(|patch| block(&levels, patch)).collect();
    Ok(Dataset {
        notes,
        ..Dataset::new(path, format, Geometry::Curvilinear { blocks }, fields)
    })
}

/// Merges the ghost array of a box into its marks and removes the array.
fn join_ghosts(arrays: &mut Vec<Array>, marks: &mut [u8]) {
    arrays.retain(|array| {
        let is_ghosts = array.name.eq_ignore_ascii_case(blanking::GHOST_TYPE);
        if let (true, [Values::U8(own)]) = (is_ghosts, array.components.as_slice()) {
            for (mark, own) in marks.iter_mut().zip(own) {
                *mark |= own;
            }
        }
        !is_ghosts
    });
}

/// Returns the nodes of a box.
fn block(levels: &[Level], patch: &Patch) -> CurvilinearBlock {
    let Level { origin, spacing } = levels[patch.level];
    let dims = patch.cells.map(|n| n + 1);
    let mut nodes = Vec::with_capacity(dims.iter().product());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let [i, j, k] = [i, j, k].map(|n| n as f64);
                let first = DVec3::from(patch.first.map(|n| n as f64));
                nodes.push(origin + spacing * (first + DVec3::new(i, j, k)));
            }
        }
    }
    CurvilinearBlock { dims, nodes }
}

/// Extrudes two-dimensional data to a layer of one cell, equally thick on all levels.
fn thicken(levels: &mut [Level], patches: &mut [Patch]) {
    for axis in 0..3 {
        if patches.iter().any(|patch| patch.cells[axis] > 0) {
            continue;
        }
        let Some(coarsest) = levels.first().copied() else {
            return;
        };
        let others = [(axis + 1) % 3, (axis + 2) % 3].map(|a| coarsest.spacing[a].abs());
        let thickness = others[0].min(others[1]);
        for level in levels.iter_mut() {
            level.origin[axis] = coarsest.origin[axis];
            level.spacing[axis] = thickness;
        }
        for patch in patches.iter_mut() {
            (patch.first[axis], patch.cells[axis]) = (0, 1);
            // Both planes of nodes of the layer have the same values.
            for array in &mut patch.node_arrays {
                let components = std::mem::take(&mut array.components);
                array.components = components
                    .into_iter()
                    .map(|c| doubled(&c, &patch.cells, axis))
                    .collect();
            }
        }
    }
}

/// Returns the values of a plane of nodes twice, for the two planes of the layer.
fn doubled(values: &Values, cells: &[usize; 3], axis: usize) -> Values {
    let dims = cells.map(|n| n + 1);
    let run: usize = dims[..axis].iter().product();
    let count: usize = dims.iter().product();
    let place = |n: usize| n / (2 * run) * run + n % run;
    let order: Vec<u32> = (0..count)
        .map(|n| u32::try_from(place(n)).unwrap_or(u32::MAX))
        .filter(|n| (*n as usize) < values.len())
        .collect();
    values.gather(&order)
}

fn check(path: &Path, levels: &[Level], patches: &[Patch]) -> Result<()> {
    let error = |place: String, expected: &str, found: String| {
        let advice = "the file is damaged: save it again";
        Err(Error::format(path, place, expected, found, advice))
    };
    for (i, level) in levels.iter().enumerate() {
        let is_sound = level.origin.is_finite()
            && level.spacing.is_finite()
            && level.spacing.cmpgt(DVec3::ZERO).all();
        if !is_sound {
            let found = format!("{} from {}", level.spacing, level.origin);
            return error(format!("level {i}"), "a spacing and an origin", found);
        }
        // The factor allows for rounding.
        let is_finer = |coarse: &Level| level.spacing.cmple(coarse.spacing * 1.001).all();
        if !levels[..i].last().is_none_or(is_finer) {
            let found = format!("{} after {}", level.spacing, levels[i - 1].spacing);
            return error(format!("level {i}"), "a spacing that is no wider", found);
        }
    }
    if patches.is_empty() {
        return error("boxes".into(), "at least one", "none".into());
    }
    for (i, patch) in patches.iter().enumerate() {
        let place = || format!("box {i} of all");
        if patch.level >= levels.len() || patch.cells.contains(&0) {
            let found = format!("level {}, cells {:?}", patch.level, patch.cells);
            return error(place(), "a box of a level", found);
        }
        // This check ensures that numbers in the file back each cell.
        if patch.node_arrays.is_empty() && patch.cell_arrays.is_empty() {
            return error(place(), "an array of numbers", "none".into());
        }
        let most = 1_i64 << 40;
        if patch.first.iter().any(|n| n.abs() > most) {
            return error(place(), "indices of cells", format!("{:?}", patch.first));
        }
    }
    Ok(())
}

/// Returns a mark for each cell of each box; 0 means that the cell is valid.
fn marks(path: &Path, levels: &[Level], patches: &[Patch]) -> Result<Vec<Vec<u8>>> {
    let counts = patches.iter().map(|p| p.cells.iter().product());
    let mut marks: Vec<Vec<u8>> = counts.map(|count| vec![0; count]).collect();
    let cell_count: usize = marks.iter().map(Vec::len).sum();
    let mut left = LEAST_WORK + 64 * cell_count;
    for (l, level) in levels.iter().enumerate() {
        let Some(bins) = Bins::new(patches, l) else {
            continue;
        };
        for (i, patch) in patches.iter().enumerate() {
            let (bit, range) = match patch.level {
                finer if finer > l => (REFINED, covered(level, &levels[finer], patch)),
                same if same == l => (DUPLICATE, range_of(patch)),
                _ => continue,
            };
            for other in bins.near(range, patches.len()) {
                left = left.saturating_sub(1);
                if bit == DUPLICATE && other <= i {
                    continue;
                }
                let shared = common(range_of(&patches[other]), range);
                left = left.saturating_sub(count_of(shared));
                if left == 0 {
                    return Err(Error::format(
                        path,
                        "boxes",
                        "boxes that lie beside one another",
                        format!("{} that overlap over and over", patches.len()),
                        "the file is damaged: save it again",
                    ));
                }
                mark(&mut marks[other], &patches[other], shared, bit);
            }
        }
    }
    Ok(marks)
}

/// First cell along each axis, and one past the last.
type Range = [[i64; 2]; 3];

fn range_of(patch: &Patch) -> Range {
    let cells = |axis: usize| i64::try_from(patch.cells[axis]).unwrap_or(i64::MAX >> 1);
    [0, 1, 2].map(|axis| [patch.first[axis], patch.first[axis] + cells(axis)])
}

/// Returns the cells of a level whose centres lie in a box of a finer one.
fn covered(level: &Level, finer: &Level, patch: &Patch) -> Range {
    let range = range_of(patch);
    [0, 1, 2].map(|axis| {
        range[axis].map(|edge| {
            let at = finer.origin[axis] + finer.spacing[axis] * edge as f64;
            let cell = ((at - level.origin[axis]) / level.spacing[axis] - 0.5).ceil();
            #[allow(
                clippy::cast_possible_truncation,
                reason = "what is too large for cells saturates"
            )]
            {
                cell.clamp(-1e15, 1e15) as i64
            }
        })
    })
}

fn common(a: Range, b: Range) -> Range {
    [0, 1, 2].map(|axis| [a[axis][0].max(b[axis][0]), a[axis][1].min(b[axis][1])])
}

fn count_of(range: Range) -> usize {
    let along = |[a, b]: [i64; 2]| usize::try_from(b - a).unwrap_or(0);
    range.into_iter().map(along).fold(1, usize::saturating_mul)
}

/// Marks the cells of a range inside the box.
fn mark(marks: &mut [u8], patch: &Patch, range: Range, bit: u8) {
    let place = |axis: usize, n: i64| usize::try_from(n - patch.first[axis]).unwrap_or(0);
    let [[i0, i1], [j0, j1], [k0, k1]] = range;
    if i0 >= i1 {
        return;
    }
    for k in k0..k1 {
        for j in j0..j1 {
            let row = patch.cells[0] * (place(1, j) + patch.cells[1] * place(2, k));
            marks[row + place(0, i0)..row + place(0, i1)]
                .iter_mut()
                .for_each(|mark| *mark |= bit);
        }
    }
}

/// Spatial hash of the boxes of a level. A bin is as large as the largest box, so each box touches few bins.
struct Bins {
    size: [i64; 3],
    boxes: HashMap<[i64; 3], Vec<usize>>,
    members: Vec<usize>,
}

impl Bins {
    /// Returns `None` if the level has no boxes.
    fn new(patches: &[Patch], level: usize) -> Option<Self> {
        let of_level = patches.iter().enumerate().filter(|(_, p)| p.level == level);
        let members: Vec<usize> = of_level.map(|(i, _)| i).collect();
        let largest = |axis: usize| {
            let lengths = members.iter().map(|&i| patches[i].cells[axis]);
            lengths.max().and_then(|n| i64::try_from(n).ok())
        };
        let size = [largest(0)?, largest(1)?, largest(2)?];
        let mut bins = Self {
            size,
            boxes: HashMap::new(),
            members: Vec::new(),
        };
        for &i in &members {
            for bin in bins.touched(range_of(&patches[i])) {
                bins.boxes.entry(bin).or_default().push(i);
            }
        }
        bins.members = members;
        Some(bins)
    }

    fn touched(&self, range: Range) -> impl Iterator<Item = [i64; 3]> + use<> {
        let ends = self.ends(range);
        let along = move |axis: usize| ends[axis][0]..=ends[axis][1];
        along(2).flat_map(move |k| along(1).flat_map(move |j| along(0).map(move |i| [i, j, k])))
    }

    fn ends(&self, range: Range) -> Range {
        [0, 1, 2].map(|axis| {
            let [first, end] = range[axis];
            [first, end - 1].map(|cell| cell.div_euclid(self.size[axis]))
        })
    }

    /// Returns the boxes that may share cells with a range, each once.
    fn near(&self, range: Range, most: usize) -> Vec<usize> {
        let [x, y, z] = self.ends(range).map(|[a, b]| (b - a + 1).max(0));
        let bin_count = x.saturating_mul(y).saturating_mul(z);
        if usize::try_from(bin_count).is_ok_and(|n| n > most) {
            return self.members.clone();
        }
        let bins = self.touched(range).filter_map(|bin| self.boxes.get(&bin));
        let mut found: Vec<usize> = bins.flatten().copied().collect();
        found.sort_unstable();
        found.dedup();
        found
    }
}
