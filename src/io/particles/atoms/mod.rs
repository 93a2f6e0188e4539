//! Reads atoms and grains as text: dumps of LAMMPS, extended XYZ, and `.gro` of GROMACS. A file is a sequence of frames,
//! each of which is a time step.
//!
//! Frames are read line by line. Only the rows of the frame that is asked for are parsed; of the others, the number of
//! lines counts.

mod cell;
mod columns;
mod elements;
mod frames;
pub(in crate::io) mod gro;
pub(in crate::io) mod lammps;
mod lines;
pub(in crate::io) mod xyz;
