//! Double precision in integers, and the cull, against their twins on the CPU.
#![cfg(feature = "gpu")]
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

mod common;

use common::Random;
use common::gpu::gpu;
use ewa_splat::blocks::{
    Block, BlockedParticles, BlockedVolume, DepthRange, Frustum, cull, distance_interval,
};
use ewa_splat::gpu::{self, f64_operations};
use ewa_splat::layout::BlockView;
use ewa_splat::scene::{
    Colour, ColourSpace, ControlPoint, Lattice, LatticeSpacing, Particles, PointVolume, Strength,
    TransferFunction, Values,
};
use ewa_splat::view::{Camera, Projection};
use glam::{DMat3, DVec2, DVec3, Vec3};

/// Denormals are zeros on the device.
fn flushed(x: f64) -> f64 {
    if x.abs() < f64::MIN_POSITIVE {
        0.0_f64.copysign(x)
    } else {
        x
    }
}

/// The same bits, all NaNs alike. At the least normal number the device rounds before it drops
/// what is denormal, the processor after.
fn same(device: u64, expected: f64) -> bool {
    let device = f64::from_bits(device);
    let is_at_the_edge = |x: f64| x.abs() <= f64::MIN_POSITIVE;
    device.to_bits() == flushed(expected).to_bits()
        || (device.is_nan() && expected.is_nan())
        || (is_at_the_edge(device) && expected.abs() == f64::MIN_POSITIVE)
}

#[test]
fn double_precision_in_integers_is_that_of_the_processor() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(1);
    let poison = [
        0.0,
        1.0,
        f64::MIN_POSITIVE,
        5e-324,
        2.2e-308,
        f64::MAX,
        f64::INFINITY,
        f64::NAN,
        0.5,
        1.0 - f64::EPSILON / 2.0,
        4_294_967_295.0,
        4_294_967_296.0,
        2_147_483_648.5,
        f64::from(f32::MAX),
        // Half a step beyond: the least that f32 rounds to infinity.
        f64::from(f32::MAX) * (1.0 + 0.5_f64.powi(25)),
        f64::from(f32::MIN_POSITIVE),
        f64::from(f32::from_bits(1)),
        f64::from(f32::from_bits(1)) * 0.5,
        f64::from(f32::from_bits(1)) * 0.75,
    ];
    let signed: Vec<f64> = poison.iter().flat_map(|&x| [x, -x]).collect();
    let mut pairs: Vec<[f64; 2]> = signed
        .iter()
        .flat_map(|&a| signed.iter().map(move |&b| [a, b]))
        .collect();
    for i in 0..200_000 {
        let bits = [random.bits(), random.bits()];
        let mut pair = bits.map(f64::from_bits);
        match i % 5 {
            // Any bits at all.
            0 => {}
            // Exponents so near that digits cancel.
            1 => {
                pair = bits.map(|b| f64::from_bits((b % (3 << 52)) | (0x3ff << 52) | (b & 1 << 63)))
            }
            // Few digits: ties.
            2 => pair = bits.map(|b| f64::from_bits((b & 0x83ff_ffff_8000_0000) | (0x3e0 << 52))),
            // Neighbours of numbers and ties of f32.
            3 => {
                let near = f64::from_bits((bits[0] & !0x1fff_ffff) | 0x1000_0000).to_bits();
                pair[0] = f64::from_bits(near.wrapping_add(bits[1] % 3).wrapping_sub(1));
                pair[0] = f64::from_bits(pair[0].to_bits() & !(0x7ff << 52))
                    + f64::from_bits((0x3ff - 160 + bits[1] % 300) << 52);
            }
            // Around u32.
            _ => pair = [random.range(-10.0, 5e9), random.log_range(1e-300, 1e300)],
        }
        pairs.push(pair);
    }
    let results = f64_operations(gpu, &pairs).unwrap();
    for (&[x, y], r) in pairs.iter().zip(&results) {
        let (a, b) = (flushed(x), flushed(y));
        let context = || {
            format!(
                "{x:e} ({:x}), {y:e} ({:x}): {r:x?}",
                x.to_bits(),
                y.to_bits()
            )
        };
        assert!(same(r.sum, a + b), "sum of {}", context());
        assert!(same(r.difference, a - b), "difference of {}", context());
        assert!(same(r.product, a * b), "product of {}", context());
        assert!(same(r.quotient, a / b), "quotient of {}", context());
        assert!(same(r.root, a.sqrt()), "root of {}", context());
        for (device, expected) in [(r.greater, a.max(b)), (r.lesser, a.min(b))] {
            let device = flushed(f64::from_bits(device));
            // Zeros of either sign are one to `max`.
            assert!(
                device == expected || (device.is_nan() && expected.is_nan()),
                "order of {}",
                context()
            );
        }
        let high = f32::from_bits((x.to_bits() >> 32) as u32);
        assert!(same(r.widened, high.into()), "widened {}", context());
        let narrow = f32::from_bits(r.narrowed);
        assert!(
            narrow.to_bits() == (a as f32).to_bits() || (narrow.is_nan() && a.is_nan()),
            "narrowed {}",
            context()
        );
        assert_eq!(r.truncated, a as u32, "truncated {}", context());
        assert_eq!(r.is_at_least_zero == 1, a >= 0.0, "sign of {}", context());
    }
    println!("{} pairs equal to the bit", pairs.len());
}

/// The views of some volumes with their keys and the keys per unit, as `Renderer::render` has
/// them.
fn expected(
    volumes: &[BlockedVolume],
    camera: &Camera,
    frustum: &Frustum,
    rejects: bool,
) -> (Vec<Vec<BlockView>>, f32) {
    let mut views = vec![Vec::new(); volumes.len()];
    for (volume, views) in volumes.iter().zip(&mut views) {
        cull(volume, camera, rejects.then_some(frustum), views);
    }
    let in_view = volumes
        .iter()
        .zip(&views)
        .flat_map(|(volume, views)| views.iter().map(|v| &volume.blocks[v.block as usize]))
        .filter(|block| frustum.sees(camera, block));
    let range = DepthRange::of(in_view.map(|block| distance_interval(camera, block)));
    for (volume, views) in volumes.iter().zip(&mut views) {
        for view in views {
            let block = &volume.blocks[view.block as usize];
            view.key = range.key(distance_interval(camera, block).0);
        }
    }
    (views, range.keys_per_unit())
}

/// Compares every view of frames, each with or without a frustum, to the bit; returns how many
/// there are in each.
fn check(volumes: &[BlockedVolume], frames: &[(Camera, bool)], part_bytes: u64) -> Vec<usize> {
    let gpu = gpu().unwrap();
    let frustum = |camera| Frustum::new(camera, 7.0);
    let uniforms: Vec<_> = frames
        .iter()
        .map(|(camera, rejects)| gpu::camera_uniform(camera, &frustum(camera), *rejects))
        .collect();
    let outputs = gpu::cull(gpu, volumes, &uniforms, part_bytes).unwrap();
    // Zeros of either sign and NaNs are alike.
    let bits = |v: &BlockView| {
        let point = v.origin_camera.map(|x| {
            let x = if x.is_nan() { f32::NAN } else { x + 0.0 };
            x.to_bits()
        });
        (v.block, point, v.first, v.count, v.key)
    };
    let mut totals = Vec::new();
    for ((camera, rejects), out) in frames.iter().zip(outputs) {
        let (views, key_scale) = expected(volumes, camera, &frustum(camera), *rejects);
        for (device, expected) in out.views.iter().zip(&views) {
            let device: Vec<_> = device.iter().map(bits).collect();
            let expected: Vec<_> = expected.iter().map(bits).collect();
            assert_eq!(device.len(), expected.len(), "views");
            for (a, b) in device.iter().zip(&expected) {
                assert_eq!(a, b);
            }
        }
        for (count, groups) in out.parts {
            assert_eq!(groups, [count.min(65_535), count.div_ceil(65_535), 1]);
        }
        assert_eq!(out.key_scale.to_bits(), key_scale.to_bits(), "key scale");
        totals.push(views.iter().map(Vec::len).sum());
    }
    totals
}

fn points(positions: Vec<DVec3>, sigma: impl Fn(usize) -> f32) -> BlockedVolume {
    let count = positions.len();
    BlockedVolume::new(PointVolume {
        particles: Particles::Isotropic {
            positions,
            sigmas: (0..count).map(sigma).collect(),
        },
        strength: Strength::Mass(vec![1.0; count]),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
    })
}

/// From beside, from within, from afar, away from it, and orthographic ones, of a scene of size 1
/// at the origin that is then scaled and moved.
fn cameras(random: &mut Random, scale: f64, middle: DVec3) -> Vec<Camera> {
    let mut cameras = Vec::new();
    for (distance, fov) in [
        (3.0, 30.0),
        (0.3, 90.0),
        (1.1, 20.0),
        (100.0, 1.0),
        (2.0, 3.0),
    ] {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let direction = random.rotation().x_axis;
            let (eye, aim) = (direction * distance, random.point(0.2));
            let size = [640, 480];
            let to_world = |p: DVec3| p * scale + middle;
            cameras.push(match projection {
                Projection::Perspective => {
                    Camera::perspective(to_world(eye), to_world(aim), DVec3::Z, fov, size)
                }
                Projection::Orthographic => {
                    Camera::orthographic(to_world(eye), to_world(aim), DVec3::Z, scale, size)
                }
            });
        }
    }
    // Looks away.
    let eye = DVec3::X * 30.0 * scale + middle;
    cameras.push(Camera::perspective(
        eye,
        eye + DVec3::X * scale,
        DVec3::Z,
        40.0,
        [64, 64],
    ));
    cameras
}

#[test]
fn blocks_of_points_are_seen_alike_at_every_scale_and_place() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(2);
    let mut totals = Vec::new();
    for (scale, offset) in [
        (1.0, 0.0),
        (1.0, 1e7),
        (1.0, 1e9),
        (1e-12, 0.0),
        (1e12, 1e12),
        (1e25, 0.0),
    ] {
        let middle = DVec3::new(offset, -offset, offset * 0.3);
        let positions = (0..70_000).map(|_| random.point(1.0) * scale + middle);
        let sigma = 1e-2 * scale;
        let volume = points(positions.collect(), |i| (sigma * (i % 7) as f64) as f32);
        let volumes = [volume];
        let cameras = cameras(&mut random, scale, middle);
        let frames: Vec<_> = cameras.into_iter().map(|c| (c, true)).collect();
        totals.extend(check(&volumes, &frames, u64::MAX));
    }
    println!("views: {totals:?}");
    assert!(totals.contains(&0) && totals.iter().any(|&n| n > 256));
}

/// Three lattices: sheared bytes of which a few are visible, rectilinear f32 with poison, and a
/// single row.
fn lattices(random: &mut Random) -> Vec<BlockedVolume> {
    let opacity = |value, opacity| ControlPoint {
        value,
        colour: None,
        opacity: Some(opacity),
    };
    let transfer = |range: [f32; 2]| {
        let at = |s: f32| range[0] + (range[1] - range[0]) * s;
        let points = [
            opacity(at(0.0), 0.0),
            opacity(at(0.6), 0.0),
            opacity(at(0.61), 0.3),
            opacity(at(0.62), 0.0),
            opacity(at(0.9), 0.0),
            opacity(at(0.9), 0.5),
        ];
        TransferFunction::from_points(&points, ColourSpace::Linear, range, 1.0).unwrap()
    };
    let volume = |lattice: Lattice, values, transfer| {
        BlockedVolume::new(PointVolume {
            particles: Particles::Lattice {
                lattice,
                kernel_width: 0.7,
            },
            strength: Strength::Classified {
                volumes: Vec::new(),
            },
            colour: Colour::Classified,
            values: Some(values),
            transfer_function: Some(transfer),
        })
    };
    let dims = [61, 50, 33];
    let step = DMat3::from_cols(
        DVec3::new(0.02, 0.001, 0.0),
        DVec3::new(0.005, 0.03, 0.0),
        DVec3::new(0.0, -0.01, 0.05),
    );
    let sheared = Lattice {
        dims,
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::new(-0.7, -0.7, -0.8),
            step,
        },
    };
    // Constant per brick, so that whole bricks are transparent.
    let level = |i: usize, j: usize, k: usize| ((i / 8 * 37 + j / 8 * 91 + k / 4 * 13) % 256) as u8;
    let bytes = |[nx, ny, nz]: [usize; 3]| {
        (0..nx * ny * nz)
            .map(|n| level(n % nx, n / nx % ny, n / (nx * ny)))
            .collect::<Vec<u8>>()
    };
    let axis = |n: usize, random: &mut Random| {
        let mut at = -1.0;
        (0..n)
            .map(|_| {
                at += random.range(0.001, 0.1);
                at
            })
            .collect::<Vec<f64>>()
    };
    let floats_dims = [40, 17, 30];
    let rectilinear = Lattice {
        dims: floats_dims,
        spacing: LatticeSpacing::Rectilinear {
            coordinates: floats_dims.map(|n| axis(n, random)),
        },
    };
    let floats: Vec<f32> = bytes(floats_dims)
        .iter()
        .enumerate()
        .map(|(n, &v)| match n {
            0..6000 => f32::NAN,
            n if n % 977 == 0 => f32::INFINITY,
            n if n % 499 == 0 => 1e-40,
            _ => f32::from(v),
        })
        .collect();
    let row = [300, 1, 1];
    let row_lattice = Lattice::uniform(row, DVec3::new(-1.5, 0.1, 0.1), DVec3::splat(0.01));
    vec![
        volume(sheared, Values::U8(bytes(dims)), transfer([0.0, 255.0])),
        volume(rectilinear, Values::F32(floats), transfer([0.0, 300.0])),
        volume(row_lattice, Values::U8(bytes(row)), transfer([10.0, 90.0])),
    ]
}

#[test]
fn transparent_bricks_and_parts_of_several_volumes_are_told_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(3);
    let mut volumes = lattices(&mut random);
    let positions = (0..3_000).map(|_| random.point(0.5)).collect();
    volumes.push(points(positions, |_| 0.01));
    volumes.push(points(Vec::new(), |_| 0.01));
    let blocks: usize = volumes.iter().map(|v| v.blocks.len()).sum();
    // Uniform scaling culls only what is transparent; keys span what is in view.
    let cameras = cameras(&mut random, 1.0, DVec3::ZERO);
    let frames: Vec<_> = (0..)
        .map(|i| i % 4 != 1)
        .zip(cameras)
        .map(|(r, c)| (c, r))
        .collect();
    // Whole, and in parts of thirty bricks or of one.
    let totals = check(&volumes, &frames, u64::MAX);
    assert_eq!(check(&volumes, &frames, 30 * 256 * 64), totals);
    assert_eq!(check(&volumes, &frames[..2], 1), totals[..2]);
    println!("views of {blocks} blocks: {totals:?}");
    assert!(totals.iter().any(|&n| n > 100) && totals.iter().all(|&n| n < blocks));
}

#[test]
fn ranges_that_end_on_entries_of_the_table_are_told_alike() {
    if gpu().is_none() {
        return;
    }
    // Value ranges exactly on the table's entries, where one more entry makes a block visible:
    // opacity begins above entry 2048.
    let curve = |v: f32| if v > 2048.0 { 0.5 } else { 0.0 };
    let range = [0.0, 4095.0];
    let transfer = TransferFunction::from_curves(|_| [1.0; 3], curve, range, 1.0).unwrap();
    let n = 256 * 600;
    let values: Vec<f32> = (0..n)
        .map(|i| {
            let block = (i / 256) as f32;
            match i % 3 {
                0 => 2040.0 + block * 0.03125,
                1 => 2047.0,
                _ => -1.0 - block,
            }
        })
        .collect();
    let volume = BlockedVolume::new(PointVolume {
        // Blocks far apart.
        particles: Particles::Isotropic {
            positions: (0..n)
                .map(|i| DVec3::new((i / 256) as f64 * 10.0, (i % 256) as f64 * 1e-3, 5.0))
                .collect(),
            sigmas: vec![0.1; n],
        },
        strength: Strength::Classified {
            volumes: vec![1.0; n],
        },
        colour: Colour::Classified,
        values: Some(Values::F32(values)),
        transfer_function: Some(transfer),
    });
    let camera = Camera {
        projection: Projection::Perspective,
        eye: DVec3::new(3000.0, 0.0, -3000.0),
        camera_from_world: DMat3::IDENTITY,
        focal_px: DVec2::splat(100.0),
        centre_px: DVec2::splat(150.0),
        width: 300,
        height: 300,
    };
    let blocks = volume.blocks.len();
    let seen = check(&[volume], &[(camera, true)], u64::MAX)[0];
    println!("{seen} of {blocks} blocks");
    assert!(seen > 0 && seen < blocks);
}

#[test]
fn more_blocks_than_one_workgroup_has_runs_of_are_placed_alike() {
    if gpu().is_none() {
        return;
    }
    // 66,000 blocks of a particle each, in 258 workgroups.
    let count = 66_000;
    let block = |i: u32| Block {
        origin: DVec3::new(0.0, 0.0, 1.0 + f64::from(i) * 4e-3),
        half_extent: Vec3::splat(1e-3),
        max_sigma: 1e-3,
        first: i,
        count: 1,
        value_range: [0.0, 1.0],
    };
    let volume = BlockedVolume {
        blocks: (0..count).map(block).collect(),
        particles: BlockedParticles::Isotropic {
            offsets: vec![[0.0; 3]; count as usize],
            sigmas: vec![1e-3; count as usize],
        },
        strength: Strength::Mass(vec![1.0; count as usize]),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
    };
    let (eye, size) = (DVec3::new(40.0, 0.0, 100.0), [200, 100]);
    let camera = Camera::perspective(eye, DVec3::Z * 120.0, DVec3::X, 120.0, size);
    let seen = check(
        &[volume],
        &[(camera.clone(), true), (camera, false)],
        u64::MAX,
    );
    println!("views: {seen:?}");
    assert!(seen[0] > 40_000 && seen[0] < 66_000);
}

#[test]
fn poison_is_seen_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(4);
    let sigmas = [f32::INFINITY, f32::NAN, 1e-42, 0.0, f32::MAX, 1.0, -1.0];
    let mut volumes = Vec::new();
    for far in [1e30, 1e150, 1e300, 1.7e308, 1e-300, 5e-324] {
        let positions = (0..2_000)
            .map(|i| random.point(1.0) * if i % 3 == 0 { far } else { 1.0 })
            .collect();
        volumes.push(points(positions, |i| sigmas[i / 300 % sigmas.len()]));
    }
    let nan = Lattice::uniform([30, 30, 30], DVec3::NAN, DVec3::ONE);
    let infinite = Lattice::uniform([30, 30, 30], DVec3::splat(-1e308), DVec3::splat(1e307));
    for lattice in [nan, infinite] {
        volumes.push(BlockedVolume::new(PointVolume {
            strength: Strength::Mass(vec![1.0; lattice.len()]),
            particles: Particles::Lattice {
                lattice,
                kernel_width: 0.7,
            },
            colour: Colour::Uniform([1.0; 3]),
            values: None,
            transfer_function: None,
        }));
    }
    let cameras = cameras(&mut random, 1.0, DVec3::ZERO);
    let frames: Vec<_> = (0..)
        .map(|i| i % 5 != 0)
        .zip(cameras)
        .map(|(r, c)| (c, r))
        .collect();
    println!("views: {:?}", check(&volumes, &frames, u64::MAX));
    for volume in &volumes {
        println!(
            "views: {:?}",
            check(std::slice::from_ref(volume), &frames, u64::MAX)
        );
    }
}
