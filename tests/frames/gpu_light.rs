//! Compares light with its CPU twin.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::gpu::{assert_alike, gpu, pictures};
use crate::common::{Random, real_data};
use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::math::normal_code;
use ewa_splat::sample::{PurposeOptions, SampleOptions, volume as sample};
use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Light, LightFrame, Lighting, Particles, PointVolume, Strength,
};
use ewa_splat::stages::blocks::{BlockedVolume, cull};
use ewa_splat::stages::record::{BlockView, ClassifiedParticle, LightingUniform};
use ewa_splat::stages::{cpu, gpu as device};
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Renderer, Settings};
use glam::{DMat3, DVec3};

const POISON: [f32; 8] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    1e-40,
    f32::MAX,
    1e30,
    1e-30,
];

/// Returns particles of each kind around `middle`, coloured, all visible.
fn volumes(random: &mut Random, middle: DVec3, size: f64) -> Vec<(&'static str, PointVolume)> {
    let count = 3_000;
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(size) + middle).collect();
    let tangents: Vec<[f32; 6]> = (0..count)
        .map(|i| match i % 50 {
            // No plane: a line, and nothing.
            0 => [1.0, 2.0, 3.0, 2.0, 4.0, 6.0],
            1 => [0.0; 6],
            2 => [0, 1, 2, 3, 4, 5].map(|_| POISON[random.index(POISON.len())]),
            _ => [0, 1, 2, 3, 4, 5].map(|_| random.range(-0.1, 0.1) as f32 * size as f32),
        })
        .collect();
    let sigmas = vec![0.1 * size as f32; count];
    let factors = tangents
        .iter()
        .map(|_| [0.1, 0.0, 0.1, 0.0, 0.0, 0.1].map(|l| l * size as f32))
        .collect();
    let dims = [19, 13, 9];
    let axis = |n: usize, random: &mut Random| {
        let mut x = 0.0;
        let next = |_| {
            x += random.range(0.5, 1.5) * 0.1 * size;
            x
        };
        (0..n).map(next).collect::<Vec<f64>>()
    };
    let coordinates = dims.map(|n| axis(n, random));
    let coordinates = [0, 1, 2].map(|a| coordinates[a].iter().map(|x| x + middle[a]).collect());
    let step = random.rotation() * DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.1) * size);
    let lattice = |spacing| Particles::Lattice {
        lattice: Lattice { dims, spacing },
        kernel_width: 0.6,
    };
    let origin = middle;
    let surfels = Particles::Surfels {
        positions: positions.clone(),
        tangents,
        is_one_sided: false,
    };
    let kinds = [
        ("uniform", lattice(LatticeSpacing::Uniform { origin, step })),
        (
            "rectilinear",
            lattice(LatticeSpacing::Rectilinear { coordinates }),
        ),
        (
            "spheres",
            Particles::Isotropic {
                positions: positions.clone(),
                sigmas,
            },
        ),
        (
            "ellipsoids",
            Particles::Anisotropic {
                positions: positions.clone(),
                factors,
            },
        ),
        ("surfels", surfels.clone()),
        ("round surfels", surfels),
    ];
    kinds
        .into_iter()
        .map(|(name, particles)| {
            let count = particles.len();
            let is_flat = name == "surfels";
            let normals = (0..count).map(|i| match i % 7 {
                0 => 0,
                // The extreme values of codes.
                1 => [1, 1 << 22, 2048, (1 << 22) - 2047][i % 4],
                _ => normal_code(random.point(1.0)),
            });
            let normals = (!is_flat).then(|| normals.collect());
            let colours = (0..count).map(|i| match i % 31 {
                0 => [0, 1, 2].map(|_| POISON[random.index(POISON.len())]),
                _ => [0, 1, 2].map(|_| random.range(0.0, 1.5) as f32),
            });
            let volume = PointVolume {
                colour: Colour::PerParticle(colours.collect()),
                normals,
                ..PointVolume::new(particles, Strength::Mass(vec![1.0; count]))
            };
            (name, volume)
        })
        .collect()
}

fn lighting(random: &mut Random, count: usize, shininess: f32) -> Lighting {
    let mut light = |i: usize| Light {
        direction: random.point(1.0),
        frame: [LightFrame::World, LightFrame::Camera][i % 2],
        colour: [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32),
    };
    Lighting {
        lights: (0..count).map(&mut light).collect(),
        ambient: 0.2,
        diffuse: 0.6,
        specular: 0.5,
        shininess,
        shadows: None,
    }
}

/// Returns blocks in view, with their origins, and the CPU's classified particles.
fn classified(
    volume: &BlockedVolume,
    camera: &Camera,
) -> (Vec<BlockView>, Vec<ClassifiedParticle>) {
    let mut views = Vec::new();
    cull(
        volume,
        camera,
        None,
        &bytemuck::Zeroable::zeroed(),
        &mut views,
    );
    let total = cpu::count_classified(volume, &mut views);
    let mut particles = vec![bytemuck::Zeroable::zeroed(); total];
    cpu::classify(volume, &views, &mut particles);
    (views, particles)
}

#[test]
fn particles_are_lit_alike() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(12);
    let mut worst = [0.0_f32; 2];
    for case in 0..8 {
        let middle = DVec3::new(1.0, -2.0, 0.5) * [0.0, 1e7][case % 2];
        let size = [1.0, 1.0, 1e-6, 1e9][case % 4];
        let shininess = [1.0, 32.0, 200.0, 1000.0][case / 2];
        let lighting = lighting(&mut random, [2, 0, 1, 8][case % 4], shininess);
        for (name, volume) in volumes(&mut random, middle, size) {
            let volume = BlockedVolume::new(volume);
            let eye = middle + random.point(2.0 * size);
            let aim = middle + random.point(0.3 * size);
            let camera = if case % 3 == 2 {
                Camera::orthographic(eye, aim, DVec3::Z, 1.0, [64; 2])
            } else {
                Camera::perspective(eye, aim, DVec3::Z, 60.0, [64; 2])
            };
            let (views, particles) = classified(&volume, &camera);
            assert!(particles.len() > 2_000, "{name}: {}", particles.len());
            let uniform = LightingUniform::new(&lighting, &camera);
            let rotation = camera.camera_from_world.as_mat3();
            let (mut on_cpu, mut on_device) = (particles.clone(), particles.clone());
            cpu::light(&volume, &views, &[], rotation, &uniform, None, &mut on_cpu);
            let part_bytes = [u64::MAX, 100_000][case % 2];
            device::light(
                gpu,
                &volume,
                &views,
                rotation,
                &uniform,
                &mut on_device,
                part_bytes,
            )
            .unwrap();
            let (mut changed, mut flips) = (0, 0);
            for ((ours, twin), before) in on_device.iter().zip(&on_cpu).zip(&particles) {
                changed += usize::from(ours.carried != before.carried);
                for c in 0..3 {
                    let (a, b, own) = (
                        ours.carried.colour()[c],
                        twin.carried.colour()[c],
                        before.carried.colour()[c],
                    );
                    let is_same = a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
                    // Numbers that are not finite stay so; denormals may be zeros.
                    if is_same || (a - b).abs() < 1e-37 {
                        continue;
                    }
                    assert!(a.is_finite() && b.is_finite(), "{name}: {a} {b} of {own}");
                    // As in `gpu::light`: unit vectors within 2e-6. The exponent multiplies that,
                    // and the logarithm's 2^-21, for each light.
                    let lights: f32 = lighting.lights.iter().map(|l| l.colour[c]).sum();
                    let diffuse = 2e-6 * own.abs() * (1.0 + lights);
                    let highlight = 0.5 * lights * shininess * (2e-6 + 5e-7) + 1e-6;
                    let error = (a - b).abs();
                    if error > diffuse + highlight && !gpu.is_software() {
                        // A side of a plane that is seen or lit edge on.
                        flips += 1;
                        break;
                    }
                    assert!(
                        error <= diffuse + highlight,
                        "{case}, {name}: {a} {b} of {own}"
                    );
                    worst[0] = worst[0].max(error / (diffuse + highlight));
                    worst[1] = worst[1].max(error);
                }
            }
            let share = changed as f64 / particles.len() as f64;
            assert!(share > 0.8, "{name}: {share}");
            assert!(flips <= particles.len() / 500, "{name}: {flips}");
        }
    }
    println!("{} of the bound at most, {} of colours", worst[0], worst[1]);
}

#[test]
fn pictures_are_lit_alike() {
    let mut random = Random::new(3);
    for orthographic in [false, true] {
        for (name, mut volume) in volumes(&mut random, DVec3::ZERO, 1.0) {
            // Faint, opaque or invisible particles; the stage's own test covers poison.
            if let Colour::PerParticle(colours) = &mut volume.colour {
                for c in colours.iter_mut().flatten() {
                    *c = c.clamp(0.0, 1.0).max(0.0);
                }
            }
            if let Particles::Surfels { tangents, .. } = &mut volume.particles {
                tangents
                    .iter_mut()
                    .for_each(|t| *t = t.map(|x| x.clamp(-0.1, 0.1)));
            }
            volume.strength = Strength::Mass(vec![0.002; volume.particles.len()]);
            let eye = DVec3::new(0.5, -6.0, 1.0);
            let camera = if orthographic {
                Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 3.0, [72, 56])
            } else {
                Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, [72, 56])
            };
            let settings = Settings {
                lighting: Some(lighting(&mut random, 3, 32.0)),
                ..Settings::default()
            };
            assert_alike(name, &volume, &camera, &settings);
        }
    }
}

#[test]
fn light_may_be_switched_between_frames() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(7);
    let (_, volume) = volumes(&mut random, DVec3::ZERO, 1.0).swap_remove(2);
    let camera = Camera::perspective(DVec3::Y * -6.0, DVec3::ZERO, DVec3::Z, 30.0, [40; 2]);
    let plain = Settings::default();
    let lit = Settings {
        lighting: Some(lighting(&mut random, 2, 32.0)),
        ..Settings::default()
    };
    let mut renderer = Renderer::new(vec![volume])
        .unwrap()
        .on(gpu.clone())
        .unwrap();
    let mut draw = |settings| renderer.render(&camera, settings).unwrap().clone();
    let (first, second) = (draw(&plain), draw(&lit));
    let bits = |image: &ewa_splat::Image| -> Vec<u32> {
        image.pixels.iter().flatten().map(|x| x.to_bits()).collect()
    };
    assert_ne!(bits(&first), bits(&second));
    assert_eq!(bits(&first), bits(&draw(&plain)));
    assert_eq!(bits(&second), bits(&draw(&lit)));
}

#[test]
fn real_volumes_are_lit_alike() {
    if pictures().is_none() {
        return;
    }
    let raw = OpenOptions {
        raw: Some(RawLayout::new([41; 3], RawType::U8)),
        ..OpenOptions::default()
    };
    for (name, options) in [
        ("volumes/nucleon_41x41x41_uint8.raw", raw),
        (
            "curvilinear/bluntfin/bluntfinxyz.bin",
            OpenOptions::default(),
        ),
    ] {
        let Some(path) = real_data(name) else {
            continue;
        };
        let options_of = SampleOptions {
            purpose: PurposeOptions {
                normals: true,
                ..PurposeOptions::default()
            },
            ..SampleOptions::default()
        };
        let volume = sample(open(&path, &options).unwrap(), &options_of)
            .unwrap()
            .volume;
        let viewpoint = Viewpoint {
            azimuth_deg: 30.0,
            elevation_deg: 20.0,
            zoom: 1.0,
            up: DVec3::Z,
        };
        let boxes = Renderer::new(vec![volume.clone()]).unwrap().visible_boxes();
        let camera = viewpoint
            .camera(&boxes, Lens::FovDeg(30.0), [96; 2])
            .unwrap();
        let settings = Settings {
            lighting: Some(Lighting::default()),
            ..Settings::default()
        };
        assert_alike(name, &volume, &camera, &settings);
    }
}
