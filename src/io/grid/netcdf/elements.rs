//! Converts elements of Exodus II to cells in VTK's order of nodes.
//!
//! Exodus numbers corners as VTK does. It orders midside nodes of solids from the bottom upwards: edges of the
//! bottom, upright edges, edges of the top; VTK has the upright edges last. Types are recognised by the first
//! letters of their names and by their number of nodes (Schoof and Yarberry, *EXODUS II: A Finite Element Data
//! Model*, SAND92-2137, and its later tables of elements).

use crate::data::cells::CellKind;
use crate::io::grid::orders::{HEXAHEDRON_20, WEDGE_15, WEDGE_18};

/// A type of elements: the kind of its cells, and the order in which a cell takes the element's nodes.
pub(super) struct Element {
    pub(super) kind: CellKind,
    /// `None`: all nodes, in the file's order.
    pub(super) order: Option<&'static [u8]>,
}

const FIRST_15: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14];

/// After its edges Exodus has the centre, then bottom, top, left, right, front and back.
const HEXAHEDRON_27: &[u8] = &[
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22,
    20,
];

/// The element type with this name and number of nodes; `None` if it is not known.
pub(super) fn element(name: &str, nodes: usize) -> Option<Element> {
    let name = name.trim().to_ascii_uppercase();
    let is = |starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
    // Nodes in the middle of faces and solids that VTK's cells lack are left out.
    let first = |count: usize| FIRST_15.get(..count);
    let (kind, order) = if is(&["SPH", "CIR"]) {
        (1, first(1))
    } else if is(&["TRU", "BEA", "BAR", "EDG", "CUR", "ROD", "LIN"]) {
        match nodes {
            2 => (3, None),
            3 => (21, None),
            _ => return None,
        }
    } else if is(&["TRI"]) || is(&["SHE"]) && matches!(nodes, 3 | 6 | 7) {
        match nodes {
            3 => (5, None),
            4 => (5, first(3)),
            6 => (22, None),
            7 => (34, None),
            _ => return None,
        }
    } else if is(&["QUA", "SHE"]) {
        match nodes {
            4 => (9, None),
            5 => (9, first(4)),
            8 => (23, None),
            9 => (28, None),
            _ => return None,
        }
    } else if is(&["TET"]) {
        match nodes {
            4 => (10, None),
            5 | 8 => (10, first(4)),
            10 => (24, None),
            11 | 14 | 15 => (24, first(10)),
            _ => return None,
        }
    } else if is(&["HEX"]) {
        match nodes {
            8 => (12, None),
            9 => (12, first(8)),
            20 | 21 => (25, Some(HEXAHEDRON_20)),
            27 => (29, Some(HEXAHEDRON_27)),
            _ => return None,
        }
    } else if is(&["WED", "PRI"]) {
        match nodes {
            6 => (13, None),
            7 => (13, first(6)),
            15 | 16 | 20 | 21 => (26, Some(WEDGE_15)),
            18 => (32, Some(WEDGE_18)),
            _ => return None,
        }
    } else if is(&["PYR"]) {
        match nodes {
            5 => (14, None),
            6 => (14, first(5)),
            13 => (27, None),
            14 | 18 | 19 => (27, first(13)),
            _ => return None,
        }
    } else {
        return None;
    };
    let kind = CellKind(kind);
    Some(Element { kind, order })
}
