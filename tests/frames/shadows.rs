//! Tests laws of shadows: transmittances in closed form, edges, what is kept from frame to frame, and both
//! back ends against each other and against single scattering in f64.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;

use crate::common::Random;
use crate::common::gpu::{ALIKE, gpu};
use ewa_splat::math::normal_code;
use ewa_splat::reference::Integrator;
use ewa_splat::render::{Advanced, SimdLevel};
use ewa_splat::scene::{
    Colour, Lattice, Light, LightFrame, Lighting, Particles, PointVolume, Shadows, Strength,
    TransferFunction,
};
use ewa_splat::view::{Camera, ClipPlane};
use ewa_splat::{Classification, Composite, Image, Renderer, Settings};
use glam::{DVec2, DVec3};

/// Light from above that is all that shows.
fn from_above(softness_deg: Option<f64>) -> Lighting {
    Lighting {
        lights: vec![Light {
            direction: DVec3::Z,
            frame: LightFrame::World,
            colour: [1.0; 3],
        }],
        ambient: 0.0,
        diffuse: 1.0,
        specular: 0.0,
        shadows: softness_deg.map(|softness_deg| Shadows { softness_deg }),
        ..Lighting::default()
    }
}

fn settings(lighting: Lighting) -> Settings {
    Settings {
        lighting: Some(lighting),
        ..Settings::default()
    }
}

/// Returns the camera at y = -10 that sees x to the right and z upwards; `height` world units are 65 pixels.
fn side(height: f64) -> Camera {
    Camera::orthographic(DVec3::Y * -10.0, DVec3::ZERO, DVec3::Z, height, [65; 2])
}

/// Returns white spheres with normals upwards.
fn spheres(of: &[(DVec3, f64, f64)]) -> PointVolume {
    let up = normal_code(DVec3::Z);
    let mass = |(_, sigma, depth): &(DVec3, f64, f64)| (depth * TAU * sigma * sigma) as f32;
    PointVolume {
        normals: Some(vec![up; of.len()]),
        colour: Colour::Uniform([1.0; 3]),
        ..PointVolume::spheres(
            of.iter().map(|(p, ..)| *p).collect::<Vec<_>>(),
            of.iter()
                .map(|(_, sigma, _)| *sigma as f32)
                .collect::<Vec<_>>(),
        )
        .with_masses(of.iter().map(mass).collect::<Vec<_>>())
    }
}

/// Returns a square of opaque surfels in the plane z = `z`, facing upwards; `half` is half its side.
fn square(middle: DVec3, half: f64, count: usize) -> PointVolume {
    let step = 2.0 * half / count as f64;
    let at = |n: usize| (n as f64 + 0.5) * step - half;
    let positions: Vec<DVec3> = (0..count * count)
        .map(|n| middle + DVec3::new(at(n % count), at(n / count), 0.0))
        .collect();
    let sigma = (0.6 * step) as f32;
    PointVolume {
        colour: Colour::Uniform([1.0; 3]),
        ..PointVolume::new(
            Particles::Surfels {
                tangents: vec![[sigma, 0.0, 0.0, 0.0, sigma, 0.0]; positions.len()],
                positions,
                is_one_sided: false,
            },
            Strength::Surface(vec![(step * step) as f32; count * count]),
        )
    }
}

fn draw(scene: &[PointVolume], camera: &Camera, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer.render(camera, settings).unwrap().clone()
}

/// Returns the ratio of a pixel's light with and without shadows.
fn passed(scene: &[PointVolume], camera: &Camera, pixel: [usize; 2], softness_deg: f64) -> f64 {
    let shaded = draw(scene, camera, &settings(from_above(Some(softness_deg))));
    let plain = draw(scene, camera, &settings(from_above(None)));
    let [x, y] = pixel;
    f64::from(shaded.pixel(x, y)[1] / plain.pixel(x, y)[1])
}

#[test]
fn a_kernel_shades_the_kernel_below_it() {
    for depth in [0.1, 1.0, 4.0] {
        let scene = [spheres(&[
            (DVec3::Z * 2.0, 0.3, depth),
            (DVec3::Z * -2.0, 0.1, 1e-3),
        ])];
        // Two units are 13 pixels.
        let passed = passed(&scene, &side(10.0), [32, 45], 0.0);
        // The mean over the receiver: half its squared radius, in deviations, is distributed exponentially, and the
        // depth falls by exp(-e/9) where that is e.
        let expected: f64 = (0..4000)
            .map(|n| (n as f64 + 0.5) * 0.005)
            .map(|e| 0.005 * (-e - depth * (-e / 9.0).exp()).exp())
            .sum();
        // Six places stand for the receiver, and lines between cells for the occluder.
        assert!(
            (passed - expected).abs() < 0.03,
            "{depth}: {passed} {expected}"
        );
    }
}

#[test]
fn light_falls_exponentially_in_a_slab() {
    let n = 33;
    let lattice = Lattice::uniform(
        [n; 3],
        DVec3::splat(-1.0),
        DVec3::splat(2.0 / (n - 1) as f64),
    );
    // Half of the light passes a unit.
    let grey = TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, [0.0, 1.0], 1.0).unwrap();
    let mut volume = PointVolume::lattice(lattice, vec![0.5_f32; n * n * n], grey);
    volume.normals = Some(vec![normal_code(DVec3::Z); n * n * n]);
    let per_unit = {
        let values = volume.transfer_function.as_ref().unwrap();
        f64::from(values.classify(0.5)[3])
    };
    let camera = side(2.6);
    for pixel in [24, 32, 40] {
        // Depth below the top at z = 1; 25 pixels are a unit.
        let z = (32.0 - pixel as f64) / 25.0;
        let passed = passed(&[volume.clone()], &camera, [32, pixel], 0.0);
        let expected = (-per_unit * (1.0 - z)).exp();
        // The lattice's kernels end half a spacing beyond its faces, 3 % of the depth.
        assert!(
            (passed / expected - 1.0).abs() < 0.07,
            "{z}: {passed} {expected}"
        );
    }
}

#[test]
fn a_surface_hides_the_light_of_what_lies_below_and_nothing_else() {
    let mut scene = vec![spheres(&[
        (DVec3::new(0.0, 0.0, -2.0), 0.1, 1e-3),
        (DVec3::new(0.0, 0.0, 3.0), 0.1, 1e-3),
        (DVec3::new(3.0, 0.0, -2.0), 0.1, 1e-3),
    ])];
    scene.push(square(DVec3::Z, 1.5, 30));
    let camera = side(10.0);
    assert_eq!(passed(&scene, &camera, [32, 45], 0.0), 0.0);
    // Above the surface, and beside it.
    for pixel in [[32, 13], [51, 45]] {
        let own = passed(&scene, &camera, pixel, 0.0);
        assert!(own > 0.97, "{pixel:?}: {own}");
    }
}

/// Returns the share of light along a row of pixels on a large square below a small one, seen from above at
/// a slant, and the world's x of each.
fn profile(softness_deg: f64) -> Vec<(f64, f64)> {
    let scene = [
        square(DVec3::ZERO, 4.0, 160),
        square(DVec3::new(0.0, 0.0, 1.0), 1.0, 40),
    ];
    // From the side, so that the small square hides nothing of the row.
    let eye = DVec3::new(0.0, -10.0, 5.0);
    let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 5.0, [129; 2]);
    let shaded = draw(&scene, &camera, &settings(from_above(Some(softness_deg))));
    let plain = draw(&scene, &camera, &settings(from_above(None)));
    let x = |pixel: usize| (pixel as f64 - 64.0) * 5.0 / 129.0;
    (0..129)
        .map(|i| {
            let ratio = shaded.pixel(i, 64)[1] / plain.pixel(i, 64)[1];
            (x(i), f64::from(ratio))
        })
        .collect()
}

#[test]
fn a_surface_casts_a_sharp_shadow_on_a_surface_without_acne() {
    for (x, ratio) in profile(0.0) {
        // A surfel of the receiver is .05 wide, a texel .03, a pixel of the filter .04.
        if x.abs() < 0.85 {
            assert!(ratio < 0.01, "{x}: {ratio}");
        } else if x.abs() > 1.15 {
            assert!(ratio > 0.999, "{x}: {ratio}");
        }
    }
    // The edge lies where the square's does.
    let width: f64 = profile(0.0)
        .iter()
        .map(|(_, ratio)| (1.0 - ratio) * 5.0 / 129.0)
        .sum();
    assert!((width - 2.0).abs() < 0.06, "{width}");
}

#[test]
fn soft_shadows_blur_with_distance_and_keep_their_area() {
    let soft = profile(6.0);
    let width: f64 = soft
        .iter()
        .map(|(_, ratio)| (1.0 - ratio) * 5.0 / 129.0)
        .sum();
    assert!((width - 2.0).abs() < 0.1, "{width}");
    // The edge is the normal distribution of standard deviation tan 6° = .105.
    let at = |wanted: f64| {
        let near = |pair: &&(f64, f64)| (pair.0 - wanted).abs() < 0.02;
        soft.iter().find(near).unwrap().1
    };
    // Sixteen directions: steps of 1/16.
    for (x, expected) in [(0.895, 0.16), (1.0, 0.5), (1.105, 0.84)] {
        let own = at(x);
        assert!((own - expected).abs() < 0.13, "{x}: {own} {expected}");
    }
}

#[test]
fn planes_at_any_angle_to_the_light_have_no_acne() {
    for degrees in [0.0_f64, 20.0, 45.0, 60.0, 75.0, 82.0] {
        let scene = [square(DVec3::ZERO, 3.0, 120)];
        let angle = degrees.to_radians();
        let mut lighting = from_above(Some(0.0));
        lighting.lights[0].direction = DVec3::new(angle.sin(), 0.3 * angle.sin(), angle.cos());
        let plain = Lighting {
            shadows: None,
            ..lighting.clone()
        };
        let camera = Camera::perspective(
            DVec3::new(2.0, -6.0, 5.0),
            DVec3::ZERO,
            DVec3::Z,
            30.0,
            [64; 2],
        );
        let shaded = draw(&scene, &camera, &settings(lighting));
        let plain = draw(&scene, &camera, &settings(plain));
        assert_eq!(shaded.pixels, plain.pixels, "{degrees}");
    }
}

#[test]
fn a_ball_has_shadow_where_it_faces_away_alone() {
    // Surfels along a spiral; normals of the ball and of planes are the same.
    let count = 6_000;
    let turn = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let positions: Vec<DVec3> = (0..count)
        .map(|n| {
            let z = 1.0 - (2.0 * n as f64 + 1.0) / count as f64;
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * (turn * n as f64).cos(), r * (turn * n as f64).sin(), z)
        })
        .collect();
    let area = 2.0 * TAU / count as f64;
    let sigma = 0.6 * area.sqrt();
    let tangents = positions
        .iter()
        .map(|p| {
            let (a, b) = p.any_orthonormal_pair();
            let (a, b) = ((a * sigma).as_vec3(), (b * sigma).as_vec3());
            [a.x, a.y, a.z, b.x, b.y, b.z]
        })
        .collect();
    let ball = PointVolume {
        colour: Colour::Uniform([1.0; 3]),
        ..PointVolume::new(
            Particles::Surfels {
                positions,
                tangents,
                is_one_sided: true,
            },
            Strength::Surface(vec![area as f32; count]),
        )
    };
    let camera = Camera::perspective(
        DVec3::new(1.0, -5.0, 2.0),
        DVec3::ZERO,
        DVec3::Z,
        30.0,
        [96; 2],
    );
    let shaded = draw(
        std::slice::from_ref(&ball),
        &camera,
        &settings(from_above(Some(0.0))),
    );
    let plain = draw(&[ball], &camera, &settings(from_above(None)));
    let mut worst = 0.0_f32;
    for (a, b) in shaded.pixels.iter().zip(&plain.pixels) {
        worst = worst.max((a[1] - b[1]).abs());
    }
    // A convex body shades nothing of itself that faces the light; at the terminator, where the cosine is below
    // a texel of the radius, the map may.
    assert!(worst < 0.05, "{worst}");
}

/// Returns a scene of kernels, some opaque, in which a surface stands.
fn mixed() -> Vec<PointVolume> {
    let mut random = Random::new(7);
    let kernels: Vec<(DVec3, f64, f64)> = (0..300)
        .map(|_| {
            let depth = random.range(0.05, 1.0);
            (random.point(1.0), random.range(0.08, 0.2), depth)
        })
        .collect();
    let mut volume = spheres(&kernels);
    let normals = kernels.iter().map(|(p, ..)| normal_code(*p));
    volume.normals = Some(normals.collect());
    vec![volume, square(DVec3::new(0.2, 0.1, -0.3), 0.7, 40)]
}

fn view_of_mixed() -> Camera {
    let eye = DVec3::new(2.0, -5.0, 2.5);
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 32.0, [48; 2])
}

/// Returns the reference image.
fn truth(integrator: &Integrator, camera: &Camera, lighting: &Lighting, low_pass: f64) -> Image {
    let pixels: Vec<[usize; 2]> = (0..camera.width * camera.height)
        .map(|i| [i % camera.width, i / camera.width])
        .collect();
    let all = integrator
        .lit_pixels(camera, lighting, low_pass, &pixels)
        .unwrap();
    let mut image = Image::new(camera.width, camera.height);
    for (pixel, own) in image.pixels.iter_mut().zip(all) {
        *pixel = own.map(|c| c as f32);
    }
    image
}

/// Returns the root mean square and the 99.9th percentile of the differences of pixels.
fn differences(a: &Image, b: &Image) -> [f64; 2] {
    let difference = |(a, b): (&[f32; 4], &[f32; 4])| {
        (0..3).fold(0.0_f64, |most, c| most.max(f64::from((a[c] - b[c]).abs())))
    };
    let mut all: Vec<f64> = a.pixels.iter().zip(&b.pixels).map(difference).collect();
    all.sort_by(f64::total_cmp);
    let squares: f64 = all.iter().map(|e| e * e).sum();
    let count = all.len();
    [(squares / count as f64).sqrt(), all[count * 999 / 1000]]
}

#[test]
fn pictures_come_near_single_scattering() {
    let scene = mixed();
    let camera = Camera {
        width: 32,
        height: 32,
        focal_px: view_of_mixed().focal_px * (32.0 / 48.0),
        centre_px: DVec2::splat(16.0),
        ..view_of_mixed()
    };
    for (softness, rms, most) in [(None, 0.01, 0.07), (Some(0.0), 0.045, 0.18)] {
        let lighting = Lighting {
            ambient: 0.1,
            ..from_above(softness)
        };
        let narrow = Settings {
            low_pass_variance_px2: 0.1,
            ..settings(lighting.clone())
        };
        let ours = draw(&scene, &camera, &narrow);
        let integrator = Integrator::new(&scene).unwrap();
        let truth = truth(&integrator, &camera, &lighting, 0.1);
        let [rmse, percentile] = differences(&ours, &truth);
        println!("softness {softness:?}: {rmse:.2e}, {percentile:.2e}");
        assert!(
            rmse < rms && percentile < most,
            "{softness:?}: {rmse} {percentile}"
        );
    }
}

#[test]
fn the_reference_agrees_with_closed_forms() {
    // A kernel under another: the light of the lower one falls by exp(-tau).
    for depth in [0.3, 2.0] {
        let scene = [spheres(&[
            (DVec3::Z * 2.0, 0.5, depth),
            (DVec3::Z * -2.0, 0.01, 1e-3),
        ])];
        let camera = side(10.0);
        let integrator = Integrator::new(&scene).unwrap();
        let light = |softness: Option<f64>| {
            let light = from_above(softness);
            integrator
                .lit_pixels(&camera, &light, 0.01, &[[32, 45]])
                .unwrap()[0][1]
        };
        let passed = light(Some(0.0)) / light(None);
        // The receiver's width is .0004 of the occluder's variance.
        assert!((passed - (-depth).exp()).abs() < 2e-3, "{passed}");
    }
    // An unlit picture is that of the integrator without light.
    let scene = mixed();
    let unlit: Vec<PointVolume> = scene
        .iter()
        .map(|volume| PointVolume {
            normals: None,
            ..volume.clone()
        })
        .take(1)
        .collect();
    let integrator = Integrator::new(&unlit).unwrap();
    let camera = view_of_mixed();
    let ours = truth(&integrator, &camera, &from_above(Some(0.0)), 1.0);
    let kernels = ewa_splat::reference::ReferenceSettings {
        pixel_filter: ewa_splat::reference::PixelFilter::Kernels,
        ..Default::default()
    };
    let theirs = integrator.render(&camera, &kernels).unwrap();
    let [_, percentile] = differences(&ours, &theirs.image);
    assert!(percentile < 3e-4, "{percentile}");
}

#[test]
fn shadows_are_kept_while_nothing_changes() {
    let scene = mixed();
    let mut renderer = Renderer::new(scene).unwrap();
    let sharp = settings(from_above(Some(0.0)));
    let camera = view_of_mixed();
    let mut time = |camera: &Camera, settings: &Settings| {
        renderer.render(camera, settings).unwrap();
        renderer.times().shadow
    };
    assert!(time(&camera, &sharp) > 0.0);
    assert_eq!(time(&camera, &sharp), 0.0);
    // A light of the world stays when the camera moves; a light of the camera does not.
    let other = Camera::perspective(DVec3::Y * -6.0, DVec3::ZERO, DVec3::Z, 30.0, [40; 2]);
    assert_eq!(time(&other, &sharp), 0.0);
    let clipped = Settings {
        clip: vec![ClipPlane {
            normal: DVec3::X,
            distance: 0.2,
        }],
        ..sharp.clone()
    };
    assert!(time(&other, &clipped) > 0.0);
    assert!(time(&other, &settings(from_above(Some(2.0)))) > 0.0);
    let mut of_camera = from_above(Some(2.0));
    of_camera.lights[0].frame = LightFrame::Camera;
    assert!(time(&other, &settings(of_camera.clone())) > 0.0);
    assert_eq!(time(&other, &settings(of_camera.clone())), 0.0);
    assert!(time(&camera, &settings(of_camera)) > 0.0);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let scene = mixed();
    let camera = view_of_mixed();
    let settings = settings(from_above(Some(3.0)));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| draw(&scene, &camera, &settings))
    };
    let one = with(1);
    for threads in [2, 5] {
        let bits = |image: &Image| -> Vec<u32> {
            image.pixels.iter().flatten().map(|c| c.to_bits()).collect()
        };
        assert_eq!(bits(&one), bits(&with(threads)), "{threads}");
    }
}

#[test]
fn both_back_ends_cast_the_same_shadows() {
    let Some(gpu) = gpu() else { return };
    let mut scene = mixed();
    // A lattice whose function shows a thin shell: kernels become pieces.
    let n = 17;
    let lattice = Lattice::uniform(
        [n; 3],
        DVec3::splat(-1.0),
        DVec3::splat(2.0 / (n - 1) as f64),
    );
    let value = |i: usize| {
        let at = [i % n, i / n % n, i / (n * n)].map(|k| k as f64 * 2.0 / (n - 1) as f64 - 1.0);
        DVec3::from(at).length() as f32
    };
    let shell = |v: f32| if (v - 0.6).abs() < 0.05 { 1.0 } else { 0.0 };
    let function =
        TransferFunction::from_curves(|_| [0.9, 0.8, 0.3], shell, [0.0, 1.8], 8.0).unwrap();
    let mut volume = PointVolume::lattice(
        lattice,
        (0..n * n * n).map(value).collect::<Vec<_>>(),
        function,
    );
    volume.normals = Some(
        (0..n * n * n)
            .map(|i| {
                let at = [i % n, i / n % n, i / (n * n)];
                normal_code(DVec3::from(
                    at.map(|k| k as f64 * 2.0 / (n - 1) as f64 - 1.0),
                ))
            })
            .collect(),
    );
    scene.push(volume);
    let camera = view_of_mixed();
    for softness in [0.0, 4.0] {
        for classify in [Classification::Extent, Classification::Particle] {
            let mut lighting = from_above(Some(softness));
            lighting.lights.push(Light {
                direction: DVec3::new(-0.5, -0.4, -1.0),
                frame: LightFrame::Camera,
                colour: [0.5, 0.2, 0.1],
            });
            let settings = Settings {
                classify,
                advanced: Advanced {
                    simd: SimdLevel::Baseline,
                    ..Advanced::default()
                },
                ..settings(lighting)
            };
            let on_cpu = draw(&scene, &camera, &settings);
            let mut renderer = Renderer::new(scene.clone()).unwrap();
            renderer = renderer.on(gpu.clone()).unwrap();
            let on_device = renderer.render(&camera, &settings).unwrap();
            let pairs = on_cpu
                .pixels
                .iter()
                .flatten()
                .zip(on_device.pixels.iter().flatten());
            let mut all: Vec<f32> = pairs.map(|(a, b)| (a - b).abs()).collect();
            all.sort_by(f32::total_cmp);
            let worst = all[all.len() - 1];
            println!("softness {softness}, {classify:?}: {worst:.1e}");
            assert!(worst <= ALIKE, "{softness} {classify:?}: {worst}");
        }
    }
}

#[test]
fn what_is_not_built_is_refused() {
    let scene = mixed();
    let camera = view_of_mixed();
    let mut renderer = Renderer::new(scene).unwrap();
    let mut refused =
        |settings: &Settings| renderer.render(&camera, settings).unwrap_err().to_string();
    let slabs = Settings {
        composite: Composite::SLABS,
        classify: Classification::Slab,
        ..settings(from_above(Some(0.0)))
    };
    let error = refused(&slabs);
    assert!(error.contains("shadows"), "{error}");
    for softness in [-1.0, 16.0, f64::NAN, f64::INFINITY] {
        let error = refused(&settings(from_above(Some(softness))));
        assert!(error.contains("softness"), "{error}");
    }
}
