//! Reads files in parts, some on each rank, or samples data of which each rank holds a part. The ranks make the particles
//! that one process makes of the whole.
//!
//! | file | subject |
//! |---|---|
//! | `point_file.rs` | points that are sampled row by row |
//! | `rows.rs` | points that are sampled by their neighbours |
//! | `halo.rs` | halo of these points: neighbours on other ranks |
//! | `pieces.rs` | an unstructured grid in pieces |
//! | `ghost_layers.rs` | ghost layers of its cells |
//! | `cell_subset.rs` | encoding of some of its cells as bytes |
//! | `grid.rs` | a curvilinear grid in pieces, sampled by planes |
//! | `planes.rs` | a lattice, by planes |
//! | `values.rs` | encoding of values as bytes |
//! | `held.rs` | data in memory, of which each rank holds a part |
//! | `found.rs` | sum of the reports of all ranks |
//! | `function.rs` | transfer function chosen from the values of all ranks |
//! | `scatter.rs` | scattering of volumes that one rank holds |
//! | `metadata.rs` | metadata of volumes: everything but their particles |

#![allow(
    clippy::cast_possible_truncation,
    reason = "indices of points and cells are 32-bit numbers by design, and counts that travel were usize where they come from"
)]

mod cell_subset;
mod found;
mod function;
mod ghost_layers;
mod grid;
mod halo;
mod held;
mod metadata;
mod pieces;
mod planes;
mod point_file;
mod rows;
mod scatter;
mod values;

pub(crate) use function::PartRead;
pub(crate) use function::outline_of_all;
pub(crate) use grid::read_grid;
pub(crate) use held::held_together;
pub(crate) use pieces::{assigned, read_pieces};
pub(crate) use planes::read_planes;
pub(crate) use point_file::read_together;
pub(crate) use rows::read_rows;
pub(crate) use scatter::{distribute, scatter};
