//! Curvilinear grids: one anisotropic kernel per node or cell.
//!
//! V = kernel_width² F Fᵀ with F = ∂x/∂(i, j, k), mass from the volume of the node's own part of
//! the grid: the eighths of the cells around it. Cells are trilinear, and both F and the
//! volumes come from the 2 x 2 x 2 Gauss points of each cell, one in each eighth: the
//! determinant of a trilinear map is quadratic in each index, so the volumes add up to the
//! volume of the grid exactly. F is the mean over the node's Gauss points, weighted by volume:
//! central differences inside, and sound on a singular line, where the differences at the node
//! itself vanish.
//!
//! A kernel lies at the centroid of its part, not at the node. Measured in one dimension at
//! width .6, as the rms error of a uniform density from .6 spacings inside the boundary on: half
//! cells at the boundary with half-width kernels at the node 7.8 %, full-width at the node
//! 4.5 %, half-width at the centroid 4.7 %, full-width at the centroid 2.2 % (.3 % from one
//! spacing on). The last is used: boundary parts have half the volume and the full F. Where
//! the spacing changes 2:1 at once, the greatest error falls from 22 % to 12 % with centroids,
//! and from 4.6 % to 2.8 % at a stretching of 1.3 per cell; nothing more is done about it.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::{
    SampleOptions, SampleReport, Sampled, check_count, check_len, classified, index_u32, keep,
    lower_factor, narrowed, nothing_left, take_scalar,
};
use crate::error::{Error, Result};
use crate::io::{Association, CurvilinearBlock, Dataset, Geometry};
use crate::scene::{Particles, Values};

/// Where the Gauss points of a cell lie along each index: (1 ± 1/√3) / 2.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_13, 0.788_675_134_594_812_9];

/// Two boundary planes are one seam if no pair of nodes is farther apart than this times the
/// spacing across the seam. Single precision closes a circle of 100 nodes to about 1e-5.
const SEAM_TOLERANCE: f64 = 1e-4;

/// A cell is degenerate if its volume is below this share of the box of its longest edges. Real
/// cells of boundary layers are thin, not sheared to nothing: they stay above 1e-3.
const DEGENERATE_VOLUME: f64 = 1e-9;

/// A grid of nodes, i fastest.
struct Grid<'a> {
    dims: [usize; 3],
    nodes: &'a [DVec3],
    /// Whether the first and the last plane along each index are one.
    periodic: [bool; 3],
    /// Sign of the determinant of most of the grid.
    handedness: f64,
}

/// A kernel before narrowing.
#[derive(Clone, Copy)]
struct Part {
    volume: f64,
    centroid: DVec3,
    jacobian: DMat3,
}

/// Why a sample gives no particle.
#[derive(Clone, Copy, PartialEq, Eq)]
enum LeftOut {
    NonFinitePosition,
    NonFiniteValue,
    Blanked,
    Degenerate,
    Seam,
    BeyondSinglePrecision,
}

const REASONS: [(LeftOut, &str); 6] = [
    (LeftOut::NonFinitePosition, "position not finite"),
    (LeftOut::NonFiniteValue, "value not finite"),
    (LeftOut::Blanked, "blanked (iblank 0)"),
    (LeftOut::Degenerate, "no volume"),
    (
        LeftOut::Seam,
        "on a periodic seam, the same as the first plane",
    ),
    (
        LeftOut::BeyondSinglePrecision,
        "shape or volume beyond single precision; rescale the grid",
    ),
];

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let taken = take_scalar(&mut dataset, options.field.as_deref())?;
    let blank = dataset
        .fields
        .iter()
        .find(|f| f.name.eq_ignore_ascii_case("iblank"))
        .map(|f| Ok::<_, Error>((f.association, dataset.field_scalar(f)?)))
        .transpose()?;
    let Geometry::Curvilinear { blocks } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    for block in blocks {
        check_block(&dataset, block)?;
    }
    let samples_of =
        |block: &CurvilinearBlock| block.dims_of(taken.association).iter().product::<usize>();
    let sample_count = blocks.iter().map(samples_of).sum();
    check_count(&dataset, sample_count)?;
    check_len(&dataset, &taken, sample_count)?;

    let mut report = SampleReport {
        field: Some(taken.name.clone()),
        sample_count,
        ..SampleReport::default()
    };
    let mut grids = Vec::with_capacity(blocks.len());
    let mut counts = CellCounts::default();
    for block in blocks {
        grids.push(Grid::new(block, &mut counts));
    }
    counts.report(&mut report);
    let mut kernels = Vec::with_capacity(sample_count);
    // Where the block's nodes and cells begin in the fields.
    let mut first_node = 0;
    let mut first_cell = 0;
    for (grid, block) in grids.iter().zip(blocks) {
        let samples = BlockSamples {
            grid,
            association: taken.association,
            values: &taken.values,
            blank: blank.as_ref(),
            first_node,
            first_cell,
            kernel_width: options.kernel_width,
        };
        kernels.par_extend(
            (0..samples_of(block))
                .into_par_iter()
                .map(|i| samples.kernel(i)),
        );
        first_node += block.nodes.len();
        first_cell += block.dims_of(Association::Cells).iter().product::<usize>();
    }

    let noun = match taken.association {
        Association::Nodes => "nodes",
        Association::Cells => "cells",
    };
    for (reason, text) in REASONS {
        let count = kernels.iter().filter(|k| k.err() == Some(reason)).count();
        report.leave_out(count, noun, text);
    }
    let count = kernels.iter().filter(|k| k.is_ok()).count();
    let mut kept = Vec::with_capacity(count);
    let mut positions = Vec::with_capacity(count);
    let mut factors = Vec::with_capacity(count);
    let mut volumes = Vec::with_capacity(count);
    for (index, kernel) in kernels.into_iter().enumerate() {
        if let Ok((position, factor, volume)) = kernel {
            kept.push(index_u32(index));
            positions.push(position);
            factors.push(factor);
            volumes.push(volume);
        }
    }
    if kept.is_empty() {
        return Err(nothing_left(&dataset, &report));
    }
    let total: f64 = volumes.iter().copied().map(f64::from).sum();
    let mean_spacing = (total / count as f64).cbrt();
    classified(
        Particles::Anisotropic { positions, factors },
        volumes,
        keep(taken.values, &kept),
        report,
        mean_spacing,
        options,
    )
}

/// Two nodes or more along each index, and as many positions as they say.
fn check_block(dataset: &Dataset, block: &CurvilinearBlock) -> Result<()> {
    let dims = block.dims;
    if dims.iter().any(|&n| n < 2) {
        return Err(Error::format(
            &dataset.path,
            "dimensions",
            "at least two nodes along each index",
            format!("{} x {} x {}", dims[0], dims[1], dims[2]),
            "a surface has no volume to render",
        ));
    }
    let node_count = dims.iter().product::<usize>();
    if block.nodes.len() != node_count {
        return Err(Error::format(
            &dataset.path,
            "nodes",
            format!("{node_count} positions"),
            format!("{} positions", block.nodes.len()),
            "the file is damaged",
        ));
    }
    Ok(())
}

/// The samples of one block.
struct BlockSamples<'a> {
    grid: &'a Grid<'a>,
    association: Association,
    /// Of all blocks, as is `blank`.
    values: &'a Values,
    blank: Option<&'a (Association, Values)>,
    first_node: usize,
    first_cell: usize,
    kernel_width: f64,
}

impl BlockSamples<'_> {
    /// Position, factor and volume of one sample of the block.
    fn kernel(&self, index: usize) -> Result<(DVec3, [f32; 6], f32), LeftOut> {
        let grid = self.grid;
        let of_nodes = self.association == Association::Nodes;
        let [ni, nj, _] = if of_nodes {
            grid.dims
        } else {
            grid.dims.map(|n| n - 1)
        };
        let ijk = [index % ni, index / ni % nj, index / (ni * nj)];
        if self.is_blanked(ijk) {
            return Err(LeftOut::Blanked);
        }
        let part = if of_nodes {
            if (0..3).any(|d| grid.periodic[d] && ijk[d] + 1 == grid.dims[d]) {
                return Err(LeftOut::Seam);
            }
            if !grid.nodes[index].is_finite() {
                return Err(LeftOut::NonFinitePosition);
            }
            grid.node_part(ijk)
        } else {
            if corners(ijk).any(|c| !grid.nodes[grid.node_index(c)].is_finite()) {
                return Err(LeftOut::NonFinitePosition);
            }
            grid.cell_part(ijk)
        };
        let first = if of_nodes {
            self.first_node
        } else {
            self.first_cell
        };
        if !self.values.get(first + index).is_finite() {
            return Err(LeftOut::NonFiniteValue);
        }
        let part = part.ok_or(LeftOut::Degenerate)?;
        let factor = lower_factor(part.jacobian * self.kernel_width).map(narrowed);
        let volume = narrowed(part.volume);
        let sound = factor.iter().all(|l| l.is_finite())
            && factor.iter().any(|l| l.abs() >= f32::MIN_POSITIVE)
            && volume.is_finite()
            && volume >= f32::MIN_POSITIVE;
        if sound {
            Ok((part.centroid, factor, volume))
        } else {
            Err(LeftOut::BeyondSinglePrecision)
        }
    }

    fn is_blanked(&self, ijk: [usize; 3]) -> bool {
        let node = |ijk| self.first_node + self.grid.node_index(ijk);
        let cell = |ijk| self.first_cell + self.grid.cell_index(ijk);
        match (self.blank, self.association) {
            (None, _) | (Some((Association::Cells, _)), Association::Nodes) => false,
            (Some((Association::Nodes, b)), Association::Nodes) => is_blank(b, node(ijk)),
            (Some((Association::Nodes, b)), Association::Cells) => {
                corners(ijk).any(|corner| is_blank(b, node(corner)))
            }
            (Some((Association::Cells, b)), Association::Cells) => is_blank(b, cell(ijk)),
        }
    }
}

fn is_blank(iblank: &Values, index: usize) -> bool {
    // PLOT3D: 0 blanked, 1 field, 2 wall, negative: interpolated from another block.
    index < iblank.len() && iblank.get(index).abs() < 0.5
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
struct CellCounts {
    collapsed: usize,
    empty: usize,
    inverted: usize,
}

impl CellCounts {
    fn report(&self, report: &mut SampleReport) {
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

impl<'a> Grid<'a> {
    fn new(block: &'a CurvilinearBlock, counts: &mut CellCounts) -> Self {
        let dims = block.dims;
        let mut grid = Self {
            dims,
            nodes: &block.nodes,
            periodic: [false; 3],
            handedness: 1.0,
        };
        grid.periodic = [0, 1, 2].map(|d| grid.is_seam(d));
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
        grid.handedness = if sum < 0.0 { -1.0 } else { 1.0 };
        let count = |f: &dyn Fn(f64) -> bool| volumes.iter().filter(|&&v| f(v)).count();
        counts.empty += count(&|v| v.abs() <= 0.0);
        counts.inverted += count(&|v| v * grid.handedness < 0.0);
        grid
    }

    fn node_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    fn cell_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + (self.dims[0] - 1) * (j + (self.dims[1] - 1) * k)
    }

    fn cell_corners(&self, cell: [usize; 3]) -> [DVec3; 8] {
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

    /// The part of the grid that belongs to a node: `None` if it has no volume.
    fn node_part(&self, ijk: [usize; 3]) -> Option<Part> {
        let origin = self.nodes[self.node_index(ijk)];
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
        (volume > 0.0 && volume.is_finite()).then_some(part)
    }

    /// A whole cell: its centre, the Jacobian there and its volume; `None` if degenerate.
    fn cell_part(&self, cell: [usize; 3]) -> Option<Part> {
        let volume = self.signed_volume(cell) * self.handedness;
        let (centroid, jacobian) = trilinear(&self.cell_corners(cell), [0.5; 3]);
        let part = Part {
            volume,
            centroid,
            jacobian,
        };
        (volume > 0.0 && volume.is_finite()).then_some(part)
    }
}

/// The product of a cell's longest edges along i, j and k.
fn longest_edges(c: &[DVec3; 8]) -> f64 {
    let lengths: Vec<f64> = edges(c).collect();
    lengths
        .chunks(4)
        .map(|along| along.iter().copied().fold(0.0, f64::max))
        .product()
}

/// Lengths of a cell's twelve edges: four along i, four along j, four along k.
fn edges(c: &[DVec3; 8]) -> impl Iterator<Item = f64> {
    [1, 2, 4].into_iter().flat_map(move |step: usize| {
        (0..8)
            .filter(move |i| i & step == 0)
            .map(move |i| c[i].distance(c[i + step]))
    })
}
