//! Tests levels of detail of lattices that are coarser lattices: the errors of whole pictures, and the rules by which a
//! level is chosen.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use crate::common::some;
use crate::promise::differences;
use ewa_splat::image::Image;
use ewa_splat::math::normal_code;
use ewa_splat::render::{Advanced, Classification};
use ewa_splat::scene::{Boundary, Lattice, Lighting, PointVolume, TransferFunction, Values};
use ewa_splat::view::{Camera, ClipPlane};
use ewa_splat::{Composite, Renderer, SceneOptions, Settings};
use glam::DVec3;

/// Samples along each axis, just enough for coarser lattices.
const NODES: usize = 129;

/// Returns a sum of Gaussian blobs within the unit ball; 1 at most.
fn blobs(p: DVec3) -> f64 {
    let blob = |at: [f64; 3], width: f64, height: f64| {
        height * (-p.distance_squared(at.into()) / (2.0 * width * width)).exp()
    };
    blob([-0.3, 0.2, 0.1], 0.3, 0.6)
        + blob([0.4, -0.1, -0.3], 0.25, 0.5)
        + blob([0.1, -0.5, 0.4], 0.2, 0.6)
}

fn lattice_of(field: impl Fn(DVec3) -> f64) -> (Lattice, Vec<f32>) {
    let spacing = 2.0 / (NODES - 1) as f64;
    let lattice = Lattice::uniform([NODES; 3], DVec3::NEG_ONE, DVec3::splat(spacing));
    let place = |n: usize| {
        let cell = [n % NODES, n / NODES % NODES, n / (NODES * NODES)];
        lattice.position(cell)
    };
    let values = (0..lattice.len()).map(|n| field(place(n)) as f32).collect();
    (lattice, values)
}

/// Returns a function that rises smoothly from a value on.
fn ramp(from: f32) -> TransferFunction {
    let colour = |v: f32| [v, 0.6, 1.0 - v];
    let opacity = |v: f32| 0.4 * ((v - from) / (1.0 - from)).clamp(0.0, 1.0);
    TransferFunction::from_curves(colour, opacity, [0.0, 1.0], 0.1).unwrap()
}

/// Returns a function of two thin shells.
fn shells() -> TransferFunction {
    let hat = |v: f32, at: f32| (1.0 - (v - at).abs() / 0.03).max(0.0);
    let opacity = move |v: f32| (0.9 * hat(v, 0.3)).max(0.98 * hat(v, 0.6));
    TransferFunction::from_curves(|v| [v, 0.7, 1.0 - v], opacity, [0.0, 1.0], 0.1).unwrap()
}

fn smooth() -> PointVolume {
    let (lattice, values) = lattice_of(blobs);
    PointVolume::lattice(lattice, values, ramp(0.1))
}

/// Returns unit normals of the surfaces of equal value of a field, turned by a map.
fn normals_of(field: impl Fn(DVec3) -> f64, turned: impl Fn(DVec3, DVec3) -> DVec3) -> Vec<u32> {
    /// A part of the samples' distance.
    const STEP: f64 = 1e-3;
    let (lattice, _) = lattice_of(|_| 0.0);
    let normal = |n: usize| {
        let cell = [n % NODES, n / NODES % NODES, n / (NODES * NODES)];
        let p = lattice.position(cell);
        let slope = |axis: DVec3| field(p + STEP * axis) - field(p - STEP * axis);
        let gradient = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
        normal_code(turned(p, gradient.normalize_or_zero()))
    };
    (0..lattice.len()).map(normal).collect()
}

/// Returns the smooth field with normals.
#[cfg(feature = "gpu")]
fn smooth_with_normals() -> PointVolume {
    PointVolume {
        normals: Some(normals_of(blobs, |_, normal| normal)),
        ..smooth()
    }
}

fn camera(size: usize) -> Camera {
    let eye = DVec3::new(2.6, -4.4, 1.9);
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, [size; 2])
}

fn at(tolerance: f32) -> Settings {
    Settings {
        tolerance,
        ..Settings::default()
    }
}

fn of_samples(tolerance: f32) -> Settings {
    Settings {
        level_of_detail: false,
        ..at(tolerance)
    }
}

/// Returns the difference that 99.9 % of all channels stay below.
fn difference(a: &Image, b: &Image) -> f32 {
    differences(a, b)[0]
}

#[test]
fn pictures_are_within_the_tolerance_of_the_samples() {
    let (lattice, values) = lattice_of(blobs);
    let bytes = values.iter().map(|v| (v * 255.0).round() as u8).collect();
    // To faces at which the field does not vanish.
    let (_, to_faces) = lattice_of(|p| 0.5 + 0.4 * (2.0 * p.x).sin() * (1.5 * p.y + p.z).cos());
    // Ripples of three samples in a part of the volume.
    let (_, rippled) = lattice_of(|p| {
        let ripple = 0.3 * (-p.distance_squared(DVec3::new(0.5, -0.5, 0.3)) / 0.02).exp();
        blobs(p) + ripple * (130.0 * p.x).sin()
    });
    let of = |values: Values, function| PointVolume::lattice(lattice.clone(), values, function);
    let sharp = PointVolume {
        boundary: Some(Boundary::Lattice),
        ..of(Values::F32(to_faces), ramp(0.2))
    };
    let bytes_function =
        TransferFunction::from_curves(|v| [v / 255.0; 3], |v| 0.3 * v / 255.0, [0.0, 255.0], 0.1);
    // The least level at a tolerance of 1/16.
    let scenes = [
        ("smooth", of(Values::F32(values.clone()), ramp(0.1)), 2),
        ("bytes", of(Values::U8(bytes), bytes_function.unwrap()), 1),
        ("shells", of(Values::F32(values), shells()), 1),
        ("sharp", sharp, 1),
        ("rippled", of(Values::F32(rippled), ramp(0.1)), 0),
    ];
    check_pictures(some(scenes, 0, 2), None);
}

#[test]
fn lit_pictures_are_within_the_tolerance_of_the_samples() {
    let straight = normals_of(blobs, |_, normal| normal);
    // Relief of six samples on shells that are smooth, in a part of the volume: light alone shows it.
    let relief = normals_of(blobs, |p, normal| {
        let part = (-p.distance_squared(DVec3::new(0.4, -0.4, -0.1)) / 0.2).exp();
        normal + 1.5 * part * (65.0 * p.x).sin() * DVec3::X
    });
    let (lattice, values) = lattice_of(blobs);
    let of = |normals: &[u32], function| PointVolume {
        normals: Some(normals.to_vec()),
        ..PointVolume::lattice(lattice.clone(), values.clone(), function)
    };
    let sharp = PointVolume {
        boundary: Some(Boundary::Lattice),
        ..of(&straight, ramp(0.02))
    };
    let scenes = [
        ("relief", of(&relief, shells()), 0),
        ("shells", of(&straight, shells()), 1),
        ("smooth", of(&straight, ramp(0.1)), 1),
        ("sharp", sharp, 1),
    ];
    let lit = Settings {
        lighting: Some(Lighting::default()),
        ..of_samples(1.0 / 255.0)
    };
    // Otherwise nothing could be lost.
    let pictures = [&scenes[0].1, &scenes[1].1].map(|volume| {
        let mut renderer = Renderer::new(vec![volume.clone()]).unwrap();
        renderer.render(&camera(160), &lit).unwrap().clone()
    });
    let [relief, smooth] = pictures;
    let shown = difference(&relief, &smooth);
    assert!(shown > 1.0 / 64.0, "the relief shows: {shown}");
    check_pictures(some(scenes, 0, 2), lit.lighting);
}

/// Checks pictures in three views at three tolerances.
///
/// - `scenes`: with their names, and the least levels of fitted views at a tolerance of 1/16.
fn check_pictures<'a>(
    scenes: impl IntoIterator<Item = (&'a str, PointVolume, usize)>,
    lighting: Option<Lighting>,
) {
    let mut broken = Vec::new();
    for (name, volume, least) in scenes {
        let mut renderer = Renderer::new(vec![volume]).unwrap();
        let fitted = camera(160);
        let near = Camera {
            eye: 0.4 * fitted.eye,
            ..fitted.clone()
        };
        let far = Camera {
            eye: 4.0 * fitted.eye,
            width: 48,
            height: 48,
            centre_px: fitted.centre_px - 56.0,
            ..fitted.clone()
        };
        for (view, camera) in [("fitted", fitted), ("near", near), ("far", far)] {
            for tolerance in some([1.0 / 64.0, 1.0 / 255.0, 1.0 / 16.0], 0, 2) {
                let [chosen, of_samples] =
                    [at(tolerance), of_samples(tolerance)].map(|own| Settings {
                        lighting: lighting.clone(),
                        ..own
                    });
                let image = renderer.render(&camera, &chosen).unwrap().clone();
                let (level, footprints) = (renderer.lattice_level(), renderer.counts().footprints);
                let all = renderer.render(&camera, &of_samples).unwrap();
                let error = difference(&image, all) / tolerance;
                println!(
                    "{name} {view} 1/{:.0}: level {level}, error {error:.2} tolerances, footprints {footprints} of {}",
                    1.0 / tolerance,
                    renderer.counts().footprints
                );
                assert_eq!(renderer.lattice_level(), 0);
                let is_expected = level >= least || view != "fitted" || tolerance < 0.05;
                if !(error < 1.0 && is_expected) {
                    broken.push((name, view, tolerance, level, error));
                }
            }
        }
    }
    assert!(broken.is_empty(), "{broken:?}");
}

#[test]
fn levels_are_those_of_the_function_and_the_values_that_are_shown() {
    let options = SceneOptions {
        keep_shapes: true,
        ..SceneOptions::default()
    };
    let mut renderer = Renderer::with_options(vec![smooth()], &options).unwrap();
    let (camera, settings) = (camera(96), at(1.0 / 16.0));
    let check = |renderer: &mut Renderer| {
        let image = renderer.render(&camera, &settings).unwrap().clone();
        let level = renderer.lattice_level();
        let all = renderer.render(&camera, &of_samples(settings.tolerance));
        assert!(difference(&image, all.unwrap()) < settings.tolerance);
        level
    };
    let first = check(&mut renderer);
    assert!(first > 0);
    // A faint function over other values: both are drawn at a coarser level, and as they are.
    renderer.set_transfer_function(0, ramp(0.4)).unwrap();
    assert!(check(&mut renderer) > 0);
    let (_, others) = lattice_of(|p| 1.0 - blobs(p));
    renderer.set_values(0, Values::F32(others)).unwrap();
    check(&mut renderer);
    // Noise.
    let noise = |n: usize| {
        let mixed = (n as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
    };
    let noise = (0..NODES.pow(3)).map(noise).collect();
    renderer.set_values(0, Values::F32(noise)).unwrap();
    check(&mut renderer);
    // Back: the choice does not depend on what was drawn before.
    let (_, values) = lattice_of(blobs);
    renderer.set_values(0, Values::F32(values)).unwrap();
    renderer.set_transfer_function(0, ramp(0.1)).unwrap();
    assert_eq!(check(&mut renderer), first);
}

#[test]
fn frames_that_need_samples_have_them() {
    let mut renderer = Renderer::new(vec![smooth()]).unwrap();
    let camera = camera(48);
    let base = at(1.0 / 16.0);
    renderer.render(&camera, &base).unwrap();
    assert!(renderer.lattice_level() > 0);
    let depth = Settings {
        depth: true,
        ..base.clone()
    };
    let slabs_of = |base: &Settings| Settings {
        composite: Composite::SLABS,
        ..base.clone()
    };
    let slabs = slabs_of(&base);
    let fine = at(5e-4);
    for settings in [depth, slabs, fine, of_samples(1.0 / 16.0)] {
        renderer.render(&camera, &settings).unwrap();
        assert_eq!(renderer.lattice_level(), 0, "{settings:?}");
    }
    // Slack counts as tolerance. With it nothing is measured.
    let slack = Settings {
        advanced: Advanced {
            merge_slack: 64.0,
            ..Advanced::default()
        },
        ..at(1e-3)
    };
    renderer.render(&camera, &slack).unwrap();
    assert!(renderer.lattice_level() > 0);
    assert_eq!(renderer.times().choose, 0.0);
    let mut other = Renderer::new(vec![smooth()]).unwrap();
    other.render(&camera, &slack).unwrap();
    assert_eq!(other.lattice_level(), 0);
    // Clip planes and light that have nothing to light do not hinder.
    let clipped = Settings {
        clip: vec![ClipPlane {
            normal: DVec3::X,
            distance: 0.0,
        }],
        ..base.clone()
    };
    let image = renderer.render(&camera, &clipped).unwrap().clone();
    assert!(renderer.lattice_level() > 0);
    let all = Settings {
        level_of_detail: false,
        ..clipped
    };
    assert!(difference(&image, renderer.render(&camera, &all).unwrap()) < base.tolerance);
    // Levels that are made after a frame in which particles carried their values.
    let mut renderer = Renderer::new(vec![smooth()]).unwrap();
    let by_slabs = Settings {
        classify: Classification::Slab,
        ..slabs_of(&base)
    };
    renderer.render(&camera, &by_slabs).unwrap();
    let image = renderer.render(&camera, &base).unwrap().clone();
    assert!(renderer.lattice_level() > 0);
    let all = renderer.render(&camera, &of_samples(base.tolerance));
    assert!(difference(&image, all.unwrap()) < base.tolerance);
    // Scenes without levels of detail.
    let options = SceneOptions {
        level_of_detail: false,
        ..SceneOptions::default()
    };
    let mut renderer = Renderer::with_options(vec![smooth()], &options).unwrap();
    renderer.render(&camera, &base).unwrap();
    assert_eq!(renderer.lattice_level(), 0);
}

#[test]
#[cfg(feature = "gpu")]
fn both_back_ends_draw_the_same_level() {
    use crate::common::gpu::{gpu, rounding};
    use ewa_splat::render::Backend;
    let Some(gpu) = gpu() else { return };
    let unlit = at(1.0 / 16.0);
    let lit = Settings {
        lighting: Some(Lighting::default()),
        normals: true,
        ..unlit.clone()
    };
    for (volume, settings) in [(smooth(), unlit), (smooth_with_normals(), lit)] {
        let camera = camera(96);
        let mut on_cpu = Renderer::with_options(vec![volume.clone()], Backend::Cpu).unwrap();
        let mut on_gpu = Renderer::new(vec![volume])
            .unwrap()
            .on(gpu.clone())
            .unwrap();
        let a = on_cpu.render(&camera, &settings).unwrap().clone();
        let b = on_gpu.render(&camera, &settings).unwrap().clone();
        assert!(on_gpu.adapter().is_some() && on_gpu.fallback().is_none());
        assert!(on_cpu.lattice_level() > 0);
        assert_eq!(on_cpu.lattice_level(), on_gpu.lattice_level());
        assert_eq!(on_cpu.counts().footprints, on_gpu.counts().footprints);
        assert!(difference(&a, &b) < rounding());
    }
}
