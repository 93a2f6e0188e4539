//! Holds orders of nodes that several formats share.
//!
//! CGNS and Exodus order the nodes on edges of solids from the bottom upwards: edges of the bottom, upright edges, edges of
//! the top. VTK has the upright edges last.

pub(super) const HEXAHEDRON_20: &[u8] = &[
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 12, 13, 14, 15,
];
pub(super) const WEDGE_15: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11];
pub(super) const WEDGE_18: &[u8] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11, 15, 16, 17];
