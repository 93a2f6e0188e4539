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
#[cfg(feature = "mpi")]
mod mpi;
pub(crate) mod renderer;
mod share;
mod statistics;
mod threads;
mod tiles;

pub use crate::collective::{Alone, Collective};
pub(crate) use frames::RankFrames;
#[cfg(feature = "mpi")]
pub use mpi::{MpiGuard, MpiRank};
pub use renderer::Renderer;
pub use share::Share;
pub(crate) use share::{SMALL, is_small};
pub use statistics::{RankStats, RankTimes};
pub use threads::ThreadRank;
