//! VTK's files: XML, legacy, collections, pieces.

pub(super) mod amr;
pub(super) mod array;
pub(super) mod codec;
pub(super) mod collection;
pub(super) mod extent;
pub(super) mod file_series;
pub(super) mod grid;
pub(super) mod legacy;
pub(super) mod meshes;
pub(super) mod pieces;
pub(super) mod pvd;
pub(super) mod surface;
pub(super) mod vti;
pub(super) mod vti_planes;
pub(super) mod vtp;
pub(super) mod vtr;
pub(super) mod vts;
pub(super) mod vts_pieces;
pub(super) mod vtu;
pub(super) mod vtu_pieces;
pub(super) mod vtu_write;
pub(super) mod xml;
pub(super) mod xml_kinds;
