//! Numbers with one home.

/// Side of a raster tile in pixels.
pub const TILE_SIZE: usize = 16;

/// Linear values up to this have code values [`SRGB_SLOPE`] times as large, larger ones
/// [`SRGB_SCALE`] x linear^(1 / [`SRGB_GAMMA`]) - [`SRGB_OFFSET`] (IEC 61966-2-1).
pub const SRGB_LINEAR_END: f32 = 0.003_130_8;
/// See [`SRGB_LINEAR_END`].
pub const SRGB_SLOPE: f32 = 12.92;
/// See [`SRGB_LINEAR_END`].
pub const SRGB_SCALE: f32 = 1.055;
/// See [`SRGB_LINEAR_END`].
pub const SRGB_OFFSET: f32 = 0.055;
/// See [`SRGB_LINEAR_END`].
pub const SRGB_GAMMA: f32 = 2.4;

/// The slope of linear light over code at code 1, the greatest up to there: [`SRGB_GAMMA`] / [`SRGB_SCALE`]. An error of
/// codes is so much of one of linear colour at most.
pub const GREATEST_SRGB_SLOPE: f32 = SRGB_GAMMA / SRGB_SCALE;

/// Pixels of a raster tile.
pub const TILE_PIXELS: usize = TILE_SIZE * TILE_SIZE;

/// Particles in a block at most.
pub const BLOCK_CAPACITY: usize = 256;

/// Cells of a lattice block along x, y and z; their product is [`BLOCK_CAPACITY`].
pub const BRICK: [usize; 3] = [8, 8, 4];

/// Bits of a depth key. One bit less than a word, so that the signed difference between a
/// particle's key and its block's fits an `i32`.
pub const DEPTH_KEY_BITS: u32 = 31;

/// The largest cut-off radius in standard deviations, whatever the tolerance and the optical
/// depth: exp(-7²/2) = 2e-11 of the peak lies outside.
pub const MAX_CUTOFF: f32 = 7.0;

/// Kernels are integrated directly from this multiple of the cut-off in front of the camera plane:
/// at 1 the outline of the exact footprint reaches infinity, and its bounds are differences of
/// large numbers.
pub const NEAR_MARGIN: f32 = 1.2;

/// Standard deviation of a kernel over the local spacing, where nothing else is asked for.
///
/// At .6 a uniform field on a cubic lattice ripples by .7 % and 17 % of the contrast at the
/// lattice's Nyquist frequency is kept; .55 is sharper, .7 smoother.
pub const DEFAULT_KERNEL_WIDTH: f64 = 0.6;

/// The default tolerance: one grey level of 255, linear colour.
pub const DEFAULT_TOLERANCE: f32 = 1.0 / 255.0;

/// The default low-pass variance \[px²\]: the papers' identity matrix. The image of a constant
/// then ripples by 4 exp(-2 pi² h²) = 1e-8 between pixel centres.
pub const DEFAULT_LOW_PASS_VARIANCE_PX2: f32 = 1.0;

/// The low-pass variance \[px²\] that brings volumes with a field nearest to their data: depths are filtered,
/// not opacities, which widens what is opaque, so that less than the filters' own variances is best
/// (docs/truth.md). A lone kernel far below a pixel ripples by 10 % with it; kernels that fill pixels
/// together bring a width of their own.
pub const FIELD_LOW_PASS_VARIANCE_PX2: f32 = 0.15;

/// The same of bare particles, which may be lone ones: the sum of a moving point ripples by .5 %.
pub const PARTICLE_LOW_PASS_VARIANCE_PX2: f32 = 0.3;

/// A tile stops when what still shines through is below this share of the tolerance: small
/// against the cut-off's share, and deep enough that stopping is rarely late.
pub const TERMINATION_SHARE: f32 = 1.0 / 16.0;

/// Footprints drawn between two looks at whether a tile is opaque already: the look costs the CPU
/// about what a footprint of the whole tile does, and the GPU two barriers.
pub const TERMINATION_INTERVAL: usize = 32;

/// Up to this optical depth tau (1 - tau/2 (1 - tau/3)) is 1 - exp(-tau) to tau³/24 < 1.2e-6 of
/// itself.
pub const FAINT: f32 = 0.03;

/// 2^f - 1 = f (ln 2 + c0 f + c1 f² + ...) for |f| <= 1/2: minimax of degree 4 for the relative
/// error, 4.3e-7; the first coefficient is ln 2 to the last bit of f32.
pub const EXP2_SERIES: [f32; 4] = [0.240_223_51, 0.055_505_004, 0.009_666_245, 0.001_333_353_8];

/// Side of a tile of a column density in pixels: its f32 sums take half of a first-level cache.
pub const COLUMN_TILE_SIZE: usize = 64;

/// The cut-off radius of column densities in standard deviations: exp(-5.5²/2) = 2.7e-7 of a
/// kernel lies outside.
pub const COLUMN_CUTOFF: f32 = 5.5;

/// Weights of surfels that add up to this cover a pixel: between neighbours of a surface that is
/// sampled well the sum ripples by some hundredths.
pub const COVERAGE_FULL: f32 = 0.85;

/// Surfaces behind one another that a pixel keeps apart while its surfels come in.
pub const SURFACE_LAYERS: usize = 3;

/// Planes that may clip a scene: a box and two more.
pub const MAX_CLIP_PLANES: usize = 8;

/// Planes that blocks are held against: the five of the frustum, and those that clip.
pub const MAX_PLANES: usize = 5 + MAX_CLIP_PLANES;

/// Where a clip plane cuts a surface, its coverage falls over so many standard deviations of the low-pass
/// filter on either side; beyond there is nothing of it.
pub const CLIP_SOFTNESS: f32 = 3.3;

/// A field that changes by less over the thickness of a layer, in shares of its range, has no direction
/// that light could tell: roundings of its mean are a hundredth of it.
pub const LEAST_SLOPE: f32 = 1e-5;

/// 1 / sqrt(2 pi), the greatest density of a unit Gaussian.
pub const FRAC_1_SQRT_2PI: f32 = 0.398_942_3;

/// Directional lights of a scene at most: a key, fills and rims, with room to spare.
pub const MAX_LIGHTS: usize = 8;

/// Planes of the boundary of its data that cut one kernel, at most: of a thin lattice all six faces.
pub const MOST_EDGES: usize = 6;

/// A plane of the boundary cuts a kernel within so many standard deviations: beyond, it would take less
/// than a hundred-thousandth of it.
pub const EDGE_REACH: f32 = 4.5;

/// The standard deviation of a kernel along a ray, as a share of that across a plane, below which the
/// plane's edge is not resolved: f32 keeps a step finite.
pub const LEAST_SPREAD: f32 = 1e-6;

/// The share of a transfer function's greatest extinction, and the opacity of a splat, below which nobody looks
/// for a particle: no fitted camera, no cut face, no sharp boundary.
pub(crate) const FAINT_SHARE: f32 = 0.01;
