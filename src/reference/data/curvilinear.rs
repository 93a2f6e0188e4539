//! Makes the cells of curvilinear grids.

use rayon::prelude::*;

use super::cells::{Cell, Known, Mesh};
use super::hexahedron::{longest_edges, volume};
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::CurvilinearBlock;
use crate::scene::Values;

/// A cell is degenerate if its volume is below this share of the box of its longest edges, like in sampling.
const DEGENERATE_VOLUME: f64 = 1e-9;

/// Returns all cells of the blocks that have a volume, in order, and the number of cells left out: those
/// without volume, blanked, or lacking a position or a value.
///
/// Seams need no special treatment: the last cell of an O-grid ends where the first begins.
pub(super) fn mesh(
    blocks: &[CurvilinearBlock],
    association: Association,
    values: &Values,
    blanking: &Blanking,
) -> (Mesh, usize) {
    let mut cells: Vec<Cell> = Vec::new();
    let (mut left_out, mut first_node, mut first_cell) = (0, 0, 0);
    for block in blocks {
        let [ci, cj, ck] = block.dims_of(Association::Cells);
        let count = ci * cj * ck;
        let corners = |cell: usize| {
            let [i, j, k] = [cell % ci, cell / ci % cj, cell / (ci * cj)];
            let [ni, nj, _] = block.dims;
            std::array::from_fn::<usize, 8, _>(|c| {
                i + (c & 1) + ni * (j + (c >> 1 & 1) + nj * (k + (c >> 2)))
            })
        };
        let sound = |cell: usize| {
            let corners = corners(cell);
            let is_hidden = blanking.cell(first_cell + cell)
                || corners.iter().any(|&c| blanking.node(first_node + c));
            let places = corners.map(|c| block.nodes[c]);
            let is_known = match association {
                Association::Nodes => corners
                    .iter()
                    .all(|&c| values.get(first_node + c).is_finite()),
                Association::Cells => values.get(first_cell + cell).is_finite(),
            };
            if is_hidden || !is_known || !places.iter().all(|p| p.is_finite()) {
                return None;
            }
            // Relative to the cell's first corner, so that a distant origin costs no digits.
            let near = places.map(|p| p - places[0]);
            let volume = volume(&near);
            let is_there = volume.abs() > DEGENERATE_VOLUME * longest_edges(&near);
            (is_there && volume.is_finite()).then_some((cell, corners, volume))
        };
        let found: Vec<_> = (0..count).into_par_iter().filter_map(sound).collect();
        let sum: f64 = found.iter().map(|(.., volume)| volume).sum();
        let handedness = if sum < 0.0 { -1.0 } else { 1.0 };
        let before = cells.len();
        // Numbers of samples have been checked against u32.
        let number = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
        // Inverted cells lie within others.
        let upright = found
            .iter()
            .filter(|(.., volume)| volume * handedness > 0.0);
        cells.extend(upright.map(|(cell, corners, _)| {
            let corners = corners.map(|c| number(first_node + c));
            Cell::hexahedron(corners, number(first_cell + cell))
        }));
        left_out += count - (cells.len() - before);
        first_node += block.nodes.len();
        first_cell += count;
    }
    let nodes = blocks.iter().flat_map(|b| b.nodes.iter().copied());
    let all = (0..values.len()).map(|i| f64::from(values.get(i)));
    let known = match association {
        Association::Nodes => Known::AtNodes(all.collect()),
        Association::Cells => Known::InCells(all.collect()),
    };
    (Mesh::new(nodes.collect(), known, cells), left_out)
}
