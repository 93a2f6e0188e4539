//! Makes the cells of unstructured grids.

use glam::DVec3;
use rayon::prelude::*;

use super::cells::{Cell, Known, Mesh};
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::handedness::Handedness;
use crate::data::polyhedron::polyhedron_faces;
use crate::scene::Values;

/// A cell is degenerate if its volume is below this share of its longest extent cubed, like in sampling.
const DEGENERATE_VOLUME: f64 = 1e-12;

/// Returns the corners of a cell with a single map, by their positions among its nodes: four of a tetrahedron,
/// eight of a hexahedron (the first index fastest). Wedges and pyramids have repeated corners. Cells of higher
/// order are represented by their corners. Returns `None` for all others.
fn corners_of(kind: CellKind) -> Option<&'static [u8]> {
    Some(match kind.0 {
        10 | 24 | 71 | 78 => &[0, 1, 2, 3],
        11 => &[0, 1, 2, 3, 4, 5, 6, 7],
        12 | 25 | 29 | 33 | 72 | 79 => &[0, 1, 3, 2, 4, 5, 7, 6],
        13 | 26 | 31 | 32 | 73 | 80 => &[0, 1, 2, 2, 3, 4, 5, 5],
        14 | 27 | 37 | 74 | 81 => &[0, 1, 3, 2, 4, 4, 4, 4],
        _ => return None,
    })
}

/// Returns all solid cells that have a volume, in order, and the number of cells left out: those without
/// volume, hidden, or lacking a position or a value.
///
/// Polyhedra and prisms become tetrahedra around the mean of their corners and the means of their faces'
/// corners, at which the value is the mean of the corners', too.
pub(super) fn mesh(
    mesh: &CellMesh,
    association: Association,
    values: &Values,
    blanking: &Blanking,
) -> (Mesh, usize) {
    let count = mesh.cell_count();
    let is_sound = |cell: usize, corners: &[u32]| {
        let is_sound = |&n: &u32| {
            mesh.nodes[n as usize].is_finite()
                && !blanking.node(n as usize)
                && (association == Association::Cells || values.get(n as usize).is_finite())
        };
        let is_known = association == Association::Nodes || values.get(cell).is_finite();
        is_known && !blanking.cell(cell) && corners.iter().all(is_sound)
    };
    // Numbers of nodes and cells have been checked against u32.
    let number = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
    let mapped: Vec<_> = (0..count)
        .into_par_iter()
        .filter_map(|i| {
            let kind = mesh.kinds[i];
            let entries = mesh.cell(i);
            let places = corners_of(kind)?;
            let corner = |c: usize| entries[usize::from(places[c])];
            let cell = match places.len() {
                4 => Cell::tetrahedron(std::array::from_fn(corner), number(i)),
                _ => Cell::hexahedron(std::array::from_fn(corner), number(i)),
            };
            if !is_sound(i, cell.nodes()) {
                return None;
            }
            let volume = cell.volume(&mesh.nodes);
            let is_there = volume.abs() > DEGENERATE_VOLUME * extent(&mesh.nodes, cell.nodes());
            (is_there && volume.is_finite()).then_some((i, cell, volume))
        })
        .collect();
    let mut turned = [[0_usize; 2]; 256];
    for (i, _, volume) in &mapped {
        turned[usize::from(mesh.kinds[*i].0)][usize::from(*volume < 0.0)] += 1;
    }
    let handedness = turned.map(Handedness::of);
    let of_kind = |i: usize| handedness[usize::from(mesh.kinds[i].0)];
    let upright = mapped
        .iter()
        .filter(|(i, _, v)| v * of_kind(*i).sign(*v) > 0.0);
    let mut cells: Vec<Cell> = upright.map(|(_, cell, _)| *cell).collect();
    let mut taken = cells.len();

    let mut nodes = mesh.nodes.clone();
    let mut known: Vec<f64> = (0..values.len())
        .map(|i| f64::from(values.get(i)))
        .collect();
    let of_nodes = association == Association::Nodes;
    for i in 0..count {
        let kind = mesh.kinds[i];
        if !kind.is_solid() || corners_of(kind).is_some() {
            continue;
        }
        let faces = faces(kind, mesh.cell(i));
        let mut corners: Vec<u32> = faces.iter().flatten().copied().collect();
        corners.sort_unstable();
        corners.dedup();
        if corners.is_empty() || !is_sound(i, &corners) {
            continue;
        }
        let mut add_mean = |of: &[u32]| {
            let first = nodes[of[0] as usize];
            let offsets: DVec3 = of.iter().map(|&n| nodes[n as usize] - first).sum();
            nodes.push(first + offsets / of.len() as f64);
            if of_nodes {
                let sum: f64 = of.iter().map(|&n| known[n as usize]).sum();
                known.push(sum / of.len() as f64);
            }
            number(nodes.len() - 1)
        };
        let least = DEGENERATE_VOLUME * extent(&mesh.nodes, &corners);
        let centre = add_mean(&corners);
        let before = cells.len();
        let mut parts = Vec::new();
        for face in &faces {
            if let [a, b, c] = face[..] {
                parts.push([a, b, c, centre]);
                continue;
            }
            let middle = add_mean(face);
            let next = face.iter().cycle().skip(1);
            parts.extend(face.iter().zip(next).map(|(&a, &b)| [a, b, middle, centre]));
        }
        let parts = parts.into_iter().map(|p| Cell::tetrahedron(p, number(i)));
        cells.extend(parts.filter(|part| part.volume(&nodes).abs() > least));
        taken += usize::from(cells.len() > before);
    }
    let known = if of_nodes {
        Known::AtNodes(known)
    } else {
        Known::InCells(known)
    };
    let solid = mesh.kinds.iter().filter(|kind| kind.is_solid()).count();
    (Mesh::new(nodes, known, cells), solid - taken)
}

/// Returns the faces of a cell as lists of nodes.
fn faces(kind: CellKind, entries: &[u32]) -> Vec<Vec<u32>> {
    match kind.faces() {
        Some(faces) => {
            let nodes = |face: &&[u8]| face.iter().map(|&i| entries[usize::from(i)]).collect();
            faces.iter().map(nodes).collect()
        }
        None => polyhedron_faces(entries).map(<[u32]>::to_vec).collect(),
    }
}

/// Returns the longest side of the box around nodes, cubed.
fn extent(nodes: &[DVec3], corners: &[u32]) -> f64 {
    let places = || corners.iter().map(|&c| nodes[c as usize]);
    let low = places().fold(DVec3::INFINITY, DVec3::min);
    let high = places().fold(DVec3::NEG_INFINITY, DVec3::max);
    (high - low).max_element().powi(3)
}
