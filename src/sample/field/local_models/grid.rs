//! Fits local models on curvilinear grids, by differences along the indices.
//!
//! First differences of positions and values are F = ∂x/∂(i, j, k) and f_a, second ones X_ab and f_ab. Then g =
//! F⁻ᵀ f_a and H = F⁻ᵀ (f_ab - g·X_ab) F⁻¹. They are exact for quadratic fields on lattices, including sheared
//! ones, and of second order on smooth grids. At borders and beside samples without a value, first differences
//! are one-sided and second ones zero.

use glam::{DMat3, DVec3, DVec4, Vec4Swizzles as _};

use super::super::gradient::{SPANNING, Samples};
use super::quadratic::{Quadratic, fit};
use super::{Range, local_model};
use crate::math::narrowed;
use crate::scene::LocalModel;

/// Number of steps along each index over which the range of values extends.
const RINGS: usize = 2;

/// Greatest number of samples in a run.
pub(in crate::sample) const RUN: usize = 32;

/// Samples of a run, with [`RINGS`] more at either end.
const WIDE: usize = RUN + 2 * RINGS;

/// Kernel of one sample.
pub(in crate::sample) struct GridKernel {
    /// Centre, world units.
    pub(in crate::sample) centre: DVec3,
    /// Factor of the variance, world units: lower-triangular.
    pub(in crate::sample) factor: [f32; 6],
    /// Standard deviation over the local spacing.
    pub(in crate::sample) width: f64,
}

/// Consecutive samples along i, with those around them.
pub(in crate::sample) struct Run {
    /// Positions and values in the nine rows around, with one sample more at either end; NaN if unknown.
    rows: [[DVec4; RUN + 2]; 9],
    /// Ranges of the values within [`RINGS`] steps along each index.
    ranges: [Range; RUN],
}

impl Run {
    /// - `values`: values of all samples, NaN if unknown.
    /// - `first`: index of the run's first sample; `count`: number of its samples, at most [`RUN`].
    pub(in crate::sample) fn new<F: Fn([usize; 3]) -> Option<(DVec3, f64)>>(
        samples: &Samples<F>,
        values: &[f32],
        [first, j, k]: [usize; 3],
        count: usize,
    ) -> Self {
        let columns: [Option<usize>; WIDE] = std::array::from_fn(|n| {
            let step = n as isize - RINGS as isize;
            let is_near = n < count + 2 * RINGS;
            is_near.then(|| samples.along(0, first, step)).flatten()
        });
        let row = |j_step: isize, k_step: isize| {
            Some([samples.along(1, j, j_step)?, samples.along(2, k, k_step)?])
        };
        let mut rows = [[DVec4::NAN; RUN + 2]; 9];
        for (n, places) in rows.iter_mut().enumerate() {
            let Some([j, k]) = row((n % 3) as isize - 1, (n / 3) as isize - 1) else {
                continue;
            };
            for (place, column) in places.iter_mut().zip(&columns[RINGS - 1..]) {
                let known = column.and_then(|i| (samples.at)([i, j, k]));
                if let Some((position, value)) = known {
                    *place = position.extend(value);
                }
            }
        }
        let [ni, nj, _] = samples.dims;
        let near = || -(RINGS as isize)..=RINGS as isize;
        let wide_rows = near().flat_map(|k_step| near().map(move |j_step| [j_step, k_step]));
        let lines = wide_rows.filter_map(|[j_step, k_step]| {
            let [j, k] = row(j_step, k_step)?;
            Some(&values[ni * (j + nj * k)..][..ni])
        });
        let ranges = pulp::Arch::new().dispatch(Ranges { lines, columns });
        Self { rows, ranges }
    }

    /// Returns the local model of the run's `n`-th sample.
    pub(in crate::sample) fn model(&self, n: usize, kernel: &GridKernel) -> LocalModel {
        let range = self.ranges[n];
        let factor = super::matrix_of(kernel.factor);
        let own = self.rows[4][n + 1];
        let value = narrowed(own.w);
        if own.w.is_nan() {
            let nothing = Quadratic::default();
            return local_model(&nothing, factor, DVec3::ZERO, value, range, 1.0);
        }
        // Position and value relative to the sample's own.
        let at = |[i, j, k]: [isize; 3]| {
            let row = 4_usize.checked_add_signed(j + 3 * k)?;
            let other = self.rows[row][(n + 1).checked_add_signed(i)?];
            (!other.w.is_nan()).then(|| other - own)
        };
        let offset = kernel.centre - own.xyz();
        // A quadratic that is linear along an index changes along it by at most the spread of the neighbours'
        // values.
        let steepest = (3.0_f64.sqrt() * kernel.width).max(1.0);
        match by_differences(at) {
            Some(quadratic) => local_model(&quadratic, factor, offset, value, range, steepest),
            None => {
                let inverse = super::inverse_of(factor);
                let (turned, factor) = match inverse {
                    Some(inverse) => (inverse, DMat3::IDENTITY),
                    None => (DMat3::IDENTITY, factor),
                };
                let quadratic = by_least_squares(at, turned);
                local_model(&quadratic, factor, turned * offset, value, range, steepest)
            }
        }
    }
}

/// Computes the ranges of the values within [`RINGS`] steps of each sample of a run, compiled for the
/// processor's vector instructions.
struct Ranges<L> {
    /// Values of the rows within that many steps along j and k.
    lines: L,
    /// Columns of the run in these rows, with [`RINGS`] samples at either end.
    columns: [Option<usize>; WIDE],
}

impl<'a, L: Iterator<Item = &'a [f32]>> pulp::NullaryFnOnce for Ranges<L> {
    type Output = [Range; RUN];

    #[inline(always)]
    fn call(self) -> [Range; RUN] {
        ranges(self.lines, &self.columns)
    }
}

#[inline(always)]
fn ranges<'a>(
    lines: impl Iterator<Item = &'a [f32]>,
    columns: &[Option<usize>; WIDE],
) -> [Range; RUN] {
    // The columns are contiguous unless an index closes within the run.
    let begin = columns.iter().take_while(|column| column.is_none()).count();
    let piece = &columns[begin..];
    let length = piece.iter().take_while(|column| column.is_some()).count();
    let from = piece.first().copied().flatten().unwrap_or(0);
    let is_one = (from..)
        .zip(&piece[..length])
        .all(|(i, column)| *column == Some(i));
    let (mut least, mut greatest) = ([f32::INFINITY; WIDE], [f32::NEG_INFINITY; WIDE]);
    for line in lines {
        let mut values = [f32::NAN; WIDE];
        if is_one {
            values[begin..begin + length].copy_from_slice(&line[from..from + length]);
        } else {
            for (value, column) in values.iter_mut().zip(columns) {
                *value = column.map_or(f32::NAN, |i| line[i]);
            }
        }
        for n in 0..WIDE {
            // Comparisons with NaN are false.
            least[n] = if values[n] < least[n] {
                values[n]
            } else {
                least[n]
            };
            greatest[n] = if values[n] > greatest[n] {
                values[n]
            } else {
                greatest[n]
            };
        }
    }
    std::array::from_fn(|n| {
        let near = (n..=n + 2 * RINGS).map(|n| Range {
            least: least[n],
            greatest: greatest[n],
        });
        near.fold(Range::EMPTY, Range::and)
    })
}

/// Fits by differences of position and value to samples some steps away, if known. Returns `None` if the
/// positions' differences do not span space: on singular lines, in single layers, beside missing samples.
fn by_differences(at: impl Fn([isize; 3]) -> Option<DVec4>) -> Option<Quadratic> {
    let step = |axis: usize, by: isize| {
        let mut steps = [0; 3];
        steps[axis] = by;
        steps
    };
    let mut first = [DVec4::ZERO; 3];
    let mut second = [[DVec4::ZERO; 3]; 3];
    for a in 0..3 {
        match (at(step(a, -1)), at(step(a, 1))) {
            (Some(before), Some(after)) => {
                first[a] = (after - before) * 0.5;
                second[a][a] = after + before;
            }
            (None, Some(after)) => first[a] = after,
            (Some(before), None) => first[a] = -before,
            (None, None) => {}
        }
    }
    let jacobian = DMat3::from_cols(first[0].xyz(), first[1].xyz(), first[2].xyz());
    let lengths: f64 = first.iter().map(|f| f.xyz().length()).product();
    // Phrased so that NaN counts as singular.
    let spans = jacobian.determinant().abs() > SPANNING * lengths;
    if !spans {
        return None;
    }
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let corner = |i: isize, j: isize| {
            let mut steps = step(a, i);
            steps[b] = j;
            at(steps)
        };
        let corners = (corner(1, 1), corner(-1, -1), corner(1, -1), corner(-1, 1));
        if let (Some(pp), Some(mm), Some(pm), Some(mp)) = corners {
            second[a][b] = (pp + mm - pm - mp) * 0.25;
            second[b][a] = second[a][b];
        }
    }
    let inverse = jacobian.inverse();
    let gradient = inverse.transpose() * DVec3::new(first[0].w, first[1].w, first[2].w);
    let column = |b: usize| {
        let entry = |a: usize| second[a][b].w - gradient.dot(second[a][b].xyz());
        DVec3::new(entry(0), entry(1), entry(2))
    };
    let along_indices = DMat3::from_cols(column(0), column(1), column(2));
    Some(Quadratic {
        gradient,
        hessian: inverse.transpose() * along_indices * inverse,
    })
}

/// Fits to all 26 neighbours by least squares, in coordinates `turned` * world.
fn by_least_squares(at: impl Fn([isize; 3]) -> Option<DVec4>, turned: DMat3) -> Quadratic {
    let around = (0..27_usize).filter_map(|n| {
        let other = at([n % 3, n / 3 % 3, n / 9].map(|s| s as isize - 1))?;
        Some((turned * other.xyz(), other.w))
    });
    fit(&around.collect::<Vec<_>>()).quadratic
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lower_factor;

    const WIDTH: f64 = 0.8;
    const SLOPE: DVec3 = DVec3::new(0.3, -1.7, 0.9);

    fn bend() -> DMat3 {
        DMat3::from_cols_array(&[1.0, 0.4, -0.7, 0.4, -2.0, 0.2, -0.7, 0.2, 3.5])
    }

    fn quadratic(x: DVec3) -> f64 {
        1.0 + SLOPE.dot(x) + 0.5 * x.dot(bend() * x)
    }

    struct Case<P, V> {
        dims: [usize; 3],
        periods: [Option<usize>; 3],
        place: P,
        field: V,
    }

    impl<P: Fn(DVec3) -> DVec3, V: Fn(DVec3) -> f64> Case<P, V> {
        /// Returns the model of a sample and the factor of its kernel, rho F, with F from differences of
        /// `place` itself. The kernel's centre lies `offset` away from the sample.
        fn model(&self, sample: [usize; 3], offset: DVec3) -> (LocalModel, DMat3) {
            let index = |s: [usize; 3]| DVec3::from(s.map(|i| i as f64));
            let at = |s: [usize; 3]| {
                let position = (self.place)(index(s));
                let value = (self.field)(position);
                value.is_finite().then_some((position, value))
            };
            let samples = Samples {
                dims: self.dims,
                periods: self.periods,
                at,
            };
            let middle = index(sample);
            let column = |d: DVec3| {
                ((self.place)(middle + 1e-4 * d) - (self.place)(middle - 1e-4 * d)) * (WIDTH / 2e-4)
            };
            let jacobian = DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
            let factor = lower_factor(jacobian).map(narrowed);
            let kernel = GridKernel {
                centre: (self.place)(middle) + offset,
                factor,
                width: WIDTH,
            };
            let [ni, nj, nk] = self.dims;
            let value = |n: usize| at([n % ni, n / ni % nj, n / (ni * nj)]);
            let values: Vec<f32> = (0..ni * nj * nk)
                .map(|n| value(n).map_or(f32::NAN, |(_, v)| narrowed(v)))
                .collect();
            // As the last sample of a run of several.
            let before = sample[0].min(5);
            let first = [sample[0] - before, sample[1], sample[2]];
            let model = Run::new(&samples, &values, first, before + 1).model(before, &kernel);
            (model, super::super::matrix_of(factor))
        }
    }

    /// Returns tr(H V) / 2.
    fn prefilter(hessian: DMat3, factor: DMat3) -> f64 {
        let product = factor.transpose() * hessian * factor;
        0.5 * (product.x_axis.x + product.y_axis.y + product.z_axis.z)
    }

    fn sheared(s: DVec3) -> DVec3 {
        let step = DMat3::from_cols_array(&[0.5, 0.1, 0.0, -0.2, 0.4, 0.1, 0.0, 0.3, 0.6]);
        step * s - DVec3::splat(0.7)
    }

    fn curved(n: f64) -> impl Fn(DVec3) -> DVec3 {
        move |s| {
            let [a, r, z] = (DVec3::ONE + s / n).to_array();
            DVec3::new(r * a.cos(), r * a.sin(), z * z + 0.2 * a * r)
        }
    }

    #[test]
    fn quadratic_fields_are_exact_on_lattices_sheared_ones_too() {
        let case = Case {
            dims: [7; 3],
            periods: [None; 3],
            place: sheared,
            field: quadratic,
        };
        for sample in [[3, 3, 3], [1, 2, 5]] {
            let place = sheared(DVec3::from(sample.map(|i| i as f64)));
            for offset in [DVec3::ZERO, DVec3::new(0.1, -0.05, 0.2)] {
                let (model, factor) = case.model(sample, offset);
                let gradient = SLOPE + bend() * place;
                let slope = factor.transpose() * gradient;
                // Factors and models are stored in f32.
                let off = (model.slope.as_dvec3() - slope).length();
                assert!(off < 1e-6 * slope.length(), "{off}");
                let at_centre = gradient.dot(offset) + 0.5 * offset.dot(bend() * offset);
                let departure = at_centre + prefilter(bend(), factor);
                let off = (f64::from(model.departure) - departure).abs();
                assert!(off < 1e-6, "{sample:?} {offset} {departure}: {off}");
            }
        }
    }

    #[test]
    fn the_prefilter_undoes_what_sums_of_linear_models_blur() {
        // sum v k (f + g.(x - x_i)) = f - tr(H V) / 2; with f + departure in place of f, it is f itself. At a
        // width of .8 the lattice ripples by 2e-5.
        let case = Case {
            dims: [13; 3],
            periods: [None; 3],
            place: sheared,
            field: quadratic,
        };
        let at = sheared(DVec3::new(6.2, 5.7, 6.4));
        let step = DMat3::from_cols(
            sheared(DVec3::X) - sheared(DVec3::ZERO),
            sheared(DVec3::Y) - sheared(DVec3::ZERO),
            sheared(DVec3::Z) - sheared(DVec3::ZERO),
        );
        let (mut blurred, mut sharp) = (0.0, 0.0);
        let mut expected = 0.0;
        for n in 0..11_usize.pow(3) {
            // One sample inside the border: all neighbours exist.
            let sample = [n % 11 + 1, n / 11 % 11 + 1, n / 121 + 1];
            let centre = sheared(DVec3::from(sample.map(|i| i as f64)));
            let (model, factor) = case.model(sample, DVec3::ZERO);
            let inverse = factor.inverse();
            let local = inverse * (at - centre);
            let weight = step.determinant() * (-0.5 * local.length_squared()).exp()
                / (std::f64::consts::TAU.powf(1.5) * factor.determinant());
            let linear = quadratic(centre) + model.slope.as_dvec3().dot(local);
            blurred += weight * linear;
            sharp += weight * (linear + f64::from(model.departure));
            expected = prefilter(bend(), factor);
        }
        // Kernels end at 6 deviations: 1e-6.
        let truth = quadratic(at);
        assert!(expected.abs() > 0.05, "{expected}");
        assert!(
            (blurred - (truth - expected)).abs() < 3e-4,
            "{blurred} {truth} {expected}"
        );
        assert!((sharp - truth).abs() < 3e-4, "{sharp} {truth}");
    }

    #[test]
    fn curved_grids_are_of_second_order() {
        let worst = |n: usize| {
            let case = Case {
                dims: [n + 1; 3],
                periods: [None; 3],
                place: curved(n as f64),
                field: |x: DVec3| quadratic(x) + (2.0 * x.x).sin() * x.z,
            };
            let mut worst = [0.0_f64; 2];
            for m in 0..(n - 1).pow(3) {
                let sample =
                    [m % (n - 1), m / (n - 1) % (n - 1), m / (n - 1).pow(2)].map(|i| i + 1);
                let x = curved(n as f64)(DVec3::from(sample.map(|i| i as f64)));
                let (model, factor) = case.model(sample, DVec3::ZERO);
                let (sin, cos) = (2.0 * x.x).sin_cos();
                let gradient = SLOPE + bend() * x + DVec3::new(2.0 * cos * x.z, 0.0, sin);
                let mut hessian = bend();
                hessian.x_axis.x -= 4.0 * sin * x.z;
                hessian.x_axis.z += 2.0 * cos;
                hessian.z_axis.x += 2.0 * cos;
                let slope = factor.transpose() * gradient;
                let (w, p) = (slope.length(), prefilter(hessian, factor));
                worst[0] = worst[0].max((model.slope.as_dvec3() - slope).length() / w.max(1e-3));
                // Relative to the squares of the spacing: 1 would be an error as large as the term.
                worst[1] = worst[1].max((f64::from(model.departure) - p).abs() * (n * n) as f64);
            }
            worst
        };
        let (coarse, fine) = (worst(10), worst(20));
        for (coarse, fine) in coarse.into_iter().zip(fine) {
            let ratio = coarse / fine;
            assert!((3.0..5.0).contains(&ratio), "{coarse} {fine}");
        }
    }

    #[test]
    fn ranges_hold_two_rings_and_no_more() {
        let spike = |x: DVec3| {
            let index = (sheared_inverse() * (x + DVec3::splat(0.7))).round();
            match index.to_array() {
                [5.0, 1.0, 3.0] => 10.0,
                [6.0, 3.0, 3.0] => 90.0,
                [3.0, 3.0, 2.0] => f64::NAN,
                [3.0, 4.0, 4.0] => -4.0,
                _ => 1.0,
            }
        };
        let case = Case {
            dims: [7; 3],
            periods: [None; 3],
            place: sheared,
            field: spike,
        };
        let (model, _) = case.model([3, 3, 3], DVec3::ZERO);
        let is_over = |x: f32, y: f32| (y..=y * 1.000_001).contains(&x);
        assert!(
            is_over(model.above, 9.0) && is_over(model.below, 5.0),
            "{model:?}"
        );
        // Around a closed index.
        let closed = Case {
            periods: [Some(6), None, None],
            ..case
        };
        let (model, _) = closed.model([0, 3, 3], DVec3::ZERO);
        assert!(is_over(model.above, 9.0), "{model:?}");
        let (model, _) = closed.model([1, 3, 3], DVec3::ZERO);
        assert!(
            is_over(model.above, 9.0) || is_over(model.below, 5.0),
            "{model:?}"
        );
    }

    fn sheared_inverse() -> DMat3 {
        let zero = sheared(DVec3::ZERO);
        DMat3::from_cols(
            sheared(DVec3::X) - zero,
            sheared(DVec3::Y) - zero,
            sheared(DVec3::Z) - zero,
        )
        .inverse()
    }

    #[test]
    fn seams_are_no_borders() {
        let n = 24;
        let ring = move |s: DVec3| {
            let angle = std::f64::consts::TAU * s.x / n as f64;
            (1.0 + 0.1 * s.y) * DVec3::new(angle.cos(), angle.sin(), 0.0) + 0.1 * DVec3::Z * s.z
        };
        let closed = Case {
            dims: [n + 1, 5, 5],
            periods: [Some(n), None, None],
            place: ring,
            field: |x: DVec3| x.x * x.x - 0.5 * x.y * x.y,
        };
        // Half a turn away the field is the same.
        let [(a, _), (b, _)] = [0, n / 2].map(|i| closed.model([i, 2, 2], DVec3::ZERO));
        assert!((a.departure - b.departure).abs() < 1e-6, "{a:?} {b:?}");
        assert!((a.slope.length() - b.slope.length()).abs() < 1e-6);
        assert!((a.above - b.above).abs() < 1e-6 && (a.below - b.below).abs() < 1e-6);
    }

    #[test]
    fn holes_borders_and_layers_have_what_they_can() {
        let linear = |x: DVec3| 4.0 + SLOPE.dot(x);
        let holes = move |x: DVec3| {
            let index = (sheared_inverse() * (x + DVec3::splat(0.7))).round();
            let n = index.dot(DVec3::new(1.0, 7.0, 49.0));
            if n % 3.0 == 0.0 { f64::NAN } else { linear(x) }
        };
        let offset = DVec3::new(0.05, 0.02, -0.03);
        let case = Case {
            dims: [7; 3],
            periods: [None; 3],
            place: sheared,
            field: holes,
        };
        for n in 0..7_usize.pow(3) {
            let sample = [n % 7, n / 7 % 7, n / 49];
            let (model, factor) = case.model(sample, offset);
            if n % 3 == 0 {
                assert_eq!(model.slope, glam::Vec3::ZERO);
                assert_eq!((model.departure, model.above), (0.0, 0.0));
                continue;
            }
            // Linear fields are exact at borders and beside holes, also off the kernel's centre.
            let slope = factor.transpose() * SLOPE;
            let off = (model.slope.as_dvec3() - slope).length();
            assert!(off < 2e-4 * slope.length(), "{sample:?}: {off} of {slope}");
            let off = (f64::from(model.departure) - SLOPE.dot(offset)).abs();
            assert!(off < 1e-3, "{sample:?}: {off}");
        }
        // One layer: curvature along it is known; across it the field is constant.
        let flat = Case {
            dims: [7, 7, 1],
            periods: [None; 3],
            place: |s: DVec3| s * 0.5,
            field: |x: DVec3| 3.0 * x.z + x.x * x.x,
        };
        let (model, _) = flat.model([3, 3, 0], DVec3::ZERO);
        let w = 2.0 * 1.5 * 0.5 * WIDTH;
        assert!(
            (model.slope.as_dvec3() - DVec3::X * w).length() < 1e-3,
            "{model:?}"
        );
        // x² has the second derivative 2: rho² h².
        let bend = WIDTH * WIDTH * 0.25;
        assert!(
            (f64::from(model.departure) - bend).abs() < 1e-3,
            "{model:?}"
        );
        // A lone sample, and a line whose samples coincide.
        let lone = Case {
            dims: [1; 3],
            ..flat
        };
        let (model, _) = lone.model([0; 3], DVec3::X);
        assert_eq!((model.slope, model.departure), (glam::Vec3::ZERO, 0.0));
        let axis = Case {
            dims: [9, 5, 5],
            periods: [None; 3],
            place: |s: DVec3| {
                let (sin, cos) = (0.2 * s.x).sin_cos();
                DVec3::new(s.y * cos, s.y * sin, s.z)
            },
            field: linear,
        };
        let (model, _) = axis.model([4, 0, 2], DVec3::ZERO);
        assert!(model.slope.is_finite() && model.departure.is_finite());
    }
}
