//! Compares emulated double precision, and the cull, with their CPU twins.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::common::gpu::{gpu, is_software};
use crate::common::{Random, lower_factor};
use ewa_splat::Filter;
use ewa_splat::scene::{
    Colour, ColourIn, ColourSpace, Column, ControlPoint, Lattice, LatticeSpacing, Particles,
    PointVolume, Strength, StrengthIn, TransferFunction, Values, ValuesIn,
};
use ewa_splat::stages::blocks::{
    Block, BlockedParticles, BlockedVolume, DepthRange, Frustum, MergeBounds, Merged,
    MergedTransfer, NO_PARENT, choose, cull, cull_detail, distance_interval,
};
use ewa_splat::stages::gpu::{self, f64_operations};
use ewa_splat::stages::record::{BlockView, ChoiceUniform, KeyKind};
use ewa_splat::stages::scene::Weighting;
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

/// Returns true for the same bits; all NaNs are alike. At the least normal number, the device
/// rounds before it flushes denormals, the CPU after.
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
        // Half a step beyond: the least number that f32 rounds to infinity.
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
            // Arbitrary bits.
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
            // `max` does not distinguish the signs of zero.
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

/// Parameters of a frame besides its frustum.
#[derive(Debug, Clone)]
struct Shot {
    camera: Camera,
    rejects: bool,
    choice: ChoiceUniform,
}

impl Shot {
    /// Makes a frame with the default tolerance and without levels of detail.
    fn new(camera: &Camera, rejects: bool) -> Self {
        let focal = camera.focal_px.as_vec2();
        Self {
            camera: camera.clone(),
            rejects,
            choice: ChoiceUniform {
                focal_px: [focal.min_element(), focal.max_element()],
                thresholds: [0.0; 2],
                by_hand: 0,
                orthographic: u32::from(camera.projection == Projection::Orthographic),
                filter_kind: Filter::Adaptive as u32,
                low_pass_variance_px2: 1.0,
                tolerance: 1.0 / 255.0,
                merge_tolerance: 0.0,
                classified_by: 0,
                slab_thickness: 0.0,
            },
        }
    }

    fn with(&self, change: impl FnOnce(&mut ChoiceUniform)) -> Self {
        let mut other = self.clone();
        change(&mut other.choice);
        other
    }
}

/// Returns the views of some volumes with their keys and filters, and the keys per unit, as
/// `Renderer::render` computes them.
fn expected(
    volumes: &[BlockedVolume],
    shot: &Shot,
    frustum: &Frustum,
) -> (Vec<Vec<BlockView>>, f32) {
    let camera = &shot.camera;
    let cull_by = shot.rejects.then_some(frustum);
    let mut views = Vec::new();
    let mut closed = Vec::new();
    for family in volumes.chunk_by(|_, next| next.merged.is_some()) {
        let mut of_family = vec![Vec::new(); family.len()];
        if shot.choice.merge_tolerance > 0.0 {
            cull_detail(
                family,
                camera,
                cull_by,
                &shot.choice,
                &mut closed,
                &mut of_family,
            );
        } else {
            cull(&family[0], camera, cull_by, &shot.choice, &mut of_family[0]);
        }
        for (volume, views) in family.iter().zip(&mut of_family) {
            choose(volume, camera, &shot.choice, views);
        }
        views.append(&mut of_family);
    }
    let in_view = volumes
        .iter()
        .zip(&views)
        .flat_map(|(volume, views)| {
            let block = |v: &BlockView| (&volume.blocks[v.block as usize], v.is_spread());
            views.iter().map(block)
        })
        .filter(|(block, is_spread)| frustum.sees(camera, block, *is_spread));
    let interval = |(block, is_spread)| distance_interval(camera, block, is_spread);
    let range = DepthRange::of(in_view.map(interval));
    for (volume, views) in volumes.iter().zip(&mut views) {
        for view in views {
            let block = &volume.blocks[view.block as usize];
            view.key = range.key(distance_interval(camera, block, false).0);
        }
    }
    (views, range.keys_per_unit())
}

/// Counts over frames.
#[derive(Debug, Default)]
struct Tally {
    /// Views of each frame.
    views: Vec<usize>,
    /// Views of all frames by filter.
    filters: [usize; 7],
    /// Views of all frames by level of detail.
    levels: [usize; 8],
}

/// Runs [`check_shots`] on frames with the default tolerance, each with or without a frustum.
/// Returns the number of views in each.
fn check(volumes: &[BlockedVolume], frames: &[(Camera, bool)], part_bytes: u64) -> Vec<usize> {
    // Kernels are classified over their extents if any are too wide for their values alone.
    let shot = |(camera, rejects): &(Camera, bool)| {
        Shot::new(camera, *rejects).with(|choice| choice.classified_by = 1)
    };
    let shots: Vec<_> = frames.iter().map(shot).collect();
    check_shots(volumes, &shots, part_bytes).views
}

/// Compares every view of frames to the bit. On hardware whose quotients and roots differ from the
/// CPU's, a hundredth of the choices may fall on the other side of a threshold.
fn check_shots(volumes: &[BlockedVolume], shots: &[Shot], part_bytes: u64) -> Tally {
    let gpu = gpu().unwrap();
    let frustum = |camera| Frustum::new(camera, 7.0);
    let uniforms: Vec<_> = shots
        .iter()
        .map(|s| {
            let keys = match s.camera.projection {
                Projection::Orthographic => KeyKind::Depth,
                Projection::Perspective => KeyKind::Distance,
            };
            gpu::camera_uniform(
                &s.camera,
                &frustum(&s.camera),
                s.rejects,
                s.choice,
                keys,
                None,
            )
        })
        .collect();
    let outputs = gpu::cull(gpu, volumes, &uniforms, part_bytes).unwrap();
    // Zeros of either sign are alike, and so are NaNs.
    let bits = |v: &BlockView| {
        let point = v.origin_camera.map(|x| {
            let x = if x.is_nan() { f32::NAN } else { x + 0.0 };
            x.to_bits()
        });
        (
            v.block,
            point,
            v.first,
            v.count,
            v.key,
            v.filter_kind,
            v.level,
            v.classified_by,
        )
    };
    let mut tally = Tally::default();
    for (shot, out) in shots.iter().zip(outputs) {
        let (views, key_scale) = expected(volumes, shot, &frustum(&shot.camera));
        let mut filters = [0; 7];
        for view in views.iter().flatten() {
            filters[view.filter_kind as usize] += 1;
            tally.levels[view.level as usize] += 1;
        }
        for (sum, n) in tally.filters.iter_mut().zip(filters) {
            *sum += n as usize;
        }
        tally.views.push(views.iter().map(Vec::len).sum());
        if !gpu.is_software() {
            let key = |v: &BlockView| (v.level, v.block, v.filter_kind);
            let keys = |views: &[Vec<BlockView>]| {
                let keys = views.iter().enumerate();
                let keys = keys.flat_map(|(i, views)| views.iter().map(move |v| (i, key(v))));
                keys.collect::<BTreeSet<_>>()
            };
            let (a, b) = (keys(&out.views), keys(&views));
            let flips = a.symmetric_difference(&b).count();
            assert!(flips <= 2 + b.len() / 100, "{flips} of {}", b.len());
            continue;
        }
        assert_eq!(out.filters, filters, "{:?}", shot.choice);
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
    }
    tally
}

fn points(positions: Vec<DVec3>, sigma: impl Fn(usize) -> f32) -> BlockedVolume {
    let count = positions.len();
    BlockedVolume::new(PointVolume::new(
        Particles::Isotropic {
            positions,
            sigmas: (0..count).map(sigma).collect(),
        },
        Strength::Mass(vec![1.0; count]),
    ))
}

/// Returns cameras beside, inside and far from a scene of size 1 at the origin, looking away, and
/// orthographic. The scene is then scaled and moved.
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
    // This one looks away.
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

/// Returns three lattices: sheared bytes of which a few are visible, rectilinear f32 with poison,
/// and a single row.
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
        BlockedVolume::new(
            PointVolume::new(
                Particles::Lattice {
                    lattice,
                    kernel_width: 0.7,
                },
                Strength::Classified {
                    volumes: Vec::new(),
                },
            )
            .classified(values, transfer),
        )
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
    // Values are constant per brick, so that whole bricks are transparent.
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
    // Uniform scaling culls only transparent blocks; keys span the visible ones.
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
    // Value ranges end exactly on the table's entries, where one more entry makes a block visible:
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
        // Blocks lie far apart.
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
        boundary: None,
        normals: None,
        local_models: None,
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
    // 66,000 blocks of one particle each, in 258 workgroups.
    let count = 66_000;
    let block = |i: u32| Block {
        origin: DVec3::new(0.0, 0.0, 1.0 + f64::from(i) * 4e-3),
        half_extent: Vec3::splat(1e-3),
        max_sigma: 1e-3,
        min_sigma: 1e-3,
        max_strength: 1.0,
        first: i,
        count: 1,
        value_range: [0.0, 1.0],
        values_around: [f32::INFINITY, f32::NEG_INFINITY],
        greatest_spread: 0.0,
        parent: NO_PARENT,
        level: 0,
        crowding: 1.0,
    };
    let volume = BlockedVolume {
        blocks: (0..count).map(block).collect(),
        particles: BlockedParticles::Isotropic {
            offsets: vec![[0.0; 3]; count as usize].into(),
            sigmas: vec![1e-3; count as usize].into(),
        },
        strength: StrengthIn::Mass(vec![1.0; count as usize].into()),
        colour: ColourIn::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        indices: None,
        local_models: None,
        lobes: None,
        merged: None,
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
            boundary: None,
            normals: None,
            local_models: None,
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

/// Returns opacity in steps and ramps, with colours that change with them, over 0 to 255.
fn transfer() -> TransferFunction {
    let opacity = |v: f32| match v {
        v if v < 40.0 => 0.0,
        v if v < 90.0 => (v - 40.0) / 500.0,
        v if v < 100.0 => 0.8,
        v if v < 200.0 => 1e-3,
        _ => 0.1,
    };
    let colour = |v: f32| [(v * 0.05).sin().abs(), v / 255.0, 0.5];
    TransferFunction::from_curves(colour, opacity, [0.0, 255.0], 0.1).unwrap()
}

/// Evaluates a smooth field with values from 0 to 255.
fn field(p: DVec3) -> f32 {
    let waves = (p.x * 3.0).sin() + (p.y * 5.0 + p.z).sin() + (p.z * 2.0).cos();
    (waves * 42.0 + 127.0) as f32
}

/// Returns points in clumps and in between, with volumes that they fill.
///
/// - `kind`: bit 0 for ellipsoids, bit 1 for classified ones, bit 2 for individual colours.
fn cloud(random: &mut Random, count: usize, kind: usize) -> PointVolume {
    let centres: Vec<DVec3> = (0..8).map(|_| random.point(0.8)).collect();
    let positions: Vec<DVec3> = (0..count)
        .map(|i| match i % 4 {
            0 => random.point(1.0),
            _ => centres[i % 8] + random.point(1.0) * random.log_range(1e-3, 0.2),
        })
        .collect();
    let size = 0.5 * (count as f64).powf(-1.0 / 3.0);
    let sigmas: Vec<f64> = (0..count)
        .map(|_| size * random.log_range(0.8, 1.5))
        .collect();
    let strengths: Vec<f32> = sigmas
        .iter()
        .map(|s| (s.powi(2) * random.log_range(1e-2, 3.0)) as f32)
        .collect();
    let values = positions.iter().map(|p| field(*p)).collect();
    let is_classified = kind & 2 != 0;
    PointVolume {
        particles: if kind & 1 == 0 {
            Particles::Isotropic {
                sigmas: sigmas.iter().map(|&s| s as f32).collect(),
                positions,
            }
        } else {
            let mut factor = |s: &f64| {
                let ratio = random.log_range(1.0, 3.0);
                lower_factor(&random.factor(*s, ratio))
            };
            Particles::Anisotropic {
                factors: sigmas.iter().map(&mut factor).collect(),
                positions,
            }
        },
        strength: if is_classified {
            Strength::Classified { volumes: strengths }
        } else {
            Strength::Mass(strengths)
        },
        colour: match kind & 6 {
            2 => Colour::Classified,
            4 => Colour::PerParticle(
                (0..count)
                    .map(|i| [0.5, (i % 3) as f32 / 2.0, 0.1])
                    .collect(),
            ),
            0 => Colour::Classified,
            _ => Colour::Uniform([0.3, 0.6, 0.9]),
        },
        values: Some(Values::F32(values)),
        transfer_function: Some(transfer()),
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns a field on a lattice that fills the cube of half side 1: 0 uniform, 1 sheared, 2
/// rectilinear.
fn grid(random: &mut Random, dims: [usize; 3], kind: usize) -> PointVolume {
    let step = dims.map(|n| 2.0 / n as f64);
    let spacing = if kind == 2 {
        let axis = |n: usize, random: &mut Random| {
            let mut at = -1.0;
            let mut next = || {
                at += 2.0 / n as f64 * random.log_range(0.5, 2.0);
                at
            };
            (0..n).map(|_| next()).collect::<Vec<f64>>()
        };
        LatticeSpacing::Rectilinear {
            coordinates: dims.map(|n| axis(n, random)),
        }
    } else {
        let shear = if kind == 1 { 0.4 } else { 0.0 };
        LatticeSpacing::Uniform {
            origin: DVec3::splat(-1.0),
            step: DMat3::from_cols(
                DVec3::new(step[0], shear * step[0], 0.0),
                DVec3::new(0.0, step[1], shear * step[1]),
                DVec3::new(-shear * step[2], 0.0, step[2]),
            ),
        }
    };
    let lattice = Lattice { dims, spacing };
    let values = (0..lattice.len())
        .map(|n| {
            let cell = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
            field(lattice.position(cell)) as u8
        })
        .collect();
    PointVolume::new(
        Particles::Lattice {
            lattice,
            kernel_width: 0.7,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(Values::U8(values), transfer())
}

/// Returns cameras on the cube of half side 1 at many zooms, from inside to where it is a pixel.
fn zooms(random: &mut Random) -> Vec<Camera> {
    let mut cameras = Vec::new();
    for power in (-2..26).step_by(2) {
        let distance = 2.0 * 2_f64.powi(power);
        let direction = random.rotation().x_axis;
        let (eye, size) = (direction * distance, [320, 240]);
        let aim = random.point(0.1);
        let mut camera = Camera::perspective(eye, aim, DVec3::Z, 40.0, size);
        // The wider the view, the larger must details be.
        camera.focal_px.y *= 1.0 + 0.3 * f64::from(power % 4);
        cameras.push(camera);
        let height = distance;
        cameras.push(Camera::orthographic(
            direction * 9.0,
            aim,
            DVec3::Z,
            height,
            size,
        ));
    }
    cameras
}

#[test]
fn filters_of_blocks_are_chosen_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(21);
    let mut volumes: Vec<_> = (0..6)
        .map(|kind| BlockedVolume::new(cloud(&mut random, 20_000, kind)))
        .collect();
    volumes.extend((0..3).map(|kind| BlockedVolume::new(grid(&mut random, [50, 41, 30], kind))));
    let (mut by_tolerance, mut by_hand) = ([0; 7], [0; 7]);
    for camera in zooms(&mut random) {
        let shot = Shot::new(&camera, true);
        let mut shots = vec![shot.clone()];
        for tolerance in [1e-4, 1e-2, 0.3] {
            for low_pass in [0.0, 0.25, 4.0] {
                shots.push(shot.with(|c| {
                    c.tolerance = tolerance;
                    c.low_pass_variance_px2 = low_pass;
                }));
            }
        }
        let first_by_hand = shots.len();
        for thresholds in [[0.3, 1.0], [2.0, 0.1], [0.0, 1e9]] {
            shots.push(shot.with(|c| {
                c.by_hand = 1;
                c.thresholds = thresholds;
            }));
        }
        let asked = shot.with(|c| c.filter_kind = Filter::Isotropic as u32);
        let add = |sums: &mut [usize; 7], tally: Tally| {
            for (sum, n) in sums.iter_mut().zip(tally.filters) {
                *sum += n;
            }
        };
        add(
            &mut by_tolerance,
            check_shots(&volumes, &shots[..first_by_hand], u64::MAX),
        );
        add(
            &mut by_hand,
            check_shots(&volumes, &shots[first_by_hand..], u64::MAX),
        );
        let asked = check_shots(&volumes, &[asked], u64::MAX);
        assert_eq!(asked.filters[Filter::Isotropic as usize], asked.views[0]);
    }
    println!("by tolerance {by_tolerance:?}, by hand {by_hand:?}");
    let count = |sums: [usize; 7], filter: Filter| sums[filter as usize];
    use Filter::{Adaptive, Ewa, Isotropic, LowPass, Reconstruction};
    for filter in [Adaptive, Ewa, Reconstruction, LowPass, Isotropic] {
        assert!(count(by_tolerance, filter) > 20, "{filter:?}");
    }
    for filter in [Ewa, Reconstruction, LowPass] {
        assert!(count(by_hand, filter) > 100, "{filter:?}");
    }
}

#[test]
fn levels_of_detail_are_cut_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(22);
    let mut families = Vec::new();
    for kind in 0..8 {
        families.push(BlockedVolume::with_detail(cloud(&mut random, 30_000, kind)));
    }
    for kind in 0..3 {
        families.push(BlockedVolume::with_detail(grid(
            &mut random,
            [90, 70, 61],
            kind,
        )));
    }
    // All families also form one scene, where parents are counted over all of them.
    let scene: Vec<_> = families.iter().flatten().cloned().collect();
    assert!(scene.iter().filter(|v| v.merged.is_some()).count() > 12);
    families.push(scene);
    let cameras = zooms(&mut random);
    let mut levels = [0; 8];
    for (f, family) in families.iter().enumerate() {
        let mut shots = Vec::new();
        for (i, camera) in cameras.iter().enumerate() {
            let shot = Shot::new(camera, i % 7 != 3).with(|c| c.merge_tolerance = c.tolerance);
            shots.push(shot.with(|c| {
                c.tolerance = [0.05, 0.5][i % 2];
                // In every second one, merging may err by more.
                c.merge_tolerance = c.tolerance * [1.0, 20.0][i / 2 % 2];
            }));
            shots.push(shot);
        }
        // A frame without levels of detail leaves nothing behind and takes nothing over.
        shots.push(Shot::new(&cameras[12], true));
        let tally = check_shots(family, &shots, u64::MAX);
        println!("{f}: {:?} by level", tally.levels);
        for (sum, n) in levels.iter_mut().zip(tally.levels) {
            *sum += n;
        }
        assert!(tally.levels[0] > 0);
        let cut = check_shots(family, &shots[20..28], 60 * 256 * 64);
        assert_eq!(cut.views, tally.views[20..28]);
    }
    assert!(levels[..4].iter().all(|&n| n > 20), "{levels:?}");
}

#[test]
fn degenerate_blocks_are_chosen_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(23);
    // Denormals are zeros on the device.
    const NUMBERS: [f32; 12] = [
        0.0,
        -0.0,
        1.0,
        1e-3,
        0.5,
        30.0,
        -1.0,
        1e30,
        1e-30,
        f32::MAX,
        f32::INFINITY,
        f32::NAN,
    ];
    let count = 8_000_u32;
    let mut pick = |rarely: usize, usual: f64| {
        if random.index(rarely) == 0 {
            NUMBERS[random.index(NUMBERS.len())]
        } else {
            (usual * random.log_range(0.1, 10.0)) as f32
        }
    };
    let block = |i: u32, parent, pick: &mut dyn FnMut(usize, f64) -> f32| Block {
        origin: DVec3::new(f64::from(i % 7) - 3.0, 0.2, 1.0 + f64::from(i % 100) * 0.3),
        half_extent: Vec3::new(pick(9, 0.1), pick(9, 0.1), pick(9, 0.1)),
        max_sigma: pick(6, 1e-2),
        min_sigma: pick(6, 8e-3),
        max_strength: pick(6, 1e-3),
        first: i,
        count: 1,
        value_range: [0.0, 1.0],
        values_around: [f32::INFINITY, f32::NEG_INFINITY],
        greatest_spread: 0.0,
        parent,
        level: u32::from(parent == NO_PARENT),
        crowding: 1.0,
    };
    let volume = |blocks, merged| BlockedVolume {
        boundary: None,
        normals: None,
        blocks,
        particles: BlockedParticles::Anisotropic {
            offsets: vec![[0.0; 3]; count as usize].into(),
            factors: vec![[1e-2, 0.0, 1e-2, 0.0, 0.0, 1e-2]; count as usize].into(),
        },
        strength: StrengthIn::Mass(vec![1e-3; count as usize].into()),
        colour: ColourIn::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        indices: None,
        local_models: None,
        lobes: None,
        merged,
    };
    let base = (0..count).map(|i| block(i, i, &mut pick)).collect();
    let coarse = (0..count).map(|i| block(i, NO_PARENT, &mut pick)).collect();
    let bounds = (0..count)
        .map(|_| MergeBounds {
            third_mean: pick(7, 3e-3),
            third: pick(7, 5e-3),
            fourth: pick(7, 5e-3),
            second: pick(7, 1e-2),
            spread: pick(7, 1.0),
            colour: pick(7, 0.1),
            uneven: pick(7, 0.3),
        })
        .collect();
    let merged = Merged {
        bounds,
        ..Merged::default()
    };
    let family = [volume(base, None), volume(coarse, Some(merged))];
    let mut tally = Tally::default();
    for distance in [0.0, 3.0, 40.0, 1e4, 1e20] {
        // The square of 1e20 is beyond f32, and so are a graphics card's quotients.
        if distance > 1e18 && !is_software() {
            continue;
        }
        for is_orthographic in [false, true] {
            let (eye, aim, size) = (DVec3::Z * -distance, DVec3::Z * 9.0, [200, 150]);
            let camera = if is_orthographic {
                Camera::orthographic(eye, aim, DVec3::Y, 4.0 + distance, size)
            } else {
                Camera::perspective(eye, aim, DVec3::Y, 60.0, size)
            };
            let shot = Shot::new(&camera, false);
            let mut shots = vec![shot.with(|c| c.merge_tolerance = c.tolerance)];
            for h2 in [0.0, 1.0, f32::MAX] {
                shots.push(shot.with(|c| c.low_pass_variance_px2 = h2));
                shots.push(shot.with(|c| {
                    c.low_pass_variance_px2 = h2;
                    c.tolerance = 0.999;
                    c.merge_tolerance = 0.999;
                }));
                for thresholds in [[0.5, 2.0], [0.0, f32::INFINITY], [f32::NAN, f32::MAX]] {
                    shots.push(shot.with(|c| {
                        c.low_pass_variance_px2 = h2;
                        c.by_hand = 1;
                        c.thresholds = thresholds;
                    }));
                }
            }
            let found = check_shots(&family, &shots, u64::MAX);
            for (sum, n) in tally.filters.iter_mut().zip(found.filters) {
                *sum += n;
            }
            for (sum, n) in tally.levels.iter_mut().zip(found.levels) {
                *sum += n;
            }
        }
    }
    println!("{tally:?}");
    assert!(tally.levels[0] > 1_000 && tally.levels[1] > 1_000);
}

/// Compares the transfer function's effect on the spread of clusters' values.
#[test]
fn clusters_of_classified_particles_are_chosen_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(24);
    let transfer =
        TransferFunction::from_curves(|v| [v / 255.0, 0.5, 0.1], |v| v / 512.0, [0.0, 255.0], 0.1)
            .unwrap();
    let count = 6_000_u32;
    let block = |i: u32, parent, random: &mut Random| {
        let low = random.range(-20.0, 270.0) as f32;
        let sigma = random.log_range(3e-3, 3e-2) as f32;
        Block {
            origin: DVec3::new(f64::from(i % 7) - 3.0, 0.2, 5.0 + f64::from(i % 100) * 0.3),
            half_extent: Vec3::splat(0.05),
            max_sigma: sigma * 1.5,
            min_sigma: sigma,
            max_strength: random.log_range(1e-8, 1e-4) as f32,
            first: i,
            count: 1,
            value_range: [low, low + random.log_range(0.01, 100.0) as f32],
            values_around: [f32::INFINITY, f32::NEG_INFINITY],
            greatest_spread: 0.0,
            parent,
            level: u32::from(parent == NO_PARENT),
            crowding: 1.0,
        }
    };
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, DVec3::Y, 60.0, [400, 300]);
    let shot = Shot::new(&camera, false);
    let shots = [1e-4, 1e-3, 4e-3, 2e-2, 0.1]
        .map(|t| shot.with(|c| (c.tolerance, c.merge_tolerance) = (t, t)));
    for case in 0..3 {
        let ones = Column::from(vec![1.0; count as usize]);
        let (strength, weighting) = match case {
            0 | 1 => (
                StrengthIn::Classified { volumes: ones },
                Weighting::Extinction,
            ),
            _ => (StrengthIn::Mass(ones), Weighting::Even),
        };
        let colour = match case {
            1 => ColourIn::Uniform([1.0; 3]),
            _ => ColourIn::Classified,
        };
        let bounds = (0..count).map(|_| MergeBounds {
            third_mean: random.log_range(1e-3, 1e-2) as f32,
            third: random.log_range(1e-3, 1e-2) as f32,
            fourth: random.log_range(1e-3, 1e-2) as f32,
            second: random.log_range(3e-3, 1e-1) as f32,
            spread: random.log_range(1e-2, 50.0) as f32,
            colour: 0.0,
            uneven: random.log_range(1e-4, 1.0) as f32,
        });
        let merged = Merged {
            bounds: bounds.collect(),
            spreads: vec![1.0; count as usize].into(),
            transfer: Some(Arc::new(MergedTransfer::new(&transfer, weighting))),
            member_depths: vec![0.0; count as usize].into(),
        };
        let volume = |blocks, merged| BlockedVolume {
            boundary: None,
            normals: None,
            blocks,
            particles: BlockedParticles::Anisotropic {
                offsets: vec![[0.0; 3]; count as usize].into(),
                factors: vec![[1e-2, 0.0, 1e-2, 0.0, 0.0, 1e-2]; count as usize].into(),
            },
            strength: strength.clone(),
            colour: colour.clone(),
            values: Some(ValuesIn::F32(vec![100.0; count as usize].into())),
            transfer_function: Some(transfer.clone()),
            indices: None,
            local_models: None,
            lobes: None,
            merged,
        };
        let base = (0..count).map(|i| block(i, i, &mut random)).collect();
        let coarse = (0..count)
            .map(|i| block(i, NO_PARENT, &mut random))
            .collect();
        let family = [volume(base, None), volume(coarse, Some(merged))];
        let tally = check_shots(&family, &shots, u64::MAX);
        println!("{case}: {tally:?}");
        assert!(tally.levels[0] > 500 && tally.levels[1] > 1_000);
    }
}
