//! Surfaces with fields: boundaries, iso-surfaces, cut faces, hulls, discs.

pub(crate) mod boundary;
pub(crate) mod cut_faces;
pub(crate) mod discs;
pub(crate) mod flat_grid;
pub(crate) mod hull;
pub(crate) mod iso_surface;
pub(crate) mod mesh_field;
