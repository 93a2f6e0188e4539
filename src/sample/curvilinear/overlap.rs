//! Measures the overlap of grids: the share of their volume that more than one of them covers.
//!
//! The kernels of each grid add up to the density of the data, so the density counts twice where two grids
//! overlap. A sample of cells is probed: a cell overlaps if its centre lies in a cell of another grid. Abutting
//! grids with a curved interface have a few such cells. Overlap is therefore reported only if enough volume has
//! centres well within cells of another grid.

use std::sync::atomic::{AtomicU8, Ordering};

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::structured::Grid;
use crate::sample::positions;
use crate::sample::positions::index_u32;
use crate::sample::report::{Finding, SampleReport};

/// Approximate number of cells that are probed.
const PROBES: usize = 4096;

/// Least depth of a centre that lies well within a cell, as a share of the distance from the cell's faces to its
/// middle. On curved interfaces, cells of one side reach a little into cells of the other side.
const WITHIN: f64 = 0.2;

/// Ranks of a probe: within no cell of another grid, within one, and well within one.
const WITHIN_CELL: u8 = 1;
const WELL_WITHIN: u8 = 2;

/// Least share of the volume that is reported as overlap.
const LEAST_SHARE: f64 = 0.01;

/// Corners of each face of a cell; corners are numbered i fastest.
const FACES: [[usize; 4]; 6] = [
    [0, 2, 6, 4],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 3, 7, 6],
    [0, 1, 3, 2],
    [4, 5, 7, 6],
];

/// A cell that is probed.
struct Probe {
    grid: usize,
    centre: DVec3,
    volume: f64,
}

/// A box: its least and greatest corner.
type Bounds = [DVec3; 2];

fn around(places: impl Iterator<Item = DVec3>) -> Bounds {
    positions::around(places.filter(|p| p.is_finite()))
}

fn holds([low, high]: &Bounds, p: DVec3) -> bool {
    p.cmpge(*low).all() && p.cmple(*high).all()
}

impl SampleReport {
    /// Notes the share of the volume of some grids that more than one of them covers.
    pub(in crate::sample) fn note_overlap(&mut self, grids: &[(usize, Grid<'_>)]) {
        let Some((cells, share)) = overlap(grids) else {
            return;
        };
        let reason = format!(
            "within cells of other blocks: {:.0} % of the volume is covered more than once, and counts as often; hide one of \
             the two (iblank, vtkGhostType)",
            (100.0 * share).ceil()
        );
        self.findings.push(Finding {
            count: cells,
            noun: "cells".into(),
            reason: reason.into(),
            left_out: false,
        });
    }
}

/// Estimates the number of cells within others, and the share of the volume that is covered more than once.
/// Returns `None` if the share is negligible.
fn overlap(grids: &[(usize, Grid<'_>)]) -> Option<(usize, f64)> {
    let is_solid = |grid: &Grid<'_>| grid.dims.iter().all(|&n| n > 1);
    let grids: Vec<&Grid<'_>> = grids.iter().map(|(_, grid)| grid).collect();
    let grids: Vec<&Grid<'_>> = grids.into_iter().filter(|grid| is_solid(grid)).collect();
    let boxes: Vec<Bounds> = grids
        .par_iter()
        .map(|grid| around(grid.nodes.iter().copied()))
        .collect();
    let boxes = boxes.as_slice();
    let meet = |a: &Bounds, b: &Bounds| (a[1].min(b[1])).cmpgt(a[0].max(b[0])).all();
    let others = |own: usize| {
        let others = boxes.iter().enumerate().filter(move |(n, _)| *n != own);
        others.filter(move |(_, other)| meet(&boxes[own], other))
    };
    if (0..grids.len()).all(|own| others(own).next().is_none()) {
        return None;
    }
    // The part of a drawn cell, and whether it lies within the box of another grid.
    let part_of = |own: usize, cell: usize| {
        let part = grids[own].cell_part(cell).ok()?;
        let is_near = others(own).any(|(_, other)| holds(other, part.centroid));
        Some((part, is_near))
    };
    // Number of cells within the boxes of other grids, and the volume of all.
    let looked_at = |own: usize| {
        let of_cell = |cell: usize| match part_of(own, cell) {
            Some((part, is_near)) => (usize::from(is_near), part.volume),
            None => (0, 0.0),
        };
        let cells = 0..cell_count(grids[own]);
        let add = |a: (usize, f64), b: (usize, f64)| (a.0 + b.0, a.1 + b.1);
        cells.into_par_iter().map(of_cell).reduce(|| (0, 0.0), add)
    };
    let found: Vec<(usize, f64)> = (0..grids.len()).map(looked_at).collect();
    let near: usize = found.iter().map(|(count, _)| count).sum();
    let volume: f64 = found.iter().map(|(_, volume)| volume).sum();
    let stride = near.div_ceil(PROBES).max(1);
    let probes: Vec<Probe> = (0..grids.len())
        .flat_map(|own| {
            let probe = |cell: usize| {
                let (part, is_near) = part_of(own, cell)?;
                is_near.then_some(Probe {
                    grid: own,
                    centre: part.centroid,
                    volume: part.volume,
                })
            };
            let cells = (0..cell_count(grids[own])).into_par_iter();
            let probes = cells.filter(|&cell| is_chosen(cell, stride));
            probes.filter_map(probe).collect::<Vec<_>>()
        })
        .collect();
    let ranks = covered(&grids, &probes);
    let share_of = |least: u8| {
        let counted = probes
            .iter()
            .zip(&ranks)
            .filter(|(_, rank)| **rank >= least);
        // Both of two overlapping cells are counted.
        let doubled = counted.map(|(probe, _)| probe.volume).sum::<f64>() * stride as f64 / 2.0;
        doubled / (volume - doubled)
    };
    let count = ranks.iter().filter(|rank| **rank >= WITHIN_CELL).count();
    (share_of(WELL_WITHIN) >= LEAST_SHARE).then(|| (count * stride, share_of(WITHIN_CELL).min(1.0)))
}

fn cell_count(grid: &Grid<'_>) -> usize {
    grid.dims.iter().map(|n| n - 1).product()
}

/// Returns true for the cells that are probed: one in `stride`, pseudo-randomly.
fn is_chosen(cell: usize, stride: usize) -> bool {
    let mixed = (cell as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 20).is_multiple_of(stride as u64)
}

/// Returns the rank of each probe.
fn covered(grids: &[&Grid<'_>], probes: &[Probe]) -> Vec<u8> {
    let [low, high] = around(probes.iter().map(|probe| probe.centre));
    let (middle, widest) = ((low + high) / 2.0, (high - low).max_element());
    let found: Vec<AtomicU8> = probes.iter().map(|_| AtomicU8::new(0)).collect();
    if widest > 0.0 && widest.is_finite() {
        // obvhs works in f32: scale to unit size, and enlarge the boxes a little.
        let corner = |p: DVec3, by: f64| Vec3A::from(((p - middle) / widest + by).as_vec3());
        let boxed = |[low, high]: Bounds| Aabb::new(corner(low, -1e-6), corner(high, 1e-6));
        let places: Vec<Aabb> = probes.iter().map(|p| boxed([p.centre; 2])).collect();
        let bvh = PlocBuilder::with_capacity(places.len()).build(
            PlocSearchDistance::Minimum,
            &places,
            (0..index_u32(places.len())).collect(),
            SortPrecision::U64,
            0,
        );
        for (own, grid) in grids.iter().enumerate() {
            let cells = (0..cell_count(grid)).into_par_iter();
            cells.for_each(|cell| probe_cell((own, grid), cell, (&bvh, &boxed), probes, &found));
        }
    }
    found.into_iter().map(AtomicU8::into_inner).collect()
}

/// Marks the probes of other grids that lie within a cell.
fn probe_cell(
    (own, grid): (usize, &Grid<'_>),
    cell: usize,
    (bvh, boxed): (&Bvh2, &impl Fn(Bounds) -> Aabb),
    probes: &[Probe],
    found: &[AtomicU8],
) {
    let [ci, cj, _] = grid.dims.map(|n| n - 1);
    let corners = grid.cell_corners([cell % ci, cell / ci % cj, cell / (ci * cj)]);
    let bounds = around(corners.iter().copied());
    let mut is_drawn = None;
    bvh.aabb_traverse(boxed(bounds), |bvh, node| {
        let node = &bvh.nodes[node as usize];
        let first = node.first_index as usize;
        for &number in &bvh.primitive_indices[first..first + node.prim_count as usize] {
            let probe = &probes[number as usize];
            if probe.grid != own && holds(&bounds, probe.centre) {
                let is_drawn = *is_drawn.get_or_insert_with(|| grid.cell_part(cell).is_ok());
                if is_drawn {
                    found[number as usize]
                        .fetch_max(rank(&corners, probe.centre), Ordering::Relaxed);
                }
            }
        }
        true
    });
}

/// Returns the rank of a place by its depth within a cell, judged by the cell's faces cut into triangles.
fn rank(corners: &[DVec3; 8], place: DVec3) -> u8 {
    let middle = corners.iter().sum::<DVec3>() / 8.0;
    let mut least = f64::INFINITY;
    for face in &FACES {
        let centre = face.iter().map(|&c| corners[c]).sum::<DVec3>() / 4.0;
        for i in 0..4 {
            let [a, b] = [face[i], face[(i + 1) % 4]].map(|c| corners[c] - centre);
            let normal = a.cross(b);
            let depth = normal.dot(middle - centre);
            // An edge that has collapsed bounds nothing.
            if depth != 0.0 {
                least = least.min(normal.dot(place - centre) / depth);
            }
        }
    }
    match least {
        least if least >= WITHIN => WELL_WITHIN,
        least if least >= 0.0 => WITHIN_CELL,
        _ => 0,
    }
}
