//! Tests laws of surfels: Heckbert's EWA filter on a textured plane, the continuum from volume
//! kernels, coverage, depth, normals, occlusion, and volumes that surfaces cut.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::collections::HashSet;
use std::f64::consts::{PI, TAU};

use crate::common::frame::Frame;
use crate::common::{Random, fixture, number, numbers};
use ewa_splat::math::{flatten, lower_factor, normal_cdf, tangents_of};
use ewa_splat::reference::{Integrator, ReferenceFrame, ReferenceSettings};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::stages::constants::TILE_SIZE;
use ewa_splat::stages::cpu::{self, Bins};
use ewa_splat::stages::record::{FootprintTerms, PATH_SURFEL};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Backend, Image, Renderer, Settings};
use glam::{DMat3, DVec2, DVec3};
use serde_json::Value;

/// Returns the case of that name.
fn case(name: &str) -> Value {
    let all = fixture("analytic_cases.json");
    let found = all.as_array().unwrap().iter().find(|c| c["name"] == name);
    found.unwrap().clone()
}

/// Round surfel.
#[derive(Debug, Clone, Copy)]
struct Disc {
    position: DVec3,
    normal: DVec3,
    sigma: f64,
    area: f64,
    colour: [f32; 3],
}

fn narrow(tangents: [DVec3; 2]) -> [f32; 6] {
    let [a, b] = tangents.map(|t| t.as_vec3());
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

fn discs(discs: &[Disc], is_one_sided: bool) -> PointVolume {
    let tangents = discs.iter().map(|d| {
        let t = d.normal.any_orthonormal_vector();
        narrow([t * d.sigma, d.normal.cross(t) * d.sigma])
    });
    PointVolume {
        colour: Colour::PerParticle(discs.iter().map(|d| d.colour).collect()),
        ..PointVolume::new(
            Particles::Surfels {
                positions: discs.iter().map(|d| d.position).collect(),
                tangents: tangents.collect(),
                is_one_sided,
            },
            Strength::Surface(discs.iter().map(|d| d.area as f32).collect()),
        )
    }
}

/// Returns a square of (2 half + 1)² surfels of width .6 around `centre`.
fn plane(
    centre: DVec3,
    [u, v]: [DVec3; 2],
    spacing: f64,
    half: i32,
    colour: impl Fn(DVec2) -> [f32; 3],
) -> Vec<Disc> {
    let normal = u.cross(v);
    let cells = (-half..=half).flat_map(|i| (-half..=half).map(move |j| (i, j)));
    cells
        .map(|(i, j)| {
            let at = DVec2::new(f64::from(i), f64::from(j)) * spacing;
            Disc {
                position: centre + u * at.x + v * at.y,
                normal,
                sigma: 0.6 * spacing,
                area: spacing * spacing,
                colour: colour(at),
            }
        })
        .collect()
}

/// Returns surfels spread evenly over a sphere, along a spiral.
fn sphere(count: usize, centre: DVec3, radius: f64, colour: [f32; 3]) -> Vec<Disc> {
    let turn = PI * (3.0 - 5.0_f64.sqrt());
    let area = 4.0 * PI * radius * radius / count as f64;
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (turn * i as f64).sin_cos();
            let normal = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            Disc {
                position: centre + normal * radius,
                normal,
                sigma: 0.6 * area.sqrt(),
                area,
                colour,
            }
        })
        .collect()
}

/// Returns a camera at the origin that looks along z, with x to the right and y down.
fn camera(projection: Projection, focal: f64, size: [usize; 2]) -> Camera {
    let mut camera = match projection {
        Projection::Perspective => {
            Camera::perspective(DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 60.0, size)
        }
        Projection::Orthographic => {
            Camera::orthographic(DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, size)
        }
    };
    camera.focal_px = DVec2::splat(focal);
    camera
}

/// Returns a renderer of the scene on the CPU.
fn renderer(scene: Vec<PointVolume>) -> Renderer {
    Renderer::with_options(scene, Backend::Cpu).unwrap()
}

/// Compares the GPU's picture of a scene with the CPU's, if there is a GPU.
#[cfg(feature = "gpu")]
fn hold(scene: &[PointVolume], view: &Camera, settings: &Settings) {
    let Some(gpu) = crate::common::gpu::pictures() else {
        return;
    };
    let mut on_cpu = renderer(scene.to_vec());
    let expected = on_cpu.render(view, settings).unwrap();
    let on_gpu = Renderer::new(scene.to_vec()).unwrap();
    let mut on_gpu = on_gpu.on(gpu.clone()).unwrap();
    let image = on_gpu.render(view, settings).unwrap();
    let channels = image.pixels.iter().flatten();
    let differences = channels.zip(expected.pixels.iter().flatten());
    let worst = differences.fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()));
    // Sums of some hundred weights, each with the roundings of its exponential.
    assert!(worst < 2e-5, "{worst} between the back ends");
}

/// Omissions of the tiles' lists, by the rasteriser's own formula.
#[derive(Debug, Default, Clone, Copy)]
struct LeftOut {
    /// Tiles with a pixel of positive weight that do not list the surfel.
    tiles: usize,
    /// Greatest weight there, relative to the surfel's at its centre.
    weight: f64,
    /// Sum of weights there, relative to the sum of the surfel's.
    share: f64,
    /// Tiles with a weight, and tiles that list a surfel.
    touched: usize,
    listed: usize,
}

/// Measures a frame's surfels in front of the camera plane; fractions are those of the worst
/// surfel.
fn left_out(frame: &Frame) -> LeftOut {
    left_out_of(frame, &frame.bins())
}

/// Measures the same if surfels were listed by their affine ellipses.
fn left_out_by_ellipses(frame: &Frame) -> LeftOut {
    let mut bins = Bins::default();
    cpu::bin(
        &frame.footprints,
        FootprintTerms::None,
        &frame.order,
        frame.tiles[0],
        0..frame.tiles[0] * frame.tiles[1],
        &mut bins,
    );
    left_out_of(frame, &bins)
}

fn left_out_of(frame: &Frame, bins: &Bins) -> LeftOut {
    let side = TILE_SIZE as u32;
    let mut lists = vec![HashSet::new(); frame.footprints.len()];
    for tile in 0..frame.tiles[0] * frame.tiles[1] {
        for i in bins.tile(tile) {
            lists[i as usize].insert(tile);
        }
    }
    let mut out = LeftOut::default();
    for (i, (footprint, listed)) in frame.footprints.iter().zip(&lists).enumerate() {
        if !footprint.is_visible() || footprint.path != PATH_SURFEL {
            continue;
        }
        let terms = frame.surfels[i];
        let (mut all, mut missed) = (0.0, 0.0);
        let (mut touched, mut absent) = (HashSet::new(), HashSet::new());
        for y in footprint.row_range().0..footprint.row_range().1 {
            for x in footprint.column_range().0..footprint.column_range().1 {
                let dx = x as f32 + 0.5 - footprint.centre_px[0];
                let dy = y as f32 + 0.5 - footprint.centre_px[1];
                let p = footprint.form_p[0] * dx + footprint.form_p[1] * dy;
                let r = footprint.form_r[0] * dx + footprint.form_r[1] * dy;
                let mut q = p * p + r * r;
                if terms.homography > 0.0 {
                    let z = terms.inverse_depth + terms.gradient[0] * dx + terms.gradient[1] * dy;
                    let root = z / terms.inverse_depth;
                    q /= root * root;
                    if root <= 0.0 {
                        continue;
                    }
                }
                if q > footprint.cutoff_squared {
                    continue;
                }
                let weight = f64::from(-0.5 * q).exp();
                let tile = (y / side) as usize * frame.tiles[0] + (x / side) as usize;
                all += weight;
                touched.insert(tile);
                if !listed.contains(&tile) {
                    absent.insert(tile);
                    missed += weight;
                    out.weight = out.weight.max(weight);
                }
            }
        }
        out.tiles += absent.len();
        out.touched += touched.len();
        out.listed += listed.len();
        out.share = out.share.max(missed / all);
    }
    out
}

#[test]
fn every_pixel_that_a_surfel_reaches_lies_in_a_tile_that_lists_it() {
    let one = |tilt: f64, sigma: f64| {
        let normal = DMat3::from_rotation_x(tilt.to_radians()) * DVec3::NEG_Z;
        Disc {
            position: DVec3::Z,
            normal,
            sigma,
            area: 1.0,
            colour: [1.0; 3],
        }
    };
    let view = camera(Projection::Perspective, 500.0, [4096, 4096]);
    let frame = |all: &[Disc]| Frame::new(discs(all, false), &view, &Settings::default());
    // Omissions of affine ellipses: tiles, the greatest weight and the share of all weights.
    for (tilt, sigma, missed, weight, share) in [
        (60.0, 0.2, 734, 0.098, 0.0858),
        (30.0, 0.1, 44, 0.0168, 0.0033),
        (75.0, 0.2, 0, 0.0, 0.0),
        (85.0, 0.25, 0, 0.0, 0.0),
        (0.0, 0.3, 0, 0.0, 0.0),
    ] {
        let frame = frame(&[one(tilt, sigma)]);
        let by_ellipses = left_out_by_ellipses(&frame);
        let found = left_out(&frame);
        println!("tilt {tilt}, sigma {sigma}: {found:?}, by ellipses {by_ellipses:?}");
        assert!(found.touched > 0, "{found:?}");
        assert_eq!(found.tiles, 0, "tilt {tilt}, sigma {sigma}: {found:?}");
        // The test is exact, except for a tile here and there where an outline passes between pixel
        // centres.
        assert!(found.listed * 100 <= found.touched * 101, "{found:?}");
        if missed > 0 {
            // A tile more or less, by roundings.
            assert!(by_ellipses.tiles.abs_diff(missed) <= 2, "{by_ellipses:?}");
            assert!((by_ellipses.weight - weight).abs() < 1e-3);
            assert!((by_ellipses.share - share).abs() < 1e-3);
        }
    }
    let mut random = Random::new(21);
    let mut seen = LeftOut::default();
    let view = camera(Projection::Perspective, 300.0, [1024, 768]);
    for focal in [60.0, 300.0, 3000.0] {
        let mut view = view.clone();
        view.focal_px = DVec2::new(focal, 1.3 * focal);
        let all: Vec<Disc> = (0..150)
            .map(|_| {
                let z = random.range(0.5, 4.0);
                let at = random.point(1.3) * DVec3::new(512.0, 384.0, 0.0) / focal * z;
                Disc {
                    position: at.with_z(z),
                    normal: random.rotation().z_axis,
                    sigma: z * random.log_range(0.01, 3.0) * 100.0 / focal,
                    area: 1.0,
                    colour: [1.0; 3],
                }
            })
            .collect();
        let frame = Frame::new(discs(&all, false), &view, &Settings::default());
        let found = left_out(&frame);
        println!("focal {focal}: {found:?}");
        assert_eq!(found.tiles, 0, "focal {focal}: {found:?}");
        seen.touched += found.touched;
    }
    assert!(seen.touched > 10_000, "{seen:?}");
}

/// Returns the reference image of a scene.
fn truth(scene: &[PointVolume], view: &Camera, error: f64) -> ReferenceFrame {
    let settings = ReferenceSettings {
        error,
        ..ReferenceSettings::default()
    };
    let integrator = Integrator::new(scene).unwrap();
    integrator.render(view, &settings).unwrap()
}

/// Compares a picture with the reference: the worst channel of a pixel, and the root mean square.
fn from_truth(picture: &Image, truth: &ReferenceFrame) -> (f64, f64) {
    let channels = picture.pixels.iter().flatten().map(|&c| f64::from(c));
    let pairs = channels.zip(truth.pixels.iter().flatten());
    let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
    for (a, b) in pairs {
        worst = worst.max((a - b).abs());
        squares += (a - b) * (a - b);
        count += 1.0;
    }
    (worst, f64::sqrt(squares / count))
}

/// Largest error at the horizon of a wide surfel at the camera plane, seen nearly edge on, relative
/// to its peak.
const NEAR_HORIZON: f64 = 0.07;

#[test]
fn single_surfels_are_those_of_the_independent_truth() {
    let settings = Settings {
        tolerance: 1e-3,
        ..Settings::default()
    };
    // Weights are at most .4, so coverage is the weight itself, and no other convention matters.
    let peak = 0.4;
    let disc = |position: DVec3, tilt: f64, sigma: f64| Disc {
        position,
        normal: DMat3::from_rotation_x(tilt.to_radians()) * DVec3::NEG_Z,
        sigma,
        area: peak * TAU * sigma * sigma,
        colour: [1.0, 0.5, 0.25],
    };
    let focal = 120.0;
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let view = camera(projection, focal, [128, 128]);
        // Parallel rays begin at the eye's plane, which no surfel here reaches.
        let (distance, in_perspective) = match projection {
            Projection::Perspective => (1.0, 1.0),
            Projection::Orthographic => (20.0, 0.0),
        };
        for tilt in [0.0_f64, 30.0, 60.0, 75.0, 80.0] {
            for sigma in [0.02, 0.08, 0.2, 1.0, 3.0] {
                let scene = [discs(&[disc(DVec3::Z * distance, tilt, sigma)], false)];
                let mut renderer = renderer(scene.to_vec());
                let picture = renderer.render(&view, &settings).unwrap();
                let truth = truth(&scene, &view, 1e-4);
                let (worst, rms) = from_truth(picture, &truth);
                let near = renderer.counts().footprints_near;
                println!(
                    "{projection:?}, tilt {tilt}, sigma {sigma}: {worst:.1e}, rms {rms:.1e}, near {near}"
                );
                // The cut-off omits a tolerance of the peak. In perspective, the filter is that of
                // the centre, carried along by the plane's homography. Over the filter's width of a
                // pixel, the nearness changes by tan(tilt) / focal; half of it was measured,
                // relative to the peak.
                let slope = tilt.to_radians().tan() / focal * in_perspective;
                let allowed = peak * (1.25e-3 + 0.55 * slope);
                // A surfel that reaches the camera plane is not filtered: towards its horizon, the
                // weight falls to 0 within a pixel.
                let allowed = if near > 0 && sigma > 1.0 && tilt > 60.0 {
                    NEAR_HORIZON * peak
                } else {
                    allowed
                };
                assert!(
                    worst < allowed,
                    "{projection:?}, tilt {tilt}, sigma {sigma}: {worst}"
                );
            }
        }
    }
}

#[test]
fn planes_of_many_surfels_and_surfaces_in_volumes_are_those_of_the_truth() {
    let settings = Settings {
        tolerance: 1e-3,
        ..Settings::default()
    };
    // A wave on an oblique plane that runs out of the picture, with 2 px and more per surfel.
    let turn = DMat3::from_rotation_x(50.0_f64.to_radians());
    let axes = [turn * DVec3::X, turn * DVec3::NEG_Y];
    let wave = |at: DVec2| [0.5 + 0.5 * (4.0 * at.x).cos() as f32, 0.5, 0.2];
    let textured = plane(DVec3::Z * 3.0, axes, 0.15, 24, wave);
    let wall = plane(
        DVec3::new(-0.6, 0.0, 3.0),
        [DVec3::X, DVec3::NEG_Y],
        0.1,
        8,
        |_| [0.8, 0.1, 0.1],
    );
    let cloud = fog(
        0.25,
        [9, 9, 9],
        DVec3::new(-1.0, -1.0, 2.0),
        0.8,
        [0.1, 0.8, 0.3],
    );
    for (what, scene) in [
        ("a textured plane", vec![discs(&textured, true)]),
        ("a wall in fog", vec![discs(&wall, true), cloud]),
    ] {
        let view = camera(Projection::Perspective, 40.0, [48, 48]);
        let mut renderer = renderer(scene.clone());
        let picture = renderer.render(&view, &settings).unwrap();
        let truth = truth(&scene, &view, 1e-3);
        let (worst, rms) = from_truth(picture, &truth);
        // Pixels that the surface covers in both.
        let pairs = picture.pixels.iter().zip(&truth.pixels);
        let (mut inside, mut colours) = (0, 0.0_f64);
        for (got, truth) in pairs.filter(|(got, truth)| truth[3] > 0.98 && got[3] > 0.98) {
            inside += 1;
            for c in 0..3 {
                let of_got = f64::from(got[c] / got[3]);
                colours = colours.max((of_got - truth[c] / truth[3]).abs());
            }
        }
        println!(
            "{what}: {worst:.1e}, rms {rms:.1e}; {inside} pixels inside, colours within {colours:.1e}; \
             stated {:.1e}, {} rays",
            truth.error, truth.rays
        );
        // Along edges, coverage counts from .85 on. Inside, the renderer averages filtered weights,
        // and the reference filters averages. .032 was measured for a wave of amplitude .5 seen
        // obliquely, .018 in fog, whose kernels overlap in depth.
        assert!(worst < 0.15 && rms < 0.012, "{what}: {worst}, {rms}");
        assert!(
            inside > 300 && colours < 0.04,
            "{what}: {inside}, {colours}"
        );
    }
}

/// Returns the amplitude of a grating in the image's red channel: twice the mean product with a
/// unit wave of the fitted phase.
fn amplitude(samples: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut c, mut s, mut n) = (0.0, 0.0, 0.0);
    for (phase, value) in samples {
        c += value * phase.cos();
        s += value * phase.sin();
        n += 1.0;
    }
    2.0 * f64::hypot(c, s) / n
}

#[test]
fn a_textured_plane_is_heckberts_filter() {
    // Facing: kernels of 1 px² and a low-pass filter of 1 px² leave exp(-2 pi² f² 2).
    let facing = case("textured_plane_facing");
    let frequency = number(&facing, "/input/freq_cyc_per_px");
    let sigma = number(&facing, "/input/kernel_var_px2").sqrt();
    let spacing = sigma / 0.6;
    let wave = |at: DVec2| [0.5 + 0.5 * (TAU * frequency * at.x).cos() as f32, 0.5, 0.5];
    let surface = plane(DVec3::Z * 50.0, [DVec3::X, DVec3::NEG_Y], spacing, 60, wave);
    let settings = Settings {
        cutoff: Some(7.0),
        ..Settings::default()
    };
    let view = camera(Projection::Orthographic, 1.0, [80, 20]);
    let mut facing_renderer = renderer(vec![discs(&surface, true)]);
    #[cfg(feature = "gpu")]
    hold(&[discs(&surface, true)], &view, &settings);
    let image = facing_renderer.render(&view, &settings).unwrap();
    let samples = (0..80).map(|x| {
        let at = x as f64 + 0.5 - 40.0;
        let red = f64::from(image.pixel(x, 10)[0]) - 0.5;
        (TAU * frequency * at, 2.0 * red)
    });
    let found = amplitude(samples);
    let expected = number(&facing, "/expected/amplitude");
    // The lattice's own ripple at sigma = .6 spacings (with the low-pass filter .85) is below 1e-4.
    assert!((found - expected).abs() < 1e-4, "{found} for {expected}");

    // Tilted by 50 degrees, the image's axes have different variances.
    let tilted = case("textured_plane_tilted_50deg");
    let tilt = number(&tilted, "/input/tilt_deg").to_radians();
    let [fx, fy] = numbers(&tilted, "/input/plane_freq")[..] else {
        panic!("two frequencies");
    };
    let scale = number(&tilted, "/input/px_per_unit");
    let spacing = number(&tilted, "/input/spacing");
    let turn = DMat3::from_rotation_x(tilt);
    let wave = |at: DVec2| {
        let phase = TAU * (fx * at.x + fy * at.y);
        [0.5 + 0.5 * phase.cos() as f32, 0.5, 0.5]
    };
    let axes = [turn * DVec3::X, turn * DVec3::NEG_Y];
    let surface = plane(DVec3::Z * 50.0, axes, spacing, 90, wave);
    let size = [100, 64];
    let view = camera(Projection::Orthographic, scale, size);
    let mut tilted_renderer = renderer(vec![discs(&surface, false)]);
    #[cfg(feature = "gpu")]
    hold(&[discs(&surface, false)], &view, &settings);
    let image = tilted_renderer.render(&view, &settings).unwrap();
    let pixels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
    // Whole periods: 100 px are 3 periods of .6/20 along x; the phase changes along both axes.
    let samples = pixels.map(|(x, y)| {
        let at = DVec2::new(x as f64 + 0.5 - 50.0, y as f64 + 0.5 - 32.0) / scale;
        let phase = TAU * (fx * at.x - fy * at.y / tilt.cos());
        (phase, 2.0 * f64::from(image.pixel(x, y)[0]) - 1.0)
    });
    let found = amplitude(samples);
    let expected = number(&tilted, "/expected/amplitude");
    // The mean over a window of whole periods along x alone leaves 1e-3 of the other phase.
    assert!((found - expected).abs() < 2e-3, "{found} for {expected}");
    // At the wave's crests and troughs, the value is the amplitude itself.
    let centre = f64::from(image.pixel(50, 32)[0] + image.pixel(49, 31)[0]) - 1.0;
    assert!((centre / expected - 1.0).abs() < 0.02, "{centre}");
}

#[test]
fn colours_are_means_and_a_plane_is_covered() {
    // One colour stays that colour, whatever the ripple of the weights.
    for spacing_px in [0.3, 1.0, 4.0, 20.0] {
        let size = [48, 48];
        let view = camera(Projection::Perspective, 60.0, size);
        let spacing = spacing_px / 60.0 * 5.0;
        let half = (60.0 / spacing_px) as i32 + 4;
        let mut random = Random::new(5);
        let mut surface = plane(
            DVec3::Z * 5.0,
            [DVec3::X, DVec3::NEG_Y],
            spacing,
            half,
            |_| [0.25, 0.5, 3.0],
        );
        for disc in &mut surface {
            disc.position +=
                DVec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), 0.0) * 0.1 * spacing;
        }
        let mut renderer = renderer(vec![discs(&surface, true)]);
        let image = renderer.render(&view, &Settings::default()).unwrap();
        for pixel in &image.pixels {
            // Sums of a few hundred weights: their roundings.
            let is_mean = |channel: usize, c: f32| (pixel[channel] - c).abs() <= 2e-6 * c;
            assert!(
                is_mean(0, 0.25) && is_mean(1, 0.5) && is_mean(2, 3.0),
                "{pixel:?}"
            );
            assert_eq!(pixel[3], 1.0, "{spacing_px} px");
        }
    }
}

#[test]
fn a_spheres_silhouette_is_as_soft_as_the_filter() {
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let (focal, distance, size) = match projection {
            Projection::Perspective => (200.0, 4.0, [160, 160]),
            Projection::Orthographic => (50.0, 4.0, [160, 160]),
        };
        let view = camera(projection, focal, size);
        let ball = sphere(60_000, DVec3::Z * distance, 1.0, [1.0, 0.5, 0.25]);
        let mut renderer = renderer(vec![discs(&ball, true)]);
        let settings = Settings {
            depth: true,
            normals: true,
            ..Settings::default()
        };
        renderer.render(&view, &settings).unwrap();
        let (image, depth) = (renderer.image(), renderer.depth().unwrap());
        let normals = renderer.normals().unwrap();
        let radius = match projection {
            Projection::Perspective => focal / (distance * distance - 1.0).sqrt(),
            Projection::Orthographic => focal,
        };
        let (mut inside, mut worst) = (0, 0.0_f32);
        for y in 0..size[1] {
            for x in 0..size[0] {
                let offset = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - view.centre_px;
                let margin = radius - offset.length();
                let alpha = image.pixel(x, y)[3];
                // The filter's 1 px and the surfels' .1 px across.
                let expected = normal_cdf(margin as f32);
                if margin > 2.5 {
                    inside += 1;
                    assert!(alpha > 0.999, "{margin}: {alpha}");
                } else {
                    worst = worst.max((alpha - expected).abs());
                }
                // The position of the surface, from the ray.
                if margin > 4.0 {
                    let (origin, ray) = match projection {
                        Projection::Perspective => (DVec3::ZERO, (offset / focal).extend(1.0)),
                        Projection::Orthographic => ((offset / focal).extend(0.0), DVec3::Z),
                    };
                    let b = ray.dot(DVec3::Z * distance - origin);
                    let c = (origin - DVec3::Z * distance).length_squared() - 1.0;
                    let a = ray.length_squared();
                    let t = (b - (b * b - a * c).sqrt()) / a;
                    let hit = origin + ray * t;
                    let i = y * size[0] + x;
                    let z = f64::from(depth.depths[i]);
                    // Curvature within the filter's reach: h² / (2 R cos³) px at the rim.
                    assert!((z - hit.z).abs() < 0.02, "{x},{y}: {z} for {}", hit.z);
                    let n = DVec3::from(normals.normals[i].map(f64::from));
                    let expected = hit - DVec3::Z * distance;
                    assert!((n.length() - 1.0).abs() < 1e-5);
                    // The mean of normals within the filter's reach.
                    assert!(n.dot(expected) > 0.995, "{x},{y}: {n} for {expected}");
                }
            }
        }
        assert!(inside > 5_000);
        // COVERAGE_FULL counts as full: at most .15 of a pixel's coverage.
        println!("{projection:?}: silhouette off by {worst} at most");
        assert!(worst < 0.15, "{worst}");
    }
}

#[test]
fn nearer_surfaces_hide_farther_ones_whatever_the_order() {
    let view = camera(Projection::Perspective, 100.0, [96, 96]);
    let red = sphere(20_000, DVec3::new(0.0, 0.0, 4.0), 1.0, [1.0, 0.0, 0.0]);
    let wall = plane(DVec3::Z * 4.5, [DVec3::X, DVec3::NEG_Y], 0.03, 120, |_| {
        [0.0, 0.0, 1.0]
    });
    let small = sphere(8_000, DVec3::new(0.5, 0.0, 2.6), 0.3, [0.0, 1.0, 0.0]);
    let mut all: Vec<Disc> = red.into_iter().chain(wall).chain(small).collect();
    let mut first = renderer(vec![discs(&all, true)]);
    let settings = Settings::default();
    let image = first.render(&view, &settings).unwrap().clone();
    // The middle of each shows nothing behind it: the cut-off is a tenth of a thousandth.
    let at = |x: f64, y: f64, z: f64| {
        image.pixel(
            (48.0 + 100.0 * x / z) as usize,
            (48.0 + 100.0 * y / z) as usize,
        )
    };
    for (pixel, channel) in [
        (at(-0.3, 0.2, 3.0), 0),
        (at(0.5, 0.0, 2.3), 1),
        (at(-1.8, 1.5, 4.5), 2),
    ] {
        for (i, value) in pixel.into_iter().enumerate() {
            let expected = f32::from(u8::from(i == channel || i == 3));
            assert!((value - expected).abs() < 1e-4, "{pixel:?}");
        }
    }
    assert!(image.pixels.iter().all(|p| (p[3] - 1.0).abs() < 1e-5));
    // The order of surfels decides ties of f32 sums, and which layer takes a fragment within the
    // slack of two, along silhouettes.
    let mut random = Random::new(9);
    for i in (1..all.len()).rev() {
        all.swap(i, random.index(i + 1));
    }
    let mut second = renderer(vec![discs(&all, true)]);
    let shuffled = second.render(&view, &settings).unwrap();
    let differences = image.pixels.iter().zip(&shuffled.pixels).map(|(a, b)| {
        let channels = a.iter().zip(b);
        channels.fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()))
    });
    let mut differences: Vec<f32> = differences.collect();
    differences.sort_by(f32::total_cmp);
    let high = differences[differences.len() * 99 / 100];
    println!(
        "shuffled: 99 % within {high}, all within {}",
        differences[differences.len() - 1]
    );
    assert!(high < 1e-5);
}

#[test]
fn surfels_of_one_side_are_not_seen_from_behind() {
    let view = camera(Projection::Perspective, 60.0, [32, 32]);
    let grey = |_| [0.5; 3];
    // Seen along its normal, that is from behind.
    let back = plane(DVec3::Z * 3.0, [DVec3::X, DVec3::Y], 0.05, 60, grey);
    let mut one = renderer(vec![discs(&back, true)]);
    let image = one.render(&view, &Settings::default()).unwrap();
    assert!(image.pixels.iter().all(|p| *p == [0.0; 4]));
    let mut two = renderer(vec![discs(&back, false)]);
    let image = two.render(&view, &Settings::default()).unwrap();
    assert!(image.pixels.iter().all(|p| p[3] == 1.0));
}

/// The eye stands on a floor of large surfels, some of which extend behind it.
#[test]
fn a_floor_reaches_the_eye() {
    let size = [64, 64];
    let view = camera(Projection::Perspective, 32.0, size);
    let checks = |at: DVec2| {
        let dark = (at.x.floor() as i32 + at.y.floor() as i32) % 2 == 0;
        if dark { [0.1; 3] } else { [0.8; 3] }
    };
    // Below the eye (y runs down).
    let height = 0.3;
    let floor = plane(DVec3::Y * height, [DVec3::X, DVec3::Z], 0.25, 300, checks);
    let mut renderer = renderer(vec![discs(&floor, false)]);
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    renderer.render(&view, &settings).unwrap();
    assert!(renderer.counts().footprints_near > 0);
    let (image, depth) = (renderer.image(), renderer.depth().unwrap());
    for y in 36..size[1] {
        for x in 0..size[0] {
            let slope = (y as f64 + 0.5 - 32.0) / 32.0;
            assert!(
                image.pixel(x, y)[3] > 0.999,
                "{x},{y}: {:?}",
                image.pixel(x, y)
            );
            // The floor's own depth: exact for planes, except for the low-pass filter's mean of it,
            // (h / 32)² / slope³.
            let z = f64::from(depth.depths[y * size[0] + x]);
            let allowed = 2e-3 + 1.5 / 1024.0 / slope.powi(3);
            assert!(
                (z - height / slope).abs() < allowed,
                "{x},{y}: {z} for {}",
                height / slope
            );
        }
    }
    // There is nothing above the horizon.
    assert!((0..24).all(|y| (0..64).all(|x| image.pixel(x, y)[3] < 1e-3)));
}

#[test]
fn scale_and_place_of_the_scene_do_not_matter() {
    let reference = {
        let view = camera(Projection::Perspective, 80.0, [64, 64]);
        let mut renderer = renderer(vec![discs(&two_spheres(1.0, DVec3::ZERO), true)]);
        renderer
            .render(&view, &Settings::default())
            .unwrap()
            .clone()
    };
    // Powers of two change no rounding; a far origin costs only f64 roundings of positions.
    for (scale, origin, allowed) in [
        (2.0_f64.powi(-40), DVec3::ZERO, 1e-6),
        (2.0_f64.powi(40), DVec3::ZERO, 1e-6),
        (1e-12, DVec3::ZERO, 2e-4),
        (1e12, DVec3::ZERO, 2e-4),
        (1.0, DVec3::new(1e7, -3e6, 2e6), 2e-3),
    ] {
        let mut view = camera(Projection::Perspective, 80.0, [64, 64]);
        view.eye = origin;
        let mut renderer = renderer(vec![discs(&two_spheres(scale, origin), true)]);
        let image = renderer.render(&view, &Settings::default()).unwrap();
        let channels = image.pixels.iter().flatten();
        let worst = channels
            .zip(reference.pixels.iter().flatten())
            .fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(worst <= allowed, "{scale} at {origin}: {worst}");
    }
}

fn two_spheres(scale: f64, origin: DVec3) -> Vec<Disc> {
    let at = |x: f64, z: f64| origin + DVec3::new(x, 0.1, z) * scale;
    let mut all = sphere(6_000, at(-0.3, 4.0), scale, [0.9, 0.3, 0.1]);
    all.extend(sphere(2_000, at(0.4, 2.8), 0.4 * scale, [0.1, 0.3, 0.9]));
    all
}

/// Returns a cloud of spheres in front of the camera, some hundred layers.
fn fog(
    spacing: f64,
    dims: [i32; 3],
    first: DVec3,
    extinction: f64,
    colour: [f32; 3],
) -> PointVolume {
    let [nx, ny, nz] = dims;
    let cells = (0..nx).flat_map(|i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
    let positions: Vec<DVec3> = cells
        .map(|c| first + DVec3::from(c.map(f64::from)) * spacing)
        .collect();
    let count = positions.len();
    PointVolume::new(
        Particles::Isotropic {
            positions,
            sigmas: vec![(0.6 * spacing) as f32; count],
        },
        Strength::Mass(vec![(extinction * spacing.powi(3)) as f32; count]),
    )
    .with_colour(colour)
}

#[test]
fn fog_in_front_of_a_wall_is_integrated_up_to_it() {
    // Uniform fog from z = 2 on, and a wall at z = 4: transmittance exp(-.5 x 2) along the axis.
    let view = camera(Projection::Orthographic, 24.0, [32, 32]);
    let (spacing, extinction) = (0.1, 0.5);
    let cloud = fog(
        spacing,
        [40, 40, 60],
        DVec3::new(-1.95, -1.95, 2.05),
        extinction,
        [0.0, 1.0, 0.0],
    );
    let wall = plane(DVec3::Z * 4.0, [DVec3::X, DVec3::NEG_Y], 0.04, 60, |_| {
        [1.0, 0.0, 0.0]
    });
    let mut both = renderer(vec![cloud, discs(&wall, true)]);
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    both.render(&view, &settings).unwrap();
    let through = (-extinction * 2.0_f64).exp();
    for y in 4..28 {
        for x in 4..28 {
            let [red, green, blue, alpha] = both.image().pixel(x, y).map(f64::from);
            // The fog's ripple, .7 % of its depth, and the soft rim of .6 spacings at its front.
            assert!((red - through).abs() < 0.01, "{red} for {through}");
            assert!((green - (1.0 - through)).abs() < 0.01, "{green}");
            assert!(blue == 0.0 && (alpha - 1.0).abs() < 1e-5);
            // Half the light is absorbed within the fog: at 2 + ln 2 / .5, to within a layer.
            let depth = f64::from(both.depth().unwrap().depths[y * 32 + x]);
            assert!(
                (depth - (2.0 + 2.0_f64.ln() / extinction)).abs() < 0.15,
                "{depth}"
            );
        }
    }
}

#[test]
fn a_wall_through_a_kernels_centre_leaves_half_of_it() {
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let focal = if projection == Projection::Perspective {
            100.0
        } else {
            20.0
        };
        let view = camera(projection, focal, [33, 33]);
        for (behind, share) in [
            (0.0_f64, 0.5_f64),
            (0.5, 0.158_655_26),
            (-0.5, 0.841_344_75),
            (9.0, 0.0),
        ] {
            // One kernel of sigma .5 and depth 1 at z = 5; the wall is `behind` it towards the eye.
            let mass = 1.0 * TAU * 0.25;
            let ball = PointVolume::new(
                Particles::Isotropic {
                    positions: vec![DVec3::Z * 5.0],
                    sigmas: vec![0.5],
                },
                Strength::Mass(vec![mass as f32]),
            )
            .with_colour([0.0, 1.0, 0.0]);
            let wall = plane(
                DVec3::Z * (5.0 - behind.min(4.0)),
                [DVec3::X, DVec3::NEG_Y],
                0.02,
                80,
                |_| [1.0, 0.0, 0.0],
            );
            let settings = Settings {
                low_pass_variance_px2: 1e-4,
                cutoff: Some(7.0),
                ..Settings::default()
            };
            let scene = vec![discs(&wall, true), ball];
            #[cfg(feature = "gpu")]
            hold(&scene, &view, &settings);
            let mut scene = renderer(scene);
            let pixel = scene.render(&view, &settings).unwrap().pixel(16, 16);
            let expected = 1.0 - (-share as f32).exp();
            // With surfels of .012 and a filter of a hundredth of a pixel, the wall is a plane.
            assert!(
                (pixel[1] - expected).abs() < 2e-4,
                "{behind}: {pixel:?} for {expected}"
            );
            assert!((pixel[0] - (1.0 - expected)).abs() < 2e-4);
        }
    }
}

#[test]
fn what_lies_behind_shows_beside_a_silhouette() {
    // The edge of a half plane, with fog entirely behind it: coverage times red, the rest green.
    let view = camera(Projection::Orthographic, 20.0, [40, 24]);
    let wall = plane(
        DVec3::new(-3.02, 0.0, 3.0),
        [DVec3::X, DVec3::NEG_Y],
        0.04,
        75,
        |_| [1.0, 0.0, 0.0],
    );
    let cloud = fog(
        0.1,
        [50, 40, 30],
        DVec3::new(-2.45, -1.95, 4.0),
        20.0,
        [0.0, 1.0, 0.0],
    );
    let mut scene = renderer(vec![discs(&wall, true), cloud]);
    let image = scene.render(&view, &Settings::default()).unwrap();
    for x in 8..32 {
        let [red, green, _, alpha] = image.pixel(x, 12);
        assert!(
            (red + green - 1.0).abs() < 2e-3 && (alpha - 1.0).abs() < 1e-3,
            "{x}: {red} {green}"
        );
    }
    assert!(image.pixel(8, 12)[0] > 0.999 && image.pixel(31, 12)[1] > 0.99);
    assert!((16..24).any(|x| (0.1..0.9).contains(&image.pixel(x, 12)[0])));
}

#[test]
fn a_panes_opacity_does_not_depend_on_its_tilt() {
    let opacity = 0.3_f64;
    for tilt in [0.0_f64, 30.0, 60.0, 75.0] {
        let turn = DMat3::from_rotation_x(tilt.to_radians());
        let spacing = 0.1;
        let axes = [turn * DVec3::X, turn * DVec3::NEG_Y];
        let surface = plane(DVec3::Z * 40.0, axes, spacing, 60, |_| [1.0; 3]);
        let mut pane = discs(&surface, false);
        let depth = spacing * spacing * -(-opacity).ln_1p();
        pane.strength = Strength::Translucent(vec![depth as f32; surface.len()]);
        let view = camera(Projection::Orthographic, 60.0, [16, 16]);
        let mut scene = renderer(vec![pane]);
        let image = scene.render(&view, &Settings::default()).unwrap();
        let mean = image.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / 256.0;
        // The lattice's ripple at .6 spacings, averaged over some cells, and the cut-off's
        // thousandth of the depth.
        assert!((mean - opacity).abs() < 2e-3, "{tilt} degrees: {mean}");
    }
}

#[test]
fn flattened_kernels_become_surfels() {
    // A bumpy sheet of ellipsoids, flattened along their own normals.
    let mut random = Random::new(3);
    let kernels: Vec<(DVec3, DMat3, DVec3)> = (0..400)
        .map(|i| {
            let at = DVec2::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5) * 0.2;
            let position = at.extend(6.0 + 0.3 * (at.x * 2.0).sin());
            let turn = DMat3::from_rotation_y(random.range(-1.0, 1.0))
                * DMat3::from_rotation_x(random.range(-1.0, 1.0));
            let factor = turn * DMat3::from_diagonal(DVec3::new(0.15, 0.2, 0.1));
            let direction = DVec3::new(-0.6 * (at.x * 2.0).cos(), 0.1, -1.0).normalize();
            (position, factor, direction)
        })
        .collect();
    let positions: Vec<DVec3> = kernels.iter().map(|k| k.0).collect();
    let volume = |particles| {
        PointVolume::new(particles, Strength::Mass(vec![0.03; kernels.len()]))
            .with_colour([1.0, 0.6, 0.2])
    };
    let at = |s: f64| {
        let factor =
            |k: &(DVec3, DMat3, DVec3)| lower_factor(flatten(k.1, k.2, s)).map(|l| l as f32);
        volume(Particles::Anisotropic {
            positions: positions.clone(),
            factors: kernels.iter().map(factor).collect(),
        })
    };
    let surfels = volume(Particles::Surfels {
        positions: positions.clone(),
        tangents: kernels
            .iter()
            .map(|k| narrow(tangents_of(k.1, k.2)))
            .collect(),
        is_one_sided: false,
    });
    let view = camera(Projection::Perspective, 90.0, [64, 64]);
    let settings = Settings {
        tolerance: 1e-6,
        ..Settings::default()
    };
    let draw = |volume: PointVolume| {
        #[cfg(feature = "gpu")]
        hold(std::slice::from_ref(&volume), &view, &settings);
        let mut renderer = renderer(vec![volume]);
        renderer.render(&view, &settings).unwrap().clone()
    };
    let limit = draw(surfels);
    let distance = |s: f64| {
        let image = draw(at(s));
        let pairs = image.pixels.iter().zip(&limit.pixels);
        pairs.fold(0.0_f32, |worst, (a, b)| worst.max((a[3] - b[3]).abs()))
    };
    let distances = [1.0, 4.0, 16.0, 64.0, f64::INFINITY].map(distance);
    println!("flattened by 1, 4, 16, 64, infinity: {distances:?} from surfels");
    // The covariance between the normal and the tangents falls as 1/s. So does the difference,
    // fourfold per step once it is small.
    assert!(distances[0] > 0.05);
    assert!(distances[2] < distances[1] / 3.6 && distances[3] < distances[2] / 3.6);
    // The same kernels in two forms differ by roundings of their factors.
    assert!(distances[4] < 2e-5);
}

#[test]
fn poison_draws_nothing_and_spoils_nothing() {
    let view = camera(Projection::Perspective, 80.0, [64, 64]);
    let sound = two_spheres(1.0, DVec3::ZERO);
    let mut clean = renderer(vec![discs(&sound, true)]);
    let clean = clean.render(&view, &Settings::default()).unwrap().clone();
    for poison in [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        0.0,
        1e-40,
        f32::MAX,
    ] {
        let mut volume = discs(&sound, true);
        let mut broken = volume.clone();
        let count = sound.len();
        if let (
            Particles::Surfels {
                positions,
                tangents,
                ..
            },
            Particles::Surfels {
                tangents: bad,
                positions: places,
                ..
            },
        ) = (&mut volume.particles, &mut broken.particles)
        {
            // Invalid surfels lie beside the sound ones, each with another invalid number.
            for i in 0..12 {
                positions.push(
                    places[i]
                        + if i % 4 == 3 {
                            DVec3::splat(f64::from(poison))
                        } else {
                            DVec3::ZERO
                        },
                );
                bad[i][i % 6] = if i < 6 { poison } else { 0.0 };
                bad[i][(i + 3) % 6] = if i < 6 { poison } else { 0.0 };
                tangents.push(bad[i].map(|t| if i % 2 == 0 { t } else { poison }));
            }
        }
        if let Strength::Surface(areas) = &mut volume.strength {
            areas.extend(
                (0..12)
                    .map(|i| if i % 3 == 0 { poison } else { areas[0] })
                    .collect::<Vec<_>>(),
            );
        }
        if let Colour::PerParticle(colours) = &mut volume.colour {
            colours.extend([[0.5; 3]; 12]);
        }
        let mut renderer = renderer(vec![volume]);
        renderer.render(&view, &Settings::default()).unwrap();
        assert_eq!(renderer.volumes()[0].particle_count().min(count), count);
        let differs = share_that_differs(&renderer.image().pixels, &clean.pixels);
        assert!(differs < 0.02, "{poison}: {differs}");
    }
}

/// Returns the fraction of pixels that differ by more than a hundredth or are not numbers.
fn share_that_differs(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let differs = |(a, b): (&[f32; 4], &[f32; 4])| {
        // The comparison counts NaN.
        !a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 0.01)
    };
    let count = a.iter().zip(b).filter(|&pair| differs(pair)).count();
    count as f64 / a.len() as f64
}
