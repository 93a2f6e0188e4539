//! Tests maximum-intensity projections against brute force, on both back ends; and slabs whose
//! numbers are large.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use ewa_splat::math::normal_cdf;
use ewa_splat::render::{Advanced, SimdLevel};
use ewa_splat::scene::{Lighting, Particles, PointVolume, Strength, TransferFunction, Values};
use ewa_splat::view::{Camera, ClipPlane, Projection};
use ewa_splat::{Composite, Image, Renderer, Settings};
use glam::DVec3;

use crate::common::Random;
use crate::common::scene::{Particle, camera, difference, volume};

/// Number of spheres with values, seen by parallel rays in slabs.
const COUNT: usize = 400;
const SIGMA: f64 = 0.25;
const FOCAL: f64 = 8.0;
const SIZE: usize = 24;
const THICKNESS: f64 = 0.4;
/// Extinction at the greatest value, which all particles have, and each kernel's volume.
const EXTINCTION: f64 = 0.8;
const VOLUME: f64 = 0.05;

fn colours(value: f32) -> [f32; 3] {
    [value, 0.3 + 0.4 * value, 1.0 - value]
}

fn transfer() -> TransferFunction {
    // There is no extinction below one half; otherwise only the value matters.
    let opacity = 1.0 - (-EXTINCTION).exp();
    let of = |v: f32| if v < 0.5 { 0.0 } else { opacity as f32 };
    TransferFunction::from_curves(colours, of, [0.0, 1.0], 1.0).unwrap()
}

fn spheres() -> (Vec<DVec3>, Vec<f32>) {
    let mut random = Random::new(17);
    let positions = (0..COUNT).map(|_| random.point(1.2) + DVec3::Z * 6.0);
    let positions: Vec<_> = positions.collect();
    let values = (0..COUNT).map(|_| random.range(0.02, 0.98) as f32);
    (positions, values.collect())
}

fn scene() -> PointVolume {
    let (positions, values) = spheres();
    PointVolume::new(
        Particles::Isotropic {
            sigmas: vec![SIGMA as f32; COUNT],
            positions,
        },
        Strength::Classified {
            volumes: vec![VOLUME as f32; COUNT],
        },
    )
    .classified(Values::F32(values), transfer())
}

fn eye() -> Camera {
    camera(Projection::Orthographic, [FOCAL; 2], [SIZE; 2])
}

fn settings() -> Settings {
    Settings {
        composite: Composite::MAXIMUM.with_thickness(Some(THICKNESS)),
        cutoff: Some(6.0),
        tolerance: 1e-5,
        depth: true,
        advanced: Advanced {
            // The CPU uses no fused operations, as the device uses none.
            simd: SimdLevel::Baseline,
            ..Advanced::default()
        },
        ..Settings::default()
    }
}

/// Result at a pixel: the greatest mean value over its slabs, the depth of that slab's middle, and
/// the margin to the next best value or to a slab at the threshold.
struct Best {
    found: Option<(f64, f64)>,
    margin: f64,
}

/// Computes in f64, slab by slab and kernel by kernel.
fn brute_force(x: usize, y: usize, near: f64) -> Best {
    let (positions, values) = spheres();
    let variance = (SIGMA * FOCAL).powi(2) + 1.0;
    let at = |i: usize| i as f64 + 0.5 - SIZE as f64 / 2.0;
    let kernels: Vec<(f64, f64, f64)> = positions
        .iter()
        .zip(&values)
        .map(|(p, value)| {
            let (dx, dy) = (at(x) - FOCAL * p.x, at(y) - FOCAL * p.y);
            let weight = FOCAL * FOCAL / (std::f64::consts::TAU * variance)
                * (-0.5 * (dx * dx + dy * dy) / variance).exp();
            let tau = EXTINCTION * VOLUME * weight;
            (tau, p.z, f64::from(*value))
        })
        .collect();
    let phi = |z: f64| f64::from(normal_cdf(z as f32));
    let mut means = Vec::new();
    let mut margin = f64::INFINITY;
    for number in 0..40 {
        let [start, end] = [number, number + 1].map(|n| f64::from(n) * THICKNESS);
        let from = start.max(near);
        let (mut length, mut sum) = (0.0, 0.0);
        for (tau, z, value) in &kernels {
            let share = (phi((end - z) / SIGMA) - phi((from - z) / SIGMA)).max(0.0);
            length += tau * share;
            sum += tau * share * value;
        }
        let least = 0.5 * EXTINCTION * THICKNESS;
        margin = margin.min((length / least - 1.0).abs());
        if length >= least {
            means.push((sum / length, 0.5 * (start + end)));
        }
    }
    means.sort_by(|a, b| b.0.total_cmp(&a.0));
    if let [best, next, ..] = means.as_slice() {
        margin = margin.min(best.0 - next.0);
    }
    Best {
        found: means.first().copied(),
        margin,
    }
}

fn hold(name: &str, renderer: &mut Renderer, near: f64) -> Image {
    let clip = ClipPlane {
        normal: DVec3::Z,
        distance: -near,
    };
    let settings = Settings {
        clip: if near > 0.0 { vec![clip] } else { Vec::new() },
        ..settings()
    };
    let image = renderer.render(&eye(), &settings).unwrap().clone();
    let depths = &renderer.depth().unwrap().depths;
    let (mut found, mut empty, mut close) = (0, 0, 0);
    for (i, pixel) in image.pixels.iter().enumerate() {
        let best = brute_force(i % SIZE, i / SIZE, near);
        // f32 roundings decide between two values this close.
        if best.margin < 1e-4 {
            close += 1;
            continue;
        }
        match best.found {
            None => {
                assert_eq!(*pixel, [0.0; 4], "{name} {i}");
                empty += 1;
            }
            Some((value, depth)) => {
                let [r, g, b] = colours(value as f32);
                // The table of 4,096 entries is interpolated linearly, and these colours are
                // linear, too.
                for (x, y) in pixel.iter().zip([r, g, b, 1.0]) {
                    assert!((x - y).abs() < 2e-4, "{name} {i}: {pixel:?} for {value}");
                }
                assert!((f64::from(depths[i]) - depth).abs() < 1e-4, "{name} {i}");
                found += 1;
            }
        }
    }
    println!("{name}: {found} pixels with a maximum, {empty} without, {close} undecided");
    assert!(found > 100 && empty > 50 && close < 20);
    image
}

#[test]
fn each_pixel_shows_the_greatest_mean_of_its_slabs() {
    let mut on_cpu = Renderer::new(vec![scene()]).unwrap();
    let images = [0.0, 6.1].map(|near| hold("cpu", &mut on_cpu, near));
    assert!(difference(&images[0], &images[1]) > 0.1);
    #[cfg(feature = "gpu")]
    if let Some(gpu) = crate::common::gpu::gpu() {
        let mut on_gpu = Renderer::new(vec![scene()])
            .unwrap()
            .on(gpu.clone())
            .unwrap();
        for (near, image) in [0.0, 6.1].into_iter().zip(&images) {
            let twin = hold("gpu", &mut on_gpu, near);
            let pixels = image.pixels.iter().zip(&twin.pixels);
            let differs = |(p, q): &(&[f32; 4], &[f32; 4])| {
                p.iter().zip(*q).any(|(x, y)| !((x - y).abs() <= 2e-5))
            };
            // Two slabs may be equal to within roundings.
            assert!(pixels.filter(differs).count() <= 2);
        }
    }
}

#[test]
fn what_has_no_maximum_is_refused() {
    let mut renderer = Renderer::new(vec![scene()]).unwrap();
    let lit = Settings {
        lighting: Some(Lighting::default()),
        ..settings()
    };
    let linear = Settings {
        advanced: Advanced {
            linear_opacity: true,
            ..settings().advanced
        },
        ..settings()
    };
    for settings in [lit, linear] {
        let error = renderer.render(&eye(), &settings).unwrap_err().to_string();
        assert!(error.contains("maximum"), "{error}");
    }
    let masses = volume(&[Particle::sphere(DVec3::Z * 6.0, 0.3, 1.0)]);
    let mut renderer = Renderer::new(vec![masses]).unwrap();
    let error = renderer.render(&eye(), &settings()).unwrap_err();
    assert!(
        error.to_string().contains("one volume with a field"),
        "{error}"
    );
}

#[test]
fn slabs_do_not_depend_on_how_far_before_them_others_begin() {
    // A vast, transparent kernel begins a hundred thousand slabs before the rest: the slabs' depths
    // must not be sums of lengths that round.
    let mut random = Random::new(23);
    let particles: Vec<Particle> = (0..60)
        .map(|_| {
            let place = random.point(0.02) + DVec3::Z * 5.0;
            let colour = [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32);
            Particle::sphere(place, 0.01, 2e-4).coloured(colour)
        })
        .collect();
    let vast = Particle::sphere(DVec3::Z * 5.0, 2e3, 0.0);
    let camera = camera(Projection::Perspective, [4000.0; 2], [32, 32]);
    let settings = Settings {
        composite: Composite::SLABS.with_thickness(Some(0.01)),
        ..Settings::default()
    };
    let draw = |scene: Vec<PointVolume>| {
        let mut renderer = Renderer::new(scene).unwrap();
        renderer.render(&camera, &settings).unwrap().clone()
    };
    let alone = draw(vec![volume(&particles)]);
    let beside = draw(vec![volume(&particles), volume(&[vast])]);
    assert!(alone.pixels.iter().any(|p| p[3] > 0.3));
    let off = difference(&alone, &beside);
    // The slabs are the same: roundings of f32 depths, 5e-7 of a thickness of .01.
    assert!(off < 1e-4, "{off}");
}
