//! Runs the cases of `fixtures/analytic_cases.json` that need no reference integrator, and the
//! layers of `fixtures/extreme_cases.json`, through the whole renderer.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::scene::{self, Particle};
use crate::common::{Random, fixture, number, numbers};
use ewa_splat::Filter;
use ewa_splat::render::Advanced;
use ewa_splat::scene::{Lattice, Particles, PointVolume, Strength};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Renderer, Settings};
use glam::{DMat3, DVec2, DVec3};
use serde_json::Value;

/// Returns the case of that name.
fn case(name: &str) -> Value {
    let all = fixture("analytic_cases.json");
    let found = all
        .as_array()
        .unwrap()
        .iter()
        .find(|c| c["name"] == name)
        .cloned();
    found.unwrap_or_else(|| panic!("no case {name}"))
}

/// Returns tau at the one pixel of an image, from opacity: -ln(1 - alpha). Its rounding grows as
/// exp(tau), which is below 3 in these tests.
fn depth(image: &ewa_splat::Image) -> f64 {
    -(-f64::from(image.pixel(0, 0)[3])).ln_1p()
}

/// Returns a perspective camera of one pixel at the origin, focal length `focal`, that looks along
/// `forward`.
fn one_pixel(focal: f64, forward: DVec3) -> Camera {
    let mut camera = Camera::perspective(DVec3::ZERO, forward, DVec3::Y, 90.0, [1, 1]);
    camera.focal_px = DVec2::splat(focal);
    camera
}

/// Returns settings without low-pass filter, with kernels out to seven standard deviations.
fn bare() -> Settings {
    Settings {
        low_pass_variance_px2: 0.0,
        cutoff: Some(7.0),
        ..Settings::default()
    }
}

#[test]
fn a_sphere_under_perspective() {
    let exact_case = case("sphere_perspective_exact");
    let sigma = number(&exact_case, "/input/sigma");
    let distance = number(&exact_case, "/input/distance");
    let g = number(&exact_case, "/input/g");
    let angles = numbers(&exact_case, "/input/angles_rad");
    let expected = numbers(&exact_case, "/expected/tau");
    let mut random = Random::new(1);
    let mut worst = 0.0_f64;
    for (&angle, expected) in angles.iter().zip(expected) {
        // The ray is the camera's axis, and the sphere lies `angle` beside it. Then the same scene
        // is seen by cameras turned away from both, whose one pixel is moved onto the ray.
        for turn in 0..8 {
            let world = random.rotation();
            let ray = world * DVec3::Z;
            let towards = world * DVec3::new(angle.sin(), 0.0, angle.cos());
            let off_axis = f64::from(turn) * 0.15;
            let axis = world * DVec3::new(0.0, off_axis.sin(), off_axis.cos());
            let mut camera = one_pixel(300.0, axis);
            let u = camera.camera_from_world * ray;
            camera.centre_px = DVec2::splat(0.5) - camera.focal_px * u.truncate() / u.z;
            let particle = Particle::sphere(towards * distance, sigma, g);
            for filter in [Filter::Exact, Filter::Adaptive] {
                let settings = Settings {
                    filter,
                    tolerance: 1e-6,
                    ..bare()
                };
                let image = scene::render(vec![scene::volume(&[particle])], &camera, &settings);
                let error = (depth(&image) - expected).abs();
                worst = worst.max(error);
                // The path errs by 6e-6 of the peak .64. A pixel coordinate near 500 px is rounded
                // to 3e-5 px; over a standard deviation of 15 px at a slope of .6, that is 8e-7.
                assert!(error < 5e-6, "{angle} rad, {filter:?}: error {error:e}");
            }
        }
    }
    println!("sphere, exact: worst error {worst:.2e}");
}

#[test]
fn a_sphere_under_the_affine_approximation() {
    let case = case("sphere_perspective_ewa");
    let sphere = Particle::sphere(
        DVec3::Z * number(&case, "/input/depth"),
        number(&case, "/input/sigma"),
        number(&case, "/input/g"),
    );
    let tangents = numbers(&case, "/input/tan_angle");
    for (tangent, expected) in tangents.into_iter().zip(numbers(&case, "/expected/tau")) {
        let mut camera = one_pixel(300.0, DVec3::Z);
        camera.centre_px = DVec2::new(0.5 - 300.0 * tangent, 0.5);
        let settings = Settings {
            filter: Filter::Ewa,
            ..bare()
        };
        let image = scene::render(vec![scene::volume(&[sphere])], &camera, &settings);
        let error = (depth(&image) - expected).abs();
        // Sixteen roundings of a depth below 1.
        assert!(error < 2e-6, "tan {tangent}: error {error:e}");
    }
}

#[test]
fn an_orthographic_sphere_with_low_pass() {
    let case = case("ortho_lowpass");
    let focal = number(&case, "/input/px_per_unit");
    let (g, sigma) = (number(&case, "/input/g"), number(&case, "/input/sigma"));
    let sphere = Particle::sphere(DVec3::Z * 5.0, sigma, g);
    let mut camera = scene::camera(Projection::Orthographic, [focal; 2], [33, 33]);
    // The centre of pixel (16, 16), exactly.
    camera.centre_px = DVec2::splat(16.5);
    let settings = Settings {
        low_pass_variance_px2: number(&case, "/input/h2") as f32,
        ..scene::linear()
    };
    let image = scene::render(vec![scene::volume(&[sphere])], &camera, &settings);
    let offsets = numbers(&case, "/input/offset_px");
    for (offset, expected) in offsets.into_iter().zip(numbers(&case, "/expected/tau")) {
        for (dx, dy) in [(offset, 0.0), (-offset, 0.0), (0.0, offset)] {
            let (x, y) = ((16.0 + dx) as usize, (16.0 + dy) as usize);
            let error = (f64::from(image.pixel(x, y)[3]) - expected).abs();
            // Sixteen roundings of a depth below 1.
            assert!(error < 1e-6, "({dx}, {dy}): error {error:e}");
        }
    }
    let sum = scene::alpha_sum(&image);
    let expected = number(&case, "/expected/pixel_sum");
    // 1e-6 of each pixel's part; the square of 33 px extends to 7 standard deviations, so it loses
    // nothing.
    assert!((sum - expected).abs() < 2e-6 * expected, "pixel sum {sum}");
}

#[test]
fn a_lattice_slab() {
    let case = case("lattice_slab_ortho");
    let layers = number(&case, "/input/layers") as usize;
    let spacing = number(&case, "/input/spacing");
    let dims = [13, 13, layers];
    let lattice = Lattice::uniform(dims, DVec3::new(-6.0, -6.0, 5.0) * spacing, DVec3::ONE);
    let volume = PointVolume::new(
        Particles::Lattice {
            lattice,
            kernel_width: number(&case, "/input/rho"),
        },
        Strength::Mass(vec![
            number(&case, "/input/g") as f32;
            dims.iter().product()
        ]),
    );
    let points = case["input"]["points"].as_array().unwrap();
    let expected = numbers(&case, "/expected/tau");
    let mut renderer = Renderer::new(vec![volume.clone()]).unwrap();
    for (i, (point, expected)) in points.iter().zip(expected).enumerate() {
        let at = numbers(point, "");
        let mut camera = scene::camera(Projection::Orthographic, [40.0; 2], [1, 1]);
        camera.centre_px = DVec2::splat(0.5) - 40.0 * DVec2::new(at[0], at[1]);
        #[cfg(feature = "gpu")]
        crate::common::gpu::hold_sampled(&volume, &camera, &bare());
        renderer.render(&camera, &bare()).unwrap();
        let error = (depth(renderer.image()) - expected).abs();
        // Each of ten layers rounds its opacity, times exp(1).
        assert!(error < 3e-6, "point {i}: error {error:e}");
    }
    // The mean over one cell.
    let camera = scene::camera(Projection::Orthographic, [40.0; 2], [40, 40]);
    #[cfg(feature = "gpu")]
    crate::common::gpu::hold_sampled(&volume, &camera, &bare());
    let image = renderer.render(&camera, &bare()).unwrap();
    let sum: f64 = image
        .pixels
        .iter()
        .map(|p| -(-f64::from(p[3])).ln_1p())
        .sum();
    let mean = sum / image.pixels.len() as f64;
    let expected = number(&case, "/expected/tau_mean");
    assert!((mean - expected).abs() < 3e-6, "mean {mean}");
}

/// Returns kernels whose centres lie on the ray of the one pixel of an orthographic camera, with
/// the given optical depths.
fn column(parts: &[(f64, f64, [f32; 3])]) -> (Vec<Particle>, Camera) {
    let camera = scene::camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    // The kernel's variance is 1 px²: tau = g / (2 pi) without low-pass filter.
    let particle = |&(z, tau, colour): &(f64, f64, [f32; 3])| {
        let g = std::f64::consts::TAU * tau;
        Particle::sphere(DVec3::Z * z, 1.0, g).coloured(colour)
    };
    (parts.iter().map(particle).collect(), camera)
}

#[test]
fn constant_colour_in_any_order_and_split() {
    let case = case("homogeneous_constant_colour");
    let colour = number(&case, "/input/color") as f32;
    let totals = numbers(&case, "/input/tau_total");
    let mut random = Random::new(2);
    let mut worst = 0.0_f64;
    for (total, expected) in totals.into_iter().zip(numbers(&case, "/expected/I")) {
        for count in [1, 2, 7, 100, 3_000] {
            // Random fractions at random depths, many of which overlap.
            let shares: Vec<f64> = (0..count).map(|_| random.range(0.1, 1.0)).collect();
            let sum: f64 = shares.iter().sum();
            let parts: Vec<_> = shares
                .iter()
                .map(|s| (random.range(10.0, 50.0), total * s / sum, [colour; 3]))
                .collect();
            let (particles, camera) = column(&parts);
            let image = scene::render(vec![scene::volume(&particles)], &camera, &bare());
            let error = (f64::from(image.pixel(0, 0)[1]) - expected).abs();
            worst = worst.max(error);
            // Each layer rounds the accumulated opacity, a random walk of sqrt(n): 3e-8 times 55.
            // Besides, the tile may stop at a sixteenth of the tolerance below opaque.
            let stop = if total > 4.0 {
                f64::from(Settings::default().tolerance) / 16.0
            } else {
                0.0
            };
            assert!(
                error < 4e-6 + stop,
                "tau {total} in {count}: error {error:e}"
            );
        }
    }
    println!("constant colour, up to 3,000 kernels: worst error {worst:.2e}");
}

#[test]
fn two_separated_kernels_and_two_coincident_ones() {
    let near = case("two_separated_over");
    let tau = numbers(&near, "/input/tau");
    let colours = numbers(&near, "/input/colors")
        .iter()
        .map(|&c| c as f32)
        .collect::<Vec<_>>();
    let intensity = |parts: &[(f64, f64, [f32; 3])]| {
        let (particles, camera) = column(parts);
        let image = scene::render(vec![scene::volume(&particles)], &camera, &bare());
        f64::from(image.pixel(0, 0)[0])
    };
    // Three roundings of each of two layers.
    let allowed = 6e-7;
    let parts = [
        (10.0, tau[0], [colours[0]; 3]),
        (40.0, tau[1], [colours[1]; 3]),
    ];
    let got = intensity(&parts);
    assert!(
        (got - number(&near, "/expected/I")).abs() < allowed,
        "{got}"
    );
    let swapped = [
        (40.0, tau[0], [colours[0]; 3]),
        (10.0, tau[1], [colours[1]; 3]),
    ];
    let got = intensity(&swapped);
    assert!(
        (got - number(&near, "/expected/I_swapped")).abs() < allowed,
        "{got}"
    );
    // The order of the input has no effect.
    assert_eq!(intensity(&parts), intensity(&[parts[1], parts[0]]));

    let same = case("two_coincident");
    let tau = numbers(&same, "/input/tau");
    let colours = numbers(&same, "/input/colors")
        .iter()
        .map(|&c| c as f32)
        .collect::<Vec<_>>();
    // The depths differ slightly, either way.
    for (hair, name) in [
        (-1e-3, "/expected/I_sorted_first"),
        (1e-3, "/expected/I_sorted_last"),
    ] {
        let got = intensity(&[
            (20.0 + hair, tau[0], [colours[0]; 3]),
            (20.0, tau[1], [colours[1]; 3]),
        ]);
        assert!((got - number(&same, name)).abs() < allowed, "{name}: {got}");
    }
    // At equal depth, the order of the input decides which is in front.
    let got = intensity(&[
        (20.0, tau[0], [colours[0]; 3]),
        (20.0, tau[1], [colours[1]; 3]),
    ]);
    assert!(
        (got - number(&same, "/expected/I_sorted_first")).abs() < allowed,
        "{got}"
    );
}

#[test]
fn mass_under_zoom() {
    let case = case("mass_under_zoom");
    let u = DVec3::from_slice(&numbers(&case, "/input/u"));
    let sphere = Particle::sphere(u, number(&case, "/input/sigma"), number(&case, "/input/g"));
    let expected = number(&case, "/expected/pixel_sum_over_fxfy");
    for focal in numbers(&case, "/input/fx") {
        let mut camera = scene::camera(Projection::Perspective, [focal; 2], [192, 192]);
        // The image around the kernel extends to seven standard deviations, of at most 10.1 px.
        camera.centre_px = DVec2::splat(96.3) - focal * u.truncate() / u.z;
        let settings = Settings {
            low_pass_variance_px2: number(&case, "/input/h2") as f32,
            filter: Filter::Ewa,
            ..scene::linear()
        };
        // tau grows as the square of the focal length. It is kept below 1, where the opacity is
        // nearly linear.
        let share = (1e3 / (focal * focal)).min(1.0);
        let mass = (f64::from(sphere.mass) * share) as f32;
        let particle = Particle { mass, ..sphere };
        let image = scene::render(vec![scene::volume(&[particle])], &camera, &settings);
        let share = f64::from(mass) / number(&case, "/input/g");
        let sum = scene::alpha_sum(&image) / (focal * focal * share);
        // exp errs by 4e-7, with one sign, and the amplitude by some eight roundings.
        let error = (sum / expected - 1.0).abs();
        assert!(error < 1.5e-6, "fx {focal}: {sum:e}, error {error:e}");
    }
}

#[test]
fn an_eye_at_the_centre() {
    let case = case("eye_at_centre");
    let sphere = Particle::sphere(
        DVec3::ZERO,
        number(&case, "/input/sigma"),
        number(&case, "/input/g"),
    );
    let expected = number(&case, "/expected/tau_any_direction");
    let mut random = Random::new(3);
    for filter in Filter::ALL {
        let camera = one_pixel(100.0, random.point(1.0));
        let settings = Settings { filter, ..bare() };
        let image = scene::render(vec![scene::volume(&[sphere])], &camera, &settings);
        let error = (depth(&image) - expected).abs();
        // Sixteen roundings of a depth below 1.
        assert!(error < 1e-6, "{filter:?}: error {error:e}");
    }
    // The same holds at every pixel of a wide image.
    let camera = Camera::perspective(DVec3::ZERO, DVec3::X, DVec3::Z, 120.0, [48, 40]);
    let image = scene::render(vec![scene::volume(&[sphere])], &camera, &bare());
    for pixel in &image.pixels {
        let error = (-(-f64::from(pixel[3])).ln_1p() - expected).abs();
        assert!(error < 1e-6, "error {error:e}");
    }
}

#[test]
fn a_tilted_sheet_is_denser() {
    // Flat kernels (rank 2) of a square lattice in a plane, tilted against the ray.
    let case = case("tilted_sheet_density");
    let density = number(&case, "/input/areal_density");
    let (spacing, rho, half) = (0.1, 0.6, 30);
    let tilts = numbers(&case, "/input/tilt_deg");
    for (tilt, expected) in tilts.into_iter().zip(numbers(&case, "/expected/tau")) {
        let turn = DMat3::from_rotation_x(tilt.to_radians());
        let particles: Vec<Particle> = (-half..=half)
            .flat_map(|i| (-half..=half).map(move |j| (f64::from(i), f64::from(j))))
            .map(|(i, j)| Particle {
                position: DVec3::Z * 40.0 + turn * DVec3::new(i, j, 0.0) * spacing,
                factor: turn * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0) * rho * spacing),
                mass: (density * spacing * spacing) as f32,
                colour: [1.0; 3],
            })
            .collect();
        let sheet = scene::volume(&particles);
        let mut renderer = Renderer::new(vec![sheet.clone()]).unwrap();
        // The mean over one cell of the lattice as seen has no ripple. The low-pass filter of 1.2
        // px and the cell are both far narrower than the sheet.
        let focal = [100.0, 100.0 / tilt.to_radians().cos()];
        let mut camera = scene::camera(Projection::Orthographic, focal, [10, 10]);
        camera.eye = DVec3::ZERO;
        #[cfg(feature = "gpu")]
        crate::common::gpu::hold_sampled(&sheet, &camera, &bare());
        let image = renderer.render(&camera, &bare()).unwrap();
        let mean: f64 = image
            .pixels
            .iter()
            .map(|p| -(-f64::from(p[3])).ln_1p())
            .sum::<f64>()
            / image.pixels.len() as f64;
        // Some fifty layers each round. The footprint of a flat kernel at 80 degrees loses a factor
        // cos 80 = .17 to the rounding of its rows. exp(2.9) times 3e-7.
        let error = (mean / expected - 1.0).abs();
        assert!(error < 1e-5, "{tilt} degrees: {mean} for {expected}");
    }
}

#[test]
fn a_minified_thick_kernel_is_too_opaque() {
    // EWA filters tau, not opacity, as published; our value is EWA's.
    let case = case("minified_thick_kernel");
    let (share, tau0) = (
        number(&case, "/input/lambda_over_h2"),
        number(&case, "/input/tau0"),
    );
    // The footprint's variance is `share` px² before the filter's 1 px².
    let sigma = share.sqrt();
    let sphere = Particle::sphere(DVec3::Z * 5.0, sigma, std::f64::consts::TAU * share * tau0);
    let camera = scene::camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    let settings = Settings {
        cutoff: Some(7.0),
        ..Settings::default()
    };
    let image = scene::render(vec![scene::volume(&[sphere])], &camera, &settings);
    let alpha = f64::from(image.pixel(0, 0)[3]);
    // Ten roundings.
    assert!(
        (alpha - number(&case, "/expected/alpha_ewa")).abs() < 1e-7,
        "{alpha}"
    );
    let truth = number(&case, "/expected/alpha_true");
    assert!(alpha > 3.0 * truth);

    // As a lone kernel, it has the true opacity, to within 6e-5 of its quadrature.
    let settings = Settings {
        advanced: Advanced {
            sub_pixel_opacity: true,
            ..settings.advanced
        },
        level_of_detail: false,
        ..settings
    };
    let image = scene::render(vec![scene::volume(&[sphere])], &camera, &settings);
    let alpha = f64::from(image.pixel(0, 0)[3]);
    assert!((alpha / truth - 1.0).abs() < 6e-5, "{alpha}");
}

#[test]
fn many_faint_layers() {
    let all = fixture("extreme_cases.json");
    let cases = all["cases"].as_array().unwrap();
    let mut tested = 0;
    for case in cases
        .iter()
        .filter(|c| c["kind"] == "composite_equal_layers")
    {
        tested += 1;
        let layers = number(case, "/input/layers") as usize;
        let tau = number(case, "/input/tau");
        let colour = number(case, "/input/color") as f32;
        let parts: Vec<_> = (0..layers)
            .map(|i| (10.0 + 30.0 * i as f64 / layers as f64, tau, [colour; 3]))
            .collect();
        let (particles, camera) = column(&parts);
        let image = scene::render(vec![scene::volume(&particles)], &camera, &bare());
        let got = f64::from(image.pixel(0, 0)[0]);
        let expected = number(case, "/expected/intensity");
        let error = (got - expected).abs();
        println!("{}: intensity {got:e}, error {error:.1e}", case["name"]);
        // Each layer adds half a unit in the last place of 0.5, 3e-8, as a random walk: 1e-5 for
        // 1e5 layers. A single colour rounds with the opacity, too. The roundings of equal layers
        // need not be random; the measured error is printed.
        let allowed = (3e-8 * (layers as f64).sqrt()).max(1e-7 * expected);
        assert!(error <= allowed, "{}: error {error:e}", case["name"]);
    }
    assert_eq!(tested, 5);
}
