//! Tests that values are replaced while shapes stay, as for the next time step.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Particles, PointVolume, Strength, TransferFunction, Values,
};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{ColumnSettings, Renderer, SceneOptions, Settings};
use glam::{DMat3, DVec3};

use crate::common::Random;
use crate::common::scene::camera;

const KEEP: SceneOptions = SceneOptions {
    level_of_detail: true,
    keep_shapes: true,
    keep_indices: false,
    task: None,
};
/// Number of spheres in the scene.
const COUNT: usize = 6_000;

fn transfer() -> TransferFunction {
    let colours = |v: f32| [v, 0.5, 1.0 - v];
    TransferFunction::from_curves(colours, |v| 0.6 * v, [0.0, 1.0], 0.2).unwrap()
}

fn values(count: usize, seed: u64) -> Values {
    let mut random = Random::new(seed);
    // Colours are nearly equal, so that particles are merged from afar.
    let level = 0.2 + 0.07 * seed as f64;
    let mut values: Vec<f32> = (0..count)
        .map(|_| (level + random.range(0.0, 0.01)) as f32)
        .collect();
    values[count / 2] = f32::NAN;
    Values::F32(values)
}

/// Returns spheres and a lattice, enough for blocks and levels of detail.
fn scene(seed: u64) -> Vec<PointVolume> {
    let mut random = Random::new(3);
    let positions: Vec<_> = (0..COUNT)
        .map(|_| random.point(1.0) + DVec3::new(-1.0, 0.0, 6.0))
        .collect();
    let points = PointVolume::new(
        Particles::Isotropic {
            sigmas: vec![0.05; COUNT],
            positions,
        },
        Strength::Classified {
            volumes: vec![1e-3; COUNT],
        },
    )
    .classified(values(COUNT, seed), transfer());
    let lattice = Lattice {
        dims: [20, 21, 22],
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::new(0.5, -1.0, 6.0),
            step: DMat3::from_diagonal(DVec3::splat(0.1)),
        },
    };
    let cells = lattice.len();
    let lattice = PointVolume {
        particles: Particles::Lattice {
            lattice,
            kernel_width: 0.6,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        values: Some(values(cells, seed + 1)),
        ..points.clone()
    };
    vec![points, lattice]
}

fn eye(zoom: f64) -> Camera {
    camera(Projection::Perspective, [40.0 * zoom; 2], [32, 32])
}

/// Gives a renderer the values of another scene.
fn exchange(renderer: &mut Renderer, next: &[PointVolume]) {
    for (i, volume) in next.iter().enumerate() {
        let values = volume.values.clone().unwrap();
        renderer.set_values(i, values).unwrap();
    }
}

#[test]
fn exchanged_values_draw_what_a_scene_of_them_draws() {
    let mut renderer = Renderer::with_options(scene(1), &KEEP).unwrap();
    let settings = Settings::default();
    let first = renderer.render(&eye(1.0), &settings).unwrap().clone();
    let before = renderer.amplitudes().sum;
    let next = scene(8);
    exchange(&mut renderer, &next);
    let mut fresh = Renderer::new(next).unwrap();
    // Views from nearby, and from where particles are merged.
    for zoom in [1.0, 0.02] {
        let expected = fresh.render(&eye(zoom), &settings).unwrap().clone();
        let counts = fresh.counts();
        assert_eq!(renderer.render(&eye(zoom), &settings).unwrap(), &expected);
        assert_eq!(renderer.counts(), counts);
        assert!(zoom > 0.5 || counts.blocks_merged > 0);
    }
    assert!(first != *renderer.render(&eye(1.0), &settings).unwrap());
    let columns = ColumnSettings::default();
    let expected = fresh.column_density(&eye(1.0), &columns).unwrap().clone();
    let column = renderer.column_density(&eye(1.0), &columns).unwrap();
    assert_eq!(column, &expected);
    assert!(renderer.amplitudes().sum != before);
}

#[cfg(feature = "gpu")]
#[test]
fn the_device_takes_them_too() {
    let Some(gpu) = crate::common::gpu::gpu() else {
        return;
    };
    let renderer = Renderer::with_options(scene(1), &KEEP).unwrap();
    let mut renderer = renderer.on(gpu.clone()).unwrap();
    let settings = Settings::default();
    renderer.render(&eye(1.0), &settings).unwrap();
    let next = scene(8);
    exchange(&mut renderer, &next);
    let mut fresh = Renderer::new(next).unwrap().on(gpu.clone()).unwrap();
    let expected = fresh.render(&eye(1.0), &settings).unwrap();
    assert_eq!(renderer.render(&eye(1.0), &settings).unwrap(), expected);
}

#[test]
fn what_cannot_be_exchanged_is_refused() {
    let refused = |renderer: &mut Renderer, volume, count, about: &str| {
        let error = renderer.set_values(volume, values(count, 1)).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(about), "{error}");
    };
    let mut renderer = Renderer::with_options(scene(1), &KEEP).unwrap();
    refused(&mut renderer, 0, 5, "6000 values");
    refused(&mut renderer, 2, COUNT, "one of 2 volumes");
    let mut renderer = Renderer::new(scene(1)).unwrap();
    refused(&mut renderer, 0, COUNT, "keeps its shapes");
    let masses = PointVolume {
        strength: Strength::Mass(vec![1.0; COUNT]),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        ..scene(1).swap_remove(0)
    };
    let mut renderer = Renderer::with_options(vec![masses], &KEEP).unwrap();
    refused(&mut renderer, 0, COUNT, "a volume with values");
}
