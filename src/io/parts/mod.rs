//! Files that are read in parts: planes of a lattice, rows of points.

pub(super) mod plane_source;
pub(super) mod planes;
pub(super) mod rows;
