//! Tests kernels summed in sheets and slabs, and cut by clip planes: laws, the true integral, and
//! the GPU back end against the CPU's.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::scene::{Particle, camera, difference, volume};
use crate::common::{Random, some};
use ewa_splat::Composite;
use ewa_splat::Filter;
use ewa_splat::math::normal_cdf;
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceSettings};
use ewa_splat::render::{Advanced, SimdLevel};
use ewa_splat::scene::{
    Colour, Particles, PointVolume, SplatRule, Strength, TransferFunction, Values,
};
use ewa_splat::stages::constants::COVERAGE_FULL;
use ewa_splat::view::{Camera, ClipPlane, Projection};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DMat3, DVec2, DVec3};

/// Modes that sum kernels before they are composited.
const LAYERED: [Composite; 3] = [Composite::SHEETS, Composite::AXIS_SHEETS, Composite::SLABS];

fn settings(composite: Composite) -> Settings {
    Settings {
        composite,
        cutoff: Some(6.0),
        tolerance: 1e-5,
        level_of_detail: false,
        ..Settings::default()
    }
}

/// Draws on the CPU and, if there is an adapter, on the GPU, and checks that the pictures are
/// alike.
#[track_caller]
fn draw(scene: &[PointVolume], camera: &Camera, settings: &Settings) -> Renderer {
    let settings = Settings {
        advanced: Advanced {
            // The CPU uses no fused operations, as the device uses none.
            simd: SimdLevel::Baseline,
            ..settings.advanced
        },
        ..settings.clone()
    };
    let mut on_cpu = Renderer::new(scene.to_vec()).unwrap();
    on_cpu.render(camera, &settings).unwrap();
    #[cfg(feature = "gpu")]
    if let Some(gpu) = crate::common::gpu::pictures() {
        let on_gpu = Renderer::new(scene.to_vec()).unwrap();
        let mut on_gpu = on_gpu.on(gpu.clone()).unwrap();
        on_gpu.render(camera, &settings).unwrap();
        assert_twins(&on_cpu, &on_gpu);
    }
    on_cpu
}

/// Compares pictures of the two back ends. f32 roundings differ in order along rays of many layers.
/// It excludes pixels where a kernel ends within rounding of the pixel's centre, or begins within
/// rounding of another layer.
#[cfg(feature = "gpu")]
#[track_caller]
fn assert_twins(a: &Renderer, b: &Renderer) {
    use crate::common::gpu::is_software;

    const ALIKE: f32 = 5e-5;
    let flips = |a: &Image, b: &Image| {
        let pixels = a.pixels.iter().zip(&b.pixels);
        let differs = |(p, q): &(&[f32; 4], &[f32; 4])| {
            !p.iter().zip(*q).all(|(x, y)| (x - y).abs() <= ALIKE)
        };
        pixels.filter(differs).count()
    };
    let (count, most) = (
        flips(a.image(), b.image()),
        difference(a.image(), b.image()),
    );
    let pixels = a.image().pixels.len();
    println!("{count} of {pixels} pixels differ, the most by {most:.1e}");
    // A graphics card fuses operations, which moves the exponents of needles by more.
    let few = if is_software() { 0 } else { 2 };
    assert!(
        count <= few + pixels / 500 && most < 0.02,
        "{count} of {pixels}, {most}"
    );
    let (c, d) = (a.counts(), b.counts());
    let off = c.splat_pixels.abs_diff(d.splat_pixels);
    assert!(off <= 4 + c.splat_pixels / 1000, "{c:?} {d:?}");
    assert_eq!(c.blocks_culled, d.blocks_culled);
    assert_eq!(a.depth().is_some(), b.depth().is_some());
    if let (Some(a), Some(b)) = (a.depth(), b.depth()) {
        let pairs = a.depths.iter().zip(&b.depths);
        let differs = |(x, y): &(&f32, &f32)| !((*x - *y).abs() <= 1e-4 * x.abs() || x == y);
        let count = pairs.filter(differs).count();
        assert!(count <= 2 + pixels / 200, "{count} of {pixels} depths");
    }
}

/// Returns 120 kernels of standard deviation 1 along 40 units of depth, all on the axis of an
/// orthographic camera. Masses and colours are random, and the total depth at the centre is
/// `depth`.
fn pile(random: &mut Random, depth: f64) -> (Vec<Particle>, Camera) {
    let weights: Vec<f64> = (0..120).map(|_| random.range(0.2, 1.8)).collect();
    let sum: f64 = weights.iter().sum();
    let particles = weights.iter().map(|w| {
        let z = random.range(5.0, 45.0);
        // The integral along the axis of a unit sphere is 1 / 2 pi.
        let mass = depth * w / sum * std::f64::consts::TAU;
        let colour = [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32);
        Particle::sphere(DVec3::new(0.0, 0.0, z), 1.0, mass).coloured(colour)
    });
    let camera = camera(Projection::Orthographic, [4.0, 4.0], [5, 5]);
    (particles.collect(), camera)
}

/// Integrates the light along the rays through pixel centres, unfiltered, in f64.
fn truth(scene: &[PointVolume], camera: &Camera, clip: &[ClipPlane]) -> Image {
    let integrator = Integrator::new(scene).unwrap().clipped(clip);
    let settings = ReferenceSettings {
        error: 1e-8,
        low_pass_variance_px2: 0.0,
        pixel_filter: PixelFilter::Image,
        ..ReferenceSettings::default()
    };
    integrator.render(camera, &settings).unwrap().image
}

#[test]
fn slabs_converge_with_the_square_of_their_thickness() {
    for depth in [2.0, 8.0, 40.0] {
        let mut worst = [0.0_f32; 4];
        let mut random = Random::new(41);
        for _ in 0..12 {
            let (particles, camera) = pile(&mut random, depth);
            let scene = [volume(&particles)];
            let truth = truth(&scene, &camera, &[]);
            for (worst, thickness) in worst.iter_mut().zip([2.0, 1.0, 0.5, 0.25]) {
                let settings = Settings {
                    low_pass_variance_px2: 0.0,
                    ..settings(Composite::SLABS.with_thickness(Some(thickness)))
                };
                let mut renderer = Renderer::new(scene.to_vec()).unwrap();
                let image = renderer.render(&camera, &settings).unwrap();
                *worst = worst.max(difference(image, &truth));
            }
        }
        let ratios = [0, 1, 2].map(|i| worst[i] / worst[i + 1]);
        println!("depth {depth}: {worst:?}, ratios {ratios:?}");
        // kappa D^2 / sigma at D = 1: within four times the worst of other random piles.
        let kappa = depth as f32 / 40.0;
        assert!(worst[1] < 0.04 * kappa, "depth {depth}: {worst:?}");
        // The error is of second order once a slab is as thin as a kernel; f32 limits the thinnest.
        assert!(
            ratios[1] > 3.4 && ratios[1] < 4.8,
            "depth {depth}: {ratios:?}"
        );
        assert!(
            ratios[2] > 3.4 && ratios[2] < 4.8,
            "depth {depth}: {ratios:?}"
        );
    }
}

#[test]
fn the_thickness_that_follows_keeps_the_tolerance() {
    // Extinctions and volumes differ from those that the kernels' widths would suggest.
    let mut random = Random::new(31);
    for density in [0.3, 3.0, 30.0] {
        let (particles, camera) = pile(&mut random, density);
        let cells = particles.iter().map(|p| p.mass).collect();
        let values: Vec<f32> = particles
            .iter()
            .map(|_| random.range(0.0, 1.0) as f32)
            .collect();
        let colour = |value: f32| [value, 0.5, 1.0 - value];
        let transfer =
            TransferFunction::from_curves(colour, |_| 0.632_120_56, [0.0, 1.0], 1.0).unwrap();
        let scene = [PointVolume {
            strength: Strength::Classified { volumes: cells },
            colour: Colour::Classified,
            values: Some(Values::F32(values)),
            transfer_function: Some(transfer),
            ..volume(&particles)
        }];
        let truth = truth(&scene, &camera, &[]);
        for tolerance in [0.02, 0.002] {
            let settings = Settings {
                tolerance,
                low_pass_variance_px2: 0.0,
                ..settings(Composite::SLABS)
            };
            let mut renderer = Renderer::new(scene.to_vec()).unwrap();
            let off = difference(renderer.render(&camera, &settings).unwrap(), &truth);
            let layers = renderer.layers().unwrap();
            println!(
                "depth {density}, {tolerance}: {off:.1e} at {:.3}",
                layers.thickness
            );
            assert!(off < tolerance, "{density} {tolerance}: {off}");
            assert!(layers.error <= f64::from(tolerance), "{layers:?}");
        }
    }
}

#[test]
fn no_scene_is_refused_at_its_own_thickness() {
    // Small kernels lie far apart, so that their levels of detail are wide. One vast kernel is
    // transparent.
    let mut random = Random::new(13);
    let small =
        (0..5_000).map(|_| Particle::sphere(random.point(1.0) + DVec3::Z * 5.0, 0.002, 1e-4));
    let vast = Particle::sphere(DVec3::Z * 5.0, 1e4, 0.0);
    let scene = [volume(&small.collect::<Vec<_>>()), volume(&[vast])];
    let camera = camera(Projection::Perspective, [60.0; 2], [32, 32]);
    let defaults = Settings {
        composite: Composite::SLABS,
        ..Settings::default()
    };
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer.render(&camera, &defaults).unwrap();
    assert!(renderer.layers().unwrap().thickness < 0.005);
    assert_eq!(renderer.counts().blocks_merged, 0);
}

#[test]
fn opacity_is_the_same_in_every_mode() {
    let mut random = Random::new(7);
    for projection in [Projection::Orthographic, Projection::Perspective] {
        let (particles, mut camera) = crate::common::scene::overlapping(&mut random);
        camera.projection = projection;
        if projection == Projection::Orthographic {
            camera.focal_px /= 4.5;
        }
        let scene = [volume(&particles[..100])];
        let over = draw(&scene, &camera, &settings(Composite::Over));
        for mode in LAYERED {
            let settings = Settings {
                depth: true,
                ..settings(mode)
            };
            let layered = draw(&scene, &camera, &settings);
            let pairs = over.image().pixels.iter().zip(&layered.image().pixels);
            // The exponential of a sum differs from a product of many by roundings, and by the
            // tails of slices.
            let most = pairs.map(|(a, b)| (a[3] - b[3]).abs()).fold(0.0, f32::max);
            assert!(most < 2e-5, "{mode:?} {projection:?}: {most}");
            assert_eq!(
                over.counts().splat_pixels,
                layered.counts().splat_pixels,
                "{mode:?}"
            );
        }
    }
}

#[test]
fn kernels_in_one_place_mix() {
    // Optical depths are 1 (red) and 2 (green): `coincident` of fixtures/analytic_cases.json.
    let expected = (1.0 - (-3.0_f64).exp()) / 3.0;
    assert!((expected - 0.316_737_643_877).abs() < 1e-12);
    let place = DVec3::new(0.0, 0.0, 10.0);
    let mass = |tau: f64| tau * std::f64::consts::TAU;
    let scene = [volume(&[
        Particle::sphere(place, 1.0, mass(1.0)).coloured([1.0, 0.0, 0.0]),
        Particle::sphere(place, 1.0, mass(2.0)).coloured([0.0, 1.0, 0.0]),
    ])];
    let camera = camera(Projection::Orthographic, [4.0, 4.0], [1, 1]);
    for mode in LAYERED {
        let settings = Settings {
            low_pass_variance_px2: 0.0,
            ..settings(mode)
        };
        let pixel = draw(&scene, &camera, &settings).image().pixel(0, 0);
        // The opacity's own rounding.
        assert!(
            (f64::from(pixel[0]) - expected).abs() < 1e-6,
            "{mode:?}: {pixel:?}"
        );
        assert!(
            (f64::from(pixel[1]) - 2.0 * expected).abs() < 1e-6,
            "{mode:?}: {pixel:?}"
        );
    }
}

#[test]
fn nothing_depends_on_where_the_scene_is_cut_into_layers() {
    // The order of two sheets of kernels is right from either side, with a thickness of half their
    // distance.
    let near = Particle::sphere(DVec3::new(0.0, 0.0, 8.0), 0.3, 3.0).coloured([1.0, 0.0, 0.0]);
    let far = Particle::sphere(DVec3::new(0.0, 0.0, 12.0), 0.3, 3.0).coloured([0.0, 0.0, 1.0]);
    let scene = [volume(&[far, near])];
    let camera = camera(Projection::Perspective, [300.0, 300.0], [24, 24]);
    let over = draw(&scene, &camera, &settings(Composite::Over));
    for mode in LAYERED {
        for thickness in [0.5, 1.3, 2.0] {
            let settings = Settings {
                ..settings(mode.with_thickness(Some(thickness)))
            };
            let layered = draw(&scene, &camera, &settings);
            let off = difference(over.image(), layered.image());
            // Kernels 13 standard deviations apart do not mix.
            assert!(off < 1e-5, "{mode:?} {thickness}: {off}");
        }
    }
}

#[test]
fn planes_cut_kernels_where_they_cross_them() {
    let mut random = Random::new(19);
    for round in 0..6 {
        let projection = if round % 2 == 0 {
            Projection::Perspective
        } else {
            Projection::Orthographic
        };
        let focal = if round % 2 == 0 { 40.0 } else { 5.0 };
        let camera = camera(projection, [focal, focal], [24, 20]);
        let particles: Vec<Particle> = (0..12)
            .map(|_| Particle {
                position: random.point(2.0) + DVec3::Z * 8.0,
                factor: random.factor(1.2, 4.0),
                mass: random.range(1.0, 6.0) as f32,
                // With one colour, the remainder does not depend on the order.
                colour: [0.9, 0.5, 0.1],
            })
            .collect();
        let planes: Vec<ClipPlane> = (0..1 + round / 2)
            .map(|_| {
                let normal = random.point(1.0);
                let through = random.point(1.0) + DVec3::Z * 8.0;
                ClipPlane {
                    normal,
                    distance: -normal.dot(through),
                }
            })
            .collect();
        let scene = [volume(&particles)];
        let truth = truth(&scene, &camera, &planes);
        for mode in Composite::ALL {
            let settings = Settings {
                clip: planes.clone(),
                filter: Filter::Exact,
                low_pass_variance_px2: 0.0,
                depth: true,
                ..settings(mode)
            };
            let clipped = draw(&scene, &camera, &settings);
            let depth = clipped.depth().unwrap();
            for (i, &z) in depth
                .depths
                .iter()
                .enumerate()
                .filter(|(_, z)| z.is_finite())
            {
                // Depths lie in the kept part, except for roundings.
                let pixel = DVec2::new((i % 24) as f64 + 0.5, (i / 24) as f64 + 0.5);
                let d = ((pixel - camera.centre_px) / camera.focal_px).extend(1.0);
                let z = f64::from(z);
                let at = match projection {
                    Projection::Perspective => d * z,
                    Projection::Orthographic => d.with_z(z),
                };
                let inside = planes.iter().map(|plane| plane.inside(at));
                let least = inside.fold(f64::INFINITY, f64::min);
                assert!(least > -1e-4, "{round} {mode:?}: {at} by {least}");
            }
            let off = difference(clipped.image(), &truth);
            println!("{round} {mode:?}: {off:.1e}");
            // f32 along rays of twelve kernels, 1e-5, and the part beyond the cut-off at six.
            assert!(off < 5e-5, "{round} {mode:?}: {off}");
        }
    }
}

#[test]
fn needles_are_cut_as_well_as_drawn() {
    let mut random = Random::new(23);
    for ratio in [30.0, 1e3, 1e4] {
        for (projection, near) in [
            (Projection::Perspective, 8.0),
            (Projection::Orthographic, 8.0),
            // The kernels cross the eye's plane.
            (Projection::Orthographic, 0.4),
        ] {
            let focal = match projection {
                Projection::Perspective => 40.0,
                Projection::Orthographic => 5.0,
            };
            let camera = camera(projection, [focal, focal], [11, 11]);
            let mut worst = [0.0_f32; 2];
            for _ in some(0..5, 0, 3) {
                // The ray through the middle pixel meets it away from its centre.
                let turn = random.rotation();
                let middle = DVec3::Z * near;
                let along = turn * DVec3::Z * random.range(0.3, 1.5);
                let needle = Particle {
                    position: middle - along,
                    factor: turn * DMat3::from_diagonal(DVec3::new(1.0, 1.0, ratio) / ratio),
                    mass: (6.0 / ratio) as f32,
                    colour: [0.9, 0.5, 0.1],
                };
                let scene = [volume(&[needle])];
                let normal = random.point(1.0).normalize();
                let through = middle + along / ratio * random.range(-1.0, 1.0);
                let plane = ClipPlane {
                    normal,
                    distance: -normal.dot(through),
                };
                for (worst, clip) in worst.iter_mut().zip([vec![], vec![plane]]) {
                    let truth = truth(&scene, &camera, &clip);
                    let settings = Settings {
                        clip,
                        filter: Filter::Exact,
                        low_pass_variance_px2: 0.0,
                        ..settings(Composite::Over)
                    };
                    let drawn = draw(&scene, &camera, &settings);
                    *worst = worst.max(difference(drawn.image(), &truth));
                    // Fused operations round differently, relative to a needle's width: the bound
                    // scales with that effect.
                    let mut fused = Renderer::new(scene.to_vec()).unwrap();
                    let simd = SimdLevel::best();
                    fused
                        .render(
                            &camera,
                            &Settings {
                                advanced: Advanced {
                                    simd,
                                    ..settings.advanced
                                },
                                ..settings
                            },
                        )
                        .unwrap();
                    let apart = difference(drawn.image(), fused.image());
                    assert!(apart < 5e-5, "1:{ratio} {projection:?}: {apart:e}");
                }
            }
            println!(
                "1:{ratio:e} {projection:?} at {near}: {:.1e} whole, {:.1e} cut",
                worst[0], worst[1]
            );
            // f32 roundings times the ratio of the axes, as for the footprint itself.
            let bound = 3e-5 + 3e-7 * ratio as f32;
            assert!(worst[1] < bound, "1:{ratio} {projection:?}: {worst:?}");
        }
    }
}

#[test]
fn needles_along_the_ray_reach_no_more_slabs_than_they_have() {
    // A kernel a million times as long as wide, nearly along the ray: its slope consists of
    // roundings.
    let mut random = Random::new(5);
    let camera = camera(Projection::Perspective, [400.0; 2], [20, 20]);
    for round in 0..12 {
        let length = if round % 2 == 0 { 1.0 } else { 100.0 };
        let tilt = random.range(1e-7, 1e-5);
        let needle = Particle {
            position: DVec3::Z * 1000.0,
            factor: DMat3::from_cols(
                DVec3::X * 1e-6 * length,
                DVec3::Y * 1e-6 * length,
                DVec3::new(tilt, 0.3 * tilt, 1.0) * length,
            ),
            mass: 1e-3,
            colour: [0.9, 0.5, 0.1],
        };
        let scene = [volume(&[needle])];
        let over = draw(&scene, &camera, &settings(Composite::Over));
        for filter in [Filter::Exact, Filter::UniformScaling] {
            let settings = Settings {
                filter,
                ..settings(Composite::SLABS)
            };
            let slabs = draw(&scene, &camera, &settings);
            if filter == Filter::Exact {
                let off = difference(over.image(), slabs.image());
                assert!(off < 2e-5, "{round}: {off}");
            }
        }
    }
}

#[test]
fn a_box_leaves_nothing_outside() {
    let mut random = Random::new(3);
    let particles: Vec<Particle> = (0..200)
        .map(|_| Particle::sphere(random.point(3.0) + DVec3::Z * 10.0, 0.5, 1.0))
        .collect();
    let scene = [volume(&particles)];
    let camera = camera(Projection::Orthographic, [8.0, 8.0], [64, 64]);
    let (lower, upper) = (DVec3::new(-1.0, -2.0, 9.0), DVec3::new(1.5, 1.0, 11.0));
    for mode in Composite::ALL {
        let settings = Settings {
            clip: ClipPlane::of_box(lower, upper).to_vec(),
            low_pass_variance_px2: 0.0,
            ..settings(mode)
        };
        let image = draw(&scene, &camera, &settings).image().clone();
        for y in 0..64 {
            for x in 0..64 {
                let at = [x, y].map(|n| (n as f64 + 0.5 - 32.0) / 8.0);
                let is_inside = at[0] > -1.0 && at[0] < 1.5 && at[1] > -2.0 && at[1] < 1.0;
                let alpha = image.pixel(x, y)[3];
                assert_eq!(alpha > 0.0, is_inside, "{mode:?} {x} {y}: {alpha}");
            }
        }
    }
}

#[test]
fn what_lies_beyond_a_plane_by_less_than_the_filter_counts() {
    // Kernels far below a pixel: the filter spreads half of the edge's over the plane.
    let mut random = Random::new(29);
    let mut some = |from: f64, to: f64| -> Vec<Particle> {
        let at =
            |random: &mut Random| DVec3::new(random.range(from, to), random.range(-1.0, 1.0), 8.0);
        (0..2_000)
            .map(|_| Particle::sphere(at(&mut random), 1e-3, 2e-4))
            .collect()
    };
    let (kept, beyond) = (some(-1.0, 0.0), some(0.06, 1.0));
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let focal = match projection {
            Projection::Perspective => 64.0,
            Projection::Orthographic => 8.0,
        };
        let camera = camera(projection, [focal; 2], [24, 24]);
        let settings = Settings {
            clip: vec![ClipPlane {
                normal: DVec3::NEG_X,
                distance: 0.05,
            }],
            ..settings(Composite::Over)
        };
        let scene = [volume(&kept), volume(&beyond)];
        let whole = Settings {
            clip: vec![],
            ..settings.clone()
        };
        let [cut, whole] = [&settings, &whole].map(|s| draw(&scene, &camera, s));
        for y in 0..24 {
            // Half of the column at the plane, whose kept side includes its centre, comes from
            // beyond.
            let [a, b] = [&cut, &whole].map(|r| r.image().pixel(11, y)[3]);
            assert!((a - b).abs() < 1e-5, "{projection:?} {y}: {a}, not {b}");
        }
        assert!(whole.image().pixel(11, 12)[3] > 0.1);
    }
}

#[test]
fn the_eye_may_lie_within_a_kernel() {
    let kernel = Particle {
        position: DVec3::new(0.1, -0.1, 0.2),
        factor: DMat3::from_diagonal(DVec3::new(1.0, 0.7, 0.5)),
        mass: 8.0,
        colour: [0.3, 0.6, 0.9],
    };
    let beyond = Particle::sphere(DVec3::new(0.3, 0.2, 6.0), 0.5, 4.0).coloured([0.3, 0.6, 0.9]);
    let scene = [volume(&[kernel, beyond])];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let focal = if projection == Projection::Perspective {
            [30.0; 2]
        } else {
            [10.0; 2]
        };
        let camera = camera(projection, focal, [32, 32]);
        let over = draw(&scene, &camera, &settings(Composite::Over));
        for mode in LAYERED {
            let settings = Settings {
                ..settings(mode.with_thickness(Some(0.2)))
            };
            let layered = draw(&scene, &camera, &settings);
            // With one colour, the order does not matter, and each kernel is whole.
            let off = difference(over.image(), layered.image());
            assert!(off < 2e-5, "{projection:?} {mode:?}: {off}");
        }
    }
}

/// Returns a square of surfels across the axis at z = 8, of which the lower left part exists.
fn wall(colour: [f32; 3]) -> PointVolume {
    let (mut positions, mut tangents, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let step = 0.1;
    for y in -30..30 {
        for x in -30..30 {
            positions.push(DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 80.0) * step);
            let s = (0.6 * step) as f32;
            tangents.push([s, 0.0, 0.0, 0.0, s, 0.0]);
            areas.push((step * step) as f32);
        }
    }
    PointVolume::new(
        Particles::Surfels {
            positions,
            tangents,
            is_one_sided: false,
        },
        Strength::Surface(areas),
    )
    .with_colour(colour)
}

#[test]
fn a_cut_shows_the_inside_of_a_closed_surface() {
    // The wall faces away, as the far side of a closed surface.
    let mut back = wall([0.2, 0.5, 0.9]);
    if let Particles::Surfels { is_one_sided, .. } = &mut back.particles {
        *is_one_sided = true;
    }
    let camera = camera(Projection::Perspective, [30.0; 2], [24, 24]);
    for (clip, seen) in [
        (vec![], 0.0),
        (
            vec![ClipPlane {
                normal: DVec3::Z,
                distance: -4.0,
            }],
            1.0,
        ),
    ] {
        let settings = Settings {
            clip,
            ..settings(Composite::Over)
        };
        let renderer = draw(std::slice::from_ref(&back), &camera, &settings);
        let alpha = renderer.image().pixel(12, 12)[3];
        assert!((alpha - seen).abs() < 0.01, "{alpha}");
    }
}

#[test]
fn surfaces_look_the_same_in_every_mode() {
    // A ball, seen from a direction that is no axis of the world.
    let (mut positions, mut tangents, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let count = 3_000;
    for i in 0..count {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let angle = f64::from(i) * 2.399_963;
        let normal =
            DVec3::new(angle.cos(), angle.sin(), 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z;
        let a = normal.any_orthonormal_vector() * 0.06;
        let b = normal.cross(a);
        positions.push(normal);
        tangents.push([a.x, a.y, a.z, b.x, b.y, b.z].map(|x| x as f32));
        areas.push((4.0 * std::f64::consts::PI / f64::from(count)) as f32);
    }
    let colours = positions.iter().map(|n| (*n * 0.5 + 0.5).as_vec3().into());
    let ball = PointVolume {
        colour: Colour::PerParticle(colours.collect()),
        particles: Particles::Surfels {
            positions,
            tangents,
            is_one_sided: false,
        },
        strength: Strength::Surface(areas),
        ..wall([0.0; 3])
    };
    let eye = DVec3::new(2.0, -2.2, 2.1);
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 35.0, [64, 64]);
    let over = draw(
        std::slice::from_ref(&ball),
        &camera,
        &settings(Composite::Over),
    );
    assert!(over.image().pixel(32, 32)[3] > 0.99);
    for mode in LAYERED {
        let layered = draw(std::slice::from_ref(&ball), &camera, &settings(mode));
        assert_eq!(over.image(), layered.image(), "{mode:?}");
    }
}

#[test]
fn long_lists_of_surfels_are_clipped_to_their_end() {
    // 40,000 kernels in one tile: more than half of the iterations that a software adapter allows a
    // loop.
    let step = 0.03;
    let count = 200;
    let positions = (0..count * count)
        .map(|i| DVec3::new(f64::from(i % count), f64::from(i / count), 0.0) * step)
        .map(|x| x + DVec3::new(-3.0, -3.0, 8.0))
        .collect();
    let s = (0.6 * step) as f32;
    let dense = PointVolume {
        particles: Particles::Surfels {
            positions,
            tangents: vec![[s, 0.0, 0.0, 0.0, s, 0.0]; count as usize * count as usize],
            is_one_sided: false,
        },
        strength: Strength::Surface(vec![(step * step) as f32; count as usize * count as usize]),
        ..wall([0.2, 0.5, 0.9])
    };
    let camera = camera(Projection::Perspective, [16.0; 2], [16, 16]);
    let far_away = ClipPlane {
        normal: DVec3::X,
        distance: 100.0,
    };
    let settings = Settings {
        clip: vec![far_away; 4],
        ..settings(Composite::Over)
    };
    let renderer = draw(&[dense], &camera, &settings);
    assert!(renderer.image().pixel(8, 8)[3] > 0.99);
}

#[test]
fn surfaces_among_layers_cut_them() {
    let mut random = Random::new(23);
    let particles: Vec<Particle> = (0..150)
        .map(|_| {
            let at = random.point(2.0) + DVec3::Z * 8.0;
            Particle::sphere(at, 0.4, 0.5).coloured([0.2, 0.7, 0.4])
        })
        .collect();
    let scene = [volume(&particles), wall([0.8, 0.1, 0.1])];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let focal = if projection == Projection::Perspective {
            100.0
        } else {
            12.0
        };
        let camera = camera(projection, [focal; 2], [90, 80]);
        let over = draw(&scene, &camera, &settings(Composite::Over));
        for mode in LAYERED {
            let settings = Settings {
                depth: true,
                ..settings(mode)
            };
            let layered = draw(&scene, &camera, &settings);
            let off = difference(over.image(), layered.image());
            // In front of the wall and behind it, kernels have one colour, so each mode sums the
            // same. Kernels and wall differ in colour. Both sides use affine terms.
            assert!(off < 1e-4, "{projection:?} {mode:?}: {off}");
        }
    }
}

#[test]
fn clipped_surfaces_end_softly_at_the_cut() {
    // Seen from the front at 20 pixels per unit, the cut is a line between pixels 40 and 41.
    let camera = camera(Projection::Orthographic, [20.0; 2], [80, 40]);
    let plane = ClipPlane {
        normal: DVec3::new(2.0, 0.0, 0.0),
        distance: -0.05,
    };
    let settings = Settings {
        clip: vec![plane],
        ..settings(Composite::Over)
    };
    let scene = [wall([1.0; 3])];
    let image = draw(&scene, &camera, &settings).image().clone();
    let whole = draw(
        &scene,
        &camera,
        &Settings {
            clip: Vec::new(),
            ..settings.clone()
        },
    );
    let whole = whole.image();
    for x in 0..80 {
        // Left of x = .025, half a pixel right of the middle of the image, nothing is left.
        let inside = x as f64 + 0.5 - 40.5;
        let (left, all) = (image.pixel(x, 20)[3], whole.pixel(x, 20)[3]);
        if inside > 3.5 {
            assert!((left - all).abs() < 1e-3, "{x}: {left}");
        } else {
            // The filtered half-plane, with coverage from sums of weights. These ripple by .02, and
            // a cut surfel's share is one of its mean.
            let half_plane = normal_cdf(inside as f32);
            let expected = if half_plane <= 0.5 {
                half_plane
            } else {
                (0.5 + (half_plane - 0.5) * (0.5 / (COVERAGE_FULL - 0.5))).min(1.0)
            };
            assert!((left - expected).abs() < 0.03, "{x}: {left} for {expected}");
        }
    }
    let camera = crate::common::scene::camera(Projection::Perspective, [150.0; 2], [80, 40]);
    let slanted = Settings {
        clip: vec![
            ClipPlane {
                normal: DVec3::new(1.0, 0.4, -0.2),
                distance: 1.4,
            },
            plane,
        ],
        normals: true,
        depth: true,
        ..settings
    };
    let clipped = draw(&scene, &camera, &slanted);
    for (i, pixel) in clipped.image().pixels.iter().enumerate() {
        let (x, y) = (i % 80, i / 80);
        // The point at which the ray meets the wall.
        let at = DVec3::new(
            (x as f64 + 0.5 - 40.0) / 150.0 * 8.0,
            (y as f64 + 0.5 - 20.0) / 150.0 * 8.0,
            8.0,
        );
        let px = 8.0 / 150.0;
        let inside = slanted.clip.iter().map(|p| {
            let unit = p.normalised().unwrap();
            // The distance on the wall, in pixels.
            unit.inside(at) / unit.normal.truncate().length() / px
        });
        let inside = inside.fold(f64::INFINITY, f64::min);
        if inside > 3.5 {
            assert!(pixel[3] > 0.99, "{x} {y}: {pixel:?}");
        } else if inside < -3.5 {
            assert!(pixel[3] < 1e-3, "{x} {y}: {pixel:?}");
        }
    }
}

#[test]
fn a_face_on_its_own_plane_stays_whole() {
    // Surfels far below a pixel, and several with a twentieth of their width inside an oblique
    // plane.
    let turn = DMat3::from_rotation_y(0.9) * DMat3::from_rotation_x(0.4);
    let mut scene = wall([1.0; 3]);
    let Particles::Surfels {
        positions,
        tangents,
        ..
    } = &mut scene.particles
    else {
        panic!("surfels");
    };
    let middle = DVec3::Z * 8.0;
    for at in positions {
        *at = middle + turn * (*at - middle);
    }
    for pair in tangents {
        let turned = [0, 3].map(|i| {
            let t = DVec3::new(pair[i].into(), pair[i + 1].into(), pair[i + 2].into());
            (turn * t).as_vec3().to_array()
        });
        *pair = turned.concat().try_into().unwrap();
    }
    let normal = turn * DVec3::Z;
    let plane = ClipPlane {
        normal,
        distance: 0.003 - normal.dot(middle),
    };
    for focal in [5.0, 40.0, 600.0] {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let per_unit = if projection == Projection::Perspective {
                focal
            } else {
                focal / 8.0
            };
            let camera = camera(projection, [per_unit; 2], [40, 40]);
            let whole = settings(Composite::Over);
            let clipped = Settings {
                clip: vec![plane],
                ..whole.clone()
            };
            let off = difference(
                draw(std::slice::from_ref(&scene), &camera, &whole).image(),
                draw(std::slice::from_ref(&scene), &camera, &clipped).image(),
            );
            // Surfels whose centres lie inside are cut only by roundings. These decide at pixels
            // that see a surfel's plane near its horizon, in the tails of its filtered kernel.
            assert!(off < 5e-3, "{focal} {projection:?}: {off}");
        }
    }
}

#[test]
fn many_layers_and_long_lists_are_carried() {
    // Kernels of very different sizes in thin slabs need rings with more than the initial number of
    // slots.
    let mut random = Random::new(31);
    let particles: Vec<Particle> = (0..400)
        .map(|_| Particle {
            position: random.point(2.0) + DVec3::Z * 9.0,
            factor: random.factor(0.8, 8.0),
            mass: random.range(0.02, 0.3) as f32,
            colour: [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect();
    let scene = [volume(&particles)];
    let camera = camera(Projection::Perspective, [60.0; 2], [48, 48]);
    let of = |thickness: f64, linear: bool| {
        let settings = Settings {
            advanced: Advanced {
                linear_opacity: linear,
                ..settings(Composite::SLABS.with_thickness(Some(thickness))).advanced
            },
            depth: true,
            ..settings(Composite::SLABS.with_thickness(Some(thickness)))
        };
        draw(&scene, &camera, &settings).image().clone()
    };
    let (thin, thinner) = (of(0.08, false), of(0.04, false));
    // .01 kappa D^2 / sigma, with kappa below 20 and sigma .1 at D = .08: .013; measured far less.
    assert!(difference(&thin, &thinner) < 0.01);
    of(0.08, true);
}

#[test]
fn splats_and_absurd_layers_are_refused() {
    let camera = camera(Projection::Perspective, [60.0; 2], [16, 16]);
    let scene = volume(&[Particle::sphere(DVec3::Z * 5.0, 0.5, 1.0)]);
    let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
    // The last but one: 14 standard deviations in 7,000 slabs.
    for thickness in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-3, 1e-12] {
        let settings = Settings {
            ..settings(Composite::SLABS.with_thickness(Some(thickness)))
        };
        let error = renderer.render(&camera, &settings).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("thickness"), "{error}");
        // The thickness that the error recommends is enough.
        if let Some((_, rest)) = error.split_once("at least ") {
            let least = rest.split_once(' ').unwrap().0.parse().unwrap();
            let settings = Settings {
                composite: settings.composite.with_thickness(Some(least)),
                ..settings
            };
            renderer.render(&camera, &settings).unwrap();
        }
    }
    let plane = ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
    };
    let zero = ClipPlane {
        normal: DVec3::ZERO,
        ..plane
    };
    for clip in [vec![plane; 9], vec![zero]] {
        let settings = Settings {
            clip,
            ..Settings::default()
        };
        let error = renderer.render(&camera, &settings).unwrap_err();
        assert!(error.to_string().contains("clip plane"), "{error}");
    }
    let splats = PointVolume {
        strength: Strength::PeakOpacity {
            opacities: vec![0.5],
            rule: SplatRule::Exact,
            by_distance: false,
        },
        ..scene
    };
    let mut renderer = Renderer::new(vec![splats]).unwrap();
    let error = renderer
        .render(&camera, &settings(Composite::SLABS))
        .unwrap_err();
    assert!(error.to_string().contains("over"), "{error}");
}
