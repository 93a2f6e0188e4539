//! Converts elements of CGNS to cells in VTK's order of nodes.
//!
//! Corners and edges are ordered as in Exodus: edges of the bottom, upright edges, edges of the top, then faces from the
//! bottom upwards. Source: "Element Numbering Conventions" of the CGNS/SIDS.

use crate::data::cells::CellKind;
use crate::io::grid::orders::{HEXAHEDRON_20, WEDGE_15, WEDGE_18};

/// Number of a list of elements of several types.
pub(super) const MIXED: i64 = 20;
/// Number of polygons.
pub(super) const NGON: i64 = 22;
/// Number of polyhedra, which name polygons.
pub(super) const NFACE: i64 = 23;

/// A type of elements.
pub(super) struct Element {
    pub(super) kind: CellKind,
    pub(super) node_count: usize,
    /// The nodes that the cell takes, in its order; `None` takes all.
    pub(super) order: Option<&'static [u8]>,
}

/// After its edges CGNS has bottom, front, right, back, left, top and the centre; VTK has left, right, front, back,
/// bottom, top and the centre.
const HEXAHEDRON_27: &[u8] = &[
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 12, 13, 14, 15, 24, 22, 21, 23, 20, 25,
    26,
];
/// Without the node in the middle of its base.
const PYRAMID_13: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

/// The element type of this number; `None` for those of third order and above.
pub(super) fn element(number: i64) -> Option<Element> {
    let (kind, node_count, order) = match number {
        2 => (1, 1, None),
        3 => (3, 2, None),
        4 => (21, 3, None),
        5 => (5, 3, None),
        6 => (22, 6, None),
        7 => (9, 4, None),
        8 => (23, 8, None),
        9 => (28, 9, None),
        10 => (10, 4, None),
        11 => (24, 10, None),
        12 => (14, 5, None),
        13 => (27, 14, Some(PYRAMID_13)),
        14 => (13, 6, None),
        15 => (26, 15, Some(WEDGE_15)),
        16 => (32, 18, Some(WEDGE_18)),
        17 => (12, 8, None),
        18 => (25, 20, Some(HEXAHEDRON_20)),
        19 => (29, 27, Some(HEXAHEDRON_27)),
        21 => (27, 13, None),
        _ => return None,
    };
    Some(Element {
        kind: CellKind(kind),
        node_count,
        order,
    })
}
