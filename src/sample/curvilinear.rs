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

use super::gradient::Samples;
use super::kernels::{Kernel, Kernels};
use super::left_out::LeftOut;
use super::local_models;
use super::sharp::sharpen_grids;
use super::{
    SampleOptions, SampleReport, Sampled, check_count, check_len, classified_kernels, nothing_left,
    take_scalar,
};
use crate::error::{Error, Result};
use crate::io::{Association, Blanking, CurvilinearBlock, Dataset, Geometry};
use crate::math::{lower_factor, normal_code};
use crate::scene::{LocalModel, LocalModels};
use crate::task::collect;

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

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let blanking = Blanking::of(&dataset)?;
    let taken = take_scalar(&mut dataset, options.field.as_deref())?;
    let Geometry::Curvilinear { blocks } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    // Walls stand among the blocks of some files; their nodes have no volume.
    let is_flat = |block: &CurvilinearBlock| block.dims.iter().any(|&n| n < 2);
    if blocks.iter().all(is_flat) {
        let dims = blocks.first().map_or([0; 3], |block| block.dims);
        return Err(Error::format(
            &dataset.path,
            "dimensions",
            "at least two nodes along each index",
            format!("{} x {} x {}", dims[0], dims[1], dims[2]),
            "a surface has no volume to render",
        ));
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
    let mut samples = Vec::with_capacity(blocks.len());
    let mut counts = CellCounts::default();
    let (mut first_node, mut first_cell, mut first_sample) = (0, 0, 0);
    for block in blocks {
        let mut grid = Grid {
            dims: block.dims,
            nodes: &block.nodes,
            periodic: [false; 3],
            handedness: 1.0,
            blanking: &blanking,
            first_node,
            first_cell,
        };
        grid.look_around(&mut counts);
        samples.push((first_sample, grid));
        first_node += block.nodes.len();
        first_cell += block.dims_of(Association::Cells).iter().product::<usize>();
        first_sample += samples_of(block);
    }
    counts.report(&mut report);

    let noun = match taken.association {
        Association::Nodes => "nodes",
        Association::Cells => "cells",
    };
    let kernels = Kernels::collect(
        sample_count,
        &mut report,
        noun,
        options.task.as_ref(),
        |i| {
            let block = samples.partition_point(|(first, _)| *first <= i) - 1;
            let (first, grid) = &samples[block];
            let part = match taken.association {
                Association::Nodes => grid.node_part(i - first),
                Association::Cells => grid.cell_part(i - first),
            }?;
            if !taken.values.get(i).is_finite() {
                return Err(LeftOut::Value);
            }
            let factor = lower_factor(part.jacobian * options.kernel_width);
            Kernel::new(part.centroid, factor, part.volume)
        },
    )?;
    if kernels.kept.is_empty() {
        return Err(nothing_left(&dataset, &report));
    }
    // The grid of a kept sample, its number there, and the values there.
    let values = &taken.values;
    let of_kept = |kernel: usize| {
        let i = kernels.kept[kernel] as usize;
        let block = samples.partition_point(|(first, _)| *first <= i) - 1;
        let (first, grid) = &samples[block];
        let value = move |local: usize| values.get(first + local);
        (grid, i - first, value)
    };
    let normals = options.normals.then(|| {
        let normal = |kernel: usize| {
            let (grid, sample, value) = of_kept(kernel);
            let samples = grid.samples(taken.association, value);
            normal_code(samples.gradient(samples.indices(sample)))
        };
        let count = kernels.kept.len();
        (0..count).into_par_iter().map(normal).collect()
    });
    let local_models = if options.local_models {
        let model = |kernel: usize| {
            let (grid, sample, value) = of_kept(kernel);
            let of_grid = local_models::grid::GridKernel {
                centre: kernels.positions[kernel],
                factor: kernels.factors[kernel],
                width: options.kernel_width,
            };
            grid.local_model(taken.association, sample, &of_grid, value)
        };
        let (task, count) = (options.task.as_ref(), kernels.kept.len());
        let models = collect(task, local_models::STAGE, count, model)?;
        Some(LocalModels::new(&models))
    } else {
        None
    };
    let is_sharp = options.is_sharp() && taken.association == Association::Nodes;
    let kept = if is_sharp {
        kernels.kept.clone()
    } else {
        Vec::new()
    };
    let mut sampled = classified_kernels(kernels, taken.values, report, options)?;
    sampled.volume.normals = normals;
    sampled.volume.local_models = local_models;
    if is_sharp {
        let Sampled { volume, report } = &mut sampled;
        sharpen_grids(volume, report, &samples, &kept, options);
    }
    Ok(sampled)
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

impl Grid<'_> {
    /// Finds seams and handedness, and counts cells with something about them.
    fn look_around(&mut self, counts: &mut CellCounts) {
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
    fn cell_part(&self, index: usize) -> Result<Part, LeftOut> {
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

    /// A field's samples, `value` by their numbers within the grid. Gradients are those between
    /// samples, not at the kernels' centroids: there the chain rule is exact.
    fn samples(
        &self,
        association: Association,
        value: impl Fn(usize) -> f32,
    ) -> Samples<impl Fn([usize; 3]) -> Option<(DVec3, f64)>> {
        let dims = self.dims_of(association);
        let at = move |ijk: [usize; 3]| {
            let position = match association {
                Association::Nodes => self.nodes[self.node_index(ijk)],
                Association::Cells => self.cell_corners(ijk).iter().sum::<DVec3>() / 8.0,
            };
            let value = f64::from(self.known(association, ijk, &value));
            let is_known = position.is_finite() && value.is_finite();
            is_known.then_some((position, value))
        };
        // The last plane of nodes is the first.
        let periods = [0, 1, 2].map(|d| self.periodic[d].then(|| self.dims[d] - 1));
        Samples { dims, periods, at }
    }

    fn dims_of(&self, association: Association) -> [usize; 3] {
        match association {
            Association::Nodes => self.dims,
            Association::Cells => self.dims.map(|n| n - 1),
        }
    }

    /// The value of a sample, NaN where it is hidden.
    fn known(
        &self,
        association: Association,
        ijk: [usize; 3],
        value: impl Fn(usize) -> f32,
    ) -> f32 {
        let (index, is_hidden) = match association {
            Association::Nodes => {
                let node = self.node_index(ijk);
                (node, self.blanking.node(self.first_node + node))
            }
            Association::Cells => {
                let cell = self.cell_index(ijk);
                (cell, self.blanking.cell(self.first_cell + cell))
            }
        };
        if is_hidden { f32::NAN } else { value(index) }
    }

    /// The local model of a field at one of its samples, `value` by their numbers within the grid.
    fn local_model(
        &self,
        association: Association,
        sample: usize,
        kernel: &local_models::grid::GridKernel,
        value: impl Fn(usize) -> f32,
    ) -> LocalModel {
        let samples = self.samples(association, &value);
        let known = |ijk| self.known(association, ijk, &value);
        local_models::grid::model(&samples, samples.indices(sample), kernel, known)
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
