//! Computes lower-triangular factors of variances in f64, and principal axes.

use glam::{DMat3, DQuat, DVec3};

use crate::error::{Error, Result};
use crate::simd::{SimdLevel, SimdWork, run_at};

/// Returns the lower-triangular L with L Lᵀ = F Fᵀ: l00, l10, l11, l20, l21, l22. Its diagonal is not negative.
///
/// F = L Q by Householder reflections from the right, so the error is that of rounding F, and short axes keep
/// their digits (F Fᵀ would lose them beyond a ratio of 1e8 in f64). F may have any rank; a zero matrix gives
/// zeros. Lengths may range from 1e-150 to 1e150.
pub fn lower_factor(f: DMat3) -> [f64; 6] {
    // Rows of F; a reflection acts on all rows alike.
    let mut rows = [f.row(0), f.row(1), f.row(2)];
    reflect_tail(&mut rows, 0);
    reflect_tail(&mut rows, 1);
    let [a, b, c] = rows;
    // The sign of a column of L is free.
    let sign = [a.x, b.y, c.z].map(|d| if d < 0.0 { -1.0 } else { 1.0 });
    [
        a.x * sign[0],
        b.x * sign[0],
        b.y * sign[1],
        c.x * sign[0],
        c.y * sign[1],
        c.z * sign[2],
    ]
}

/// Reflects so that row `k` is zero beyond its element `k`; elements before `k` stay.
#[inline(always)]
fn reflect_tail(rows: &mut [DVec3; 3], k: usize) {
    let mut v = rows[k];
    if k > 0 {
        v.x = 0.0;
    }
    let length = v.length();
    if length <= 0.0 || !length.is_finite() {
        return;
    }
    // The sign avoids cancellation: v = tail + sign(head) |tail| e_k.
    let head = v[k];
    let image = if head < 0.0 { length } else { -length };
    v[k] = head - image;
    let v_squared = v.length_squared();
    if v_squared <= 0.0 {
        return;
    }
    for row in rows.iter_mut() {
        *row -= v * (2.0 * v.dot(*row) / v_squared);
    }
    // Set exactly, not just up to rounding.
    let before = if k > 0 { rows[k].x } else { 0.0 };
    rows[k] = DVec3::ZERO;
    rows[k].x = before;
    rows[k][k] = image;
}

/// A variance matrix, from xx, xy, xz, yy, yz, zz or from a matrix. It is checked when its factor is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variance(DMat3);

impl From<[f64; 6]> for Variance {
    fn from([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Self {
        Self(DMat3::from_cols_array(&[
            xx, xy, xz, xy, yy, yz, xz, yz, zz,
        ]))
    }
}

impl From<DMat3> for Variance {
    fn from(matrix: DMat3) -> Self {
        Self(matrix)
    }
}

impl Variance {
    /// Returns the lower-triangular factor L with V = L Lᵀ: l00, l10, l11, l20, l21, l22.
    ///
    /// Negative eigenvalues within the rounding of a file's single precision, 1e-6 of the trace, count as zero.
    ///
    /// ```
    /// use ewa_splat::math::Variance;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let factor = Variance::from([0.25, 0.0, 0.0, 0.09, 0.0, 0.01]).factor()?;
    /// assert_eq!(factor, [0.5, 0.0, 0.3, 0.0, 0.0, 0.1]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// A matrix that is not symmetric, not positive semi-definite, zero or not finite.
    pub fn factor(&self) -> Result<[f64; 6]> {
        /// Rounding of single precision, as a share of the trace.
        const ROUNDING: f64 = 1e-6;
        let Self(m) = self;
        let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
        let trace = x.x + y.y + z.z;
        let skew = [x.y - y.x, x.z - z.x, y.z - z.y];
        // Phrased so that NaN counts as not symmetric.
        let is_symmetric = skew.iter().all(|d| d.abs() <= ROUNDING * trace);
        let elements = [x.x, x.y, x.z, y.y, y.z, z.z];
        let factor = Some(elements).filter(|_| is_symmetric);
        factor.and_then(factor_of_variance).ok_or_else(|| {
            Error::invalid(
                "variance",
                "matrix",
                "a symmetric positive semi-definite matrix other than 0",
                m.to_string(),
                "correct it, or leave it out",
            )
        })
    }
}

/// Returns the lower-triangular factor of a variance given as vxx, vxy, vxz, vyy, vyz, vzz; `None` if it is
/// indefinite, zero or not finite.
///
/// The method is Cholesky's recurrence unless a pivot is small. Near a singular variance, the recurrence would
/// divide the rounding of the elements by a small pivot and find valid f32 data indefinite: eigenvectors are
/// used instead. Negative eigenvalues within rounding (1e-6 of the trace) count as zero.
pub(crate) fn factor_of_variance(variance: [f64; 6]) -> Option<[f64; 6]> {
    const ROUNDING: f64 = 1e-6;
    let [xx, _, _, yy, _, zz] = variance;
    let trace = xx + yy + zz;
    if !(trace > 0.0 && variance.iter().all(|v| v.is_finite())) {
        return None;
    }
    if let Some(factor) = cholesky(variance, ROUNDING * trace) {
        return Some(factor);
    }
    let (eigenvalues, axes) = eigen(variance.map(|v| v / trace));
    if eigenvalues.min_element() < -ROUNDING {
        return None;
    }
    let sigmas = (eigenvalues.max(DVec3::ZERO) * trace).map(f64::sqrt);
    Some(lower_factor(axes * DMat3::from_diagonal(sigmas)))
}

/// Returns Cholesky's factor if all squared pivots are greater than `least`.
fn cholesky([xx, xy, xz, yy, yz, zz]: [f64; 6], least: f64) -> Option<[f64; 6]> {
    let l00 = xx.sqrt();
    let (l10, l20) = (xy / l00, xz / l00);
    let pivot_y = yy - l10 * l10;
    let l11 = pivot_y.sqrt();
    let l21 = (yz - l20 * l10) / l11;
    let pivot_z = zz - l20 * l20 - l21 * l21;
    let is_sound = xx > least && pivot_y > least && pivot_z > least;
    is_sound.then(|| [l00, l10, l11, l20, l21, pivot_z.sqrt()])
}

/// Returns the eigenvalues of a symmetric matrix xx, xy, xz, yy, yz, zz, in no order, and the corresponding
/// axes as columns.
pub(crate) fn eigen([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> (DVec3, DMat3) {
    let mut v = DMat3::from_cols(
        DVec3::new(xx, xy, xz),
        DVec3::new(xy, yy, yz),
        DVec3::new(xz, yz, zz),
    );
    // Cyclic Jacobi (Golub and Van Loan, Matrix Computations, 8.5). It converges quadratically: eight sweeps
    // leave rounding only, usually four or five. Off-diagonal elements count as zero if they are rounding of
    // their two diagonal elements, so that small eigenvalues keep their digits.
    let mut axes = DMat3::IDENTITY;
    for _ in 0..8 {
        let mut is_diagonal = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (beside, above, below) = (v.col(q)[p], v.col(p)[p], v.col(q)[q]);
            let rounding = f64::EPSILON * (above * below).abs().sqrt();
            if beside.abs() <= rounding.max(f64::MIN_POSITIVE) {
                continue;
            }
            is_diagonal = false;
            let (t, c) = rotation_of((below - above) / (2.0 * beside));
            let s = t * c;
            let mut rotation = DMat3::IDENTITY;
            rotation.col_mut(p)[p] = c;
            rotation.col_mut(q)[q] = c;
            rotation.col_mut(q)[p] = s;
            rotation.col_mut(p)[q] = -s;
            v = rotation.transpose() * v * rotation;
            axes *= rotation;
        }
        if is_diagonal {
            break;
        }
    }
    (DVec3::new(v.x_axis.x, v.y_axis.y, v.z_axis.z), axes)
}

/// Returns tangent and cosine of the smaller of the two rotations that make a pair perpendicular; `zeta` is the
/// cotangent of twice its angle.
#[inline(always)]
fn rotation_of(zeta: f64) -> (f64, f64) {
    // If the square overflows, t is below all rounding.
    let t = zeta.signum() / (zeta.abs() + (zeta * zeta + 1.0).sqrt());
    (t, 1.0 / (t * t + 1.0).sqrt())
}

/// Returns axes diag(eigenvalues) axesᵀ as xx, xy, xz, yy, yz, zz.
pub(crate) fn from_eigen(eigenvalues: DVec3, axes: DMat3) -> [f64; 6] {
    let v = axes * DMat3::from_diagonal(eigenvalues) * axes.transpose();
    symmetric(v)
}

/// Returns xx, xy, xz, yy, yz, zz of a symmetric matrix.
pub(crate) fn symmetric(v: DMat3) -> [f64; 6] {
    [
        v.x_axis.x, v.x_axis.y, v.x_axis.z, v.y_axis.y, v.y_axis.z, v.z_axis.z,
    ]
}

/// Returns the matrix of a lower-triangular factor: the inverse of [`lower_factor`].
pub(crate) fn lower_matrix([l00, l10, l11, l20, l21, l22]: [f64; 6]) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(l00, l10, l20),
        DVec3::new(0.0, l11, l21),
        DVec3::new(0.0, 0.0, l22),
    )
}

/// Returns the standard deviations along the principal axes of L Lᵀ, greatest first.
pub(crate) fn principal_sigmas(factor: [f64; 6]) -> [f64; 3] {
    principal_axes(lower_matrix(factor)).map(DVec3::length)
}

/// Number of kernels whose deviations are found together.
pub(crate) const TOGETHER: usize = 8;

/// A number for each of some kernels.
type Lanes = [f64; TOGETHER];

/// Returns the deviations of [`principal_sigmas`] of several finite kernels, bit for bit.
pub(crate) fn principal_sigmas_together(factors: &[[f32; 6]; TOGETHER]) -> [[f64; 3]; TOGETHER] {
    run_at(SimdLevel::best(), PrincipalSigmas(factors))
}

struct PrincipalSigmas<'a>(&'a [[f32; 6]; TOGETHER]);

impl SimdWork for PrincipalSigmas<'_> {
    type Output = [[f64; 3]; TOGETHER];

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) -> Self::Output {
        let mut columns = [[[0.0; TOGETHER]; 3]; 3];
        for (n, factor) in self.0.iter().enumerate() {
            let [l00, l10, l11, l20, l21, l22] = factor.map(f64::from);
            for (column, own) in
                columns
                    .iter_mut()
                    .zip([[l00, l10, l20], [0.0, l11, l21], [0.0, 0.0, l22]])
            {
                for (lanes, x) in column.iter_mut().zip(own) {
                    lanes[n] = x;
                }
            }
        }
        let [mut a, mut b, mut c] = columns;
        for _ in 0..SWEEPS {
            // In the order of [`principal_axes`], one rotation after the other.
            let first = rotate(&mut a, &mut b);
            let second = rotate(&mut a, &mut c);
            let third = rotate(&mut b, &mut c);
            if !(first | second | third) {
                break;
            }
        }
        let mut squared = [[0.0; TOGETHER]; 3];
        for (squared, column) in squared.iter_mut().zip([&a, &b, &c]) {
            *squared = dots(column, column);
        }
        let mut sigmas = [[0.0; 3]; TOGETHER];
        for (n, sigmas) in sigmas.iter_mut().enumerate() {
            let own = [squared[0][n], squared[1][n], squared[2][n]];
            *sigmas = greatest_first(own, |squared| *squared).map(f64::sqrt);
        }
        sigmas
    }
}

#[inline(always)]
fn dots(a: &[Lanes; 3], b: &[Lanes; 3]) -> Lanes {
    let mut dots = [0.0; TOGETHER];
    for n in 0..TOGETHER {
        dots[n] = a[0][n] * b[0][n] + a[1][n] * b[1][n] + a[2][n] * b[2][n];
    }
    dots
}

/// Rotates each pair of columns once, so that it is perpendicular. Returns false if all were.
#[inline(always)]
fn rotate(a: &mut [Lanes; 3], b: &mut [Lanes; 3]) -> bool {
    let (aa, bb, dot) = (dots(a, a), dots(b, b), dots(a, b));
    let (mut tangents, mut cosines) = ([0.0; TOGETHER], [1.0; TOGETHER]);
    let mut rotates = false;
    for n in 0..TOGETHER {
        let (t, c) = rotation_of((bb[n] - aa[n]) / (2.0 * dot[n]));
        let is_done = are_perpendicular(dot[n], aa[n], bb[n]);
        tangents[n] = if is_done { 0.0 } else { t };
        cosines[n] = if is_done { 1.0 } else { c };
        rotates |= !is_done;
    }
    for (a, b) in a.iter_mut().zip(b) {
        for n in 0..TOGETHER {
            let (own, other) = (a[n], b[n]);
            a[n] = (own - other * tangents[n]) * cosines[n];
            b[n] = (own * tangents[n] + other) * cosines[n];
        }
    }
    rotates
}

/// Greatest number of sweeps of [`principal_axes`]. It converges quadratically; six leave rounding only.
const SWEEPS: usize = 6;

/// Returns true if two columns are perpendicular up to rounding.
///
/// - `dot`, `aa`, `bb`: their product, and their squared lengths.
#[inline(always)]
fn are_perpendicular(dot: f64, aa: f64, bb: f64) -> bool {
    // Fourth powers of what single precision holds neither overflow nor underflow.
    dot * dot <= f64::EPSILON * f64::EPSILON * (aa * bb)
}

/// Returns the principal axes of F Fᵀ, each as long as its standard deviation, longest first.
pub(crate) fn principal_axes(f: DMat3) -> [DVec3; 3] {
    // One-sided Jacobi on the columns: it rotates pairs until they are perpendicular; their lengths are then
    // the singular values (Golub and Van Loan, Matrix Computations, 8.6).
    let mut columns = [f.x_axis, f.y_axis, f.z_axis];
    for _ in 0..SWEEPS {
        let mut is_done = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (columns[p], columns[q]);
            let dot = a.dot(b);
            let (aa, bb) = (a.length_squared(), b.length_squared());
            if are_perpendicular(dot, aa, bb) {
                continue;
            }
            is_done = false;
            let (t, c) = rotation_of((bb - aa) / (2.0 * dot));
            columns[p] = (a - b * t) * c;
            columns[q] = (a * t + b) * c;
        }
        if is_done {
            break;
        }
    }
    let by_length = columns.map(|column| (column.length_squared(), column));
    greatest_first(by_length, |(squared, _)| *squared).map(|(_, column)| column)
}

/// Sorts three items by a number, the greatest first.
#[inline(always)]
fn greatest_first<T>(mut items: [T; 3], number: impl Fn(&T) -> f64) -> [T; 3] {
    for (p, q) in [(0, 1), (1, 2), (0, 1)] {
        if number(&items[p]) < number(&items[q]) {
            items.swap(p, q);
        }
    }
    items
}

/// Returns the standard deviations along a kernel's own axes, greatest first, and the rotation from x, y, z to
/// these axes: F Fᵀ = R diag(sigmas)² Rᵀ.
///
/// If axes have no length (surfels, needles), perpendicular ones complete the frame.
pub(crate) fn scales_and_rotation(f: DMat3) -> ([f64; 3], DQuat) {
    let axes = principal_axes(f);
    let sigmas = axes.map(DVec3::length);
    let x = axes[0].try_normalize().unwrap_or(DVec3::X);
    // Perpendicular to the first up to rounding, however short it is.
    let y = axes[1]
        .try_normalize()
        .and_then(|y| (y - x * x.dot(y)).try_normalize());
    let y = y.unwrap_or_else(|| x.any_orthonormal_vector());
    let rotation = DMat3::from_cols(x, y, x.cross(y));
    (sigmas, DQuat::from_mat3(&rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::narrowed;
    use proptest::prelude::*;

    #[test]
    fn deviations_found_together_are_those_found_alone() {
        let noise = |n: usize, d: usize| narrowed(((n * 7 + d + 1) as f64 * 1.7).sin());
        let scale = |n: usize| narrowed(10_f64.powf((n % 60) as f64 - 30.0));
        for n in 0..200 {
            let factors: [[f32; 6]; TOGETHER] = std::array::from_fn(|m| {
                let of = 8 * n + m;
                let own: [f32; 6] = std::array::from_fn(|d| noise(of, d) * scale(of));
                let [a, b, c, d, e, f] = own;
                match m {
                    // Round, flat, a needle, nothing.
                    0 => [a, 0.0, a, 0.0, 0.0, a],
                    1 => [a, b, c, d, e, 0.0],
                    2 => [a, b, 0.0, d, 0.0, 0.0],
                    3 => [0.0; 6],
                    4 => [a * 1e-6, b, c * 1e6, d, e, f],
                    _ => own,
                }
            });
            let alone = factors.map(|factor| principal_sigmas(factor.map(f64::from)));
            assert_eq!(principal_sigmas_together(&factors), alone, "{factors:?}");
        }
    }

    fn gap(a: DMat3, b: DMat3) -> f64 {
        let d = a - b;
        d.x_axis.length() + d.y_axis.length() + d.z_axis.length()
    }

    fn matrices() -> impl Strategy<Value = DMat3> {
        let column = || prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from_array);
        let scale = || prop_oneof![Just(0.0), (-9.0f64..9.0).prop_map(|e| 10f64.powf(e))];
        (
            column(),
            column(),
            column(),
            prop::array::uniform3(scale()),
            0u8..4,
        )
            .prop_map(|(a, b, c, s, copy)| {
                let b = if copy == 1 { a } else { b };
                let c = if copy == 2 { a - b } else { c };
                DMat3::from_cols(a * s[0], b * s[1], c * s[2])
            })
    }

    proptest! {
        #[test]
        fn scales_and_rotation_reproduce_the_variance(f in matrices()) {
            let (sigmas, rotation) = scales_and_rotation(f);
            let r = DMat3::from_quat(rotation);
            let turned = r * DMat3::from_diagonal(DVec3::from(sigmas));
            let v = f * f.transpose();
            let trace = v.x_axis.x + v.y_axis.y + v.z_axis.z;
            // Some fifty f64 rounding errors, and a quaternion's.
            prop_assert!(gap(turned * turned.transpose(), v) <= 1e-13 * trace);
            prop_assert!(sigmas[0] >= sigmas[1] && sigmas[1] >= sigmas[2]);
            prop_assert!(gap(r * r.transpose(), DMat3::IDENTITY) <= 1e-14);
            prop_assert!(r.determinant() > 0.0);
        }

        #[test]
        fn factors_reproduce_the_variance(f in matrices()) {
            let lower = lower_factor(f);
            let l = lower_matrix(lower);
            let v = f * f.transpose();
            let scale = v.x_axis.x + v.y_axis.y + v.z_axis.z;
            // Some thirty f64 rounding errors.
            prop_assert!(gap(l * l.transpose(), v) <= 1e-14 * scale);
            prop_assert!(lower[0] >= 0.0 && lower[2] >= 0.0 && lower[5] >= 0.0);
            let sigmas = principal_sigmas(lower);
            let product = f.determinant().abs();
            let bound = sigmas[0] * sigmas[0] * sigmas[0];
            prop_assert!((sigmas[0] * sigmas[1] * sigmas[2] - product).abs() <= 1e-13 * bound);
            let squares: f64 = sigmas.iter().map(|s| s * s).sum();
            prop_assert!((squares - scale).abs() <= 1e-13 * scale);
        }

        #[test]
        #[allow(clippy::cast_possible_truncation, reason = "as a table holds them")]
        fn factors_are_found_for_every_variance_and_refuses_the_rest(f in matrices(), shift in 0.0f64..1.0) {
            let v = f * f.transpose();
            let trace = v.x_axis.x + v.y_axis.y + v.z_axis.z;
            prop_assume!(trace > 1e-300);
            let shift = shift * trace;
            let elements = |shift: f64| [
                v.x_axis.x - shift, v.x_axis.y, v.x_axis.z,
                v.y_axis.y - shift, v.y_axis.z, v.z_axis.z - shift,
            ].map(|x| f64::from((x / trace) as f32));
            let l = factor_of_variance(elements(0.0));
            prop_assert!(l.is_some());
            let l = lower_matrix(l.unwrap());
            // Nine f32 rounding errors, and the distance of a negative eigenvalue from zero.
            prop_assert!(gap(l * l.transpose(), v * (1.0 / trace)) <= 1e-6);
            let least = principal_sigmas(lower_factor(f))[2].powi(2) / trace;
            if shift / trace > least + 1e-5 && 3.0 * shift < trace {
                prop_assert!(factor_of_variance(elements(shift)).is_none());
            }
        }
    }
}
