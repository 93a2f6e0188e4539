//! Defines the structs that the stages of a frame exchange. They are plain words, so that any back end
//! can write and read them.
//!
//! | struct | written by | read by |
//! |---|---|---|
//! | [`ViewUniform`] | the frame's set-up | project, rasterise |
//! | [`CameraUniform`] | the frame's set-up (GPU) | cull, shade, project |
//! | [`LightingUniform`] | the frame's set-up | light |
//! | [`ShadowUniform`] | the frame's set-up | light |
//! | [`DeviceBlock`] | the upload (GPU) | cull, classify, project |
//! | [`LatticeUniform`] | the upload (GPU) | classify, shade, project |
//! | [`BrickUniform`] | the upload (GPU) | classify |
//! | [`FrameState`] | cull, classify (GPU) | cull, the frame |
//! | [`PartState`] | cull, classify (GPU) | classify, shade, project, the frame |
//! | [`ChoiceUniform`] | the frame's set-up | cull |
//! | [`MergedBlock`] | cull (GPU) | cull |
//! | [`BlockView`] | cull (places, filters), classify (counts) | classify, project |
//! | [`ClassifiedParticle`] | classify | project |
//! | [`PieceTerms`] | classify, over extents | project |
//! | [`Footprint`] | project | sort, bin, rasterise |
//! | [`ExactTerms`] | project, for exact footprints | bin, rasterise |
//! | [`SurfelTerms`] | project, for surfels of opaque surfaces | rasterise |
//! | [`NearTerms`] | project, for kernels that cross the camera plane | bin, rasterise |
//! | [`PartIndex`] | the upload (GPU) | sort, gather |
//! | [`PartRange`] | sort (GPU) | sort, gather |
//! | [`SortState`] | sort (GPU) | gather |
//! | [`ChunkUniform`] | the frame's set-up (GPU) | gather, bin |
//! | [`ChunkState`] | gather, bin (GPU) | gather, bin |

mod block;
mod footprint;
mod shadow;
mod state;
mod terms;
mod view;

pub use block::{
    BlockView, BrickUniform, ClassifiedBy, ClassifiedParticle, DeviceBlock, LatticeUniform,
    MERGED_FITS, MERGED_OPEN, MERGED_UNSEEN, MergedBlock,
};
pub use footprint::{
    Carried, Footprint, PATH_AFFINE, PATH_CAPPED, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR,
    PATH_NEAR_SURFEL, PATH_PEAK, PATH_SURFEL, pack_range,
};
pub use shadow::{LightShadow, ShadowUniform};
pub use state::{ChunkState, ChunkUniform, FrameState, PartIndex, PartRange, PartState, SortState};
pub use terms::{ExactTerms, FootprintTerms, NearTerms, PieceTerms, RAY_EDGES, SurfelTerms};
pub use view::{CameraUniform, ChoiceUniform, KeyKind, LightUniform, LightingUniform, ViewUniform};
