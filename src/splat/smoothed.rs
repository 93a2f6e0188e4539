//! Computes the means over pixels of projected SPH kernels, for column sums.
//!
//! The line integral of a round kernel depends on the impact parameter alone: with distances in units of the support, it is
//! F(x² + y²). F is nearly a sum of products, F = sum of s_k u_k(x) u_k(y) with s_k = 1 or -1. The functions u_k are the
//! eigenfunctions of F as a matrix over x and y, times the root of the eigenvalue's magnitude. Like F, they are zero from
//! the support on. [`RANK`] of them leave 2e-5 of the peak. The mean over a pixel is the sum of products of means along its
//! sides, at any size of the pixel. The mean of u_k along a side is the difference of its antiderivative U_k; of short sides, the
//! mean of u_k at two places (Gauss-Legendre). A table made on first use holds U_k, u_k and derivatives: cubics around
//! its nearest entry give the rest.
//!
//! Under perspective, a footprint may be sheared. Then the products hold for each row, and a pixel is divided into rows so thin
//! that the shear within a row does not matter. Kernels narrower than [`LEAST_DRAWN_PX`] remain Gaussians,
//! whose means over pixels keep the mass at any size.
//!
//! Footprints have the kernel's variance, widened by that of a pixel, and its mass. So the kernel needs no other numbers.
//!
//! Twin: `shaders/shared/smoothed.wgsl`.

use std::f32::consts::TAU;
use std::sync::OnceLock;

use bytemuck::{Pod, Zeroable};

use super::pixel_mean::{PIXEL_VARIANCE_PX2, is_of_pixels};
use crate::data::smoothing::SphKernel;
use crate::math::lane::madd;
use crate::math::narrowed;
use crate::record::{Footprint, ViewUniform};

/// Number of kernels.
const KERNELS: usize = 6;
/// Number of products.
pub(crate) const RANK: usize = 8;
/// Number of intervals of a table.
pub(crate) const PROFILE_CELLS: usize = 64;

/// Squared support over the variance along an axis: of the cubic, quartic and quintic spline, and of Wendland C2,
/// C4 and C6, in the order of [`SphKernel`](crate::io::SphKernel).
pub(crate) const REACHES: [f32; KERNELS] =
    [40.0 / 3.0, 375.0 / 23.0, 135.0 / 7.0, 15.0, 19.5, 24.0];

/// Least support that is drawn as it is \[px\].
pub(crate) const LEAST_DRAWN_PX: f32 = 0.25;
/// Sides shorter than this, in supports, take the mean of two places: f32 would lose the difference of antiderivatives.
pub(crate) const SHORT_SIDE: f32 = 1.0 / 16.0;
/// Distance of the two places from a side's middle, over its length: 1/(2 sqrt 3).
pub(crate) const SIDE_PLACE: f32 = 0.288_675_13;
/// Greatest number of rows of a pixel.
pub(crate) const MOST_ROWS: usize = 8;
/// Rows of a pixel per root of the shear within it, in supports.
pub(crate) const ROWS_PER_SHEAR: f32 = 100.0;
/// Least tilt that counts as shear. Less moves the kernel by less than the error of the products.
const LEAST_TILT: f32 = 1e-6;

/// Orders of an entry of a table: U_k, and u_k with its derivatives up to the third, over their factorials, in steps of the
/// table.
const ORDERS: usize = 5;

/// The table of a kernel.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Profiles {
    /// Entries at even steps of the distance, from 0 to the support.
    pub(crate) knots: [[[f32; RANK]; ORDERS]; PROFILE_CELLS + 1],
    /// s_k.
    pub(crate) signs: [f32; RANK],
}

/// Returns the place of a kernel in [`REACHES`].
fn place_of(smoothing: u32) -> usize {
    (smoothing as usize).clamp(1, KERNELS) - 1
}

/// Returns a kernel at a distance in units of the support, of any mass.
fn kernel(which: usize, u: f64) -> f64 {
    // B-splines, with the support in units of the distance between knots.
    let spline = |support: f64, power: i32, weights: &[f64]| -> f64 {
        let knot = |(k, weight): (usize, &f64)| {
            let rest = support - k as f64 - support * u;
            weight * rest.max(0.0).powi(power)
        };
        weights.iter().enumerate().map(knot).sum()
    };
    let rest = (1.0 - u).max(0.0);
    match which {
        0 => spline(2.0, 3, &[1.0, -4.0]),
        1 => spline(2.5, 4, &[1.0, -5.0, 10.0]),
        2 => spline(3.0, 5, &[1.0, -6.0, 15.0]),
        3 => rest.powi(4) * (1.0 + 4.0 * u),
        4 => rest.powi(6) * (1.0 + 6.0 * u + 35.0 / 3.0 * u * u),
        _ => rest.powi(8) * (1.0 + 8.0 * u + 25.0 * u * u + 32.0 * u.powi(3)),
    }
}

/// Returns the line integral of a kernel, by the square of the impact parameter. The kernel is even, and smooth where it ends,
/// so that the midpoint rule is within 1e-8 of the integral.
fn projected(which: usize, b_squared: f64) -> f64 {
    const STEPS: u32 = 100;
    let half = (1.0 - b_squared).max(0.0).sqrt();
    let at = |i: u32| {
        let z = half * (f64::from(i) + 0.5) / f64::from(STEPS);
        kernel(which, (b_squared + z * z).sqrt())
    };
    2.0 * half / f64::from(STEPS) * (0..STEPS).map(at).sum::<f64>()
}

/// A round kernel of unit mass and unit support, in f64.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RoundKernel {
    which: usize,
    scale: f64,
}

impl RoundKernel {
    pub(crate) fn new(kernel: SphKernel) -> Self {
        /// Simpson's rule meets the mass within 1e-12, since kernels are smooth.
        const STEPS: u32 = 1000;
        let which = kernel as usize;
        let shell = |i: u32| {
            let u = f64::from(i) / f64::from(STEPS);
            let weight = match i {
                0 | STEPS => 1.0,
                _ => f64::from(2 + 2 * (i % 2)),
            };
            weight * self::kernel(which, u) * u * u
        };
        let mass = (0..=STEPS).map(shell).sum::<f64>() / f64::from(3 * STEPS);
        Self {
            which,
            scale: 1.0 / (2.0 * std::f64::consts::TAU * mass),
        }
    }

    /// Returns the support of a kernel, in its standard deviations along an axis.
    pub(crate) fn reach(kernel: SphKernel) -> f64 {
        f64::from(REACHES[kernel as usize]).sqrt()
    }

    /// Returns the kernel at a distance in supports.
    pub(crate) fn at(&self, u: f64) -> f64 {
        self.scale * kernel(self.which, u)
    }
}

impl Profiles {
    /// Returns the table of a kernel.
    ///
    /// - `smoothing`: [`ViewUniform::smoothing`]: 1 for the first of [`REACHES`]; 0 gives zeros.
    pub(crate) fn of(smoothing: u32) -> &'static Self {
        static ALL: [OnceLock<Profiles>; KERNELS] = [const { OnceLock::new() }; KERNELS];
        static NONE: Profiles = Profiles {
            knots: [[[0.0; RANK]; ORDERS]; PROFILE_CELLS + 1],
            signs: [0.0; RANK],
        };
        if smoothing == 0 {
            return &NONE;
        }
        let which = place_of(smoothing);
        ALL[which].get_or_init(|| Self::new(which))
    }

    fn new(which: usize) -> Self {
        let cells = PROFILE_CELLS as f64;
        let matrix = (0..PROFILE_CELLS).map(|i| {
            let row = (0..PROFILE_CELLS)
                .map(|j| projected(which, (i * i + j * j) as f64 / (cells * cells)));
            row.collect()
        });
        let mut terms = eigen(matrix.collect());
        terms.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let mut profiles = Self::zeroed();
        let mut mass = 0.0;
        let mut columns = Vec::new();
        for (eigenvalue, vector) in terms.iter().take(RANK) {
            let scale = eigenvalue.abs().sqrt();
            // Even, and zero beyond the support.
            let value = |i: isize| vector.get(i.unsigned_abs()).map_or(0.0, |v| scale * v);
            let differences = |i| [1, 2].map(|step| value(i + step) - value(i - step));
            let slope = |i| {
                let [near, far] = differences(i);
                (8.0 * near - far) / 12.0
            };
            let mut sum = 0.0;
            let mut column = Vec::new();
            for i in 0..=PROFILE_CELLS as isize {
                let [near, far] = [1, 2].map(|step| value(i + step) + value(i - step));
                let second = (16.0 * near - far - 30.0 * value(i)) / 12.0;
                let [near, far] = differences(i);
                let third = 0.5 * far - near;
                column.push([sum, value(i), slope(i), second / 2.0, third / 6.0]);
                let trapezoid = 0.5 * (value(i) + value(i + 1));
                sum += (trapezoid + (slope(i) - slope(i + 1)) / 12.0) / cells;
            }
            mass += eigenvalue.signum() * (2.0 * column[PROFILE_CELLS][0]).powi(2);
            columns.push((eigenvalue.signum(), column));
        }
        // The mass of a kernel is 1.
        let scale = 1.0 / mass.sqrt();
        for (k, (sign, column)) in columns.iter().enumerate() {
            profiles.signs[k] = narrowed(*sign);
            for (knot, entry) in profiles.knots.iter_mut().zip(column) {
                for (order, number) in knot.iter_mut().zip(entry) {
                    order[k] = narrowed(scale * number);
                }
            }
        }
        profiles
    }

    /// Returns U_k at a distance from the centre, and the sign of the distance, by which it must be multiplied.
    #[inline(always)]
    fn sums<const FMA: bool>(&self, x: f32) -> ([f32; RANK], f32) {
        let (knot, t) = self.nearest(x);
        let [sum, value, slope, second, _] = knot;
        let step = t / PROFILE_CELLS as f32;
        let weights = [step, step * (t / 2.0), step * (t * t * (1.0 / 3.0))];
        let sums = series::<FMA>(sum, [value, slope, second], weights);
        (sums, 1.0_f32.copysign(x))
    }

    /// Returns u_k at a distance from the centre.
    #[inline(always)]
    fn values<const FMA: bool>(&self, x: f32) -> [f32; RANK] {
        let (knot, t) = self.nearest(x);
        let [_, value, slope, second, third] = knot;
        series::<FMA>(value, [slope, second, third], [t, t * t, t * t * t])
    }

    /// Returns the entry nearest to a distance from the centre, and the place beside it, in steps of the table.
    #[inline(always)]
    fn nearest(&self, x: f32) -> (&[[f32; RANK]; ORDERS], f32) {
        /// Numbers as great as this are whole.
        const WHOLE: f32 = 8_388_608.0;
        let place = x.abs().min(1.0) * PROFILE_CELLS as f32;
        let rounded = place + WHOLE;
        // Not a conversion, which would test for NaN and infinity.
        let i = (rounded.to_bits() - WHOLE.to_bits()) as usize;
        (&self.knots[i.min(PROFILE_CELLS)], place - (rounded - WHOLE))
    }

    /// Returns the means of u_k along a side, by its middle and its length.
    #[inline(always)]
    fn mean<const FMA: bool>(&self, middle: f32, length: f32) -> [f32; RANK] {
        let mut means = [[0.0; RANK]];
        self.means::<FMA>(middle, length, &mut means);
        means[0]
    }

    /// Writes the means of u_k along neighbouring sides of a length.
    ///
    /// - `first`: the middle of the first side.
    #[inline(always)]
    fn means<const FMA: bool>(&self, first: f32, length: f32, out: &mut [[f32; RANK]]) {
        if length < SHORT_SIDE {
            let away = SIDE_PLACE * length;
            for (i, out) in out.iter_mut().enumerate() {
                let middle = madd::<FMA>(i as f32, length, first);
                let a = self.values::<FMA>(middle - away);
                let b = self.values::<FMA>(middle + away);
                for k in 0..RANK {
                    out[k] = 0.5 * (a[k] + b[k]);
                }
            }
            return;
        }
        let begin = first - 0.5 * length;
        let (mut before, mut sign_before) = self.sums::<FMA>(begin);
        let per_length = 1.0 / length;
        for (i, out) in out.iter_mut().enumerate() {
            let end = madd::<FMA>((i + 1) as f32, length, begin);
            let (after, sign) = self.sums::<FMA>(end);
            let (of_after, of_before) = (sign * per_length, sign_before * per_length);
            for k in 0..RANK {
                out[k] = madd::<FMA>(of_after, after[k], -(of_before * before[k]));
            }
            (before, sign_before) = (after, sign);
        }
    }
}

/// Returns the sum of a list and of three lists with weights.
#[inline(always)]
fn series<const FMA: bool>(
    first: &[f32; RANK],
    [a, b, c]: [&[f32; RANK]; 3],
    [of_a, of_b, of_c]: [f32; 3],
) -> [f32; RANK] {
    let mut sum = [0.0; RANK];
    for k in 0..RANK {
        let small = madd::<FMA>(of_b, b[k], of_c * c[k]);
        sum[k] = first[k] + madd::<FMA>(of_a, a[k], small);
    }
    sum
}

/// Returns the eigenvalues of a symmetric matrix, each with its eigenvector of length 1, by Jacobi's rotations.
fn eigen(mut matrix: Vec<Vec<f64>>) -> Vec<(f64, Vec<f64>)> {
    /// The rotations converge quadratically.
    const SWEEPS: usize = 12;
    let count = matrix.len();
    let unit = |i: usize| (0..count).map(|j| f64::from(u8::from(i == j))).collect();
    let mut vectors: Vec<Vec<f64>> = (0..count).map(unit).collect();
    let size = matrix.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    for _ in 0..SWEEPS {
        for p in 0..count {
            for q in p + 1..count {
                if matrix[p][q].abs() <= 1e-17 * size {
                    continue;
                }
                let cotangent = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
                let tangent = cotangent.signum() / (cotangent.abs() + cotangent.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let sine = tangent * cosine;
                let turned = |a: f64, b: f64| (cosine * a - sine * b, sine * a + cosine * b);
                for row in &mut matrix {
                    (row[p], row[q]) = turned(row[p], row[q]);
                }
                for lists in [&mut matrix, &mut vectors] {
                    let (head, tail) = lists.split_at_mut(q);
                    for (a, b) in head[p].iter_mut().zip(&mut tail[0]) {
                        (*a, *b) = turned(*a, *b);
                    }
                }
            }
        }
    }
    let eigenvalues: Vec<f64> = (0..count).map(|i| matrix[i][i]).collect();
    eigenvalues.into_iter().zip(vectors).collect()
}

/// A footprint that is drawn by its SPH kernel.
#[derive(Debug, Clone, Copy)]
pub struct Smoothed {
    profiles: &'static Profiles,
    /// Supports in a pixel along an axis; along x, at a fixed y.
    per_px: [f32; 2],
    /// Change of x by y on the line through the middles of the rows.
    tilt: f32,
    /// Factor of a pixel's sum of products, as column.
    pub(crate) amplitude: f32,
    /// Rows of a pixel: at most [`MOST_ROWS`].
    rows: f32,
    /// Pixels in a support along x, at a fixed y.
    reach_px: f32,
    /// Half of a pixel's width, and the way of a sheared row's middle from the pixel's middle to its edges, px.
    margin_px: f32,
}

/// The rows into which a kernel divides pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows {
    /// From the footprint's centre to the pixels' centres, px.
    dy: f32,
    /// Half of the chord of the pixels that the kernel reaches, px.
    half_chord: f32,
    /// From the footprint's centre to the rows' middles, px.
    middles: [f32; MOST_ROWS],
    weights: [[f32; RANK]; MOST_ROWS],
}

impl Smoothed {
    /// Returns the kernel of an affine footprint; `None` if it is drawn as a Gaussian.
    #[inline(always)]
    pub(crate) fn of(view: &ViewUniform, footprint: &Footprint) -> Option<Self> {
        if view.smoothing == 0 || !is_of_pixels(view.low_pass_variance_px2) {
            return None;
        }
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let wide = 1.0 / (px * ry - py * rx).abs();
        let reach_squared = (wide - PIXEL_VARIANCE_PX2) * REACHES[place_of(view.smoothing)];
        // Phrased so that NaN is drawn as a Gaussian.
        if !(reach_squared >= LEAST_DRAWN_PX * LEAST_DRAWN_PX && reach_squared.is_finite()) {
            return None;
        }
        // Distances in supports, from the quadratic form.
        let per_form = wide / reach_squared;
        let along = px * px + rx * rx;
        let tilt = -(px * py + rx * ry) / along;
        let x = (along * per_form).sqrt();
        // The area of a pixel is that of its form.
        let area = per_form / wide;
        let rows = ROWS_PER_SHEAR * (tilt.abs() * area).sqrt();
        Some(Self {
            profiles: Profiles::of(view.smoothing),
            per_px: [x, area / x],
            tilt,
            amplitude: footprint.tau * TAU * per_form,
            rows: rows.ceil().clamp(1.0, MOST_ROWS as f32),
            reach_px: 1.0 / x,
            margin_px: 0.5 + 0.5 * tilt.abs(),
        })
    }

    /// Returns whether means over pixels are sums of products of a row and a column.
    #[inline(always)]
    pub(crate) fn is_separable(&self) -> bool {
        self.tilt.abs() <= LEAST_TILT
    }

    /// Writes the factors of neighbouring pixels along an axis.
    ///
    /// - `first`: distance of the first pixel's centre from the footprint's, px.
    #[inline(always)]
    pub(crate) fn factors<const FMA: bool>(
        &self,
        axis: usize,
        first: f32,
        out: &mut [[f32; RANK]],
    ) {
        let per_px = self.per_px[axis];
        self.profiles.means::<FMA>(first * per_px, per_px, out);
    }

    /// Returns the weights of the factors along x by those along y.
    #[inline(always)]
    pub(crate) fn weights(&self, of_y: &[f32; RANK]) -> [f32; RANK] {
        let mut weights = [0.0; RANK];
        for k in 0..RANK {
            weights[k] = self.profiles.signs[k] * of_y[k];
        }
        weights
    }

    /// Returns the rows of pixels.
    ///
    /// - `dy`: distance of the pixels' centres from the footprint's along y, px.
    #[inline(always)]
    pub(crate) fn rows<const FMA: bool>(&self, dy: f32) -> Rows {
        let share = 1.0 / self.rows;
        let per_px = self.per_px[1];
        let mut rows = Rows {
            dy,
            half_chord: self.half_chord(dy),
            middles: [0.0; MOST_ROWS],
            weights: [[0.0; RANK]; MOST_ROWS],
        };
        let mut row = 0.0;
        for (middle, weights) in rows.middles.iter_mut().zip(&mut rows.weights) {
            if row >= self.rows {
                break;
            }
            *middle = dy + (row + 0.5) * share - 0.5;
            let of_y = self.profiles.mean::<FMA>(*middle * per_px, share * per_px);
            *weights = self.weights(&of_y);
            row += 1.0;
        }
        rows
    }

    /// Returns the mean over a pixel.
    ///
    /// - `dx`: distance of the pixel's centre from the footprint's along x, px.
    /// - `rows`: the pixel's rows.
    #[inline(always)]
    pub(crate) fn mean<const FMA: bool>(&self, dx: f32, rows: &Rows) -> f32 {
        if !((dx - self.tilt * rows.dy).abs() < rows.half_chord) {
            return 0.0;
        }
        let per_px = self.per_px[0];
        let (mut sum, mut row) = (0.0, 0.0);
        for (dy, weights) in rows.middles.iter().zip(&rows.weights) {
            if row >= self.rows {
                break;
            }
            row += 1.0;
            let middle = (dx - self.tilt * dy) * per_px;
            let of_x = self.profiles.mean::<FMA>(middle, per_px);
            for k in 0..RANK {
                sum = madd::<FMA>(weights[k], of_x[k], sum);
            }
        }
        // Sums of products fall below 0 near the rim, by less than their error.
        self.amplitude * (sum / self.rows).max(0.0)
    }

    /// Returns half of the extent along an axis of the pixels that the kernel reaches, px.
    #[inline(always)]
    pub(crate) fn half_extent(&self, axis: usize) -> f32 {
        1.0 / self.per_px[axis] + 0.5
    }

    /// Returns half of the chord, along a row of pixels, of the pixels that the kernel reaches, px; 0 if it reaches none.
    ///
    /// - `dy`: distance of the row's middle from the footprint's, px.
    #[inline(always)]
    pub(crate) fn half_chord(&self, dy: f32) -> f32 {
        let y = (dy.abs() - 0.5).max(0.0) * self.per_px[1];
        if y >= 1.0 {
            return 0.0;
        }
        (1.0 - y * y).sqrt() * self.reach_px + self.margin_px
    }
}

#[cfg(test)]
#[expect(
    clippy::cast_possible_truncation,
    reason = "inputs are narrowed on purpose"
)]
mod tests {
    use super::*;

    #[test]
    fn products_are_the_projections_of_the_kernels() {
        for (which, reach) in REACHES.into_iter().enumerate() {
            let profiles = Profiles::new(which);
            let steps = 1000;
            let places = || (0..steps).map(|i| (f64::from(i) + 0.5) / f64::from(steps));
            // Over t = b²: the area is pi dt.
            let sum = |of: &dyn Fn(f64) -> f64| places().map(of).sum::<f64>() / f64::from(steps);
            let mass = std::f64::consts::PI * sum(&|t| projected(which, t));
            let variance = sum(&|t| t * projected(which, t)) / 2.0;
            let variance = std::f64::consts::PI * variance / mass;
            assert!(
                (f64::from(reach) * variance - 1.0).abs() < 1e-4,
                "{which}: {variance}"
            );
            let peak = projected(which, 0.0) / mass;
            let mut worst = 0.0_f64;
            for x in (0..=55).map(|i| f64::from(i) / 50.0) {
                for y in (0..=55).map(|i| f64::from(i) / 50.0) {
                    let [of_x, of_y] = [x, y].map(|x| profiles.values::<false>(narrowed(x)));
                    let product = |k: usize| f64::from(profiles.signs[k] * of_x[k] * of_y[k]);
                    let own: f64 = (0..RANK).map(product).sum();
                    let truth = projected(which, x * x + y * y) / mass;
                    worst = worst.max((own - truth).abs() / peak);
                }
            }
            println!("{which}: {worst:.1e}");
            assert!(worst < 2.5e-5, "{which}: {worst:e}");
            let whole: f64 = (0..RANK)
                .map(|k| {
                    f64::from(profiles.signs[k])
                        * f64::from(2.0 * profiles.knots[PROFILE_CELLS][0][k]).powi(2)
                })
                .sum();
            assert!((whole - 1.0).abs() < 1e-6, "{which}: mass {whole}");
        }
    }

    #[test]
    fn means_along_sides_do_not_depend_on_the_rule() {
        let profiles = Profiles::new(0);
        for middle in [-1.2_f32, -0.4, 0.0, 0.013, 0.7, 0.99, 1.02] {
            let at = |length: f32| profiles.mean::<false>(middle, length);
            let (short, long) = (at(0.999 * SHORT_SIDE), at(SHORT_SIDE));
            for k in 0..RANK {
                let error = (short[k] - long[k]).abs() / profiles.knots[0][1][0];
                assert!(error < 1e-4, "{k} at {middle}: {error:e}");
            }
        }
    }

    /// Returns a footprint that is `reach` pixels in support, sheared.
    fn footprint(reach: f64, tilt: f64, stretch: f64) -> Footprint {
        // A circle, stretched along y and sheared, widened by a pixel.
        let variance = reach * reach / f64::from(REACHES[0]);
        let own = [
            variance * (1.0 + (tilt * stretch).powi(2)),
            variance * tilt * stretch * stretch,
            variance * stretch * stretch,
        ];
        let scale = 1.0 + f64::from(PIXEL_VARIANCE_PX2) / (variance * stretch);
        let [xx, xy, yy] = own.map(|v| v * scale);
        // Cholesky, of the inverse.
        let determinant = xx * yy - xy * xy;
        let [a, b, c] = [yy, -xy, xx].map(|v| v / determinant);
        let px = a.sqrt();
        let (py, ry) = (b / px, (c - b * b / a).sqrt());
        Footprint {
            form_p: [px as f32, py as f32],
            form_r: [0.0, ry as f32],
            tau: 1.0,
            ..Footprint::zeroed()
        }
    }

    #[test]
    fn means_of_sheared_kernels_are_those_of_brute_force() {
        let view = ViewUniform {
            smoothing: 1,
            low_pass_variance_px2: PIXEL_VARIANCE_PX2,
            ..ViewUniform::zeroed()
        };
        let count = 1 << 12;
        let table: Vec<f64> = (0..=count)
            .map(|i| projected(0, f64::from(i) / f64::from(count)))
            .collect();
        // In units of the support.
        let mass = std::f64::consts::PI * table.iter().sum::<f64>() / f64::from(count)
            - std::f64::consts::FRAC_PI_2 * table[0] / f64::from(count);
        for reach in [0.3, 1.0, 2.5, 8.0, 30.0] {
            for tilt in [0.0, 0.01, 0.1, 0.5] {
                let footprint = footprint(reach, tilt, 1.2);
                let Some(own) = Smoothed::of(&view, &footprint) else {
                    panic!("{reach}: a Gaussian")
                };
                let [x, y] = own.per_px.map(f64::from);
                let at = |dx: f64, dy: f64| {
                    let u = (dx - f64::from(own.tilt) * dy) * x;
                    let t = u * u + (dy * y).powi(2);
                    let place = t * f64::from(count);
                    let [low, high] = *table.get(place as usize..)?.first_chunk()?;
                    Some(low + (high - low) * place.fract())
                };
                let (mut worst, mut greatest) = (0.0_f64, 0.0_f64);
                let half = (2.0 * reach).ceil() as i32 + 1;
                let parts = (100.0 / reach).ceil().clamp(5.0, 100.0) as i32;
                let step = if reach > 10.0 { 5 } else { 1 };
                for j in (-half..=half).step_by(step) {
                    for i in (-half..=half).step_by(step) {
                        let d = [f64::from(i) + 0.13, f64::from(j) - 0.34];
                        let mut truth = 0.0;
                        for n in 0..parts * parts {
                            let part = [n % parts, n / parts];
                            let [u, v] =
                                part.map(|n| (f64::from(n) + 0.5) / f64::from(parts) - 0.5);
                            truth += at(d[0] + u, d[1] + v).unwrap_or(0.0);
                        }
                        truth /= f64::from(parts * parts);
                        let mean = f64::from(
                            own.mean::<false>(d[0] as f32, &own.rows::<false>(d[1] as f32)),
                        );
                        let mean = mean / f64::from(own.amplitude);
                        greatest = greatest.max(truth);
                        worst = worst.max((mean * mass - truth).abs());
                    }
                }
                let error = worst / greatest;
                println!("{reach} px, tilt {tilt}: {error:.1e}, {} rows", own.rows);
                // The products err by 2e-5, and the midpoints of this test by up to 8e-5. Eight rows are too few for small kernels.
                let most = 1e-4 + 2e-3 * tilt / reach.max(1.0);
                assert!(error < most, "{reach} px, tilt {tilt}: {error:e}");
            }
        }
    }
}
