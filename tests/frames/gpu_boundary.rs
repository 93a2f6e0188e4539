//! Compares the back ends on sharp boundaries.

use ewa_splat::sample::{BoundaryChoice, grid};
use ewa_splat::scene::PointVolume;
use ewa_splat::view::ClipPlane;
use ewa_splat::{Composite, Filter, Settings};
use glam::DVec3;

use crate::boundary::{
    all_cameras, ball_volume, extent, lattices, ring, settings, shells, uniform_options,
};
use crate::common::gpu::{assert_alike, pictures};
use crate::common::some;

fn all_settings() -> Vec<(&'static str, Settings)> {
    let clip = ClipPlane {
        normal: DVec3::new(0.3, 0.8, -0.2),
        distance: 0.1,
    };
    let with = |composite| Settings {
        composite,
        ..settings()
    };
    vec![
        (
            "over",
            Settings {
                depth: true,
                ..settings()
            },
        ),
        (
            "wide filter",
            Settings {
                low_pass_variance_px2: 1.0,
                ..settings()
            },
        ),
        (
            "exact",
            Settings {
                filter: Filter::Exact,
                ..settings()
            },
        ),
        (
            "clipped",
            Settings {
                clip: vec![clip],
                ..settings()
            },
        ),
        ("sheets", with(Composite::SHEETS)),
        ("slabs", with(Composite::SLABS)),
        ("maximum", with(Composite::MAXIMUM)),
    ]
}

/// Draws each lattice with each camera and each method on both back ends.
#[test]
fn both_back_ends_cut_alike() {
    // A software adapter takes seconds for each combination: it draws half of them.
    let sparse = if pictures().is_some() { 1 } else { 2 };
    for (name, lattice) in some(lattices(), 0, 3) {
        let (middle, radius) = extent(&lattice);
        let volume = ball_volume(&lattice);
        for (i, camera) in all_cameras(middle, radius).iter().enumerate() {
            for (j, (how, settings)) in all_settings().iter().enumerate() {
                // Each lattice is drawn with each camera and each method, but not in all
                // combinations. In a maximum, a slab with little data before the eye amplifies
                // roundings.
                let is_thin = i > 2 && matches!(settings.composite, Composite::Maximum { .. });
                if (i + j + name.len()) % (4 * sparse) == 0 && !is_thin {
                    let name = format!("{name}, camera {i}, {how}");
                    assert_alike(&name, &volume, camera, settings);
                }
            }
        }
    }
    let dims = [14, 20, 10];
    let nodes = ring(dims, 4.0);
    let values: Vec<f32> = nodes.iter().map(|p| (p.z / 3.0) as f32).collect();
    let sampled = grid(dims, nodes, values, &uniform_options(BoundaryChoice::Sharp)).unwrap();
    let volume = PointVolume {
        transfer_function: Some(shells()),
        ..sampled.volume
    };
    for (i, camera) in all_cameras(DVec3::Z * 1.5, 3.4).iter().enumerate() {
        for (j, (how, settings)) in all_settings().into_iter().enumerate() {
            let is_thin = i > 2 && matches!(settings.composite, Composite::Maximum { .. });
            if (i + j) % (3 * sparse) == 0 && !is_thin {
                let name = format!("ring, camera {i}, {how}");
                assert_alike(&name, &volume, camera, &settings);
            }
        }
    }
}
