//! Makes scenes of which columns are drawn, in pixels.

use crate::common::scene::camera;
use crate::common::{Random, lower_factor};
use ewa_splat::scene::{Particles, PointVolume, Strength, TransferFunction, Values};
use ewa_splat::view::{Camera, Projection};
use glam::DVec3;

/// Returns a camera whose pixels are world units. The image is centred on the z axis, with the eye
/// far in front.
pub(crate) fn orthographic(size: usize) -> Camera {
    Camera {
        eye: DVec3::Z * -1e5,
        ..camera(Projection::Orthographic, [1.0; 2], [size; 2])
    }
}

pub(crate) fn masses(particles: Particles, masses: Vec<f32>) -> PointVolume {
    PointVolume::new(particles, Strength::Mass(masses))
}

/// Returns a volume whose transfer function makes everything invisible: columns do not use it.
pub(crate) fn classified(particles: Particles, volumes: Vec<f32>, values: Values) -> PointVolume {
    let transfer = TransferFunction::from_curves(|_| [1.0; 3], |_| 0.0, [0.0, 1.0], 1.0);
    PointVolume::new(particles, Strength::Classified { volumes })
        .classified(values, transfer.expect("a function of two points"))
}

pub(crate) fn spheres(positions: Vec<DVec3>, sigmas: Vec<f32>) -> Particles {
    Particles::Isotropic { positions, sigmas }
}

/// Returns `count` spheres, `count` ellipsoids and kernels near the camera, in one perspective
/// scene.
pub(crate) fn mixed(count: usize, height: usize) -> (Vec<PointVolume>, Camera) {
    let mut random = Random::new(5);
    let (mut positions, mut factors, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..count {
        positions.push(random.point(1.0) + DVec3::Z * 2.5);
        let size = random.log_range(1e-4, 0.1);
        factors.push(lower_factor(&random.factor(size, 8.0)));
        weights.push(random.range(0.5, 1.5) as f32);
    }
    // These lie around the eye.
    for _ in 0..20 {
        positions.push(random.point(0.3));
        factors.push(lower_factor(&random.factor(0.2, 2.0)));
        weights.push(1.0);
    }
    let balls = positions.iter().map(|p| *p * 1.1).collect();
    let sigmas = positions
        .iter()
        .map(|_| random.log_range(1e-4, 0.1) as f32)
        .collect();
    let volumes = vec![
        masses(
            Particles::Anisotropic { positions, factors },
            weights.clone(),
        ),
        masses(spheres(balls, sigmas), weights),
    ];
    (
        volumes,
        camera(
            Projection::Perspective,
            [1.5, 1.55].map(|f| f * height as f64),
            [3 * height / 2, height],
        ),
    )
}
