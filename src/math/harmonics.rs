//! Real spherical harmonics up to degree 3, with the signs that radiance fields use.

use std::array;

use glam::Vec3;

/// The constant harmonic, 1 / (2 sqrt(pi)).
pub const HARMONIC_0: f32 = 0.282_094_8;

/// Of degree 1: sqrt(3 / 4 pi).
pub(crate) const HARMONIC_1: f32 = 0.488_602_5;

/// Of degree 2: sqrt(15 / 4 pi), sqrt(5 / 16 pi).
pub(crate) const HARMONICS_2: [f32; 2] = [1.092_548_4, 0.315_391_57];

/// Of degree 3: sqrt(35 / 32 pi), sqrt(105 / 4 pi), sqrt(21 / 32 pi), sqrt(7 / 16 pi).
pub(crate) const HARMONICS_3: [f32; 4] = [0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34];

/// The greatest degree of [`harmonics`].
pub const MAX_HARMONICS_DEGREE: u8 = 3;

/// The sixteen harmonics up to degree 3 in direction (x, y, z), a unit vector.
///
/// Orthonormal on the sphere, ordered by degree l and then m = -l..=l, with the Condon-Shortley
/// phase (-1)^m: degree 1 is sqrt(3 / 4 pi) (-y, z, -x), as in Kerbl et al. 2023, *3D Gaussian
/// Splatting*, and every file of that layout.
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

/// Coefficients of one colour channel for a given degree: (degree + 1)².
pub fn harmonics_count(degree: u8) -> usize {
    (usize::from(degree) + 1).pow(2)
}

/// 1/2 + the sum of coefficients times harmonics, per colour channel; `coefficients` are R, G, B
/// of the first harmonic, of the second, ...
#[inline]
pub fn harmonics_sum(coefficients: &[f32], basis: &[f32; 16]) -> [f32; 3] {
    let mut sum = [0.5; 3];
    for (rgb, y) in coefficients.chunks_exact(3).zip(basis) {
        sum = array::from_fn(|c| sum[c] + y * rgb[c]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_basis_is_orthonormal() {
        // Gauss-Legendre would do with four nodes; a fine midpoint rule in z is simpler. The
        // products are polynomials of degree 6 in z at most, times trigonometric ones that
        // sixteen angles integrate exactly.
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
