//! Fits a quadratic to a field about a sample, by least squares over its neighbours.

use glam::{DMat3, DVec3};

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

/// Fits the gradient and the second derivatives of a quadratic through a sample's value to its neighbours.
///
/// - `neighbours`: offsets and changes of value; neighbours without a finite change are ignored.
///
/// There are nine unknowns; weights are 1/distance². With too few neighbours, or degenerate ones, the second
/// derivatives are the least ones (in the coordinates of the offsets) that fit. Without neighbours all are
/// zero.
pub(super) fn fit(neighbours: &[(DVec3, f64)]) -> Fitted {
    pulp::Arch::new().dispatch(Fit(neighbours))
}

/// Runs [`fitted`] compiled for the processor's vector instructions.
struct Fit<'a>(&'a [(DVec3, f64)]);

impl pulp::NullaryFnOnce for Fit<'_> {
    type Output = Fitted;

    #[inline(always)]
    fn call(self) -> Fitted {
        fitted(self.0)
    }
}

#[inline(always)]
fn fitted(neighbours: &[(DVec3, f64)]) -> Fitted {
    let known = || {
        neighbours
            .iter()
            .filter(|(offset, change)| change.is_finite() && offset.length_squared() > 0.0)
    };
    let count = known().count() as f64;
    let squares: f64 = known().map(|(offset, _)| offset.length_squared()).sum();
    let distance = (squares / count).sqrt();
    if !(distance > 0.0 && distance.is_finite()) {
        return Fitted::default();
    }
    let mut matrix = [[0.0; 9]; 9];
    let mut right = [0.0; 9];
    for (offset, change) in known() {
        let d = *offset / distance;
        let weight = 1.0 / d.length_squared().max(NEAREST * NEAREST);
        // Products of two coordinates belong to two entries of H. The factor 1/sqrt(2) makes the sum of the
        // unknowns' squares that of H's entries, which does not depend on the axes.
        let mixed = d * std::f64::consts::FRAC_1_SQRT_2;
        let row = [
            d.x,
            d.y,
            d.z,
            0.5 * d.x * d.x,
            0.5 * d.y * d.y,
            0.5 * d.z * d.z,
            mixed.x * d.y,
            mixed.x * d.z,
            mixed.y * d.z,
        ];
        for ((line, sum), a) in matrix.iter_mut().zip(&mut right).zip(row) {
            let weighted = weight * a;
            *sum += weighted * change;
            for (entry, b) in line.iter_mut().zip(row) {
                *entry += weighted * b;
            }
        }
    }
    // Sums of squares over all nine are `count` for the gradient and a quarter of it for H.
    let damping = |i: usize| match i {
        0..3 => GRADIENT_DAMPING * count / 3.0,
        _ => HESSIAN_DAMPING * count / 24.0,
    };
    let (factor, is_determined) = factorise(&matrix, damping);
    let mut unknowns = solve(&factor, right);
    for _ in 0..REFINEMENTS {
        let mut rest = right;
        for (rest, line) in rest.iter_mut().zip(&matrix) {
            *rest -= line.iter().zip(&unknowns).map(|(a, x)| a * x).sum::<f64>();
        }
        for (x, correction) in unknowns.iter_mut().zip(solve(&factor, rest)) {
            *x += correction;
        }
    }
    let [gx, gy, gz, xx, yy, zz, xy, xz, yz] = unknowns;
    let [xy, xz, yz] = [xy, xz, yz].map(|h| h * std::f64::consts::FRAC_1_SQRT_2);
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
        is_determined: is_determined && count >= 9.0,
    }
}

/// Returns the Cholesky factor of a matrix with `damping` on its diagonal; the factor's own diagonal is
/// inverted. Also returns true if all columns are independent.
#[inline(always)]
fn factorise(matrix: &[[f64; 9]; 9], damping: impl Fn(usize) -> f64) -> ([[f64; 9]; 9], bool) {
    let mut factor = [[0.0; 9]; 9];
    let mut is_determined = true;
    for i in 0..9 {
        for j in 0..i {
            let sum: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            factor[i][j] = (matrix[i][j] - sum) * factor[j][j];
        }
        let sum: f64 = factor[i][..i].iter().map(|l| l * l).sum();
        let left = matrix[i][i] - sum;
        is_determined &= left > INDEPENDENT * matrix[i][i];
        // Rounding removes no more than the damping.
        factor[i][i] = 1.0 / (left.max(0.0) + damping(i)).sqrt();
    }
    (factor, is_determined)
}

#[inline(always)]
fn solve(factor: &[[f64; 9]; 9], mut x: [f64; 9]) -> [f64; 9] {
    for i in 0..9 {
        let sum: f64 = (0..i).map(|k| factor[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) * factor[i][i];
    }
    for i in (0..9).rev() {
        let sum: f64 = (i + 1..9).map(|k| factor[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) * factor[i][i];
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
