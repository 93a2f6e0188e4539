//! Tests slices through sums of kernels against their formulas in f64.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use super::column_kernels::{KERNELS, definition};
use super::column_scenes::{classified, masses, orthographic, spheres};
use crate::common::Random;
use ewa_splat::scene::{Boundary, Lattice, Particles, PointVolume, Values};
use ewa_splat::view::{Along, Camera, ClipPlane, Window};
use ewa_splat::{ColumnImage, ColumnSettings, Renderer};
use glam::{DMat3, DVec3};

fn slice(
    volume: PointVolume,
    camera: &Camera,
    through: DVec3,
    settings: ColumnSettings,
) -> ColumnImage {
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let settings = ColumnSettings {
        slice: Some(through),
        ..settings
    };
    renderer.column_density(camera, &settings).unwrap().clone()
}

/// Returns the world's points at the pixels' centres on the plane at a coordinate along an axis.
fn points(along: Along, window: &Window, size: [usize; 2], at: f64) -> Vec<DVec3> {
    let [right, up] = along.picture_axes();
    // The coordinates across fall to the right in a picture from behind.
    let [mut left, mut end] = window.across;
    if right.min_element() < 0.0 {
        std::mem::swap(&mut left, &mut end);
    }
    let [low, high] = window.upwards;
    let part = |i: usize, count: usize| (i as f64 + 0.5) / count as f64;
    let pixel = |n: usize| {
        let [x, y] = [n % size[0], n / size[0]];
        right.abs() * (left + (end - left) * part(x, size[0]))
            + up * (high - (high - low) * part(y, size[1]))
            + along.axis() * at
    };
    (0..size[0] * size[1]).map(pixel).collect()
}

/// f32 standard deviations and offsets from blocks' origins: 1e-6 of the peak.
const TOLERANCE: f64 = 2e-6;

/// Gaussians end at the cut-off of columns, exp(-5.5²/2) of their peak.
const CUT: f64 = 3e-7;

/// - `peak`: the greatest peak of a kernel.
fn check(image: &ColumnImage, truth: &[f64], peak: f64, what: &str) {
    let greatest = truth.iter().copied().fold(0.0, f64::max);
    assert!(greatest > 0.0, "{what}: nothing there");
    for (value, truth) in image.values.iter().zip(truth) {
        let error = (f64::from(*value) - truth).abs();
        assert!(
            error <= TOLERANCE * greatest + CUT * peak,
            "{what}: {value} for {truth} of {greatest}"
        );
    }
}

#[test]
fn slices_are_sums_of_kernels_at_pixels() {
    let mut random = Random::new(31);
    let count = 300;
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(1.0)).collect();
    let sigmas: Vec<f32> = positions
        .iter()
        .map(|_| random.log_range(0.004, 0.2) as f32)
        .collect();
    let weights: Vec<f32> = positions
        .iter()
        .map(|_| random.range(-0.5, 1.5) as f32)
        .collect();
    let window = Window {
        across: [-0.8, 0.9],
        upwards: [-0.5, 0.7],
    };
    let size = [40, 33];
    for (name, at) in [("z", 0.1), ("-z", -0.3), ("x", 0.0), ("-y", 0.45)] {
        let along = Along::of_name(name).unwrap();
        let camera = along.camera(&window, &[(DVec3::ZERO, DVec3::ONE)], size);
        let pixels = points(along, &window, size, at);
        for kernel in KERNELS.map(Some).into_iter().chain([None]) {
            let volume = masses(spheres(positions.clone(), sigmas.clone()), weights.clone());
            let settings = ColumnSettings {
                smoothing: kernel,
                ..ColumnSettings::default()
            };
            let image = slice(volume, &camera, along.axis() * at, settings);
            let profile = |u: f64| match kernel {
                Some(kernel) => definition(kernel, u).0,
                None => (-u * u / 2.0).exp(),
            };
            // The radius of a kernel's profile over its standard deviation, and the profile's mass.
            let (reach, end) = match kernel {
                Some(kernel) => (1.0 / definition(kernel, 0.0).1.sqrt(), 1.0),
                None => (1.0, 8.0),
            };
            let steps = 4000;
            let ring = |i: i32| {
                let u = (f64::from(i) + 0.5) * end / f64::from(steps);
                2.0 * std::f64::consts::TAU * u * u * profile(u) * end / f64::from(steps)
            };
            let mass: f64 = (0..steps).map(ring).sum();
            let sum = |pixel: &DVec3| {
                let of = |i: usize| {
                    let length = reach * f64::from(sigmas[i]);
                    let u = positions[i].distance(*pixel) / length;
                    f64::from(weights[i]) * profile(u) / (mass * length.powi(3))
                };
                (0..count).map(of).sum::<f64>()
            };
            let truth: Vec<f64> = pixels.iter().map(sum).collect();
            check(&image, &truth, 0.0, &format!("{kernel:?} along {name}"));
        }
    }
}

#[test]
fn slices_of_ellipsoids_are_sums_of_their_gaussians() {
    let mut random = Random::new(32);
    let count = 200;
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(1.0)).collect();
    let variances: Vec<DMat3> = positions
        .iter()
        .map(|_| {
            let size = random.log_range(0.02, 0.2);
            let factor = random.factor(size, 20.0);
            factor * factor.transpose()
        })
        .collect();
    let volume = PointVolume::ellipsoids(positions.clone(), &variances)
        .unwrap()
        .with_masses(vec![1.0; count]);
    let window = Window {
        across: [-1.0, 1.0],
        upwards: [-1.0, 1.0],
    };
    let along = Along::of_name("-x").unwrap();
    let camera = along.camera(&window, &[(DVec3::ZERO, DVec3::ONE)], [32, 32]);
    let image = slice(volume, &camera, DVec3::X * 0.2, ColumnSettings::default());
    let sum = |pixel: &DVec3| {
        let of = |i: usize| {
            let offset = *pixel - positions[i];
            let m_squared = offset.dot(variances[i].inverse() * offset);
            let volume = (std::f64::consts::TAU.powi(3) * variances[i].determinant()).sqrt();
            (-m_squared / 2.0).exp() / volume
        };
        (0..count).map(of).sum::<f64>()
    };
    let pixels = points(along, &window, [32, 32], 0.2);
    let truth: Vec<f64> = pixels.iter().map(sum).collect();
    let peak =
        |variance: &DMat3| 1.0 / (std::f64::consts::TAU.powi(3) * variance.determinant()).sqrt();
    let peak = variances.iter().map(peak).fold(0.0, f64::max);
    check(&image, &truth, peak, "ellipsoids");
}

/// Columns are integrals of slices. Midpoints .1 apart sum smooth kernels of a pixel and more to far less than the
/// tolerance; columns are means over pixels, which centres of slices are within 1/24 of the Laplacian only.
#[test]
fn slices_add_up_to_columns() {
    let mut random = Random::new(33);
    let positions: Vec<DVec3> = (0..30).map(|_| random.point(6.0)).collect();
    let volume = masses(spheres(positions, vec![6.0; 30]), vec![1.0; 30]);
    let camera = orthographic(48);
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    for smoothing in [None, Some(KERNELS[0])] {
        let settings = ColumnSettings {
            smoothing,
            ..ColumnSettings::default()
        };
        let column = renderer.column_density(&camera, &settings).unwrap().clone();
        let mut sum = vec![0.0; column.values.len()];
        for i in -200..200 {
            let through = DVec3::Z * 0.2 * (f64::from(i) + 0.5);
            let settings = ColumnSettings {
                slice: Some(through),
                ..settings.clone()
            };
            let slice = renderer.column_density(&camera, &settings).unwrap();
            for (sum, value) in sum.iter_mut().zip(&slice.values) {
                *sum += 0.2 * f64::from(*value);
            }
        }
        let greatest = f64::from(column.range().unwrap()[1]);
        for (sum, value) in sum.iter().zip(&column.values) {
            let error = (sum - f64::from(*value)).abs();
            assert!(error < 3e-3 * greatest, "{sum} {value} of {greatest}");
        }
    }
}

/// A uniform field in a box stays uniform up to the faces, and ends there.
#[test]
fn slices_of_lattices_end_at_sharp_boundaries() {
    let particles = Particles::Lattice {
        lattice: Lattice::uniform([16; 3], DVec3::ZERO, DVec3::ONE),
        kernel_width: 0.7,
    };
    let mut volume = classified(particles, Vec::new(), Values::F32(vec![2.0; 16 * 16 * 16]));
    volume.boundary = Some(Boundary::Lattice);
    let window = Window {
        across: [-5.0, 20.0],
        upwards: [-5.0, 20.0],
    };
    let camera = Along::Z.camera(&window, &[(DVec3::ZERO, DVec3::splat(15.0))], [100, 100]);
    for (at, is_there) in [(7.3, true), (0.1, true), (-0.1, false)] {
        let settings = ColumnSettings::default();
        let image = slice(volume.clone(), &camera, DVec3::Z * at, settings);
        for (pixel, value) in points(Along::Z, &window, [100, 100], at)
            .iter()
            .zip(&image.values)
        {
            let is_inside = |x: f64| (0.0..=15.0).contains(&x);
            let is_inside = is_there && is_inside(pixel.x) && is_inside(pixel.y);
            // One layer of ghosts leaves .6 % out beside a face, 1.8 % beside a corner.
            let error = (value - if is_inside { 2.0 } else { 0.0 }).abs();
            assert!(error < 0.04, "{pixel}: {value}");
        }
    }
}

/// A point of the plane is inside all clip planes, or shows nothing.
#[test]
fn slices_end_at_clip_planes() {
    let volume = masses(spheres(vec![DVec3::ZERO], vec![4.0]), vec![1.0]);
    let camera = orthographic(16);
    let plane = ClipPlane {
        normal: DVec3::new(1.0, 0.0, 1.0),
        distance: 0.2,
    };
    let at = DVec3::Z * 1.5;
    let whole = slice(volume.clone(), &camera, at, ColumnSettings::default());
    let settings = ColumnSettings {
        clip: vec![plane],
        ..ColumnSettings::default()
    };
    let cut = slice(volume, &camera, at, settings);
    for (n, (cut, whole)) in cut.values.iter().zip(&whole.values).enumerate() {
        // The camera's axes are the world's.
        let x = (n % 16) as f64 + 0.5 - 8.0;
        let expected = if x + 1.5 + 0.2 >= 0.0 { *whole } else { 0.0 };
        assert_eq!(cut.to_bits(), expected.to_bits(), "{x}");
        assert!(*whole > 0.0);
    }
}

#[test]
fn kernels_between_pixels_are_counted_and_what_has_no_slice_is_refused() {
    let ball = || masses(spheres(vec![DVec3::ZERO], vec![0.01]), vec![1.0]);
    let camera = orthographic(8);
    let mut renderer = Renderer::new(vec![ball()]).unwrap();
    let at = |through: DVec3| ColumnSettings {
        slice: Some(through),
        ..ColumnSettings::default()
    };
    renderer.column_density(&camera, &at(DVec3::ZERO)).unwrap();
    assert_eq!(
        (renderer.counts().footprints, renderer.counts().narrow),
        (1, 1)
    );
    renderer.column_density(&camera, &at(DVec3::Z)).unwrap();
    assert_eq!(renderer.counts().footprints, 0);
    assert!(renderer.column_density(&camera, &at(DVec3::NAN)).is_err());
    let near = Camera::perspective(DVec3::Z * 5.0, DVec3::ZERO, DVec3::Y, 40.0, [8, 8]);
    assert!(renderer.column_density(&near, &at(DVec3::ZERO)).is_err());
    let disc = [[0.25, 0.0, 0.0, 0.25, 0.0, 0.0]];
    let disc = PointVolume::ellipsoids([DVec3::ZERO], &disc).unwrap();
    let mut renderer = Renderer::new(vec![disc.with_masses([1.0])]).unwrap();
    let refused = renderer.column_density(&camera, &at(DVec3::ZERO));
    assert!(refused.unwrap_err().to_string().contains("thickness"));
    assert!(renderer.column_density(&camera, &at(DVec3::Z)).is_ok());
}
