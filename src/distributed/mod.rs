//! One picture by many ranks, each of which has a share of the scene.
//!
//! Sort-middle: a rank culls, classifies and projects the particles that it has; their footprints travel to the ranks
//! that own the image's tiles; these sort them by depth, list them by tile and draw; the first rank gathers the tiles.
//! What crosses the network is footprints, and the picture is that of one machine, bit for bit, whatever the number of
//! ranks and wherever the particles are: blocks, levels of detail, depth keys and layers are those of the whole scene,
//! footprints are drawn in the order that one machine gives them, and sums are formed in its order.
//!
//! | file | subject |
//! |---|---|
//! | `communicator.rs` | what ranks say to one another |
//! | `threads.rs` | ranks that are threads of one process |
//! | `mpi.rs` | ranks that are processes (feature `mpi`) |
//! | `ranks.rs` | ranks that know of one another's failures |
//! | `message.rs` | records as bytes |
//! | `share.rs` | what each rank brings of a scene |
//! | `read.rs` | a file of points that ranks read together (feature `prepared`) |
//! | `rows.rs` | a file of points that look at their neighbours, whose rows ranks read together (feature `cli`) |
//! | `surroundings.rs` | points of other ranks among these neighbours (feature `cli`) |
//! | `pieces.rs` | an unstructured grid whose pieces ranks read together (feature `cli`) |
//! | `grid.rs` | a curvilinear grid in pieces, of which ranks get planes (feature `cli`) |
//! | `rings.rs` | cells of other ranks around these (feature `cli`) |
//! | `patch.rs` | some of its cells, as bytes (feature `cli`) |
//! | `planes.rs` | a lattice whose planes ranks read together (feature `cli`) |
//! | `shown.rs` | the function of a field of which each rank has some values (feature `cli`) |
//! | `scatter.rs` | volumes that one rank has, for all (feature `prepared`) |
//! | `head.rs` | what volumes have besides their particles (feature `prepared`) |
//! | `tiles.rs` | which rank draws which tiles |
//! | `exchange.rs` | footprints on their way |
//! | `frames.rs` | frames, stage after stage |
//! | `statistics.rs` | what each rank did |
//! | `renderer.rs` | a scene, and its pictures |

#![allow(
    clippy::cast_possible_truncation,
    reason = "places among footprints are 32-bit numbers by design, and counts that travel were usize where they come from"
)]

mod communicator;
mod exchange;
mod frames;
#[cfg(feature = "cli")]
mod grid;
#[cfg(feature = "prepared")]
mod head;
mod message;
#[cfg(feature = "mpi")]
mod mpi;
#[cfg(feature = "cli")]
mod patch;
#[cfg(feature = "cli")]
mod pieces;
#[cfg(feature = "cli")]
mod planes;
mod ranks;
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

pub use communicator::Communicator;
pub(crate) use frames::RankFrames;
#[cfg(feature = "cli")]
pub(crate) use grid::read_grid;
#[cfg(feature = "cli")]
pub(crate) use message::{put, take, unknown};
#[cfg(feature = "mpi")]
pub use mpi::MpiRank;
#[cfg(feature = "cli")]
pub(crate) use pieces::{dealt, read_pieces};
#[cfg(feature = "cli")]
pub(crate) use planes::read_planes;
pub(crate) use ranks::Ranks;
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
