//! Texture colours filtered over a footprint: the elliptical weighted average of Heckbert 1989,
//! *Fundamentals of Texture Mapping and Image Warping*, on a pyramid.
//!
//! A footprint is a Gaussian in texture space, given by its variance. What is averaged is the image
//! as bilinear interpolation draws it, in linear light. Two ways, by size:
//!
//! - Footprints whose standard deviation is below [`SHARP_SIGMA`] texels in every direction:
//!   bilinear interpolation at the centre, which is exact on linear ramps.
//! - Larger ones: texels are summed with Gaussian weights of the footprint's variance plus that of
//!   the interpolation (1/6 texel²: the tent's), normalised by the sum of weights. The narrow axis is held to
//!   [`LEAST_SIGMA`] texels; below, the sum over texels would see their lattice. Where the narrow
//!   axis spans two texels or more, a coarser level of the pyramid is summed instead, whose own box
//!   average ((4^l - 1)/12 texel²) is taken off the variance.
//!
//! Weights depend on what alpha means ([`Weighing`]): the averaged colour is that of what is there.

use std::sync::OnceLock;

use glam::DVec2;
use rayon::prelude::*;

use crate::image::linear_from_srgb;
use crate::io::{Texture, TextureImage, Wrap};

/// Up to this standard deviation, texels, a footprint is a point.
const SHARP_SIGMA: f64 = 0.5;

/// Least standard deviation of summed weights, texels: at .6 a constant sum ripples by
/// 4 exp(-2 π² .36) = .3 % before it is normalised, a ramp's mean is off by less.
const LEAST_SIGMA: f64 = 0.6;

/// The variance of the tent by which bilinear interpolation weighs, texel².
const TENT_VARIANCE: f64 = 1.0 / 6.0;

/// Weights end here, standard deviations: exp(-3.5²/2) = .2 % of a Gaussian's integral lies
/// beyond.
const CUTOFF: f64 = 3.5;

/// The longest a footprint may be over its width; wider ones are widened, as is usual, so that no
/// lookup sums more than some thousand texels.
const MOST_STRETCHED: f64 = 16.0;

/// The greatest variance of summed weights, texel²: [`MOST_STRETCHED`] times the four texel² at
/// which the next level is taken. More is asked for only on the last level, a single texel.
const MOST_VARIANCE: f64 = 4.0 * MOST_STRETCHED * MOST_STRETCHED;

/// What a texel's weight is in an average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Weighing {
    /// One: alpha means nothing.
    Alike,
    /// Its alpha.
    Alpha,
    /// One where alpha is at least this, nothing below.
    AtLeast(f32),
}

/// A texture and its coarser levels.
#[derive(Debug)]
pub(super) struct Pyramid<'a> {
    image: &'a TextureImage,
    wrap: [Wrap; 2],
    weighing: Weighing,
    /// Level 1 and up, each half of the one before.
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

    /// Linear RGB times weight, and weight, averaged over a footprint.
    ///
    /// - `centre`: texture coordinates, v down, in units of the texture's size.
    /// - `variance`: of the Gaussian footprint, in the same units squared: uu, uv, vv.
    ///
    /// Constant textures come out constant, up to rounding. NaN where the input is not finite.
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

    /// Bilinear interpolation of the finest level.
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
            Weighing::Alike | Weighing::Alpha => {
                let texels = texels.map(|t| decoded(t, self.weighing));
                weighted(&weights, &texels)
            }
            Weighing::AtLeast(cutoff) => {
                // As a renderer does it: alpha is interpolated, then compared.
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

    /// The sum over texels of the level that the narrow axis asks for.
    fn summed(&self, centre: DVec2, values: [f64; 2], axis: DVec2) -> [f64; 4] {
        let major = values[0];
        let minor = values[1].max(major / (MOST_STRETCHED * MOST_STRETCHED));
        let mut level = 0;
        let mut scale = 1.0;
        while level < self.levels.len() && minor * scale >= 4.0 {
            level += 1;
            scale *= 0.25;
        }
        // What the level's boxes have averaged already, and the interpolation has not.
        let done = (1.0 / scale - 1.0) / 12.0 - TENT_VARIANCE;
        let least = LEAST_SIGMA * LEAST_SIGMA;
        let held = |v: f64| ((v - done) * scale).max(least);
        // Beyond the single texel of the last level there is nothing new to see.
        let (major, minor) = (
            held(major).min(MOST_VARIANCE),
            held(minor).min(MOST_VARIANCE),
        );
        let size = match level.checked_sub(1) {
            None => [self.image.width, self.image.height],
            Some(coarse) => self.levels[coarse].size,
        };
        // Coarse levels of odd sizes are a little less than half: lengths go by the true sizes.
        let stretch = |i: usize, whole: usize| size[i] as f64 / (whole as f64 * scale.sqrt());
        let stretch = [stretch(0, self.image.width), stretch(1, self.image.height)];
        let across = DVec2::new(-axis.y, axis.x);
        let variance = |a: usize, b: usize| {
            (major * axis[a] * axis[b] + minor * across[a] * across[b]) * stretch[a] * stretch[b]
        };
        let [mut xx, mut xy, mut yy] = [variance(0, 0), variance(0, 1), variance(1, 1)];
        // All texels beside a lone one are the same: there, the marginal along the other axis.
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

/// Linear RGB times weight, and weight, of a pixel.
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
        Weighing::Alpha => alpha,
        Weighing::AtLeast(cutoff) => f32::from(u8::from(alpha >= cutoff)),
    };
    let [r, g, b] = [r, g, b].map(|c| linear[usize::from(c)] * weight);
    [r, g, b, weight]
}

/// The sum of `texels` times `weights`.
fn weighted(weights: &[f64; 4], texels: &[[f32; 4]; 4]) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for (weight, texel) in weights.iter().zip(texels) {
        for (sum, t) in sum.iter_mut().zip(texel) {
            *sum += weight * f64::from(*t);
        }
    }
    sum
}

/// A level of half the size: each texel the average over the box it covers, whose edges cut
/// through texels where the size is odd.
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

/// Which of `n` texels each of `half` covers, and what share of it each of them is.
fn shares(n: usize, half: usize) -> Vec<Vec<(usize, f32)>> {
    // In parts of 1/half texels, whole numbers.
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

/// Texture coordinates near the origin that name the same texel.
fn reduced(at: DVec2, wrap: [Wrap; 2]) -> DVec2 {
    let reduced = |x: f64, wrap| match wrap {
        Wrap::Repeat => x.rem_euclid(1.0),
        Wrap::MirroredRepeat => x.rem_euclid(2.0),
        // Far outside, where footprints no longer reach the image.
        Wrap::ClampToEdge => x.clamp(-1e6, 1e6),
    };
    DVec2::new(reduced(at.x, wrap[0]), reduced(at.y, wrap[1]))
}

/// The texel of `n` that stands at a whole number `at`.
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

/// Eigenvalues of xx, xy, yy, the greater first, and the unit axis of that one.
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
