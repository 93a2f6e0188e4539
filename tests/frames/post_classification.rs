//! Tests slabs that are classified and lit by the mean value of a field in them: laws, an f64
//! reference, and the GPU back end against the CPU's.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::scene::{Particle, camera, difference, volume};
use ewa_splat::Composite;
use ewa_splat::render::{Advanced, Classification};
use ewa_splat::scene::{
    Lattice, LatticeSpacing, Light, LightFrame, Lighting, LocalModel, LocalModels, Particles,
    PointVolume, Strength, TransferFunction, Values,
};
use ewa_splat::stages::cpu::{Sides, SimdLevel, lit};
use ewa_splat::stages::record::LightingUniform;
use ewa_splat::view::{Camera, ClipPlane, Projection};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DMat3, DVec3, Vec3};

/// Nodes along each axis, about a unit apart.
const NODES: usize = 17;
/// Depth of the middle one.
const MIDDLE: f64 = 24.0;

/// Returns a lattice in front of the eye with a field.
fn field(of: impl Fn(DVec3) -> f64, transfer: TransferFunction) -> PointVolume {
    // It is sheared, so that kernels are oblique to the rays.
    let step = DMat3::from_cols(
        DVec3::new(1.0, 0.2, 0.25),
        DVec3::new(-0.1, 1.0, 0.2),
        DVec3::new(0.2, -0.15, 1.0),
    );
    let origin = DVec3::Z * MIDDLE - step * DVec3::splat((NODES - 1) as f64 / 2.0);
    let lattice = Lattice {
        dims: [NODES; 3],
        spacing: LatticeSpacing::Uniform { origin, step },
    };
    let nodes = (0..lattice.len()).map(|i| [i % NODES, i / NODES % NODES, i / (NODES * NODES)]);
    let values: Vec<f32> = nodes
        .map(|cell| of(lattice.position(cell)) as f32)
        .collect();
    PointVolume::lattice(lattice, values, transfer)
}

/// Returns the same field on single spheres, at random offsets from the nodes.
fn spheres(of: impl Fn(DVec3) -> f64, transfer: TransferFunction) -> PointVolume {
    let mut random = Random::new(7);
    let at_nodes = field(&of, transfer);
    let Particles::Lattice { lattice, .. } = &at_nodes.particles else {
        unreachable!()
    };
    let nodes = (0..lattice.len()).map(|i| [i % NODES, i / NODES % NODES, i / (NODES * NODES)]);
    let positions: Vec<_> = nodes
        .map(|cell| lattice.position(cell) + random.point(0.2))
        .collect();
    let values = positions.iter().map(|x| of(*x) as f32).collect();
    PointVolume {
        strength: Strength::Classified {
            volumes: vec![1.0; positions.len()],
        },
        values: Some(Values::F32(values)),
        particles: Particles::Isotropic {
            sigmas: vec![0.6; positions.len()],
            positions,
        },
        ..at_nodes
    }
}

/// Returns colours from blue to yellow, and an extinction that steps up where the field exceeds a
/// half.
fn step() -> TransferFunction {
    let opacity = |value: f32| if value > 0.5 { 0.2 } else { 0.0 };
    TransferFunction::from_curves(colours, opacity, [0.0, 1.0], 1.0).unwrap()
}

/// Returns the same colours with an extinction of .2 everywhere.
fn even() -> TransferFunction {
    let opacity = 1.0 - (-0.2_f32).exp();
    TransferFunction::from_curves(colours, |_| opacity, [0.0, 1.0], 1.0).unwrap()
}

fn colours(value: f32) -> [f32; 3] {
    [value, 0.2 + 0.5 * value, 1.0 - value]
}

fn slabs(thickness: f64) -> Composite {
    Composite::SLABS.with_thickness(Some(thickness))
}

fn settings() -> Settings {
    Settings {
        composite: slabs(0.5),
        classify: Classification::Slab,
        cutoff: Some(4.5),
        tolerance: 1e-5,
        level_of_detail: false,
        advanced: Advanced {
            // The CPU uses no fused operations, as the device uses none.
            simd: SimdLevel::Baseline,
            ..Advanced::default()
        },
        ..Settings::default()
    }
}

fn eye(projection: Projection, pixels: usize) -> Camera {
    // The lattice fills the picture.
    let per_unit = pixels as f64 / 12.0;
    let focal = match projection {
        Projection::Perspective => per_unit * (MIDDLE - 8.0),
        Projection::Orthographic => per_unit,
    };
    camera(projection, [focal; 2], [pixels; 2])
}

fn draw(scene: &[PointVolume], camera: &Camera, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer.render(camera, settings).unwrap().clone()
}

/// Returns a light from the world's left, and a dim one from above the camera.
fn lighting() -> Lighting {
    let light = |direction, frame, colour| Light {
        direction,
        frame,
        colour,
    };
    Lighting {
        lights: vec![
            light(
                DVec3::new(-1.0, 0.4, -0.6),
                LightFrame::World,
                [1.0, 0.9, 0.8],
            ),
            light(
                DVec3::new(0.2, -1.0, -1.0),
                LightFrame::Camera,
                [0.2, 0.3, 0.4],
            ),
        ],
        ..Lighting::default()
    }
}

#[test]
fn a_step_across_the_rays_is_as_sharp_as_a_pixel() {
    // The field increases from left to right: .5 on the axis, where the extinction steps up.
    let scene = [field(|x| 0.5 + x.x / 16.0, step())];
    let camera = eye(Projection::Orthographic, 48);
    let after = draw(&scene, &camera, &settings());
    let before = Settings {
        composite: slabs(0.5),
        classify: Classification::Particle,
        ..settings()
    };
    let before = draw(&scene, &camera, &before);
    // Opacity of the right half, through the whole lattice.
    let opaque = TransferFunction::from_curves(colours, |_| 0.2, [0.0, 1.0], 1.0).unwrap();
    let whole = draw(&[field(|_| 1.0, opaque)], &camera, &settings());
    let row = |image: &Image| -> Vec<f32> {
        let row = (12..36).map(|x| image.pixels[24 * 48 + x][3]);
        row.collect()
    };
    let whole = row(&whole);
    // Returns the largest error of a row, at least `from` pixels away from the step.
    let off = |row: &[f32], from: usize| {
        let is_right = |i: usize| i >= 12;
        let errors = row
            .iter()
            .zip(&whole)
            .enumerate()
            .map(|(i, (alpha, whole))| {
                let to_step = if is_right(i) { i - 12 } else { 11 - i };
                let truth = if is_right(i) { *whole } else { 0.0 };
                if to_step < from {
                    0.0
                } else {
                    (alpha - truth).abs()
                }
            });
        errors.fold(0.0, f32::max)
    };
    let (after, before) = (row(&after), row(&before));
    println!(
        "{:.3} after, {:.3} before, two pixels off {:.3}",
        off(&after, 0),
        off(&before, 0),
        off(&before, 2)
    );
    // The sum of the kernels ripples by 1e-3, and less if rays cross many. Where a ray leaves the
    // lattice, the mean is over kernels on one side: less than a pixel off.
    assert!(whole[12] > 0.5, "{whole:?}");
    assert!(
        off(&after, 1) < 1e-3 && off(&after, 0) < 0.1,
        "{after:?}, not {whole:?}"
    );
    // Kernels of .6 node distances, two and a half pixels, blur the step if they are classified by
    // their values.
    assert!(off(&before, 2) > 0.1, "{before:?}");
}

#[test]
fn a_band_along_the_rays_converges_on_the_truth() {
    // The field increases with depth; a bell-shaped band of it absorbs.
    let bell = |value: f64| (-0.5 * ((value - 0.5) / 0.06).powi(2)).exp();
    let opacity = |value: f32| 1.0 - (-2.0 * bell(f64::from(value))).exp() as f32;
    let transfer = TransferFunction::from_curves(colours, opacity, [0.0, 1.0], 1.0).unwrap();
    let of = |x: DVec3| 0.5 + (x.z - MIDDLE) / 16.0;
    let scene = [field(of, transfer)];
    let camera = eye(Projection::Orthographic, 5);
    // From front to back, in f64: extinction 2 bell(v), over 16 units of depth per unit of v.
    let steps = 100_000;
    let (mut through, mut sum) = (1.0_f64, [0.0_f64; 3]);
    for i in 0..steps {
        let value = (i as f64 + 0.5) / steps as f64;
        let absorbed = 1.0 - (-2.0 * bell(value) * 16.0 / steps as f64).exp();
        for (sum, c) in sum.iter_mut().zip(colours(value as f32)) {
            *sum += through * absorbed * f64::from(c);
        }
        through *= 1.0 - absorbed;
    }
    let truth = [sum[0], sum[1], sum[2], 1.0 - through].map(|x| x as f32);
    let off = |thickness: f64, classify: Classification| {
        let settings = Settings {
            composite: slabs(thickness),
            classify,
            low_pass_variance_px2: 0.0,
            ..settings()
        };
        let image = draw(&scene, &camera, &settings);
        let pixel = image.pixels[12];
        let pairs = pixel.iter().zip(&truth);
        pairs.fold(0.0_f32, |most, (x, y)| most.max((x - y).abs()))
    };
    let errors = [1.0, 0.5, 0.25, 0.125].map(|thickness| off(thickness, Classification::Slab));
    println!(
        "{errors:?}; of particles {}",
        off(0.125, Classification::Extent)
    );
    // The error falls as the square of the thickness, down to the ripple of the kernels' sum.
    assert!(errors[1] < 0.4 * errors[0] && errors[2] < 0.4 * errors[1]);
    assert!(errors[3] < 2e-3, "{errors:?}");
}

#[test]
fn of_a_constant_field_it_makes_no_difference() {
    let scene = [field(|_| 0.7, step())];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let camera = eye(projection, 32);
        let before = Settings {
            composite: slabs(0.5),
            classify: Classification::Extent,
            ..settings()
        };
        let [a, b] = [settings(), before].map(|s| draw(&scene, &camera, &s));
        let off = difference(&a, &b);
        // Roundings of sums of some hundred kernels, and of the table.
        assert!(off < 1e-5, "{projection:?}: {off}");
        // A constant field gives light no direction.
        let lit = Settings {
            lighting: Some(lighting()),
            ..settings()
        };
        let inner = Camera {
            focal_px: camera.focal_px * 2.0,
            ..camera
        };
        let off = difference(
            &draw(&scene, &inner, &lit),
            &draw(&scene, &inner, &settings()),
        );
        assert!(off < 1e-5, "{projection:?}, lit: {off}");
    }
}

#[test]
fn light_falls_as_the_field_slopes() {
    for slope in [
        DVec3::new(0.5, -0.7, -0.5).normalize(),
        DVec3::Z,
        DVec3::new(-1.0, 0.2, 0.1).normalize(),
    ] {
        let of = move |x: DVec3| 0.5 + (x - DVec3::Z * MIDDLE).dot(slope) / 28.0;
        // With one colour and opacity, only the light is visible.
        let colour = [0.5, 0.4, 0.3];
        let transfer = TransferFunction::from_curves(|_| colour, |_| 0.6, [0.0, 1.0], 1.0).unwrap();
        for (kind, scene, tolerance) in [
            // Ripple of the kernels' sum.
            ("lattice", field(of, transfer.clone()), 1e-3),
            // Nodes are offset by .2 of their distance.
            ("spheres", spheres(of, transfer.clone()), 0.05),
        ] {
            for projection in [Projection::Perspective, Projection::Orthographic] {
                let camera = eye(projection, 24);
                // Half of the width, far from the lattice's sides; and not its front face, where
                // the mean value ends sharply.
                let settings = Settings {
                    lighting: Some(lighting()),
                    clip: vec![ClipPlane {
                        normal: DVec3::Z,
                        distance: 4.0 - MIDDLE,
                    }],
                    ..settings()
                };
                let image = draw(std::slice::from_ref(&scene), &camera, &settings);
                let uniform = LightingUniform::new(&lighting(), &camera);
                let mut worst = 0.0_f32;
                for i in (0..24 * 24)
                    .filter(|i| (6..18).contains(&(i % 24)) && (6..18).contains(&(i / 24)))
                {
                    let pixel =
                        DVec3::new((i % 24) as f64 + 0.5, (i / 24) as f64 + 0.5, 0.0).truncate();
                    let d = (pixel - camera.centre_px) / camera.focal_px;
                    let to_eye = match projection {
                        Projection::Perspective => -d.extend(1.0).normalize(),
                        Projection::Orthographic => -DVec3::Z,
                    };
                    let expected = lit(
                        &uniform,
                        Sides::Both,
                        colour,
                        slope.as_vec3(),
                        to_eye.as_vec3(),
                    );
                    let [r, g, b, alpha] = image.pixels[i];
                    assert!(alpha > 0.99);
                    let off = (Vec3::new(r, g, b) / alpha - Vec3::from(expected)).abs();
                    worst = worst.max(off.max_element());
                }
                println!("{kind} {projection:?} {slope:.2}: {worst:.1e}");
                assert!(worst < tolerance, "{kind} {projection:?} {slope}: {worst}");
            }
        }
    }
}

/// Returns a narrow lobe, and `floor` of opacity everywhere else.
fn lobe(floor: f32) -> TransferFunction {
    let opacity = move |value: f32| (0.6 * (1.0 - (value - 0.5).abs() / 0.03)).max(floor);
    TransferFunction::from_curves(colours, opacity, [0.0, 1.0], 1.0).unwrap()
}

fn gentle(x: DVec3) -> f64 {
    0.5 + 0.05 * x.x + 0.04 * (0.7 * x.y).sin() + 0.02 * (x.z - MIDDLE)
}

/// Returns spheres with local models: from all others within a distance.
fn spheres_with_models(transfer: TransferFunction) -> PointVolume {
    let scene = spheres(gentle, transfer);
    let (Some(Values::F32(values)), Particles::Isotropic { positions, .. }) =
        (&scene.values, &scene.particles)
    else {
        unreachable!()
    };
    let model = |i: usize| {
        let near = |j: &usize| positions[*j].distance(positions[i]) < 2.5;
        let around = (0..values.len()).filter(near).map(|j| values[j]);
        let [lo, hi] = around.fold([values[i]; 2], |[lo, hi], v| [lo.min(v), hi.max(v)]);
        LocalModel {
            slope: Vec3::new(0.05, 0.0, 0.02) * 0.6,
            departure: 0.0,
            below: values[i] - lo,
            above: hi - values[i],
        }
    };
    let models: Vec<_> = (0..values.len()).map(model).collect();
    PointVolume {
        local_models: Some(LocalModels::new(&models)),
        ..scene
    }
}

#[test]
fn what_nothing_around_shows_is_left_out_and_not_missed() {
    let camera = eye(Projection::Perspective, 32);
    for (name, of) in [
        (
            "lattice",
            (|f| field(gentle, lobe(f))) as fn(f32) -> PointVolume,
        ),
        ("spheres", |f| spheres_with_models(lobe(f))),
    ] {
        let drawn = |floor: f32, settings: &Settings| {
            let mut renderer = Renderer::new(vec![of(floor)]).unwrap();
            let image = renderer.render(&camera, settings).unwrap().clone();
            (image, renderer.counts().classified)
        };
        let (some, seen) = drawn(0.0, &settings());
        // The floor is so faint that it is invisible, and nothing is omitted.
        let (all, count) = drawn(1e-6, &settings());
        assert!(
            count == NODES.pow(3) && seen < count * 2 / 3,
            "{name}: {seen}"
        );
        let off = difference(&some, &all);
        println!("{name}: {seen} of {count}, {off:.1e}");
        assert!(some.pixels.iter().any(|p| p[3] > 0.3));
        // 1e-6 x 17 of the floor, and the contribution of kernels four nodes away to a mean value.
        // Spheres store the surrounding values in steps, and their field is less even.
        assert!(
            off < if name == "lattice" { 2e-4 } else { 2e-3 },
            "{name}: {off}"
        );
        // In thick slabs, the mean value covers more than the surroundings; and the greatest value
        // may be transparent.
        let thick = Settings {
            composite: slabs(1.5),
            ..settings()
        };
        assert_eq!(drawn(0.0, &thick).1, count, "{name}");
        let greatest = Settings {
            composite: Composite::Maximum {
                thickness: Some(0.5),
            },
            ..settings()
        };
        assert_eq!(drawn(0.0, &greatest).1, count, "{name}");
    }
}

/// Scenes of one field are drawn alike by GPU and CPU.
#[test]
#[cfg(feature = "gpu")]
fn twins_classify_alike() {
    let Some(gpu) = crate::common::gpu::pictures() else {
        return;
    };
    let of = |x: DVec3| 0.5 + 0.3 * (0.6 * x.x).sin() * (0.5 * x.y).cos() + 0.03 * (x.z - MIDDLE);
    let across = |i: usize, n: usize| (i % n) as f64 * 2.0 - 9.0;
    let wall = PointVolume::new(
        Particles::Surfels {
            positions: (0..49)
                .map(|i| {
                    let (x, y) = (across(i, 7), across(i / 7, 7));
                    DVec3::new(x, y, MIDDLE + 1.3 + 0.2 * x)
                })
                .collect(),
            tangents: vec![[1.2, 0.0, 0.24, 0.0, 1.2, 0.0]; 49],
            is_one_sided: false,
        },
        Strength::Surface(vec![4.0; 49]),
    )
    .with_colour([0.2, 0.8, 0.3]);
    let lit = Settings {
        lighting: Some(lighting()),
        ..settings()
    };
    let cut = Settings {
        clip: vec![ClipPlane {
            normal: DVec3::new(0.6, 0.0, 0.8),
            distance: -0.8 * (MIDDLE - 3.0),
        }],
        depth: true,
        ..lit.clone()
    };
    let within = Camera {
        eye: DVec3::new(0.3, 0.2, MIDDLE - 6.0),
        ..eye(Projection::Perspective, 20)
    };
    let scenes = [
        (
            "plain",
            vec![field(of, step())],
            eye(Projection::Perspective, 24),
            settings(),
        ),
        (
            "lit",
            vec![spheres(of, step())],
            eye(Projection::Orthographic, 24),
            lit.clone(),
        ),
        (
            "cut",
            vec![field(of, even())],
            eye(Projection::Perspective, 24),
            cut,
        ),
        (
            "wall",
            vec![field(of, step()), wall],
            eye(Projection::Perspective, 24),
            lit.clone(),
        ),
        ("within", vec![field(of, even())], within, lit.clone()),
        (
            "lobe",
            vec![field(gentle, lobe(0.0))],
            eye(Projection::Perspective, 24),
            settings(),
        ),
        (
            "lobe of spheres",
            vec![spheres_with_models(lobe(0.0))],
            eye(Projection::Orthographic, 24),
            lit,
        ),
    ];
    for (name, scene, camera, settings) in scenes {
        let mut on_cpu = Renderer::new(scene.clone()).unwrap();
        on_cpu.render(&camera, &settings).unwrap();
        let mut on_gpu = Renderer::new(scene).unwrap().on(gpu.clone()).unwrap();
        on_gpu.render(&camera, &settings).unwrap();
        let pairs = on_cpu.image().pixels.iter().zip(&on_gpu.image().pixels);
        // Slopes are small differences of large sums, and highlights the thirtieth power of a
        // cosine.
        let differs =
            |(p, q): &(&[f32; 4], &[f32; 4])| !p.iter().zip(*q).all(|(x, y)| (x - y).abs() <= 2e-4);
        let count = pairs.filter(differs).count();
        let most = difference(on_cpu.image(), on_gpu.image());
        assert_eq!(
            on_cpu.counts().classified,
            on_gpu.counts().classified,
            "{name}"
        );
        println!("{name}: {count} pixels differ, the most by {most:.1e}");
        assert!(count <= 2 && most < 0.05, "{name}: {count}, {most}");
        assert!(on_cpu.image().pixels.iter().any(|p| p[3] > 0.5));
        if let (Some(a), Some(b)) = (on_cpu.depth(), on_gpu.depth()) {
            let pairs = a.depths.iter().zip(&b.depths);
            let off = pairs.filter(|(x, y)| !((*x - *y).abs() <= 1e-4 * x.abs() || x == y));
            assert!(off.count() <= 2);
        }
    }
}

#[test]
fn colours_come_back() {
    let scene = [field(|x| 0.5 + x.x / 16.0, step())];
    let camera = eye(Projection::Perspective, 24);
    let before = Settings {
        composite: slabs(0.5),
        classify: Classification::Extent,
        ..settings()
    };
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    for (settings, transfer) in [
        (settings(), step()),
        (before.clone(), step()),
        (settings(), even()),
        (before, even()),
    ] {
        renderer.set_transfer_function(0, transfer.clone()).unwrap();
        let image = renderer.render(&camera, &settings).unwrap();
        let fresh = [field(|x| 0.5 + x.x / 16.0, transfer)];
        let expected = draw(&fresh, &camera, &settings);
        assert!(difference(image, &expected) == 0.0);
        // The function itself determines what is visible.
        let fresh = Renderer::new(fresh.to_vec()).unwrap();
        assert_eq!(renderer.visible_boxes(), fresh.visible_boxes());
    }
}

#[test]
fn the_low_pass_filter_suits_a_field_however_much_is_known_of_it() {
    let suits = |volume: PointVolume| Renderer::new(vec![volume]).unwrap().suitable_low_pass_px2();
    let of_field = suits(field(gentle, even()));
    assert_eq!(of_field, suits(spheres(gentle, even())));
    assert_eq!(of_field, suits(spheres_with_models(even())));
    let bare = volume(&[Particle::sphere(DVec3::Z * MIDDLE, 1.0, 4.0)]);
    assert!(of_field < suits(bare));
}

#[test]
fn what_has_no_one_field_is_refused() {
    let camera = eye(Projection::Perspective, 8);
    let one = || field(|x| 0.5 + x.x / 16.0, step());
    let masses = volume(&[Particle::sphere(DVec3::Z * MIDDLE, 1.0, 4.0)]);
    for (scene, settings, about) in [
        (vec![one(), one()], settings(), "one volume with a field"),
        (vec![masses], settings(), "one volume with a field"),
    ] {
        let mut renderer = Renderer::new(scene).unwrap();
        let error = renderer.render(&camera, &settings).unwrap_err().to_string();
        assert!(error.contains(about), "{error}");
    }
}
