//! Computes the part of a structured grid of hexahedra that belongs to a node or a cell.
//!
//! Cells are trilinear. F = ∂x/∂(i, j, k) and volumes come from the 2 x 2 x 2 Gauss points of each cell, one in
//! each eighth. The determinant of a trilinear map is quadratic in each index, so the volumes add up to the
//! volume of the grid exactly. F is the mean over the node's Gauss points, weighted by volume. Inside the grid
//! it equals central differences. On a singular line, where differences at the node itself vanish, it stays
//! sound.
//!
//! Nodes and cells are processed in runs along i, with their coordinates in arrays of lanes: the compiler
//! vectorises the loops over these.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::seam::seam;
use super::window::Window;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::math::ExactSum;
use crate::sample::left_out::LeftOut;
use crate::sample::report::SampleReport;

/// Distance along each index from a corner to the Gauss point of its eighth: (1 - 1/√3) / 2.
const GAUSS: f64 = 0.211_324_865_405_187_13;

/// A cell is degenerate if its volume is below this share of the box of its longest edges. Real cells of
/// boundary layers are thin but not sheared flat: they stay above 1e-3.
const DEGENERATE_VOLUME: f64 = 1e-9;

/// One block.
pub(in crate::sample) struct Grid<'a> {
    pub(in crate::sample) dims: [usize; 3],
    pub(in crate::sample) nodes: &'a [DVec3],
    /// True for each index along which the first and the last plane coincide.
    pub(in crate::sample) periodic: [bool; 3],
    /// Sign of the determinant of most of the grid.
    pub(in crate::sample) handedness: f64,
    pub(in crate::sample) blanking: &'a Blanking,
    /// Number of the grid's first node among those of all blocks; likewise of its first cell.
    pub(in crate::sample) first_node: usize,
    pub(in crate::sample) first_cell: usize,
    /// Range of planes of a larger grid that these are.
    pub(in crate::sample) window: Window,
    /// The volume that an eighth of each cell must exceed to count: infinite in blanked cells.
    least_eighths: Vec<f64>,
}

/// The part of a grid that belongs to a node or a cell.
#[derive(Debug, Clone, Copy)]
pub(in crate::sample) struct Part {
    pub(in crate::sample) volume: f64,
    pub(in crate::sample) centroid: DVec3,
    pub(in crate::sample) jacobian: DMat3,
}

/// Returns ∂x/∂(i, j, k) of a trilinear cell at `s`, each component in 0..1. Corners are numbered i fastest.
#[inline(always)]
fn columns(c: &[DVec3; 8], [si, sj, sk]: [f64; 3]) -> [DVec3; 3] {
    // From differences, so that a distant origin costs no digits.
    let mix = |a: DVec3, b: DVec3, s: f64| a + (b - a) * s;
    let bilinear = |e: [DVec3; 4], s: f64, t: f64| mix(mix(e[0], e[1], s), mix(e[2], e[3], s), t);
    [
        bilinear([c[1] - c[0], c[3] - c[2], c[5] - c[4], c[7] - c[6]], sj, sk),
        bilinear([c[2] - c[0], c[3] - c[1], c[6] - c[4], c[7] - c[5]], si, sk),
        bilinear([c[4] - c[0], c[5] - c[1], c[6] - c[2], c[7] - c[3]], si, sj),
    ]
}

#[inline(always)]
fn determinant([i, j, k]: [DVec3; 3]) -> f64 {
    i.dot(j.cross(k))
}

/// Measures of a cell, taken before its eighths.
#[derive(Clone, Copy, Default)]
struct Cell {
    /// Volume with the sign of its determinant; 0 if degenerate.
    volume: f64,
    /// Product of the longest edges along i, j and k.
    of_box: f64,
    /// True if an edge has no length.
    is_collapsed: bool,
}

impl Cell {
    #[inline(always)]
    fn new(c: &[DVec3; 8]) -> Self {
        let mut longest_squared = [0.0_f64; 3];
        let mut is_collapsed = false;
        for (axis, longest) in longest_squared.iter_mut().enumerate() {
            for i in [0, 1, 2, 3] {
                // Corners with a 0 in this bit.
                let from = i >> axis << (axis + 1) | i & ((1 << axis) - 1);
                let squared = c[from].distance_squared(c[from + (1 << axis)]);
                *longest = longest.max(squared);
                is_collapsed |= squared <= 0.0;
            }
        }
        let [i, j, k] = longest_squared.map(f64::sqrt);
        let of_box = i * j * k;
        let mut volume = 0.0;
        for si in [GAUSS, 1.0 - GAUSS] {
            for sj in [GAUSS, 1.0 - GAUSS] {
                for sk in [GAUSS, 1.0 - GAUSS] {
                    volume += determinant(columns(c, [si, sj, sk])) / 8.0;
                }
            }
        }
        let is_degenerate = volume.abs() <= DEGENERATE_VOLUME * of_box;
        Self {
            volume: if is_degenerate { 0.0 } else { volume },
            of_box,
            is_collapsed,
        }
    }
}

/// Greatest number of nodes or cells in a run.
const RUN: usize = 16;

/// A number for each node or cell of a run.
type Lanes = [f64; RUN];

/// Positions of the nodes of a run, by coordinate.
#[derive(Clone, Copy)]
struct Row {
    /// Coordinates of the run's nodes, of the one before and of the one behind; NaN outside the grid.
    at: [[f64; RUN + 2]; 3],
    /// Coordinates as the end of the preceding cells: at a seam those of the last plane.
    ends: [Lanes; 3],
}

impl Row {
    const NONE: Self = Self {
        at: [[f64::NAN; RUN + 2]; 3],
        ends: [[f64::NAN; RUN]; 3],
    };

    /// Returns node `n`, counted from the one before the run.
    #[inline(always)]
    fn node(&self, n: usize) -> DVec3 {
        DVec3::new(self.at[0][n], self.at[1][n], self.at[2][n])
    }

    #[inline(always)]
    fn end(&self, n: usize) -> DVec3 {
        DVec3::new(self.ends[0][n], self.ends[1][n], self.ends[2][n])
    }
}

/// Sums over the eighths of cells that belong to the nodes of a run.
struct Eighths {
    volume: Lanes,
    /// ∫ (x - node) dV.
    moment: [Lanes; 3],
    /// ∫ F dV, by columns.
    jacobian: [[Lanes; 3]; 3],
}

impl Eighths {
    const NONE: Self = Self {
        volume: [0.0; RUN],
        moment: [[0.0; RUN]; 3],
        jacobian: [[[0.0; RUN]; 3]; 3],
    };

    /// Adds the eighths of the cells on one side of the nodes along each index.
    ///
    /// - `rows`: corners of these cells: nearest to the nodes, farther along j, along k, along both.
    /// - `nodes`: the nodes themselves.
    /// - `ABOVE`: true for cells above the nodes along i.
    /// - `signs`: for each index 1 if the cells lie above the nodes, -1 if below.
    /// - `least`: the volume that each eighth must exceed.
    #[inline(always)]
    fn add<const ABOVE: bool>(
        &mut self,
        rows: [&Row; 4],
        nodes: &Row,
        signs: DVec3,
        handedness: f64,
        least: &Lanes,
    ) {
        let sense = signs.element_product() * handedness / 8.0;
        #[allow(
            clippy::needless_range_loop,
            reason = "one counter for all arrays of a run becomes vector code"
        )]
        for n in 0..RUN {
            // From the node's corner outwards along each index.
            let near = |row: &Row| if ABOVE { row.node(n + 1) } else { row.end(n) };
            let far = |row: &Row| row.node(if ABOVE { n + 2 } else { n });
            let [a, b, c, d] = rows;
            let corners = [
                near(a),
                far(a),
                near(b),
                far(b),
                near(c),
                far(c),
                near(d),
                far(d),
            ];
            let derivatives = columns(&corners, [GAUSS; 3]);
            let volume = determinant(derivatives) * sense;
            // Phrased so that NaN does not count.
            let counts = volume > least[n] && volume < f64::INFINITY;
            let weighted = |x: f64| if counts { x * volume } else { 0.0 };
            // From the corner along its edge, along a face, and inwards.
            let [own, i, j, ij, ..] = corners;
            let on_face = (j - own) + ((ij - i) - (j - own)) * GAUSS;
            let point = (own - nodes.node(n + 1)) + ((i - own) + on_face + derivatives[2]) * GAUSS;
            self.volume[n] += weighted(1.0);
            for d in 0..3 {
                self.moment[d][n] += weighted(point[d]);
                for index in 0..3 {
                    self.jacobian[index][d][n] += weighted(derivatives[index][d] * signs[index]);
                }
            }
        }
    }

    /// Returns the part of the node at `origin`.
    fn part(&self, n: usize, origin: DVec3) -> Part {
        let vector = |lanes: &[Lanes; 3]| DVec3::new(lanes[0][n], lanes[1][n], lanes[2][n]);
        let [i, j, k] = self.jacobian.each_ref().map(vector);
        let volume = self.volume[n];
        Part {
            volume,
            centroid: origin + vector(&self.moment) / volume,
            jacobian: DMat3::from_cols(i, j, k) * (1.0 / volume),
        }
    }
}

/// Numbers of collapsed, empty and inverted cells over all blocks.
#[derive(Default)]
pub(in crate::sample) struct CellCounts {
    collapsed: usize,
    empty: usize,
    inverted: usize,
}

/// Measures of a row of cells.
#[derive(Default)]
pub(in crate::sample) struct CellRow {
    /// Signed volume of all cells together.
    volume: f64,
    collapsed: usize,
    empty: usize,
    /// Numbers of cells with a positive and with a negative volume.
    of_sign: [usize; 2],
}

/// Returns the signed volume of the cells in rows.
pub(in crate::sample) fn volume_of(rows: &[CellRow]) -> ExactSum {
    let mut sum = ExactSum::default();
    // Cells without volume have volume 0 here.
    rows.iter().for_each(|row| sum.add(row.volume));
    sum
}

impl CellCounts {
    pub(in crate::sample) fn report(&self, report: &mut SampleReport) {
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

/// Runs [`Grid::look_at_row`] compiled for the processor's vector instructions.
struct LookAtRow<'a, 'b> {
    grid: &'a Grid<'b>,
    row: [usize; 2],
    least: &'a mut [f64],
}

impl pulp::NullaryFnOnce for LookAtRow<'_, '_> {
    type Output = CellRow;

    #[inline(always)]
    fn call(self) -> CellRow {
        self.grid.look_at_row(self.row, self.least)
    }
}

/// Runs [`Grid::eighths`] compiled for the processor's vector instructions.
struct AddEighths<'a, 'b> {
    grid: &'a Grid<'b>,
    first: [usize; 3],
}

impl pulp::NullaryFnOnce for AddEighths<'_, '_> {
    type Output = Eighths;

    #[inline(always)]
    fn call(self) -> Eighths {
        self.grid.eighths(self.first)
    }
}

impl<'a> Grid<'a> {
    /// Returns a block with its seams and its handedness, and adds its unusual cells to `counts`.
    pub(in crate::sample) fn new(
        dims: [usize; 3],
        nodes: &'a [DVec3],
        blanking: &'a Blanking,
        first_node: usize,
        first_cell: usize,
        counts: &mut CellCounts,
    ) -> Self {
        let periodic = [0, 1, 2].map(|d| seam(dims, nodes, d, 0..dims[2]).is_seam());
        let mut grid = Self {
            dims,
            nodes,
            periodic,
            handedness: 1.0,
            blanking,
            first_node,
            first_cell,
            window: Window::whole(dims[2]),
            least_eighths: Vec::new(),
        };
        let rows = grid.look_at_cells();
        grid.turn(volume_of(&rows).value(), &rows, counts);
        grid
    }

    /// Returns some planes of a grid whose seams are known, and the measures of the rows of wanted cells.
    /// [Turn](Self::turn) it by the rows of all ranks.
    pub(in crate::sample) fn of_planes(
        dims: [usize; 3],
        nodes: &'a [DVec3],
        blanking: &'a Blanking,
        periodic: [bool; 3],
        window: Window,
    ) -> (Self, Vec<CellRow>) {
        let own = window.cells(dims);
        let mut grid = Self {
            dims,
            nodes,
            periodic,
            handedness: 1.0,
            blanking,
            first_node: 0,
            first_cell: 0,
            window,
            least_eighths: Vec::new(),
        };
        let of_plane = dims[1].saturating_sub(1);
        let mut rows = grid.look_at_cells();
        rows.truncate(own.end * of_plane);
        rows.drain(..(own.start * of_plane).min(rows.len()));
        (grid, rows)
    }

    /// Sets the handedness, and counts the unusual cells.
    ///
    /// - `volume`: signed volume of the grid's cells.
    /// - `rows`: rows of the cells to count.
    pub(in crate::sample) fn turn(
        &mut self,
        volume: f64,
        rows: &[CellRow],
        counts: &mut CellCounts,
    ) {
        self.handedness = if volume < 0.0 { -1.0 } else { 1.0 };
        let inverted = usize::from(volume >= 0.0);
        for row in rows {
            counts.collapsed += row.collapsed;
            counts.empty += row.empty;
            counts.inverted += row.of_sign[inverted];
        }
    }

    /// Returns a grid with the same seams and handedness, and nothing blanked.
    pub(in crate::sample) fn like(other: &Self, dims: [usize; 3], nodes: &'a [DVec3]) -> Self {
        let mut grid = Self {
            dims,
            nodes,
            blanking: &Blanking::NONE,
            first_node: 0,
            first_cell: 0,
            window: Window::whole(dims[2]),
            least_eighths: Vec::new(),
            ..*other
        };
        grid.look_at_cells();
        grid
    }

    /// Finds the least volumes of the cells' eighths, and measures each row of cells.
    fn look_at_cells(&mut self) -> Vec<CellRow> {
        let [ci, cj, ck] = self.dims.map(|n| n.saturating_sub(1));
        let mut least = vec![f64::INFINITY; ci * cj * ck];
        let grid = &*self;
        let look = |(row, least): (usize, &mut [f64])| {
            let row = [row % cj, row / cj];
            pulp::Arch::new().dispatch(LookAtRow { grid, row, least })
        };
        let rows = least.par_chunks_mut(ci.max(1)).enumerate().map(look);
        let rows = rows.collect();
        self.least_eighths = least;
        rows
    }

    #[inline(always)]
    fn look_at_row(&self, [j, k]: [usize; 2], least: &mut [f64]) -> CellRow {
        let mut found = CellRow::default();
        for first in (0..least.len()).step_by(RUN) {
            let mut rows = [Row::NONE; 4];
            for (row, [j, k]) in
                rows.iter_mut()
                    .zip([[j, k], [j + 1, k], [j, k + 1], [j + 1, k + 1]])
            {
                self.load(row, [first, j, k]);
            }
            let mut cells = [Cell::default(); RUN];
            for (n, cell) in cells.iter_mut().enumerate() {
                let [a, b, c, d] = &rows;
                *cell = Cell::new(&[
                    a.node(n + 1),
                    a.node(n + 2),
                    b.node(n + 1),
                    b.node(n + 2),
                    c.node(n + 1),
                    c.node(n + 2),
                    d.node(n + 1),
                    d.node(n + 2),
                ]);
            }
            for (i, (least, cell)) in least[first..].iter_mut().zip(&cells).enumerate() {
                if cell.volume.is_finite() {
                    found.volume += cell.volume;
                }
                found.collapsed += usize::from(cell.is_collapsed);
                found.empty += usize::from(cell.volume.abs() <= 0.0);
                found.of_sign[0] += usize::from(cell.volume > 0.0);
                found.of_sign[1] += usize::from(cell.volume < 0.0);
                if !self.is_blanked([first + i, j, k]) {
                    *least = DEGENERATE_VOLUME / 8.0 * cell.of_box;
                }
            }
        }
        found
    }

    pub(in crate::sample) fn node_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    pub(in crate::sample) fn cell_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + (self.dims[0] - 1) * (j + (self.dims[1] - 1) * k)
    }

    /// Returns true if a cell, or a node at one of its corners, is blanked.
    fn is_blanked(&self, cell: [usize; 3]) -> bool {
        let is_blank = |node: usize| self.blanking.node(self.first_node + node);
        self.blanking.cell(self.first_cell + self.cell_index(cell))
            || (self.blanking.mask(Association::Nodes).is_some()
                && self.corners(cell).into_iter().any(is_blank))
    }

    /// Returns the nodes at a cell's corners, i fastest.
    fn corners(&self, [i, j, k]: [usize; 3]) -> [usize; 8] {
        std::array::from_fn(|c| self.node_index([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)]))
    }

    pub(in crate::sample) fn cell_corners(&self, cell: [usize; 3]) -> [DVec3; 8] {
        self.corners(cell).map(|node| self.nodes[node])
    }

    /// Loads the run of nodes that begins at one.
    #[inline(always)]
    fn load(&self, row: &mut Row, [first, j, k]: [usize; 3]) {
        let start = self.node_index([0, j, k]);
        let nodes = &self.nodes[start..start + self.dims[0]];
        let last = nodes.len() - 1;
        *row = Row::NONE;
        let skipped = usize::from(first == 0);
        let from = first + skipped - 1;
        let inside = &nodes[from..nodes.len().min(first + RUN + 1)];
        for (n, node) in (skipped..).zip(inside) {
            for d in 0..3 {
                row.at[d][n] = node[d];
            }
        }
        #[allow(
            clippy::needless_range_loop,
            reason = "one axis of nodes, rows and their ends"
        )]
        for d in 0..3 {
            row.ends[d].copy_from_slice(&row.at[d][1..=RUN]);
            if first == 0 && self.periodic[0] {
                row.at[d][0] = nodes[last - 1][d];
                row.ends[d][0] = nodes[last][d];
            }
        }
    }

    /// Returns the planes along index `d` between which the cells on one side of a node lie. The first is the
    /// node's own plane, or at a seam its counterpart; the second is the next.
    fn side(&self, d: usize, i: usize, is_above: bool) -> Option<[usize; 2]> {
        let last = self.dims[d] - 1;
        match (is_above, i) {
            (true, i) => (i < last).then(|| [i, i + 1]),
            (false, 0) => self.periodic[d].then(|| [last, last - 1]),
            (false, i) => Some([i, i - 1]),
        }
    }

    /// Sums the eighths of cells around the nodes of a run.
    #[inline(always)]
    fn eighths(&self, [first, j, k]: [usize; 3]) -> Eighths {
        let mut sums = Eighths::NONE;
        let mut nodes = Row::NONE;
        self.load(&mut nodes, [first, j, k]);
        let mut rows = [Row::NONE; 4];
        for above_k in [false, true] {
            for above_j in [false, true] {
                let (Some(js), Some(ks)) = (self.side(1, j, above_j), self.side(2, k, above_k))
                else {
                    continue;
                };
                for (n, row) in rows.iter_mut().enumerate() {
                    self.load(row, [first, js[n & 1], ks[n >> 1]]);
                }
                let [below, above] = self.least(first, js[0].min(js[1]), ks[0].min(ks[1]));
                let sign = |is_above: bool| if is_above { 1.0 } else { -1.0 };
                let signs = DVec3::new(1.0, sign(above_j), sign(above_k));
                let rows = rows.each_ref();
                sums.add::<true>(rows, &nodes, signs, self.handedness, &above);
                sums.add::<false>(rows, &nodes, signs.with_x(-1.0), self.handedness, &below);
            }
        }
        sums
    }

    /// Returns the volumes that the eighths of the cells below and above the nodes of a run must exceed;
    /// infinite if there is no cell.
    #[inline(always)]
    fn least(&self, first: usize, j: usize, k: usize) -> [Lanes; 2] {
        let start = self.cell_index([0, j, k]);
        let row = &self.least_eighths[start..start + self.dims[0] - 1];
        let mut sides = [[f64::INFINITY; RUN]; 2];
        let [below, above] = &mut sides;
        for (n, least) in row[first.min(row.len())..].iter().take(RUN).enumerate() {
            above[n] = *least;
        }
        let skipped = usize::from(first == 0);
        for (n, least) in (skipped..RUN).zip(&row[first + skipped - 1..]) {
            below[n] = *least;
        }
        if first == 0 && self.periodic[0] {
            below[0] = row[row.len() - 1];
        }
        sides
    }

    /// Calls `each` with the parts of the grid that belong to some nodes, `RUN` of a row at a time.
    pub(in crate::sample) fn node_parts(
        &self,
        nodes: Range<usize>,
        mut each: impl FnMut(usize, Result<Part, LeftOut>),
    ) {
        let [ni, nj, _] = self.dims;
        let has_cells = self.dims.iter().all(|n| *n > 1);
        let mut node = nodes.start;
        while node < nodes.end {
            let first = [node % ni, node / ni % nj, node / (ni * nj)];
            let count = RUN.min(ni - first[0]).min(nodes.end - node);
            let sums = if has_cells {
                pulp::Arch::new().dispatch(AddEighths { grid: self, first })
            } else {
                Eighths::NONE
            };
            for n in 0..count {
                each(
                    node + n,
                    self.node_part([first[0] + n, first[1], first[2]], n, &sums),
                );
            }
            node += count;
        }
    }

    /// Returns the part of the grid that belongs to a node, the `n`-th of a run.
    fn node_part(&self, ijk: [usize; 3], n: usize, sums: &Eighths) -> Result<Part, LeftOut> {
        let index = self.node_index(ijk);
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
        let part = sums.part(n, origin);
        if part.volume > 0.0 && part.volume.is_finite() {
            Ok(part)
        } else if self.is_beside_blanked(ijk) {
            Err(LeftOut::Blanked)
        } else {
            Err(LeftOut::Degenerate)
        }
    }

    /// Returns true if a cell at a node, or a node at one of its corners, is blanked.
    pub(in crate::sample) fn is_beside_blanked(&self, ijk: [usize; 3]) -> bool {
        (0..8_usize).any(|side| {
            let along = |d: usize| self.side(d, ijk[d], side >> d & 1 == 1);
            let (Some(i), Some(j), Some(k)) = (along(0), along(1), along(2)) else {
                return false;
            };
            self.is_blanked([i, j, k].map(|[a, b]| a.min(b)))
        })
    }

    /// Returns a whole cell: its centre, the Jacobian there and its volume.
    pub(in crate::sample) fn cell_part(&self, index: usize) -> Result<Part, LeftOut> {
        let [ci, cj, _] = self.dims.map(|n| n - 1);
        let ijk = [index % ci, index / ci % cj, index / (ci * cj)];
        if self.is_blanked(ijk) {
            return Err(LeftOut::Blanked);
        }
        let corners = self.cell_corners(ijk);
        if !corners.iter().all(|c| c.is_finite()) {
            return Err(LeftOut::Position);
        }
        let volume = Cell::new(&corners).volume * self.handedness;
        if volume > 0.0 && volume.is_finite() {
            let [i, j, k] = columns(&corners, [0.5; 3]);
            Ok(Part {
                volume,
                centroid: corners.iter().sum::<DVec3>() / 8.0,
                jacobian: DMat3::from_cols(i, j, k),
            })
        } else {
            Err(LeftOut::Degenerate)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
    use crate::scene::Values;

    /// Returns numbers from -1 to 1.
    fn noise(n: usize, d: usize) -> f64 {
        2.0 * ((n as f64 + 1.0) * [0.754_878, 0.569_840, 0.870_271][d]).fract() - 1.0
    }

    fn indices(n: usize, [ni, nj, _]: [usize; 3]) -> [usize; 3] {
        [n % ni, n / ni % nj, n / (ni * nj)]
    }

    fn blanked_cells(cells: &[usize], count: usize) -> Blanking {
        let mut marks = vec![0_u8; count];
        for &cell in cells {
            marks[cell] = 32;
        }
        let field = Field {
            name: "vtkGhostType".into(),
            association: Association::Cells,
            source: FieldSource::Scalar(Values::U8(marks)),
            unit: None,
        };
        let geometry = Geometry::Points {
            positions: Vec::new(),
        };
        let path = std::path::Path::new("test");
        Blanking::of(&Dataset::new(path, "test", geometry, vec![field])).unwrap()
    }

    /// Returns the sums over the eighths around a node, computed one by one from the shape functions of its
    /// cells' corners: volume, moment about the node, integral of the Jacobian.
    fn brute_force(grid: &Grid<'_>, ijk: [usize; 3]) -> (f64, DVec3, DMat3) {
        let node = grid.nodes[grid.node_index(ijk)];
        let mut sums = (0.0, DVec3::ZERO, DMat3::ZERO);
        'eighths: for eighth in 0..8_usize {
            let (mut cell, mut s) = ([0; 3], [0.0; 3]);
            for d in 0..3 {
                let last = grid.dims[d] - 1;
                let is_above = eighth >> d & 1 == 1;
                cell[d] = match (is_above, ijk[d]) {
                    (true, i) if i < last => i,
                    (false, i) if i > 0 => i - 1,
                    (false, _) if grid.periodic[d] => last - 1,
                    _ => continue 'eighths,
                };
                s[d] = if is_above { GAUSS } else { 1.0 - GAUSS };
            }
            if grid.blanking.cell(grid.cell_index(cell)) {
                continue;
            }
            let (mut point, mut jacobian) = (DVec3::ZERO, DMat3::ZERO);
            for corner in 0..8_usize {
                let at = [0, 1, 2].map(|d| cell[d] + (corner >> d & 1));
                let offset = grid.nodes[grid.node_index(at)] - node;
                let share = |d: usize| {
                    if corner >> d & 1 == 1 {
                        s[d]
                    } else {
                        1.0 - s[d]
                    }
                };
                let slope = |d: usize| if corner >> d & 1 == 1 { 1.0 } else { -1.0 };
                point += offset * (share(0) * share(1) * share(2));
                for d in 0..3 {
                    let others = share((d + 1) % 3) * share((d + 2) % 3);
                    *jacobian.col_mut(d) += offset * (slope(d) * others);
                }
            }
            let volume = jacobian.determinant() / 8.0 * grid.handedness;
            // An eighth is far from degenerate, or has no volume.
            if volume > 1e-6 {
                sums.0 += volume;
                sums.1 += point * volume;
                sums.2 += jacobian * volume;
            }
        }
        sums
    }

    fn check(dims: [usize; 3], place: impl Fn([f64; 3], usize) -> DVec3, blanked: &[usize]) {
        let count = dims.iter().product();
        let nodes: Vec<DVec3> = (0..count)
            .map(|n| place(indices(n, dims).map(|i| i as f64), n))
            .collect();
        let cell_count = dims.iter().map(|n| n - 1).product();
        let blanking = blanked_cells(blanked, cell_count);
        let mut counts = CellCounts::default();
        let grid = Grid::new(dims, &nodes, &blanking, 0, 0, &mut counts);
        let mut parts = Vec::new();
        grid.node_parts(0..count, |n, part| {
            assert_eq!(n, parts.len());
            parts.push(part);
        });
        for (n, part) in parts.iter().enumerate() {
            // The part does not depend on the run that it is in.
            grid.node_parts(n..n + 1, |_, alone| match (part, alone) {
                (Ok(a), Ok(b)) => assert_eq!(
                    (a.volume, a.centroid, a.jacobian),
                    (b.volume, b.centroid, b.jacobian)
                ),
                (a, b) => assert_eq!(a.err(), b.err()),
            });
            let ijk = indices(n, dims);
            let is_seam = (0..3).any(|d| grid.periodic[d] && ijk[d] + 1 == dims[d]);
            let (volume, moment, jacobian) = brute_force(&grid, ijk);
            match part {
                Err(LeftOut::Seam) => assert!(is_seam),
                Err(LeftOut::Position) => assert!(!nodes[n].is_finite()),
                Err(LeftOut::Blanked) => assert!(volume <= 0.0 && !blanked.is_empty()),
                Err(LeftOut::Degenerate) => assert!(volume <= 0.0),
                Err(other) => panic!("{other:?}"),
                Ok(part) => {
                    // Some fifty roundings of f64.
                    let is_near = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-13 * scale;
                    assert!(is_near(part.volume, volume, volume), "{ijk:?}");
                    let size = (jacobian * (1.0 / volume)).to_cols_array();
                    let size = size.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
                    let off = part.centroid - nodes[n] - moment / volume;
                    let digits = size + 1e-2 * nodes[n].length();
                    assert!(is_near(off.length(), 0.0, digits), "{ijk:?} {off}");
                    let off = part.jacobian - jacobian * (1.0 / volume);
                    for x in off.to_cols_array() {
                        assert!(is_near(x, 0.0, size), "{ijk:?} {off}");
                    }
                }
            }
        }
    }

    #[test]
    fn parts_are_the_sums_of_their_eighths() {
        let jittered = |[i, j, k]: [f64; 3], n: usize| {
            let shift = DVec3::new(noise(n, 0), noise(n, 1), noise(n, 2)) * 0.2;
            DVec3::new(1.1 * i + 0.3 * j, j, 0.7 * k + 0.1 * i) + shift
        };
        check([37, 4, 3], jittered, &[]);
        check([2, 2, 2], jittered, &[]);
        check([RUN + 1, 3, 2], jittered, &[3, 17, 18]);
        // With the other handedness, and far away.
        let mirrored = |s: [f64; 3], n: usize| jittered(s, n) * DVec3::new(-1.0, 1.0, 1.0) + 1e3;
        check([5, 4, 3], mirrored, &[]);
        // All nodes around one blanked; nodes without a position; one cell turned inside out.
        check([3, 3, 3], jittered, &[0, 1, 2, 3, 4, 5, 6, 7]);
        let holes = |s: [f64; 3], n: usize| match n {
            31 => DVec3::NAN,
            77 => DVec3::new(0.0, f64::INFINITY, 0.0),
            _ => jittered(s, n),
        };
        check([20, 4, 3], holes, &[5]);
        let folded = |s: [f64; 3], n: usize| {
            if n == 42 {
                jittered(s, n) + DVec3::X * 2.5
            } else {
                jittered(s, n)
            }
        };
        check([19, 4, 3], folded, &[]);
        // A line along which nodes coincide.
        let wedge = |[i, j, k]: [f64; 3], _: usize| {
            DVec3::new(j * (0.2 * i).cos(), -j * (0.2 * i).sin(), k)
        };
        check([6, 5, 3], wedge, &[]);
    }

    #[test]
    fn parts_go_on_across_seams() {
        // Closed up to a share of the spacing.
        let turn = |x: f64, n: usize| std::f64::consts::TAU * x / n as f64 + 1e-5 * x / n as f64;
        for axis in 0..3 {
            let mut dims = [4, 3, 5];
            dims[axis] = 20;
            check(
                dims,
                |at, _| {
                    let angle = turn(at[axis], 19);
                    let radius = 2.0 + 0.5 * at[(axis + 1) % 3] + 0.02 * angle.sin();
                    let height = at[(axis + 2) % 3] + 0.1 * angle.cos();
                    DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
                },
                &[7],
            );
        }
    }

    #[test]
    fn cells_with_something_about_them_are_counted() {
        let dims = [RUN + 3, 3, 3];
        let mut nodes: Vec<DVec3> = (0..dims.iter().product())
            .map(|n| DVec3::from(indices(n, dims).map(|i| i as f64)))
            .collect();
        // One cell is turned inside out; an edge of another has no length.
        nodes[2] -= DVec3::X * 6.0;
        nodes[10] = nodes[11];
        let mut counts = CellCounts::default();
        Grid::new(dims, &nodes, &Blanking::NONE, 0, 0, &mut counts);
        let cells = |found: &dyn Fn(f64, bool) -> bool| {
            let all = (0..dims.iter().map(|n| n - 1).product()).filter(|&n| {
                let [i, j, k] = indices(n, dims.map(|n| n - 1));
                let at = |c: usize| {
                    let to = [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)];
                    nodes[to[0] + dims[0] * (to[1] + dims[1] * to[2])]
                };
                let (c, mut volume, mut is_collapsed) = ([0; 8], 0.0, false);
                // By six tetrahedra around a diagonal: nodes are moved along edges of flat faces alone.
                for path in [[1, 3], [3, 2], [2, 6], [6, 4], [4, 5], [5, 1]] {
                    let [u, v, w] = [path[0], path[1], 7].map(|c| at(c) - at(0));
                    volume += u.dot(v.cross(w)) / 6.0;
                }
                for (a, _) in c.iter().enumerate() {
                    for step in [1, 2, 4] {
                        is_collapsed |= a & step == 0 && at(a) == at(a + step);
                    }
                }
                found(volume, is_collapsed)
            });
            all.count()
        };
        assert_eq!(counts.collapsed, cells(&|_, is_collapsed| is_collapsed));
        assert_eq!(counts.inverted, cells(&|volume, _| volume < -1e-12));
        assert_eq!(counts.empty, 0);
        assert_eq!((counts.collapsed, counts.inverted), (1, 1));
        // Without height, in cells of either orientation.
        let flat: Vec<DVec3> = nodes.iter().map(|p| p.with_z(0.0)).collect();
        let mut counts = CellCounts::default();
        Grid::new(dims, &flat, &Blanking::NONE, 0, 0, &mut counts);
        assert_eq!(counts.empty, (RUN + 2) * 4);
    }
}
