//! Converts cells that files state by their faces.

use crate::data::cells::{CellKind, CellMesh};

/// Appends a cell: one of fixed shape if its faces are those of one, or else a polyhedron.
///
/// - `outward`: the nodes of each face, anticlockwise seen from outside.
///
/// Returns `None` if 32-bit integers cannot count the entries of cells.
pub(super) fn append(mesh: &mut CellMesh, outward: &[Vec<u32>]) -> Option<()> {
    let kind = match shape(outward) {
        Some((kind, nodes)) => {
            mesh.connectivity.extend(nodes);
            kind
        }
        None => {
            mesh.connectivity.push(u32::try_from(outward.len()).ok()?);
            for face in outward {
                mesh.connectivity.push(u32::try_from(face.len()).ok()?);
                mesh.connectivity.extend(face);
            }
            CellKind::POLYHEDRON
        }
    };
    mesh.offsets
        .push(u32::try_from(mesh.connectivity.len()).ok()?);
    mesh.kinds.push(kind);
    Some(())
}

/// The cell of fixed shape with these faces, and its nodes in VTK's order. The faces' nodes are anticlockwise
/// seen from outside.
fn shape(faces: &[Vec<u32>]) -> Option<(CellKind, Vec<u32>)> {
    let triangles = faces.iter().filter(|face| face.len() == 3).count();
    let quads = faces.iter().filter(|face| face.len() == 4).count();
    if triangles + quads != faces.len() {
        return None;
    }
    let (kind, base_size) = match (triangles, quads) {
        (4, 0) => (CellKind::TETRA, 3),
        (0, 6) => (CellKind::HEXAHEDRON, 4),
        (2, 3) => (CellKind::WEDGE, 3),
        (4, 1) => (CellKind::PYRAMID, 4),
        _ => return None,
    };
    let base = faces.iter().find(|face| face.len() == base_size)?;
    let mut nodes = base.clone();
    // VTK orders the base so that the rest lies above it, except for wedges.
    if kind != CellKind::WEDGE {
        nodes.reverse();
    }
    let above: Vec<u32> = nodes
        .iter()
        .map(|&node| above(faces, base, node))
        .collect::<Option<_>>()?;
    match kind {
        CellKind::TETRA | CellKind::PYRAMID => nodes.push(above[0]),
        _ => nodes.extend(above),
    }
    // Other shapes have the same numbers of faces of these sizes, too.
    let sorted = |face: &mut Vec<u32>| face.sort_unstable();
    let mut found = faces.to_vec();
    found.iter_mut().for_each(sorted);
    found.sort();
    let of_kind = kind.faces()?.iter();
    let corners = |face: &&[u8]| face.iter().map(|&c| nodes[usize::from(c)]).collect();
    let mut expected: Vec<Vec<u32>> = of_kind.map(corners).collect();
    expected.iter_mut().for_each(sorted);
    expected.sort();
    (found == expected).then_some((kind, nodes))
}

/// The node outside the base that an edge joins to a node of the base.
fn above(faces: &[Vec<u32>], base: &[u32], node: u32) -> Option<u32> {
    let of_face = |face: &Vec<u32>| {
        let at = face.iter().position(|&n| n == node)?;
        let last = face.len() - 1;
        let beside = [
            face[if at == 0 { last } else { at - 1 }],
            face[if at == last { 0 } else { at + 1 }],
        ];
        beside.into_iter().find(|n| !base.contains(n))
    };
    faces.iter().find_map(of_face)
}
