//! Renders one image of a scene that is partitioned among ranks (MPI processes or threads).
//!
//! The method is sort-middle parallel rendering. A frame takes four steps:
//!
//! 1. Each rank culls, classifies and projects the particles that it holds.
//! 2. Each rank sends the footprints to the ranks that own the image tiles which they touch.
//! 3. Each rank sorts the footprints of its tiles by depth, lists them by tile and draws them.
//! 4. The first rank gathers the tiles.
//!
//! Ranks exchange footprints and finished tiles during a frame, never particles.
//!
//! The image is bit for bit that of a single rank, for any number of ranks and any partition of the particles. To that
//! end, blocks, levels of detail, depth keys and layers are those of the whole scene. Footprints are drawn, and sums
//! are formed, in the order of a single rank.
//!
//! All communication is collective: every rank calls the same functions in the same order ([`Collective`]). A rank
//! that fails sends its error in place of its data.
//!
//! | file | subject |
//! |---|---|
//! | `threads.rs` | ranks that are threads of one process |
//! | `mpi.rs` | ranks that are processes (feature `mpi`) |
//! | `share.rs` | the part of a scene that a rank contributes, and blocks made of all parts |
//! | `read.rs` | parallel reading of a file of points, by rows (feature `prepared`) |
//! | `rows.rs` | parallel reading of points that are sampled by their neighbours (feature `cli`) |
//! | `surroundings.rs` | halo of these points: neighbours on other ranks (feature `cli`) |
//! | `pieces.rs` | parallel reading of an unstructured grid in pieces (feature `cli`) |
//! | `rings.rs` | ghost layers of its cells (feature `cli`) |
//! | `patch.rs` | encoding of some of its cells as bytes (feature `cli`) |
//! | `grid.rs` | parallel reading of a curvilinear grid in pieces, sampled by planes (feature `cli`) |
//! | `planes.rs` | parallel reading of a lattice, by planes (feature `cli`) |
//! | `shown.rs` | transfer function chosen from the values of all ranks (feature `cli`) |
//! | `scatter.rs` | scattering of volumes that one rank holds (feature `prepared`) |
//! | `head.rs` | metadata of volumes: everything but their particles (feature `prepared`) |
//! | `tiles.rs` | assignment of tiles to ranks |
//! | `exchange.rs` | exchange of footprints |
//! | `frames.rs` | stages of a frame |
//! | `statistics.rs` | counts and times of each rank |
//! | `renderer.rs` | the public renderer |

#![allow(
    clippy::cast_possible_truncation,
    reason = "places among footprints are 32-bit numbers by design, and counts that travel were usize where they come from"
)]

mod exchange;
mod frames;
#[cfg(feature = "cli")]
mod grid;
#[cfg(feature = "prepared")]
mod head;
#[cfg(feature = "mpi")]
mod mpi;
#[cfg(feature = "cli")]
mod patch;
#[cfg(feature = "cli")]
mod pieces;
#[cfg(feature = "cli")]
mod planes;
#[cfg(feature = "prepared")]
mod read;
mod renderer;
#[cfg(feature = "cli")]
mod rings;
#[cfg(feature = "cli")]
mod rows;
#[cfg(feature = "prepared")]
mod scatter;
mod share;
#[cfg(feature = "cli")]
mod shown;
mod statistics;
#[cfg(feature = "cli")]
mod surroundings;
mod threads;
mod tiles;

pub use crate::collective::{Alone, Collective};
pub(crate) use frames::RankFrames;
#[cfg(feature = "cli")]
pub(crate) use grid::read_grid;
#[cfg(feature = "mpi")]
pub use mpi::MpiRank;
#[cfg(feature = "cli")]
pub(crate) use pieces::{dealt, read_pieces};
#[cfg(feature = "cli")]
pub(crate) use planes::read_planes;
#[cfg(feature = "cli")]
pub(crate) use read::read_together;
pub use renderer::Renderer;
#[cfg(feature = "cli")]
pub(crate) use renderer::shared;
#[cfg(feature = "cli")]
pub(crate) use rows::read_rows;
#[cfg(feature = "cli")]
pub(crate) use scatter::{hand_out, scatter};
pub use share::Share;
#[cfg(feature = "cli")]
pub(crate) use shown::PartRead;
pub use statistics::{RankStats, RankTimes};
pub use threads::ThreadRank;
