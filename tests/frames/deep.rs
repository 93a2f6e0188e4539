//! Tests deep images: what stands at any depth in them, and their own depths.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::sync::Arc;

use ewa_splat::image::DepthOf;
use ewa_splat::math::normal_cdf;
use ewa_splat::render::{Advanced, Backdrop, SimdLevel};
use ewa_splat::scene::PointVolume;
use ewa_splat::view::Projection;
use ewa_splat::{Composite, DepthImage, Renderer, Settings};
use glam::{DVec2, DVec3};

use crate::backdrop::{SIZE, cloud, eye, sheet};
use crate::common::Random;
use crate::common::scene::difference;

fn settings(tolerance: f32) -> Settings {
    Settings {
        tolerance,
        low_pass_variance_px2: 0.15,
        advanced: Advanced {
            simd: SimdLevel::Baseline,
            opaque_edges: false,
            ..Advanced::default()
        },
        ..Settings::default()
    }
}

#[test]
fn what_is_put_into_a_deep_image_looks_as_if_it_were_drawn_with_it() {
    for (projection, composite, has_surface) in [
        (Projection::Perspective, Composite::Over, false),
        (Projection::Perspective, Composite::Over, true),
        (
            Projection::Orthographic,
            Composite::SLABS.with_thickness(Some(0.3)),
            true,
        ),
    ] {
        let tolerance = 1.0 / 64.0;
        let settings = Settings {
            composite,
            ..settings(tolerance)
        };
        let camera = eye(projection);
        let mut scene = vec![cloud()];
        scene.extend(has_surface.then(sheet));
        let mut renderer = Renderer::new(scene).unwrap();
        let whole = renderer.render(&camera, &settings).unwrap().clone();
        let deep = renderer.render_deep(&camera, &settings).unwrap();
        let pixels = SIZE[0] * SIZE[1];
        println!(
            "{projection:?}: {} samples of {pixels} pixels",
            deep.samples.len()
        );
        // A frame ends early in tiles that are opaque to within a share of the tolerance, one with ends later.
        let most = difference(&deep.flat(), &whole);
        println!("flat: {most:e}");
        assert!(most < 0.1 * tolerance, "{most}");
        assert_eq!(renderer.image(), &whole);
        for pair in (0..pixels).map(|i| deep.pixel(i % SIZE[0], i / SIZE[0])) {
            assert!(pair.windows(2).all(|two| two[0].back <= two[1].front));
            assert!(
                pair.iter()
                    .all(|s| s.front <= s.back && (0.0..=1.0).contains(&s.rgba[3]))
            );
        }
        // Each pixel has a depth of its own, anywhere.
        let mut random = Random::new(5);
        let mut errors = Vec::new();
        for _ in 0..6 {
            let depth = DepthImage {
                width: SIZE[0],
                height: SIZE[1],
                depths: (0..pixels).map(|_| random.range(4.0, 8.0) as f32).collect(),
            };
            let ended = Settings {
                backdrop: Some(Arc::new(Backdrop::new(depth.clone()).unwrap())),
                ..settings.clone()
            };
            let truth = renderer.render(&camera, &ended).unwrap();
            let own = deep.before(&depth).unwrap();
            errors.extend(truth.pixels.iter().zip(&own.pixels).map(|(a, b)| {
                let channels = a.iter().zip(b);
                channels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            }));
        }
        errors.sort_by(f32::total_cmp);
        let (most, worst) = (errors[errors.len() * 999 / 1000], errors[errors.len() - 1]);
        println!("{projection:?}, {composite:?}: 99.9 % within {most:e}, {worst:e}");
        assert!(most <= tolerance, "{most}");
    }
}

#[test]
fn depths_of_one_kernel_are_those_of_its_gaussian() {
    let (sigma, z) = (0.4_f32, 6.0);
    let camera = eye(Projection::Orthographic);
    let kernel = PointVolume::spheres([DVec3::Z * z], [sigma]).with_masses([1.6]);
    let mut renderer = Renderer::new(vec![kernel]).unwrap();
    let settings = Settings {
        low_pass_variance_px2: 0.0,
        cutoff: Some(7.0),
        ..settings(1e-3)
    };
    let deep = renderer.render_deep(&camera, &settings).unwrap();
    let all = [
        DepthOf::Half,
        DepthOf::Entry,
        DepthOf::Exit,
        DepthOf::Median,
        DepthOf::Mean,
    ];
    let depths = all.map(|of| deep.depth(of));
    let cuts = [5.2, 6.1];
    let left = cuts.map(|cut| deep.transmittance(cut));
    for (x, y) in [(24, 20), (27, 21), (31, 25), (0, 0)] {
        let at = DVec2::new(x as f64, y as f64) + 0.5;
        let r2 = ((at - camera.centre_px) / camera.focal_px).length_squared();
        let s2 = f64::from(sigma * sigma);
        let tau = 1.6 * (-0.5 * r2 / s2).exp() / (std::f64::consts::TAU * s2);
        let i = y * SIZE[0] + x;
        let opacity = |depth: f64| {
            let share = normal_cdf(((depth - z) / f64::from(sigma)).clamp(-30.0, 30.0) as f32);
            -(-tau * f64::from(share)).exp_m1()
        };
        for (cut, left) in cuts.iter().zip(&left) {
            let expected = 1.0 - opacity(f64::from(*cut));
            assert!((f64::from(left[i]) - expected).abs() < 1e-3);
        }
        let whole = opacity(1e3);
        // Where an opacity is reached, by bisection.
        let reached = |wanted: f64| {
            let mut range = [z - 4.0, z + 4.0];
            for _ in 0..60 {
                let middle = 0.5 * (range[0] + range[1]);
                range[usize::from(opacity(middle) >= wanted)] = middle;
            }
            range[0]
        };
        let steps = 20_000;
        let mean: f64 = (0..steps)
            .map(|n| {
                let [a, b] = [n, n + 1].map(|n| z - 4.0 + 8.0 * f64::from(n) / f64::from(steps));
                0.5 * (a + b) * (opacity(b) - opacity(a))
            })
            .sum();
        if whole < 0.01 {
            continue;
        }
        let half = if whole > 0.5 {
            reached(0.5)
        } else {
            f64::INFINITY
        };
        let rim = whole / 256.0;
        let expected = [
            half,
            reached(rim),
            reached(whole - rim),
            reached(0.5 * whole),
            mean / whole,
        ];
        for ((of, depth), expected) in all.iter().zip(&depths).zip(expected) {
            let found = f64::from(depth.depths[i]);
            // Entry and exit lie where a depth changes opacity by less than the tolerance.
            let most = match of {
                DepthOf::Entry | DepthOf::Exit => 0.2,
                _ => 0.01,
            };
            let is_right = found == expected || (found - expected).abs() < most;
            assert!(is_right, "{of:?} at {x}, {y}: {found}, {expected}");
        }
    }
    let empty = deep.depth(DepthOf::Mean).depths[0];
    assert!(empty == f32::INFINITY || deep.pixel(0, 0)[0].rgba[3] < 1e-3);
}

#[test]
fn surfaces_are_samples_without_extent() {
    let camera = eye(Projection::Perspective);
    let mut renderer = Renderer::new(vec![sheet()]).unwrap();
    let settings = Settings {
        depth: true,
        ..settings(1.0 / 64.0)
    };
    renderer.render(&camera, &settings).unwrap();
    let depth = renderer.depth().unwrap().clone();
    let deep = renderer.render_deep(&camera, &settings).unwrap();
    let mut inside = 0;
    for (i, depth) in depth.depths.iter().enumerate() {
        let samples = deep.pixel(i % SIZE[0], i / SIZE[0]);
        if let ([sample], true) = (samples, *depth < f32::INFINITY) {
            assert_eq!(sample.front, sample.back);
            assert!(
                (sample.front / depth - 1.0).abs() < 3e-4,
                "{sample:?}, {depth}"
            );
            inside += 1;
        }
    }
    assert!(inside > 300, "{inside}");
}
