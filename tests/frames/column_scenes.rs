//! Scenes of which columns are drawn, in pixels.

use crate::common::scene::camera;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength, TransferFunction, Values};
use ewa_splat::view::{Camera, Projection};
use glam::DVec3;

/// Pixels are world units; the image is centred on the z axis, the eye far in front.
pub(crate) fn orthographic(size: usize) -> Camera {
    Camera {
        eye: DVec3::Z * -1e5,
        ..camera(Projection::Orthographic, [1.0; 2], [size; 2])
    }
}

pub(crate) fn masses(particles: Particles, masses: Vec<f32>) -> PointVolume {
    PointVolume {
        particles,
        strength: Strength::Mass(masses),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        normals: None,
    }
}

/// Classified by a transfer function that leaves nothing visible: it is not asked.
pub(crate) fn classified(particles: Particles, volumes: Vec<f32>, values: Values) -> PointVolume {
    let transfer = TransferFunction::from_curves(|_| [1.0; 3], |_| 0.0, [0.0, 1.0], 1.0);
    PointVolume {
        particles,
        strength: Strength::Classified { volumes },
        colour: Colour::Classified,
        values: Some(values),
        transfer_function: Some(transfer.expect("a function of two points")),
        normals: None,
    }
}

pub(crate) fn spheres(positions: Vec<DVec3>, sigmas: Vec<f32>) -> Particles {
    Particles::Isotropic { positions, sigmas }
}
