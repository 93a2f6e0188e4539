//! Tests numerical stability at the extremes through the whole renderer: a scene, a camera, a
//! picture.
//!
//! Every picture is compared with the reference integrator, with the low-pass filter on kernels, so
//! that the test measures projection, rounding and cut-off. Kernels of one scene have one colour,
//! so that their order has no effect (with 1 - exp(-tau), the opacity is exact for any overlap).
//! `cargo test --test extremes -- --nocapture --test-threads 1` prints the table of the
//! documentation.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;

use crate::common::scene::{self, Particle};
use crate::common::{Random, fixture, number, numbers};
use ewa_splat::Filter;
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceSettings};
use ewa_splat::scene::PointVolume;
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DMat3, DVec2, DVec3};
use serde_json::Value;

/// Default settings: the adaptive filter at 1/255.
fn default_settings() -> Settings {
    Settings::default()
}

/// Returns the renderer's most accurate settings.
fn exact_settings() -> Settings {
    Settings {
        filter: Filter::Exact,
        tolerance: 1e-6,
        cutoff: Some(7.0),
        ..Settings::default()
    }
}

/// Draws on the CPU, and compares the GPU's picture with it.
fn render(scene: &PointVolume, camera: &Camera, settings: &Settings, name: &str) -> Image {
    #[cfg(feature = "gpu")]
    crate::common::gpu::assert_alike(name, scene, camera, settings);
    let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
    let image = renderer.render(camera, settings).unwrap();
    let finite = image.pixels.iter().flatten().all(|c| c.is_finite());
    assert!(finite, "{name}: a pixel is not finite");
    image.clone()
}

/// Returns the largest difference of a channel.
fn error(image: &Image, truth: &[[f64; 4]]) -> f64 {
    let pairs = image.pixels.iter().flatten().zip(truth.iter().flatten());
    pairs
        .map(|(a, b)| (f64::from(*a) - b).abs())
        .fold(0.0, f64::max)
}

/// Compares a scene's pictures with the reference. The most accurate one must be within `bound` of
/// the picture's peak, the default one within twice the tolerance, relative to full scale (one
/// approximation of the shape and one of the cut-off). Prints a row of the table.
fn judge(name: &str, particles: &[Particle], camera: &Camera, h2: f64, bound: f64) {
    judge_against(name, particles, camera, h2, bound, 1e-9);
}

fn judge_against(
    name: &str,
    particles: &[Particle],
    camera: &Camera,
    h2: f64,
    bound: f64,
    reference_error: f64,
) {
    let scene = scene::volume(particles);
    let integrator = Integrator::new(std::slice::from_ref(&scene)).unwrap();
    let settings = ReferenceSettings {
        error: reference_error,
        low_pass_variance_px2: h2,
        pixel_filter: PixelFilter::Kernels,
        ..ReferenceSettings::default()
    };
    let truth = integrator.render(camera, &settings).unwrap().pixels;
    let peak = truth.iter().flatten().copied().fold(0.0, f64::max);
    let error = |settings: Settings| {
        let settings = Settings {
            low_pass_variance_px2: h2 as f32,
            ..settings
        };
        error(&render(&scene, camera, &settings, name), &truth)
    };
    let (best, default) = (error(exact_settings()), error(default_settings()));
    println!("| {name} | {peak:.1e} | {best:.1e} | {default:.1e} |");
    let allowed = bound * peak + reference_error;
    assert!(best <= allowed, "{name}: {best:e} of {peak:e}");
    let allowed = 2.0 * f64::from(Settings::default().tolerance);
    assert!(default <= allowed, "{name}: {default:e} by default");
}

/// f32 rounds a position in the picture to 3e-5 px, a shape to 1e-7, relative, and a depth by a few
/// 1e-7. The published worst of these formulas is 5.5e-6 of the peak.
const ROUNDING: f64 = 6e-6;

fn camera(fov_deg: f64, size: [usize; 2]) -> Camera {
    let mut camera = scene::camera(Projection::Perspective, [1.0; 2], size);
    let focal = size[1] as f64 / (2.0 * (fov_deg.to_radians() / 2.0).tan());
    camera.focal_px = DVec2::splat(focal);
    camera
}

/// Returns the mass that gives a sphere of standard deviation `sigma` the depth `tau`.
fn mass(tau: f64, sigma: f64) -> f64 {
    tau * TAU * sigma * sigma
}

/// Returns overlapping kernels of one colour, some 2 to 20 px wide at 400 px focal length.
fn cloud(count: usize) -> Vec<Particle> {
    let mut random = Random::new(2024);
    (0..count)
        .map(|_| Particle {
            position: DVec3::Z * 20.0 + random.point(1.0),
            factor: {
                let largest = random.log_range(0.1, 1.0);
                random.factor(largest, 5.0)
            },
            mass: random.log_range(1e-3, 0.1) as f32,
            colour: [0.75, 0.5, 0.25],
        })
        .collect()
}

/// Returns the cloud and its camera at another scale and position.
fn carried(scale: f64, offset: DVec3) -> (Vec<Particle>, Camera) {
    let mut particles = cloud(20);
    for p in &mut particles {
        p.position = p.position * scale + offset;
        p.factor *= scale;
        p.mass = (f64::from(p.mass) * scale * scale) as f32;
    }
    let mut camera = scene::camera(Projection::Perspective, [400.0; 2], [64, 48]);
    camera.eye = offset;
    (particles, camera)
}

#[test]
fn axis_ratios() {
    let mut random = Random::new(7);
    for power in 0..=6 {
        let ratio = 10_f64.powi(power);
        let particles: Vec<_> = (0..8)
            .map(|_| Particle {
                position: DVec3::Z * 20.0 + random.point(0.5),
                factor: random.factor(0.8, ratio),
                // The depth of the mass spread over a pixel-wide line, not more.
                mass: 2e-3,
                colour: [0.75; 3],
            })
            .collect();
        let camera = scene::camera(Projection::Perspective, [400.0; 2], [64, 64]);
        judge(
            &format!("axis ratio 1e{power}"),
            &particles,
            &camera,
            1.0,
            4.0 * ROUNDING,
        );
    }
}

#[test]
fn ranks() {
    let camera = scene::camera(Projection::Perspective, [400.0; 2], [64, 64]);
    let mut random = Random::new(8);
    for (rank, sigmas) in [
        (3, DVec3::new(0.5, 0.3, 0.2)),
        (2, DVec3::new(0.5, 0.3, 0.0)),
        (1, DVec3::new(0.5, 0.0, 0.0)),
        (0, DVec3::ZERO),
    ] {
        let particles: Vec<_> = (0..8)
            .map(|_| Particle {
                position: DVec3::Z * 20.0 + random.point(0.5),
                factor: random.rotation() * DMat3::from_diagonal(sigmas),
                mass: 2e-3,
                colour: [0.75; 3],
            })
            .collect();
        judge(
            &format!("rank {rank}"),
            &particles,
            &camera,
            1.0,
            2.0 * ROUNDING,
        );
    }
}

#[test]
fn at_across_and_behind_the_camera_plane() {
    let camera = camera(90.0, [40, 40]);
    for (name, shape) in [
        ("sphere", DMat3::IDENTITY),
        (
            "ellipsoid 1:5",
            DMat3::from_rotation_x(0.6) * DMat3::from_diagonal(DVec3::new(1.0, 0.4, 0.2)),
        ),
    ] {
        for z in [-3.0, -1.0, -0.25, 0.0, 0.25, 1.0, 3.0, 8.0] {
            let kernel = Particle {
                position: DVec3::new(0.3, -0.2, z),
                factor: shape,
                mass: mass(2.0, 0.5) as f32,
                colour: [0.75; 3],
            };
            judge(
                &format!("{name}, centre at depth {z} sigma"),
                &[kernel],
                &camera,
                0.0,
                2.0 * ROUNDING,
            );
        }
    }
}

#[test]
fn the_eye_inside() {
    let particles: Vec<_> = cloud(20)
        .into_iter()
        .map(|p| Particle {
            position: p.position - DVec3::Z * 20.0,
            ..p
        })
        .collect();
    judge(
        "eye inside 20 kernels",
        &particles,
        &camera(90.0, [40, 40]),
        0.0,
        4.0 * ROUNDING,
    );
}

#[test]
fn scales() {
    for power in [-12, -9, -6, -3, 0, 3, 6, 9, 12] {
        let (particles, camera) = carried(10_f64.powi(power), DVec3::ZERO);
        judge(
            &format!("scene scale 1e{power}"),
            &particles,
            &camera,
            1.0,
            2.0 * ROUNDING,
        );
    }
}

#[test]
fn offsets() {
    for power in [0, 2, 4, 6, 8] {
        let offset = DVec3::new(1.0, -2.0, 3.0) * 10_f64.powi(power);
        let (particles, camera) = carried(1.0, offset);
        judge(
            &format!("offset 1e{power} kernels' widths"),
            &particles,
            &camera,
            1.0,
            2.0 * ROUNDING,
        );
    }
}

#[test]
fn fields_of_view() {
    for fov in [1.0, 10.0, 60.0, 120.0, 150.0, 179.0_f64] {
        let camera = camera(fov, [48, 48]);
        let half = (fov.to_radians() / 2.0).tan();
        let mut random = Random::new(9);
        // Kernels on the axis, half way and in the corner, all a few pixels wide on the axis.
        let particles: Vec<_> = [0.0, 0.5, 0.95]
            .map(|share| Particle {
                position: DVec3::new(share * half, share * half, 1.0) * 10.0,
                factor: random.factor((20.0 * half / 48.0 * 2.0).min(2.0), 3.0),
                mass: mass(0.3, (20.0 * half / 48.0 * 2.0).min(2.0)) as f32,
                colour: [0.75; 3],
            })
            .to_vec();
        judge(
            &format!("field of view {fov} degrees"),
            &particles,
            &camera,
            1.0,
            2.0 * ROUNDING,
        );
    }
}

#[test]
fn few_and_many() {
    let camera = scene::camera(Projection::Perspective, [400.0; 2], [5, 5]);
    let wider = scene::camera(Projection::Perspective, [400.0; 2], [64, 64]);
    judge("one particle", &cloud(1), &wider, 1.0, ROUNDING);
    // Each layer is 1e-4 deep at its peak; together they are ten deep.
    let mut random = Random::new(10);
    let layers: Vec<_> = (0..100_000)
        .map(|i| Particle {
            position: DVec3::new(0.02, -0.01, 15.0 + 1e-4 * f64::from(i)) + random.point(0.05),
            factor: DMat3::from_diagonal(DVec3::splat(0.3)),
            mass: mass(1e-4, 0.3) as f32,
            colour: [0.75; 3],
        })
        .collect();
    // Once less than 3e-8/1e-4 of the light is left, a layer adds less than half a unit in the last
    // place, 3e-8, and so nothing. That fraction stays dark.
    judge("100,000 layers of depth 1e-4", &layers, &camera, 1.0, 3e-4);
}

#[test]
fn optical_depths() {
    let camera = scene::camera(Projection::Perspective, [400.0; 2], [48, 48]);
    for power in [-10, -6, -3, 0, 1, 2, 4] {
        let tau = 10_f64.powi(power);
        let kernel = Particle::sphere(DVec3::new(0.1, 0.05, 20.0), 0.3, mass(tau, 0.3));
        // An opaque kernel's edge lies where tau is about 1, far out. There, the relative error of
        // the depth is ln(tau) times that of the position.
        let steeper = 1.0 + tau.ln().max(0.0);
        let name = format!("peak depth 1e{power}");
        let kernel = [kernel.coloured([0.75; 3])];
        // The reference's error is also relative to full scale.
        judge_against(&name, &kernel, &camera, 1.0, ROUNDING * steeper, 1e-14);
    }
}

#[test]
fn shapes_of_images() {
    for size in [[1, 1], [1, 4096], [4096, 1], [17, 3]] {
        let mut camera = scene::camera(Projection::Perspective, [400.0; 2], size);
        let long = size[0].max(size[1]) as f64;
        camera.focal_px = DVec2::splat(10.0 * long.max(20.0));
        let name = format!("image {} x {}", size[0], size[1]);
        judge(&name, &cloud(20), &camera, 1.0, 2.0 * ROUNDING);
    }
}

// Returns the published cases as scenes.

fn cases(kind: &str) -> Vec<Value> {
    let all = fixture("extreme_cases.json");
    let list = all["cases"].as_array().unwrap().iter();
    let found: Vec<_> = list.filter(|c| c["kind"] == kind).cloned().collect();
    assert!(!found.is_empty(), "no case of kind {kind}");
    found
}

/// Returns the case's kernel, and the camera of one pixel whose centre is `probe`.
fn published(case: &Value, probe: DVec2) -> (Particle, Camera) {
    let n = |p: &str| number(case, &format!("/input/{p}"));
    let row = |i: usize| {
        let r = numbers(case, &format!("/input/factor_L_rows/{i}"));
        DVec3::new(r[0], r[1], r[2])
    };
    let centre = numbers(case, "/input/mean_cam");
    let particle = Particle {
        position: DVec3::new(centre[0], centre[1], centre[2]),
        factor: DMat3::from_cols(row(0), row(1), row(2)).transpose(),
        mass: n("mass_g") as f32,
        colour: [1.0; 3],
    };
    let projection = if case["input"]["camera"]["model"] == "orthographic" {
        Projection::Orthographic
    } else {
        Projection::Perspective
    };
    let mut camera = scene::camera(projection, [n("camera/fx"), n("camera/fy")], [1, 1]);
    let axis = DVec2::new(n("camera/cx"), n("camera/cy"));
    camera.centre_px = axis - probe + 0.5;
    (particle, camera)
}

fn probes(case: &Value) -> Vec<DVec2> {
    let list = case["input"]["pixels"].as_array().unwrap();
    list.iter()
        .map(|p| DVec2::new(number(p, "/0"), number(p, "/1")))
        .collect()
}

#[test]
fn published_footprints() {
    let mut tested = 0;
    for case in cases("footprint") {
        let name = case["name"].as_str().unwrap();
        let h2 = number(&case, "/input/lowpass_h2_px2") as f32;
        let expected = |key: &str| {
            let all = case["expected"].get(key)?.as_array()?;
            Some(all.iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>())
        };
        let exact = expected("tau_exact").or_else(|| expected("tau_exact_half_line"));
        // The affine footprint exists only for kernels in front of the camera plane.
        let ewa = expected("tau_ewa").filter(|_| expected("tau_exact_half_line").is_none());
        for (filter, digits) in [(Filter::Exact, exact), (Filter::Ewa, ewa)] {
            let Some(digits) = digits else { continue };
            let peak = expected("tau_ewa").map_or(1.0, |_| number(&case, "/expected/tau_peak_ewa"));
            for (probe, tau) in probes(&case).into_iter().zip(&digits) {
                let (particle, camera) = published(&case, probe);
                let reach = 7.0 * particle.factor.row(2).length();
                if filter == Filter::Ewa && particle.position.z < 1.5 * reach {
                    // The kernel is too near the camera plane for an affine footprint: it is
                    // integrated directly.
                    continue;
                }
                let settings = Settings {
                    filter,
                    low_pass_variance_px2: h2,
                    ..exact_settings()
                };
                let image = render(&scene::volume(&[particle]), &camera, &settings, name);
                let alpha = f64::from(image.pixel(0, 0)[3]);
                let error = (alpha + (-tau).exp_m1()).abs();
                // The opacity's error is e^-tau times the depth's. Beyond 7 sigma,
                // nothing is drawn.
                let cut = if *tau < 2.3e-11 * peak { *tau } else { 0.0 };
                let allowed = ROUNDING * peak.min(1.0) * (1.0 + peak.ln().max(0.0)) + cut;
                assert!(
                    error <= allowed,
                    "{name}, {filter:?} at {probe}: opacity {alpha:e} for tau {tau:e}, off by {error:e}"
                );
                tested += 1;
            }
        }
    }
    println!("{tested} probes");
    assert!(tested > 120);
}

#[test]
fn published_rows_offsets_and_ties() {
    // Q(i) = A x² + 2 B x dy + C dy², x = x0 + i: a kernel with that conic, in one row of 4096
    // pixels.
    for case in cases("quad_row") {
        let n = |p: &str| number(&case, &format!("/input/{p}"));
        let conic = glam::DMat2::from_cols_array(&[n("A"), n("B"), n("B"), n("C")]);
        let v = conic.inverse();
        // The lower-triangular factor of a variance of 5e5 by 3e4 px².
        let l00 = v.x_axis.x.sqrt();
        let l10 = v.x_axis.y / l00;
        let l11 = (v.y_axis.y - l10 * l10).sqrt();
        let particle = Particle {
            position: DVec3::new(-n("x0") + 0.5, -n("dy") + 0.5, 1e4),
            factor: DMat3::from_cols(
                DVec3::new(l00, l10, 0.0),
                DVec3::new(0.0, l11, 0.0),
                DVec3::new(0.0, 0.0, 100.0),
            ),
            mass: (0.9 * TAU * l00 * l11) as f32,
            colour: [1.0; 3],
        };
        let mut camera = scene::camera(Projection::Orthographic, [1.0; 2], [4096, 1]);
        camera.centre_px = DVec2::ZERO;
        let settings = Settings {
            low_pass_variance_px2: 0.0,
            ..exact_settings()
        };
        let image = render(&scene::volume(&[particle]), &camera, &settings, "row");
        for (i, q) in numbers(&case, "/input/indices")
            .iter()
            .zip(numbers(&case, "/expected/Q"))
        {
            let alpha = f64::from(image.pixel(*i as usize, 0)[3]);
            let truth = -(-0.9 * (-0.5 * q).exp()).exp_m1();
            assert!((alpha - truth).abs() < ROUNDING, "{i}: {alpha} for {truth}");
        }
    }
    for case in cases("offset") {
        let at = |key: &str| {
            let v = numbers(&case, &format!("/input/{key}"));
            DVec3::new(v[0], v[1], v[2])
        };
        let particle = Particle::sphere(at("mean_world_f64"), 0.05, mass(0.5, 0.05));
        let n = |p: &str| number(&case, &format!("/input/camera/{p}"));
        let mut camera = scene::camera(Projection::Perspective, [n("fx"), n("fy")], [1024, 768]);
        camera.eye = at("eye_world_f64");
        camera.centre_px = DVec2::new(n("cx"), n("cy"));
        let image = render(
            &scene::volume(&[particle]),
            &camera,
            &default_settings(),
            "offset",
        );
        // The centre of light is the kernel's centre, except for the curvature of perspective.
        let (mut sum, mut place) = (0.0, DVec2::ZERO);
        for (i, p) in image.pixels.iter().enumerate() {
            let alpha = f64::from(p[3]);
            sum += alpha;
            place += alpha * (DVec2::new((i % 1024) as f64, (i / 1024) as f64) + 0.5);
        }
        let centre = numbers(&case, "/expected/center_px");
        let off = (place / sum - DVec2::new(centre[0], centre[1])).length();
        assert!(off < 0.01, "{} for {centre:?}", place / sum);
    }
    for case in cases("sort") {
        // Colours encode the right order; each kernel is half transparent.
        let depths = numbers(&case, "/input/depth_f64");
        let order = numbers(&case, "/expected/order");
        let mut rank = vec![0; depths.len()];
        for (r, i) in order.iter().enumerate() {
            rank[*i as usize] = r;
        }
        let particles: Vec<_> = depths
            .iter()
            .zip(&rank)
            .map(|(z, r)| {
                let light = 0.5_f32.powi(*r as i32);
                let sphere = Particle::sphere(DVec3::Z * *z, 1e-3, mass(2_f64.ln(), 1e-3));
                sphere.coloured([light, 1.0 - light, 0.0])
            })
            .collect();
        let camera = scene::camera(Projection::Orthographic, [1e4; 2], [1, 1]);
        let settings = Settings {
            low_pass_variance_px2: 0.0,
            ..exact_settings()
        };
        let image = render(&scene::volume(&particles), &camera, &settings, "ties");
        // sum of 2^-(r+1) 2^-r.
        let light: f64 = (0..depths.len())
            .map(|r| 0.5 * 0.25_f64.powi(r as i32))
            .sum();
        let red = f64::from(image.pixel(0, 0)[0]);
        assert!((red - light).abs() < 1e-6, "{red} for {light}");
    }
}

#[test]
fn published_overlaps_and_filtered_opacities_are_the_renderers_known_errors() {
    // Whole kernels are sorted, so the pictures have the published values of `over`. The reference
    // shows that these are wrong by up to alpha1 alpha2.
    for case in cases("overlap_two_kernels") {
        let n = |p: &str| number(&case, &format!("/input/{p}"));
        let kernel = |i: usize, colour: [f32; 3]| {
            let [tau, mean, sigma] = ["tau", "mu", "sigma"].map(|key| n(&format!("{key}{i}")));
            Particle {
                position: DVec3::Z * mean,
                factor: DMat3::from_diagonal(DVec3::new(1.0, 1.0, sigma)),
                mass: mass(tau, 1.0) as f32,
                colour,
            }
        };
        let scene = scene::volume(&[kernel(1, [1.0, 0.0, 0.0]), kernel(2, [0.0, 1.0, 0.0])]);
        let camera = scene::camera(Projection::Orthographic, [1.0; 2], [1, 1]);
        let settings = Settings {
            low_pass_variance_px2: 0.0,
            ..exact_settings()
        };
        let pixel = render(&scene, &camera, &settings, "overlap").pixel(0, 0);
        let (a1, a2) = (-(-n("tau1")).exp_m1(), -(-n("tau2")).exp_m1());
        for (channel, key) in [(0, "w1"), (1, "w2")] {
            let got = f64::from(pixel[channel]);
            let sorted = number(&case, &format!("/expected/{key}_sorted"));
            let exact = number(&case, &format!("/expected/{key}_exact"));
            assert!(
                (got - sorted).abs() < 1e-6,
                "{}: {got} for {sorted}",
                case["name"]
            );
            assert!(
                (got - exact).abs() <= a1 * a2,
                "{}: beyond the bound",
                case["name"]
            );
        }
    }
    // The filter applies to depths, not opacities.
    for case in cases("filtered_opacity_peak") {
        let (share, tau0) = (number(&case, "/input/a"), number(&case, "/input/tau0"));
        let kernel = Particle::sphere(DVec3::Z * 20.0, 1.0, mass(tau0, 1.0));
        let camera = scene::camera(Projection::Orthographic, [share.sqrt(); 2], [1, 1]);
        let image = render(
            &scene::volume(&[kernel]),
            &camera,
            &exact_settings(),
            "filtered",
        );
        let alpha = f64::from(image.pixel(0, 0)[3]);
        let ewa = number(&case, "/expected/alpha_ewa");
        assert!(
            (alpha - ewa).abs() < 1e-6 * (1.0 + ewa),
            "{}: {alpha} for {ewa}",
            case["name"]
        );
    }
}
