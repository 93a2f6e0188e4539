//! Tests pictures through the opening of a lens, and while a camera moves.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use ewa_splat::io::{Association, Dataset, Field, FieldSource, Geometry};
use ewa_splat::math::normal_code;
use ewa_splat::sample::{self, Motion, SampleOptions};
use ewa_splat::scene::{Colour, Particles, PointVolume, SplatRule, Strength, Values};
use ewa_splat::view::{Aperture, Camera, Projection};
use ewa_splat::{Image, Renderer, Settings};
use glam::DVec3;

use crate::common::scene::{Particle, camera, difference, volume};
use crate::common::{Random, scalar};

const FOCUS: f64 = 6.0;

fn eye() -> Camera {
    camera(Projection::Perspective, [110.0; 2], [96, 80])
}

fn through(diameter: f64, pictures: usize) -> Settings {
    Settings {
        aperture: Some(Aperture {
            diameter,
            focus: FOCUS,
            pictures,
        }),
        level_of_detail: false,
        low_pass_variance_px2: 0.3,
        ..Settings::default()
    }
}

fn draw(scene: &[PointVolume], camera: &Camera, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer.render(camera, settings).unwrap().clone()
}

/// Returns balls before, at and behind the focus, of an optical depth of about 1.
fn cloud() -> PointVolume {
    let mut random = Random::new(11);
    let balls: Vec<Particle> = (0..150)
        .map(|_| {
            let at = random.point(1.4) + DVec3::Z * (FOCUS + random.range(-2.5, 2.5));
            let sigma = random.range(0.05, 0.15);
            let colour = [0, 1, 2].map(|_| random.range(0.1, 1.0) as f32);
            let mass = random.range(2.0, 9.0) * sigma * sigma;
            Particle::sphere(at, sigma, mass).coloured(colour)
        })
        .collect();
    volume(&balls)
}

/// Sum of the opacity of a picture, its middle, and the variance about it along an axis, pixels.
fn moments(image: &Image) -> (f64, [f64; 2], f64) {
    let (mut sum, mut at, mut square) = (0.0, [0.0; 2], 0.0);
    for y in 0..image.height {
        for x in 0..image.width {
            let alpha = f64::from(image.pixel(x, y)[3]);
            sum += alpha;
            at[0] += alpha * x as f64;
            at[1] += alpha * y as f64;
            square += alpha * (x * x + y * y) as f64;
        }
    }
    let middle = at.map(|at| at / sum);
    let about = square / sum - middle[0] * middle[0] - middle[1] * middle[1];
    (sum, middle, about / 2.0)
}

/// A faint ball, out of focus: its opacity adds up as in focus, and its variance grows by that of the disc,
/// f² (diameter/4)² (1/focus - 1/z)². Parts of the opening give the same.
#[test]
fn a_ball_out_of_focus_has_the_variance_of_its_disc() {
    for z in [3.0, 4.0, FOCUS, 9.0] {
        let ball = |mass| vec![volume(&[Particle::sphere(DVec3::Z * z, 0.1, mass)])];
        let camera = eye();
        let fine = |mut settings: Settings| {
            settings.cutoff = Some(7.0);
            settings
        };
        let sharp = Settings {
            aperture: None,
            ..fine(through(0.4, 1))
        };
        let (sum, middle, variance) = moments(&draw(&ball(1e-4), &camera, &sharp));
        for pictures in [1, 64] {
            let settings = fine(through(0.4, pictures));
            let found = moments(&draw(&ball(1e-4), &camera, &settings));
            let disc = (110.0 * 0.1 * (1.0 / FOCUS - 1.0 / z)).powi(2);
            // The variance of the ball's depths adds (f s sigma / z²)².
            let deep = (110.0 * 0.1 * 0.1 / (z * z)).powi(2);
            assert!(
                (found.0 / sum - 1.0).abs() < 1e-2,
                "{z}, {pictures}: {found:?} {sum}"
            );
            for (a, b) in found.1.iter().zip(middle) {
                assert!((a - b).abs() < 0.1, "{z}, {pictures}: {a} {b}");
            }
            let off = found.2 - variance - disc - deep;
            assert!(
                off.abs() < 0.02 * (variance + disc),
                "{z}, {pictures}: {found:?} {variance} {disc}"
            );
        }
    }
}

/// The more parts the opening has, the nearer is the picture to that of 1,024 points of it.
#[test]
fn pictures_of_parts_come_near_to_those_of_points() {
    let (scene, camera) = ([cloud()], eye());
    let truth = draw(&scene, &camera, &through(0.5, 1024));
    let mut errors: Vec<(usize, f32)> = Vec::new();
    for pictures in [1, 16, 64] {
        let image = draw(&scene, &camera, &through(0.5, pictures));
        let off = |(a, b): (&[f32; 4], &[f32; 4])| {
            a.iter()
                .zip(b)
                .map(|(x, y)| (x - y).abs())
                .fold(0.0, f32::max)
        };
        let mut all: Vec<f32> = image.pixels.iter().zip(&truth.pixels).map(off).collect();
        all.sort_by(f32::total_cmp);
        errors.push((pictures, all[all.len() * 999 / 1000]));
    }
    println!("{errors:?}");
    for (found, bound) in errors.iter().zip([0.3, 0.08, 0.02]) {
        assert!(found.1 < bound, "{errors:?}");
    }
}

/// Optical depths of a sharp lens and of a tiny opening are alike, whatever the number of pictures.
#[test]
fn a_tiny_opening_is_a_point() {
    let (scene, camera) = ([cloud()], eye());
    let sharp = draw(
        &scene,
        &camera,
        &Settings {
            aperture: None,
            ..through(1.0, 1)
        },
    );
    for pictures in [1, 5] {
        let image = draw(&scene, &camera, &through(1e-6, pictures));
        assert!(difference(&image, &sharp) < 2e-3, "{pictures}");
    }
}

/// A lone splat of a radiance field keeps the sum of its opacity, by every rule. Rules end sharp splats, at three deviations or at an
/// opacity of 1/255: a twentieth of their variance lies beyond.
#[test]
fn splats_out_of_focus_keep_their_opacity_times_area() {
    for rule in [
        SplatRule::Exact,
        SplatRule::Khr,
        SplatRule::Inria,
        SplatRule::Mip,
    ] {
        let splat = PointVolume {
            colour: Colour::Uniform([1.0; 3]),
            ..PointVolume::new(
                Particles::Isotropic {
                    positions: vec![DVec3::Z * 4.0],
                    sigmas: vec![0.12],
                },
                Strength::PeakOpacity {
                    opacities: vec![0.8],
                    rule,
                    by_distance: false,
                },
            )
        };
        let settings = |pictures| Settings {
            cutoff: Some(6.0),
            ..through(0.4, pictures)
        };
        let sharp = Settings {
            aperture: None,
            ..settings(1)
        };
        let mut tiny = settings(1);
        tiny.aperture.as_mut().unwrap().diameter = 1e-6;
        let own = std::slice::from_ref(&splat);
        let pictures = [sharp, tiny].map(|settings| draw(own, &eye(), &settings));
        assert!(difference(&pictures[0], &pictures[1]) < 1e-6, "{rule:?}");
        let points = moments(&draw(std::slice::from_ref(&splat), &eye(), &settings(400)));
        let one = moments(&draw(&[splat], &eye(), &settings(1)));
        assert!(
            (one.0 / points.0 - 1.0).abs() < 0.02,
            "{rule:?}: {one:?} {points:?}"
        );
        assert!(
            (one.2 / points.2 - 1.0).abs() < 0.06,
            "{rule:?}: {one:?} {points:?}"
        );
    }
}

/// Returns a square of opaque surfels that faces the eye.
fn square(z: f64) -> PointVolume {
    let (mut positions, mut tangents, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    for y in -10..=10 {
        for x in -10..=10 {
            positions.push(DVec3::new(f64::from(x) * 0.08, f64::from(y) * 0.08, z));
            tangents.push([0.05, 0.0, 0.0, 0.0, 0.05, 0.0]);
            areas.push(0.0064);
        }
    }
    let normals = vec![normal_code(-DVec3::Z); positions.len()];
    PointVolume {
        normals: Some(normals),
        ..PointVolume::new(
            Particles::Surfels {
                positions,
                tangents,
                is_one_sided: false,
            },
            Strength::Surface(areas),
        )
    }
}

#[test]
fn surfaces_are_blurred_by_several_pictures() {
    let (scene, camera) = ([square(3.5)], eye());
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    let error = renderer.render(&camera, &through(0.4, 1)).unwrap_err();
    assert!(error.to_string().contains("more than one"), "{error}");
    let sharp = Settings {
        aperture: None,
        ..through(0.4, 1)
    };
    let sharp = draw(&scene, &camera, &sharp);
    let image = draw(&scene, &camera, &through(0.4, 64));
    // Half of an edge's light comes from beyond it: the area stays.
    let (whole, found) = (moments(&sharp), moments(&image));
    assert!(
        (found.0 / whole.0 - 1.0).abs() < 5e-3,
        "{found:?} {whole:?}"
    );
    let partly = |image: &Image| {
        let is_part = |p: &&[f32; 4]| p[3] > 0.1 && p[3] < 0.9;
        image.pixels.iter().filter(is_part).count()
    };
    let counts = [partly(&image), partly(&sharp)];
    assert!(2 * counts[0] > 3 * counts[1], "{counts:?}");
}

#[test]
fn an_exposure_is_the_mean_of_its_cameras() {
    let scene = [cloud()];
    let at = |x: f64| Camera {
        eye: DVec3::X * x,
        ..eye()
    };
    let cameras: Vec<Camera> = (0..3).map(|i| at(0.05 * f64::from(i))).collect();
    let settings = Settings {
        aperture: None,
        background: Some([0.1, 0.2, 0.3]),
        ..through(1.0, 1)
    };
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    let mean = renderer
        .render_exposure(&cameras, &settings)
        .unwrap()
        .clone();
    let each: Vec<Image> = cameras
        .iter()
        .map(|own| draw(&scene, own, &settings))
        .collect();
    for (i, pixel) in mean.pixels.iter().enumerate() {
        for (c, channel) in pixel.iter().enumerate() {
            let sum: f32 = each.iter().map(|image| image.pixels[i][c]).sum();
            assert!((channel - sum / 3.0).abs() < 1e-6);
        }
    }
    assert!(renderer.render_exposure(&[], &settings).is_err());
    let small = Camera {
        width: 5,
        ..at(0.0)
    };
    assert!(
        renderer
            .render_exposure(&[at(0.0), small], &settings)
            .is_err()
    );
    let depths = Settings {
        depth: true,
        ..settings
    };
    assert!(renderer.render_exposure(&cameras, &depths).is_err());
}

/// Kernels that an eye looks out of, on either side of the plane of the eye, end in numbers.
#[test]
fn kernels_around_the_eye_are_drawn() {
    let mut random = Random::new(4);
    let balls: Vec<Particle> = (0..40)
        .map(|_| Particle::sphere(random.point(0.6), random.range(0.05, 0.8), 0.02))
        .collect();
    for pictures in [1, 3] {
        let image = draw(&[volume(&balls)], &eye(), &through(0.7, pictures));
        let is_sound = |x: &f32| (0.0..=1.0).contains(x);
        assert!(image.pixels.as_flattened().iter().all(is_sound));
        assert!(moments(&image).0 > 10.0);
    }
}

#[cfg(feature = "gpu")]
#[test]
fn both_back_ends_blur_alike() {
    use crate::common::gpu::{assert_alike, gpu};
    if gpu().is_none() {
        return;
    }
    let camera = camera(Projection::Perspective, [60.0; 2], [48, 40]);
    let splats = PointVolume {
        colour: Colour::Uniform([1.0, 0.5, 0.2]),
        ..PointVolume::new(
            Particles::Isotropic {
                positions: (0..12)
                    .map(|i| DVec3::new(0.2 * f64::from(i) - 1.2, 0.1, 3.0 + 0.4 * f64::from(i)))
                    .collect(),
                sigmas: vec![0.12; 12],
            },
            Strength::PeakOpacity {
                opacities: vec![0.7; 12],
                rule: SplatRule::Inria,
                by_distance: false,
            },
        )
    };
    let mut random = Random::new(4);
    let near: Vec<Particle> = (0..12)
        .map(|_| Particle::sphere(random.point(0.6), random.range(0.05, 0.5), 0.02))
        .collect();
    for (name, scene) in [
        ("cloud", cloud()),
        ("splats", splats),
        ("near", volume(&near)),
    ] {
        assert_alike(name, &scene, &camera, &through(0.4, 1));
    }
    assert_alike("cloud, three", &cloud(), &camera, &through(0.4, 3));
}

/// Returns balls on a disc that turns about the line of sight, displaced by a share of the way that each goes at its velocity.
fn turning(share: f64, motion: Option<Motion>) -> PointVolume {
    let mut random = Random::new(23);
    let count = 60;
    let places: Vec<DVec3> = (0..count)
        .map(|_| random.point(1.2) + DVec3::Z * FOCUS)
        .collect();
    let velocities: Vec<DVec3> = places.iter().map(|x| DVec3::new(-x.y, x.x, 0.3)).collect();
    let moved = places.iter().zip(&velocities);
    let positions = moved.map(|(x, v)| *x + share * *v).collect();
    let mut column = |name: &str, low: f64, high: f64| {
        let values = (0..count).map(|_| random.range(low, high) as f32).collect();
        scalar(name, Association::Nodes, values)
    };
    let mut fields = vec![
        column("sigma", 0.04, 0.12),
        column("mass", 1e-3, 6e-3),
        column("r", 0.0, 1.0),
        column("g", 0.0, 1.0),
        column("b", 0.0, 1.0),
    ];
    let axis =
        |of: fn(&DVec3) -> f64| Values::F32(velocities.iter().map(|v| of(v) as f32).collect());
    fields.push(Field {
        name: "speed".into(),
        association: Association::Nodes,
        source: FieldSource::Vector(vec![axis(|v| v.x), axis(|v| v.y), axis(|v| v.z)]),
        unit: None,
    });
    let dataset = Dataset::new(
        Path::new("turning"),
        "test",
        Geometry::Points { positions },
        fields,
    );
    let options = SampleOptions {
        motion,
        ..SampleOptions::default()
    };
    sample::volume(dataset, &options).unwrap().volume
}

/// Particles that are drawn out along their ways, against the mean of 256 pictures of places on these ways.
#[test]
fn streaks_are_means_of_moments() {
    let camera = eye();
    let settings = Settings {
        aperture: None,
        ..through(1.0, 1)
    };
    for time in [0.05, 0.2, 0.8] {
        let mut mean = vec![[0.0_f32; 4]; 96 * 80];
        for i in 0..256 {
            let share = time * ((f64::from(i) + 0.5) / 256.0 - 0.5);
            let image = draw(&[turning(share, None)], &camera, &settings);
            for (sum, pixel) in mean.iter_mut().zip(&image.pixels) {
                for (sum, channel) in sum.iter_mut().zip(pixel) {
                    *sum += channel / 256.0;
                }
            }
        }
        let motion = |field: &str| Motion {
            field: field.into(),
            time,
        };
        let streaks = turning(0.0, Some(motion("speed")));
        let parts = streaks.particles.len();
        let image = draw(&[streaks], &camera, &settings);
        let off = |(a, b): (&[f32; 4], &[f32; 4])| {
            a.iter()
                .zip(b)
                .map(|(x, y)| (x - y).abs())
                .fold(0.0, f32::max)
        };
        let mut all: Vec<f32> = image.pixels.iter().zip(&mean).map(off).collect();
        all.sort_by(f32::total_cmp);
        let error = all[all.len() * 999 / 1000];
        println!("{time}: {parts} kernels of 60 particles, {error:.4}");
        // Optical depths are averaged, not opacities, which makes streaks of opaque balls too dense.
        assert!(error < 0.05, "{time}: {error}");
    }
}
