//! Sorts particles into blocks, so that a frame can cull many at once.
//!
//! | file | subject |
//! |---|---|
//! | `amplitude.rs` | amplitudes, which column densities sum |
//! | `block.rs` | a block: a run of particles and their bounds |
//! | `brick.rs` | a lattice cut into bricks of cells, nothing reordered, nothing stored |
//! | `brick_blocks.rs` | blocks of a lattice: the bounds of its bricks |
//! | `build.rs` | blocks of a point set: subtrees of a BVH |
//! | `merge/` | level of detail: clusters of particles, each drawn as one particle |
//! | `merged.rs` | data of merged particles |
//! | `options.rs` | options for preparing scenes and volumes |
//! | `overlap.rs` | overlap counts: the most kernels in one place |
//! | `partitioned/` | blocks of points or of a lattice that is partitioned among ranks |
//! | `choose.rs` | choice of a filter, and of merged particles |
//! | `coarser.rs` | lattices of half as many samples along each axis, and the errors of their blocks |
//! | `cull.rs` | culling: the blocks that a frame sees |
//! | `density.rs` | density of the blocks' kernels |
//! | `extent.rs` | kernels that are classified over their extents |
//! | `halo.rs` | halo of a brick: the field around a lattice's cells |
//! | `neighbours.rs` | particles that slabs leave invisible, by the values around them |
//! | `layers.rs` | the sheets and slabs in which kernels are summed |
//! | `points.rs` | a point set as columns |
//! | `room.rs` | storage of columns while a scene is made: in memory or on disk |
//! | `rule.rs` | rule by which particles are drawn: as kernels, splats or surfels |
//! | `scene.rs` | all volumes of a scene |
//! | `share.rs` | partition of a scene's blocks among owners |
//! | `source.rs` | the particles of which blocks and levels of detail are made |
//! | `stream.rs` | points that arrive a part at a time, sorted on disk |
//! | `transfer.rs` | change of a transfer function |
//! | `tree.rs` | a BVH over particles, built by obvhs in chunks |
//! | `volume.rs` | a volume in blocks |

#![allow(
    clippy::cast_possible_truncation,
    reason = "positions become f32 offsets here by design, and counts were checked to fit u32"
)]

mod amplitude;
mod block;
mod brick;
mod brick_blocks;
mod build;
mod choose;
mod coarser;
mod cull;
mod density;
mod extent;
mod halo;
mod layers;
mod merge;
mod merged;
mod neighbours;
mod options;
mod overlap;
mod partitioned;
mod points;
mod room;
mod rule;
mod scene;
mod share;
mod source;
#[cfg(feature = "prepared")]
mod stream;
mod transfer;
mod tree;
mod volume;

pub use amplitude::AmplitudeSummary;
pub(crate) use amplitude::visit_amplitudes;
pub use block::{Block, NO_PARENT};

pub use brick::{AxisSample, BrickGrid};
pub(crate) use build::check_count;
pub use choose::choose;
pub(crate) use coarser::BlockError;
pub(crate) use cull::tiles_of;
#[cfg(feature = "gpu")]
pub(crate) use cull::{DEPTH_KEY_SPAN, PIECE_REACH};
pub use cull::{DepthRange, Frustum, cull, cull_detail, cull_outside, distance_interval};
#[cfg(feature = "gpu")]
pub(crate) use extent::THICKEST_SLAB;
pub(crate) use halo::Halo;
pub(crate) use layers::MOST_SLABS;
pub use layers::{LayerKind, Layers};
pub use merged::{MergeBounds, Merged, MergedTransfer};
pub(crate) use neighbours::Neighbours;
pub use options::SceneOptions;
pub(crate) use partitioned::{
    Held, LEAST, PlaneRuns, SharedVolume, assign_by_position, build_lattice_together,
    build_together,
};
pub(crate) use rule::Rule;
pub use scene::BlockedScene;
#[cfg(feature = "prepared")]
pub(crate) use scene::KeptOfVolume;
pub(crate) use share::runs_in_turn;
#[cfg(feature = "prepared")]
pub use stream::ParticleStream;
pub use volume::{BlockedParticles, BlockedVolume};
