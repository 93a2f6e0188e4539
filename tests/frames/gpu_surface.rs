//! Compares opaque surfels on the GPU with the CPU's: their projection, their rasteriser, kernels
//! that surfaces cut, and whole pictures.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::depth_of;
use crate::common::frame::Frame;
use crate::common::gpu::{ALIKE, gpu, pictures};
use crate::common::scene::{Particle, camera, difference, volume};
use crate::common::{Random, some};
use ewa_splat::Filter;
use ewa_splat::constants::{COVERAGE_FULL, NEAR_MARGIN, TERMINATION_INTERVAL, TILE_SIZE};
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::math::unpack_normal;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength, TransferFunction};
use ewa_splat::stages::cpu::{self, Bins, NormalTile, RasteriseSettings, SimdLevel, Tile};
use ewa_splat::stages::gpu::{
    Gpu, Projected, RasterSpec, SurfacePixels, SurfaceSpec, project, rasterise, rasterise_surface,
};
use ewa_splat::stages::record::{
    Carried, ExactTerms, Footprint, NearTerms, PATH_NEAR_SURFEL, PATH_SURFEL, SurfelTerms,
    ViewUniform, pack_range,
};
use ewa_splat::stages::splat::{Axes, Interval};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Renderer, Settings, Show};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Surfel in world space.
#[derive(Debug, Clone, Copy)]
struct Surfel {
    position: DVec3,
    tangents: [DVec3; 2],
    area: f32,
    colour: [f32; 3],
}

fn surfels(surfels: &[Surfel], is_one_sided: bool) -> PointVolume {
    let tangents = |s: &Surfel| {
        let [a, b] = s.tangents.map(|t| t.as_vec3().to_array());
        [a[0], a[1], a[2], b[0], b[1], b[2]]
    };
    PointVolume {
        colour: Colour::PerParticle(surfels.iter().map(|s| s.colour).collect()),
        ..PointVolume::new(
            Particles::Surfels {
                positions: surfels.iter().map(|s| s.position).collect(),
                tangents: surfels.iter().map(tangents).collect(),
                is_one_sided,
            },
            Strength::Surface(surfels.iter().map(|s| s.area).collect()),
        )
    }
}

/// Returns surfels on a Fibonacci lattice over a sphere, facing outwards.
fn sphere(centre: DVec3, radius: f64, count: usize, colour: [f32; 3]) -> Vec<Surfel> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let area = 4.0 * std::f64::consts::PI * radius * radius / count as f64;
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let ring = (1.0 - z * z).sqrt();
            let (sin, cos) = (golden * i as f64).sin_cos();
            let normal = DVec3::new(ring * cos, ring * sin, z);
            let along = normal.any_orthonormal_vector();
            let sigma = 0.7 * area.sqrt();
            Surfel {
                position: centre + normal * radius,
                tangents: [along * sigma, normal.cross(along) * sigma],
                area: area as f32,
                colour: [0, 1, 2].map(|c| colour[c] * (0.75 + 0.25 * normal[c] as f32)),
            }
        })
        .collect()
}

/// Returns `count`² surfels of a checked parallelogram.
fn plane(corner: DVec3, edges: [DVec3; 2], count: usize) -> Vec<Surfel> {
    let step = edges.map(|e| e / count as f64);
    let at = |i: usize, j: usize| Surfel {
        position: corner + step[0] * (i as f64 + 0.5) + step[1] * (j as f64 + 0.5),
        tangents: step.map(|s| s * 0.7),
        area: step[0].cross(step[1]).length() as f32,
        colour: if (i / 4 + j / 4).is_multiple_of(2) {
            [0.8, 0.8, 0.7]
        } else {
            [0.2, 0.25, 0.3]
        },
    };
    (0..count * count)
        .map(|n| at(n % count, n / count))
        .collect()
}

/// Returns surfels of any size and shape, around and in front of the eye.
fn scattered(random: &mut Random, count: usize, spread: f64) -> Vec<Surfel> {
    (0..count)
        .map(|_| {
            let size = random.log_range(2e-3, 0.3);
            let turn = random.rotation();
            let second = size / random.log_range(1.0, 30.0);
            let lean = random.range(-0.8, 0.8);
            Surfel {
                position: random.point(spread) + DVec3::Z * (0.8 * spread),
                tangents: [
                    turn.x_axis * size,
                    (turn.y_axis + turn.x_axis * lean) * second,
                ],
                area: (size * second * random.log_range(0.1, 10.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect()
}

fn kind(f: &Footprint) -> u32 {
    if f.path & 15 == PATH_NEAR_SURFEL {
        PATH_NEAR_SURFEL
    } else {
        f.path
    }
}

/// Projects the frame's particles again on the device.
fn on_device(gpu: &Gpu, frame: &Frame, is_cut: bool) -> Projected {
    project(
        gpu,
        &frame.volume,
        &frame.views,
        &frame.classified,
        &frame.pieces,
        &frame.uniform,
        frame.camera.camera_from_world.as_mat3(),
        is_cut,
        frame.classified.len(),
    )
    .unwrap()
}

/// A rounding of f32, relative.
const EPS: f32 = f32::EPSILON / 2.0;

/// Differences between two projections of the same surfels.
#[derive(Debug, Default)]
struct Seen {
    visible: usize,
    /// Counts: affine, by homography, near.
    kinds: [usize; 3],
    bit_equal: usize,
    kind_flips: usize,
    range_flips: usize,
    normal_flips: usize,
    /// Greatest differences relative to their bounds.
    centre: f32,
    form: f32,
    tau: f32,
    terms: f32,
    near: f32,
}

/// Compares the device's footprints with the CPU's. The bounds are roundings of the factor's rows,
/// carried to the footprint's smaller axis: its axis ratio times some dozens of them.
fn compare(frame: &Frame, found: &Projected) -> Seen {
    let mut seen = Seen::default();
    assert_eq!(found.footprints.len(), frame.footprints.len());
    assert_eq!(found.near.len(), found.near_count as usize);
    for (i, (e, f)) in frame.footprints.iter().zip(&found.footprints).enumerate() {
        let context = || {
            let terms = (frame.surfels[i], found.surfels[i]);
            format!("{i}: {e:?}\n{f:?}\n{terms:?}")
        };
        assert_eq!((e.carried, e.key), (f.carried, f.key), "{}", context());
        if kind(e) != kind(f) {
            seen.kind_flips += 1;
            continue;
        }
        if (e.columns, e.rows) != (f.columns, f.rows) {
            // An edge within its roundings of a pixel centre.
            seen.range_flips += 1;
            if !e.is_visible() || !f.is_visible() {
                continue;
            }
            let close = |a: (u32, u32), b: (u32, u32)| a.0.abs_diff(b.0) + a.1.abs_diff(b.1) <= 1;
            assert!(close(e.column_range(), f.column_range()), "{}", context());
            assert!(close(e.row_range(), f.row_range()), "{}", context());
        }
        if !e.is_visible() {
            continue;
        }
        seen.visible += 1;
        let mut take = |worst: fn(&mut Seen) -> &mut f32, error: f32, bound: f32| {
            let worst = worst(&mut seen);
            // The comparison fails for NaN.
            assert!(error <= bound, "{error:e} of {bound:e}: {}", context());
            *worst = worst.max(error / bound);
        };
        if kind(e) == PATH_NEAR_SURFEL {
            let [a, b] = [
                frame.near[(e.path >> 4) as usize],
                found.near[(f.path >> 4) as usize],
            ];
            // Differences of vectors whose length is that of the vectors over the plane's distance,
            // which may be a ten-thousandth of it.
            let size = |t: &NearTerms, k: usize| Vec3::from(t.misses[k]).length();
            for k in 0..3 {
                let difference = Vec3::from(a.misses[k]) - Vec3::from(b.misses[k]);
                let unit = size(&a, k) + if k < 2 { size(&a, 2) * a.sigma } else { 0.0 };
                take(|s| &mut s.near, difference.length(), 4096.0 * EPS * unit);
            }
            take(
                |s| &mut s.near,
                (a.sigma - b.sigma).abs(),
                64.0 * EPS * a.sigma,
            );
            take(|s| &mut s.tau, (e.tau - f.tau).abs(), 256.0 * EPS * e.tau);
            seen.kinds[2] += 1;
            continue;
        }
        let (a, b) = (&frame.surfels[i], &found.surfels[i]);
        let mut same = *e;
        same.path = f.path;
        seen.bit_equal += usize::from(same == *f && a == b);
        let [p, r] = [e.form_p, e.form_r].map(Vec2::from);
        let ratio = (p.length_squared() + r.length_squared()) / (p.x * r.y - p.y * r.x).abs();
        let centre = Vec2::from(e.centre_px).distance(Vec2::from(f.centre_px));
        let rounding = 16.0 * EPS * (Vec2::from(e.centre_px).length() + 300.0);
        let far = 1.0 / a.inverse_depth.abs().min(1.0);
        let mut take = |worst: fn(&mut Seen) -> &mut f32, error: f32, bound: f32| {
            let worst = worst(&mut seen);
            assert!(error <= bound, "{error:e} of {bound:e}: {}", context());
            *worst = worst.max(error / bound);
        };
        take(|s| &mut s.centre, centre, rounding * far.max(1.0));
        let forms = p.distance(f.form_p.into()) + r.distance(f.form_r.into());
        let axis = 64.0 * EPS * ratio;
        take(|s| &mut s.form, forms, axis * (p.length() + r.length()));
        take(
            |s| &mut s.tau,
            (e.tau - f.tau).abs(),
            (axis + 64.0 * EPS / 0.02) * e.tau,
        );
        // The slack holds three low-pass filters' change of the inverse depth. At a plane seen at a
        // cosine of GRAZING, a rounding of its normal is amplified fifty times.
        let gradient = Vec2::from(a.gradient).distance(b.gradient.into());
        let steep = axis + 64.0 * EPS / 0.02;
        take(|s| &mut s.terms, gradient, steep * a.slack);
        take(|s| &mut s.terms, (a.slack - b.slack).abs(), steep * a.slack);
        let inverse_depth = (a.inverse_depth - b.inverse_depth).abs();
        take(
            |s| &mut s.terms,
            inverse_depth,
            16.0 * EPS * a.inverse_depth.abs().max(1.0),
        );
        // The inverse depth at the box's edge: the gradient's error times the kernel's reach,
        // pixels.
        let reach = ratio.sqrt() / (p.x * r.y - p.y * r.x).abs().sqrt() * e.cutoff_squared.sqrt();
        let depth = (e.depth - f.depth).abs();
        let unit = e.depth.abs() + a.slack * (1.0 + reach);
        take(|s| &mut s.terms, depth, 4.0 * steep * unit);
        assert_eq!(a.homography, b.homography, "{}", context());
        // A step of the octahedron if a coordinate lies within rounding of its edge.
        let normals = unpack_normal(a.normal).distance(unpack_normal(b.normal));
        assert!(normals < 3e-3, "{}", context());
        seen.normal_flips += usize::from(a.normal != b.normal);
        seen.kinds[usize::from(a.homography > 0.0)] += 1;
    }
    seen
}

fn perspective(size: [usize; 2]) -> Camera {
    Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, size)
}

fn orthographic(size: [usize; 2]) -> Camera {
    Camera::orthographic(DVec3::Z * 0.5, DVec3::Z * 2.0, -DVec3::Y, 3.0, size)
}

#[test]
fn surfels_are_projected_alike() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(41);
    for (name, camera) in [
        ("perspective", perspective([203, 117])),
        ("orthographic", orthographic([130, 95])),
    ] {
        for is_one_sided in [false, true] {
            for low_pass_variance_px2 in [1.0, 0.25] {
                let settings = Settings {
                    low_pass_variance_px2,
                    ..Settings::default()
                };
                let scene = surfels(&scattered(&mut random, 6_000, 1.5), is_one_sided);
                let frame = Frame::new(scene, &camera, &settings);
                let seen = compare(&frame, &on_device(gpu, &frame, false));
                println!("{name}, one-sided {is_one_sided}: {seen:?}");
                assert!(seen.visible > 1_000);
                // A needle's edge, or a threshold within rounding: one in a thousand.
                let few = 2 + frame.footprints.len() / 1000;
                let most = seen.kind_flips.max(seen.range_flips).max(seen.normal_flips);
                assert!(most <= few, "{seen:?}");
                let is_perspective = camera.projection == Projection::Perspective;
                assert_eq!(seen.kinds[1] > 0 && seen.kinds[2] > 0, is_perspective);
                assert!(seen.kinds[0] > 0);
            }
        }
    }
}

#[test]
fn panes_are_projected_alike() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(42);
    for camera in [perspective([203, 117]), orthographic([130, 95])] {
        for is_one_sided in [false, true] {
            let mut scene = surfels(&scattered(&mut random, 3_000, 1.5), is_one_sided);
            if let Strength::Surface(areas) = scene.strength {
                scene.strength = Strength::Translucent(areas);
            }
            let settings = Settings {
                filter: Filter::Ewa,
                ..Settings::default()
            };
            let frame = Frame::new(scene, &camera, &settings);
            let found = on_device(gpu, &frame, false);
            let mut visible = 0;
            for (e, f) in frame.footprints.iter().zip(&found.footprints) {
                if e.path & 3 != 0 || f.path & 3 != 0 {
                    continue;
                }
                visible += usize::from(e.is_visible());
                if e.is_visible() && f.is_visible() {
                    // The cosine of a plane seen edge on: a rounding of it over some hundredths.
                    let bound = 1e-4 * e.tau + 1e-12;
                    assert!((e.tau - f.tau).abs() <= bound, "{e:?}\n{f:?}");
                }
            }
            let seen = |f: &[Footprint]| f.iter().filter(|f| f.is_visible()).count();
            let (a, b) = (seen(&frame.footprints), seen(&found.footprints));
            println!("{a} and {b} visible");
            assert!(visible > 300 && a.abs_diff(b) <= 2 + a / 1000);
        }
    }
}

/// Makes a frame of one surfel whose numbers are all short binary fractions: a cut-off of two
/// standard deviations, a low-pass filter of a pixel. Its block's origin is the surfel itself.
fn exact_frame(is_orthographic: bool, is_one_sided: bool, surfel: Surfel) -> Frame {
    let (kind, focal) = if is_orthographic {
        (Projection::Orthographic, 1.0)
    } else {
        (Projection::Perspective, 32.0)
    };
    let camera = camera(kind, [focal; 2], [32, 32]);
    let settings = Settings {
        cutoff: Some(2.0),
        ..Settings::default()
    };
    Frame::uncut(surfels(&[surfel], is_one_sided), &camera, &settings)
}

#[test]
fn thresholds_of_the_projection_fall_alike() {
    let Some(gpu) = gpu() else { return };
    let flat = |position: DVec3, tangents: [DVec3; 2]| Surfel {
        position,
        tangents,
        area: 4.0,
        colour: [1.0; 3],
    };
    let mut list = Vec::new();
    // Seen edge on, from the front and from behind.
    for lean in [0.0, 0.5, -0.5] {
        for x in [0.0, 4.0, -4.0] {
            let tangents = [DVec3::new(0.0, 1.5, 0.0), DVec3::new(lean, 0.0, 1.5)];
            list.push(flat(DVec3::new(x, 0.5, 64.0), tangents));
        }
    }
    // Edges of the box on pixel centres.
    for x in -16..=16 {
        let tangents = [DVec3::X * 1.5, -DVec3::Y * 1.5];
        list.push(flat(DVec3::new(f64::from(x) * 0.5, 0.25, 64.0), tangents));
    }
    // At and beside the depths at which it is near, and at which it is behind.
    let reach = 2.0_f32 * 1.5;
    for z in [NEAR_MARGIN * reach, -reach, 0.0, reach] {
        for z in [z, z.next_up(), z.next_down()] {
            let tangents = [DVec3::Z * 1.5, DVec3::new(0.0, 1.5, 0.0)];
            list.push(flat(DVec3::new(1.0, 0.5, f64::from(z)), tangents));
        }
    }
    // As flat as a surfel may be, and flatter.
    for second in [2e-6, 1.1e-6, 1e-6, 0.9e-6, 0.0] {
        let tangents = [DVec3::X, DVec3::new(1.0, -second, 0.0)];
        list.push(flat(DVec3::new(0.0, 0.5, 64.0), tangents));
    }
    for is_orthographic in [false, true] {
        for is_one_sided in [false, true] {
            let mut counts = [0; 3];
            for (i, surfel) in list.iter().enumerate() {
                let own = exact_frame(is_orthographic, is_one_sided, *surfel);
                let found = on_device(gpu, &own, false);
                assert_eq!(own.footprints.len(), found.footprints.len());
                for (e, f) in own.footprints.iter().zip(&found.footprints) {
                    assert_eq!(
                        (kind(e), e.is_visible(), e.columns, e.rows),
                        (kind(f), f.is_visible(), f.columns, f.rows),
                        "{i} {surfel:?}, orthographic {is_orthographic}\n{e:?}\n{f:?}"
                    );
                    let which = match kind(e) {
                        PATH_SURFEL => 0,
                        PATH_NEAR_SURFEL => 1,
                        _ => 2,
                    };
                    counts[which] += 1;
                }
            }
            println!("orthographic {is_orthographic}, one-sided {is_one_sided}: {counts:?}");
            assert!(
                counts[0] > 9 && (counts[1] > 3) != is_orthographic,
                "{counts:?}"
            );
        }
    }
}

#[test]
fn poison_stays_where_it_is() {
    let Some(gpu) = gpu() else { return };
    const POISON: [f32; 14] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        1e-45,
        -1e-40,
        0.0,
        -0.0,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e30,
        1e-30,
        -1e20,
        1e-20,
    ];
    let mut random = Random::new(43);
    for camera in [perspective([70, 50]), orthographic([70, 50])] {
        let scene = surfels(&scattered(&mut random, 3_000, 1.5), false);
        let mut frame = Frame::new(scene, &camera, &Settings::default());
        let is_poisoned = |i: usize| i.is_multiple_of(3);
        if let ewa_splat::stages::blocks::BlockedParticles::Surfels {
            offsets, tangents, ..
        } = &mut frame.volume.particles
        {
            let (offsets, tangents) = (offsets.to_mut(), tangents.to_mut());
            for i in (0..tangents.len()).step_by(3) {
                let poison = POISON[random.index(POISON.len())];
                match random.index(9) {
                    place @ 0..3 => offsets[i][place] = poison,
                    place => tangents[i][place - 3] = poison,
                }
            }
        }
        frame.project();
        let found = on_device(gpu, &frame, false);
        let (mut count, mut otherwise) = (0, 0);
        for (i, (e, f)) in frame.footprints.iter().zip(&found.footprints).enumerate() {
            let particle = frame.classified[i];
            let block = frame.views[particle.view as usize].block as usize;
            let index = (frame.volume.blocks[block].first + particle.local) as usize;
            if !is_poisoned(index) {
                continue;
            }
            count += 1;
            if f.is_visible() {
                let (c, r) = (f.column_range(), f.row_range());
                let [width, height] = frame.uniform.size;
                assert!(c.0 < c.1 && c.1 <= width && r.0 < r.1 && r.1 <= height);
                assert!(f.tau > 0.0 && f.tau.is_finite(), "{f:?}");
                let is_near = kind(f) == PATH_NEAR_SURFEL && f.path >> 4 < found.near_count;
                assert!(is_near || kind(f) == PATH_SURFEL, "{f:?}");
            }
            if e.is_visible() != f.is_visible() {
                otherwise += 1;
                println!("visible otherwise: {e:?}\n{f:?}");
            }
        }
        println!("{otherwise} of {count} otherwise");
        // For numbers beyond f32's range, a device may round to zero or infinity earlier.
        assert!(count > 300 && otherwise * 100 <= count);
        // The result is a picture of finite numbers in any case.
        frame.footprints = found.footprints;
        frame.surfels = found.surfels;
        frame.near = found.near;
        cpu::sort(&frame.footprints, &mut frame.order);
        let spec = spec_of(&frame);
        let drawn = on_gpu(gpu, &frame, &frame.bins(), spec, 1);
        assert!(drawn.image.pixels.iter().flatten().all(|c| c.is_finite()));
    }
}

fn spec_of(frame: &Frame) -> SurfaceSpec {
    SurfaceSpec {
        clip: false,
        near: !frame.near.is_empty(),
        normals: false,
        count: false,
        is_picture: false,
    }
}

fn lists(frame: &Frame, bins: &Bins) -> Vec<Vec<u32>> {
    (0..frame.tiles[0] * frame.tiles[1])
        .map(|t| bins.tile(t).collect())
        .collect()
}

fn on_gpu(
    gpu: &Gpu,
    frame: &Frame,
    bins: &Bins,
    spec: SurfaceSpec,
    chunks: usize,
) -> SurfacePixels {
    let lists = lists(frame, bins);
    rasterise_surface(
        gpu,
        &frame.uniform,
        spec,
        &frame.footprints,
        &frame.surfels,
        &frame.near,
        &lists,
        chunks,
    )
    .unwrap()
}

/// Returns the tiles of a frame's surfels on the CPU, without fused operations, and their picture.
fn on_cpu(frame: &Frame, bins: &Bins, spec: SurfaceSpec) -> (Vec<Tile>, SurfacePixels) {
    let count = frame.tiles[0] * frame.tiles[1];
    let mut tiles = vec![Tile::default(); count];
    let mut normal_tiles = vec![NormalTile::new(); if spec.normals { count } else { 0 }];
    let splat_pixels = cpu::rasterise_surface(
        &frame.uniform,
        RasteriseSettings {
            axes: Axes {
                count: spec.count,
                ..Axes::default()
            },
            level: SimdLevel::Baseline,
            task: None,
        },
        &frame.footprints,
        &frame.surfels,
        &frame.near,
        bins,
        frame.tiles[0],
        &mut tiles,
        &mut normal_tiles,
    );
    let (width, height) = (frame.camera.width, frame.camera.height);
    let place = |i: usize| {
        let (x, y) = (i % width, i / width);
        (
            y / TILE_SIZE * frame.tiles[0] + x / TILE_SIZE,
            y % TILE_SIZE * TILE_SIZE + x % TILE_SIZE,
        )
    };
    let mut image = Image::new(width, height);
    cpu::resolve(&tiles, None, false, &mut image);
    let each = |i: usize| place(i);
    let depths = (0..width * height).map(each);
    let depths = depths.map(|(t, at)| tiles[t].depth[at]).collect();
    let normals = (0..width * height).map(each).filter(|_| spec.normals);
    let normals = normals.map(|(t, at)| normal_tiles[t][at]).collect();
    let drawn = SurfacePixels {
        image,
        depth: DepthImage {
            width,
            height,
            depths,
        },
        normals,
        splat_pixels,
    };
    (tiles, drawn)
}

/// Largest difference from roundings: sums of some hundred weights near 1, each rounded by 2^-24,
/// and quotients of them.
const ROUNDING: f32 = 1e-5;

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
                    assert_eq!(
                        expected.splat_pixels, found.splat_pixels,
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

/// Draws a scene on both back ends and compares pictures, depths, normals and counts.
fn assert_scene_alike(name: &str, scene: &[PointVolume], camera: &Camera, settings: &Settings) {
    let Some(gpu) = crate::common::gpu::pictures() else {
        return;
    };
    let settings = Settings {
        // The CPU uses no fused operations, as the device uses none.
        simd: SimdLevel::Baseline,
        depth: true,
        normals: true,
        ..settings.clone()
    };
    let mut on_cpu = Renderer::new(scene.to_vec()).unwrap();
    on_cpu.render(camera, &settings).unwrap();
    let on_gpu = Renderer::new(scene.to_vec()).unwrap();
    let mut on_gpu = on_gpu.on(gpu.clone()).unwrap();
    on_gpu.render(camera, &settings).unwrap();
    let (c, d) = (on_cpu.counts(), on_gpu.counts());
    println!("{name}: {c:?}\n{d:?}");
    let near = |a: usize, b: usize| a.abs_diff(b) <= 2 + a / 1000;
    assert_eq!(
        (
            c.blocks,
            c.blocks_culled,
            c.blocks_merged,
            c.block_filters,
            c.classified
        ),
        (
            d.blocks,
            d.blocks_culled,
            d.blocks_merged,
            d.block_filters,
            d.classified
        )
    );
    assert!(near(c.footprints, d.footprints) && near(c.surfels, d.surfels));
    assert!(near(c.footprints_exact, d.footprints_exact));
    assert!(near(c.footprints_near, d.footprints_near));
    assert!(near(c.tile_entries, d.tile_entries));
    assert!(near(c.splat_pixels as usize, d.splat_pixels as usize));
    let (a, b) = (on_cpu.image(), on_gpu.image());
    let far = |x: f32, y: f32, bound: f32| !((x - y).abs() <= bound) && x != y;
    // A layer's decision within rounding changes a pixel completely.
    let allowed = a.pixels.len() / 500;
    let pixels = a.pixels.iter().zip(&b.pixels);
    let pixels = pixels.filter(|(p, q)| p.iter().zip(*q).any(|(x, y)| far(*x, *y, ALIKE)));
    let pixels = pixels.count();
    let depths = on_cpu.depth().unwrap().depths.iter();
    let depths = depths.zip(&on_gpu.depth().unwrap().depths);
    let depths = depths
        .filter(|(x, y)| far(**x, **y, 1e-5 * x.abs()))
        .count();
    let (m, n) = (on_cpu.normals().unwrap(), on_gpu.normals().unwrap());
    let normals = m.normals.iter().zip(&n.normals);
    let normals = normals.filter(|(p, q)| p.iter().zip(*q).any(|(x, y)| far(*x, *y, 1e-4)));
    let normals = normals.count();
    println!("{name}: {pixels} pixels, {depths} depths, {normals} normals differ");
    assert!(
        pixels <= allowed && depths <= allowed && normals <= allowed,
        "{name}"
    );
}

/// Returns a sphere on a checked plane, and another behind it.
fn spheres_on_a_plane() -> PointVolume {
    let mut list = sphere(DVec3::new(0.0, 0.0, 0.5), 0.5, 4_000, [0.9, 0.4, 0.2]);
    list.extend(sphere(
        DVec3::new(-0.3, 0.9, 0.5),
        0.5,
        4_000,
        [0.1, 0.5, 0.9],
    ));
    let edges = [DVec3::X * 4.0, DVec3::Y * 4.0];
    list.extend(plane(DVec3::new(-2.0, -2.0, 0.0), edges, 80));
    surfels(&list, false)
}

/// Returns cameras on that scene: perspective, orthographic, and so near that surfels cross the
/// camera plane.
fn cameras(size: [usize; 2]) -> [(&'static str, Camera); 3] {
    let target = DVec3::new(0.0, 0.2, 0.4);
    let eye = DVec3::new(0.6, -2.6, 1.4);
    let low = DVec3::new(0.3, -1.2, 0.02);
    [
        (
            "perspective",
            Camera::perspective(eye, target, DVec3::Z, 45.0, size),
        ),
        (
            "orthographic",
            Camera::orthographic(eye, target, DVec3::Z, 2.5, size),
        ),
        (
            "near",
            Camera::perspective(low, target, DVec3::Z, 70.0, size),
        ),
    ]
}

#[test]
fn surfaces_look_alike() {
    if gpu().is_none() {
        return;
    }
    let scene = [spheres_on_a_plane()];
    for (name, camera) in cameras([150, 110]) {
        for show in [Show::Scene, Show::Count, Show::Choice] {
            let settings = Settings {
                show,
                background: (show == Show::Scene && name == "near").then_some([0.1, 0.2, 0.3]),
                ..Settings::default()
            };
            assert_scene_alike(&format!("{name}, {show:?}"), &scene, &camera, &settings);
        }
    }
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer
        .render(&cameras([150, 110])[2].1, &Settings::default())
        .unwrap();
    assert!(renderer.counts().footprints_near > 0);
}

/// Surfels with individual values are coloured by a transfer function.
#[test]
fn surfaces_with_fields_look_alike() {
    if pictures().is_none() {
        return;
    }
    let mut surface = spheres_on_a_plane();
    let mut random = Random::new(46);
    let count = surface.particles.len();
    let values: Vec<f32> = (0..count).map(|_| random.range(-0.2, 1.2) as f32).collect();
    surface.values = Some(values.into());
    surface.colour = Colour::Classified;
    let colours = |t: f32| [t, 1.0 - t, 0.5];
    let function = TransferFunction::from_curves(colours, |t| t, [0.0, 1.0], 1.0);
    surface.transfer_function = Some(function.unwrap());
    for (name, camera) in cameras([150, 110]) {
        let scene = [surface.clone()];
        assert_scene_alike(name, &scene, &camera, &Settings::default());
    }
}

/// Returns ellipsoids about the scene, some cut by it, some behind it, some around a near eye.
fn gas(count: usize) -> PointVolume {
    let mut random = Random::new(45);
    let particles: Vec<Particle> = (0..count)
        .map(|_| {
            let size = random.log_range(0.01, 0.25);
            Particle {
                position: random.point(1.5) + DVec3::Z * 0.5,
                factor: random.factor(size, 5.0),
                mass: (size * size * random.log_range(0.02, 2.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect();
    volume(&particles)
}

#[test]
fn surfaces_in_gas_look_alike() {
    if pictures().is_none() {
        return;
    }
    let scene = [gas(800), spheres_on_a_plane()];
    for (name, camera) in cameras([150, 110]) {
        for (filter, linear_opacity, show) in [
            (Filter::Adaptive, false, Show::Scene),
            (Filter::Exact, false, Show::Scene),
            (Filter::Ewa, true, Show::Scene),
            (Filter::Adaptive, false, Show::Count),
        ] {
            let settings = Settings {
                filter,
                linear_opacity,
                show,
                background: linear_opacity.then_some([0.1, 0.2, 0.3]),
                ..Settings::default()
            };
            let name = format!("{name}, {filter:?}, {show:?}");
            assert_scene_alike(&name, &scene, &camera, &settings);
        }
    }
}

/// Returns splats with stated opacities, on the same particles.
fn splats(count: usize) -> PointVolume {
    let mut volume = gas(count);
    volume.strength = Strength::PeakOpacity {
        opacities: vec![0.6; count],
        is_anti_aliased: false,
    };
    volume
}

#[test]
fn surfaces_among_splats_and_panes_look_alike() {
    if pictures().is_none() {
        return;
    }
    let edges = [DVec3::X * 2.0, DVec3::new(0.0, 0.3, 1.5)];
    let mut pane = surfels(&plane(DVec3::new(-1.0, -0.8, 0.1), edges, 30), false);
    if let Strength::Surface(areas) = pane.strength {
        pane.strength = Strength::Translucent(areas.iter().map(|a| 0.7 * a).collect());
    }
    let scene = [spheres_on_a_plane(), splats(400), pane, gas(100)];
    for (name, camera) in cameras([120, 90]) {
        assert_scene_alike(name, &scene, &camera, &Settings::default());
    }
}

#[test]
fn pictures_do_not_depend_on_how_the_frame_is_cut() {
    let Some(gpu) = pictures() else { return };
    let settings = Settings {
        depth: true,
        normals: true,
        background: Some([0.1, 0.2, 0.3]),
        ..Settings::default()
    };
    let scenes = [
        vec![spheres_on_a_plane()],
        vec![spheres_on_a_plane(), gas(12_000)],
    ];
    for (number, scene) in scenes.into_iter().enumerate() {
        for (name, camera) in some(cameras([203, 117]), number, 2) {
            let draw = |gpu| {
                let mut renderer = Renderer::new(scene.clone()).unwrap().on(gpu).unwrap();
                renderer.render(&camera, &settings).unwrap();
                let depth = renderer.depth().unwrap().clone();
                let normals = renderer.normals().unwrap().clone();
                (renderer.image().clone(), depth, normals, renderer.counts())
            };
            let whole = draw(gpu.clone());
            // The limit is so small that there are several parts, chunks and bands.
            let cut = draw(gpu.clone().with_binding_limit(361_000));
            assert_eq!(difference(&whole.0, &cut.0), 0.0, "{name}");
            assert_eq!(whole.1, cut.1, "{name}");
            assert_eq!(whole.2, cut.2, "{name}");
            assert_eq!(whole.3, cut.3, "{name}");
        }
    }
}

#[test]
fn frames_follow_one_another() {
    let Some(gpu) = pictures() else { return };
    // The requested outputs change between frames; no frame affects the next.
    let scene = vec![gas(300), spheres_on_a_plane()];
    let mut renderer = Renderer::new(scene.clone()).unwrap();
    renderer = renderer.on(gpu.clone()).unwrap();
    for normals in [true, false, true] {
        for (name, camera) in cameras([80, 60]) {
            let settings = Settings {
                normals,
                depth: !normals,
                ..Settings::default()
            };
            renderer.render(&camera, &settings).unwrap();
            let mut fresh = Renderer::new(scene.clone()).unwrap();
            fresh = fresh.on(gpu.clone()).unwrap();
            fresh.render(&camera, &settings).unwrap();
            let allowed = if gpu.is_software() { 0.0 } else { ALIKE };
            assert!(
                difference(renderer.image(), fresh.image()) <= allowed,
                "{name}"
            );
            assert_eq!(renderer.depth(), fresh.depth());
            assert_eq!(renderer.normals(), fresh.normals());
            assert_eq!(renderer.normals().is_some(), normals);
            assert_eq!(renderer.counts(), fresh.counts());
        }
    }
}

/// Compares the terms by which surfaces cut kernels, and the cut kernels, on the CPU's input.
#[test]
fn kernels_are_cut_alike() {
    let Some(gpu) = gpu() else { return };
    for (name, camera) in cameras([130, 90]) {
        for filter in [Filter::Adaptive, Filter::Exact, Filter::Ewa] {
            let settings = Settings {
                filter,
                ..Settings::default()
            };
            let surface = Frame::new(spheres_on_a_plane(), &camera, &settings);
            let of_surface = SurfaceSpec {
                normals: false,
                ..spec_of(&surface)
            };
            let (tiles, surface) = on_cpu(&surface, &surface.bins(), of_surface);
            let mut frame = Frame::new(gas(600), &camera, &settings);
            project_cut(&mut frame);
            compare_depth_terms(&frame, &on_device(gpu, &frame, true));
            let bins = frame.bins();
            for (depth, linear_opacity) in [(true, false), (false, true)] {
                let spec = RasterSpec {
                    axes: Axes {
                        may_be_exact: frame.any_exact,
                        interval: Interval::Surface,
                        depth,
                        linear_opacity,
                        ..Axes::default()
                    },
                    near: !frame.near.is_empty(),
                    ..RasterSpec::default()
                };
                let (image, depths, splat_pixels) = cut_on_cpu(&frame, &bins, &tiles, spec);
                for chunks in [1, 3] {
                    let found = rasterise(
                        gpu,
                        &frame.uniform,
                        spec,
                        &frame.footprints,
                        &frame.exact,
                        &frame.near,
                        &lists(&frame, &bins),
                        chunks,
                        Some((&surface.image, &surface.depth)),
                        None,
                    )
                    .unwrap();
                    let pixels = image.pixels.iter().zip(&found.0.pixels);
                    // Some hundred layers; a cut-off within rounding differs by the tolerance.
                    let differ = |(p, q): &(&[f32; 4], &[f32; 4])| {
                        p.iter().zip(*q).any(|(x, y)| !((x - y).abs() <= 5e-6))
                    };
                    let differ = pixels.filter(differ).count();
                    println!(
                        "{name} {filter:?} {chunks} chunks: {differ} pixels, largest difference {:e}, {splat_pixels} and {} splat-pixels",
                        difference(&image, &found.0),
                        found.2
                    );
                    assert!(differ <= image.pixels.len() / 1000);
                    // A kernel behind the eye counts until its depth underflows, which happens
                    // sooner on the device.
                    let tails = if frame.near.is_empty() {
                        300
                    } else {
                        splat_pixels / 100
                    };
                    assert!(splat_pixels.abs_diff(found.2) <= tails, "{name}");
                    let Some(found) = &found.1 else { continue };
                    let depths = depths.depths.iter().zip(&found.depths);
                    let far =
                        |(x, y): &(&f32, &f32)| !((*x - *y).abs() <= 1e-5 * x.abs()) && x != y;
                    let differ = depths.filter(far).count();
                    assert!(
                        differ <= image.pixels.len() / 500,
                        "{name}: {differ} depths"
                    );
                }
            }
        }
    }
}

/// Projects the frame again, with kernels to be cut.
fn project_cut(frame: &mut Frame) {
    frame.exact = vec![ExactTerms::default(); frame.footprints.len()];
    frame.project_as(true);
}

fn compare_depth_terms(frame: &Frame, found: &Projected) {
    let mut count = 0;
    for (i, (e, f)) in frame.footprints.iter().zip(&found.footprints).enumerate() {
        if !e.is_visible() || !f.is_visible() || e.path != f.path || e.path & 2 != 0 {
            continue;
        }
        count += 1;
        let (a, b) = (frame.exact[i], found.exact[i]);
        // Axis ratios are up to 5, as those of the footprints: some dozens of roundings.
        let bound = 1e-5 * a.depth_sigma;
        let sigma = (a.depth_sigma - b.depth_sigma).abs();
        assert!(a.depth_sigma > 0.0 && sigma <= bound, "{a:?} {b:?}");
        let slope = Vec2::from(a.gradient).distance(b.gradient.into());
        let unit = Vec2::from(a.gradient).length().max(a.depth_sigma);
        assert!(slope <= 2e-5 * unit, "{a:?} {b:?}");
    }
    assert!(count > 100, "{count}");
}

fn cut_on_cpu(
    frame: &Frame,
    bins: &Bins,
    surface: &[Tile],
    spec: RasterSpec,
) -> (Image, DepthImage, u64) {
    let (tiles, splat_pixels) = frame.rasterised(bins, spec.axes, surface);
    let ViewUniform {
        size: [width, height],
        ..
    } = frame.uniform;
    let mut image = Image::new(width as usize, height as usize);
    cpu::resolve(&tiles, None, false, &mut image);
    let depth = depth_of(&tiles, [width as usize, height as usize]);
    (image, depth, splat_pixels)
}
