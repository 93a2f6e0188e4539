//! Tests laws of whole images.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::scene::{self, Particle, camera, difference, render, volume};
use ewa_splat::Filter;
use ewa_splat::render::Advanced;
use ewa_splat::scene::{Lattice, LatticeSpacing, Particles, PointVolume, Strength};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DMat3, DVec2, DVec3};

/// Returns random coloured ellipsoids in a cube of half side 1 about the origin.
fn cloud(seed: u64, count: usize) -> Vec<Particle> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let (size, ratio) = (random.log_range(0.01, 0.2), random.log_range(1.0, 20.0));
            Particle {
                position: random.point(1.0),
                factor: random.factor(size, ratio),
                mass: random.log_range(1e-4, 2e-2) as f32,
                colour: random.point(0.5).to_array().map(|c| c as f32 + 0.5),
            }
        })
        .collect()
}

/// Returns a camera that sees the cloud from nearby, along no axis.
fn beside(size: [usize; 2]) -> Camera {
    Camera::perspective(
        DVec3::new(1.7, -2.1, 0.9),
        DVec3::ZERO,
        DVec3::Z,
        55.0,
        size,
    )
}

/// Returns the largest change of a pixel by rounding alone: the step at a kernel's edge, which a
/// pixel may fall on either side of. The cut-off keeps it below the tolerance; roundings add 1e-5.
fn edge_step(settings: &Settings) -> f32 {
    settings.tolerance + 1e-5
}

/// Returns settings that draw every kernel to seven standard deviations, where the step at its edge
/// is negligible.
fn wide() -> Settings {
    Settings {
        cutoff: Some(7.0),
        filter: Filter::Exact,
        ..Settings::default()
    }
}

fn brightest(image: &Image) -> f32 {
    image.pixels.iter().map(|p| p[3]).fold(0.0, f32::max)
}

#[test]
fn mass_is_conserved_under_zoom_and_under_every_filter() {
    // Affine filters spread g |det J| for any shape. Sampling at pixels is accurate as long as no
    // footprint is narrower than a pixel (ripple 4 exp(-2 pi² h²)).
    let mut random = Random::new(1);
    for focal in [40.0, 80.0, 160.0, 320.0] {
        for filter in [
            Filter::Ewa,
            Filter::LowPass,
            Filter::Isotropic,
            Filter::UniformScaling,
        ] {
            let factor = random.factor(0.04, 3.0);
            let position = DVec3::new(0.4, -0.3, 3.0);
            let mut camera = camera(Projection::Perspective, [focal, focal * 1.3], [128, 128]);
            camera.centre_px =
                DVec2::splat(64.2) - camera.focal_px * position.truncate() / position.z;
            let mass = 0.2 / (focal * focal);
            let particle = Particle {
                position,
                factor,
                mass: mass as f32,
                colour: [1.0; 3],
            };
            let settings = Settings {
                filter,
                ..scene::linear()
            };
            let image = render(vec![volume(&[particle])], &camera, &settings);
            let expected = f64::from(particle.mass)
                * camera.focal_px.x
                * camera.focal_px.y
                * position.length()
                / position.z.powi(3);
            let sum = scene::alpha_sum(&image);
            // exp errs by 4e-7, with one sign, and the amplitude by eight roundings.
            let error = (sum / expected - 1.0).abs();
            assert!(
                error < 1.5e-6,
                "{filter:?}, f {focal}: {sum} for {expected}"
            );
        }
    }
}

#[test]
fn moving_scene_and_camera_together_changes_nothing() {
    let particles = cloud(2, 400);
    let view = beside([80, 60]);
    let settings = wide();
    let before = render(vec![volume(&particles)], &view, &settings);
    assert!(brightest(&before) > 0.5);

    // 2^23 is 8.4e6: its sum with 1 keeps 29 bits below the point in f64.
    let shift = DVec3::new(8_388_608.0, -8_388_608.0, 1.0e7);
    let moved: Vec<_> = particles
        .iter()
        .map(|p| Particle {
            position: p.position + shift,
            ..*p
        })
        .collect();
    let camera = Camera {
        eye: view.eye + shift,
        ..view.clone()
    };
    let after = render(vec![volume(&moved)], &camera, &settings);
    // Positions move by 1e-9, a ten-millionth of the narrowest kernel's width (5e-4), and pixels by
    // less than f32 rounding.
    let error = difference(&before, &after);
    println!("translated by 1e7: {error:.1e}");
    assert!(error < 2e-5, "translated: {error:e}");

    let mut random = Random::new(3);
    for _ in 0..3 {
        let turn = random.rotation();
        let moved: Vec<_> = particles
            .iter()
            .map(|p| Particle {
                position: turn * p.position,
                factor: turn * p.factor,
                ..*p
            })
            .collect();
        let camera = Camera {
            eye: turn * view.eye,
            camera_from_world: view.camera_from_world * turn.transpose(),
            ..view.clone()
        };
        let after = render(vec![volume(&moved)], &camera, &settings);
        let error = difference(&before, &after);
        println!("rotated: {error:.1e}");
        // Factors are triangular in world space, so a rotation rounds them anew: 20 (the axis
        // ratio) times 6e-8 times a slope of .6 per sigma, from some ten kernels of a depth up to
        // 10 at a pixel. A pixel coordinate rounds to 4e-6 px of a width of 1 px.
        assert!(error < 1e-4, "rotated: {error:e}");
    }
}

#[test]
fn order_and_division_of_the_input_play_no_part() {
    let particles = cloud(4, 700);
    let camera = beside([70, 50]);
    for settings in [wide(), Settings::default()] {
        let one = render(vec![volume(&particles)], &camera, &settings);
        // Offsets from another block's origin round differently; pixels at a kernel's edge may then
        // flip.
        let allowed = if settings.cutoff.is_some() {
            3e-5
        } else {
            edge_step(&settings)
        };

        let mut shuffled = particles.clone();
        let mut random = Random::new(5);
        for i in (1..shuffled.len()).rev() {
            shuffled.swap(i, random.index(i + 1));
        }
        let error = difference(&one, &render(vec![volume(&shuffled)], &camera, &settings));
        assert!(error < allowed, "reordered: {error:e}");

        let (a, b) = particles.split_at(250);
        let parts = vec![volume(a), volume(b)];
        let error = difference(&one, &render(parts, &camera, &settings));
        println!("divided into two volumes: {error:.1e}");
        assert!(error < allowed, "divided: {error:e}");
        let parts = vec![volume(b), volume(&[]), volume(a)];
        let error = difference(&one, &render(parts, &camera, &settings));
        assert!(error < allowed, "divided otherwise: {error:e}");
    }
}

#[test]
fn the_nearer_of_two_covers_the_farther_from_both_sides() {
    let red = Particle::sphere(DVec3::X, 0.2, 5.0).coloured([1.0, 0.0, 0.0]);
    let blue = Particle::sphere(-DVec3::X, 0.2, 5.0).coloured([0.0, 0.0, 1.0]);
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for (side, order) in [(1.0, [0, 1]), (-1.0, [1, 0])] {
            // The two are in one block, in two volumes, and in either order.
            for scene in [
                vec![volume(&[red, blue])],
                vec![volume(&[blue, red])],
                vec![volume(&[blue]), volume(&[red])],
            ] {
                let eye = DVec3::X * 6.0 * side;
                let camera = match projection {
                    Projection::Perspective => {
                        Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, [31, 31])
                    }
                    Projection::Orthographic => {
                        Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 4.0, [31, 31])
                    }
                };
                let image = render(scene, &camera, &Settings::default());
                let [red, _, blue, alpha] = image.pixel(15, 15);
                let seen = [red, blue];
                // tau of each is near 20: the front one transmits 2e-9.
                assert!(
                    seen[order[0]] > 0.9999 && seen[order[1]] < 1e-4,
                    "{seen:?} from {side}"
                );
                assert!(alpha > 0.9999);
            }
        }
    }
}

#[test]
fn particles_behind_the_camera_are_invisible() {
    let behind: Vec<_> = cloud(6, 300)
        .into_iter()
        .map(|p| Particle {
            position: p.position - DVec3::Z * 4.0,
            ..p
        })
        .collect();
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for filter in Filter::ALL {
            let settings = Settings {
                filter,
                ..Settings::default()
            };
            let camera = camera(projection, [20.0; 2], [40, 40]);
            let image = render(vec![volume(&behind)], &camera, &settings);
            assert!(
                image.pixels.iter().all(|p| *p == [0.0; 4]),
                "{projection:?}, {filter:?}"
            );
        }
    }
}

#[test]
fn a_camera_inside_the_cloud_sees_finite_pixels() {
    let particles = cloud(7, 2_000);
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for filter in Filter::ALL {
            let mut camera = camera(projection, [30.0; 2], [48, 48]);
            camera.eye = DVec3::new(0.1, 0.05, -0.02);
            let settings = Settings {
                filter,
                depth: true,
                ..Settings::default()
            };
            let scene = volume(&particles);
            #[cfg(feature = "gpu")]
            crate::common::gpu::assert_alike("inside the cloud", &scene, &camera, &settings);
            let mut renderer = Renderer::new(vec![scene]).unwrap();
            let image = renderer.render(&camera, &settings).unwrap();
            // The remaining opacity: premultiplied colours stay within it (three roundings).
            let legal = |p: &[f32; 4]| {
                p.iter().all(|c| c.is_finite() && *c >= 0.0)
                    && p[3] <= 1.0
                    && p[..3].iter().all(|c| *c <= p[3] * 1.000_01 + 1e-6)
            };
            assert!(image.pixels.iter().all(legal), "{projection:?}, {filter:?}");
            assert!(brightest(image) > 0.5);
            assert!(
                renderer.counts().footprints_near > 0,
                "{projection:?}, {filter:?}"
            );
        }
    }
}

/// Moves a kernel through the eye's plane in small steps. Returns the largest change of a pixel
/// between two steps.
fn largest_step(projection: Projection, filter: Filter, factor: DMat3, beside: f64) -> f32 {
    let mut camera = camera(projection, [20.0; 2], [24, 24]);
    camera.centre_px = DVec2::new(11.7, 12.4);
    let settings = Settings {
        filter,
        ..Settings::default()
    };
    let reach = factor.row(2).length();
    const STEPS: usize = 400;
    let mut last: Option<Image> = None;
    let mut most = 0.0_f32;
    for i in 0..=STEPS {
        // From 8 standard deviations in front to 8 behind: 0.04 of one per step.
        let z = reach * (8.0 - 16.0 * i as f64 / STEPS as f64);
        // The depth is about 1 at its thickest.
        let particle = Particle {
            position: DVec3::new(beside, 0.3 * beside, z),
            factor,
            mass: 0.5,
            colour: [1.0; 3],
        };
        let image = render(vec![volume(&[particle])], &camera, &settings);
        if let Some(last) = &last {
            most = most.max(difference(last, &image));
        }
        last = Some(image);
    }
    most
}

#[test]
fn passing_the_camera_plane_is_continuous() {
    let sphere = DMat3::from_diagonal(DVec3::splat(0.4));
    let tilted = DMat3::from_rotation_y(0.7) * DMat3::from_diagonal(DVec3::new(0.2, 0.4, 0.8));
    for (name, factor) in [("sphere", sphere), ("tilted", tilted)] {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            for filter in [Filter::Exact, Filter::Adaptive] {
                let most = largest_step(projection, filter, factor, 0.1);
                println!("{name}, {projection:?}, {filter:?}: largest step {most:.4}");
                // A step of .04 standard deviations changes a half-line factor by at most .016 of a
                // depth near 1, whose opacity follows at 1/e: .006. The outline of a kernel beside
                // the eye sweeps the image at a similar rate. The change of path, and of the edge
                // that the two paths cut off, may each add a tolerance (1/255). A path that is
                // wrong by a tenth of a kernel would exceed this.
                assert!(most < 0.025, "{name}, {projection:?}, {filter:?}: {most}");
            }
        }
    }
}

#[test]
fn the_change_of_path_at_the_camera_plane_is_small() {
    // The kernel lies slightly on either side of the depth 1.2 r sigma_z, at which it changes from
    // the exact path to the half line.
    let mut random = Random::new(8);
    let mut worst = 0.0_f32;
    for i in 0..60 {
        let ratio = random.log_range(1.0, 4.0);
        let factor = random.factor(0.3, ratio);
        let reach = factor.row(2).length();
        let filter = [Filter::Exact, Filter::Adaptive][i % 2];
        let settings = Settings {
            filter,
            cutoff: Some(3.5),
            ..Settings::default()
        };
        let camera = camera(Projection::Perspective, [60.0; 2], [64, 64]);
        let direction = random.point(0.4).truncate();
        let at = |z: f64| {
            let particle = Particle {
                position: (direction * z).extend(z),
                factor,
                // The depth is below .6 at any ratio.
                mass: 0.02,
                colour: [1.0; 3],
            };
            let scene = volume(&[particle]);
            #[cfg(feature = "gpu")]
            crate::common::gpu::hold_sampled(&scene, &camera, &settings);
            let mut renderer = Renderer::new(vec![scene]).unwrap();
            renderer.render(&camera, &settings).unwrap();
            (renderer.image().clone(), renderer.counts())
        };
        let (front, front_counts) = at(1.2 * 3.5 * reach * (1.0 + 1e-4));
        let (behind, behind_counts) = at(1.2 * 3.5 * reach * (1.0 - 1e-4));
        assert_eq!(
            (front_counts.footprints_near, behind_counts.footprints_near),
            (0, 1)
        );
        worst = worst.max(difference(&front, &behind));
    }
    println!("largest change where the path changes: {worst:.1e}");
    // The part behind the plane at 3.5 standard deviations is 2e-4. The half line takes the
    // low-pass filter at sqrt(u2² + V_zz), 4 % wider: 1/50 of its share in the footprint, a few px²
    // of hundreds. The flip at the edge is exp(-3.5²/2) = .0022 of the depth, and 2e-4 in depth
    // moves 2e-4.
    assert!(worst < 0.003, "{worst}");
}

#[test]
fn a_thin_needle_passes_the_change_of_path_without_a_jump() {
    // The kernel is narrower than the low-pass filter, so its footprint is that filter's.
    let factor = DMat3::from_diagonal(DVec3::new(1e-3, 1e-3, 0.3));
    let camera = camera(Projection::Perspective, [60.0; 2], [31, 31]);
    let settings = Settings {
        cutoff: Some(3.5),
        ..Settings::default()
    };
    let at = |z: f64| {
        let particle = Particle {
            position: DVec3::Z * z,
            factor,
            mass: 1e-3,
            colour: [1.0; 3],
        };
        render(vec![volume(&[particle])], &camera, &settings)
    };
    let change = 3.5 * 0.3;
    let (front, behind) = (at(change * (1.0 + 1e-4)), at(change * (1.0 - 1e-4)));
    let jump = difference(&front, &behind);
    println!(
        "a thin needle's jump: {jump:.4} of {:.3}",
        brightest(&front)
    );
    assert!(jump < settings.tolerance, "{jump}");
}

#[test]
fn any_size_of_image_shows_the_same_pixels() {
    let particles = cloud(9, 500);
    let whole = beside([96, 80]);
    for settings in [
        Settings::default(),
        Settings {
            depth: true,
            ..wide()
        },
    ] {
        let big = render(vec![volume(&particles)], &whole, &settings);
        // Windows of the whole image, moved by centre_px, are no multiples of the tile.
        for (at, size) in [
            ([40, 40], [1, 1]),
            ([31, 17], [17, 33]),
            ([3, 30], [64, 1]),
            ([47, 0], [1, 80]),
        ] {
            let camera = Camera {
                centre_px: whole.centre_px - DVec2::new(at[0] as f64, at[1] as f64),
                width: size[0],
                height: size[1],
                ..whole.clone()
            };
            let part = render(vec![volume(&particles)], &camera, &settings);
            assert_eq!(
                (part.width, part.height, part.pixels.len()),
                (size[0], size[1], size[0] * size[1])
            );
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let (a, b) = (part.pixel(x, y), big.pixel(x + at[0], y + at[1]));
                    let error = a
                        .iter()
                        .zip(b)
                        .map(|(a, b)| (a - b).abs())
                        .fold(0.0, f32::max);
                    // Pixel coordinates round differently; a tile may stop a sixteenth of the
                    // tolerance earlier or later than another.
                    assert!(
                        error < edge_step(&settings),
                        "{size:?} at ({x}, {y}): {error:e}"
                    );
                }
            }
        }
    }
    // Long and narrow.
    for size in [[1, 4096], [4096, 1]] {
        let mut camera = beside(size);
        camera.focal_px = DVec2::splat(3000.0);
        let image = render(vec![volume(&particles)], &camera, &Settings::default());
        assert_eq!(image.pixels.len(), 4096);
        assert!(image.pixels.iter().flatten().all(|c| c.is_finite()));
        assert!(brightest(&image) > 0.1);
    }
}

#[test]
fn an_empty_scene_is_the_background() {
    let camera = beside([20, 10]);
    for scene in [vec![], vec![volume(&[])], vec![volume(&[]), volume(&[])]] {
        let image = render(scene.clone(), &camera, &Settings::default());
        assert!(image.pixels.iter().all(|p| *p == [0.0; 4]));
        let settings = Settings {
            background: Some([0.25, 0.5, 1.0]),
            depth: true,
            ..Settings::default()
        };
        let mut renderer = Renderer::new(scene).unwrap();
        let image = renderer.render(&camera, &settings).unwrap();
        assert!(image.pixels.iter().all(|p| *p == [0.25, 0.5, 1.0, 1.0]));
        assert!(
            renderer
                .depth()
                .unwrap()
                .depths
                .iter()
                .all(|d| *d == f32::INFINITY)
        );
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let mut renderer = Renderer::new(vec![volume(&cloud(10, 3))]).unwrap();
    let camera = beside([8, 8]);
    let good = Settings::default();
    assert!(renderer.render(&camera, &good).is_ok());
    for size in [[0, 8], [8, 0], [70_000, 1]] {
        let camera = Camera {
            width: size[0],
            height: size[1],
            ..camera.clone()
        };
        let error = renderer.render(&camera, &good).unwrap_err().to_string();
        assert!(error.contains("image size"), "{error}");
    }
    for (settings, word) in [
        (
            Settings {
                tolerance: 0.0,
                ..good.clone()
            },
            "tolerance",
        ),
        (
            Settings {
                tolerance: f32::NAN,
                ..good.clone()
            },
            "tolerance",
        ),
        (
            Settings {
                tolerance: 1.0,
                ..good.clone()
            },
            "tolerance",
        ),
        (
            Settings {
                advanced: Advanced {
                    merge_slack: 0.5,
                    ..good.advanced
                },
                ..good.clone()
            },
            "merge slack",
        ),
        (
            Settings {
                advanced: Advanced {
                    merge_slack: f32::INFINITY,
                    ..good.advanced
                },
                ..good.clone()
            },
            "merge slack",
        ),
        (
            Settings {
                low_pass_variance_px2: -1.0,
                ..good.clone()
            },
            "low-pass",
        ),
        (
            Settings {
                low_pass_variance_px2: f32::NAN,
                ..good.clone()
            },
            "low-pass",
        ),
        (
            Settings {
                low_pass_variance_px2: f32::INFINITY,
                ..good.clone()
            },
            "low-pass",
        ),
        (
            Settings {
                cutoff: Some(0.0),
                ..good.clone()
            },
            "cut-off",
        ),
        (
            Settings {
                cutoff: Some(f32::NAN),
                ..good.clone()
            },
            "cut-off",
        ),
        (
            Settings {
                cutoff: Some(8.0),
                ..good
            },
            "cut-off",
        ),
    ] {
        let error = renderer.render(&camera, &settings).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn a_background_shines_through_what_is_left() {
    let particles = cloud(11, 200);
    let camera = beside([40, 30]);
    let front = render(vec![volume(&particles)], &camera, &Settings::default());
    let background = [0.2, 0.7, 0.4];
    let settings = Settings {
        background: Some(background),
        ..Settings::default()
    };
    let over = render(vec![volume(&particles)], &camera, &settings);
    for (front, over) in front.pixels.iter().zip(&over.pixels) {
        for (i, b) in background.into_iter().enumerate() {
            // One fused rounding or two single ones.
            assert!((over[i] - (front[i] + (1.0 - front[3]) * b)).abs() < 2e-7);
        }
        assert_eq!(over[3], 1.0);
    }
}

#[test]
fn depth_is_that_of_the_particle_that_makes_half() {
    let scene = [
        // tau about 0.16 at the centre: below one half.
        Particle::sphere(DVec3::new(0.0, 0.0, 3.0), 0.3, 0.09),
        Particle::sphere(DVec3::new(0.0, 0.0, 5.0), 0.5, 10.0),
        Particle::sphere(DVec3::new(0.0, 0.0, 9.0), 0.5, 10.0),
    ];
    for (projection, focal) in [
        (Projection::Perspective, 100.0),
        (Projection::Orthographic, 20.0),
    ] {
        let camera = camera(projection, [focal; 2], [65, 65]);
        let settings = Settings {
            depth: true,
            ..Settings::default()
        };
        let mut renderer = Renderer::new(vec![volume(&scene)]).unwrap();
        renderer.render(&camera, &settings).unwrap();
        let depth = renderer.depth().unwrap();
        assert_eq!((depth.width, depth.height), (65, 65));
        // The sphere's own z, a sum of two f32 numbers.
        assert!((depth.depths[32 * 65 + 32] - 5.0).abs() < 1e-6);
        assert_eq!(depth.depths[0], f32::INFINITY);
        for (d, p) in depth.depths.iter().zip(&renderer.image().pixels) {
            assert_eq!(d.is_finite(), p[3] >= 0.5, "{d} at {p:?}");
        }
        // Depths are computed only on request; the image is the same.
        let with = renderer.image().clone();
        renderer.render(&camera, &Settings::default()).unwrap();
        assert!(renderer.depth().is_none());
        assert_eq!(difference(&with, renderer.image()), 0.0);
    }
}

#[test]
fn linear_opacity_adds_depths_up_to_one() {
    let camera = camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    let sphere =
        |z: f64, tau: f64| Particle::sphere(DVec3::Z * z, 1.0, std::f64::consts::TAU * tau);
    let settings = Settings {
        low_pass_variance_px2: 0.0,
        ..scene::linear()
    };
    for (taus, expected) in [
        (vec![0.3], 0.3),
        (vec![5.0], 1.0),
        (vec![0.5, 0.5], 0.75),
        (vec![0.2, 0.9, 0.4], 1.0 - 0.8 * 0.1 * 0.6),
    ] {
        let parts: Vec<_> = taus
            .iter()
            .enumerate()
            .map(|(i, &t)| sphere(10.0 + 10.0 * i as f64, t))
            .collect();
        let alpha = f64::from(render(vec![volume(&parts)], &camera, &settings).pixel(0, 0)[3]);
        // The pixel's centre lies on the axis; some ten roundings of each.
        assert!(
            (alpha - expected).abs() < 1e-6,
            "{taus:?}: {alpha} for {expected}"
        );
    }
}

#[test]
fn a_cutoff_by_hand_ends_the_kernel_there_and_keeps_its_mass() {
    let mut camera = camera(Projection::Orthographic, [1.0; 2], [81, 81]);
    camera.centre_px = DVec2::splat(40.5);
    let sphere = Particle::sphere(DVec3::Z * 100.0, 8.0, 1.0);
    for r in [1.0_f32, 2.0, 4.0] {
        let settings = Settings {
            low_pass_variance_px2: 0.0,
            advanced: Advanced {
                linear_opacity: true,
                ..Advanced::default()
            },
            cutoff: Some(r),
            ..Settings::default()
        };
        let image = render(vec![volume(&[sphere])], &camera, &settings);
        for (i, p) in image.pixels.iter().enumerate() {
            let (x, y) = ((i % 81) as f32 - 40.0, (i / 81) as f32 - 40.0);
            let distance = x.hypot(y) / 8.0;
            // A pixel within rounding of the edge may fall on either side.
            if (distance - r).abs() > 1e-4 {
                assert_eq!(p[3] > 0.0, distance < r, "({x}, {y}) at r = {r}");
            }
        }
        // The disc of radius 8 r covers its area up to the pixels on its edge, whose count errs by
        // about (8 r)^(2/3), each with an edge value exp(-r²/2)/(2 pi 64).
        let sum = scene::alpha_sum(&image);
        let share = 1.0 - f64::from(-0.5 * r * r).exp();
        let edge = f64::from(-0.5 * r * r).exp() / share / (std::f64::consts::TAU * 64.0);
        let allowed = 3.0 * edge * (8.0 * f64::from(r)).powf(2.0 / 3.0) + 1e-6;
        assert!(
            (sum - 1.0).abs() < allowed,
            "r = {r}: sum {sum}, allowed {allowed}"
        );
    }
}

#[test]
fn spheres_are_isotropic_ellipsoids() {
    let mut random = Random::new(12);
    let particles: Vec<_> = (0..300)
        .map(|_| {
            let (sigma, mass) = (random.log_range(0.01, 0.2), random.log_range(1e-4, 2e-2));
            // sigma is representable in f32, so both volumes have the same numbers.
            Particle::sphere(random.point(1.0), f64::from(sigma as f32), mass)
        })
        .collect();
    let spheres = PointVolume {
        particles: Particles::Isotropic {
            positions: particles.iter().map(|p| p.position).collect(),
            sigmas: particles.iter().map(|p| p.factor.x_axis.x as f32).collect(),
        },
        ..volume(&particles)
    };
    let camera = beside([60, 60]);
    let a = render(vec![spheres], &camera, &wide());
    let b = render(vec![volume(&particles)], &camera, &wide());
    // A rotated factor rounds, whereas a sphere's does not.
    assert!(difference(&a, &b) < 1e-5, "{:e}", difference(&a, &b));
    assert!(brightest(&a) > 0.3);
}

/// Returns the particles that a lattice stands for.
fn explicit(
    lattice: &Lattice,
    kernel_width: f64,
    masses: &[f32],
    widths: &dyn Fn([usize; 3]) -> DMat3,
) -> Vec<Particle> {
    let [nx, ny, nz] = lattice.dims;
    (0..nx * ny * nz)
        .map(|n| {
            let cell = [n % nx, n / nx % ny, n / (nx * ny)];
            Particle {
                position: lattice.position(cell),
                factor: widths(cell) * kernel_width,
                mass: masses[n],
                colour: [0.8, 0.4, 0.1],
            }
        })
        .collect()
}

fn lattice_volume(lattice: Lattice, kernel_width: f64, masses: Vec<f32>) -> PointVolume {
    PointVolume::new(
        Particles::Lattice {
            lattice,
            kernel_width,
        },
        Strength::Mass(masses),
    )
    .with_colour([0.8, 0.4, 0.1])
}

#[test]
fn lattices_are_the_particles_they_stand_for() {
    let mut random = Random::new(13);
    let dims = [19, 10, 7];
    let masses: Vec<f32> = (0..dims.iter().product())
        .map(|_| random.log_range(1e-5, 1e-3) as f32)
        .collect();
    let camera = beside([64, 48]);

    let sheared = DMat3::from_cols(
        DVec3::new(0.1, 0.01, 0.0),
        DVec3::new(0.03, 0.15, 0.0),
        DVec3::new(0.0, 0.04, 0.2),
    );
    for step in [DMat3::from_diagonal(DVec3::new(0.1, 0.15, 0.2)), sheared] {
        let origin = DVec3::new(-0.9, -0.7, -0.6);
        let lattice = Lattice {
            dims,
            spacing: LatticeSpacing::Uniform { origin, step },
        };
        let particles = explicit(&lattice, 0.6, &masses, &|_| step);
        let a = render(
            vec![lattice_volume(lattice, 0.6, masses.clone())],
            &camera,
            &wide(),
        );
        let b = render(vec![volume(&particles)], &camera, &wide());
        // Other blocks and origins, and other factors of the same variance.
        assert!(difference(&a, &b) < 3e-5, "{:e}", difference(&a, &b));
        assert!(brightest(&a) > 0.1);
    }

    let coordinates = [0, 1, 2].map(|a| {
        let mut at = -0.9;
        let mut next = || {
            at += random.range(0.03, 0.25);
            at
        };
        (0..dims[a]).map(|_| next()).collect::<Vec<f64>>()
    });
    let lattice = Lattice {
        dims,
        spacing: LatticeSpacing::Rectilinear {
            coordinates: coordinates.clone(),
        },
    };
    // A cell is as wide as half the distance of its neighbours, and at the ends as its only step.
    let width = |a: usize, i: usize| {
        let x = &coordinates[a];
        let last = x.len() - 1;
        match i {
            0 => x[1] - x[0],
            i if i == last => x[last] - x[last - 1],
            i => (x[i + 1] - x[i - 1]) / 2.0,
        }
    };
    let widths = |c: [usize; 3]| {
        DMat3::from_diagonal(DVec3::new(width(0, c[0]), width(1, c[1]), width(2, c[2])))
    };
    let particles = explicit(&lattice, 0.6, &masses, &widths);
    let a = render(vec![lattice_volume(lattice, 0.6, masses)], &camera, &wide());
    let b = render(vec![volume(&particles)], &camera, &wide());
    assert!(difference(&a, &b) < 3e-5, "{:e}", difference(&a, &b));
    assert!(brightest(&a) > 0.1);
}

#[test]
fn a_hundred_thousand_particles_in_one_place() {
    let count = 100_000;
    let tau = 2.0 / f64::from(count);
    let particle = Particle::sphere(DVec3::new(0.3, -0.2, 7.0), 1.0, std::f64::consts::TAU * tau);
    let mut camera = camera(Projection::Orthographic, [1.0; 2], [4, 4]);
    camera.centre_px = DVec2::new(1.5 - 0.3, 1.5 + 0.2);
    let settings = Settings {
        low_pass_variance_px2: 0.0,
        ..wide()
    };
    let image = render(
        vec![volume(&vec![particle; count as usize])],
        &camera,
        &settings,
    );
    // The sum of tau is 2 at the centre for any number; random roundings add 3e-8 sqrt(1e5).
    let alpha = f64::from(image.pixel(1, 1)[3]);
    let expected = -(-2.0_f64).exp_m1();
    println!(
        "1e5 particles in one place: error {:.1e}",
        (alpha - expected).abs()
    );
    assert!((alpha - expected).abs() < 1e-5, "{alpha} for {expected}");
}

#[test]
fn a_fitted_camera_ignores_what_is_clear_or_haze() {
    use ewa_splat::scene::{
        ColourSpace, ControlPoint, Particles, PointVolume, Strength, TransferFunction, Values,
    };
    // Values are 0 far away (transparent), 1 around the origin (dense), .505 between (haze: 1 %).
    let positions = vec![
        DVec3::new(100.0, 0.0, 0.0),
        DVec3::new(-1.0, 0.0, 0.0),
        DVec3::new(1.0, 2.0, 0.0),
        DVec3::new(0.0, 0.0, 50.0),
    ];
    let point = |value, opacity| ControlPoint {
        value,
        colour: Some([1.0; 3]),
        opacity: Some(opacity),
    };
    let transfer = TransferFunction::from_points(
        &[point(0.0, 0.0), point(0.5, 0.0), point(1.0, 0.2)],
        ColourSpace::Linear,
        [0.0, 1.0],
        1.0,
    );
    let volume = PointVolume::new(
        Particles::Isotropic {
            positions,
            sigmas: vec![0.25; 4],
        },
        Strength::Classified {
            volumes: vec![1.0; 4],
        },
    )
    .classified(Values::F32(vec![0.0, 1.0, 1.0, 0.504]), transfer.unwrap());
    let boxes = Renderer::new(vec![volume]).unwrap().visible_boxes();
    assert_eq!(
        boxes,
        [(DVec3::new(0.0, 1.0, 0.0), DVec3::new(1.25, 1.25, 0.25))]
    );
}

#[test]
fn adaptive_holds_its_tolerance_where_many_faint_kernels_add_up() {
    // 16³ kernels, each too faint to err by a tolerance alone, seen from close by: their affine
    // errors are similar and add up along a ray.
    let mut particles = Vec::new();
    for i in 0..4096 {
        let cell = DVec3::new((i % 16) as f64, (i / 16 % 16) as f64, (i / 256) as f64);
        particles.push(Particle {
            position: cell - 7.5 + DVec3::new(0.0, 0.0, 24.0),
            factor: DMat3::from_diagonal(DVec3::splat(0.6)),
            mass: 0.1,
            colour: [1.0, 0.5, 0.2],
        });
    }
    let camera = camera(Projection::Perspective, [60.0; 2], [64, 64]);
    let render = |filter| {
        let settings = Settings {
            filter,
            tolerance: 1e-3,
            cutoff: Some(6.0),
            ..Settings::default()
        };
        let mut renderer = Renderer::new(vec![volume(&particles)]).unwrap();
        renderer.render(&camera, &settings).unwrap().clone()
    };
    let error = difference(&render(Filter::Adaptive), &render(Filter::Exact));
    assert!(error <= 1e-3, "{error}");
}
