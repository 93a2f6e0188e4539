//! Filters texture colours over a footprint: the elliptical weighted average of Heckbert 1989, *Fundamentals of
//! Texture Mapping and Image Warping*, on a pyramid.
//!
//! A footprint is a Gaussian in texture space, given by its variance. The filter averages the image as bilinear
//! interpolation draws it, in linear light. It works in two ways, by size:
//!
//! - Footprints whose standard deviation is below [`SHARP_SIGMA`] texels in every direction: bilinear
//!   interpolation at the centre, which is exact on linear ramps.
//! - Larger ones: texels are summed with Gaussian weights and normalised by the sum of weights. The variance is
//!   the footprint's plus that of the interpolation (1/6 texel²: the tent's). The narrow axis is at least
//!   [`LEAST_SIGMA`] texels; below, the sum would show the lattice of texels. If the narrow axis spans three
//!   texels or more, a coarser level of the pyramid is summed instead. The variance of that level's own box
//!   average, (4^l - 1)/12 texel², is subtracted.
//!
//! Weights depend on the meaning of alpha ([`Weighing`]): the averaged colour is that of the visible part.

use std::sync::OnceLock;

use glam::DVec2;
use rayon::prelude::*;

use crate::data::mesh::{Texture, TextureImage, Wrap};
use crate::image::linear_from_srgb;

/// Greatest standard deviation, in texels, up to which a footprint is a point.
const SHARP_SIGMA: f64 = 0.5;

/// Least standard deviation of summed weights, in texels. At .6 a constant sum ripples by 4 exp(-2 π² .36) = .3
/// % before it is normalised, and a ramp's mean is off by less.
const LEAST_SIGMA: f64 = 0.6;

/// Variance of the tent that bilinear interpolation weights by, texel².
const TENT_VARIANCE: f64 = 1.0 / 6.0;

/// Cut-off of weights, in standard deviations: exp(-3.5²/2) = .2 % of a Gaussian's integral lies beyond.
const CUTOFF: f64 = 3.5;

/// Greatest ratio of a footprint's length to its width. Narrower footprints are widened, as is usual, so that
/// no lookup sums more than some thousand texels.
const MOST_STRETCHED: f64 = 16.0;

/// Variance of the narrow axis, texel², from which the next level is used: a deviation of three texels, one and
/// a half of the level's. On white noise the level's boxes err by .04 % rms of full scale; used from two texels
/// on, by .4 %.
const COARSER_FROM: f64 = 9.0;

/// Greatest variance of summed weights, texel². Only the last level, a single texel, would need more.
const MOST_VARIANCE: f64 = COARSER_FROM * MOST_STRETCHED * MOST_STRETCHED;

/// Weight of a texel in an average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Weighing {
    /// One: alpha is ignored.
    Alike,
    /// The texel's alpha.
    Alpha,
    /// One if alpha is at least this, otherwise zero.
    AtLeast(f32),
    /// One, for textures whose red, green and blue are numbers from 0 to 1 instead of encoded light.
    Numbers,
}

/// A texture and its coarser levels.
#[derive(Debug)]
pub(super) struct Pyramid<'a> {
    image: &'a TextureImage,
    wrap: [Wrap; 2],
    weighing: Weighing,
    /// Levels from 1 on, each half the size of the one before.
    levels: Vec<Level>,
}

/// Averages of texels: linear RGB times weight, and weight.
#[derive(Debug)]
struct Level {
    size: [usize; 2],
    texels: Vec<[f32; 4]>,
}

impl<'a> Pyramid<'a> {
    /// Averages down to a single texel: a third of the texture's number of texels, 16 bytes each.
    pub(super) fn new(texture: &'a Texture, weighing: Weighing) -> Self {
        let image = &*texture.image;
        let mut levels: Vec<Level> = Vec::new();
        loop {
            let (size, next) = match levels.last() {
                None => {
                    let size = [image.width, image.height];
                    let texel = |x, y| decoded(image.pixels[y * size[0] + x], weighing);
                    (size, halved(size, texel))
                }
                Some(level) => {
                    let [width, _] = level.size;
                    (
                        level.size,
                        halved(level.size, |x, y| level.texels[y * width + x]),
                    )
                }
            };
            if size == [1, 1] {
                break;
            }
            levels.push(next);
        }
        Self {
            image,
            wrap: texture.wrap,
            weighing,
            levels,
        }
    }

    /// Returns linear RGB times weight, and weight, averaged over a footprint.
    ///
    /// - `centre`: texture coordinates, v down, in units of the texture's size.
    /// - `variance`: variance of the Gaussian footprint, in the same units squared: uu, uv, vv.
    ///
    /// A constant texture gives its constant, up to rounding. Input that is not finite gives NaN.
    pub(super) fn filtered(&self, centre: DVec2, variance: [f64; 3]) -> [f64; 4] {
        let [width, height] = [self.image.width as f64, self.image.height as f64];
        let [uu, uv, vv] = variance;
        let texels = [
            uu * width * width,
            uv * width * height,
            vv * height * height,
        ];
        if !(centre.is_finite() && texels.iter().all(|v| v.is_finite())) {
            return [f64::NAN; 4];
        }
        let centre = reduced(centre, self.wrap);
        let (values, axis) = principal(texels);
        if values[0] <= SHARP_SIGMA * SHARP_SIGMA {
            return self.interpolated(centre);
        }
        self.summed(centre, values, axis)
    }

    /// Interpolates the finest level bilinearly.
    fn interpolated(&self, centre: DVec2) -> [f64; 4] {
        let size = [self.image.width, self.image.height];
        let at = [
            centre.x * size[0] as f64 - 0.5,
            centre.y * size[1] as f64 - 0.5,
        ];
        let corner = at.map(f64::floor);
        let share = [at[0] - corner[0], at[1] - corner[1]];
        let texel = |i: usize, j: usize| {
            let x = wrapped(corner[0] + i as f64, size[0], self.wrap[0]);
            let y = wrapped(corner[1] + j as f64, size[1], self.wrap[1]);
            self.image.pixels[y * size[0] + x]
        };
        let weights = [
            (1.0 - share[0]) * (1.0 - share[1]),
            share[0] * (1.0 - share[1]),
            (1.0 - share[0]) * share[1],
            share[0] * share[1],
        ];
        let texels = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
        match self.weighing {
            Weighing::Alike | Weighing::Alpha | Weighing::Numbers => {
                let texels = texels.map(|t| decoded(t, self.weighing));
                weighted(&weights, &texels)
            }
            Weighing::AtLeast(cutoff) => {
                // As renderers do: alpha is interpolated, then compared.
                let texels = texels.map(|t| {
                    let [r, g, b, _] = decoded(t, Weighing::Alike);
                    [r, g, b, f32::from(t[3]) / 255.0]
                });
                let [r, g, b, alpha] = weighted(&weights, &texels);
                if alpha >= f64::from(cutoff) - 1e-9 {
                    [r, g, b, 1.0]
                } else {
                    [0.0; 4]
                }
            }
        }
    }

    /// Sums the texels of the level that suits the narrow axis.
    fn summed(&self, centre: DVec2, values: [f64; 2], axis: DVec2) -> [f64; 4] {
        let major = values[0];
        let minor = values[1].max(major / (MOST_STRETCHED * MOST_STRETCHED));
        let mut level = 0;
        let mut scale = 1.0;
        while level < self.levels.len() && minor * scale >= COARSER_FROM {
            level += 1;
            scale *= 0.25;
        }
        // The variance that the level's boxes have already added, less that of the interpolation.
        let done = (1.0 / scale - 1.0) / 12.0 - TENT_VARIANCE;
        let least = LEAST_SIGMA * LEAST_SIGMA;
        let held = |v: f64| ((v - done) * scale).max(least);
        // Beyond the single texel of the last level nothing changes.
        let (major, minor) = (
            held(major).min(MOST_VARIANCE),
            held(minor).min(MOST_VARIANCE),
        );
        let size = match level.checked_sub(1) {
            None => [self.image.width, self.image.height],
            Some(coarse) => self.levels[coarse].size,
        };
        // Coarse levels of odd sizes are a little smaller than half: lengths scale by the true sizes.
        let stretch = |i: usize, whole: usize| size[i] as f64 / (whole as f64 * scale.sqrt());
        let stretch = [stretch(0, self.image.width), stretch(1, self.image.height)];
        let across = DVec2::new(-axis.y, axis.x);
        let variance = |a: usize, b: usize| {
            (major * axis[a] * axis[b] + minor * across[a] * across[b]) * stretch[a] * stretch[b]
        };
        let [mut xx, mut xy, mut yy] = [variance(0, 0), variance(0, 1), variance(1, 1)];
        // Along an axis with a single texel all texels are equal: use the marginal along the other axis.
        if size[0] == 1 {
            (xx, xy) = (least, 0.0);
        }
        if size[1] == 1 {
            (yy, xy) = (least, 0.0);
        }
        let determinant = xx * yy - xy * xy;
        let [cxx, cxy, cyy] = [yy / determinant, -xy / determinant, xx / determinant];
        let at = DVec2::new(
            centre.x * size[0] as f64 - 0.5,
            centre.y * size[1] as f64 - 0.5,
        );
        let (half_width, half_height) = (CUTOFF * xx.sqrt(), CUTOFF * yy.sqrt());
        let mut sum = [0.0; 4];
        let mut total = 0.0;
        let (mut y, last_y) = ((at.y - half_height).ceil(), (at.y + half_height).floor());
        while y <= last_y {
            let row = wrapped(y, size[1], self.wrap[1]) * size[0];
            let dy = y - at.y;
            // Q = cxx dx² + 2 cxy dx dy + cyy dy² <= cutoff².
            let middle = -cxy * dy / cxx;
            let room = (CUTOFF * CUTOFF - dy * dy / yy) / cxx;
            let half = room.max(0.0).sqrt().min(half_width);
            let (mut x, last_x) = (
                (at.x + middle - half).ceil(),
                (at.x + middle + half).floor(),
            );
            while x <= last_x {
                let dx = x - at.x;
                let q = cxx * dx * dx + 2.0 * cxy * dx * dy + cyy * dy * dy;
                let weight = (-0.5 * q).exp();
                let index = row + wrapped(x, size[0], self.wrap[0]);
                let texel = match level.checked_sub(1) {
                    None => decoded(self.image.pixels[index], self.weighing),
                    Some(coarse) => self.levels[coarse].texels[index],
                };
                for (sum, t) in sum.iter_mut().zip(texel) {
                    *sum += weight * f64::from(t);
                }
                total += weight;
                x += 1.0;
            }
            y += 1.0;
        }
        sum.map(|s| s / total)
    }
}

/// Returns linear RGB times weight, and weight, of a pixel.
fn decoded([r, g, b, alpha]: [u8; 4], weighing: Weighing) -> [f32; 4] {
    static LINEAR: OnceLock<[f32; 256]> = OnceLock::new();
    let linear = LINEAR.get_or_init(|| {
        let mut table = [0.0; 256];
        for (entry, code) in table.iter_mut().zip(0_u8..=255) {
            *entry = linear_from_srgb(f32::from(code) / 255.0);
        }
        table
    });
    let alpha = f32::from(alpha) / 255.0;
    let weight = match weighing {
        Weighing::Alike => 1.0,
        Weighing::Numbers => return [r, g, b, 255].map(|c| f32::from(c) / 255.0),
        Weighing::Alpha => alpha,
        Weighing::AtLeast(cutoff) => f32::from(u8::from(alpha >= cutoff)),
    };
    let [r, g, b] = [r, g, b].map(|c| linear[usize::from(c)] * weight);
    [r, g, b, weight]
}

/// Returns the sum of `texels` times `weights`.
fn weighted(weights: &[f64; 4], texels: &[[f32; 4]; 4]) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for (weight, texel) in weights.iter().zip(texels) {
        for (sum, t) in sum.iter_mut().zip(texel) {
            *sum += weight * f64::from(*t);
        }
    }
    sum
}

/// Returns a level of half the size. Each texel is the average over the box that it covers; the box's edges cut
/// through texels if the size is odd.
fn halved(size: [usize; 2], texel: impl Fn(usize, usize) -> [f32; 4] + Sync) -> Level {
    let half = size.map(|n| (n / 2).max(1));
    let [columns, rows] = [shares(size[0], half[0]), shares(size[1], half[1])];
    let row = |row: &[(usize, f32)]| -> Vec<[f32; 4]> {
        let average = |column: &[(usize, f32)]| {
            let mut sum = [0.0; 4];
            for &(y, share_y) in row {
                for &(x, share_x) in column {
                    let texel = texel(x, y);
                    for (sum, t) in sum.iter_mut().zip(texel) {
                        *sum += share_x * share_y * t;
                    }
                }
            }
            sum
        };
        columns.iter().map(|column| average(column)).collect()
    };
    Level {
        size: half,
        texels: rows.par_iter().flat_map_iter(|r| row(r)).collect(),
    }
}

/// Returns, for each of `half` texels, the texels among `n` that it covers and their shares of it.
fn shares(n: usize, half: usize) -> Vec<Vec<(usize, f32)>> {
    // In parts of 1/half texels, as integers.
    let covered = |i: usize| {
        let (start, end) = (i * n, (i + 1) * n);
        let share = move |x: usize| {
            let length = end.min((x + 1) * half) - start.max(x * half);
            (x, length as f32 / n as f32)
        };
        (start / half..end.div_ceil(half)).map(share).collect()
    };
    (0..half).map(covered).collect()
}

/// Returns texture coordinates near the origin that address the same texel.
fn reduced(at: DVec2, wrap: [Wrap; 2]) -> DVec2 {
    let reduced = |x: f64, wrap| match wrap {
        Wrap::Repeat => x.rem_euclid(1.0),
        Wrap::MirroredRepeat => x.rem_euclid(2.0),
        // Clamped far outside, where footprints no longer reach the image.
        Wrap::ClampToEdge => x.clamp(-1e6, 1e6),
    };
    DVec2::new(reduced(at.x, wrap[0]), reduced(at.y, wrap[1]))
}

/// Returns the texel among `n` that an integer `at` addresses.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole numbers, held to the image first"
)]
fn wrapped(at: f64, n: usize, wrap: Wrap) -> usize {
    let last = n as f64 - 1.0;
    if (0.0..=last).contains(&at) {
        return at as usize;
    }
    match wrap {
        Wrap::Repeat => (at as i64).rem_euclid(n as i64) as usize,
        Wrap::MirroredRepeat => {
            let there = (at as i64).rem_euclid(2 * n as i64) as usize;
            there.min(2 * n - 1 - there)
        }
        Wrap::ClampToEdge => at.clamp(0.0, last) as usize,
    }
}

/// Returns the eigenvalues of xx, xy, yy, the greater first, and the unit axis of that one.
fn principal([xx, xy, yy]: [f64; 3]) -> ([f64; 2], DVec2) {
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let root = half.hypot(xy);
    let axis = if half >= 0.0 {
        DVec2::new(half + root, xy)
    } else {
        DVec2::new(xy, root - half)
    };
    let axis = axis.try_normalize().unwrap_or(DVec2::X);
    ([mean + root, (mean - root).max(0.0)], axis)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn texture(
        size: [usize; 2],
        wrap: [Wrap; 2],
        pixel: impl Fn(usize, usize) -> [u8; 4],
    ) -> Texture {
        let [width, height] = size;
        let at = |i: usize| pixel(i % width, i / width);
        Texture {
            image: Arc::new(TextureImage {
                width,
                height,
                pixels: (0..width * height).map(at).collect(),
            }),
            wrap,
        }
    }

    /// Returns a random number, uniform in [0, 1).
    fn random(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns random bits for a pixel.
    #[expect(clippy::cast_possible_truncation, reason = "any bits will do")]
    fn noise(x: usize, y: usize, c: u64) -> u8 {
        let mut state = (x as u64) << 32 | (y as u64) << 8 | c;
        random(&mut state);
        (random(&mut state) * 256.0) as u8
    }

    /// Returns uu, uv, vv of a Gaussian with these standard deviations, rotated by `angle`.
    fn variance([a, b]: [f64; 2], angle: f64) -> [f64; 3] {
        let (sin, cos) = angle.sin_cos();
        let (a, b) = (a * a, b * b);
        [
            a * cos * cos + b * sin * sin,
            (a - b) * sin * cos,
            a * sin * sin + b * cos * cos,
        ]
    }

    const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge];

    #[test]
    fn a_constant_stays_constant() {
        let mut state = 5;
        for size in [[1, 1], [7, 5], [64, 1], [1, 33], [100, 37]] {
            for wrap in WRAPS {
                let texture = texture(size, [wrap; 2], |_, _| [200, 100, 3, 77]);
                for weighing in [Weighing::Alike, Weighing::Alpha, Weighing::AtLeast(0.3)] {
                    let expected = decoded([200, 100, 3, 77], weighing).map(f64::from);
                    let pyramid = Pyramid::new(&texture, weighing);
                    for _ in 0..60 {
                        let at = DVec2::new(random(&mut state), random(&mut state)) * 8.0 - 4.0;
                        let sigmas = [0, 1].map(|_| 10.0_f64.powf(-4.0 + 5.0 * random(&mut state)));
                        let found =
                            pyramid.filtered(at, variance(sigmas, 6.0 * random(&mut state)));
                        for (f, e) in found.iter().zip(expected) {
                            // The shares of boxes are f32: one rounding for each level and tap.
                            assert!((f - e).abs() < 2e-6, "{size:?} {wrap:?} {found:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_checkerboard_far_away_is_half_in_linear_light() {
        for size in [[64, 64], [96, 50], [129, 77]] {
            let checker = |x: usize, y: usize| {
                if (x + y).is_multiple_of(2) {
                    [255; 4]
                } else {
                    [0, 0, 0, 255]
                }
            };
            let texture = texture(size, [Wrap::Repeat; 2], checker);
            let pyramid = Pyramid::new(&texture, Weighing::Alike);
            for sigmas in [[0.1, 0.1], [0.5, 0.06], [30.0, 30.0]] {
                let [r, ..] = pyramid.filtered(DVec2::new(0.31, 0.77), variance(sigmas, 0.4));
                // Textures of odd size repeat with two equal squares side by side: .4 % more white.
                assert!((r - 0.5).abs() < 6e-3, "{size:?} {sigmas:?}: {r}");
            }
        }
    }

    #[test]
    fn a_ramp_gives_its_value_at_the_centre() {
        // Alpha is linear in the code: a ramp without sRGB encoding.
        #[expect(clippy::cast_possible_truncation, reason = "up to 255")]
        let ramp = |x: usize, _: usize| [0, 0, 0, x as u8];
        let texture = texture([256, 64], [Wrap::ClampToEdge; 2], ramp);
        let pyramid = Pyramid::new(&texture, Weighing::Alpha);
        let mut state = 9;
        for _ in 0..300 {
            let at = DVec2::new(0.3 + 0.4 * random(&mut state), random(&mut state));
            let sigma = 10.0_f64.powf(-2.0 + 3.0 * random(&mut state)).min(12.0) / 256.0;
            let sigmas = [sigma, sigma * (0.1 + 0.9 * random(&mut state))];
            let [uu, uv, vv] = variance(sigmas, 6.0 * random(&mut state));
            let [.., alpha] = pyramid.filtered(at, [uu, 4.0 * uv, 16.0 * vv]);
            let expected = (at.x * 256.0 - 0.5) / 255.0;
            // Weights are sampled at texels: their first moment is off by up to 4 pi sigma exp(-2 pi² sigma²)
            // texels = .006 at sigma .6, and those past the cut-off are missing.
            let texels = (alpha - expected).abs() * 255.0;
            assert!(
                texels < 0.02 + 0.02 * sigma * 256.0,
                "{at} {sigmas:?}: {texels}"
            );
        }
    }

    #[test]
    fn turning_the_texture_and_the_footprint_changes_nothing() {
        let size = [40, 40];
        let pixel = |x: usize, y: usize| [noise(x, y, 0), noise(x, y, 1), noise(x, y, 2), 255];
        let upright = texture(size, [Wrap::Repeat; 2], pixel);
        let turned = texture(size, [Wrap::Repeat; 2], |x, y| pixel(39 - y, x));
        let [upright, turned] = [&upright, &turned].map(|t| Pyramid::new(t, Weighing::Alike));
        let mut state = 3;
        for _ in 0..200 {
            let at = DVec2::new(random(&mut state), random(&mut state));
            let sigmas = [0, 1].map(|_| 10.0_f64.powf(-3.0 + 2.5 * random(&mut state)));
            let [uu, uv, vv] = variance(sigmas, 6.0 * random(&mut state));
            let a = upright.filtered(at, [uu, uv, vv]);
            let b = turned.filtered(DVec2::new(at.y, 1.0 - at.x), [vv, -uv, uu]);
            for (a, b) in a.iter().zip(b) {
                // Texels right at the cut-off may fall on either side: .2 % of the peak.
                assert!((a - b).abs() < 2e-3, "{at} {sigmas:?}: {a} {b}");
            }
        }
    }

    #[test]
    fn edges_go_on_as_the_wrap_mode_says() {
        let pixel = |x: usize, _: usize| if x == 0 { [255; 4] } else { [0, 0, 0, 255] };
        let at_edge = |wrap: Wrap, u: f64, sigma: f64| {
            let texture = texture([8, 8], [wrap, Wrap::Repeat], pixel);
            let pyramid = Pyramid::new(&texture, Weighing::Alike);
            pyramid.filtered(DVec2::new(u, 0.5), variance([sigma; 2], 0.0))[0]
        };
        // Between the first texel and the one before it.
        for (wrap, expected) in WRAPS.into_iter().zip([0.5, 1.0, 1.0]) {
            assert!((at_edge(wrap, 0.0, 0.0) - expected).abs() < 1e-6);
            assert!(
                (at_edge(wrap, -3.0, 0.0)
                    - [0.5, 0.0, 1.0][WRAPS.iter().position(|w| *w == wrap).unwrap()])
                .abs()
                    < 1e-6
            );
        }
        // Beyond the edge: white throughout; one white texel; two of them.
        let sigma = 0.7 / 8.0;
        let clamped = at_edge(Wrap::ClampToEdge, 0.0, sigma);
        let mirrored = at_edge(Wrap::MirroredRepeat, 0.0, sigma);
        let repeated = at_edge(Wrap::Repeat, 0.0, sigma);
        assert!(clamped > mirrored + 0.05 && mirrored > repeated + 0.2);
        assert!((2.0 * repeated - mirrored).abs() < 1e-3);
    }

    /// Returns the sum over all texels of the finest level within six standard deviations.
    fn brute_force(texture: &Texture, at: DVec2, [uu, uv, vv]: [f64; 3]) -> [f64; 4] {
        let size = [texture.image.width, texture.image.height];
        let [w, h] = size.map(|n| n as f64);
        let (values, axis) = principal([uu * w * w, uv * w * h, vv * h * h]);
        let least = LEAST_SIGMA * LEAST_SIGMA;
        let [major, minor] = values.map(|v| (v + TENT_VARIANCE).max(least));
        let reach = (6.0 * major.sqrt()).ceil();
        let centre = DVec2::new(at.x * w - 0.5, at.y * h - 0.5);
        let (mut sum, mut total) = ([0.0; 4], 0.0);
        let mut y = (centre.y - reach).floor();
        while y <= centre.y + reach {
            let mut x = (centre.x - reach).floor();
            while x <= centre.x + reach {
                let d = DVec2::new(x, y) - centre;
                let q = d.dot(axis).powi(2) / major + d.perp_dot(axis).powi(2) / minor;
                let weight = (-0.5 * q).exp();
                let (i, j) = (
                    wrapped(x, size[0], texture.wrap[0]),
                    wrapped(y, size[1], texture.wrap[1]),
                );
                let texel = decoded(texture.image.pixels[j * size[0] + i], Weighing::Alpha);
                for (sum, t) in sum.iter_mut().zip(texel) {
                    *sum += weight * f64::from(t);
                }
                total += weight;
                x += 1.0;
            }
            y += 1.0;
        }
        sum.map(|s| s / total)
    }

    #[test]
    fn lookups_agree_with_sums_over_all_texels() {
        let pixel = |x, y| {
            [
                noise(x, y, 0),
                noise(x, y, 1),
                noise(x, y, 2),
                noise(x, y, 3),
            ]
        };
        let mut state = 21;
        let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
        for wrap in WRAPS {
            let texture = texture([48, 34], [wrap; 2], pixel);
            let pyramid = Pyramid::new(&texture, Weighing::Alpha);
            for _ in 0..200 {
                let mut at = DVec2::new(random(&mut state), random(&mut state));
                if wrap == Wrap::ClampToEdge {
                    // Beyond the edge, a coarser level continues with its own texel.
                    at = DVec2::splat(0.4) + 0.2 * at;
                }
                // From .6 to 9 texels long, up to eight times as long as wide.
                let long = 0.6 * 15.0_f64.powf(random(&mut state));
                let wide = long * 8.0_f64.powf(-random(&mut state));
                let [uu, uv, vv] = variance([long, wide], 6.0 * random(&mut state));
                let scaled = [uu / (48.0 * 48.0), uv / (48.0 * 34.0), vv / (34.0 * 34.0)];
                let found = pyramid.filtered(at, scaled);
                for (f, e) in found.iter().zip(brute_force(&texture, at, scaled)) {
                    worst = worst.max((f - e).abs());
                    squares += (f - e).powi(2);
                    count += 1.0;
                }
            }
        }
        let rms = f64::sqrt(squares / count);
        println!("against all texels of noise: rms {rms:.5}, worst {worst:.5}");
        // White noise at full scale is the hardest case. Coarser levels are boxes, not Gaussians, but the next
        // filter is wide enough to hide most of that.
        assert!(rms < 1e-3 && worst < 0.01, "rms {rms}, worst {worst}");
    }

    #[test]
    fn a_mask_counts_what_reaches_the_cutoff() {
        let pixel = |x: usize, _: usize| [255, 0, 0, if x < 16 { 200 } else { 20 }];
        let texture = texture([32, 32], [Wrap::Repeat; 2], pixel);
        let pyramid = Pyramid::new(&texture, Weighing::AtLeast(0.5));
        let whole = pyramid.filtered(DVec2::splat(0.3), variance([2.0; 2], 0.0));
        assert!((whole[3] - 0.5).abs() < 1e-6 && (whole[0] - 0.5).abs() < 1e-6);
        let points = [0.2, 0.8].map(|u| pyramid.filtered(DVec2::new(u, 0.4), [0.0; 3])[3]);
        assert_eq!(points, [1.0, 0.0]);
    }

    #[test]
    fn poison_gives_nan_and_ends() {
        let texture = texture([5, 3], [Wrap::ClampToEdge; 2], |_, _| [9; 4]);
        let pyramid = Pyramid::new(&texture, Weighing::Alike);
        for x in [f64::NAN, f64::INFINITY] {
            assert!(pyramid.filtered(DVec2::new(x, 0.0), [0.0; 3])[0].is_nan());
            assert!(pyramid.filtered(DVec2::ZERO, [x, 0.0, 1.0])[0].is_nan());
        }
        for huge in [1e30, 1e300] {
            assert!(pyramid.filtered(DVec2::splat(huge), [1e9, 0.0, 1e-9])[0] > 0.0);
        }
    }
}
