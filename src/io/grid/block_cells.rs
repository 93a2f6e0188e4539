//! Converts blocks of structured grids to cells, for grids that also have others.

use crate::data::cells::{CellKind, CellMesh};

/// Appends the cells of a block: hexahedra, or quadrilaterals, lines or a point if axes have a single node.
///
/// - `dims`: nodes along i, j and k, at least one.
/// - `first`: index of the block's first node.
///
/// Returns `None` if 32-bit integers cannot count nodes or entries of cells.
pub(super) fn append(mesh: &mut CellMesh, dims: [usize; 3], first: usize) -> Option<()> {
    let [nx, ny, _] = dims;
    let [cx, cy, cz] = dims.map(|n| n.saturating_sub(1).max(1));
    let axes: Vec<usize> = [1, nx, nx * ny]
        .into_iter()
        .zip(dims)
        .filter(|(_, n)| *n > 1)
        .map(|(stride, _)| stride)
        .collect();
    let (kind, corners) = match axes[..] {
        [a, b, c] => (
            CellKind::HEXAHEDRON,
            vec![0, a, a + b, b, c, a + c, a + b + c, b + c],
        ),
        [a, b] => (CellKind::QUAD, vec![0, a, a + b, b]),
        [a] => (CellKind::LINE, vec![0, a]),
        _ => (CellKind::VERTEX, vec![0]),
    };
    for cell in 0..cx * cy * cz {
        let [i, j, k] = [cell % cx, cell / cx % cy, cell / (cx * cy)];
        let corner = first + i + nx * (j + ny * k);
        for step in &corners {
            mesh.connectivity.push(u32::try_from(corner + step).ok()?);
        }
        mesh.kinds.push(kind);
        mesh.offsets
            .push(u32::try_from(mesh.connectivity.len()).ok()?);
    }
    Some(())
}
