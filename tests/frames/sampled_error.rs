//! Tests the picture's error measured in a sample of its tiles, and the tolerance calibrated by it,
//! against whole pictures.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::Random;
use crate::common::scene::{Particle, camera, volume};
use ewa_splat::measure::{ErrorSample, accurate};
use ewa_splat::render::Composite;
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Image, Renderer, Settings};
use glam::DVec3;

const SIZE: [usize; 2] = [200, 120];

/// Returns thousands of kernels of .5 to 8 pixels, denser on the left.
fn cloud(seed: u64) -> Renderer {
    let mut random = Random::new(seed);
    let particles: Vec<Particle> = (0..6000)
        .map(|_| {
            let ratio = random.log_range(1.0, 4.0);
            let width = random.log_range(0.004, 0.06);
            let mut position = random.point(1.0);
            position.x = 1.5 - 3.0 * position.x.abs().sqrt();
            Particle {
                position: position + DVec3::Z * 3.0,
                factor: random.factor(width, ratio),
                mass: (0.8 * width * width) as f32,
                colour: [0.9, 0.6, 0.3],
            }
        })
        .collect();
    Renderer::new(vec![volume(&particles)]).unwrap()
}

fn seen() -> Camera {
    camera(Projection::Perspective, [130.0; 2], SIZE)
}

/// Compares the picture with the whole exact frame. Returns the difference that 99.9 % of its
/// numbers stay below, and the greatest.
fn whole(renderer: &mut Renderer, settings: &Settings) -> [f32; 2] {
    let exact = renderer
        .render(&seen(), &accurate(settings))
        .unwrap()
        .clone();
    let drawn = renderer.render(&seen(), settings).unwrap();
    let numbers = exact
        .pixels
        .iter()
        .flatten()
        .zip(drawn.pixels.iter().flatten());
    let mut all: Vec<f32> = numbers.map(|(a, b)| (a - b).abs()).collect();
    all.sort_unstable_by(f32::total_cmp);
    [all[all.len() * 999 / 1000], all[all.len() - 1]]
}

#[test]
fn a_sample_errs_as_the_picture_does() {
    for (seed, tolerance) in [(1, 1.0 / 16.0), (2, 1.0 / 64.0), (3, 1.0 / 255.0)] {
        let mut renderer = cloud(seed);
        let settings = Settings {
            tolerance,
            ..Settings::default()
        };
        let image = renderer.render(&seen(), &settings).unwrap().clone();
        let sample = ErrorSample::draw(&mut renderer, &seen(), &settings).unwrap();
        let error = sample.error_of(&image);
        assert_eq!(error.tiles, 32);
        assert!(error.pixels > 30 * 256 - 32 * 128 && error.pixels <= 32 * 256);
        let [percentile, greatest] = whole(&mut renderer, &settings);
        // The whole picture has more pixels, with errors that differ as much as tiles differ from
        // each other.
        assert!(
            error.greatest <= 1.01 * greatest + 1e-6,
            "{error:?} {greatest}"
        );
        assert!(
            error.percentile_999 > 0.4 * percentile,
            "{error:?} {percentile}"
        );
        assert!(
            error.percentile_999 < 2.5 * percentile,
            "{error:?} {percentile}"
        );
        // Tiles drawn by themselves equal those of the picture.
        let alone = sample.error_at(&mut renderer, tolerance).unwrap();
        assert!((alone.greatest - error.greatest).abs() < 0.02 * error.greatest);
    }
}

#[test]
fn a_sample_sees_what_is_wrong_and_nothing_else() {
    let mut renderer = cloud(4);
    let settings = accurate(&Settings::default());
    let mut image: Image = renderer.render(&seen(), &settings).unwrap().clone();
    let sample = ErrorSample::draw(&mut renderer, &seen(), &settings).unwrap();
    // The results agree except for the tiles' position: roundings of distances from the picture's
    // middle.
    let own = sample.error_of(&image);
    assert!(own.greatest < 2e-5, "{own:?}");
    for pixel in &mut image.pixels {
        pixel[1] += 0.25;
    }
    let shifted = sample.error_of(&image);
    assert!((shifted.percentile_999 - 0.25).abs() < 1e-4, "{shifted:?}");
    image.pixels.fill([f32::NAN; 4]);
    assert!(sample.error_of(&image).greatest.is_nan());
}

#[test]
fn a_calibrated_tolerance_keeps_the_one_that_was_asked_for() {
    for seed in 5..8 {
        let mut renderer = cloud(seed);
        let asked = Settings {
            tolerance: 1.0 / 64.0,
            ..Settings::default()
        };
        let sample = ErrorSample::draw(&mut renderer, &seen(), &asked).unwrap();
        let (tolerance, error) = sample.calibrated(&mut renderer).unwrap();
        assert!(
            tolerance > asked.tolerance,
            "{tolerance}: bounds are wide here"
        );
        assert!(error.greatest <= 0.5 * asked.tolerance);
        let next = tolerance * std::f32::consts::SQRT_2;
        let beyond = sample.error_at(&mut renderer, next).unwrap();
        assert!(beyond.greatest > 0.5 * asked.tolerance, "{beyond:?}");
        let wider = Settings { tolerance, ..asked };
        let footprints = |renderer: &Renderer| renderer.counts().splat_pixels;
        let [percentile, _] = whole(&mut renderer, &wider);
        assert!(percentile <= 1.0 / 64.0, "{seed}: {percentile}");
        let cheaper = footprints(&renderer);
        renderer
            .render(
                &seen(),
                &Settings {
                    tolerance: 1.0 / 64.0,
                    ..wider
                },
            )
            .unwrap();
        assert!(cheaper < footprints(&renderer));
    }
}

#[test]
fn layers_are_measured_in_layers_and_nothing_errs_by_nothing() {
    let mut renderer = cloud(9);
    let settings = Settings {
        composite: Composite::Slabs {
            thickness: Some(0.05),
        },
        ..Settings::default()
    };
    let image = renderer.render(&seen(), &settings).unwrap().clone();
    let sample = ErrorSample::draw(&mut renderer, &seen(), &settings).unwrap();
    let error = sample.error_of(&image);
    assert!(
        error.percentile_999 > 0.0 && error.percentile_999 < settings.tolerance,
        "{error:?}"
    );
    // The camera looks away: no tile shows anything.
    let mut away = seen();
    away.camera_from_world =
        glam::DMat3::from_rotation_y(std::f64::consts::PI) * away.camera_from_world;
    let image = renderer.render(&away, &settings).unwrap().clone();
    let sample = ErrorSample::draw(&mut renderer, &away, &settings).unwrap();
    let error = sample.error_of(&image);
    assert_eq!((error.tiles, error.pixels, error.greatest), (0, 0, 0.0));
}
