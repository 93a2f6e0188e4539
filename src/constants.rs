//! Declares the numbers that several modules or both back ends share.

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

/// Slope of linear light over code value at code 1, its maximum over the range 0 to 1: [`SRGB_GAMMA`] /
/// [`SRGB_SCALE`]. An error in code values times this bounds the error in linear colour.
pub const GREATEST_SRGB_SLOPE: f32 = SRGB_GAMMA / SRGB_SCALE;

/// Number of pixels of a raster tile.
pub const TILE_PIXELS: usize = TILE_SIZE * TILE_SIZE;

/// Greatest number of particles in a block.
pub const BLOCK_CAPACITY: usize = 256;

/// Cells of a lattice block along x, y and z; their product is [`BLOCK_CAPACITY`].
pub const BRICK: [usize; 3] = [8, 8, 4];

/// Number of bits of a depth key. It is one bit less than a word, so that the signed difference between a
/// particle's key and its block's fits an `i32`.
pub const DEPTH_KEY_BITS: u32 = 31;

/// The largest cut-off radius in standard deviations, whatever the tolerance and the optical
/// depth: exp(-7²/2) = 2e-11 of the peak lies outside.
pub const MAX_CUTOFF: f32 = 7.0;

/// Kernels are integrated directly within this multiple of the cut-off from the camera plane. At 1 the outline
/// of the exact footprint reaches infinity, and its bounds are differences of large numbers.
pub const NEAR_MARGIN: f32 = 1.2;

/// Default standard deviation of a kernel over the local spacing.
///
/// At .6 a uniform field on a cubic lattice ripples by .7 % and 17 % of the contrast at the
/// lattice's Nyquist frequency is kept; .55 is sharper, .7 smoother.
pub const DEFAULT_KERNEL_WIDTH: f64 = 0.6;

/// The default tolerance: one grey level of 255, linear colour.
pub const DEFAULT_TOLERANCE: f32 = 1.0 / 255.0;

/// The default low-pass variance \[px²\]: the papers' identity matrix. The image of a constant
/// then ripples by 4 exp(-2 pi² h²) = 1e-8 between pixel centres.
pub const DEFAULT_LOW_PASS_VARIANCE_PX2: f32 = 1.0;

/// Low-pass variance \[px²\] that brings volumes with a field nearest to their data. The filter acts on depths,
/// not on opacities, which widens opaque regions; a variance below the filter's own is therefore best
/// (docs/truth.md). With it, a lone kernel far below a pixel ripples by 10 %. Kernels that fill pixels together
/// add a width of their own.
pub const FIELD_LOW_PASS_VARIANCE_PX2: f32 = 0.15;

/// Low-pass variance \[px²\] of bare particles, which may be isolated: the sum of a moving point ripples by .5
/// %.
pub const PARTICLE_LOW_PASS_VARIANCE_PX2: f32 = 0.3;

/// A tile stops when the transmittance falls below this share of the tolerance. The share is small compared
/// with the cut-off's, and large enough that stopping is rarely late.
pub const TERMINATION_SHARE: f32 = 1.0 / 16.0;

/// Opacities on the image between which splats are drawn by the rules of Kerbl et al. 2023: smaller ones are left out,
/// greater ones are the ceiling.
pub const SPLAT_FLOOR: f32 = 1.0 / 255.0;
/// See [`SPLAT_FLOOR`].
pub const SPLAT_CEILING: f32 = 0.99;

/// Cut-off of splats by the rule of `KHR_gaussian_splatting`, standard deviations.
pub const SPLAT_CUTOFF: f32 = 3.0;

/// Number of footprints drawn between two tests of a tile for opacity. A test costs the CPU about as much as a
/// footprint that covers the tile, and the GPU two barriers.
pub const TERMINATION_INTERVAL: usize = 32;

/// Optical depth up to which tau (1 - tau/2 (1 - tau/3)) approximates 1 - exp(-tau), with a relative error of
/// tau³/24 < 1.2e-6.
pub const FAINT: f32 = 0.03;

/// 2^f - 1 = f (ln 2 + c0 f + c1 f² + ...) for |f| <= 1/2: minimax of degree 4 for the relative
/// error, 4.3e-7; the first coefficient is ln 2 to the last bit of f32.
pub const EXP2_SERIES: [f32; 4] = [0.240_223_51, 0.055_505_004, 0.009_666_245, 0.001_333_353_8];

/// Side of a tile of a column density in pixels: its f32 sums fill half of a first-level cache.
pub const COLUMN_TILE_SIZE: usize = 64;

/// The cut-off radius of column densities in standard deviations: exp(-5.5²/2) = 2.7e-7 of a
/// kernel lies outside.
pub const COLUMN_CUTOFF: f32 = 5.5;

/// Sum of surfels' weights at which they cover a pixel. On a well-sampled surface the sum ripples by some
/// hundredths.
pub const COVERAGE_FULL: f32 = 0.85;

/// Number of surfaces behind one another that a pixel keeps apart while its surfels arrive.
pub const SURFACE_LAYERS: usize = 3;

/// Greatest number of planes that clip a scene: a box and two more.
pub const MAX_CLIP_PLANES: usize = 8;

/// Number of planes that blocks are tested against: the five of the frustum, and the clip planes.
pub const MAX_PLANES: usize = 5 + MAX_CLIP_PLANES;

/// Range over which the coverage of a surface falls on either side of a clip plane, in standard deviations of
/// the low-pass filter. Beyond it the coverage is zero.
pub const CLIP_SOFTNESS: f32 = 3.3;

/// Least change of a field over the thickness of a layer, as a share of its range, that gives the field a
/// direction for shading. Rounding errors of its mean are a hundredth of it.
pub const LEAST_SLOPE: f32 = 1e-5;

/// 1 / sqrt(2 pi), the greatest density of a unit Gaussian.
pub const FRAC_1_SQRT_2PI: f32 = 0.398_942_3;

/// Greatest number of directional lights of a scene: a key, fills and rims, with room to spare.
pub const MAX_LIGHTS: usize = 8;

/// Greatest number of boundary planes that cut one kernel: all six faces of a thin lattice.
pub const MOST_EDGES: usize = 6;

/// Distance, in standard deviations, within which a boundary plane cuts a kernel. A plane beyond would remove
/// less than a hundred-thousandth of it.
pub const EDGE_REACH: f32 = 4.5;

/// Least standard deviation of a kernel along a ray, as a share of that across a plane, for which the plane's
/// edge is resolved. It keeps a step finite in f32.
pub const LEAST_SPREAD: f32 = 1e-6;

/// Share of a transfer function's greatest extinction, and opacity of a splat, below which a particle counts as
/// invisible: for fitted cameras, cut faces and sharp boundaries.
pub(crate) const FAINT_SHARE: f32 = 0.01;

/// Number of entries in a transfer function's table. At 4096 each byte has sixteen entries and each 12-bit
/// value one of its own, and one function takes 64 KiB of device memory.
pub const CLASSIFICATION_TABLE_LEN: usize = 4096;
