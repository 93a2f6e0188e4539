//! Tests the projection of surfels on both back ends, and its thresholds.

use super::{
    EPS, Surfel, kind, on_device, on_gpu, orthographic, perspective, scattered, spec_of, surfels,
};
use crate::common::Random;
use crate::common::frame::Frame;
use crate::common::gpu::{gpu, is_software};
use crate::common::scene::camera;
use ewa_splat::math::unpack_normal;
use ewa_splat::scene::Strength;
use ewa_splat::stages::constants::NEAR_MARGIN;
use ewa_splat::stages::cpu;
use ewa_splat::stages::gpu::Projected;
use ewa_splat::stages::record::{Footprint, NearTerms, PATH_NEAR_SURFEL, PATH_SURFEL};
use ewa_splat::view::Projection;
use ewa_splat::{Filter, Settings};
use glam::{DVec3, Vec2, Vec3};

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
        assert_eq!(e.carried, f.carried, "{}", context());
        // Keys have 31 bits; a graphics card's depth may differ by a rounding of 24.
        let rounding = if is_software() { 0 } else { 1 << 9 };
        assert!(e.key.abs_diff(f.key) <= rounding, "{}", context());
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
                    // A graphics card's logarithm has an absolute error of 2^-21.
                    let share = if is_software() { 1e-4 } else { 1e-3 };
                    let bound = share * e.tau + 1e-12;
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
        let share = if is_software() { 100 } else { 20 };
        assert!(count > 300 && otherwise * share <= count);
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
