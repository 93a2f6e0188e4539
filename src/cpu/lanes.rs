//! The rasteriser's inner loop, one body for every instruction set.
//!
//! The body is plain Rust over arrays of a tile's row. It is compiled once per [`SimdLevel`] with
//! that level's target features, and the compiler turns its loops into vectors: sixteen lanes
//! with AVX-512, eight with AVX2, four at the baseline. `tests/simd_levels.rs` holds the
//! same mathematics in its plainest form.

use crate::constants::{EXP2_SERIES, FAINT, MAX_CUTOFF, TILE_PIXELS, TILE_SIZE};
use crate::layout::{ExactTerms, Footprint};
use crate::math::ERFC_SERIES;

/// One float per pixel of a tile.
pub(super) type Plane = [f32; TILE_PIXELS];

/// Instruction sets that the inner loop is compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// What every processor of the target has.
    Baseline,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512 F, DQ and VL.
    Avx512,
}

impl SimdLevel {
    /// The levels that this processor has, the best last.
    pub fn available() -> Vec<Self> {
        let mut levels = vec![Self::Baseline];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                levels.push(Self::Avx2);
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                {
                    levels.push(Self::Avx512);
                }
            }
        }
        levels
    }

    /// The best level of this processor.
    pub fn best() -> Self {
        Self::available().pop().unwrap_or(Self::Baseline)
    }
}

/// Asks for a footprint's cache line ahead of its use. Footprints lie in the order of particles
/// and are read in the order of depth: without this, waiting for memory is a quarter of binning
/// and rasterising.
#[inline(always)]
pub(super) fn prefetch(footprint: Option<&Footprint>) {
    #[cfg(target_arch = "x86_64")]
    if let Some(footprint) = footprint {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: the address is a reference's, and a prefetch reads nothing.
        #[allow(unsafe_code, reason = "the intrinsic takes a raw pointer")]
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(footprint).cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = footprint;
}

/// A raster tile, one array per channel, rows from the top.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct Tile {
    /// Accumulated opacity. Opacity rather than transmittance: it starts at zero, where f32 is
    /// fine enough for a hundred thousand layers of 1e-8.
    pub alpha: [f32; TILE_PIXELS],
    /// Accumulated linear colour, premultiplied.
    pub red: [f32; TILE_PIXELS],
    /// Green.
    pub green: [f32; TILE_PIXELS],
    /// Blue.
    pub blue: [f32; TILE_PIXELS],
    /// Depth at which the opacity passed one half.
    pub depth: [f32; TILE_PIXELS],
    /// |D| of each pixel's ray D = (X, Y, 1).
    pub ray_length: [f32; TILE_PIXELS],
}

impl Default for Tile {
    fn default() -> Self {
        Self {
            alpha: [0.0; TILE_PIXELS],
            red: [0.0; TILE_PIXELS],
            green: [0.0; TILE_PIXELS],
            blue: [0.0; TILE_PIXELS],
            depth: [f32::INFINITY; TILE_PIXELS],
            ray_length: [1.0; TILE_PIXELS],
        }
    }
}

/// What a loop is specialised for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mode {
    /// Opacity min(tau, 1) instead of 1 - exp(-tau).
    pub(super) linear: bool,
    /// Whether depths are wanted.
    pub(super) depth: bool,
    /// Whether pixels count kernels instead of showing them.
    pub(super) count: bool,
}

/// Where a footprint meets a tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// Pixel coordinate of the centre of the tile's first pixel.
    pub(super) first_px: [f32; 2],
    /// Columns of the tile, half-open.
    pub(super) columns: [usize; 2],
    /// Rows of the tile, half-open.
    pub(super) rows: [usize; 2],
    /// Columns of the tile that lie in the image.
    pub(super) width: usize,
}

/// Adds a footprint on the affine or (with `exact`) the exact path to a tile; returns how many
/// pixels lay within its cut-off.
#[inline]
pub(super) fn splat(
    level: SimdLevel,
    mode: Mode,
    tile: &mut Tile,
    footprint: &Footprint,
    exact: Option<&ExactTerms>,
    patch: Patch,
) -> u32 {
    match level {
        // SAFETY: `rasterise`, the only caller, clamps the level to `SimdLevel::best`, which asked
        // the processor for these very features.
        #[cfg(target_arch = "x86_64")]
        #[allow(
            unsafe_code,
            reason = "calls into functions compiled for detected features"
        )]
        SimdLevel::Avx512 => unsafe { splat_avx512(mode, tile, footprint, exact, patch) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        #[allow(
            unsafe_code,
            reason = "calls into functions compiled for detected features"
        )]
        SimdLevel::Avx2 => unsafe { splat_avx2(mode, tile, footprint, exact, patch) },
        _ => dispatch::<false, 8>(mode, tile, footprint, exact, patch),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn splat_avx512(
    mode: Mode,
    tile: &mut Tile,
    footprint: &Footprint,
    exact: Option<&ExactTerms>,
    patch: Patch,
) -> u32 {
    dispatch::<true, 16>(mode, tile, footprint, exact, patch)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn splat_avx2(
    mode: Mode,
    tile: &mut Tile,
    footprint: &Footprint,
    exact: Option<&ExactTerms>,
    patch: Patch,
) -> u32 {
    dispatch::<true, 8>(mode, tile, footprint, exact, patch)
}

#[inline(always)]
fn dispatch<const FMA: bool, const LANES: usize>(
    mode: Mode,
    tile: &mut Tile,
    footprint: &Footprint,
    exact: Option<&ExactTerms>,
    patch: Patch,
) -> u32 {
    let none = ExactTerms::default();
    let terms = exact.unwrap_or(&none);
    if exact.is_some() {
        by_output::<FMA, LANES, true>(mode, tile, footprint, terms, patch)
    } else {
        by_output::<FMA, LANES, false>(mode, tile, footprint, terms, patch)
    }
}

/// What the loop writes besides opacities.
const COLOUR: u8 = 0;
/// Colours and depths.
const DEPTH: u8 = 1;
/// The number of kernels in place of the colour, and depths, wanted or not.
const COUNT: u8 = 2;

#[inline(always)]
fn by_output<const FMA: bool, const LANES: usize, const EXACT: bool>(
    mode: Mode,
    tile: &mut Tile,
    footprint: &Footprint,
    terms: &ExactTerms,
    patch: Patch,
) -> u32 {
    if mode.count {
        by_opacity::<FMA, LANES, EXACT, COUNT>(mode, tile, footprint, terms, patch)
    } else if mode.depth {
        by_opacity::<FMA, LANES, EXACT, DEPTH>(mode, tile, footprint, terms, patch)
    } else {
        by_opacity::<FMA, LANES, EXACT, COLOUR>(mode, tile, footprint, terms, patch)
    }
}

/// Adds numbers times a factor to the pixels from `first` on.
#[inline(always)]
pub(super) fn add_scaled<const N: usize>(
    plane: &mut Plane,
    first: usize,
    numbers: &[f32; N],
    factor: f32,
) {
    if let Some(sums) = plane[first..].first_chunk_mut::<N>() {
        for (sum, number) in sums.iter_mut().zip(numbers) {
            *sum += number * factor;
        }
    }
}

/// Work that gains from being compiled for an instruction set as a whole.
pub(super) trait Kernel {
    /// What it returns.
    type Output;

    /// The work; inlined into a function of the level's features. `FMA`: whether these fuse.
    fn run<const FMA: bool>(self) -> Self::Output;
}

/// Runs `kernel` at `level`, or at the best that the processor has where that is less.
pub(super) fn run_at<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    match level.min(SimdLevel::best()) {
        // SAFETY: the level was just clamped to `SimdLevel::best`, which asked the processor for
        // these very features.
        #[cfg(target_arch = "x86_64")]
        #[allow(
            unsafe_code,
            reason = "calls into functions compiled for detected features"
        )]
        SimdLevel::Avx512 => unsafe { run_avx512(kernel) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        #[allow(
            unsafe_code,
            reason = "calls into functions compiled for detected features"
        )]
        SimdLevel::Avx2 => unsafe { run_avx2(kernel) },
        _ => kernel.run::<false>(),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<true>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<true>()
}

/// Opacity 1 - exp(-tau).
const EXPONENTIAL: u8 = 0;
/// The same for tau up to [`FAINT`], by its series: no second exponential.
const SERIES: u8 = 1;
/// Opacity min(tau, 1).
const LINEAR: u8 = 2;

#[inline(always)]
fn by_opacity<const FMA: bool, const LANES: usize, const EXACT: bool, const OUTPUT: u8>(
    mode: Mode,
    tile: &mut Tile,
    footprint: &Footprint,
    terms: &ExactTerms,
    patch: Patch,
) -> u32 {
    if mode.linear {
        by_shape::<FMA, LANES, EXACT, OUTPUT, LINEAR>(tile, footprint, terms, patch)
    } else if !EXACT && footprint.tau <= FAINT {
        by_shape::<FMA, LANES, EXACT, OUTPUT, SERIES>(tile, footprint, terms, patch)
    } else {
        by_shape::<FMA, LANES, EXACT, OUTPUT, EXPONENTIAL>(tile, footprint, terms, patch)
    }
}

#[inline(always)]
fn by_shape<
    const FMA: bool,
    const LANES: usize,
    const EXACT: bool,
    const OUTPUT: u8,
    const OPACITY: u8,
>(
    tile: &mut Tile,
    footprint: &Footprint,
    terms: &ExactTerms,
    patch: Patch,
) -> u32 {
    if !EXACT && is_aligned(footprint) {
        rows::<FMA, LANES, EXACT, OUTPUT, OPACITY, true>(tile, footprint, terms, patch)
    } else {
        rows::<FMA, LANES, EXACT, OUTPUT, OPACITY, false>(tile, footprint, terms, patch)
    }
}

/// Whether the axes of an affine footprint are the image's: each row of its form has one number.
fn is_aligned(footprint: &Footprint) -> bool {
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    (py == 0.0 && rx == 0.0) || (px == 0.0 && ry == 0.0)
}

/// The loop: rows of the patch, chunks of `LANES` pixels of each row.
///
/// `ALIGNED`: exp(-Q/2) is a factor of the column times one of the row, an exponential less for
/// each pixel. Q itself is the same, and so are the pixels within the cut-off.
#[inline(always)]
fn rows<
    const FMA: bool,
    const LANES: usize,
    const EXACT: bool,
    const OUTPUT: u8,
    const OPACITY: u8,
    const ALIGNED: bool,
>(
    tile: &mut Tile,
    footprint: &Footprint,
    terms: &ExactTerms,
    patch: Patch,
) -> u32 {
    let [px, py] = footprint.form_p;
    let [rx, ry] = footprint.form_r;
    let [red, green, blue] = if OUTPUT == COUNT {
        [1.0; 3]
    } else {
        footprint.colour
    };
    let [gx, gy] = terms.gradient;
    let [hxx, hxy, hyy] = terms.hessian;
    let (tau_peak, cutoff, depth) = (footprint.tau, footprint.cutoff_squared, footprint.depth);
    let dx_first = patch.first_px[0] - footprint.centre_px[0];
    let dy_first = patch.first_px[1] - footprint.centre_px[1];
    // A row of one vector is no loop.
    let chunks = if LANES == TILE_SIZE {
        0..1
    } else {
        patch.columns[0] / LANES..(patch.columns[1] - 1) / LANES + 1
    };
    let (alphas, _) = tile.alpha.as_chunks_mut::<LANES>();
    let (reds, _) = tile.red.as_chunks_mut::<LANES>();
    let (greens, _) = tile.green.as_chunks_mut::<LANES>();
    let (blues, _) = tile.blue.as_chunks_mut::<LANES>();
    let (depths, _) = tile.depth.as_chunks_mut::<LANES>();
    let (rays, _) = tile.ray_length.as_chunks::<LANES>();
    // Vectors reach beyond the image's right border; there nothing is within the cut-off.
    let mut limits = [cutoff; TILE_SIZE];
    for limit in limits.iter_mut().skip(patch.width) {
        *limit = -1.0;
    }
    let (mut of_columns, mut of_rows) = ([0.0; TILE_SIZE], [0.0; TILE_SIZE]);
    if ALIGNED {
        // Beyond the largest cut-off nothing is within one: there Q is no less than its parts.
        let factor = |d: f32| exp_minus_half::<FMA>((d * d).min(MAX_CUTOFF * MAX_CUTOFF));
        for (i, (column, row)) in of_columns.iter_mut().zip(&mut of_rows).enumerate() {
            *column = factor((px + rx) * (dx_first + i as f32));
            *row = tau_peak * factor((py + ry) * (dy_first + i as f32));
        }
    }
    let mut inside = [0_u32; LANES];
    #[allow(
        clippy::needless_range_loop,
        reason = "over an iterator of `of_rows` the inner loop becomes scalar code, four times slower"
    )]
    for y in patch.rows[0]..patch.rows[1] {
        let dy = dy_first + y as f32;
        let (p_row, r_row) = (py * dy, ry * dy);
        // w along the row is w_row + dx (w_slope + dx hxx).
        let w_row = madd::<FMA>(dy, madd::<FMA>(dy, hyy, gy), 1.0);
        let w_slope = madd::<FMA>(dy, hxy, gx);
        for chunk in chunks.clone() {
            let at = y * (TILE_SIZE / LANES) + chunk;
            let (Some(a_row), Some(r_out), Some(g_out), Some(b_out), Some(z_out), Some(ray)) = (
                alphas.get_mut(at),
                reds.get_mut(at),
                greens.get_mut(at),
                blues.get_mut(at),
                depths.get_mut(at),
                rays.get(at),
            ) else {
                continue;
            };
            let Some(of_column) = of_columns[chunk * LANES..].first_chunk::<LANES>() else {
                continue;
            };
            let Some(limit) = limits[chunk * LANES..].first_chunk::<LANES>() else {
                continue;
            };
            let dx_chunk = dx_first + (chunk * LANES) as f32;
            for lane in 0..LANES {
                let dx = dx_chunk + lane as f32;
                let p = madd::<FMA>(px, dx, p_row);
                let r = madd::<FMA>(rx, dx, r_row);
                let mut q = madd::<FMA>(p, p, r * r);
                let mut tau = tau_peak;
                let mut is_inside = true;
                if EXACT {
                    let w = madd::<FMA>(dx, madd::<FMA>(dx, hxx, w_slope), w_row);
                    let inverse = 1.0 / w;
                    q *= inverse;
                    tau *= ray[lane] * inverse.sqrt();
                    is_inside = w > 0.0;
                }
                // NaN compares false, here and above: outside.
                is_inside &= q <= limit[lane];
                let tau = if ALIGNED {
                    of_rows[y] * of_column[lane]
                } else {
                    tau * exp_minus_half::<FMA>(q)
                };
                let tau = if is_inside { tau } else { 0.0 };
                let opacity = match OPACITY {
                    LINEAR => tau.min(1.0),
                    SERIES => tau * (1.0 - 0.5 * tau * (1.0 - tau * (1.0 / 3.0))),
                    _ => opacity::<FMA>(tau),
                };
                let before = a_row[lane];
                let weight = opacity * (1.0 - before);
                let after = before + weight;
                a_row[lane] = after;
                let share = match OUTPUT {
                    COUNT => f32::from(u8::from(is_inside)),
                    _ => weight,
                };
                r_out[lane] = madd::<FMA>(share, red, r_out[lane]);
                g_out[lane] = madd::<FMA>(share, green, g_out[lane]);
                b_out[lane] = madd::<FMA>(share, blue, b_out[lane]);
                if OUTPUT != COLOUR {
                    let passes = before < 0.5 && after >= 0.5;
                    z_out[lane] = if passes { depth } else { z_out[lane] };
                }
                inside[lane] += u32::from(is_inside);
            }
        }
    }
    inside.iter().sum()
}

/// a b + c, fused where the level has it.
#[inline(always)]
pub(super) fn madd<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Adding this to y leaves round(y) + 127 in the low bits: the exponent field of 2^round(y).
const ROUND_TO_EXPONENT: f32 = 12_582_912.0 + 127.0;

/// Splits 2^y into (2^n, 2^f - 1) with n the nearest integer, for y in \[-126, 0\]; the second by
/// [`EXP2_SERIES`].
#[inline(always)]
fn exp2_parts<const FMA: bool>(y: f32) -> (f32, f32) {
    let shifted = y + ROUND_TO_EXPONENT;
    let f = y - (shifted - ROUND_TO_EXPONENT);
    let power = f32::from_bits(shifted.to_bits() << 23);
    let [c0, c1, c2, c3] = EXP2_SERIES;
    let mut series = c3;
    series = madd::<FMA>(series, f, c2);
    series = madd::<FMA>(series, f, c1);
    series = madd::<FMA>(series, f, c0);
    series = madd::<FMA>(series, f, std::f32::consts::LN_2);
    (power, series * f)
}

/// exp(-q/2) for q in \[0, 49\].
#[inline(always)]
pub(super) fn exp_minus_half<const FMA: bool>(q: f32) -> f32 {
    const SCALE: f32 = -0.5 * std::f32::consts::LOG2_E;
    let (power, rest) = exp2_parts::<FMA>(q * SCALE);
    madd::<FMA>(power, rest, power)
}

/// Phi(x), the integral of the unit Gaussian up to x, as [`normal_cdf`](crate::math::normal_cdf) has
/// it, by vector code: beyond 6.8 the tail stays at 1e-12.
#[inline(always)]
pub(super) fn cdf<const FMA: bool>(x: f32) -> f32 {
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / madd::<FMA>(0.5, z, 1.0);
    let [c0, higher @ ..] = ERFC_SERIES;
    let mut poly = 0.0;
    for c in higher.iter().rev() {
        poly = t * (c + poly);
    }
    let q = 2.0 * (madd::<FMA>(z, z, -c0) - poly);
    let tail = 0.5 * t * exp_minus_half::<FMA>(q.clamp(0.0, 49.0));
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// 1 - exp(-tau) for tau >= 0, with a small relative error at any tau: no cancellation, because
/// 2^n (2^f - 1) and 2^n - 1 are each exact where tau is small (n = 0).
#[inline(always)]
pub(super) fn opacity<const FMA: bool>(tau: f32) -> f32 {
    // Beyond 64 the opacity is 1 in f32.
    let (power, rest) = exp2_parts::<FMA>(tau.min(64.0) * -std::f32::consts::LOG2_E);
    madd::<FMA>(-power, rest, 1.0 - power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_hold_their_relative_error() {
        for i in 0..200_000 {
            let q = i as f32 * (49.0 / 200_000.0);
            let exact = (-0.5 * f64::from(q)).exp();
            let error = (f64::from(exp_minus_half::<false>(q)) - exact).abs() / exact;
            // The series' 4.3e-7 of a part below .41, and the rounding of y up to 35: 2e-6.
            assert!(error < 3e-6, "{q}: {error}");
            let tau = 10_f32.powf(i as f32 / 20_000.0 - 9.0);
            let exact = -(-f64::from(tau)).exp_m1();
            let error = (f64::from(opacity::<false>(tau)) - exact).abs() / exact;
            assert!(error < 8e-7, "{tau}: {error}");
        }
        assert_eq!(opacity::<false>(0.0), 0.0);
        assert_eq!(opacity::<true>(1e30), 1.0);
    }
}
