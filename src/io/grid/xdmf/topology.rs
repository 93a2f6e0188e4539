//! Reads the cells of a `Topology`.
//!
//! | kinds | `TopologyType` | numbers |
//! |---|---|---|
//! | one | `Triangle`, `Tetrahedron_10`, ... | the nodes of each element |
//! | several | `Mixed` | of each element the number of its kind, for points, lines and polygons a count, then nodes; for polyhedra the faces, each with a count |
//! | structured | `3DCoRectMesh`, `3DRectMesh`, `3DSMesh`, and `2D...` | none: `Dimensions` are the nodes along each axis, the slowest first |
//!
//! Nodes of quadratic elements are in VTK's order.

use crate::data::cells::{CellKind, CellMesh};
use crate::error::Result;
use crate::io::grid::zones::push_cell;

/// A kind of elements: its names, its number in mixed lists, VTK's number for it and its number of nodes, or 0 for any.
struct Kind {
    names: &'static [&'static str],
    number: i64,
    cell: u8,
    nodes: usize,
}

const fn kind(names: &'static [&'static str], number: i64, cell: u8, nodes: usize) -> Kind {
    Kind {
        names,
        number,
        cell,
        nodes,
    }
}

/// Number of a polyhedron in mixed lists.
const POLYHEDRON: i64 = 16;

static KINDS: [Kind; 22] = [
    kind(&["polyvertex"], 1, 2, 0),
    kind(&["polyline"], 2, 4, 0),
    kind(&["polygon"], 3, 7, 0),
    kind(&["triangle"], 4, 5, 3),
    kind(&["quadrilateral"], 5, 9, 4),
    kind(&["tetrahedron"], 6, 10, 4),
    kind(&["pyramid"], 7, 14, 5),
    kind(&["wedge"], 8, 13, 6),
    kind(&["hexahedron"], 9, 12, 8),
    kind(&["edge_3"], 34, 21, 3),
    kind(&["quadrilateral_9", "quad_9"], 35, 28, 9),
    kind(&["triangle_6", "tri_6"], 36, 22, 6),
    kind(&["quadrilateral_8", "quad_8"], 37, 23, 8),
    kind(&["tetrahedron_10", "tet_10"], 38, 24, 10),
    kind(&["pyramid_13"], 39, 27, 13),
    kind(&["wedge_15"], 40, 26, 15),
    kind(&["wedge_18"], 41, 32, 18),
    kind(&["hexahedron_20", "hex_20"], 48, 25, 20),
    kind(&["hexahedron_24", "hex_24"], 49, 33, 24),
    kind(&["hexahedron_27", "hex_27"], 50, 29, 27),
    kind(&["interval"], 0, 3, 2),
    kind(&["mixed"], 0, 0, 0),
];

/// Kind of cells of a topology.
pub(super) enum Topology {
    /// Elements of one kind: VTK's number, and the number of nodes, or 0 where the element states it.
    One(CellKind, usize),
    Mixed,
    /// Nodes at equal steps.
    Uniform,
    /// Nodes where lines across the axes meet.
    Rectilinear,
    /// Nodes anywhere.
    Curvilinear,
}

/// Returns the topology of this name.
pub(super) fn of(name: &str) -> Option<Topology> {
    let name = name.trim().to_ascii_lowercase();
    Some(match name.as_str() {
        "mixed" => Topology::Mixed,
        "3dcorectmesh" | "2dcorectmesh" => Topology::Uniform,
        "3drectmesh" | "2drectmesh" => Topology::Rectilinear,
        "3dsmesh" | "2dsmesh" => Topology::Curvilinear,
        other => {
            let found = KINDS.iter().find(|kind| kind.names.contains(&other))?;
            Topology::One(CellKind(found.cell), found.nodes)
        }
    })
}

/// Reads elements of one kind.
///
/// - `node`: converts a stored number to the index of a node.
pub(super) fn of_one_kind(
    path: &std::path::Path,
    mesh: &mut CellMesh,
    cell: CellKind,
    per_element: usize,
    numbers: &[i64],
    node: &dyn Fn(i64) -> Result<u32>,
) -> Result<()> {
    for element in numbers.chunks(per_element) {
        // Two nodes in a row are a line.
        let kind = match (cell, per_element) {
            (CellKind::POLY_LINE, 2) => CellKind::LINE,
            (CellKind::POLY_VERTEX, 1) => CellKind::VERTEX,
            _ => cell,
        };
        for &number in element {
            mesh.connectivity.push(node(number)?);
        }
        push_cell(path, mesh, kind)?;
    }
    Ok(())
}

/// Reads a mixed list.
///
/// - `fault`: makes an error from what was expected and found.
pub(super) fn mixed(
    path: &std::path::Path,
    mesh: &mut CellMesh,
    numbers: &[i64],
    node: &dyn Fn(i64) -> Result<u32>,
    fault: &dyn Fn(&str, String) -> crate::error::Error,
) -> Result<()> {
    let mut rest = numbers;
    let take = |rest: &mut &[i64]| -> Result<i64> {
        let (&first, others) = rest.split_first().ok_or_else(|| {
            fault(
                "more numbers of an element",
                "the end of the list".to_owned(),
            )
        })?;
        *rest = others;
        Ok(first)
    };
    let count = |number: i64| -> Result<usize> {
        let count = usize::try_from(number).ok().filter(|&n| n > 0);
        count.ok_or_else(|| fault("a count of nodes or faces", number.to_string()))
    };
    while !rest.is_empty() {
        let number = take(&mut rest)?;
        if number == POLYHEDRON {
            let faces = count(take(&mut rest)?)?;
            mesh.connectivity.push(small(faces, fault)?);
            for _ in 0..faces {
                let corners = count(take(&mut rest)?)?;
                mesh.connectivity.push(small(corners, fault)?);
                for _ in 0..corners {
                    mesh.connectivity.push(node(take(&mut rest)?)?);
                }
            }
            push_cell(path, mesh, CellKind::POLYHEDRON)?;
            continue;
        }
        let kind = KINDS
            .iter()
            .find(|kind| kind.number == number && number > 0);
        let kind =
            kind.ok_or_else(|| fault("the number of a kind of elements", number.to_string()))?;
        let nodes = match kind.nodes {
            0 => count(take(&mut rest)?)?,
            nodes => nodes,
        };
        for _ in 0..nodes {
            mesh.connectivity.push(node(take(&mut rest)?)?);
        }
        let cell = match (CellKind(kind.cell), nodes) {
            (CellKind::POLY_LINE, 2) => CellKind::LINE,
            (CellKind::POLY_VERTEX, 1) => CellKind::VERTEX,
            (cell, _) => cell,
        };
        push_cell(path, mesh, cell)?;
    }
    Ok(())
}

fn small(count: usize, fault: &dyn Fn(&str, String) -> crate::error::Error) -> Result<u32> {
    u32::try_from(count).map_err(|_| fault("fewer entries", count.to_string()))
}
