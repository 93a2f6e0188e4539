//! Tests the reference integrator against closed forms, published digits, a brute-force march and a
//! brute-force pixel filter.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;

use crate::common::scene::{self, Particle};
use crate::common::{Random, fixture, number, numbers, some};
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceFrame, ReferenceSettings};
use ewa_splat::scene::{Colour, Lattice, Particles, PointVolume, Strength};
use ewa_splat::view::{Camera, ClipPlane, Projection};
use glam::{DMat3, DVec2, DVec3};
use serde_json::Value;

/// Tolerance for the published digits.
const DIGITS: f64 = 1e-9;

fn analytic(name: &str) -> Value {
    let all = fixture("analytic_cases.json");
    let found = all.as_array().unwrap().iter().find(|c| c["name"] == name);
    found.cloned().unwrap_or_else(|| panic!("no case {name}"))
}

fn extreme(kind: &str) -> Vec<Value> {
    let all = fixture("extreme_cases.json");
    let cases = all["cases"].as_array().unwrap().iter();
    let found: Vec<_> = cases.filter(|c| c["kind"] == kind).cloned().collect();
    assert!(!found.is_empty(), "no case of {kind}");
    found
}

/// Returns a width near `near` and a mass, both f32, with mass / (2 pi width²) = `tau` to 1e-11. A
/// scene stores f32, and a mass alone would round the depth by 3e-8.
fn width_and_mass(tau: f64, near: f32) -> (f64, f32) {
    let mut best = (f64::INFINITY, 0.0, 0.0_f32);
    let mut width = near;
    for _ in 0..200_000 {
        width = width.next_up();
        let area = TAU * f64::from(width).powi(2);
        let mass = (tau * area) as f32;
        let error = (f64::from(mass) / (area * tau) - 1.0).abs();
        if error < best.0 {
            best = (error, f64::from(width), mass);
        }
    }
    assert!(best.0 < 1e-11, "{}", best.0);
    (best.1, best.2)
}

/// Returns a kernel of depth `tau` on the optical axis of an orthographic camera.
fn on_axis(tau: f64, mean: f64, sigma: f64, colour: f32) -> Particle {
    let (width, mass) = width_and_mass(tau, 1.0);
    Particle {
        position: DVec3::Z * mean,
        factor: DMat3::from_diagonal(DVec3::new(width, width, sigma)),
        mass,
        colour: [colour; 3],
    }
}

fn integrator(particles: &[Particle]) -> Integrator {
    Integrator::new(&[scene::volume(particles)]).unwrap()
}

/// Returns red and opacity on the axis of an orthographic camera at the origin, unfiltered.
fn along_axis(particles: &[Particle]) -> [f64; 2] {
    let camera = scene::camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    let ray = integrator(particles).ray(&camera, camera.centre_px, 1e-12);
    [ray.rgba[0], ray.rgba[3]]
}

fn close(name: &str, got: f64, expected: f64, allowed: f64) {
    let error = (got - expected).abs();
    println!("{name}: {got:.15e}, error {error:.1e}");
    assert!(error <= allowed, "{name}: {got} for {expected}");
}

/// Returns -ln(1 - opacity).
fn depth(opacity: f64) -> f64 {
    -(-opacity).ln_1p()
}

#[test]
fn a_sphere_under_perspective() {
    let case = analytic("sphere_perspective_exact");
    let angles = numbers(&case, "/input/angles_rad");
    let sphere = [Particle::sphere(DVec3::Z * 10.0, 0.5, 1.0)];
    for turn in [0.0, 0.7, 1.3] {
        // The value is the same wherever in the image the kernel lies.
        let mut camera = scene::camera(Projection::Perspective, [100.0; 2], [1, 1]);
        camera.camera_from_world = DMat3::from_rotation_y(turn);
        for (angle, tau) in angles.iter().zip(numbers(&case, "/expected/tau")) {
            let slope = (turn + angle).tan();
            let px = camera.centre_px + DVec2::new(100.0 * slope, 0.0);
            let ray = integrator(&sphere).ray(&camera, px, 1e-12);
            close("sphere", depth(ray.rgba[3]), tau, 1e-12);
        }
    }
}

#[test]
fn an_orthographic_sphere_with_the_filter_on_kernels() {
    let case = analytic("ortho_lowpass");
    // sigma .1 is no f32, but 1 at a tenth of the scale is.
    let sphere = [Particle::sphere(DVec3::Z * 50.0, 1.0, 5.0)];
    let camera = scene::camera(Projection::Orthographic, [2.0; 2], [41, 41]);
    let settings = ReferenceSettings {
        error: 1e-12,
        pixel_filter: PixelFilter::Kernels,
        ..ReferenceSettings::default()
    };
    let frame = integrator(&sphere).render(&camera, &settings).unwrap();
    for (x, tau) in numbers(&case, "/input/offset_px")
        .iter()
        .zip(numbers(&case, "/expected/tau"))
    {
        let pixel = frame.pixels[20 * 41 + 20 + *x as usize];
        close("orthographic", depth(pixel[3]), tau, 1e-12);
    }
    let sum: f64 = frame.pixels.iter().map(|p| depth(p[3])).sum();
    close("sum", sum, number(&case, "/expected/pixel_sum"), 1e-8);
}

#[test]
fn a_lattice_slab() {
    let case = analytic("lattice_slab_ortho");
    let layers = number(&case, "/input/layers") as usize;
    let lattice = Lattice::uniform([31, 31, layers], DVec3::new(-15.0, -15.0, 30.0), DVec3::ONE);
    let count = lattice.len();
    let slab = |mass: f32| {
        PointVolume::new(
            Particles::Lattice {
                lattice: lattice.clone(),
                kernel_width: number(&case, "/input/rho"),
            },
            Strength::Mass(vec![mass; count]),
        )
    };
    let camera = scene::camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    let points = case.pointer("/input/points").unwrap().as_array().unwrap();
    // .1 is no f32, but depths are proportional.
    let mass = 0.1_f32;
    let scale = number(&case, "/input/g") / f64::from(mass);
    for (point, tau) in points.iter().zip(numbers(&case, "/expected/tau")) {
        let px = camera.centre_px + DVec2::new(number(point, "/0"), number(point, "/1"));
        let ray = Integrator::new(&[slab(mass)])
            .unwrap()
            .ray(&camera, px, 1e-12);
        close("slab", depth(ray.rgba[3]) * scale, tau, DIGITS);
    }
}

#[test]
fn constant_colour_in_any_order_and_split() {
    let case = analytic("homogeneous_constant_colour");
    let colour = 0.75;
    let factor = f64::from(colour) / number(&case, "/input/color");
    let expected = numbers(&case, "/expected/I");
    let mut random = Random::new(3);
    for (total, light) in numbers(&case, "/input/tau_total").iter().zip(expected) {
        for parts in [1, 2, 7, 40] {
            let (width, mass) = width_and_mass(total / f64::from(parts), 1.0);
            let particles: Vec<_> = (0..parts)
                .map(|_| Particle {
                    position: DVec3::Z * random.range(20.0, 30.0),
                    factor: DMat3::from_diagonal(DVec3::new(
                        width,
                        width,
                        f64::from(random.log_range(1e-3, 2.0) as f32),
                    )),
                    mass,
                    colour: [colour; 3],
                })
                .collect();
            let [red, _] = along_axis(&particles);
            close("constant colour", red, light * factor, 1e-11);
        }
    }
}

#[test]
fn two_kernels_apart_and_coincident() {
    let case = analytic("two_separated_over");
    let [t1, t2]: [f64; 2] = numbers(&case, "/input/tau").try_into().unwrap();
    let colours: [f64; 2] = numbers(&case, "/input/colors").try_into().unwrap();
    let [c1, c2] = colours.map(|c| c as f32);
    let apart = [on_axis(t1, 10.0, 0.5, c1), on_axis(t2, 20.0, 0.5, c2)];
    close(
        "apart",
        along_axis(&apart)[0],
        number(&case, "/expected/I"),
        1e-11,
    );
    let swapped = [on_axis(t1, 20.0, 0.5, c1), on_axis(t2, 10.0, 0.5, c2)];
    close(
        "swapped",
        along_axis(&swapped)[0],
        number(&case, "/expected/I_swapped"),
        1e-11,
    );

    let case = analytic("two_coincident");
    let together = [on_axis(t1, 10.0, 0.5, 1.0), on_axis(t2, 10.0, 0.5, 0.0)];
    close(
        "together",
        along_axis(&together)[0],
        number(&case, "/expected/I_exact"),
        1e-11,
    );
    // Coincident sheets mix in the same way: the limit of equally flattened kernels.
    let sheets = [on_axis(t1, 10.0, 0.0, 1.0), on_axis(t2, 10.0, 0.0, 0.0)];
    close(
        "sheets",
        along_axis(&sheets)[0],
        number(&case, "/expected/I_exact"),
        1e-11,
    );
}

#[test]
fn overlapping_pairs_of_the_extreme_cases() {
    for case in extreme("overlap_two_kernels") {
        let input = |key: &str| number(&case, &format!("/input/{key}"));
        // Lengths are multiplied by ten, so that .2 and .3 are exact in f32.
        let kernel = |i: usize, colour: f32| {
            let [tau, mean, sigma] = ["tau", "mu", "sigma"].map(|n| input(&format!("{n}{i}")));
            on_axis(tau, 10.0 * mean, (10.0 * sigma).round(), colour)
        };
        for (i, key) in [(1, "w1_exact"), (2, "w2_exact")] {
            let of = |k: usize| kernel(k, f32::from(u8::from(k == i)));
            let [weight, opacity] = along_axis(&[of(1), of(2)]);
            let name = format!("{} {key}", case["name"]);
            close(
                &name,
                weight,
                number(&case, &format!("/expected/{key}")),
                DIGITS,
            );
            close(
                "opacity",
                opacity,
                -(-input("tau1") - input("tau2")).exp_m1(),
                1e-11,
            );
        }
    }
}

#[test]
fn faint_and_dense_layers_of_the_extreme_cases() {
    for case in extreme("composite_equal_layers") {
        let layers = number(&case, "/input/layers") as u32;
        let (width, mass) = width_and_mass(number(&case, "/input/tau"), 1.0);
        let particles: Vec<_> = (0..layers)
            .map(|i| Particle {
                position: DVec3::Z * (10.0 + 30.0 * f64::from(i) / f64::from(layers)),
                factor: DMat3::from_diagonal(DVec3::new(width, width, 0.25)),
                mass,
                colour: [number(&case, "/input/color") as f32; 3],
            })
            .collect();
        let expected = number(&case, "/expected/intensity");
        let name = case["name"].as_str().unwrap();
        close(name, along_axis(&particles)[0], expected, DIGITS);
    }
}

#[test]
fn filtered_opacities_of_small_kernels() {
    for case in extreme("filtered_opacity_peak") {
        let (share, tau0) = (number(&case, "/input/a"), number(&case, "/input/tau0"));
        let (width, mass) = width_and_mass(tau0, 1.0);
        let sphere = [Particle::sphere(DVec3::Z * 20.0, width, f64::from(mass))];
        let focal = share.sqrt() / width;
        let camera = scene::camera(Projection::Orthographic, [focal; 2], [1, 1]);
        let settings = |pixel_filter| ReferenceSettings {
            // Convergence is so fast that one lattice more gives all digits.
            error: 1e-7,
            pixel_filter,
            max_rays_per_pixel: 1 << 20,
            ..ReferenceSettings::default()
        };
        let integrator = integrator(&sphere);
        let frame = integrator
            .render(&camera, &settings(PixelFilter::Image))
            .unwrap();
        let name = case["name"].as_str().unwrap();
        println!("{name}: {} rays", frame.rays);
        assert_eq!(frame.unconverged, 0, "{name}: {:e}", frame.error);
        close(
            name,
            frame.pixels[0][3],
            number(&case, "/expected/alpha_true"),
            DIGITS,
        );
        let frame = integrator
            .render(&camera, &settings(PixelFilter::Kernels))
            .unwrap();
        close(
            "as EWA",
            frame.pixels[0][3],
            number(&case, "/expected/alpha_ewa"),
            DIGITS,
        );
    }
}

#[test]
fn an_eye_at_the_centre() {
    let case = analytic("eye_at_centre");
    let sphere = [Particle::sphere(DVec3::ZERO, 0.5, 1.0)];
    let expected = number(&case, "/expected/tau_any_direction");
    for forward in [DVec3::Z, DVec3::new(1.0, -2.0, 0.5), -DVec3::X] {
        let camera = Camera::perspective(DVec3::ZERO, forward, DVec3::Y, 90.0, [8, 8]);
        for px in [camera.centre_px, DVec2::ZERO, DVec2::new(-300.0, 4.0)] {
            let ray = integrator(&sphere).ray(&camera, px, 1e-12);
            close("inside", depth(ray.rgba[3]), expected, 1e-12);
            // With one colour, the integral equals the closed form, from the eye on.
            close("its light", ray.rgba[0], ray.rgba[3], 1e-12);
        }
    }
}

#[test]
fn tilted_sheets() {
    let case = analytic("tilted_sheet_density");
    let angles = numbers(&case, "/input/tilt_deg");
    for (angle, tau) in angles.iter().zip(numbers(&case, "/expected/tau")) {
        // One flat kernel whose peak depth is the areal density: mass/(2 pi sigma²) = .5.
        let (width, mass) = width_and_mass(number(&case, "/input/areal_density"), 1.0);
        let tilt = DMat3::from_rotation_y(angle.to_radians());
        let sheet = Particle {
            position: DVec3::Z * 10.0,
            factor: tilt * DMat3::from_diagonal(DVec3::new(width, width, 0.0)),
            mass,
            colour: [1.0; 3],
        };
        // The tilt is rounded to f32: 6e-8, times tan(80 degrees)²/cos.
        close("sheet", depth(along_axis(&[sheet])[1]), tau, 2e-5);
    }
}

/// Returns a cloud of overlapping kernels in front of the camera at the origin.
fn cloud(seed: u64, count: usize) -> Vec<Particle> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| Particle {
            position: DVec3::Z * 6.0 + random.point(1.5),
            factor: {
                let largest = random.log_range(0.2, 0.8);
                random.factor(largest, 8.0)
            },
            mass: random.log_range(0.05, 1.0) as f32,
            colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect()
}

/// Integrates eq. 3 by the midpoint rule: density from the inverse variance, transmittance step by
/// step.
fn march(particles: &[Particle], direction: DVec3, steps: usize) -> [f64; 4] {
    let bodies: Vec<_> = particles
        .iter()
        .map(|p| {
            let [l00, l10, l11, l20, l21, l22] =
                crate::common::lower_factor(&p.factor).map(f64::from);
            let factor = DMat3::from_cols(
                DVec3::new(l00, l10, l20),
                DVec3::new(0.0, l11, l21),
                DVec3::new(0.0, 0.0, l22),
            );
            let peak = f64::from(p.mass) / (TAU.powf(1.5) * factor.determinant().abs());
            (p.position, factor.inverse(), peak, p.colour.map(f64::from))
        })
        .collect();
    let length = 16.0;
    let step = length / steps as f64;
    let (mut light, mut transmittance) = ([0.0; 3], 1.0);
    for i in 0..steps {
        let x = direction * ((i as f64 + 0.5) * step);
        let (mut extinction, mut emission) = (0.0, [0.0; 3]);
        for (centre, inverse, peak, colour) in &bodies {
            let q: f64 = (*inverse * (x - *centre)).length_squared();
            let e: f64 = peak * (-0.5 * q).exp();
            extinction += e;
            for (sum, c) in emission.iter_mut().zip(colour) {
                *sum += e * c;
            }
        }
        // The transmittance is also taken at the midpoint: second order.
        let through = (-extinction * step).exp();
        for (sum, e) in light.iter_mut().zip(emission) {
            *sum += transmittance * through.sqrt() * e * step;
        }
        transmittance *= through;
    }
    let [r, g, b] = light;
    [r, g, b, 1.0 - transmittance]
}

fn largest(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    (0..4).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max)
}

#[test]
fn a_brute_force_march_converges_to_it() {
    let camera = scene::camera(Projection::Perspective, [20.0; 2], [16, 16]);
    for seed in 0..4 {
        let particles = cloud(seed, 40);
        let integrator = integrator(&particles);
        for px in [
            DVec2::new(8.0, 8.0),
            DVec2::new(5.2, 9.7),
            DVec2::new(10.1, 4.4),
        ] {
            let truth = integrator.ray(&camera, px, 1e-11);
            assert!(truth.error < 1e-11, "{}", truth.error);
            let slope = (px - camera.centre_px) / camera.focal_px;
            let direction = slope.extend(1.0).normalize();
            let [coarse, fine] = [2000, 8000].map(|n| march(&particles, direction, n));
            let off = |image: [f64; 4]| largest(&image, &truth.rgba);
            // Second order: a quarter of the step has a sixteenth of the error. Without that error,
            // by Richardson's rule, the rest is of fourth order.
            let limit = [0, 1, 2, 3].map(|c| fine[c] + (fine[c] - coarse[c]) / 15.0);
            let errors = [off(coarse), off(fine), off(limit)];
            println!("seed {seed}, {px}: march off by {errors:?}");
            assert!(errors[1] < errors[0] / 15.0, "{errors:?}");
            assert!(errors[2] < DIGITS, "{errors:?}");
        }
    }
}

#[test]
fn a_stated_error_is_kept_along_rays() {
    let camera = scene::camera(Projection::Perspective, [20.0; 2], [16, 16]);
    let mut worst = 0.0_f64;
    for seed in 10..30 {
        let integrator = integrator(&cloud(seed, 60));
        for x in 0..8 {
            let px = DVec2::new(4.0 + f64::from(x), 7.3);
            let truth = integrator.ray(&camera, px, 1e-12);
            for error in [1e-3, 1e-6, 1e-9] {
                let ray = integrator.ray(&camera, px, error);
                let off = largest(&ray.rgba, &truth.rgba);
                assert!(
                    off <= error && ray.error <= error,
                    "{off:e} {:e} at {error:e}",
                    ray.error
                );
                worst = worst.max(off / error);
            }
        }
    }
    println!("largest error over the one asked for: {worst:.2e}");
}

fn filtered(integrator: &Integrator, camera: &Camera, h2: f64, error: f64) -> ReferenceFrame {
    let settings = ReferenceSettings {
        error,
        low_pass_variance_px2: h2,
        max_rays_per_pixel: 1 << 14,
        ..ReferenceSettings::default()
    };
    integrator.render(camera, &settings).unwrap()
}

/// Computes the filter as a plain sum over a fine square lattice, out to six standard deviations.
fn filtered_by_force(
    integrator: &Integrator,
    camera: &Camera,
    px: DVec2,
    h: f64,
    n: i32,
) -> [f64; 4] {
    let step = 6.0 * h / f64::from(n);
    let (mut sum, mut weights) = ([0.0; 4], 0.0);
    for i in -n..=n {
        for j in -n..=n {
            let offset = DVec2::new(f64::from(i), f64::from(j)) * step;
            let weight = (-0.5 * offset.length_squared() / (h * h)).exp();
            let ray = integrator.ray(camera, px + offset, 1e-8);
            for (s, v) in sum.iter_mut().zip(ray.rgba) {
                *s += weight * v;
            }
            weights += weight;
        }
    }
    sum.map(|s| s / weights)
}

#[test]
fn the_pixel_filter_is_a_gaussian_over_the_image() {
    // Small kernels of great depth give results far from those of filtered depths.
    let mut random = Random::new(77);
    let mut particles = cloud(5, 8);
    particles.extend((0..12).map(|_| Particle {
        position: DVec3::Z * 6.0 + random.point(1.5),
        factor: random.factor(0.15, 2.0),
        mass: 0.5,
        colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
    }));
    let integrator = integrator(&particles);
    let camera = scene::camera(Projection::Perspective, [12.0; 2], [9, 7]);
    for h2 in some([0.3, 4.0, 1.0], 2, 3) {
        let frame = filtered(&integrator, &camera, h2, 1e-6);
        assert_eq!(frame.unconverged, 0);
        for [x, y] in [[4, 3], [8, 5]] {
            let px = DVec2::new(x as f64, y as f64) + 0.5;
            let truth = filtered_by_force(
                &integrator,
                &camera,
                px,
                h2.sqrt(),
                (120.0 * h2.sqrt()) as i32,
            );
            let pixel = frame.pixels[y * 9 + x];
            let off = largest(&pixel, &truth);
            println!("h² {h2}, ({x}, {y}): off by {off:.1e}");
            // The stated error; the sum's own, beyond six standard deviations, is 1e-8.
            assert!(off <= frame.error + 1e-7, "{off:e} for {:e}", frame.error);
        }
    }
}

#[test]
fn a_filter_narrower_than_the_first_lattices_is_all_but_none() {
    let mut random = Random::new(78);
    let wide = (0..8).map(|_| Particle::sphere(random.point(1.5) + DVec3::Z * 6.0, 0.7, 2.0));
    let integrator = integrator(&wide.collect::<Vec<_>>());
    let camera = scene::camera(Projection::Perspective, [12.0; 2], [9, 7]);
    let sharp = filtered(&integrator, &camera, 0.0, 1e-6);
    for h2 in [1e-2, 1e-3] {
        let frame = filtered(&integrator, &camera, h2, 1e-5);
        assert_eq!(frame.unconverged, 0);
        let pairs = frame.pixels.iter().zip(&sharp.pixels);
        let off = pairs.map(|(a, b)| largest(a, b)).fold(0.0, f64::max);
        println!("h² {h2}: {off:.1e}");
        // Half of h² times the curvature of kernels more than a pixel wide.
        assert!(off <= h2, "{off:e}");
    }
}

#[test]
fn a_stated_error_is_kept_by_pixels() {
    for seed in some(0..2, 0, 2) {
        // Sub-pixel needles and points among wide kernels, which lattices may miss.
        let mut random = Random::new(100 + seed);
        let mut particles = cloud(seed, 6);
        particles.extend((0..24).map(|_| Particle {
            position: DVec3::Z * 6.0 + random.point(2.0),
            factor: {
                let largest = random.log_range(0.03, 0.3);
                random.factor(largest, 6.0)
            },
            mass: random.log_range(1e-4, 1.0) as f32,
            colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
        }));
        let integrator = integrator(&particles);
        let camera = scene::camera(Projection::Perspective, [20.0; 2], [6, 5]);
        let truth = filtered(&integrator, &camera, 1.0, 3e-5);
        assert_eq!(truth.unconverged, 0);
        for error in [1e-2, 1e-3] {
            let frame = filtered(&integrator, &camera, 1.0, error);
            let pairs = frame.pixels.iter().zip(&truth.pixels);
            let off = pairs.map(|(a, b)| largest(a, b)).fold(0.0, f64::max);
            println!(
                "asked {error:.0e}: stated {:.1e}, off by {off:.1e}, {} rays per pixel",
                frame.error,
                frame.rays / frame.pixels.len() as u64
            );
            assert_eq!(frame.unconverged, 0);
            assert!(off <= frame.error + truth.error);
        }
    }
}

#[test]
fn a_small_kernel_between_the_samples_is_found() {
    // The kernel is a hundredth of a pixel wide, where the first lattices have no sample.
    let (width, mass) = width_and_mass(10.0, 1.0);
    let offset = DVec2::new(0.3, 0.17);
    let kernel = Particle::sphere(DVec3::Z * 20.0, width, f64::from(mass));
    let mut camera = scene::camera(Projection::Orthographic, [0.01 / width; 2], [1, 1]);
    camera.centre_px += offset;
    let frame = filtered(&integrator(&[kernel]), &camera, 1.0, 1e-5);
    assert_eq!(frame.unconverged, 0);
    // Its integrated opacity is 2 pi sigma² Ein(10). The filter is nearly constant over it: to
    // sigma²/h² = 1e-4.
    const EIN_10: f64 = 2.879_804_914_864_508;
    let truth = 1e-4 * EIN_10 * (-0.5 * offset.length_squared()).exp();
    close("opacity", frame.pixels[0][3], truth, 1e-5);
}

#[test]
fn rays_too_few_are_reported() {
    let needle = Particle {
        position: DVec3::Z * 6.0,
        factor: DMat3::from_diagonal(DVec3::new(0.5, 1e-4, 1e-4)),
        mass: 1e-3,
        colour: [1.0; 3],
    };
    let camera = scene::camera(Projection::Perspective, [30.0; 2], [9, 9]);
    let settings = ReferenceSettings {
        max_rays_per_pixel: 16,
        ..ReferenceSettings::default()
    };
    let frame = integrator(&[needle]).render(&camera, &settings).unwrap();
    assert!(frame.unconverged > 0 && frame.error > settings.error);
}

#[test]
fn a_tree_and_a_list_find_the_same_kernels() {
    // 65 kernels have a tree, a single one has a list. Depths add up.
    for (offset, scale) in [
        (DVec3::ZERO, 1.0),
        (DVec3::splat(1e7), 1.0),
        (DVec3::ZERO, 1e-9),
    ] {
        let mut particles = cloud(8, 200);
        for p in &mut particles {
            p.position = p.position * scale + offset;
            p.factor *= scale;
            p.mass *= (scale * scale) as f32;
        }
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let focal = match projection {
                Projection::Perspective => 6.0,
                Projection::Orthographic => 2.0 / scale,
            };
            let mut camera = scene::camera(projection, [focal; 2], [13, 11]);
            camera.eye = offset;
            let settings = ReferenceSettings {
                error: 1e-9,
                low_pass_variance_px2: 0.0,
                ..ReferenceSettings::default()
            };
            let frame = integrator(&particles).render(&camera, &settings).unwrap();
            let alone = |p: &Particle| integrator(std::slice::from_ref(p));
            let alone: Vec<Integrator> = particles.iter().map(alone).collect();
            let pixels = some(frame.pixels.iter().enumerate(), 0, 2);
            for (i, pixel) in pixels {
                let px = DVec2::new((i % 13) as f64, (i / 13) as f64) + 0.5;
                let of = |one: &Integrator| depth(one.ray(&camera, px, 1e-12).rgba[3]);
                let sum: f64 = alone.iter().map(of).sum();
                let error = (pixel[3] + (-sum).exp_m1()).abs();
                assert!(error < 1e-12, "{error:e} at {px}");
            }
        }
    }
}

#[test]
fn what_is_wrong_is_refused() {
    let integrator = integrator(&cloud(1, 2));
    let camera = scene::camera(Projection::Perspective, [6.0; 2], [2, 2]);
    let good = ReferenceSettings::default();
    let empty = Camera {
        width: 0,
        ..camera.clone()
    };
    let refused = [
        integrator.render(&empty, &good),
        integrator.render(
            &camera,
            &ReferenceSettings {
                error: 0.0,
                ..good.clone()
            },
        ),
        integrator.render(
            &camera,
            &ReferenceSettings {
                low_pass_variance_px2: f64::NAN,
                ..good
            },
        ),
    ];
    for (result, word) in refused
        .iter()
        .zip(["image size", "error", "low-pass variance"])
    {
        let message = result.as_ref().unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    }
}

/// Surfel of one colour, as the tests below describe it.
#[derive(Debug, Clone, Copy)]
struct Surfel {
    position: DVec3,
    tangents: [DVec3; 2],
    area: f64,
    colour: [f32; 3],
}

/// Makes an opaque surface, or (with an optical depth for the area) a translucent one.
fn surface(surfels: &[Surfel], is_opaque: bool, is_one_sided: bool) -> PointVolume {
    let areas = surfels.iter().map(|s| s.area as f32).collect();
    PointVolume {
        particles: Particles::Surfels {
            positions: surfels.iter().map(|s| s.position).collect(),
            tangents: surfels
                .iter()
                .map(|s| {
                    let [a, b] = s.tangents.map(|t| t.as_vec3());
                    [a.x, a.y, a.z, b.x, b.y, b.z]
                })
                .collect(),
            is_one_sided,
        },
        strength: if is_opaque {
            Strength::Surface(areas)
        } else {
            Strength::Translucent(areas)
        },
        colour: Colour::PerParticle(surfels.iter().map(|s| s.colour).collect()),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns a round surfel across the z axis that faces its negative end.
fn facing(z: f64, sigma: f64, area: f64, colour: [f32; 3]) -> Surfel {
    Surfel {
        position: DVec3::Z * z,
        tangents: [DVec3::X * sigma, DVec3::NEG_Y * sigma],
        area,
        colour,
    }
}

/// Returns the surfel's weight where a ray from `origin` meets its plane, from the numbers s, t
/// with origin + depth ray = position + s a + t b; zero behind the origin.
fn weight_along(s: &Surfel, origin: DVec3, ray: DVec3) -> f64 {
    // The scene stores its numbers in f32.
    let [a, b] = s.tangents.map(|t| t.as_vec3().as_dvec3());
    let met = DMat3::from_cols(ray, -a, -b).inverse() * (s.position - origin);
    let area = f64::from(s.area as f32);
    let weight =
        area / (TAU * a.cross(b).length()) * (-0.5 * (met.y * met.y + met.z * met.z)).exp();
    if met.x > 0.0 { weight } else { 0.0 }
}

#[test]
fn rays_meet_surfels_where_they_meet_their_planes() {
    let mut random = Random::new(31);
    let (mut seen, mut full) = (0, 0);
    for i in 0..400 {
        let projection = [Projection::Perspective, Projection::Orthographic][i % 2];
        let camera = scene::camera(projection, [90.0, 70.0], [64, 64]);
        let turn = random.rotation();
        let sigma = random.log_range(0.05, 3.0);
        let lean = random.range(-0.9, 0.9);
        let surfel = Surfel {
            // Some lie behind the eye, some across its plane.
            position: random.point(0.4) + DVec3::Z * random.range(-0.5, 4.0),
            tangents: [
                turn.x_axis * sigma,
                (turn.y_axis + turn.x_axis * lean) * (sigma * random.log_range(0.05, 1.0)),
            ],
            area: sigma * sigma * random.log_range(0.1, 10.0),
            colour: [0.25, 0.5, 0.75],
        };
        let pixel = DVec2::new(random.range(0.0, 64.0), random.range(0.0, 64.0));
        let slope = (pixel - camera.centre_px) / camera.focal_px;
        let (origin, ray) = match projection {
            Projection::Perspective => (DVec3::ZERO, slope.extend(1.0)),
            Projection::Orthographic => (slope.extend(0.0), DVec3::Z),
        };
        let weight = weight_along(&surfel, origin, ray);
        let normal = surfel.tangents[0].cross(surfel.tangents[1]);
        let is_front = normal.dot(ray) < 0.0;
        let draw = |is_opaque, is_one_sided| {
            let scene = [surface(&[surfel], is_opaque, is_one_sided)];
            let integrator = Integrator::new(&scene).unwrap();
            integrator.ray(&camera, pixel, 1e-12).rgba
        };
        // Beyond 7 standard deviations, nothing is drawn: 2e-11 of the peak. Otherwise, a 3x3
        // system that may be ill-conditioned rounds.
        let allowed = 1e-9 * (1.0 + surfel.area / sigma.powi(2));
        for is_one_sided in [false, true] {
            let is_seen = is_front || !is_one_sided;
            let covered = if is_seen { weight.min(1.0) } else { 0.0 };
            let got = draw(true, is_one_sided);
            for (got, c) in got.iter().zip([0.25, 0.5, 0.75, 1.0]) {
                assert!(
                    (got - covered * c).abs() < allowed,
                    "{surfel:?}: {got} {covered}"
                );
            }
            let opacity = if is_seen { -(-weight).exp_m1() } else { 0.0 };
            let got = draw(false, is_one_sided);
            assert!((got[3] - opacity).abs() < allowed, "{surfel:?}");
        }
        seen += usize::from(weight > 0.01);
        full += usize::from(weight > 1.0);
    }
    println!("{seen} seen, {full} in full");
    assert!(seen > 100 && full > 10);
}

#[test]
fn a_surfel_before_a_camera_of_parallel_rays_is_filtered_in_closed_form() {
    // Tilted about x by 60 degrees: a Gaussian of variances sigma² and (sigma cos)² on the image,
    // plus the filter's 1 px².
    let (focal, sigma, tilt) = (20.0, 0.1, 60.0_f64.to_radians());
    let camera = scene::camera(Projection::Orthographic, [focal; 2], [17, 17]);
    let surfel = Surfel {
        position: DVec3::Z,
        tangents: [
            DVec3::X * sigma,
            DVec3::new(0.0, tilt.cos(), tilt.sin()) * sigma,
        ],
        area: 0.02,
        colour: [1.0; 3],
    };
    let integrator = Integrator::new(&[surface(&[surfel], true, false)]).unwrap();
    let (vx, vy) = (
        (sigma * focal).powi(2) + 1.0,
        (sigma * focal * tilt.cos()).powi(2) + 1.0,
    );
    let peak = 0.02 * focal * focal * tilt.cos() / (TAU * (vx * vy).sqrt());
    for pixel_filter in [PixelFilter::Image, PixelFilter::Kernels] {
        let settings = ReferenceSettings {
            error: 1e-7,
            max_rays_per_pixel: 4096,
            pixel_filter,
            ..ReferenceSettings::default()
        };
        let frame = integrator.render(&camera, &settings).unwrap();
        let mut worst = 0.0_f64;
        for (i, pixel) in frame.pixels.iter().enumerate() {
            let (x, y) = ((i % 17) as f64 - 8.0, (i / 17) as f64 - 8.0);
            let expected = peak * (-0.5 * (x * x / vx + y * y / vy)).exp();
            worst = worst.max((pixel[3] - expected).abs());
        }
        println!("{pixel_filter:?}: {worst:.1e}, stated {:.1e}", frame.error);
        // The stated error, and the scene's roundings to f32.
        assert!(
            worst < 1e-7 && frame.unconverged == 0,
            "{pixel_filter:?}: {worst}"
        );
    }
}

#[test]
fn surfaces_cover_one_another_and_end_what_lies_in_front() {
    let camera = scene::camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    let ray = |scene: &[PointVolume], planes: &[ClipPlane]| {
        let integrator = Integrator::new(scene).unwrap().clipped(planes);
        integrator.ray(&camera, camera.centre_px, 1e-12).rgba
    };
    let close = |what: &str, got: [f64; 4], expected: [f64; 4]| {
        for (got, expected) in got.iter().zip(expected) {
            // Areas are stored in f32.
            assert!(
                (got - expected).abs() < 2e-7,
                "{what}: {got} for {expected}"
            );
        }
    };
    // Weights .4 and .5 on the axis, in either order; and a third that fills the remaining .1.
    let at = |z: f64, weight: f64, colour| facing(z, 0.1, weight * TAU * 0.01, colour);
    let (red, green, blue) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let three = [at(3.0, 0.9, blue), at(1.0, 0.4, red), at(2.0, 0.5, green)];
    close(
        "three",
        ray(&[surface(&three, true, true)], &[]),
        [0.4, 0.5, 0.1, 1.0],
    );
    // Together, they act as one surfel of the mean colour.
    let together = [at(1.0, 0.4, red), at(1.05, 0.8, green)];
    let mean = [0.4 / 1.2, 0.8 / 1.2, 0.0, 1.0];
    close(
        "together",
        ray(&[surface(&together, true, true)], &[]),
        mean,
    );
    // A kernel of depth .7 about the first surface: half of it in front, half behind.
    let fog = scene::volume(&[Particle {
        colour: [1.0, 1.0, 0.0],
        ..Particle::sphere(DVec3::Z * 2.0, 0.2, 0.7 * TAU * 0.04)
    }]);
    let half: f64 = (-0.35_f64).exp();
    let wall = surface(&[at(2.0, 0.4, blue)], true, true);
    let whole = 1.0 - half * half;
    let yellow = 0.4 * (1.0 - half) + 0.6 * whole;
    let expected = [yellow, yellow, 0.4 * half, 0.4 + 0.6 * whole];
    close("in fog", ray(&[fog.clone(), wall.clone()], &[]), expected);
    // A sheet of depth .5 in front of the wall, another behind it, visible through a gap of .6.
    let mut sheets = [at(1.0, 0.5, red), at(3.0, 0.5, green)];
    for sheet in &mut sheets {
        sheet.tangents[1].z = 0.05;
        sheet.area = 0.5 * TAU * sheet.tangents[0].cross(sheet.tangents[1]).length();
    }
    let (through, hidden) = ((-0.5_f64).exp(), 1.0 - (-0.5_f64).exp());
    let expected = [
        hidden,
        0.6 * through * hidden,
        0.4 * through,
        0.4 + 0.6 * (1.0 - through * through),
    ];
    close(
        "between sheets",
        ray(&[surface(&sheets, false, false), wall.clone()], &[]),
        expected,
    );
    // Clip planes: in front of the wall, within the fog before it, and behind everything. They open
    // a closed surface: surfels seen from behind are drawn.
    let cut = |z: f64, sign: f64| ClipPlane {
        normal: DVec3::Z * sign,
        distance: -z * sign,
    };
    close(
        "cut away",
        ray(std::slice::from_ref(&wall), &[cut(2.5, 1.0)]),
        [0.0; 4],
    );
    let expected = [1.0 - half, 1.0 - half, 0.0, 1.0 - half];
    let behind = surface(&[at(2.1, 0.4, blue)], true, true);
    close(
        "cut behind",
        ray(&[fog, behind], &[cut(2.0, -1.0)]),
        expected,
    );
    let mut back = at(1.0, 0.4, red);
    back.tangents.swap(0, 1);
    let back = surface(&[back], true, true);
    close(
        "from behind",
        ray(std::slice::from_ref(&back), &[]),
        [0.0; 4],
    );
    close(
        "opened",
        ray(&[back], &[cut(0.5, 1.0)]),
        [0.4, 0.0, 0.0, 0.4],
    );
}
