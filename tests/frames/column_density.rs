//! Tests column densities: mass, exactness, linearity, determinism, and the command line.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use super::column_scenes::{classified, masses, mixed, orthographic, spheres};
use crate::common::judge::Body;
use crate::common::scene::{self, camera};
use crate::common::{Random, lower_factor};
use ewa_splat::Filter;
use ewa_splat::render::SimdLevel;
use ewa_splat::scene::{Lattice, LatticeSpacing, Particles, PointVolume, Values};
use ewa_splat::view::{Camera, ClipPlane, Projection};
use ewa_splat::{ColumnImage, ColumnSettings, Renderer};
use glam::{DMat3, DVec2, DVec3};

/// Half a unit in the last place of f32, relative.
const EPS: f64 = 5.960_464_477_539_063e-8;

fn column(volume: PointVolume, camera: &Camera, settings: &ColumnSettings) -> ColumnImage {
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    renderer.column_density(camera, settings).unwrap().clone()
}

/// Returns settings with the filter of 1 px², sampled at the pixels' centres.
fn filtered() -> ColumnSettings {
    ColumnSettings {
        low_pass_variance_px2: 1.0,
        ..ColumnSettings::default()
    }
}

/// Returns the largest difference of two images, relative to the largest magnitude of the second.
fn difference(a: &ColumnImage, b: &ColumnImage) -> f64 {
    let pairs = a.values.iter().zip(&b.values);
    let largest = b.values.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    let worst = pairs
        .map(|(a, b)| f64::from((a - b).abs()))
        .fold(0.0, f64::max);
    worst / f64::from(largest)
}

/// Returns some 10,000 particles well inside an image of 512 px.
fn cloud(random: &mut Random, count: usize) -> (Vec<DVec3>, Vec<f32>) {
    let positions = (0..count).map(|_| random.point(150.0)).collect();
    let masses = (0..count).map(|_| random.range(0.5, 2.0) as f32).collect();
    (positions, masses)
}

#[test]
fn mass_is_conserved_for_spheres_of_every_size() {
    let mut random = Random::new(1);
    // The largest is wider than half the image; all of it stays inside.
    for (sigma, count, half) in [
        (1e-3, 10_000, 200.0),
        (0.3, 10_000, 200.0),
        (1.0, 10_000, 200.0),
        (5.0, 10_000, 200.0),
        (40.0, 1_000, 30.0),
        (300.0, 50, 100.0),
    ] {
        let size = if sigma > 100.0 { 4096 } else { 512 };
        let positions: Vec<DVec3> = (0..count).map(|_| random.point(half)).collect();
        let weights: Vec<f32> = (0..count).map(|_| random.range(0.5, 2.0) as f32).collect();
        let total: f64 = weights.iter().map(|&m| f64::from(m)).sum();
        let volume = masses(spheres(positions, vec![sigma; count]), weights);
        let mut renderer = Renderer::new(vec![volume]).unwrap();
        let settings = ColumnSettings::default();
        let image = renderer
            .column_density(&orthographic(size), &settings)
            .unwrap();
        let error = image.sum_times_area().unwrap() / total - 1.0;
        // The promised bound. The cut-off omits 2.7e-7, the exponential errs by 2e-7, an amplitude
        // by 4 EPS.
        assert!(error.abs() < 1e-5, "{sigma} px: {error:e}");
        // The actual error is smaller; a drift would show here first.
        assert!(error.abs() < 1.5e-6, "{sigma} px: {error:e}");
        assert!((renderer.amplitudes().sum - total).abs() < 1e-9 * total);
    }
}

#[test]
fn mass_is_conserved_for_ellipsoids_and_lattices() {
    let mut random = Random::new(2);
    for (largest, ratio) in [(1e-2, 3.0), (2.0, 5.0), (15.0, 1.0), (15.0, 300.0)] {
        let (positions, weights) = cloud(&mut random, 3_000);
        let factors = positions
            .iter()
            .map(|_| lower_factor(&random.factor(largest, ratio)))
            .collect();
        let total: f64 = weights.iter().map(|&m| f64::from(m)).sum();
        let volume = masses(Particles::Anisotropic { positions, factors }, weights);
        let image = column(volume, &orthographic(512), &ColumnSettings::default());
        let error = image.sum_times_area().unwrap() / total - 1.0;
        assert!(error.abs() < 1.5e-6, "{largest} px, 1:{ratio}: {error:e}");
    }
    // Uniform, rotated and sheared, and rectilinear lattices; values of both signs.
    let step = DMat3::from_cols(
        DVec3::new(9.0, 2.0, 1.0),
        DVec3::new(-1.0, 8.0, 2.0),
        DVec3::new(3.0, 0.5, 7.0),
    );
    let axis: Vec<f64> = (0..12).map(|i| f64::from(i * i)).collect();
    // At the ends, the distance to the only neighbour.
    let width = |i: usize| match i {
        0 => axis[1] - axis[0],
        11 => axis[11] - axis[10],
        _ => (axis[i + 1] - axis[i - 1]) / 2.0,
    };
    let uniform_volume = |_: [usize; 3]| step.determinant();
    let rectilinear_volume = |cell: [usize; 3]| cell.map(width).iter().product::<f64>();
    type CellVolume<'a> = &'a dyn Fn([usize; 3]) -> f64;
    let cases: [(LatticeSpacing, CellVolume); 2] = [
        (
            LatticeSpacing::Uniform {
                origin: DVec3::splat(-60.0),
                step,
            },
            &uniform_volume,
        ),
        (
            LatticeSpacing::Rectilinear {
                coordinates: [0; 3].map(|_| axis.iter().map(|x| x - 60.0).collect()),
            },
            &rectilinear_volume,
        ),
    ];
    for (spacing, cell_volume) in cases {
        let lattice = Lattice {
            dims: [12; 3],
            spacing,
        };
        let values: Vec<f32> = (0..12 * 12 * 12)
            .map(|_| random.range(-0.2, 1.0) as f32)
            .collect();
        let particles = Particles::Lattice {
            lattice,
            kernel_width: 0.6,
        };
        let volume = classified(particles, Vec::new(), Values::F32(values.clone()));
        let mut renderer = Renderer::new(vec![volume]).unwrap();
        let settings = ColumnSettings::default();
        let image = renderer
            .column_density(&orthographic(512), &settings)
            .unwrap();
        let sum = image.sum_times_area().unwrap();
        let total = renderer.amplitudes().sum;
        assert!((sum / total - 1.0).abs() < 4e-6, "{}", sum / total - 1.0);
        // Compares with volumes that the renderer did not compute; rectilinear ones are products of
        // f32.
        let cells = (0..12 * 12 * 12).map(|i| [i % 12, i / 12 % 12, i / 144]);
        let direct: f64 = values
            .iter()
            .zip(cells)
            .map(|(&v, cell)| f64::from(v) * cell_volume(cell))
            .sum();
        assert!((direct / total - 1.0).abs() < 10.0 * EPS);
    }
}

#[test]
fn one_particle_is_its_gaussian_at_pixel_centres() {
    let mut random = Random::new(3);
    for sigma in [1e-3, 0.5, 4.0, 30.0] {
        for anisotropic in [false, true] {
            let position = random.point(20.0);
            let factor = if anisotropic {
                random.factor(sigma, 4.0)
            } else {
                DMat3::from_diagonal(DVec3::splat(sigma))
            };
            let particles = if anisotropic {
                Particles::Anisotropic {
                    positions: vec![position],
                    factors: vec![lower_factor(&factor)],
                }
            } else {
                spheres(vec![position], vec![sigma as f32])
            };
            let image = column(
                masses(particles, vec![3.0]),
                &orthographic(512),
                &filtered(),
            );
            let v = factor * factor.transpose();
            let (a, b, c) = (v.x_axis.x + 1.0, v.x_axis.y, v.y_axis.y + 1.0);
            let determinant = a * c - b * b;
            let peak = 3.0 / (std::f64::consts::TAU * determinant.sqrt());
            let narrow = (0.5 * (a + c) - (0.5 * (a - c)).hypot(b)).sqrt();
            // The centre's pixel coordinate is rounded to EPS of some 300 px in each axis, against
            // the slope .61/sigma. The cut-off omits 2.7e-7, and the exponential errs by at most
            // 3e-6. Form and amplitude have ten roundings.
            let tolerance = 0.61 * 2.0 * 300.0 * EPS / narrow + 3.6e-6 + 10.0 * EPS;
            for y in 0..512 {
                for x in 0..512 {
                    let pixel = DVec2::new(x as f64, y as f64) + 0.5 - 256.0;
                    let d = pixel - position.truncate();
                    let q = (c * d.x * d.x - 2.0 * b * d.x * d.y + a * d.y * d.y) / determinant;
                    let value = f64::from(image.values[y * 512 + x]) / peak;
                    let error = (value - (-0.5 * q).exp()).abs();
                    assert!(
                        error < tolerance,
                        "{sigma}, ({x}, {y}): {error:e} > {tolerance:e}"
                    );
                }
            }
        }
    }
}

/// Returns the mean of a Gaussian of unit mass over each pixel of a square image: in closed form
/// along x, and along y by Gauss-Legendre quadrature of eight points in each of many parts.
fn pixel_means(variance: [f64; 3], centre: DVec2, size: usize) -> Vec<f64> {
    const NODES: [(f64, f64); 4] = [
        (0.183_434_642_495_650, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887),
        (0.796_666_477_413_627, 0.222_381_034_453_374),
        (0.960_289_856_497_536, 0.101_228_536_290_376),
    ];
    let [xx, xy, yy] = variance;
    let (along, turn) = (yy.sqrt(), xy / yy);
    let across = (xx - xy * turn).max(1e-18).sqrt();
    let cdf = |x: f64| ewa_splat::math::normal_density_and_cdf([x]).1[0];
    let mut means = vec![0.0; size * size];
    for row in 0..size {
        let low = (row as f64 - centre.y).max(-9.0 * along);
        let high = (row as f64 + 1.0 - centre.y).min(9.0 * along);
        if low >= high {
            continue;
        }
        let finest = along.min(across / turn.abs().max(1e-9));
        let parts = ((high - low) / finest).ceil().clamp(1.0, 300.0) as usize;
        let width = (high - low) / parts as f64;
        for part in 0..parts {
            let middle = low + (part as f64 + 0.5) * width;
            for (node, weight) in NODES {
                for y in [middle - 0.5 * width * node, middle + 0.5 * width * node] {
                    let mass = 0.5 * width * weight * (-0.5 * (y / along).powi(2)).exp()
                        / (std::f64::consts::TAU.sqrt() * along);
                    let end = |x: usize| cdf((x as f64 - centre.x - turn * y) / across);
                    for x in 0..size {
                        means[row * size + x] += mass * (end(x + 1) - end(x));
                    }
                }
            }
        }
    }
    means
}

#[test]
fn pixels_have_the_means_of_kernels_over_them() {
    let mut random = Random::new(41);
    let size = 64;
    // Standard deviations, px, and the largest allowed error relative to the greatest pixel. For
    // round kernels it is the integral's rounding, beyond two pixels the remainder of the pixel's
    // variance, and for rotated ones that of the bands.
    for (sigmas, allowed) in [
        ([0.05, 0.05], 4e-5),
        ([0.3, 0.3], 1e-5),
        ([1.0, 1.0], 1e-5),
        ([1.9, 1.9], 1e-5),
        ([2.2, 2.2], 1.3e-4),
        ([5.0, 5.0], 2e-5),
        ([0.3, 0.1], 1e-2),
        ([1.0, 0.3], 1e-2),
        ([3.0, 1.0], 1e-3),
        ([5.0, 0.3], 1e-2),
        ([3.0, 0.02], 8e-2),
    ] {
        for turn in [0.0, 0.4, std::f64::consts::FRAC_PI_4, 1.3] {
            let [long, short] = sigmas;
            let at = DVec2::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0));
            let (sin, cos) = f64::sin_cos(turn);
            let factor = DMat3::from_cols(
                DVec3::new(cos, sin, 0.0) * long,
                DVec3::new(-sin, cos, 0.0) * short,
                DVec3::Z,
            );
            let particles = if long == short {
                spheres(vec![at.extend(0.0)], vec![long as f32])
            } else {
                Particles::Anisotropic {
                    positions: vec![at.extend(0.0)],
                    factors: vec![lower_factor(&factor)],
                }
            };
            let volume = masses(particles, vec![1.0]);
            let image = column(volume, &orthographic(size), &ColumnSettings::default());
            let v = factor * factor.transpose();
            let truth = pixel_means([v.x_axis.x, v.x_axis.y, v.y_axis.y], at + 32.0, size);
            let greatest = truth.iter().copied().fold(0.0, f64::max);
            let pairs = image.values.iter().zip(&truth);
            let errors = pairs.map(|(own, true_mean)| (f64::from(*own) - true_mean).abs());
            let worst = errors.fold(0.0, f64::max) / greatest;
            println!("{sigmas:?} turned by {turn}: {worst:.1e}");
            assert!(worst < allowed, "{sigmas:?} turned by {turn}: {worst:e}");
            let mass = image.sum_times_area().unwrap();
            assert!((mass - 1.0).abs() < 3e-6, "{sigmas:?}, {turn}: {mass}");
        }
    }
}

#[test]
fn amplitudes_add_and_negative_ones_subtract() {
    let mut random = Random::new(4);
    let (positions, _) = cloud(&mut random, 2_000);
    let sigmas: Vec<f32> = positions
        .iter()
        .map(|_| random.log_range(0.1, 20.0) as f32)
        .collect();
    let values = |random: &mut Random| -> Vec<f32> {
        positions
            .iter()
            .map(|_| random.range(-1.0, 1.0) as f32)
            .collect()
    };
    let (a, b) = (values(&mut random), values(&mut random));
    let draw = |values: Vec<f32>| {
        let particles = spheres(positions.clone(), sigmas.clone());
        let volumes = vec![0.5; positions.len()];
        column(
            classified(particles, volumes, Values::F32(values)),
            &orthographic(512),
            &ColumnSettings::default(),
        )
    };
    let sum: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 2.0 * a + b).collect();
    let (of_a, of_b, of_sum) = (draw(a), draw(b), draw(sum));
    let added = ColumnImage {
        values: of_a
            .values
            .iter()
            .zip(&of_b.values)
            .map(|(a, b)| 2.0 * a + b)
            .collect(),
        ..of_a.clone()
    };
    assert!(of_a.values.iter().any(|v| *v < 0.0) && of_a.values.iter().any(|v| *v > 0.0));
    // A pixel has up to hundreds of kernels, whose magnitudes sum to some ten times the largest
    // value. Each is rounded by 8 EPS in tau, and by 2 EPS in the sum of the values.
    assert!(
        difference(&added, &of_sum) < 1e2 * EPS,
        "{:e}",
        difference(&added, &of_sum)
    );
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let (volumes, camera) = mixed(3_000, 200);
            let mut renderer = Renderer::new(volumes).unwrap();
            let settings = ColumnSettings::default();
            let perspective = renderer.column_density(&camera, &settings).unwrap().clone();
            // One tile holds so many footprints that its list is split into tasks.
            let mut random = Random::new(6);
            let positions = (0..40_000).map(|_| random.point(20.0)).collect();
            let sigmas = (0..40_000)
                .map(|_| random.log_range(0.1, 3.0) as f32)
                .collect();
            let crowd = masses(spheres(positions, sigmas), vec![1.0; 40_000]);
            let crowd = column(crowd, &orthographic(60), &settings);
            assert!(renderer.counts().footprints_near > 5);
            [perspective, crowd]
        })
    };
    let one = draw(1);
    for threads in [2, 3, 7] {
        assert_eq!(draw(threads), one, "{threads} threads");
    }
}

#[test]
fn instruction_sets_agree() {
    let (volumes, camera) = mixed(3_000, 200);
    let mut renderer = Renderer::new(volumes).unwrap();
    let mut images = Vec::new();
    for simd in SimdLevel::available() {
        for filter in [Filter::Adaptive, Filter::Exact, Filter::Ewa] {
            let settings = ColumnSettings {
                simd,
                filter,
                ..ColumnSettings::default()
            };
            let image = renderer.column_density(&camera, &settings).unwrap();
            images.push((simd, filter, image.clone(), renderer.counts()));
        }
    }
    for (simd, filter, image, counts) in &images {
        let baseline = images.iter().find(|(_, f, _, _)| f == filter).unwrap();
        // Fused or not: a few roundings in q of up to 30, so 30 EPS of a kernel where it
        // contributes exp(-15), and 10 EPS where it is high. The cut-off matters by 2.7e-7 of a
        // peak.
        let error = difference(image, &baseline.2);
        assert!(error < 12.0 * EPS, "{simd:?} {}: {error:e}", filter.name());
        let splats = counts.splat_pixels as f64 / baseline.3.splat_pixels as f64;
        assert!((splats - 1.0).abs() < 1e-4, "{simd:?}: {splats}");
    }
}

#[test]
fn amplitudes_beyond_single_precision_give_columns_within_it() {
    // A cloud in centimetres and grams, 1e43 g each: 1e24 cm across, 1e43 in density x volume.
    let mut random = Random::new(7);
    let count = 1_000;
    let scale = 2e21;
    let small: Vec<DVec3> = (0..count).map(|_| random.point(150.0)).collect();
    let draw = |length: f64, volume: f32, value: f32, anisotropic: bool| {
        let positions: Vec<DVec3> = small.iter().map(|p| *p * length).collect();
        let particles = if anisotropic {
            let factor = DMat3::from_diagonal(DVec3::new(3.0, 4.0, 5.0) * length);
            let factors = vec![lower_factor(&factor); count];
            Particles::Anisotropic { positions, factors }
        } else {
            spheres(positions, vec![(3.0 * length) as f32; count])
        };
        let camera = Camera {
            eye: DVec3::Z * (-1e5 * length),
            focal_px: DVec2::splat(1.0 / length),
            ..orthographic(512)
        };
        let volume = classified(
            particles,
            vec![volume; count],
            Values::F32(vec![value; count]),
        );
        column(volume, &camera, &ColumnSettings::default())
    };
    for anisotropic in [false, true] {
        let physical = draw(scale, 1e33, 1e10, anisotropic);
        let unit = draw(1.0, 1.0, 1.0, anisotropic);
        let expected = 1e43 / (scale * scale);
        let total = physical.sum_times_area().unwrap();
        assert!((total / 1e46 - 1.0).abs() < 2e-6, "{total:e}");
        for (physical, unit) in physical.values.iter().zip(&unit.values) {
            let ratio = f64::from(*physical) / expected;
            // Positions round differently: EPS of 300 px at a slope of .61/3 each.
            let tolerance = 2e-5 * f64::from(*unit) + 1e-6;
            assert!(
                (ratio - f64::from(*unit)).abs() < tolerance,
                "{ratio} {unit}"
            );
        }
    }
}

#[test]
fn results_beyond_single_precision_are_an_error() {
    let particles = spheres(vec![DVec3::ZERO; 10], vec![1.0; 10]);
    let volume = classified(particles, vec![1e33; 10], Values::F32(vec![1e10; 10]));
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let error = renderer
        .column_density(&orthographic(64), &ColumnSettings::default())
        .unwrap_err();
    assert!(error.to_string().contains("larger units"), "{error}");
}

#[test]
fn values_that_are_not_numbers_add_nothing_and_are_counted() {
    let at = vec![DVec3::ZERO, DVec3::X * 5.0, DVec3::Y * 5.0];
    let volumes = vec![2.0; 3];
    let some = classified(
        spheres(at.clone(), vec![1.0; 3]),
        volumes.clone(),
        Values::F32(vec![f32::NAN, 1.5, f32::INFINITY]),
    );
    let one = classified(
        spheres(at, vec![1.0; 3]),
        volumes,
        Values::F32(vec![0.0, 1.5, 0.0]),
    );
    let settings = ColumnSettings::default();
    let mut renderer = Renderer::new(vec![some]).unwrap();
    let image = renderer
        .column_density(&orthographic(64), &settings)
        .unwrap()
        .clone();
    assert_eq!(renderer.amplitudes().not_finite, 2);
    assert_eq!(image, column(one, &orthographic(64), &settings));
    assert!((image.sum_times_area().unwrap() - 3.0).abs() < 1e-5);
}

#[test]
fn a_uniform_lattice_is_its_path_length_inside() {
    let lattice = Lattice {
        dims: [40, 40, 10],
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::new(-78.0, -78.0, -18.0),
            step: DMat3::from_diagonal(DVec3::splat(4.0)),
        },
    };
    let particles = Particles::Lattice {
        lattice,
        kernel_width: 0.6,
    };
    let volume = classified(particles, Vec::new(), Values::F32(vec![2.5; 16_000]));
    let image = column(volume, &orthographic(256), &ColumnSettings::default());
    // Ten cells of 4 lie behind one another. The field of kernels .6 spacings wide ripples by 2
    // exp(-2 pi² .36) = .16 % in each of two axes; the low-pass filter adds 1/16 to .36.
    for y in 100..156 {
        for x in 100..156 {
            let value = f64::from(image.values[y * 256 + x]);
            assert!((value / 100.0 - 1.0).abs() < 3.3e-3, "({x}, {y}): {value}");
        }
    }
}

#[test]
fn perspective_is_the_line_integral_off_the_axis() {
    let mut random = Random::new(8);
    let camera = camera(Projection::Perspective, [400.0, 420.0], [640, 480]);
    let focal = camera.focal_px;
    for (filter, largest_error) in [
        // Kernels are affine if their bound fits the tolerance, and exact otherwise.
        (Filter::Adaptive, 1.0 / 255.0),
        // f32 roundings of w and Q: 6e-6 of the peak (`footprint_laws.rs`), the exponential's
        // 3e-6, and the centre's rounding to EPS of 640 px at .61 per px, twice.
        (Filter::Exact, 6e-6 + 3e-6 + 2.0 * 0.61 * 640.0 * EPS),
    ] {
        let mut worst = 0.0_f64;
        for _ in 0..60 {
            let depth = random.log_range(1.0, 100.0);
            let slope = DVec2::new(random.range(-0.7, 0.7), random.range(-0.5, 0.5));
            let position = (slope * depth).extend(depth);
            let sigma = depth * random.log_range(1e-4, 0.05);
            let volume = masses(spheres(vec![position], vec![sigma as f32]), vec![2.0]);
            let settings = ColumnSettings {
                filter,
                ..filtered()
            };
            let image = column(volume, &camera, &settings);
            let body = Body {
                centre: position,
                variance: DMat3::from_diagonal(DVec3::splat(f64::from(sigma as f32).powi(2))),
                mass: 2.0,
            }
            .low_passed(focal, 1.0, depth);
            let peak = body.line_integral(position);
            for (i, value) in image.values.iter().enumerate() {
                let pixel = DVec2::new((i % 640) as f64, (i / 640) as f64) + 0.5;
                let ray = ((pixel - camera.centre_px) / focal).extend(1.0);
                let error = (f64::from(*value) - body.line_integral(ray)).abs() / peak;
                worst = worst.max(error);
            }
        }
        assert!(worst < largest_error, "{}: {worst:e}", filter.name());
        // Adaptive must use affine footprints somewhere, or the test would be void.
        assert!(filter == Filter::Exact || worst > 1e-4, "{worst:e}");
    }
}

/// Returns a plane that keeps about half of the neighbourhood of a point, at any angle to the rays.
fn plane_through(random: &mut Random, at: DVec3) -> ClipPlane {
    let normal = random.rotation().x_axis * random.log_range(0.1, 10.0);
    ClipPlane {
        normal,
        distance: -normal.dot(at),
    }
}

#[test]
fn planes_leave_the_integral_over_the_rest_of_each_ray() {
    let mut random = Random::new(31);
    for (projection, focal, filter) in [
        (Projection::Perspective, 90.0, Filter::Exact),
        (Projection::Orthographic, 8.0, Filter::Adaptive),
    ] {
        // The image's border cuts off tiles, within one picture of columns.
        let camera = camera(projection, [focal, focal * 1.1], [100, 75]);
        let mut worst = 0.0_f64;
        let mut cut = 0;
        for _ in 0..30 {
            let depth = random.range(8.0, 12.0);
            let at = DVec3::new(random.range(-3.0, 3.0), random.range(-2.0, 2.0), depth);
            let factor = random.factor(0.8, 4.0);
            let volume = masses(
                Particles::Anisotropic {
                    positions: vec![at],
                    factors: vec![lower_factor(&factor)],
                },
                vec![-2.0],
            );
            let beside = at + random.point(0.5);
            let plane = plane_through(&mut random, beside);
            let settings = ColumnSettings {
                filter,
                // Without a filter, the reference is the integral along the pixel's own ray.
                low_pass_variance_px2: 0.0,
                clip: vec![plane],
                ..ColumnSettings::default()
            };
            let image = column(volume, &camera, &settings);
            let body = Body {
                centre: at,
                variance: factor * factor.transpose(),
                mass: 2.0,
            };
            // No ray has a larger value.
            let peak = image.values.iter().fold(1e-3_f32, |m, v| m.max(v.abs()));
            for (i, value) in image.values.iter().enumerate() {
                let pixel = DVec2::new((i % 100) as f64, (i / 100) as f64) + 0.5;
                let slope = (pixel - camera.centre_px) / camera.focal_px;
                let (start, ray) = match projection {
                    Projection::Perspective => (DVec3::ZERO, slope.extend(1.0)),
                    Projection::Orthographic => (slope.extend(0.0), DVec3::Z),
                };
                let (inside, rate) = (
                    plane.normal.dot(start) + plane.distance,
                    plane.normal.dot(ray),
                );
                let crossing = start - ray * (inside / rate);
                let expected = if rate > 0.0 {
                    body.half_line_integral(crossing, ray)
                } else {
                    body.half_line_integral(crossing, -ray)
                };
                let whole = body.half_line_integral(crossing - ray * 100.0, ray);
                cut += usize::from(expected > 0.2 * whole && expected < 0.8 * whole);
                let error = (f64::from(*value) + expected).abs() / f64::from(peak);
                worst = worst.max(error);
            }
        }
        // The bound of pictures with clip planes (docs/compositing.md), which includes the cut-off
        // and the exponential, 4e-6.
        assert!(worst < 5e-5, "{projection:?}: {worst:e}");
        assert!(cut > 1000, "{projection:?}: {cut}");
    }
}

#[test]
fn a_plane_through_the_middle_leaves_half_the_mass() {
    let mut random = Random::new(32);
    for sigma in [0.3_f32, 4.0, 20.0] {
        let (half, half_masses) = cloud(&mut random, 2000);
        // The plane passes through the centre, about which every kernel has a mirror image.
        let positions = half.iter().copied().chain(half.iter().map(|p| -*p));
        let weights = half_masses.iter().chain(&half_masses).copied().collect();
        let total: f64 = half_masses.iter().map(|&m| 2.0 * f64::from(m)).sum();
        let particles = spheres(positions.collect(), vec![sigma; 4000]);
        let mut renderer = Renderer::new(vec![masses(particles, weights)]).unwrap();
        let mut sum_of = |clip: Vec<ClipPlane>| {
            let settings = ColumnSettings {
                clip,
                ..ColumnSettings::default()
            };
            let camera = orthographic(512);
            let image = renderer.column_density(&camera, &settings).unwrap();
            image.sum_times_area().unwrap() / total
        };
        let plane = ClipPlane {
            normal: DVec3::new(0.5, -0.3, 0.8),
            distance: 0.0,
        };
        let rest = ClipPlane {
            normal: -plane.normal,
            distance: 0.0,
        };
        let (half, other) = (sum_of(vec![plane]), sum_of(vec![rest]));
        // The whole has a promised error of 1e-5. The plane's position has an ulp of f32 at the
        // eye's distance of 1e5, a few thousandths of a unit in a cloud of some 300.
        assert!((half - 0.5).abs() < 1e-4, "{sigma}: {half}");
        assert!(
            (half + other - 1.0).abs() < 1.5e-5,
            "{sigma}: {half} {other}"
        );
        // Opposite planes leave nothing.
        assert_eq!(sum_of(vec![plane, rest]), 0.0);
    }
}

#[test]
fn planes_beyond_everything_change_nothing() {
    let (scene, camera) = mixed(3_000, 200);
    let mut renderer = Renderer::new(scene).unwrap();
    let whole = renderer
        .column_density(&camera, &ColumnSettings::default())
        .unwrap()
        .clone();
    let settings = ColumnSettings {
        clip: ClipPlane::of_box(DVec3::splat(-1e4), DVec3::splat(1e4)).to_vec(),
        ..ColumnSettings::default()
    };
    let clipped = renderer.column_density(&camera, &settings).unwrap();
    assert_eq!(clipped.values, whole.values);
}

#[test]
fn repeated_contributions_lose_nothing() {
    // 200,000 equal kernels lie at one position: an f32 sum would be off by parts in a thousand.
    let count = 200_000;
    let volume = masses(
        spheres(vec![DVec3::ZERO; count], vec![2.0; count]),
        vec![0.7; count],
    );
    let many = column(volume, &orthographic(64), &ColumnSettings::default());
    let one = masses(spheres(vec![DVec3::ZERO], vec![2.0]), vec![0.7]);
    let one = column(one, &orthographic(64), &ColumnSettings::default());
    for (many, one) in many.values.iter().zip(&one.values) {
        let expected = f64::from(*one) * count as f64;
        // 64 equal additions in f32 err by at most 32 EPS; one more for each picture.
        assert!((f64::from(*many) - expected).abs() <= 35.0 * EPS * expected);
    }
}

#[test]
fn bad_settings_are_refused() {
    let volume = masses(spheres(vec![DVec3::ZERO], vec![1.0]), vec![1.0]);
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    for (settings, says) in [
        (
            ColumnSettings {
                cutoff: 8.0,
                ..ColumnSettings::default()
            },
            "cut-off",
        ),
        (
            ColumnSettings {
                low_pass_variance_px2: -1.0,
                ..ColumnSettings::default()
            },
            "low-pass",
        ),
    ] {
        let error = renderer
            .column_density(&orthographic(64), &settings)
            .unwrap_err();
        assert!(error.to_string().contains(says), "{error}");
    }
    // A picture and a column density of one renderer do not affect each other.
    let camera = orthographic(64);
    let first = renderer.render(&camera, &scene::linear()).unwrap().clone();
    let as_drawn = ColumnSettings {
        low_pass_variance_px2: scene::linear().low_pass_variance_px2,
        ..ColumnSettings::default()
    };
    let column = renderer.column_density(&camera, &as_drawn).unwrap().clone();
    assert_eq!(*renderer.render(&camera, &scene::linear()).unwrap(), first);
    // The volume is so thin that opacity min(tau, 1) is tau.
    for (pixel, value) in first.pixels.iter().zip(&column.values) {
        assert!((pixel[3] - value).abs() < 1e-6);
    }
}

#[test]
fn a_real_set_keeps_its_mass() {
    let Some(path) = crate::common::real_data("particles/phantom_mhd_00000.csv") else {
        return;
    };
    let dataset = ewa_splat::io::open(&path, &ewa_splat::io::OpenOptions::default()).unwrap();
    let options = ewa_splat::sample::SampleOptions {
        field: Some("rho".into()),
        ..ewa_splat::sample::SampleOptions::default()
    };
    let volume = ewa_splat::sample::volume(dataset, &options).unwrap().volume;
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let view = ewa_splat::view::Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 25.0,
        zoom: 0.6,
        up: DVec3::Z,
    };
    let lens = ewa_splat::view::Lens::OrthoHeight(None);
    let camera = view.camera(&renderer.boxes(), lens, [400, 300]).unwrap();
    let settings = ColumnSettings::default();
    let image = renderer.column_density(&camera, &settings).unwrap();
    // The column `m` of the file: 4,843 particles of .000304762024.
    let error = image.sum_times_area().unwrap() / 1.475_962_482_231_933_5 - 1.0;
    assert!(error.abs() < 1.5e-6, "{error:e}");
}

#[cfg(feature = "cli")]
mod command_line {
    use std::path::Path;
    use std::process::{Command, Output};

    use serde_json::Value;

    const TABLE: &str = "x,y,z,h,m,rho\n0,0,0,.5,2,1\n3,1,0,.2,1,4\n-2,-1,1,.01,3,2\n";

    fn run(folder: &Path, arguments: &[&str]) -> Output {
        let program = env!("CARGO_BIN_EXE_ewa-splat");
        let mut command = Command::new(program);
        command
            .args(arguments)
            .current_dir(folder)
            .output()
            .unwrap()
    }

    fn render(folder: &Path, out: &str, more: &[&str]) -> (Output, Value) {
        let mut arguments = vec!["render", "a.csv", "--column-density", "--size", "96x64"];
        arguments.extend(["--zoom", ".6", "--stats", "s.json", "--out", out]);
        arguments.extend(more);
        let output = run(folder, &arguments);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}");
        let stats = std::fs::read(folder.join("s.json")).unwrap();
        (output, serde_json::from_slice(&stats).unwrap())
    }

    fn floats(bytes: &[u8]) -> Vec<f32> {
        let words = bytes.as_chunks::<4>().0;
        words.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    #[test]
    fn writes_every_format_and_says_what_it_holds() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        std::fs::write(folder.join("a.csv"), TABLE).unwrap();
        // Density by volumes m / rho: the column mass.
        let field = ["--field", "rho"];
        let (_, stats) = render(folder, "a.npy", &field);
        let column = &stats["column_density"];
        let total = column["sum_times_area"].as_f64().unwrap();
        // The view is zoomed out, so that six standard deviations of each kernel lie inside.
        assert!((total / 6.0 - 1.0).abs() < 1e-5, "{total}");
        assert!((column["amplitude_sum"].as_f64().unwrap() / 6.0 - 1.0).abs() < 1e-6);
        assert_eq!(column["not_finite"], 0);
        assert!(stats["splat_pixels"].as_u64().unwrap() > 100);
        assert!(stats["times_ms"]["frame"].as_f64().unwrap() > 0.0);
        assert_eq!(stats["footprints"], 3);

        let npy = std::fs::read(folder.join("a.npy")).unwrap();
        let values = floats(&npy[npy.len() - 96 * 64 * 4..]);
        let header = String::from_utf8_lossy(&npy[..128]).into_owned();
        assert!(
            header.contains("<f4") && header.contains("(64, 96"),
            "{header}"
        );
        let largest = values.iter().copied().fold(0.0, f32::max);
        assert_eq!(column["range"][1].as_f64().unwrap() as f32, largest);
        let least = column["range"][0].as_f64().unwrap();
        assert!(least == 0.0 && least.is_sign_positive());

        render(folder, "a.pfm", &field);
        let pfm = std::fs::read(folder.join("a.pfm")).unwrap();
        assert!(pfm.starts_with(b"Pf\n96 64\n-1.0\n"));
        let rows = floats(&pfm[pfm.len() - 96 * 64 * 4..]);
        let flipped: Vec<f32> = rows.chunks(96).rev().flatten().copied().collect();
        assert_eq!(flipped, values);

        render(folder, "a.exr", &field);
        let exr = exr::prelude::read_first_flat_layer_from_file(folder.join("a.exr")).unwrap();
        let channels = &exr.layer_data.channel_data.list;
        assert_eq!(channels.len(), 1);
        assert_eq!(channels[0].name.to_string(), "Y");
        let stored: Vec<f32> = channels[0].sample_data.values_as_f32().collect();
        assert_eq!(stored, values);

        let (output, stats) = render(folder, "a.png", &field);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains("viridis over log10"), "{text}");
        let least = stats["column_density"]["shown_range"][0].as_f64().unwrap();
        assert!(text.contains(&format!("{:e}", least as f32)), "{text}");
        let png = ewa_splat::io::read_image(&folder.join("a.png")).unwrap();
        for (pixel, value) in png.pixels.iter().zip(&values) {
            assert_eq!(pixel[3] > 0.0, f64::from(*value) >= least);
        }
    }

    #[test]
    fn takes_any_camera_and_refuses_what_has_no_meaning() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        std::fs::write(folder.join("a.csv"), TABLE).unwrap();
        // No pixel area under perspective.
        let (_, stats) = render(folder, "a.npy", &["--field", "rho", "--fov", "30"]);
        assert!(stats["column_density"]["sum_times_area"].is_null());
        let (_, stats) = render(folder, "a.npy", &["--field", "rho", "--ortho", "20"]);
        assert!(stats["column_density"]["sum_times_area"].as_f64().unwrap() > 5.9);
        for option in [
            &["--reference"][..],
            &["--opacity", "linear"],
            &["--background", "0,0,0"],
            &["--depth", "d.npy"],
        ] {
            let mut arguments = vec!["render", "a.csv", "--column-density", "--out", "b.npy"];
            arguments.extend(option);
            assert_eq!(run(folder, &arguments).status.code(), Some(2), "{option:?}");
        }
        assert!(!folder.join("b.npy").exists());
    }
}
