//! Provides particles that several examples render.
#![allow(dead_code, reason = "each example uses a part")]

use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use glam::DVec3;

/// Returns uniform pseudo-random numbers in \[0, 1): the same in every run.
pub(crate) fn uniform(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        // A linear congruential generator.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    }
}

/// Returns random needles, discs and blobs in a cube of side 2, so faint that hundreds overlap. Standard deviations are
/// about `sigma_px` when seen from a distance of 4 in an image of `height` rows and 30 degrees.
pub(crate) fn particles(count: usize, height: usize, sigma_px: f32) -> PointVolume {
    let mut random = uniform(1);
    let focal_px = height as f32 / (2.0 * 15_f32.to_radians().tan());
    let sigma = sigma_px * 4.0 / focal_px;
    let mut positions = Vec::with_capacity(count);
    let mut factors = Vec::with_capacity(count);
    let mut masses = Vec::with_capacity(count);
    let mut colours = Vec::with_capacity(count);
    for _ in 0..count {
        let mut coordinate = || f64::from(random()) * 2.0 - 1.0;
        positions.push(DVec3::new(coordinate(), coordinate(), coordinate()));
        let mut scale = || sigma * (0.5 + random());
        let diagonal = [scale(), scale(), scale()];
        let mut skew = || sigma * (random() - 0.5);
        factors.push([
            diagonal[0],
            skew(),
            diagonal[1],
            skew(),
            skew(),
            diagonal[2],
        ]);
        masses.push(2e-6 * random());
        colours.push([random(), random(), random()]);
    }
    PointVolume {
        particles: Particles::Anisotropic { positions, factors },
        strength: Strength::Mass(masses),
        colour: Colour::PerParticle(colours),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns the camera for [`particles`].
pub(crate) fn camera(size: [usize; 2]) -> Camera {
    let eye = DVec3::new(0.0, -4.0, 0.0);
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, size)
}
