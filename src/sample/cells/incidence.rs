//! Finds the cells of a mesh that meet at each node.

use crate::data::cells::{CellKind, CellMesh};
use crate::data::polyhedron::polyhedron_faces;
use crate::sample::positions::index_u32;

/// Returns the first of the nodes at the position of `node`. `first` lists it for each node; it is empty if no
/// nodes coincide.
pub(in crate::sample) fn first_of(first: &[u32], node: u32) -> u32 {
    first.get(node as usize).copied().unwrap_or(node)
}

/// Returns the nodes of a cell; those of a polyhedron once for each of its faces.
pub(in crate::sample) fn nodes_of(mesh: &CellMesh, cell: usize) -> impl Iterator<Item = u32> {
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

/// The cells that meet at each node.
#[derive(Debug)]
pub(crate) struct CellsAround {
    /// Index in `cells` at which the cells of each node begin; one more entry at the end.
    starts: Vec<usize>,
    cells: Vec<u32>,
}

impl CellsAround {
    pub(crate) fn new(mesh: &CellMesh, first: &[u32]) -> Self {
        let each = |visit: &mut dyn FnMut(usize, u32)| {
            let mut last = vec![u32::MAX; mesh.nodes.len()];
            for cell in 0..mesh.cell_count() {
                // `for_each` is faster than a loop.
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

    /// Returns the cells at a node, which must be the first at its position.
    pub(crate) fn of(&self, node: u32) -> &[u32] {
        let node = node as usize;
        &self.cells[self.starts[node]..self.starts[node + 1]]
    }
}
