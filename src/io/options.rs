//! Defines the options for opening data files.

use std::path::PathBuf;

use super::splats::log_scales::ScaleMeaning;
use super::volume::raw::RawLayout;
use crate::data::particle_type::ParticleType;

/// Settings for [`open`](super::open): properties of the data that the file does not state, and choices among its contents.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Layout of a raw volume; other formats ignore it.
    pub raw: Option<RawLayout>,
    /// Solution of a PLOT3D grid, or its function file. If absent, the reader looks for it beside the grid. Other
    /// formats ignore it.
    pub solution: Option<PathBuf>,
    /// Texture image for the parts of an OBJ or PLY mesh that have texture coordinates but no texture. Other formats
    /// ignore it.
    pub texture: Option<PathBuf>,
    /// Geometry to read from a file that may hold points or a mesh. If absent, a file with faces is read as a mesh. A
    /// file that cannot be read this way is refused.
    pub read_as: Option<ReadAs>,
    /// Type of the particles to read from a snapshot with several types. If absent, gas is read, or else the first type
    /// in the file; from Phantom files, everything but the sinks. A file without particles of this type is refused, and
    /// so is a file of another format.
    pub particle_type: Option<ParticleType>,
    /// Meaning of the scales of splats in glTF files and of the columns `scale_0..2` of tables. If absent, they are
    /// logarithms if any is negative, and standard deviations otherwise. Data without such scales are refused.
    pub scales: Option<ScaleMeaning>,
    /// Time step to read from a file with several, counted from 0 ([`Format::time_steps`](super::Format::time_steps)). If absent, the first is
    /// read and a note states this. Other formats ignore it.
    pub time_step: Option<usize>,
}

/// Geometry to read from points with faces: from PLY files, and from VTK files with flat cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadAs {
    /// Particles, with all attributes of the points as fields.
    Points,
    /// A mesh.
    Mesh,
}
