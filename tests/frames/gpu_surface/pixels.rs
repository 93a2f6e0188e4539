//! Tests the surface's pixels on both back ends, and thresholds between layers.

use super::{
    ROUNDING, kind, on_cpu, on_gpu, orthographic, perspective, plane, scattered, spec_of, sphere,
    surfels,
};
use crate::common::Random;
use crate::common::frame::Frame;
use crate::common::gpu::{gpu, is_software};
use ewa_splat::Settings;
use ewa_splat::stages::constants::{COVERAGE_FULL, TERMINATION_INTERVAL, TILE_SIZE};
use ewa_splat::stages::cpu::Bins;
use ewa_splat::stages::gpu::{Gpu, SurfacePixels, SurfaceSpec};
use ewa_splat::stages::record::{
    Carried, Footprint, PATH_NEAR_SURFEL, PATH_SURFEL, SurfelTerms, pack_range,
};
use ewa_splat::view::Projection;
use glam::{DVec2, DVec3, Vec3};

/// Returns true if any decision at a pixel about a layer, or about a surfel's cut-off, falls within
/// rounding. It recomputes the layers in f64.
fn is_on_threshold(frame: &Frame, bins: &Bins, x: usize, y: usize) -> bool {
    let wide = |v: [f32; 2]| DVec2::new(f64::from(v[0]), f64::from(v[1]));
    let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    let ray = ((at - wide(frame.uniform.centre_px)) / wide(frame.uniform.focal_px)).extend(1.0);
    let close = |a: f64, b: f64| (a - b).abs() <= 3e-5 * (a.abs() + b.abs());
    let mut layers: Vec<[f64; 2]> = Vec::new();
    let tile = y / TILE_SIZE * frame.tiles[0] + x / TILE_SIZE;
    for i in bins.tile(tile) {
        let f = &frame.footprints[i as usize];
        let inside =
            |(first, end): (u32, u32), x: usize| (first as usize..end as usize).contains(&x);
        if !inside(f.column_range(), x) || !inside(f.row_range(), y) {
            continue;
        }
        let (q, z, slack);
        if kind(f) == PATH_NEAR_SURFEL {
            let terms = &frame.near[(f.path >> 4) as usize];
            let [a, b, n] = [0, 1, 2].map(|k| Vec3::from(terms.misses[k]).as_dvec3().dot(ray));
            q = (a / n).powi(2) + (b / n).powi(2);
            z = n;
            slack = f64::from(terms.sigma) * n * n;
        } else {
            let terms = &frame.surfels[i as usize];
            let d = at - wide(f.centre_px);
            let inverse_depth = f64::from(terms.inverse_depth);
            z = inverse_depth + wide(terms.gradient).dot(d);
            let mut affine = wide(f.form_p).dot(d).powi(2) + wide(f.form_r).dot(d).powi(2);
            if terms.homography > 0.0 {
                affine /= (z / inverse_depth).powi(2);
            }
            q = affine;
            slack = f64::from(terms.slack);
        }
        let cutoff = f64::from(f.cutoff_squared);
        if close(q, cutoff) || (z.abs() < 1e-5 && kind(f) == PATH_NEAR_SURFEL) {
            return true;
        }
        if !(q <= cutoff && (z > 0.0 || frame.uniform.orthographic != 0)) {
            continue;
        }
        let w = f64::from(f.tau) * (-0.5 * q).exp();
        let mut covered = 0.0;
        let mut place = layers.len();
        for (k, [weight, sum]) in layers.iter_mut().enumerate() {
            let ahead = z * *weight - *sum;
            // Includes the sum's own rounding.
            let rounding = 1e-6 * sum.abs();
            if close(ahead.abs(), slack * *weight)
                || (ahead.abs() - slack * *weight).abs() <= rounding
                || close(covered + *weight, f64::from(COVERAGE_FULL))
            {
                return true;
            }
            if ahead.abs() <= slack * *weight {
                *weight += w;
                *sum += w * z;
                place = usize::MAX;
                break;
            }
            if ahead > 0.0 {
                place = k;
                break;
            }
            covered += *weight;
            if covered >= f64::from(COVERAGE_FULL) {
                place = usize::MAX;
                break;
            }
        }
        if place != usize::MAX {
            layers.insert(place, [w, w * z]);
            layers.truncate(3);
        }
    }
    // Half of the coverage.
    let coverage = |w: f64| {
        let full = f64::from(COVERAGE_FULL);
        if w <= 0.5 {
            w
        } else {
            (0.5 + (w - 0.5) * 0.5 / (full - 0.5)).min(1.0)
        }
    };
    let total: f64 = layers.iter().map(|l| coverage(l[0])).sum::<f64>().min(1.0);
    let mut covered = 0.0;
    layers.iter().any(|l| {
        covered += coverage(l[0]);
        close(covered, 0.5 * total)
    })
}

/// Counts pixels at which any number differs by more than the bound. Each must lie on a threshold.
fn flips(frame: &Frame, bins: &Bins, a: &SurfacePixels, b: &SurfacePixels, rounding: f32) -> usize {
    // A graphics card rounds quotients and roots otherwise.
    let least = if is_software() { 0.0 } else { 1e-6 };
    let rounding = rounding.max(least);
    let width = a.image.width;
    let mut flips = 0;
    for i in 0..a.image.pixels.len() {
        let near = |x: f32, y: f32, unit: f32| (x - y).abs() <= rounding * unit || x == y;
        let (p, q) = (a.image.pixels[i], b.image.pixels[i]);
        let mut alike = p.iter().zip(q).all(|(x, y)| near(*x, y, x.abs().max(1.0)));
        let (c, d) = (a.depth.depths[i], b.depth.depths[i]);
        alike &= near(c, d, c.abs().max(1.0));
        if let (Some(m), Some(n)) = (a.normals.get(i), b.normals.get(i)) {
            // Sums of normals of very different directions nearly cancel.
            alike &= m.iter().zip(n).all(|(x, y)| near(*x, *y, 10.0));
        }
        if !alike {
            flips += 1;
            let (x, y) = (i % width, i / width);
            assert!(
                is_on_threshold(frame, bins, x, y),
                "({x}, {y}): {p:?} {q:?}, depths {c} {d}, normals {:?} {:?}",
                a.normals.get(i),
                b.normals.get(i)
            );
        }
    }
    flips
}

/// Compares the device with the CPU, with the lists in one chunk and in three. Returns the CPU's
/// picture.
fn check(gpu: &Gpu, name: &str, frame: &Frame, spec: SurfaceSpec) -> SurfacePixels {
    let bins = frame.bins();
    let (_, expected) = on_cpu(frame, &bins, spec);
    for chunks in [1, 3] {
        let found = on_gpu(gpu, frame, &bins, spec, chunks);
        let flips = flips(frame, &bins, &expected, &found, ROUNDING);
        println!("{name}, {chunks} chunks: {flips} pixels differ at a threshold");
        assert!(
            flips <= expected.image.pixels.len() / 500,
            "{name}: {flips}"
        );
        assert_eq!(expected.splat_pixels, found.splat_pixels, "{name}");
        assert_eq!(expected.normals.len(), found.normals.len());
    }
    expected
}

#[test]
fn surfels_are_drawn_alike() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(44);
    for (name, camera) in [
        ("perspective", perspective([203, 117])),
        ("orthographic", orthographic([130, 95])),
    ] {
        let mut of_scene = sphere(DVec3::Z * 2.0, 0.6, 3_000, [0.9, 0.4, 0.2]);
        of_scene.extend(sphere(
            DVec3::new(0.4, 0.1, 3.0),
            0.6,
            2_000,
            [0.1, 0.5, 0.9],
        ));
        let edges = [DVec3::new(4.0, 0.0, 0.5), DVec3::new(0.0, 0.2, 4.0)];
        of_scene.extend(plane(DVec3::new(-2.0, 0.5, -0.5), edges, 48));
        for (what, list) in [
            ("scattered", scattered(&mut random, 2_500, 1.2)),
            ("scene", of_scene),
        ] {
            let frame = Frame::new(surfels(&list, false), &camera, &Settings::default());
            let is_perspective = camera.projection == Projection::Perspective;
            let has_near = is_perspective && what == "scattered";
            assert!(!has_near || frame.near.len() > 10);
            for normals in [false, true] {
                let spec = SurfaceSpec {
                    normals,
                    ..spec_of(&frame)
                };
                let drawn = check(gpu, &format!("{name} {what}"), &frame, spec);
                let covered = drawn.image.pixels.iter().filter(|p| p[3] == 1.0).count();
                assert!(covered > 500, "{covered}");
            }
            let counted = SurfaceSpec {
                count: true,
                ..spec_of(&frame)
            };
            let drawn = check(gpu, &format!("{name} {what} counts"), &frame, counted);
            let sum: f64 = drawn.image.pixels.iter().map(|p| f64::from(p[0])).sum();
            assert_eq!(sum as u64, drawn.splat_pixels);
        }
    }
}

/// Makes footprints that cover all 40 x 24 pixels evenly, given by inverse depth, weight and slack,
/// drawn in their order.
fn layered(is_orthographic: bool, list: &[(f32, f32, f32)]) -> Frame {
    let camera = if is_orthographic {
        orthographic([40, 24])
    } else {
        perspective([40, 24])
    };
    let scene = surfels(&scattered(&mut Random::new(1), 1, 0.1), false);
    let mut frame = Frame::new(scene, &camera, &Settings::default());
    frame.near.clear();
    frame.order = (0..list.len() as u64).collect();
    frame.footprints = list
        .iter()
        .enumerate()
        .map(|(i, &(inverse_depth, weight, slack))| Footprint {
            centre_px: [16.5, 12.5],
            form_p: [0.0; 2],
            form_r: [0.0; 2],
            tau: weight,
            cutoff_squared: 1.0,
            carried: Carried::of_colour([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]][i % 3]),
            depth: inverse_depth + slack,
            path: PATH_SURFEL,
            columns: pack_range(0, 40),
            rows: pack_range(0, 24),
            key: 0,
        })
        .collect();
    let terms = list.iter().map(|&(inverse_depth, _, slack)| SurfelTerms {
        inverse_depth,
        slack,
        ..SurfelTerms::default()
    });
    frame.surfels = terms.collect();
    frame
}

#[test]
fn layers_at_the_slack_itself_fall_alike() {
    let Some(gpu) = gpu() else { return };
    let slack = 0.25_f32;
    // Returns a pixel's result for a list: its three layers' colours, coverage and depth.
    let show = |list: &[(f32, f32, f32)]| {
        let frame = layered(false, list);
        let bins = frame.bins();
        let spec = SurfaceSpec {
            normals: true,
            ..spec_of(&frame)
        };
        let (_, expected) = on_cpu(&frame, &bins, spec);
        for chunks in [1, list.len()] {
            let found = on_gpu(gpu, &frame, &bins, spec, chunks);
            assert_eq!(flips(&frame, &bins, &expected, &found, 0.0), 0, "{list:?}");
            assert_eq!(expected.splat_pixels, found.splat_pixels);
        }
        (expected.image.pixel(3, 3), expected.depth.depths[0])
    };
    // exp(0) on both sides makes every number below exact. Depths lie within the slack, at it and
    // beyond it, from the front and from behind.
    for [within, at, beyond] in [
        [2.125, 2.25, 2.25_f32.next_up()],
        [1.875, 1.75, 1.75_f32.next_down()],
    ] {
        for (second, is_one) in [(within, true), (at, true), (beyond, false)] {
            let (pixel, depth) = show(&[(2.0, 0.5, slack), (second, 0.25, slack)]);
            let mean = (2.0 * 0.5 + second * 0.25) / 0.75;
            let is_mean = (1.0 / depth - mean).abs() < 1e-6;
            assert_eq!(is_mean, is_one, "{second}: {pixel:?} {depth}");
        }
    }
    // Full coverage hides everything behind; slightly less does not.
    for (weight, is_hidden) in [(COVERAGE_FULL, true), (COVERAGE_FULL.next_down(), false)] {
        let (pixel, _) = show(&[(2.0, weight, slack), (1.0, 0.5, slack)]);
        assert_eq!(pixel[1] == 0.0, is_hidden, "{pixel:?}");
    }
    // A fourth layer in front displaces the last one; one behind all is dropped.
    let layers = [(4.0, 0.1, slack), (3.0, 0.1, slack), (2.0, 0.1, slack)];
    for fourth in [5.0, 3.5, 2.5, 1.0, 4.0, 3.0, 2.0] {
        for turn in 0..3 {
            let mut list = layers;
            list.rotate_left(turn);
            let list = [list[0], list[1], list[2], (fourth, 0.2, slack)];
            show(&list);
        }
    }
    // Empty lists, zero weights, and the same depth repeatedly.
    show(&[(2.0, 0.0, slack), (1.0, 0.4, 0.0), (1.0, 0.4, 0.0)]);
    show(&[(2.0, 0.02, slack); 100]);
}

#[test]
fn what_covered_tiles_hide_is_not_evaluated() {
    let Some(gpu) = gpu() else { return };
    let n = TERMINATION_INTERVAL;
    for is_orthographic in [false, true] {
        let front = if is_orthographic { -1.0 } else { 1.0 };
        // Enough in front, then some behind, at it, and in front again.
        for behind in [-0.5, -0.25, -0.25_f32.next_down(), 0.25] {
            for count in [n - 1, n, n + 1, 2 * n, 2 * n + 5] {
                let mut list = vec![(front, 1.0, 0.125); 1];
                list.resize(count, (front, 0.0, 0.125));
                list.resize(count + 40, (front + behind, 0.25, 0.25));
                let frame = layered(is_orthographic, &list);
                let bins = frame.bins();
                let spec = spec_of(&frame);
                let (_, expected) = on_cpu(&frame, &bins, spec);
                for chunks in [1, 2, 7] {
                    let found = on_gpu(gpu, &frame, &bins, spec, chunks);
                    assert_eq!(flips(&frame, &bins, &expected, &found, 0.0), 0);
                    // A graphics card's depths are within a rounding of the slack itself.
                    let is_at_it = (behind + 0.25).abs() < 1e-3 && !is_software();
                    assert!(
                        is_at_it || expected.splat_pixels == found.splat_pixels,
                        "{count} {behind}"
                    );
                }
                let all = 40 * 24 * (count as u64 + 40);
                assert_eq!(
                    expected.splat_pixels < all,
                    behind < -0.25,
                    "{count} {behind}"
                );
            }
        }
    }
    // An open pixel hides nothing.
    let mut frame = layered(false, &[(1.0, 1.0, 0.125); 100]);
    for f in &mut frame.footprints[..50] {
        f.columns = pack_range(1, 40);
    }
    for (f, terms) in frame.footprints[50..]
        .iter_mut()
        .zip(&mut frame.surfels[50..])
    {
        terms.inverse_depth = 0.5;
        f.depth = 0.5;
    }
    check(gpu, "a pixel left open", &frame, spec_of(&frame));
}
