//! Defines a field with known derivatives, for tests.

use glam::{DMat3, DVec3};

/// Positions and widths of Gaussian blobs, with alternating heights 1 and -1.
const BLOBS: [([f64; 3], f64); 6] = [
    ([-0.3, -0.2, -0.1], 0.2),
    ([0.3, 0.2, -0.2], 0.25),
    ([0.0, 0.3, 0.3], 0.3),
    ([-0.2, 0.3, -0.3], 0.22),
    ([0.3, -0.3, 0.2], 0.28),
    ([-0.1, -0.3, 0.35], 0.2),
];

/// Returns value, gradient and second derivatives of the sum of blobs.
pub(super) fn blobs(x: DVec3) -> (f64, DVec3, DMat3) {
    let (mut value, mut gradient, mut hessian) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for (i, (place, width)) in BLOBS.into_iter().enumerate() {
        let d = x - DVec3::from(place);
        let square = width * width;
        let height = if i % 2 == 0 { 1.0 } else { -1.0 };
        let f = height * (-0.5 * d.length_squared() / square).exp();
        value += f;
        gradient -= d * (f / square);
        let dyad = DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        hessian += dyad * (f / (square * square)) - DMat3::IDENTITY * (f / square);
    }
    (value, gradient, hessian)
}

/// Returns a random point, uniform in a cube (SplitMix64).
pub(super) fn random_point(state: &mut u64, half_side: f64) -> DVec3 {
    let mut uniform = || {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        half_side * (2.0 * ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64 - 1.0)
    };
    DVec3::new(uniform(), uniform(), uniform())
}

/// Root mean square of errors relative to that of the true values.
#[derive(Debug, Default)]
pub(super) struct Rms {
    errors: f64,
    truths: f64,
}

impl Rms {
    pub(super) fn add(&mut self, error: f64, truth: f64) {
        self.errors += error * error;
        self.truths += truth * truth;
    }

    pub(super) fn share(&self) -> f64 {
        (self.errors / self.truths).sqrt()
    }
}
