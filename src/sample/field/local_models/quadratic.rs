//! Fits a quadratic to a field about a sample, by least squares over its neighbours.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DMat3, DVec3};

use crate::simd::{SimdLevel, SimdWork, run_at};

/// Least distance of a neighbour, as a share of the root mean square distance; nearer ones count as if they
/// were this far. Two samples almost at one place do not determine a gradient.
const NEAREST: f64 = 0.05;

/// Damping added to the diagonal of the normal equations, as a share of their mean entries. It is far smaller
/// for the gradient than for second derivatives, so that an ambiguous change counts as linear. Undetermined
/// terms become zero: across a plane the field is constant, across two layers linear. Determined terms are
/// corrected [`REFINEMENTS`] times and err by some 1e-6.
const GRADIENT_DAMPING: f64 = 1e-8;
/// Damping of the second derivatives; see [`GRADIENT_DAMPING`].
const HESSIAN_DAMPING: f64 = 1e-4;
/// Number of refinements; see [`GRADIENT_DAMPING`].
const REFINEMENTS: usize = 2;

/// A second derivative is determined if this share of its column is independent of the others'.
const INDEPENDENT: f64 = 1e-2;

/// value(x + d) ~ value(x) + g·d + dᵀ H d / 2.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::sample) struct Quadratic {
    pub(in crate::sample) gradient: DVec3,
    pub(in crate::sample) hessian: DMat3,
}

/// A quadratic and the quality of its fit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Fitted {
    pub(super) quadratic: Quadratic,
    /// Root mean square distance of the neighbours.
    pub(super) distance: f64,
    /// True if the neighbours determine all nine unknowns.
    pub(super) is_determined: bool,
}

/// Number of fits that are made together.
pub(super) const LANES: usize = 8;

/// A number for each of some fits.
type Lanes<const N: usize> = [f64; N];

/// Offsets of neighbours from a sample, and changes of the value.
pub(super) type Changes = Vec<(DVec3, f64)>;

/// Fits the gradient and the second derivatives of a quadratic through a sample's value to its neighbours.
///
/// - `neighbours`: those without a finite change are ignored.
///
/// There are nine unknowns; weights are 1/distance². With too few neighbours, or degenerate ones, the second
/// derivatives are the least ones (in the coordinates of the offsets) that fit. Without neighbours all are
/// zero.
pub(super) fn fit(neighbours: &[(DVec3, f64)]) -> Fitted {
    let [fitted] = run_at(SimdLevel::best(), Fit([neighbours]));
    fitted
}

/// Returns what [`fit`] does, bit for bit, for up to [`LANES`] samples; nothing for those without a list.
pub(super) fn fit_together(neighbours: &[Changes]) -> [Fitted; LANES] {
    let list = |n: usize| neighbours.get(n).map_or(&[][..], |list| list);
    run_at(SimdLevel::best(), Fit(std::array::from_fn(list)))
}

/// Runs [`fitted`] compiled for the processor's vector instructions.
struct Fit<'a, const N: usize>([&'a [(DVec3, f64)]; N]);

impl<const N: usize> SimdWork for Fit<'_, N> {
    type Output = [Fitted; N];

    #[inline(always)]
    fn run<const FMA: bool, const WIDTH: usize>(self) -> [Fitted; N] {
        fitted(self.0)
    }
}

/// Equations for the nine unknowns of each fit.
struct Equations<const N: usize> {
    matrix: [[Lanes<N>; 9]; 9],
    right: [Lanes<N>; 9],
}

#[inline(always)]
fn fitted<const N: usize>(neighbours: [&[(DVec3, f64)]; N]) -> [Fitted; N] {
    let is_known =
        |&(offset, change): &(DVec3, f64)| change.is_finite() && offset.length_squared() > 0.0;
    let mut count = [0.0; N];
    let mut distance = [f64::NAN; N];
    for (l, list) in neighbours.iter().enumerate() {
        let known = list.iter().copied().filter(is_known);
        count[l] = known.clone().count() as f64;
        let squares: f64 = known.map(|(offset, _)| offset.length_squared()).sum();
        distance[l] = (squares / count[l]).sqrt();
    }
    let mut equations = Equations {
        matrix: [[[0.0; N]; 9]; 9],
        right: [[0.0; N]; 9],
    };
    let longest = neighbours.iter().map(|list| list.len()).max().unwrap_or(0);
    for n in 0..longest {
        let mut offsets = [[0.0; N]; 3];
        let mut changes = [0.0; N];
        let mut shares = [0.0; N];
        for (l, list) in neighbours.iter().enumerate() {
            if let Some(&(offset, change)) = list.get(n).filter(|one| is_known(one)) {
                for (d, offsets) in offsets.iter_mut().enumerate() {
                    offsets[l] = offset[d] / distance[l];
                }
                changes[l] = change;
                shares[l] = 1.0;
            }
        }
        equations.add(&offsets, &changes, &shares);
    }
    // Sums of squares over all nine are `count` for the gradient and a quarter of it for H.
    let damping = |i: usize, l: usize| match i {
        0..3 => GRADIENT_DAMPING * count[l] / 3.0,
        _ => HESSIAN_DAMPING * count[l] / 24.0,
    };
    let (factor, is_determined) = factorise(&equations.matrix, damping);
    let mut unknowns = solve(&factor, equations.right);
    for _ in 0..REFINEMENTS {
        let correction = solve(&factor, equations.rest(&unknowns));
        for (x, correction) in unknowns.iter_mut().zip(&correction) {
            for l in 0..N {
                x[l] += correction[l];
            }
        }
    }
    std::array::from_fn(|l| {
        let distance = distance[l];
        if !(distance > 0.0 && distance.is_finite()) {
            return Fitted::default();
        }
        let [gx, gy, gz, xx, yy, zz, xy, xz, yz] = unknowns.map(|x| x[l]);
        let [xy, xz, yz] = [xy, xz, yz].map(|h| h * FRAC_1_SQRT_2);
        let hessian = DMat3::from_cols(
            DVec3::new(xx, xy, xz),
            DVec3::new(xy, yy, yz),
            DVec3::new(xz, yz, zz),
        );
        Fitted {
            quadratic: Quadratic {
                gradient: DVec3::new(gx, gy, gz) / distance,
                hessian: hessian * (1.0 / (distance * distance)),
            },
            distance,
            is_determined: is_determined[l] && count[l] >= 9.0,
        }
    })
}

impl<const N: usize> Equations<N> {
    /// Adds one neighbour of each sample.
    ///
    /// - `offsets`: x, y and z over the root mean square distance.
    /// - `shares`: 1, or 0 for a sample that has no such neighbour.
    #[inline(always)]
    fn add(&mut self, offsets: &[Lanes<N>; 3], changes: &Lanes<N>, shares: &Lanes<N>) {
        let mut weights = [0.0; N];
        let mut row = [[0.0; N]; 9];
        for l in 0..N {
            let [x, y, z] = offsets.map(|offset| offset[l]);
            let squared = x * x + y * y + z * z;
            let nearest = NEAREST * NEAREST;
            weights[l] = shares[l] / if squared > nearest { squared } else { nearest };
            // Products of two coordinates belong to two entries of H. The factor 1/sqrt(2) makes the sum of the
            // unknowns' squares that of H's entries, which does not depend on the axes.
            let mixed = [x, y, z].map(|d| d * FRAC_1_SQRT_2);
            let own = [
                x,
                y,
                z,
                0.5 * x * x,
                0.5 * y * y,
                0.5 * z * z,
                mixed[0] * y,
                mixed[0] * z,
                mixed[1] * z,
            ];
            for (row, own) in row.iter_mut().zip(own) {
                row[l] = own;
            }
        }
        for (i, own) in row.iter().enumerate() {
            let weighted = product(&weights, own);
            add_product(&mut self.right[i], 1.0, &weighted, changes);
            for (entry, other) in self.matrix[i].iter_mut().zip(&row[..=i]) {
                add_product(entry, 1.0, &weighted, other);
            }
        }
    }

    /// Returns what unknowns leave of the right sides.
    #[inline(always)]
    fn rest(&self, unknowns: &[Lanes<N>; 9]) -> [Lanes<N>; 9] {
        let mut rest = self.right;
        for (i, rest) in rest.iter_mut().enumerate() {
            for (j, unknown) in unknowns.iter().enumerate() {
                // The matrix is symmetric; its lower half is stored.
                add_product(rest, -1.0, &self.matrix[i.max(j)][i.min(j)], unknown);
            }
        }
        rest
    }
}

#[inline(always)]
fn product<const N: usize>(a: &Lanes<N>, b: &Lanes<N>) -> Lanes<N> {
    std::array::from_fn(|l| a[l] * b[l])
}

/// Adds `sign` a b to a sum.
#[inline(always)]
fn add_product<const N: usize>(sum: &mut Lanes<N>, sign: f64, a: &Lanes<N>, b: &Lanes<N>) {
    for l in 0..N {
        sum[l] += sign * (a[l] * b[l]);
    }
}

/// Returns the Cholesky factors of matrices with `damping` on their diagonals; the factors' own diagonals are
/// inverted. Also returns true if all columns are independent.
#[inline(always)]
fn factorise<const N: usize>(
    matrix: &[[Lanes<N>; 9]; 9],
    damping: impl Fn(usize, usize) -> f64,
) -> ([[Lanes<N>; 9]; 9], [bool; N]) {
    let mut factor = [[[0.0; N]; 9]; 9];
    let mut is_determined = [true; N];
    for i in 0..9 {
        for j in 0..=i {
            let mut left = matrix[i][j];
            let [own, other] = [&factor[i], &factor[j]];
            for (a, b) in own[..j].iter().zip(other) {
                add_product(&mut left, -1.0, a, b);
            }
            for l in 0..N {
                factor[i][j][l] = if i > j {
                    left[l] * factor[j][j][l]
                } else {
                    is_determined[l] &= left[l] > INDEPENDENT * matrix[i][i][l];
                    // Rounding removes no more than the damping.
                    let positive = if left[l] > 0.0 { left[l] } else { 0.0 };
                    1.0 / (positive + damping(i, l)).sqrt()
                };
            }
        }
    }
    (factor, is_determined)
}

#[inline(always)]
fn solve<const N: usize>(factor: &[[Lanes<N>; 9]; 9], mut x: [Lanes<N>; 9]) -> [Lanes<N>; 9] {
    for i in 0..9 {
        let mut own = x[i];
        for (entry, other) in factor[i][..i].iter().zip(&x) {
            add_product(&mut own, -1.0, entry, other);
        }
        x[i] = product(&own, &factor[i][i]);
    }
    for i in (0..9).rev() {
        let mut own = x[i];
        for (line, other) in factor.iter().zip(&x).skip(i + 1) {
            add_product(&mut own, -1.0, &line[i], other);
        }
        x[i] = product(&own, &factor[i][i]);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRADIENT: DVec3 = DVec3::new(0.3, -1.7, 0.9);

    fn hessian() -> DMat3 {
        DMat3::from_cols_array(&[1.0, 0.4, -0.7, 0.4, -2.0, 0.2, -0.7, 0.2, 0.5])
    }

    fn change(d: DVec3) -> f64 {
        GRADIENT.dot(d) + 0.5 * d.dot(hessian() * d)
    }

    /// Returns offsets spread over a cube, without a pattern.
    fn spread(count: usize) -> impl Iterator<Item = DVec3> {
        (1..=count).map(|i| {
            let t = i as f64;
            let share = |step: f64| 2.0 * (step * t).fract() - 1.0;
            // Powers of the plastic number's inverse (Roberts 2018).
            DVec3::new(share(0.819_172), share(0.671_044), share(0.549_700))
        })
    }

    fn with(offsets: impl Iterator<Item = DVec3>) -> Vec<(DVec3, f64)> {
        offsets.map(|d| (d, change(d))).collect()
    }

    fn error(a: DMat3, b: DMat3) -> f64 {
        let difference = a - b;
        let squares = difference
            .to_cols_array()
            .iter()
            .map(|x| x * x)
            .sum::<f64>();
        squares.sqrt()
    }

    #[test]
    fn quadratic_fields_are_exact() {
        for (count, scale) in [(14, 1.0), (24, 1e-6), (60, 1e9)] {
            let neighbours: Vec<(DVec3, f64)> =
                spread(count).map(|d| (d * scale, change(d))).collect();
            let found = fit(&neighbours);
            assert!(found.is_determined, "{count}");
            let quadratic = found.quadratic;
            let off = (quadratic.gradient * scale - GRADIENT).length();
            let bend = error(quadratic.hessian * (scale * scale), hessian());
            // The damping leaves (1e-4 / 24 / .01)^3 of a term that is determined by a hundredth.
            assert!(off < 1e-5 && bend < 1e-4, "{count}: {off} {bend}");
        }
    }

    #[test]
    fn fits_made_together_are_those_made_alone() {
        let lists: Vec<Changes> = [9, 0, 14, 24, 3, 24, 60]
            .map(|count| with(spread(count)))
            .into();
        let same = |a: Fitted, b: Fitted| format!("{a:?}") == format!("{b:?}");
        for (list, together) in lists.iter().zip(fit_together(&lists)) {
            assert!(same(fit(list), together), "{together:?}");
        }
        assert!(same(fit_together(&lists)[LANES - 1], Fitted::default()));
    }

    #[test]
    fn few_neighbours_and_planes_give_what_they_can() {
        assert_eq!(fit(&[]).quadratic.gradient, DVec3::ZERO);
        let nothing = [(DVec3::ZERO, 1.0), (DVec3::X, f64::NAN), (DVec3::NAN, 1.0)];
        assert_eq!(fit(&nothing).quadratic.gradient, DVec3::ZERO);
        // One neighbour: the gradient takes all of its change, and points along it.
        let one = fit(&[(DVec3::X * 2.0, 6.0)]);
        assert!(!one.is_determined);
        let linear = one.quadratic.gradient + one.quadratic.hessian * DVec3::X;
        assert!((linear - DVec3::X * 3.0).length() < 1e-3, "{linear}");
        // A rotated plane: H within it is right, and nothing is known across.
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.7, 1.1, 0.4);
        let normal = turn * DVec3::Z;
        let plane = spread(30).map(|d| turn * d.with_z(0.0));
        let found = fit(&with(plane));
        assert!(!found.is_determined);
        let along = DMat3::IDENTITY
            - DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
        let off = (found.quadratic.gradient - along * GRADIENT).length();
        let bend = error(found.quadratic.hessian, along * hessian() * along);
        assert!(off < 1e-5 && bend < 1e-4, "{off} {bend}");
        // Two layers: linear across.
        let layers = spread(60).map(|d| DVec3::new(d.x, d.y, if d.z > 0.3 { 0.8 } else { 0.0 }));
        let found = fit(&layers
            .map(|d| (d, GRADIENT.dot(d) - d.x * d.x))
            .collect::<Vec<_>>());
        assert!(!found.is_determined);
        let quadratic = found.quadratic;
        // H takes the ratio of the two dampings, 3e-4.
        let off = (quadratic.gradient - GRADIENT).length();
        assert!(off < 1e-3, "{quadratic:?}");
        let expected = DMat3::from_diagonal(DVec3::new(-2.0, 0.0, 0.0));
        assert!(error(quadratic.hessian, expected) < 1e-3, "{quadratic:?}");
    }

    #[test]
    fn neighbours_almost_at_the_place_do_not_decide() {
        // A jump of 1 over a millionth of the spacing.
        let jump = (DVec3::X * 1e-6, 1.0);
        let found = fit(&with(spread(24))
            .into_iter()
            .chain([jump])
            .collect::<Vec<_>>());
        let off = (found.quadratic.gradient - GRADIENT).length();
        assert!(off < 0.1, "{off}");
    }
}
