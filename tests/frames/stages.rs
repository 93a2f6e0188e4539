//! Tests single stages against brute force: the sort, the tiles' lists, the cull.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::frame::Frame;
use crate::common::scene::{self, Particle, difference, render, volume};
use ewa_splat::render::Advanced;
use ewa_splat::scene::{
    Colour, Particles, PointVolume, Strength, StrengthIn, TransferFunction, Values,
};
use ewa_splat::stages::blocks::{BlockedParticles, BlockedVolume};
use ewa_splat::stages::constants::TILE_SIZE;
use ewa_splat::stages::cpu::{Bins, bin, classify, count_classified, sort};
use ewa_splat::stages::record::{
    BlockView, Carried, ClassifiedParticle, Footprint, PATH_EXACT, PATH_NEAR, pack_range,
};
use ewa_splat::stages::splat::Axes;
use ewa_splat::stages::splat::{Filter, evaluate_near};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Renderer, Settings};
use glam::{DVec2, DVec3, Vec3};

#[test]
fn the_order_is_that_of_a_stable_sort() {
    let mut random = Random::new(1);
    for (count, keys) in [
        (0, 1),
        (1, 1),
        (1_000, 3),
        (50_000, 70_000),
        (50_000, 1 << 31),
    ] {
        let footprints: Vec<Footprint> = (0..count)
            .map(|_| Footprint {
                key: (random.bits() % keys) as u32,
                // Every fifth reaches no pixel.
                rows: if random.index(5) == 0 {
                    0
                } else {
                    pack_range(3, 9)
                },
                ..bytemuck::Zeroable::zeroed()
            })
            .collect();
        let mut expected: Vec<usize> = (0..footprints.len())
            .filter(|&i| footprints[i].rows != 0)
            .collect();
        expected.sort_by_key(|&i| footprints[i].key);
        // Earlier contents are overwritten.
        let mut order = vec![7; 3];
        sort(&footprints, &mut order);
        let got: Vec<usize> = order.iter().map(|&w| w as u32 as usize).collect();
        assert_eq!(got, expected);
        assert!(
            order
                .iter()
                .all(|w| (w >> 32) as u32 == footprints[*w as u32 as usize].key)
        );
    }
}

/// Returns ellipsoids from a tenth of a pixel to half the image, some around the eye, some beside
/// it.
fn particles(seed: u64, count: usize, ratio: f64) -> Vec<Particle> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|i| {
            let size = random.log_range(3e-3, 0.5);
            let ratio = random.log_range(1.0, ratio);
            let half = if i % 9 == 0 { 0.4 } else { 3.0 };
            let position = random.point(half)
                + if i % 9 == 0 {
                    DVec3::ZERO
                } else {
                    DVec3::Z * 3.2
                };
            Particle {
                position,
                factor: random.factor(size, ratio),
                mass: (size * size / ratio * random.log_range(0.01, 20.0)) as f32,
                colour: [1.0; 3],
            }
        })
        .collect()
}

/// Returns true if a pixel's centre lies inside the cut-off by more than rounding, and `None` if it
/// is near the cut-off.
fn inside(frame: &Frame, i: usize, x: usize, y: usize) -> Option<bool> {
    let f = &frame.footprints[i];
    let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    let word = |v: [f32; 2]| DVec2::new(f64::from(v[0]), f64::from(v[1]));
    if f.path & 3 == PATH_NEAR {
        let slope = |i: usize, at: usize| {
            (at as f32 + 0.5 - frame.uniform.centre_px[i]) / frame.uniform.focal_px[i]
        };
        let terms = &frame.near[(f.path >> 2) as usize];
        let ray = Vec3::new(slope(0, x), slope(1, y), 1.0);
        return Some(evaluate_near(terms, f.tau, ray, f.cutoff_squared) > 0.0);
    }
    let d = at - word(f.centre_px);
    let (p, r) = (word(f.form_p), word(f.form_r));
    let mut q = p.dot(d).powi(2) + r.dot(d).powi(2);
    if f.path & 3 == PATH_EXACT {
        let terms = &frame.exact[i];
        let [hxx, hxy, hyy] = terms.hessian.map(f64::from);
        let w =
            1.0 + word(terms.gradient).dot(d) + hxx * d.x * d.x + hxy * d.x * d.y + hyy * d.y * d.y;
        q = if w > 0.0 { q / w } else { f64::INFINITY };
    }
    let cutoff = f64::from(f.cutoff_squared);
    // 1e-3 of r² is an eighth of a percent of the radius.
    if (q - cutoff).abs() < 1e-3 * cutoff {
        None
    } else {
        Some(q < cutoff)
    }
}

/// Checks the lists of one frame. Returns the numbers of entries and of needed entries.
fn check_lists(frame: &Frame) -> (usize, usize) {
    let bins = frame.bins();
    let [columns, rows] = frame.tiles;
    let mut listed = vec![vec![false; frame.footprints.len()]; columns * rows];
    for (t, listed) in listed.iter_mut().enumerate() {
        let mut last = None;
        for i in bins.tile(t) {
            let key = (frame.footprints[i as usize].key, i);
            assert!(
                last.is_none_or(|last| last < key),
                "tile {t} is out of order"
            );
            last = Some(key);
            listed[i as usize] = true;
        }
    }
    let mut needed = 0;
    for &word in &frame.order {
        let i = word as u32 as usize;
        let f = &frame.footprints[i];
        let near = f.path & 3 == PATH_NEAR;
        let mut by_tile = vec![false; columns * rows];
        for y in 0..frame.camera.height {
            for x in 0..frame.camera.width {
                let is_inside = inside(frame, i, x, y);
                let t = y / TILE_SIZE * columns + x / TILE_SIZE;
                if is_inside != Some(false) {
                    by_tile[t] = true;
                }
                // A near kernel's range is that of its half line, in whole tiles: see the next
                // test.
                if is_inside == Some(true) && !near {
                    assert!(listed[t][i], "({x}, {y}) of {f:?} is in no list");
                    let (x0, x1) = f.column_range();
                    let (y0, y1) = f.row_range();
                    let (x, y) = (x as u32, y as u32);
                    assert!(
                        x0 <= x && x < x1 && y0 <= y && y < y1,
                        "({x}, {y}) beyond {f:?}"
                    );
                }
            }
        }
        needed += by_tile.iter().filter(|t| **t).count();
    }
    (bins.len(), needed)
}

#[test]
fn every_tile_inside_a_cutoff_lists_the_footprint() {
    let mut totals = [0_usize; 2];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for filter in Filter::ALL {
            for (seed, ratio) in [(2, 10.0), (3, 1e4)] {
                let camera = scene::camera(projection, [61.0, 47.0], [115, 83]);
                let settings = Settings {
                    filter,
                    ..Settings::default()
                };
                let frame = Frame::new(volume(&particles(seed, 250, ratio)), &camera, &settings);
                assert!(frame.order.len() > 15, "{}", frame.order.len());
                let (entries, needed) = check_lists(&frame);
                totals[0] += entries;
                totals[1] += needed;
            }
        }
    }
    let [entries, needed] = totals;
    println!(
        "{entries} entries, {needed} needed: {:.1} % to spare",
        100.0 * (entries as f64 / needed as f64 - 1.0)
    );
    // Lists of bounding boxes alone would hold some 40 % too many.
    assert!(entries < needed * 5 / 4, "{entries} entries for {needed}");
}

#[test]
fn lopsided_outlines_of_strong_perspective_miss_no_tile() {
    // A wide angle, and kernels that extend half way to the eye: the outline's middle lies far from
    // the centre.
    let mut random = Random::new(8);
    let particles: Vec<Particle> = (0..400)
        .map(|_| {
            let depth = random.range(0.3, 2.0);
            let slope = random.point(2.0).truncate();
            let (size, ratio) = (random.log_range(0.05, 0.25), random.log_range(1.0, 8.0));
            Particle {
                position: (slope * depth).extend(depth),
                factor: random.factor(size * depth, ratio),
                mass: (0.1 * (size * depth).powi(2) / ratio) as f32,
                colour: [1.0; 3],
            }
        })
        .collect();
    let camera = scene::camera(Projection::Perspective, [60.0, 50.0], [253, 201]);
    let settings = Settings {
        filter: Filter::Exact,
        ..Settings::default()
    };
    let frame = Frame::new(volume(&particles), &camera, &settings);
    let exact = frame
        .order
        .iter()
        .filter(|&&w| frame.footprints[w as u32 as usize].path == PATH_EXACT);
    assert!(exact.count() > 150);
    let (entries, needed) = check_lists(&frame);
    println!("strong perspective: {entries} entries, {needed} needed");
    assert!(entries < needed * 5 / 4, "{entries} entries for {needed}");
}

#[test]
fn many_footprints_keep_their_order_in_every_tile() {
    // More than one chunk of the sorted footprints.
    let camera = scene::camera(Projection::Perspective, [61.0, 47.0], [115, 83]);
    let frame = Frame::new(
        volume(&particles(4, 20_000, 10.0)),
        &camera,
        &Settings::default(),
    );
    assert!(frame.order.len() > 8_000);
    let bins = frame.bins();
    let mut entries = 0;
    for t in 0..frame.tiles[0] * frame.tiles[1] {
        let list: Vec<_> = bins
            .tile(t)
            .map(|i| (frame.footprints[i as usize].key, i))
            .collect();
        assert!(list.windows(2).all(|w| w[0] < w[1]), "tile {t}");
        entries += list.len();
    }
    assert_eq!(entries, bins.len());
    assert!(!bins.is_empty());
}

#[test]
fn runs_of_tiles_have_the_lists_of_the_whole() {
    let settings = Settings::default();
    let camera = scene::camera(Projection::Perspective, [240.0; 2], [130, 150]);
    let frame = Frame::new(volume(&particles(31, 3000, 30.0)), &camera, &settings);
    let [columns, rows] = frame.tiles;
    let whole = frame.bins();
    assert_eq!(whole.tiles(), 0..columns * rows);
    let mut entries = 0;
    // Runs that begin and end within a row.
    assert_eq!(columns, 9);
    for first in (0..columns * rows).step_by(17) {
        let run = first..(first + 17).min(columns * rows);
        let mut bins = Bins::default();
        let (footprints, order) = (&frame.footprints, &frame.order);
        bin(
            footprints,
            frame.terms(),
            order,
            columns,
            run.clone(),
            &mut bins,
        );
        assert_eq!(bins.tiles(), run);
        for tile in bins.tiles() {
            assert!(bins.tile(tile).eq(whole.tile(tile)), "{tile}");
            entries += bins.tile_len(tile);
        }
    }
    assert_eq!(entries, whole.len());
    assert!(entries > 5000);
}

#[test]
fn near_kernels_reach_every_tile_their_half_line_meets() {
    let mut random = Random::new(5);
    let mut checked = 0;
    for i in 0..200 {
        let (ratio, h2) = (random.log_range(1.0, 30.0), [1.0, 25.0][i % 2]);
        let factor = random.factor(0.4, ratio);
        let particle = Particle {
            position: factor * random.point(2.5),
            factor,
            mass: 0.05,
            colour: [1.0; 3],
        };
        let focal = [30.0, 1.3 * random.range(20.0, 40.0)];
        let camera = scene::camera(Projection::Perspective, focal, [96, 80]);
        let settings = Settings {
            low_pass_variance_px2: h2,
            ..Settings::default()
        };
        let frame = Frame::new(volume(&[particle]), &camera, &settings);
        let Some(f) = frame.footprints.first() else {
            continue;
        };
        if f.path & 3 != PATH_NEAR || !f.is_visible() {
            continue;
        }
        let bare = crate::common::judge::Body {
            centre: particle.position,
            variance: factor * factor.transpose(),
            mass: 1.0,
        };
        let depth = (bare.centre.z.powi(2) + bare.variance.z_axis.z).sqrt();
        let body = bare.low_passed(camera.focal_px, f64::from(h2), depth);
        let inverse = body.variance.inverse();
        for y in 0..camera.height {
            for x in 0..camera.width {
                let slope = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - camera.centre_px)
                    / camera.focal_px;
                let d = slope.extend(1.0);
                // The nearest point of the half line in the kernel's metric.
                let t = (d.dot(inverse * body.centre) / d.dot(inverse * d)).max(0.0);
                let gap = d * t - body.centre;
                let q = gap.dot(inverse * gap);
                // Slightly within the cut-off, for rounding (of K, by the square of the ratio).
                if t > 0.0 && q < f64::from(f.cutoff_squared) * 0.998 {
                    let (x0, x1) = f.column_range();
                    let (y0, y1) = f.row_range();
                    let (x, y) = (x as u32, y as u32);
                    assert!(
                        x0 <= x && x < x1 && y0 <= y && y < y1,
                        "({x}, {y}) at Q {q} lies beyond {:?} x {:?} of {particle:?}, h² {h2}",
                        f.column_range(),
                        f.row_range()
                    );
                    checked += 1;
                }
            }
        }
    }
    println!("{checked} pixels of near kernels lie within their range");
    assert!(checked > 50_000);
}

/// Returns a camera whose frustum cuts through the particles.
fn cutting(projection: Projection, random: &mut Random) -> Camera {
    let mut camera = scene::camera(projection, [40.0, 50.0], [64, 48]);
    camera.camera_from_world = random.rotation();
    camera.eye = random.point(2.0);
    camera
}

#[test]
fn the_cull_drops_nothing_that_would_draw() {
    let mut random = Random::new(6);
    let (mut culled, mut blocks) = (0, 0);
    let mut worst = [0.0_f32; Filter::ALL.len()];
    for round in 0..6 {
        let all: Vec<Particle> = (0..12_000)
            .map(|_| {
                let (size, ratio) = (random.log_range(1e-3, 0.06), random.log_range(1.0, 100.0));
                Particle {
                    position: random.point(3.0),
                    factor: random.factor(size, ratio),
                    mass: (size * size / ratio) as f32,
                    colour: [0.9, 0.5, 0.2],
                }
            })
            .collect();
        let projection = [Projection::Perspective, Projection::Orthographic][round % 2];
        let camera = cutting(projection, &mut random);
        for filter in Filter::ALL {
            let settings = Settings {
                filter,
                ..Settings::default()
            };
            let mut renderer = Renderer::new(vec![volume(&all)]).unwrap();
            let image = renderer.render(&camera, &settings).unwrap().clone();
            culled += renderer.counts().blocks_culled;
            blocks += renderer.counts().blocks;
            let uncut = without_cull(&all, &camera, &settings);
            let error = difference(&image, &uncut);
            let n = filter as usize;
            worst[n] = worst[n].max(error);
        }
    }
    println!("{culled} of {blocks} blocks culled; largest difference by filter {worst:?}");
    assert!(culled * 10 > blocks, "the cameras cut too little away");
    for filter in [Filter::Adaptive, Filter::Exact, Filter::UniformScaling] {
        // Blocks keep their origins, so footprints are equal. Uniform scaling enlarges kernels
        // beyond any reach, so it culls only transparent blocks.
        assert!(worst[filter as usize] < 1e-6, "{filter:?}: {worst:?}");
    }
    for filter in [
        Filter::Ewa,
        Filter::Reconstruction,
        Filter::LowPass,
        Filter::Isotropic,
    ] {
        // The affine footprint of a kernel far off the axis extends beyond the kernel itself. The
        // cull's omissions there are an error of that approximation.
        assert!(
            worst[filter as usize] < Settings::default().tolerance,
            "{filter:?}: {worst:?}"
        );
    }
}

/// Draws the image of all blocks, none culled: the stages of a frame, with a frustum that contains
/// everything.
fn without_cull(all: &[Particle], camera: &Camera, settings: &Settings) -> ewa_splat::Image {
    use ewa_splat::stages::cpu::{RasteriseSettings, Tile, rasterise, resolve};
    let frame = Frame::uncut(volume(all), camera, settings);
    let mut tiles = vec![Tile::default(); frame.tiles[0] * frame.tiles[1]];
    let raster = RasteriseSettings {
        axes: Axes {
            linear_opacity: settings.advanced.linear_opacity,
            depth: false,
            count: false,
            may_be_exact: frame.any_exact,
            ..Axes::default()
        },
        level: settings.advanced.simd,
        ends: None,
        task: None,
    };
    rasterise(
        &frame.uniform,
        raster,
        &frame.footprints,
        &frame.exact,
        &frame.near,
        &frame.bins(),
        frame.tiles[0],
        &[],
        None,
        &mut tiles,
    );
    let mut image = ewa_splat::Image::new(camera.width, camera.height);
    resolve(&tiles, None, false, &mut image);
    image
}

#[test]
fn a_particle_alone_draws_what_it_draws_in_its_block() {
    // In a scene of its own, each particle is tested against the frustum alone; together they share
    // blocks.
    let mut random = Random::new(7);
    let mut worst = 0.0_f32;
    for round in 0..4 {
        let all: Vec<Particle> = (0..120)
            .map(|_| {
                let (size, ratio) = (random.log_range(1e-2, 0.3), random.log_range(1.0, 10.0));
                Particle {
                    position: random.point(2.5),
                    factor: random.factor(size, ratio),
                    mass: (0.02 * size * size / ratio) as f32,
                    colour: [1.0; 3],
                }
            })
            .collect();
        let projection = [Projection::Perspective, Projection::Orthographic][round % 2];
        let camera = cutting(projection, &mut random);
        let settings = Settings {
            advanced: Advanced {
                linear_opacity: true,
                ..Advanced::default()
            },
            ..Settings::default()
        };
        let together = render(vec![volume(&all)], &camera, &settings);
        // 1 - product of (1 - alpha), in any order.
        let mut left = vec![1.0_f64; together.pixels.len()];
        for particle in &all {
            let alone = render(vec![volume(&[*particle])], &camera, &settings);
            for (left, p) in left.iter_mut().zip(&alone.pixels) {
                *left *= 1.0 - f64::from(p[3]);
            }
        }
        for (left, p) in left.iter().zip(&together.pixels) {
            worst = worst.max((1.0 - left - f64::from(p[3])).abs() as f32);
        }
    }
    println!("alone against together: {worst:.1e}");
    // A pixel on a kernel's edge may flip: the tolerance times the depth, at most .02 / 6.
    assert!(worst < 5e-5, "{worst:e}");
}

/// Returns 3,000 spheres whose masses and values number them, except for poison and repeated
/// values.
fn numbered(kind: usize) -> BlockedVolume {
    let mut random = Random::new(9);
    let count = 3_000;
    let of_f32 = |i: usize| match i % 50 {
        0 => [
            f32::NAN,
            -f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            -0.0,
            0.0,
        ][i / 50 % 6],
        n if n < 10 => (i % 7) as f32 * 50.0,
        _ => (i * 7_919 % count) as f32 / 10.0,
    };
    BlockedVolume::new(PointVolume {
        particles: Particles::Isotropic {
            positions: (0..count).map(|_| random.point(1.0)).collect(),
            sigmas: (0..count).map(|i| 1.0 + i as f32).collect(),
        },
        strength: Strength::Classified {
            volumes: (0..count).map(|i| 1.0 + i as f32).collect(),
        },
        colour: Colour::Classified,
        values: Some(match kind {
            0 => Values::U8((0..count).map(|i| (i * 7_919) as u8).collect()),
            1 => Values::I16((0..count).map(|i| (i * 7_919 % 400) as i16 - 50).collect()),
            2 => Values::U16((0..count).map(|i| (i * 7_919 % 400) as u16).collect()),
            _ => Values::F32((0..count).map(of_f32).collect()),
        }),
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    })
}

#[test]
fn particles_of_a_block_are_in_the_order_of_their_values() {
    for kind in 0..4 {
        let volume = numbered(kind);
        let (values, BlockedParticles::Isotropic { sigmas, .. }) =
            (volume.values.as_ref().unwrap(), &volume.particles)
        else {
            panic!("spheres stay spheres");
        };
        let StrengthIn::Classified { volumes } = &volume.strength else {
            panic!("volumes stay volumes");
        };
        // All arrays are reordered alike.
        assert_eq!(volumes, sigmas);
        for block in &volume.blocks {
            let members = block.first as usize..(block.first + block.count) as usize;
            for i in members.start + 1..members.end {
                let (a, b) = (values.get(i - 1), values.get(i));
                let is_tie = a == b || (a.is_nan() && b.is_nan());
                let is_ascending = a < b || (b.is_nan() && !a.is_nan());
                assert!(
                    is_ascending || (is_tie && sigmas[i - 1] < sigmas[i]),
                    "{a} {b}"
                );
            }
        }
    }
}

#[test]
fn what_classify_leaves_out_is_invisible() {
    let shapes: [fn(f32) -> f32; 7] = [
        |_| 0.0,
        |_| 0.5,
        |v| f32::from(v >= 250.0) * 0.5,
        |v| f32::from(v <= 0.0) * 0.5,
        |v| f32::from((49.0..51.0).contains(&v)) * 0.5,
        |v| f32::from((20.0..30.0).contains(&v) || (200.0..210.0).contains(&v)) * 0.5,
        // A single entry.
        |v| f32::from((v - 100.0).abs() < 0.04) * 0.5,
    ];
    let (mut seen, mut all) = (0, 0);
    for kind in 0..4 {
        let mut volume = numbered(kind);
        for shape in shapes {
            let colour = |v: f32| [v / 300.0, 0.5, 1.0];
            let transfer = TransferFunction::from_curves(colour, shape, [0.0, 300.0], 1.0).unwrap();
            let (values, StrengthIn::Classified { volumes }) =
                (volume.values.as_ref().unwrap(), &volume.strength)
            else {
                panic!("volumes stay volumes");
            };
            let mut expected = Vec::new();
            for (v, block) in (0..).zip(&volume.blocks) {
                for local in 0..block.count {
                    let i = (block.first + local) as usize;
                    let [r, g, b, extinction] = transfer.classify(values.get(i));
                    if extinction > 0.0 {
                        expected.push(ClassifiedParticle {
                            view: v,
                            local,
                            mass: extinction * volumes[i],
                            carried: Carried::of_colour([r, g, b]),
                        });
                    }
                }
            }
            volume.transfer_function = Some(transfer);
            let mut views: Vec<BlockView> = (0..volume.blocks.len() as u32)
                .map(|block| BlockView {
                    block,
                    ..bytemuck::Zeroable::zeroed()
                })
                .collect();
            let total = count_classified(&volume, &mut views);
            let mut found = vec![bytemuck::Zeroable::zeroed(); total];
            classify(&volume, &views, &mut found);
            assert_eq!(found, expected);
            seen += found.len();
            all += volume.particle_count();
        }
    }
    println!("{seen} of {all} visible");
    assert!(seen > all / 8 && seen < all / 2);
}
