//! Tests columns of SPH kernels: against brute force in f64, their mass, and the GPU against the CPU.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

#[cfg(feature = "gpu")]
use super::column_scenes::mixed;
use super::column_scenes::{masses, orthographic, spheres};
use crate::common::Random;
use ewa_splat::io::SphKernel;
#[cfg(feature = "gpu")]
use ewa_splat::render::SimdLevel;
#[cfg(feature = "gpu")]
use ewa_splat::view::ClipPlane;
use ewa_splat::{ColumnImage, ColumnSettings, Renderer};
use glam::DVec3;

pub(crate) const KERNELS: [SphKernel; 6] = [
    SphKernel::CubicSpline,
    SphKernel::QuarticSpline,
    SphKernel::QuinticSpline,
    SphKernel::WendlandC2,
    SphKernel::WendlandC4,
    SphKernel::WendlandC6,
];

/// Returns a kernel of support 1 at distance `u`, of any mass, and its variance along an axis (exact).
pub(crate) fn definition(kernel: SphKernel, u: f64) -> (f64, f64) {
    let spline = |support: f64, power: i32, weights: &[f64]| -> f64 {
        let knot = |(k, weight): (usize, &f64)| {
            weight * (support - k as f64 - support * u).max(0.0).powi(power)
        };
        weights.iter().enumerate().map(knot).sum()
    };
    let rest = (1.0 - u).max(0.0);
    match kernel {
        SphKernel::CubicSpline => (spline(2.0, 3, &[1.0, -4.0]), 0.3 / 4.0),
        SphKernel::QuarticSpline => (spline(2.5, 4, &[1.0, -5.0, 10.0]), 23.0 / 60.0 / 6.25),
        SphKernel::QuinticSpline => (spline(3.0, 5, &[1.0, -6.0, 15.0]), 7.0 / 15.0 / 9.0),
        SphKernel::WendlandC2 => (rest.powi(4) * (1.0 + 4.0 * u), 4.0 / 15.0 / 4.0),
        SphKernel::WendlandC4 => {
            let series = 1.0 + 6.0 * u + 35.0 / 3.0 * u * u;
            (rest.powi(6) * series, 8.0 / 39.0 / 4.0)
        }
        SphKernel::WendlandC6 => {
            let series = 1.0 + 8.0 * u + 25.0 * u * u + 32.0 * u.powi(3);
            (rest.powi(8) * series, 1.0 / 6.0 / 4.0)
        }
    }
}

/// The projection of a kernel of unit mass and support 1, at impact parameters in steps of 1/2000.
struct Projection(Vec<f64>);

impl Projection {
    fn of(kernel: SphKernel) -> Self {
        let steps = 2000;
        let at = |i: usize| {
            let b = i as f64 / f64::from(steps);
            let half = (1.0 - b * b).max(0.0).sqrt();
            let part = |k: i32| {
                let z = half * (f64::from(k) + 0.5) / 400.0;
                definition(kernel, (b * b + z * z).sqrt()).0
            };
            2.0 * half / 400.0 * (0..400).map(part).sum::<f64>()
        };
        let values: Vec<f64> = (0..=steps as usize).map(at).collect();
        let rings = values.iter().enumerate();
        let mass: f64 = rings
            .map(|(i, value)| value * std::f64::consts::TAU * i as f64 / f64::from(steps).powi(2))
            .sum();
        Self(values.iter().map(|value| value / mass).collect())
    }

    fn at(&self, b: f64) -> f64 {
        let place = b * 2000.0;
        let i = place as usize;
        match self.0.get(i..i + 2) {
            Some(&[low, high]) => low + (high - low) * (place - i as f64),
            _ => 0.0,
        }
    }
}

/// Draws particles of one support in an image of a pixel per unit.
fn drawn(
    kernel: Option<SphKernel>,
    places: &[[f64; 2]],
    sigma: f64,
    size: usize,
    settings: &ColumnSettings,
) -> ColumnImage {
    let positions = places.iter().map(|[x, y]| DVec3::new(*x, *y, 0.0));
    let sigmas = vec![sigma as f32; places.len()];
    let volume = masses(
        spheres(positions.collect(), sigmas),
        vec![1.0; places.len()],
    );
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let settings = ColumnSettings {
        smoothing: kernel,
        ..settings.clone()
    };
    renderer
        .column_density(&orthographic(size), &settings)
        .unwrap()
        .clone()
}

/// Single particles are those of brute force.
#[test]
fn columns_of_one_particle_are_means_of_its_kernel() {
    let mut random = Random::new(12);
    for kernel in KERNELS {
        let projection = Projection::of(kernel);
        let (_, variance) = definition(kernel, 0.0);
        for reach in [0.3, 0.7, 1.8, 2.6, 4.0, 7.1, 13.9, 14.1, 33.0, 127.0, 129.0] {
            let size = (2.0 * reach) as usize + 8;
            let place = [random.range(-0.5, 0.5), random.range(-0.5, 0.5)];
            let sigma = reach * variance.sqrt();
            let settings = ColumnSettings::default();
            let image = drawn(Some(kernel), &[place], sigma, size, &settings);
            let mut worst = 0.0_f64;
            let mut greatest = 0.0_f64;
            // Midpoints err by the Laplacian over 24: 2e-5 of the peak at 200 points along the support.
            let parts = (200.0 / reach).ceil().max(3.0) as i32;
            let offsets = || (0..parts).map(|i| (f64::from(i) + 0.5) / f64::from(parts) - 0.5);
            for y in 0..size {
                for x in 0..size {
                    let [dx, dy] = [x, y].map(|i| i as f64 + 0.5 - size as f64 / 2.0);
                    let sum: f64 = offsets()
                        .flat_map(|v| offsets().map(move |u| (u, v)))
                        .map(|(u, v)| {
                            let b = (dx + u - place[0]).hypot(dy + v - place[1]);
                            projection.at(b / reach)
                        })
                        .sum();
                    let truth = sum / f64::from(parts * parts) / (reach * reach);
                    greatest = greatest.max(truth);
                    worst = worst.max((f64::from(image.values[y * size + x]) - truth).abs());
                }
            }
            let error = worst / greatest;
            println!("{kernel:?} {reach}: {error:.1e}");
            // The products' 2e-5, and the error of this test's own means.
            assert!(error < 6e-5, "{kernel:?} {reach}: {error:e}");
            assert!(image.values.iter().all(|value| *value >= 0.0));
            let mass = image.sum_times_area().unwrap();
            assert!((mass - 1.0).abs() < 5e-6, "{kernel:?} {reach}: {mass}");
        }
    }
}

#[test]
fn gaussians_remain_for_small_kernels_filters_and_cut_offs() {
    let settings = ColumnSettings::default();
    let filtered = ColumnSettings {
        low_pass_variance_px2: 1.0,
        ..settings.clone()
    };
    let places = [[0.2, -0.3], [1.7, 1.1]];
    let cubic = Some(SphKernel::CubicSpline);
    let cut = ColumnSettings {
        cutoff: 3.0,
        ..settings.clone()
    };
    let reconstructed = ColumnSettings {
        filter: ewa_splat::Filter::Reconstruction,
        ..settings.clone()
    };
    for (sigma, settings) in [
        (0.05, &settings),
        (1e-4, &settings),
        (3.0, &filtered),
        (3.0, &cut),
        (3.0, &reconstructed),
    ] {
        let [own, gaussian] =
            [cubic, None].map(|kernel| drawn(kernel, &places, sigma, 32, settings));
        assert_eq!(own.values, gaussian.values, "{sigma}");
    }
}

#[test]
fn mass_of_many_particles_is_kept() {
    let mut random = Random::new(3);
    for kernel in [SphKernel::CubicSpline, SphKernel::WendlandC2] {
        for sigma in [0.6, 1.5, 5.0] {
            let places: Vec<[f64; 2]> = (0..5000)
                .map(|_| [random.range(-90.0, 90.0), random.range(-90.0, 90.0)])
                .collect();
            let settings = ColumnSettings::default();
            let image = drawn(Some(kernel), &places, sigma, 256, &settings);
            let error = image.sum_times_area().unwrap() / 5000.0 - 1.0;
            println!("{kernel:?} {sigma}: {error:.1e}");
            assert!(error.abs() < 5e-6, "{kernel:?} {sigma}: {error:e}");
        }
    }
}

/// Kernels on corners and edges of pixels spread over more pixels than others.
#[test]
fn mass_of_small_particles_is_kept_wherever_they_lie() {
    for kernel in KERNELS {
        let (_, variance) = definition(kernel, 0.0);
        for reach in [0.3, 0.55, 1.135, 2.2, 3.7] {
            for place in [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.21, 0.4]] {
                let sigma = reach * variance.sqrt();
                let settings = ColumnSettings::default();
                let image = drawn(Some(kernel), &[place], sigma, 16, &settings);
                let error = image.sum_times_area().unwrap() - 1.0;
                assert!(
                    error.abs() < 5e-6,
                    "{kernel:?} {reach} {place:?}: {error:e}"
                );
            }
        }
    }
}

#[test]
fn other_shapes_are_refused() {
    let factors = vec![[1.0, 0.0, 0.0, 1.0, 0.0, 1.0]];
    let particles = ewa_splat::scene::Particles::Anisotropic {
        positions: vec![DVec3::ZERO],
        factors,
    };
    let mut renderer = Renderer::new(vec![masses(particles, vec![1.0])]).unwrap();
    let settings = ColumnSettings {
        smoothing: Some(SphKernel::CubicSpline),
        ..ColumnSettings::default()
    };
    let error = renderer.column_density(&orthographic(16), &settings);
    assert!(error.unwrap_err().to_string().contains("round particles"));
}

/// The CPU uses no fused operations, as the device uses none; a clip plane cuts some kernels.
#[cfg(feature = "gpu")]
#[test]
fn both_back_ends_draw_the_same_kernels() {
    use crate::common::gpu::gpu;
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(8);
    let settings = ColumnSettings {
        simd: SimdLevel::Baseline,
        ..ColumnSettings::default()
    };
    let cut = ColumnSettings {
        clip: vec![ClipPlane {
            normal: DVec3::new(0.3, 0.2, 1.0),
            distance: 0.0,
        }],
        ..settings.clone()
    };
    for kernel in KERNELS {
        // Under perspective, kernels are sheared.
        let perspective = mixed(1, 96).1;
        for (settings, camera, size, away) in [
            (&settings, orthographic(96), 1.0, 0.0),
            (&cut, orthographic(96), 1.0, 0.0),
            (&settings, perspective, 1.0 / 40.0, 2.5),
        ] {
            let place = |_| random.point(40.0 * size) + away * DVec3::Z;
            let positions: Vec<DVec3> = (0..400).map(place).collect();
            let sigmas = (0..400).map(|_| (size * random.log_range(0.2, 12.0)) as f32);
            let volume = masses(spheres(positions, sigmas.collect()), vec![1.0; 400]);
            let settings = ColumnSettings {
                smoothing: Some(kernel),
                ..settings.clone()
            };
            let mut renderer = Renderer::new(vec![volume.clone()]).unwrap();
            let a = renderer.column_density(&camera, &settings).unwrap().clone();
            let mut renderer = Renderer::new(vec![volume])
                .unwrap()
                .on(gpu.clone())
                .unwrap();
            let b = renderer.column_density(&camera, &settings).unwrap();
            let largest = a.values.iter().fold(0.0_f32, |m, v| m.max(*v));
            let pairs = a.values.iter().zip(&b.values);
            let worst = pairs.fold(0.0_f32, |m, (a, b)| m.max((a - b).abs())) / largest;
            println!("{kernel:?}, {} planes: {worst:.1e}", settings.clip.len());
            // Sums of eight terms that cancel: ten roundings of the greatest.
            assert!(worst < 5e-6, "{kernel:?}: {worst:e}");
        }
    }
}

/// Software adapters end loops early, so that lists are drawn in slices.
#[cfg(feature = "gpu")]
#[test]
fn crowded_pixels_are_summed_whole_on_the_gpu() {
    use crate::common::gpu::gpu;
    let Some(gpu) = gpu() else { return };
    let count = 4000;
    let positions = vec![DVec3::new(0.2, 0.1, 0.0); count];
    for sigma in [0.6, 2.0, 9.0] {
        let volume = masses(
            spheres(positions.clone(), vec![sigma; count]),
            vec![0.1; count],
        );
        let settings = ColumnSettings {
            smoothing: Some(SphKernel::QuinticSpline),
            ..ColumnSettings::default()
        };
        let mut renderer = Renderer::new(vec![volume])
            .unwrap()
            .on(gpu.clone())
            .unwrap();
        let image = renderer
            .column_density(&orthographic(128), &settings)
            .unwrap();
        let error = image.sum_times_area().unwrap() / 400.0 - 1.0;
        assert!(error.abs() < 5e-6, "{sigma}: {error:e}");
    }
}
