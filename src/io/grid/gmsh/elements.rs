//! Converts Gmsh's elements to cells in VTK's order of nodes.
//!
//! Corners have the same order in both. Gmsh numbers the nodes on the edges of solids by the lower corner of each edge,
//! and VTK from the bottom upwards, upright edges last. Sources: "Node ordering" and the list of types in Gmsh's
//! reference manual.

use crate::data::cells::CellKind;

/// A type of elements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element {
    pub(super) kind: CellKind,
    /// Number of nodes in the file.
    pub(super) node_count: usize,
    /// The nodes that the cell takes, in its order; `None` takes the first `taken`.
    pub(super) order: Option<&'static [u8]>,
    /// Number of nodes of the cell.
    pub(super) taken: usize,
    /// Whether it is of third order or above, of which only the corners are taken.
    pub(super) is_cut: bool,
}

const TETRAHEDRON_10: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 7, 9, 8];
const HEXAHEDRON_20: &[u8] = &[
    0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15,
];
/// After its edges Gmsh has bottom, front, left, right, back, top and the centre; VTK has left, right, front, back,
/// bottom, top and the centre.
const HEXAHEDRON_27: &[u8] = &[
    0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25,
    26,
];
const PRISM_15: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11];
const PRISM_18: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11, 15, 17, 16];
const PYRAMID_13: &[u8] = &[0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12];

/// The element type of this number in Gmsh; `None` for polygons, polyhedra and types without nodes of their own.
pub(super) fn element(number: i64) -> Option<Element> {
    let whole = |kind, node_count| {
        Some(Element {
            kind: CellKind(kind),
            node_count,
            order: None,
            taken: node_count,
            is_cut: false,
        })
    };
    let ordered = |kind, order: &'static [u8], node_count| {
        Some(Element {
            kind: CellKind(kind),
            node_count,
            order: Some(order),
            taken: order.len(),
            is_cut: false,
        })
    };
    match number {
        15 => return whole(1, 1),
        1 => return whole(3, 2),
        2 => return whole(5, 3),
        3 => return whole(9, 4),
        4 => return whole(10, 4),
        5 => return whole(12, 8),
        6 => return whole(13, 6),
        7 => return whole(14, 5),
        8 => return whole(21, 3),
        9 => return whole(22, 6),
        10 => return whole(28, 9),
        11 => return ordered(24, TETRAHEDRON_10, 10),
        12 => return ordered(29, HEXAHEDRON_27, 27),
        13 => return ordered(32, PRISM_18, 18),
        // The node in the middle of its base is left out: VTK's pyramid of 13 nodes has none there.
        14 => return ordered(27, PYRAMID_13, 14),
        16 => return whole(23, 8),
        17 => return ordered(25, HEXAHEDRON_20, 20),
        18 => return ordered(26, PRISM_15, 15),
        19 => return ordered(27, PYRAMID_13, 13),
        _ => {}
    }
    let of = |first: i64, counts: &[usize]| {
        let at = usize::try_from(number - first).ok()?;
        counts.get(at).copied()
    };
    // Types of orders 3 to 10: complete elements, and those without nodes inside.
    let triangle = || {
        of(20, &[9, 10, 12, 15, 15, 21])
            .or_else(|| of(42, &[28, 36, 45, 55, 66]))
            .or_else(|| of(52, &[18, 21, 24, 27, 30]))
    };
    let quadrilateral = || {
        of(36, &[16, 25, 36, 12, 16, 20])
            .or_else(|| of(47, &[49, 64, 81, 100, 121]))
            .or_else(|| of(57, &[24, 28, 32, 36, 40]))
    };
    let tetrahedron = || {
        of(29, &[20, 35, 56, 22, 28])
            .or_else(|| of(71, &[84, 120, 165, 220, 286]))
            .or_else(|| of(79, &[34, 40, 46, 52, 58]))
            .or_else(|| of(137, &[16]))
    };
    let hexahedron = || {
        of(92, &[64, 125, 216, 343, 512, 729, 1000])
            .or_else(|| of(99, &[32, 44, 56, 68, 80, 92, 104]))
    };
    let prism = || {
        of(90, &[40, 75])
            .or_else(|| of(106, &[126, 196, 288, 405, 550]))
            .or_else(|| of(111, &[24, 33, 42, 51, 60, 69, 78]))
    };
    let pyramid = || {
        of(118, &[30, 55, 91, 140, 204, 285, 385])
            .or_else(|| of(125, &[21, 29, 37, 45, 53, 61, 69]))
    };
    let line = || of(26, &[4, 5, 6]).or_else(|| of(62, &[7, 8, 9, 10, 11]));
    let found = |count: Option<usize>, kind, taken| count.map(|count| (kind, count, taken));
    let (kind, node_count, taken) = found(line(), 3, 2)
        .or_else(|| found(triangle(), 5, 3))
        .or_else(|| found(quadrilateral(), 9, 4))
        .or_else(|| found(tetrahedron(), 10, 4))
        .or_else(|| found(hexahedron(), 12, 8))
        .or_else(|| found(prism(), 13, 6))
        .or_else(|| found(pyramid(), 14, 5))?;
    Some(Element {
        kind: CellKind(kind),
        node_count,
        order: None,
        taken,
        is_cut: true,
    })
}
