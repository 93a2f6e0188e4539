//! Makes scenes for unit tests.

use glam::DVec3;

use super::{Particles, PointVolume, Strength};

/// Returns `count` spheres about the origin, and an opaque plane of surfels among them.
pub(crate) fn spheres_and_plane(count: usize) -> Vec<PointVolume> {
    // Multiples of three irrational numbers fill a cube evenly.
    let at = |i: usize| (DVec3::new(0.754_878, 0.569_840, 0.618_034) * i as f64).fract() - 0.5;
    let places: Vec<DVec3> = (0..count).map(at).collect();
    let sigmas: Vec<f32> = (0..count)
        .map(|i| 0.002 + 0.02 * (i % 7) as f32 / 7.0)
        .collect();
    let spheres = PointVolume::spheres(places, sigmas).with_masses(vec![2e-5; count]);
    let grid: Vec<DVec3> = (0..400)
        .map(|i| DVec3::new((i % 20) as f64 - 9.5, (i / 20) as f64 - 9.5, 4.0) * 0.05)
        .collect();
    let plane = PointVolume::new(
        Particles::Surfels {
            tangents: vec![[0.04, 0.0, 0.0, 0.0, 0.04, 0.0]; grid.len()],
            positions: grid,
            is_one_sided: false,
        },
        Strength::Surface(vec![2.5e-3; 400]),
    )
    .with_colour([0.2, 0.6, 0.3]);
    vec![spheres, plane]
}
