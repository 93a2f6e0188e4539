//! Divides the tolerance among the approximations. All shares are defined here.
//!
//! The promise concerns pictures: 99.9 of 100 pixels differ from the same scene with everything exact by
//! less than the tolerance, and the others by a small multiple ([`WORST_PIXEL`]).
//! `tests/frames/promise.rs` checks it on every fixture and data set. The bounds concern single kernels,
//! so each share includes how the errors of many kernels combine:
//!
//! - Cut-off ([`CUTOFF_SHARE`]): the mass cut off at the edges of overlapping kernels adds up, because it
//!   has one sign in pixels that see only tails. Two to five times one kernel's share was measured.
//! - Affine footprints ([`AFFINE_SHARE`]): neighbours have similar errors relative to their own depth, so
//!   the error of the sum is that of one kernel. Half of the bound was measured.
//! - Simplified filters ([`FILTER_SHARE`]): as affine footprints, of which they are a kind. A block may
//!   have both errors.
//! - Merging ([`MERGE_SHARE`]): it moves mass within a cluster, to either side alike, so the errors of
//!   many clusters add up as their root. The error of a lone cluster is seen in full. The transfer
//!   function is averaged over a cluster's values as if they were evenly distributed between two ends.
//!   Other distributions cause an error of one sign along a ray ([`MISREAD_SHARE`]).
//! - Coarser lattices ([`COARSER_SHARE`]): their error is measured on some tiles of the picture, whatever its cause. The
//!   rest of the tolerance is for the errors that both pictures share.
//! - Early termination of a tile ([`TERMINATION_SHARE`](crate::constants::TERMINATION_SHARE)): once per
//!   pixel.
//!
//! The worst cases rarely coincide in a pixel, so the shares need not sum to 1.

/// Share of the cut-off at the edge of a kernel.
pub const CUTOFF_SHARE: f32 = 0.25;

/// Number of kernels whose edges coincide in ordinary data. A block knows if more overlap, as when
/// thousands lie at one point ([`Block::crowding`](crate::blocks::Block::crowding)). Each kernel is then
/// cut off as if it were that many times deeper.
///
/// Opaque kernels side by side, as in a sheet, leave this many tails in a pixel at the sheet's rim. With
/// a value of 1 the paper's checkerboard errs by 3.8 tolerances in one pixel of a thousand.
pub const OVERLAP: f32 = 6.0;

/// Factor by which more kernels end in one pixel than overlap at one point. Along a line, 2.5 times as
/// many are seen at its rim as within a deviation of one of them; over a sheet, 6.3 times. Block
/// boundaries split such groups as well. Without this factor, the cut-off of 3,000 kernels on a ring cost
/// 5 tolerances in one pixel of a thousand.
pub const MEETING: f32 = 8.0;

/// Greatest factor for the overlap that the low-pass filter causes. It makes kernels smaller than a pixel
/// overlap, by as much as it enlarges their area, and their total depth decides the cut-off. A kernel
/// without width has no area to enlarge, hence the limit.
pub const GREATEST_ENLARGEMENT: f32 = 256.0;

/// Share of the affine footprint.
pub const AFFINE_SHARE: f32 = 0.5;

/// Share of a footprint without low-pass filter, of the low-pass filter alone, or of a round one.
pub const FILTER_SHARE: f32 = 0.25;

/// Share of drawing a cluster as one particle.
pub const MERGE_SHARE: f32 = 1.0;

/// Share of a lattice drawn at fewer samples, measured against the samples' own picture.
pub const COARSER_SHARE: f32 = 0.5;

/// Greatest error of any pixel, in tolerances.
pub const WORST_PIXEL: f32 = 4.0;

/// A cluster's error is at most this times the norm of its third central moments, as a fraction of its
/// peak, in units of the standard deviation that its members share. The third derivative of a Gaussian
/// over 3! has norm .284 at most.
pub const MERGE_THIRD: f32 = 0.284;

/// The same factor for the norm of a cluster's fourth cumulants. Along an axis it is 3/4! = .125; .2
/// covers all directions and the higher orders (3,000 random clusters: .84 of the sum of both at most).
pub const MERGE_FOURTH: f32 = 0.2;

/// The same factor for contrast times width, if colours vary within a cluster. The greatest slope of a
/// Gaussian is .607, and a cluster's shift to one side is undone by its neighbour's.
pub const CONTRAST_SHARE: f32 = 0.2;

/// The same factor for contrast times the depth of a layer of clusters, because front and back of the
/// layer become one colour: sqrt(3)/6 for colours that change linearly through the layer.
pub const MIXED_SHARE: f32 = 0.289;

/// The same factor for the error of a transfer function's average over a cluster's values. The error is a
/// fraction of the greatest extinction ([`MergeBounds::uneven`](crate::blocks::MergeBounds) times the
/// function's slope). The factor is the greatest value of T exp(-T), because all clusters along a ray of
/// depth T may err alike. On scans of bodies with sharp faces the 99.9th percentile of the error was 60
/// tolerances without this term and is .34 with it (`tests/frames/promise.rs`).
pub const MISREAD_SHARE: f32 = 0.37;

/// Limit of a steady change of colour from layer to layer, in units of the root of a layer's depth.
/// Beyond it colours do not keep changing one way through all visible layers. The errors of layers then
/// have either sign and add up as their root.
pub const TREND: f32 = 0.2;

/// Fraction of the root sum of many clusters' errors that remains in a pixel, because neighbours undo one
/// another's shifts. An eighth to a quarter was measured.
pub const MANY_SHARE: f32 = 0.25;
