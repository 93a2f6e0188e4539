//! The data model: data sets, cells, meshes, splats, and what their files say of units, axes and particles.

pub(crate) mod association;
pub(crate) mod blanking;
mod cell_check;
pub(crate) mod cells;
pub(crate) mod colour_columns;
pub(crate) mod dataset;
pub(crate) mod element;
pub(crate) mod first_order;
pub(crate) mod gas;
pub(crate) mod handedness;
pub(crate) mod mesh;
pub(crate) mod particle_type;
pub(crate) mod polyhedron;
pub(crate) mod shape_columns;
pub(crate) mod smoothing;
pub(crate) mod splats;
pub(crate) mod spz_records;
mod temperature;
pub(crate) mod unit;
pub(crate) mod up;
pub(crate) mod vectors;
