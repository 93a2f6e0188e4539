//! Which cells of a mesh meet at which nodes.

use super::index_u32;
use crate::io::{CellKind, CellMesh, polyhedron_faces};

/// Of the nodes at one position the first: `first` names it for each node, or is empty where none
/// share any.
pub(super) fn first_of(first: &[u32], node: u32) -> u32 {
    first.get(node as usize).copied().unwrap_or(node)
}

/// The nodes of a cell; of a polyhedron once for each face.
pub(super) fn nodes_of(mesh: &CellMesh, cell: usize) -> impl Iterator<Item = u32> {
    let entries = mesh.cell(cell);
    let is_polyhedron = mesh.kinds[cell] == CellKind::POLYHEDRON;
    let (plain, faces) = if is_polyhedron {
        (&[][..], entries)
    } else {
        (entries, &[][..])
    };
    let of_faces = polyhedron_faces(faces).flatten();
    plain.iter().chain(of_faces).copied()
}

/// Which cells meet at each node.
#[derive(Debug)]
pub(crate) struct CellsAround {
    /// Where the cells of each node begin in `cells`; one more at the end.
    starts: Vec<usize>,
    cells: Vec<u32>,
}

impl CellsAround {
    pub(crate) fn new(mesh: &CellMesh, first: &[u32]) -> Self {
        let each = |visit: &mut dyn FnMut(usize, u32)| {
            let mut last = vec![u32::MAX; mesh.nodes.len()];
            for cell in 0..mesh.cell_count() {
                // Faster than a loop.
                nodes_of(mesh, cell).for_each(|node| {
                    let node = first_of(first, node) as usize;
                    if last[node] != index_u32(cell) {
                        last[node] = index_u32(cell);
                        visit(node, index_u32(cell));
                    }
                });
            }
        };
        let mut starts = vec![0; mesh.nodes.len() + 1];
        each(&mut |node, _| starts[node + 1] += 1);
        for node in 0..mesh.nodes.len() {
            starts[node + 1] += starts[node];
        }
        let mut next = starts.clone();
        let mut cells = vec![0; starts[mesh.nodes.len()]];
        each(&mut |node, cell| {
            cells[next[node]] = cell;
            next[node] += 1;
        });
        Self { starts, cells }
    }

    /// The cells at a node that is the first at its position.
    pub(crate) fn of(&self, node: u32) -> &[u32] {
        let node = node as usize;
        &self.cells[self.starts[node]..self.starts[node + 1]]
    }
}
