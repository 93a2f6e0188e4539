//! Tests pictures in which something stands already: rays end at the depths of a backdrop, and its colours stand
//! behind the scene.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::sync::Arc;

use ewa_splat::image::{linear_from_srgb, srgb_from_linear};
use ewa_splat::math::normal_cdf;
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceSettings};
use ewa_splat::render::{Advanced, Backdrop, Blend, SimdLevel};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Composite, DepthImage, Image, Renderer, SceneOptions, Settings};
use glam::{DVec2, DVec3};

use crate::common::Random;
use crate::common::scene::{camera, difference};

pub(crate) const SIZE: [usize; 2] = [48, 40];

pub(crate) fn eye(projection: Projection) -> Camera {
    let focal = match projection {
        Projection::Perspective => 60.0,
        Projection::Orthographic => 10.0,
    };
    camera(projection, [focal; 2], SIZE)
}

/// Returns a backdrop of the depths of a function of the pixel's centre.
fn backdrop(depth: impl Fn(DVec2) -> f64) -> Backdrop {
    let [width, height] = SIZE;
    let at = |i: usize| DVec2::new((i % width) as f64, (i / width) as f64) + 0.5;
    let depths = (0..width * height).map(|i| depth(at(i)) as f32).collect();
    Backdrop::new(DepthImage {
        width,
        height,
        depths,
    })
    .unwrap()
}

/// Returns the depth of a sphere in front of a plane, both of which a volume surrounds.
fn ball_and_plane(camera: &Camera) -> Backdrop {
    let (middle, radius) = (DVec3::new(0.3, -0.2, 6.0), 0.7);
    backdrop(|pixel| {
        let slope = (pixel - camera.centre_px) / camera.focal_px;
        let (from, along) = match camera.projection {
            Projection::Perspective => (DVec3::ZERO, slope.extend(1.0)),
            Projection::Orthographic => (slope.extend(0.0), DVec3::Z),
        };
        // Along the ray, z is the parameter: z = (0 or z) + t with along.z = 1.
        let plane = (6.6 - 0.3 * from.x) / (1.0 + 0.3 * along.x);
        let offset = from - middle;
        let (a, b) = (along.length_squared(), along.dot(offset));
        let left = b * b - a * (offset.length_squared() - radius * radius);
        match left >= 0.0 {
            true => ((-b - left.sqrt()) / a).min(plane),
            false => plane,
        }
    })
}

/// Returns overlapping kernels about the point (0, 0, 6).
pub(crate) fn cloud() -> PointVolume {
    let mut random = Random::new(41);
    let positions: Vec<DVec3> = (0..300)
        .map(|_| DVec3::Z * 6.0 + random.point(1.2))
        .collect();
    let colours = positions
        .iter()
        .map(|p| [0.5 + 0.3 * p.x, 0.4, 0.6 - 0.3 * p.y].map(|c| c as f32))
        .collect();
    let count = positions.len();
    PointVolume {
        colour: Colour::PerParticle(colours),
        ..PointVolume::new(
            Particles::Isotropic {
                positions,
                sigmas: vec![0.15; count],
            },
            Strength::Mass(vec![0.03; count]),
        )
    }
}

/// Returns a tilted square of surfels that passes through the ball and the plane.
pub(crate) fn sheet() -> PointVolume {
    let step = 0.1;
    let mut positions = Vec::new();
    for y in -12..=12 {
        for x in -12..=12 {
            let (x, y) = (f64::from(x) * step, f64::from(y) * step);
            positions.push(DVec3::new(x, y, 6.0 + 0.6 * y + 0.3 * x));
        }
    }
    let s = 0.06_f32;
    let count = positions.len();
    let area = step * step * (1.0 + 0.36 + 0.09_f64).sqrt();
    PointVolume {
        colour: Colour::Uniform([0.9, 0.3, 0.1]),
        ..PointVolume::new(
            Particles::Surfels {
                positions,
                tangents: vec![[s, 0.0, 0.3 * s, 0.0, s, 0.6 * s]; count],
                is_one_sided: false,
            },
            Strength::Surface(vec![area as f32; count]),
        )
    }
}

fn settings(backdrop: &Backdrop) -> Settings {
    Settings {
        tolerance: 1e-4,
        low_pass_variance_px2: 0.15,
        backdrop: Some(Arc::new(backdrop.clone())),
        advanced: Advanced {
            // As the GPU, without fused operations; one sample a pixel, as the reference below.
            simd: SimdLevel::Baseline,
            opaque_edges: false,
            ..Advanced::default()
        },
        ..Settings::default()
    }
}

fn drawn(scene: &[PointVolume], camera: &Camera, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer.render(camera, settings).unwrap().clone()
}

#[test]
fn a_kernel_ends_at_the_depth_of_each_pixel() {
    let (sigma, mass, z) = (0.4, 0.8, 6.0);
    let kernel = PointVolume::spheres([DVec3::Z * z], [sigma]).with_masses([mass]);
    let camera = eye(Projection::Orthographic);
    let ends = backdrop(|pixel| match pixel.x as usize {
        x if x < 10 => f64::INFINITY,
        x if x > 40 => -1e30,
        x => z + (x as f64 - 24.0) * 0.05,
    });
    let settings = Settings {
        low_pass_variance_px2: 0.0,
        cutoff: Some(7.0),
        ..settings(&ends)
    };
    let image = drawn(&[kernel], &camera, &settings);
    for (i, pixel) in image.pixels.iter().enumerate() {
        let at = DVec2::new((i % SIZE[0]) as f64, (i / SIZE[0]) as f64) + 0.5;
        let r2 = ((at - camera.centre_px) / camera.focal_px).length_squared();
        let s2 = f64::from(sigma) * f64::from(sigma);
        let whole = f64::from(mass) * (-0.5 * r2 / s2).exp() / (std::f64::consts::TAU * s2);
        let end = f64::from(ends.depth().depths[i]);
        let share = normal_cdf((((end - z) / f64::from(sigma)).clamp(-30.0, 30.0)) as f32);
        let opacity = -(-whole * f64::from(share)).exp_m1();
        // Rounding of f32, and the polynomial of the normal distribution.
        assert!(
            (f64::from(pixel[3]) - opacity).abs() < 3e-6,
            "{i}: {pixel:?}, {opacity}"
        );
    }
}

#[test]
fn what_stands_there_hides_as_the_same_surfels_do() {
    // Black surfels of a plane, and the same plane as a depth.
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let camera = eye(projection);
        let step = 0.05;
        let positions: Vec<DVec3> = (0..161 * 161)
            .map(|i| (f64::from(i % 161) - 80.0, f64::from(i / 161) - 80.0))
            .map(|(x, y)| DVec3::new(x * step, y * step, 6.2 - 0.3 * x * step))
            .collect();
        let count = positions.len();
        let s = 0.04_f32;
        let area = step * step * 1.09_f64.sqrt();
        let black = PointVolume {
            colour: Colour::Uniform([0.0; 3]),
            ..PointVolume::new(
                Particles::Surfels {
                    positions,
                    tangents: vec![[s, 0.0, -0.3 * s, 0.0, s, 0.0]; count],
                    is_one_sided: false,
                },
                Strength::Surface(vec![area as f32; count]),
            )
        };
        let plane = backdrop(|pixel| {
            let slope = (pixel.x - camera.centre_px.x) / camera.focal_px.x;
            match projection {
                Projection::Perspective => 6.2 / (1.0 + 0.3 * slope),
                Projection::Orthographic => 6.2 - 0.3 * slope,
            }
        });
        let opaque = Image {
            pixels: vec![[0.0, 0.0, 0.0, 1.0]; SIZE[0] * SIZE[1]],
            ..Image::new(SIZE[0], SIZE[1])
        };
        for composite in [Composite::Over, Composite::SLABS.with_thickness(Some(0.3))] {
            let with_plane = Settings {
                composite,
                ..settings(&plane.clone().with_colours(opaque.clone()).unwrap())
            };
            let with_surfels = Settings {
                backdrop: None,
                ..with_plane.clone()
            };
            let a = drawn(&[cloud()], &camera, &with_plane);
            let b = drawn(&[cloud(), black.clone()], &camera, &with_surfels);
            // The depth of a pixel's surface is a mean of several surfels' planes in f32.
            let most = difference(&a, &b);
            assert!(most < 2e-5, "{projection:?}, {composite:?}: {most}");
            assert!(a.pixels.iter().all(|pixel| pixel[3] > 0.9999));
        }
    }
}

#[test]
fn pictures_agree_with_the_reference_and_between_back_ends() {
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let camera = eye(projection);
        let ends = ball_and_plane(&camera);
        let settings = settings(&ends);
        let cloud = [cloud()];
        let slabs = Settings {
            composite: Composite::SLABS.with_thickness(Some(0.05)),
            tolerance: 1e-4,
            ..settings.clone()
        };
        let reference = ReferenceSettings {
            error: 1e-6,
            low_pass_variance_px2: 0.15,
            pixel_filter: PixelFilter::Kernels,
            ..ReferenceSettings::default()
        };
        let integrator = Integrator::new(&cloud).unwrap();
        let truth = integrator.clone().ended(Some(ends.depth()));
        let truth = truth.render(&camera, &reference).unwrap();
        // What slabs differ from the integral by without a backdrop bounds it with one; the depths of a ball's
        // outline, where filtered kernels see other depths than their rays, are apart.
        let whole = integrator.render(&camera, &reference).unwrap();
        let whole_settings = Settings {
            backdrop: None,
            ..slabs.clone()
        };
        let without = difference(&drawn(&cloud, &camera, &whole_settings), &whole.image);
        let with = difference(&drawn(&cloud, &camera, &slabs), &truth.image);
        println!("{projection:?}: {without:e} without, {with:e} with a backdrop");
        assert!(with < 1.5 * without.max(1e-3), "{with}, {without}");
        assert!(difference(&truth.image, &whole.image) > 0.05);

        #[cfg(feature = "gpu")]
        if let Some(gpu) = crate::common::gpu::gpu() {
            let scenes = [
                vec![cloud[0].clone()],
                vec![sheet()],
                vec![cloud[0].clone(), sheet()],
            ];
            for (scene, settings) in [
                (0, &settings),
                (1, &settings),
                (2, &settings),
                (
                    2,
                    &Settings {
                        normals: true,
                        depth: true,
                        ..settings.clone()
                    },
                ),
                (
                    2,
                    &Settings {
                        composite: Composite::SHEETS,
                        ..settings.clone()
                    },
                ),
            ] {
                let scene = &scenes[scene];
                let a = drawn(scene, &camera, settings);
                let mut on_gpu = Renderer::new(scene.clone())
                    .unwrap()
                    .on(gpu.clone())
                    .unwrap();
                let b = on_gpu.render(&camera, settings).unwrap();
                let most = difference(&a, b);
                assert!(most < 2e-5, "{projection:?}: {most}");
                // Again, without: nothing of the backdrop is left.
                let bare = Settings {
                    backdrop: None,
                    ..settings.clone()
                };
                let a = drawn(scene, &camera, &bare);
                let most = difference(&a, on_gpu.render(&camera, &bare).unwrap());
                assert!(most < 2e-5, "{projection:?}, without: {most}");
            }
        }
    }
}

#[test]
fn surfels_beyond_the_depths_are_hidden() {
    let camera = eye(Projection::Perspective);
    let ends = ball_and_plane(&camera);
    let image = drawn(&[sheet()], &camera, &settings(&ends));
    let mut whole = Renderer::new(vec![sheet()]).unwrap();
    let all = Settings {
        depth: true,
        backdrop: None,
        ..settings(&ends)
    };
    whole.render(&camera, &all).unwrap();
    let (depth, picture) = (whole.depth().unwrap(), whole.image());
    let (mut seen, mut hidden) = (0, 0);
    for i in 0..depth.depths.len() {
        let (own, end) = (depth.depths[i], ends.depth().depths[i]);
        // Surfels of one place differ in depth by rounding alone.
        if own < end - 1e-4 {
            assert!((image.pixels[i][3] - picture.pixels[i][3]).abs() < 1e-6);
            seen += 1;
        } else if own > end + 1e-4 && own < f32::INFINITY {
            assert_eq!(image.pixels[i], [0.0; 4]);
            hidden += 1;
        }
    }
    assert!(seen > 50 && hidden > 50, "{seen}, {hidden}");
}

#[test]
fn samples_of_opaque_edges_end_where_their_pixels_do() {
    let camera = eye(Projection::Perspective);
    let ends = ball_and_plane(&camera);
    let dense = cloud().with_masses(vec![0.6; 300]);
    let edges = |settings: Settings| Settings {
        advanced: Advanced {
            opaque_edges: true,
            ..settings.advanced
        },
        ..settings
    };
    let mut renderer = Renderer::new(vec![dense.clone()]).unwrap();
    let image = renderer
        .render(&camera, &edges(settings(&ends)))
        .unwrap()
        .clone();
    assert!(renderer.counts().supersampled_tiles > 0);
    // A plane of one depth: samples and a picture of twice the size are the same.
    let flat = backdrop(|_| 5.5);
    let image_of_flat = renderer
        .render(&camera, &edges(settings(&flat)))
        .unwrap()
        .clone();
    assert!(difference(&image, &image_of_flat) > 0.1);
    let larger = Camera {
        focal_px: camera.focal_px * 2.0,
        centre_px: camera.centre_px * 2.0,
        width: camera.width * 2,
        height: camera.height * 2,
        ..camera.clone()
    };
    let depth = DepthImage {
        width: larger.width,
        height: larger.height,
        depths: vec![5.5; larger.width * larger.height],
    };
    let large = drawn(&[dense], &larger, &settings(&Backdrop::new(depth).unwrap()));
    let mean = |x: usize, y: usize| {
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let four = four.map(|(u, v)| large.pixel(2 * x + u, 2 * y + v)[3]);
        four.iter().sum::<f32>() / 4.0
    };
    let off = (0..SIZE[0] * SIZE[1]).map(|i| {
        let [x, y] = [i % SIZE[0], i / SIZE[0]];
        (image_of_flat.pixel(x, y)[3] - mean(x, y)).abs()
    });
    // Tiles that are drawn once have no edges beyond the tolerance.
    assert!(off.fold(0.0, f32::max) < 1e-3);
}

#[test]
fn colours_stand_behind_in_the_space_of_blending() {
    let camera = eye(Projection::Perspective);
    let ends = ball_and_plane(&camera);
    let colour = |i: usize| {
        let a = if i.is_multiple_of(3) { 1.0 } else { 0.5 };
        [0.2 * a, 0.7 * a, 0.4 * a, a]
    };
    let colours = Image {
        pixels: (0..SIZE[0] * SIZE[1]).map(colour).collect(),
        ..Image::new(SIZE[0], SIZE[1])
    };
    let with = ends.clone().with_colours(colours.clone()).unwrap();
    let background = [0.1, 0.3, 0.9];
    for blend in [Blend::Linear, Blend::Encoded] {
        for background in [None, Some(background)] {
            let alone = Settings {
                blend,
                ..settings(&ends)
            };
            let both = Settings {
                blend,
                background,
                ..settings(&with)
            };
            let bare = drawn(&[cloud()], &camera, &alone);
            let image = drawn(&[cloud()], &camera, &both);
            let curve = |x: f32, f: fn(f32) -> f32| match blend {
                Blend::Encoded => f(x),
                _ => x,
            };
            for ((own, over), behind) in bare.pixels.iter().zip(&image.pixels).zip(&colours.pixels)
            {
                let mut under = *behind;
                if let Some(background) = background {
                    for c in 0..3 {
                        under[c] += (1.0 - under[3]) * background[c];
                    }
                    under[3] = 1.0;
                }
                let alpha = own[3] + (1.0 - own[3]) * under[3];
                assert!((over[3] - alpha).abs() < 1e-6);
                for c in 0..3 {
                    let code = |pixel: &[f32; 4]| match pixel[3] > 0.0 {
                        true => pixel[3] * curve(pixel[c] / pixel[3], srgb_from_linear),
                        false => 0.0,
                    };
                    let mixed = code(own) + (1.0 - own[3]) * code(&under);
                    let expected = alpha * curve(mixed / alpha, linear_from_srgb);
                    assert!(
                        (over[c] - expected).abs() < 2e-6,
                        "{blend:?}: {over:?}, {expected}"
                    );
                }
            }
        }
    }
}

#[test]
fn shares_at_a_pixel_are_those_of_the_picture() {
    let camera = eye(Projection::Perspective);
    let ends = ball_and_plane(&camera);
    let options = SceneOptions {
        keep_indices: true,
        ..SceneOptions::default()
    };
    let mut renderer = Renderer::with_options(vec![cloud()], &options).unwrap();
    let settings = settings(&ends);
    let image = renderer.render(&camera, &settings).unwrap().clone();
    for pixel in [[24, 20], [30, 18], [10, 12]] {
        let picked = renderer.pick(&camera, &settings, pixel).unwrap();
        let sum: f32 = picked.iter().map(|found| found.share).sum();
        let opacity = image.pixel(pixel[0], pixel[1])[3];
        // What the picture's early end leaves out: the tolerance.
        assert!((sum - opacity).abs() < 2e-4, "{pixel:?}: {sum}, {opacity}");
    }
}

#[test]
fn backdrops_of_another_size_and_numbers_that_are_none_are_refused() {
    let depth = |width: usize, height: usize, z: f32| DepthImage {
        width,
        height,
        depths: vec![z; 12],
    };
    for wrong in [
        depth(4, 4, 1.0),
        depth(usize::MAX, 2, 1.0),
        depth(4, 3, f32::NAN),
    ] {
        Backdrop::new(wrong).unwrap_err();
    }
    let small = Backdrop::new(depth(4, 3, 1.0)).unwrap();
    small.clone().with_colours(Image::new(3, 4)).unwrap_err();
    let infinite = Image {
        pixels: vec![[f32::INFINITY; 4]; 12],
        ..Image::new(4, 3)
    };
    small.clone().with_colours(infinite).unwrap_err();
    let mut renderer = Renderer::new(vec![cloud()]).unwrap();
    let error = renderer.render(&eye(Projection::Perspective), &settings(&small));
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("backdrop") && error.contains("48 x 40"),
        "{error}"
    );
}
