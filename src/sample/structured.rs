//! Structured grids of hexahedra: what part of one belongs to a node or a cell.
//!
//! Cells are trilinear, and both F = ∂x/∂(i, j, k) and volumes come from the 2 x 2 x 2 Gauss points
//! of each cell, one in each eighth: the determinant of a trilinear map is quadratic in each index,
//! so the volumes add up to the volume of the grid exactly. F is the mean over the node's Gauss
//! points, weighted by volume: central differences inside, and sound on a singular line, where the
//! differences at the node itself vanish.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::SampleReport;
use super::left_out::LeftOut;
use crate::io::Blanking;

/// Where the Gauss points of a cell lie along each index: (1 ± 1/√3) / 2.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_13, 0.788_675_134_594_812_9];

/// Two boundary planes are one seam if no pair of nodes is farther apart than this times the
/// spacing across the seam. Single precision closes a circle of 100 nodes to about 1e-5.
const SEAM_TOLERANCE: f64 = 1e-4;

/// A cell is degenerate if its volume is below this share of the box of its longest edges. Real
/// cells of boundary layers are thin, not sheared to nothing: they stay above 1e-3.
const DEGENERATE_VOLUME: f64 = 1e-9;

/// One block.
pub(super) struct Grid<'a> {
    pub(super) dims: [usize; 3],
    pub(super) nodes: &'a [DVec3],
    /// Whether the first and the last plane along each index are one.
    pub(super) periodic: [bool; 3],
    /// Sign of the determinant of most of the grid.
    pub(super) handedness: f64,
    pub(super) blanking: &'a Blanking,
    /// Where the grid's nodes and cells begin among those of all blocks.
    pub(super) first_node: usize,
    pub(super) first_cell: usize,
}

/// A kernel before narrowing.
#[derive(Clone, Copy)]
pub(super) struct Part {
    pub(super) volume: f64,
    pub(super) centroid: DVec3,
    pub(super) jacobian: DMat3,
}

/// The eight corners of a cell, i fastest.
fn corners([i, j, k]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..8).map(move |c| [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)])
}

/// Position and Jacobian ∂x/∂(i, j, k) of a trilinear cell at `s`, each 0..1.
fn trilinear(corners: &[DVec3; 8], s: [f64; 3]) -> (DVec3, DMat3) {
    let mix = |a: DVec3, b: DVec3, s: f64| a + (b - a) * s;
    let [c000, c100, c010, c110, c001, c101, c011, c111] = *corners;
    let [si, sj, sk] = s;
    let (e00, e10) = (mix(c000, c100, si), mix(c010, c110, si));
    let (e01, e11) = (mix(c001, c101, si), mix(c011, c111, si));
    let (f0, f1) = (mix(e00, e10, sj), mix(e01, e11, sj));
    let di = mix(
        mix(c100 - c000, c110 - c010, sj),
        mix(c101 - c001, c111 - c011, sj),
        sk,
    );
    let dj = mix(e10 - e00, e11 - e01, sk);
    (mix(f0, f1, sk), DMat3::from_cols(di, dj, f1 - f0))
}

/// Cells with something about them, over all blocks.
#[derive(Default)]
pub(super) struct CellCounts {
    collapsed: usize,
    empty: usize,
    inverted: usize,
}

impl CellCounts {
    pub(super) fn report(&self, report: &mut SampleReport) {
        report.note(
            self.collapsed,
            "cells",
            "degenerate: an edge has no length; drawn with the volume that is left",
        );
        report.note(
            self.empty,
            "cells",
            "without volume: they add nothing to their nodes",
        );
        report.note(
            self.inverted,
            "cells",
            "inverted against the rest of the grid: left out of their nodes' volumes",
        );
    }
}

impl Grid<'_> {
    /// Finds seams and handedness, and counts cells with something about them.
    pub(super) fn look_around(&mut self, counts: &mut CellCounts) {
        self.periodic = [0, 1, 2].map(|d| self.is_seam(d));
        let grid = &*self;
        let dims = grid.dims;
        let cell_count = dims.iter().map(|n| n - 1).product::<usize>();
        let [ci, cj, _] = dims.map(|n| n - 1);
        let volumes: Vec<f64> = (0..cell_count)
            .into_par_iter()
            .map(|c| grid.signed_volume([c % ci, c / ci % cj, c / (ci * cj)]))
            .collect();
        counts.collapsed += (0..cell_count)
            .into_par_iter()
            .filter(|c| {
                let corners = grid.cell_corners([c % ci, c / ci % cj, c / (ci * cj)]);
                edges(&corners).any(|length| length <= 0.0)
            })
            .count();
        // Cells without volume have volume 0 here.
        let sum: f64 = volumes.iter().filter(|v| v.is_finite()).sum();
        self.handedness = if sum < 0.0 { -1.0 } else { 1.0 };
        let count = |f: &dyn Fn(f64) -> bool| volumes.iter().filter(|&&v| f(v)).count();
        counts.empty += count(&|v| v.abs() <= 0.0);
        counts.inverted += count(&|v| v * self.handedness < 0.0);
    }

    pub(super) fn node_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    pub(super) fn cell_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + (self.dims[0] - 1) * (j + (self.dims[1] - 1) * k)
    }

    pub(super) fn cell_corners(&self, cell: [usize; 3]) -> [DVec3; 8] {
        let [i, j, k] = cell;
        std::array::from_fn(|c| {
            self.nodes[self.node_index([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)])]
        })
    }

    /// Whether the first and last plane along index `d` coincide (an O-grid's seam).
    fn is_seam(&self, d: usize) -> bool {
        let n = self.dims[d];
        // Three cells or more: two would have no inside.
        if n < 4 {
            return false;
        }
        let [a, b] = [(d + 1) % 3, (d + 2) % 3];
        let mut crossed = false;
        for p in 0..self.dims[a] {
            for q in 0..self.dims[b] {
                let at = |along: usize| {
                    let mut ijk = [0; 3];
                    (ijk[d], ijk[a], ijk[b]) = (along, p, q);
                    self.nodes[self.node_index(ijk)]
                };
                let spacing = at(0).distance(at(1)).max(at(n - 2).distance(at(n - 1)));
                // Phrased so that NaN says no.
                let closed = at(0).distance(at(n - 1)) <= SEAM_TOLERANCE * spacing;
                if !closed {
                    return false;
                }
                crossed |= spacing > 0.0;
            }
        }
        crossed
    }

    /// The volume of a cell with the sign of its determinant; 0 if degenerate.
    fn signed_volume(&self, cell: [usize; 3]) -> f64 {
        let corners = self.cell_corners(cell);
        let volume: f64 = (0..8)
            .map(|g| {
                let s = [g & 1, g >> 1 & 1, g >> 2].map(|s: usize| GAUSS[s]);
                trilinear(&corners, s).1.determinant() / 8.0
            })
            .sum();
        if volume.abs() <= DEGENERATE_VOLUME * longest_edges(&corners) {
            0.0
        } else {
            volume
        }
    }

    /// The part of the grid that belongs to a node.
    pub(super) fn node_part(&self, index: usize) -> Result<Part, LeftOut> {
        let [ni, nj, _] = self.dims;
        let ijk = [index % ni, index / ni % nj, index / (ni * nj)];
        if self.blanking.node(self.first_node + index) {
            return Err(LeftOut::Blanked);
        }
        if (0..3).any(|d| self.periodic[d] && ijk[d] + 1 == self.dims[d]) {
            return Err(LeftOut::Seam);
        }
        let origin = self.nodes[index];
        if !origin.is_finite() {
            return Err(LeftOut::Position);
        }
        let mut hidden = false;
        let mut volume = 0.0;
        let mut moment = DVec3::ZERO;
        let mut jacobian = DMat3::ZERO;
        'cells: for side in 0..8usize {
            let mut cell = [0; 3];
            let mut s = [0.0; 3];
            for d in 0..3 {
                let last = self.dims[d] - 1;
                // Above the node its cell starts there; below, it ends there.
                let above = side >> d & 1 == 1;
                cell[d] = match (above, ijk[d]) {
                    (true, i) if i < last => i,
                    (false, i) if i > 0 => i - 1,
                    (false, _) if self.periodic[d] => last - 1,
                    _ => continue 'cells,
                };
                s[d] = if above { GAUSS[0] } else { GAUSS[1] };
            }
            if self.blanking.cell(self.first_cell + self.cell_index(cell)) {
                hidden = true;
                continue;
            }
            // Relative to the node, so that a far origin costs no digits. Across a seam the
            // cell's own end is the node, within the seam's tolerance.
            let corners = self.cell_corners(cell).map(|c| c - origin);
            let (point, derivative) = trilinear(&corners, s);
            let weight = derivative.determinant() / 8.0 * self.handedness;
            if weight.is_finite() && weight > DEGENERATE_VOLUME / 8.0 * longest_edges(&corners) {
                volume += weight;
                moment += point * weight;
                jacobian += derivative * weight;
            }
        }
        let part = Part {
            volume,
            centroid: origin + moment / volume,
            jacobian: jacobian * (1.0 / volume),
        };
        if volume > 0.0 && volume.is_finite() {
            Ok(part)
        } else if hidden {
            Err(LeftOut::Blanked)
        } else {
            Err(LeftOut::Degenerate)
        }
    }

    /// A whole cell: its centre, the Jacobian there and its volume.
    pub(super) fn cell_part(&self, index: usize) -> Result<Part, LeftOut> {
        let [ci, cj, _] = self.dims.map(|n| n - 1);
        let ijk = [index % ci, index / ci % cj, index / (ci * cj)];
        let is_blank = |ijk| self.blanking.node(self.first_node + self.node_index(ijk));
        if self.blanking.cell(self.first_cell + index) || corners(ijk).any(is_blank) {
            return Err(LeftOut::Blanked);
        }
        let corners = self.cell_corners(ijk);
        if !corners.iter().all(|c| c.is_finite()) {
            return Err(LeftOut::Position);
        }
        let volume = self.signed_volume(ijk) * self.handedness;
        let (centroid, jacobian) = trilinear(&corners, [0.5; 3]);
        if volume > 0.0 && volume.is_finite() {
            Ok(Part {
                volume,
                centroid,
                jacobian,
            })
        } else {
            Err(LeftOut::Degenerate)
        }
    }
}

/// The product of a cell's longest edges along i, j and k.
fn longest_edges(c: &[DVec3; 8]) -> f64 {
    let mut longest = [0.0_f64; 3];
    for (i, length) in edges(c).enumerate() {
        longest[i / 4] = longest[i / 4].max(length);
    }
    longest.iter().product()
}

/// Lengths of a cell's twelve edges: four along i, four along j, four along k.
fn edges(c: &[DVec3; 8]) -> impl Iterator<Item = f64> {
    [1, 2, 4].into_iter().flat_map(move |step: usize| {
        (0..8)
            .filter(move |i| i & step == 0)
            .map(move |i| c[i].distance(c[i + step]))
    })
}
