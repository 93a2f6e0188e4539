//! How the one tolerance is shared out among the approximations: the one place.
//!
//! The promise is of pictures: 99.9 of 100 pixels differ from the same scene with everything exact by
//! less than the tolerance, and the others by a small multiple ([`WORST_PIXEL`]); `tests/frames/promise.rs`
//! holds it on every fixture and data set. Bounds are of kernels, so each share says what many
//! kernels make of one kernel's error:
//!
//! - Cut-off ([`CUTOFF_SHARE`]): what the edges of overlapping kernels leave out adds up, since it has one
//!   sign where a pixel sees tails alone; two to five times one kernel's share was measured.
//! - Affine footprints ([`AFFINE_SHARE`]): neighbours err alike, relative to their own depth, so that the error
//!   of the sum is that of one; half of the bound was measured.
//! - Filters that leave something out ([`FILTER_SHARE`]): as affine footprints, of which they are a kind; a
//!   block may have both.
//! - Merging ([`MERGE_SHARE`]): moves mass about within a cluster, to either side alike, so that the
//!   errors of many add up as their root; of a cluster by itself all of it is seen. What a transfer
//!   function makes of a cluster's values is averaged as if they were spread evenly between two ends:
//!   where they are not, the error has one sign along a ray ([`MISREAD_SHARE`]).
//! - Giving a tile up ([`TERMINATION_SHARE`](crate::constants::TERMINATION_SHARE)): once per pixel.
//!
//! Worst cases rarely meet in a pixel, so the shares need not add up to 1.

/// Of the cut-off at the edge of a kernel.
pub const CUTOFF_SHARE: f32 = 0.25;

/// So many kernels end together where data lie as they are meant to; of more, as where thousands lie in
/// one place, a block knows ([`Block::crowding`](crate::blocks::Block::crowding)), and each ends as if it
/// were as many times deeper.
///
/// Opaque kernels side by side, as in a sheet, leave so many tails in a pixel at the sheet's rim: with
/// one alone the paper's checkerboard errs by 3.8 tolerances in one pixel of a thousand.
pub const OVERLAP: f32 = 6.0;

/// So many times as many kernels as lie in one place may end in one pixel: along a line, or over a sheet, more are seen
/// at its rim than within a deviation of one of them (2.5 and 6.3 times as many), and blocks cut places apart. Of 3,000
/// kernels on a ring the cut-off left 5 tolerances in one pixel of a thousand without it.
pub const MEETING: f32 = 8.0;

/// Below a pixel the low-pass filter heaps neighbours upon one another, as many as it has enlarged
/// their area: their depth together is what ends them. At most so many: a kernel without width has
/// no area to enlarge.
pub const GREATEST_ENLARGEMENT: f32 = 256.0;

/// Of the affine footprint.
pub const AFFINE_SHARE: f32 = 0.5;

/// Of a footprint without low-pass filter, of the low-pass filter alone, of a round one.
pub const FILTER_SHARE: f32 = 0.25;

/// Of drawing a cluster as one particle.
pub const MERGE_SHARE: f32 = 1.0;

/// No pixel errs by more than so many tolerances.
pub const WORST_PIXEL: f32 = 4.0;

/// A cluster errs by this times the norm of its third central moments at most, as a share of its
/// peak, in units of the standard deviation that its members share: the third derivative of a
/// Gaussian over 3! has norm .284 at most.
pub const MERGE_THIRD: f32 = 0.284;

/// By this times the norm of its fourth cumulants: 3/4! = .125 along an axis; .2 covers all
/// directions and what higher orders add (3,000 random clusters: .84 of the sum of both at most).
pub const MERGE_FOURTH: f32 = 0.2;

/// By this times contrast and width where colours vary within a cluster: .607 is the greatest slope
/// of a Gaussian, and what a cluster shifts to one side its neighbour shifts back.
pub const CONTRAST_SHARE: f32 = 0.2;

/// By this times contrast and the depth of a layer of clusters, because front and back of it become
/// one colour: sqrt(3)/6 for colours that change linearly through the layer.
pub const MIXED_SHARE: f32 = 0.289;

/// Where a transfer function is averaged over a cluster's values, by this times the error of the
/// average as a share of the greatest extinction ([`MergeBounds::uneven`](crate::blocks::MergeBounds)
/// times the function's slope): the greatest of T exp(-T), since all clusters along a ray of depth T may
/// err alike. Of scans of bodies with sharp faces the 99.9th percentile was 60 tolerances without this
/// term and is .34 with it (`tests/frames/promise.rs`).
pub const MISREAD_SHARE: f32 = 0.37;

/// Colours that change from layer to layer by more than this times the root of a layer's depth do not
/// go on changing one way through all the layers that are seen: there the errors of layers are of
/// either sign, and add up as their root.
pub const TREND: f32 = 0.2;

/// Of the errors of many clusters in a pixel this times their root is left, because what one moves
/// to a side its neighbours move back: an eighth to a quarter was measured.
pub const MANY_SHARE: f32 = 0.25;
