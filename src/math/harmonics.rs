//! Computes real spherical harmonics up to degree 3, with the signs that radiance fields use.

use std::array;

use glam::{DMat3, DVec3, Vec3};

/// The constant harmonic, 1 / (2 sqrt(pi)).
pub const HARMONIC_0: f32 = 0.282_094_8;

/// Constant of degree 1: sqrt(3 / 4 pi).
pub(crate) const HARMONIC_1: f32 = 0.488_602_5;

/// Constants of degree 2: sqrt(15 / 4 pi), sqrt(5 / 16 pi).
pub(crate) const HARMONICS_2: [f32; 2] = [1.092_548_4, 0.315_391_57];

/// Constants of degree 3: sqrt(35 / 32 pi), sqrt(105 / 4 pi), sqrt(21 / 32 pi), sqrt(7 / 16 pi).
pub(crate) const HARMONICS_3: [f32; 4] = [0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34];

/// The greatest degree of [`harmonics`].
pub const MAX_HARMONICS_DEGREE: u8 = 3;

/// Returns the sixteen harmonics up to degree 3 in direction (x, y, z), a unit vector.
///
/// They are orthonormal on the sphere, ordered by degree l and then m = -l..=l, with the Condon-Shortley phase
/// (-1)^m. Degree 1 is sqrt(3 / 4 pi) (-y, z, -x), as in Kerbl et al. 2023, *3D Gaussian Splatting*, and in
/// every file of that layout.
#[inline]
pub fn harmonics(Vec3 { x, y, z }: Vec3) -> [f32; 16] {
    const L1: f32 = HARMONIC_1;
    const L2: [f32; 2] = HARMONICS_2;
    const L3: [f32; 4] = HARMONICS_3;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        HARMONIC_0,
        -L1 * y,
        L1 * z,
        -L1 * x,
        L2[0] * x * y,
        -L2[0] * y * z,
        L2[1] * (2.0 * zz - xx - yy),
        -L2[0] * x * z,
        0.5 * L2[0] * (xx - yy),
        -L3[0] * y * (3.0 * xx - yy),
        L3[1] * x * y * z,
        -L3[2] * y * (4.0 * zz - xx - yy),
        L3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -L3[2] * x * (4.0 * zz - xx - yy),
        0.5 * L3[1] * z * (xx - yy),
        -L3[0] * x * (xx - 3.0 * yy),
    ]
}

/// Returns [`harmonics`] in f64, for integrals and for laws that hold to more digits than f32 has.
fn harmonics_f64(DVec3 { x, y, z }: DVec3) -> [f64; 16] {
    use std::f64::consts::PI;
    let root = |numerator: f64, denominator: f64| (numerator / (denominator * PI)).sqrt();
    let l1 = root(3.0, 4.0);
    let l2 = [root(15.0, 4.0), root(5.0, 16.0)];
    let l3 = [
        root(35.0, 32.0),
        root(105.0, 4.0),
        root(21.0, 32.0),
        root(7.0, 16.0),
    ];
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        root(1.0, 4.0),
        -l1 * y,
        l1 * z,
        -l1 * x,
        l2[0] * x * y,
        -l2[0] * y * z,
        l2[1] * (2.0 * zz - xx - yy),
        -l2[0] * x * z,
        0.5 * l2[0] * (xx - yy),
        -l3[0] * y * (3.0 * xx - yy),
        l3[1] * x * y * z,
        -l3[2] * y * (4.0 * zz - xx - yy),
        l3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -l3[2] * x * (4.0 * zz - xx - yy),
        0.5 * l3[1] * z * (xx - yy),
        -l3[0] * x * (xx - 3.0 * yy),
    ]
}

/// Returns the number of coefficients of one colour channel for a degree: (degree + 1)².
pub fn harmonics_count(degree: u8) -> usize {
    (usize::from(degree) + 1).pow(2)
}

/// Returns 1/2 + the sum of coefficients times harmonics, per colour channel. `coefficients` are R, G, B of the
/// first harmonic, of the second, ...
#[inline]
pub fn harmonics_sum(coefficients: &[f32], basis: &[f32; 16]) -> [f32; 3] {
    let mut sum = [0.5; 3];
    for (rgb, y) in coefficients.chunks_exact(3).zip(basis) {
        sum = array::from_fn(|c| sum[c] + y * rgb[c]);
    }
    sum
}

/// Transforms coefficients by the linear map that moves the object they colour.
///
/// The colour seen along d in the world is the one that the coefficients give for the direction A⁻¹ d, with A
/// the map from their space to the world. The result is exact for rotations and uniform scales. Other maps turn
/// the harmonics into ones of all degrees; the nearest of the same degree is kept (least squares over the
/// sphere).
#[derive(Debug, Clone)]
pub(crate) struct HarmonicsTransform([[f64; 16]; 16]);

impl HarmonicsTransform {
    /// - `source_from_world`: maps directions of the world to those of the coefficients; any length.
    pub(crate) fn new(source_from_world: DMat3) -> Self {
        /// Zeros of the Legendre polynomial of degree 4, and their weights. With eight angles the rule is exact
        /// for polynomials of degree 7; products of two harmonics have degree 6.
        const NODES: [(f64, f64); 4] = [
            (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
            (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        ];
        /// Rounding error of an integral over the sphere, with its 32 products, from 0 or 1.
        const SNAP: f64 = 1e-14;
        let mut matrix = [[0.0; 16]; 16];
        for (z, weight) in NODES {
            let r = (1.0 - z * z).sqrt();
            for k in 0..8 {
                let angle = std::f64::consts::TAU * f64::from(k) / 8.0;
                let d = DVec3::new(r * angle.cos(), r * angle.sin(), z);
                let source = (source_from_world * d).normalize_or_zero();
                let basis = harmonics_f64(d);
                let seen = harmonics_f64(source);
                let weight = weight * std::f64::consts::TAU / 8.0;
                for (row, y) in matrix.iter_mut().zip(basis) {
                    for (cell, s) in row.iter_mut().zip(seen) {
                        *cell += weight * y * s;
                    }
                }
            }
        }
        // A rotation that maps axes to axes only changes signs of many harmonics: these stay exact.
        for cell in matrix.as_flattened_mut() {
            if (*cell - cell.round()).abs() <= SNAP {
                *cell = cell.round();
            }
        }
        Self(matrix)
    }

    /// Transforms the coefficients of one particle: R, G and B of each harmonic.
    pub(crate) fn apply(&self, coefficients: &mut [f32]) {
        let mut moved = [[0.0; 3]; 16];
        let count = coefficients.len() / 3;
        for (sum, row) in moved.iter_mut().zip(&self.0) {
            for (rgb, factor) in coefficients.chunks_exact(3).zip(row) {
                *sum = array::from_fn(|c| sum[c] + factor * f64::from(rgb[c]));
            }
        }
        for (rgb, sum) in coefficients
            .chunks_exact_mut(3)
            .zip(&moved[..count.min(16)])
        {
            #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
            for (c, sum) in rgb.iter_mut().zip(sum) {
                *c = *sum as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    #[test]
    fn moved_coefficients_show_the_same_colours() {
        let rotation = DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.1, 0.8).normalize());
        for degree in 0..=MAX_HARMONICS_DEGREE {
            let count = 3 * harmonics_count(degree);
            let coefficients: Vec<f32> = (0..count)
                .map(|i| ((7 * i) % 11) as f32 / 11.0 - 0.4)
                .collect();
            for scale in [1.0, 2.5] {
                let transform = HarmonicsTransform::new((rotation * scale).inverse());
                let mut moved = coefficients.clone();
                transform.apply(&mut moved);
                for d in [
                    DVec3::X,
                    DVec3::new(0.48, -0.6, 0.64),
                    DVec3::new(-0.8, 0.0, 0.6),
                ] {
                    let before = harmonics_sum(&coefficients, &harmonics(d.as_vec3()));
                    let after = harmonics_sum(&moved, &harmonics((rotation * d).as_vec3()));
                    for (a, b) in before.into_iter().zip(after) {
                        // Sixteen products of f32 harmonics on either side.
                        assert!((a - b).abs() < 5e-6, "degree {degree}: {a} and {b}");
                    }
                }
            }
        }
    }

    proptest! {
        /// A rotation is exact except for the rounding of the transformed coefficients: 6e-8 of each, which are
        /// below 1.4 (seven of .5), times harmonics whose squares sum to 16 / 4 pi.
        #[test]
        fn turned_coefficients_show_the_colours_of_directions_turned_back(
            axis in prop::array::uniform3(-1.0f64..1.0),
            angle in -7.0f64..7.0,
            seen in prop::array::uniform3(-1.0f64..1.0),
            coefficients in prop::collection::vec(-0.5f32..0.5, 48),
        ) {
            let (axis, seen) = (DVec3::from(axis), DVec3::from(seen));
            prop_assume!(axis.length() > 0.1 && seen.length() > 0.1);
            let rotation = DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle));
            let d = seen.normalize();
            let transform = HarmonicsTransform::new(rotation.transpose());
            for degree in 0..=MAX_HARMONICS_DEGREE {
                let own = &coefficients[..3 * harmonics_count(degree)];
                let mut moved = own.to_vec();
                transform.apply(&mut moved);
                let colour = |coefficients: &[f32], d: DVec3| {
                    let basis = harmonics_f64(d);
                    let terms = coefficients.chunks_exact(3).zip(basis);
                    terms.map(|(rgb, y)| DVec3::from([0, 1, 2].map(|c| f64::from(rgb[c]))) * y)
                        .sum::<DVec3>()
                };
                let gap = (colour(own, d) - colour(&moved, rotation * d)).abs().max_element();
                prop_assert!(gap < 1e-6, "degree {}: {}", degree, gap);
            }
        }
    }

    #[test]
    fn both_precisions_have_one_basis() {
        for d in [
            DVec3::X,
            DVec3::new(0.48, -0.6, 0.64),
            DVec3::new(-0.8, 0.0, 0.6),
        ] {
            for (a, b) in harmonics(d.as_vec3()).into_iter().zip(harmonics_f64(d)) {
                // Some six rounding errors of f32.
                assert!((f64::from(a) - b).abs() < 1e-6, "{a} and {b}");
            }
        }
    }

    #[test]
    fn the_basis_is_orthonormal() {
        // Gauss-Legendre with four nodes would suffice; a fine midpoint rule in z is simpler. The products are
        // polynomials of degree at most 6 in z, times trigonometric ones that sixteen angles integrate exactly.
        const STEPS: usize = 2_000;
        let mut gram = [[0.0_f64; 16]; 16];
        for i in 0..STEPS {
            let z = (i as f64 + 0.5) / STEPS as f64 * 2.0 - 1.0;
            let r = (1.0 - z * z).sqrt();
            for k in 0..16 {
                let angle = std::f64::consts::TAU * f64::from(k) / 16.0;
                let d = glam::DVec3::new(r * angle.cos(), r * angle.sin(), z).as_vec3();
                let basis = harmonics(d).map(f64::from);
                let weight = 4.0 * std::f64::consts::PI / (16 * STEPS) as f64;
                for (row, a) in gram.iter_mut().zip(basis) {
                    for (cell, b) in row.iter_mut().zip(basis) {
                        *cell += weight * a * b;
                    }
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                // f32 harmonics, and the midpoint rule's (1/2000)².
                assert!((value - expected).abs() < 5e-6, "{i}, {j}: {value}");
            }
        }
    }
}
