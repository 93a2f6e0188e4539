//! Tests panoramas: pixels are those of cameras along their rays, faces join, masses are kept, and both back ends agree.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::f64::consts::PI;

use ewa_splat::math::normal_code;
use ewa_splat::render::{Backdrop, ColumnSettings};
use ewa_splat::scene::{Lighting, PointVolume};
use ewa_splat::view::{Camera, FisheyeRule, Mapping, Panorama, Projection};
use ewa_splat::{DepthImage, Image, Renderer, Settings, Show};
use glam::{DMat3, DVec2, DVec3};

use crate::common::Random;
use crate::common::scene::{Particle, camera, difference, volume};

/// Returns coloured kernels on all sides of the origin, with deviations of 18 degrees or more.
fn around() -> PointVolume {
    let mut random = Random::new(7);
    let particles: Vec<Particle> = (0..60)
        .map(|_| {
            let sigma = random.range(0.8, 1.4);
            let at = random.rotation() * DVec3::Z * random.range(1.0, 2.5);
            let colour = [0, 1, 2].map(|_| random.range(0.1, 1.0) as f32);
            Particle::sphere(at, sigma, random.range(0.3, 1.2)).coloured(colour)
        })
        .collect();
    volume(&particles)
}

fn panorama(mapping: Mapping, width: usize, height: usize) -> Panorama {
    let camera = camera(Projection::Perspective, [1.0; 2], [width, height]);
    Panorama::of_camera(&camera, mapping)
}

fn drawn(scene: &PointVolume, panorama: &Panorama, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
    renderer
        .render_panorama(panorama, settings)
        .unwrap()
        .clone()
}

/// Settings without approximations but the rounding of f32.
fn exact() -> Settings {
    Settings {
        tolerance: 1e-6,
        low_pass_variance_px2: 0.1,
        ..Settings::default()
    }
}

/// Returns the picture that a small camera takes along a ray, whose pixels are as wide as the panorama's; its middle pixel lies about the
/// ray.
fn along(direction: DVec3, spacing: f64) -> Camera {
    let mut camera = Camera::perspective(DVec3::ZERO, direction, DVec3::Y, 90.0, [3, 3]);
    camera.focal_px = DVec2::splat(1.0 / spacing);
    camera
}

#[test]
fn a_pixel_is_that_of_a_camera_along_its_ray() {
    let scene = around();
    let fisheye = |rule, fov_deg| Mapping::Fisheye { rule, fov_deg };
    for (mapping, size, spacing) in [
        (Mapping::Equirectangular, [256, 128], PI / 128.0),
        (
            fisheye(FisheyeRule::Equidistant, 220.0),
            [120, 120],
            220_f64.to_radians() / 120.0,
        ),
        (
            fisheye(FisheyeRule::Equisolid, 180.0),
            [120, 120],
            1.5 / 120.0,
        ),
        (Mapping::Cube, [360, 60], 2.0 / 60.0),
        (
            Mapping::Healpix,
            [12 * 32 * 32, 1],
            (4.0 * PI / 12.0).sqrt() / 32.0,
        ),
    ] {
        let whole = panorama(mapping, size[0], size[1]);
        let picture = drawn(&scene, &whole, &exact());
        let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
        let mut most: f32 = 0.0;
        for pixel in (0..picture.pixels.len()).step_by(picture.pixels.len() / 97) {
            let place = [pixel % size[0], pixel / size[0]];
            let corner = |u, v| whole.direction(place, DVec2::new(u, v));
            let corners = [
                corner(0.0, 0.0),
                corner(1.0, 0.0),
                corner(0.0, 1.0),
                corner(1.0, 1.0),
            ];
            // The rim crosses others.
            if corners.contains(&None) {
                continue;
            }
            let direction = corner(0.5, 0.5).unwrap();
            let camera = along(direction, spacing);
            let expected = renderer.render(&camera, &exact()).unwrap().pixel(1, 1);
            let [a, b] = [picture.pixels[pixel], expected];
            most = a
                .iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs())
                .fold(most, f32::max);
        }
        // Deviations of kernels are 10 px and more. The filters of pixels differ by up to .09 px², which is 4e-4 of the
        // second derivative of such a kernel, or of .6 of its peak on the whole; 1.9e-4 was measured.
        assert!(most < 2.5e-4, "{mapping:?}: {most}");
    }
}

#[test]
fn pictures_turn_without_a_seam() {
    let scene = around();
    let whole = panorama(Mapping::Equirectangular, 128, 64);
    let turned = Panorama {
        // A sixteenth of a turn to the right: no edge of a face stays where it is.
        camera_from_world: DMat3::from_rotation_y(-PI / 8.0),
        ..whole.clone()
    };
    let [a, b] = [&whole, &turned].map(|view| drawn(&scene, view, &exact()));
    let shifted = Image {
        pixels: (0..128 * 64)
            .map(|i| a.pixels[i / 128 * 128 + (i % 128 + 8) % 128])
            .collect(),
        ..a.clone()
    };
    let most = difference(&shifted, &b);
    assert!(most < 2e-4, "{most}");
}

#[test]
fn masses_on_the_sphere_are_those_over_their_distances_squared() {
    let mut random = Random::new(3);
    let mut expected = 0.0;
    let particles: Vec<Particle> = (0..20)
        .map(|_| {
            let distance = random.range(2.0, 5.0);
            let sigma = distance * random.range(0.03, 0.15);
            let mass = random.range(0.5, 2.0);
            // The mean of 1 / r² over a Gaussian, by the Laplacian of 1 / r², which is 2 / r⁴, and the next term.
            let share = (sigma / distance).powi(2);
            expected += mass / distance.powi(2) * (1.0 + share + 3.0 * share * share);
            let at = random.rotation() * DVec3::Z * distance;
            Particle::sphere(at, sigma, mass)
        })
        .collect();
    let mut renderer = Renderer::new(vec![volume(&particles)]).unwrap();
    let mut check = |view: &Panorama, area: &dyn Fn(usize) -> f64| {
        let column = renderer
            .column_panorama(view, &ColumnSettings::default())
            .unwrap();
        let values = column.values.iter().enumerate();
        let sum: f64 = values.map(|(i, value)| f64::from(*value) * area(i)).sum();
        assert!(
            (sum / expected - 1.0).abs() < 2e-3,
            "{:?}: {sum} {expected}",
            view.mapping
        );
    };
    let sky = Panorama::sky(DVec3::ZERO, 32);
    check(&sky, &|_| 4.0 * PI / (12.0 * 32.0 * 32.0));
    let equirect = panorama(Mapping::Equirectangular, 128, 64);
    check(&equirect, &|i| {
        let ends = [i / 128, i / 128 + 1].map(|row| (row as f64 / 64.0 * PI).cos());
        (ends[0] - ends[1]) * 2.0 * PI / 128.0
    });
}

#[test]
fn depths_are_distances_and_lights_stay_with_the_camera() {
    let particles: Vec<Particle> = (0..900)
        .map(|i| {
            let at = DVec3::new(
                f64::from(i % 60) * 0.2 - 1.0,
                f64::from(i / 60) * 0.2 - 1.5,
                5.0,
            );
            Particle {
                factor: DMat3::from_diagonal(DVec3::new(0.2, 0.2, 1e-3)),
                mass: 0.1,
                ..Particle::sphere(at, 1.0, 1.0)
            }
        })
        .collect();
    let mut scene = volume(&particles);
    let tilted = DVec3::new(0.6, 0.0, -0.8);
    scene.normals = Some(vec![normal_code(tilted); 900]);
    let settings = Settings {
        depth: true,
        lighting: Some(Lighting::default()),
        ..exact()
    };
    let whole = panorama(Mapping::Equirectangular, 256, 128);
    let mut renderer = Renderer::new(vec![scene]).unwrap();
    let picture = renderer.render_panorama(&whole, &settings).unwrap().clone();
    let depths = renderer.depth().unwrap().clone();
    // A camera of 140 degrees sees directions that the panorama's right face does, too.
    let wide = camera(Projection::Perspective, [64.0; 2], [352, 128]);
    let expected = renderer.render(&wide, &settings).unwrap();
    for column in [128, 140, 163, 170] {
        let pixel = 64 * 256 + column;
        let direction = whole.direction([column, 64], DVec2::splat(0.5)).unwrap();
        let distance = 5.0 / direction.z;
        assert!(
            // The depth is that of one of the kernels, whose deviation is .2.
            (f64::from(depths.depths[pixel]) / distance - 1.0).abs() < 0.05,
            "{column}: {} {distance}",
            depths.depths[pixel]
        );
        let at = wide.project(direction).unwrap();
        let other = expected.pixel(at.x as usize, at.y as usize);
        for (a, b) in picture.pixels[pixel].iter().zip(other) {
            // Places differ by half a pixel at most.
            assert!(
                (a - b).abs() < 0.02,
                "{column}: {:?} {other:?}",
                picture.pixels[pixel]
            );
        }
    }
    assert_eq!(depths.depths[64 * 256], f32::INFINITY);
}

#[test]
fn what_is_no_picture_of_all_directions_is_refused() {
    let mut renderer = Renderer::new(vec![around()]).unwrap();
    let whole = panorama(Mapping::Equirectangular, 16, 8);
    let depth = DepthImage {
        width: 16,
        height: 8,
        depths: vec![1.0; 128],
    };
    for wrong in [
        Settings {
            show: Show::Count,
            ..exact()
        },
        Settings {
            backdrop: Some(Backdrop::new(depth).unwrap().into()),
            ..exact()
        },
    ] {
        assert!(renderer.render_panorama(&whole, &wrong).is_err());
    }
    let wide = panorama(Mapping::Equirectangular, 70_000, 1);
    assert!(renderer.render_panorama(&wide, &exact()).is_err());
    let slice = ColumnSettings {
        slice: Some(DVec3::ZERO),
        ..ColumnSettings::default()
    };
    assert!(renderer.column_panorama(&whole, &slice).is_err());
    // Later pictures are not affected.
    renderer.render_panorama(&whole, &exact()).unwrap();
}

#[test]
fn odd_shapes_are_drawn_or_refused() {
    let mut renderer = Renderer::new(vec![around()]).unwrap();
    let settings = Settings {
        depth: true,
        normals: true,
        tolerance: 1e-2,
        ..exact()
    };
    // Wide pixels whose samples lie on other faces than their middles.
    for [width, height] in [[1, 1], [3, 300], [512, 1], [2, 1], [1, 64]] {
        let whole = panorama(Mapping::Equirectangular, width, height);
        let picture = renderer.render_panorama(&whole, &settings).unwrap();
        let least = picture
            .pixels
            .iter()
            .fold(1.0, |least: f32, p| least.min(p[3]));
        assert!(least > 0.1, "{width} x {height}: {least}");
    }
    let thin = panorama(Mapping::Equirectangular, 65_535, 100);
    assert!(renderer.render_panorama(&thin, &settings).is_err());
}

#[test]
fn backgrounds_lie_behind_all_pixels() {
    let mapping = Mapping::Fisheye {
        rule: FisheyeRule::Equidistant,
        fov_deg: 180.0,
    };
    let whole = panorama(mapping, 33, 32);
    let clear = drawn(&around(), &whole, &exact());
    let background = [0.2, 0.3, 0.4];
    let shown = Settings {
        background: Some(background),
        ..exact()
    };
    let most = difference(&clear.over(background), &drawn(&around(), &whole, &shown));
    assert!(most < 1e-5, "{most}");
    assert_eq!(clear.pixels[0], [0.0; 4]);
}

#[test]
fn two_eyes_see_what_each_sees() {
    let middle = camera(Projection::Perspective, [30.0; 2], [24, 20]);
    let settings = Settings {
        depth: true,
        ..exact()
    };
    let mut renderer = Renderer::new(vec![around()]).unwrap();
    let both = renderer
        .render_stereo(&middle, &settings, 0.3)
        .unwrap()
        .clone();
    let depths = renderer.depth().unwrap().clone();
    assert_eq!([both.width, both.height], [24, 40]);
    let footprints = renderer.counts().footprints;
    let mut alone = 0;
    for (eye, first) in [(-0.15, 0), (0.15, 24 * 20)] {
        let own = Camera {
            eye: DVec3::X * eye,
            ..middle.clone()
        };
        let image = renderer.render(&own, &settings).unwrap().clone();
        assert_eq!(image.pixels, both.pixels[first..][..24 * 20]);
        assert_eq!(
            renderer.depth().unwrap().depths,
            depths.depths[first..][..24 * 20]
        );
        alone += renderer.counts().footprints;
    }
    assert_eq!(alone, footprints);
    let flat = Camera {
        projection: Projection::Orthographic,
        ..middle.clone()
    };
    assert!(renderer.render_stereo(&flat, &settings, 0.3).is_err());
    assert!(
        renderer
            .render_stereo(&middle, &settings, f64::NAN)
            .is_err()
    );
}

#[cfg(feature = "gpu")]
#[test]
fn both_back_ends_draw_the_same() {
    use crate::common::gpu::{ALIKE, gpu};
    let Some(gpu) = gpu() else { return };
    let whole = panorama(Mapping::Equirectangular, 64, 32);
    let cpu = drawn(&around(), &whole, &exact());
    let renderer = Renderer::new(vec![around()]).unwrap();
    let mut renderer = renderer.on(gpu.clone()).unwrap();
    let most = difference(&cpu, renderer.render_panorama(&whole, &exact()).unwrap());
    // The magnitudes of a cubic's weights add up to 1.27 at most, twice.
    assert!(most < 1.6 * ALIKE, "{most}");
}
