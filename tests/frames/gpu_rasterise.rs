//! Compares the GPU's rasteriser and background with the CPU's, on the same lists.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::depth_of;
use crate::common::frame::Frame;
use crate::common::gpu::{explained_flips, gpu};
use crate::common::scene::{Particle, volume};
use ewa_splat::Filter;
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::render::Advanced;
use ewa_splat::stages::constants::{FAINT, TERMINATION_INTERVAL};
use ewa_splat::stages::cpu::{self, Bins, SimdLevel};
use ewa_splat::stages::gpu::{Gpu, RasterSpec, rasterise};
use ewa_splat::stages::record::{
    Carried, ExactTerms, Footprint, PATH_AFFINE, PATH_EXACT, PATH_PEAK, pack_range,
};
use ewa_splat::stages::splat::Axes;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Settings, Show};
use glam::DVec3;

/// Results of the last stages on the CPU.
struct Drawn {
    image: Image,
    depth: Option<DepthImage>,
    splat_pixels: u64,
}

fn on_cpu(frame: &Frame, bins: &Bins, spec: RasterSpec, background: Option<[f32; 3]>) -> Drawn {
    let [width, height] = frame.uniform.size.map(|n| n as usize);
    let (tiles, splat_pixels) = frame.rasterised(bins, spec.axes, &[]);
    let mut image = Image::new(width, height);
    cpu::resolve(&tiles, background, false, &mut image);
    Drawn {
        image,
        depth: spec.axes.depth.then(|| depth_of(&tiles, [width, height])),
        splat_pixels,
    }
}

fn on_gpu(
    gpu: &Gpu,
    frame: &Frame,
    bins: &Bins,
    spec: RasterSpec,
    chunks: usize,
    background: Option<[f32; 3]>,
) -> Drawn {
    let lists: Vec<Vec<u32>> = (0..frame.tiles[0] * frame.tiles[1])
        .map(|t| bins.tile(t).collect())
        .collect();
    let (image, depth, splat_pixels) = rasterise(
        gpu,
        &frame.uniform,
        spec,
        &frame.footprints,
        &frame.exact,
        &frame.near,
        &lists,
        chunks,
        None,
        background,
    )
    .unwrap();
    Drawn {
        image,
        depth,
        splat_pixels,
    }
}

/// Returns ellipsoids in front of and around the eye.
fn frame(seed: u64, count: usize, spread: f64, camera: &Camera, settings: &Settings) -> Frame {
    let scene = volume(&particles(seed, count, spread));
    Frame::new(scene, camera, settings)
}

fn particles(seed: u64, count: usize, spread: f64) -> Vec<Particle> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let size = random.log_range(3e-3, 0.3);
            Particle {
                position: random.point(spread) + DVec3::Z * 2.0,
                factor: random.factor(size, 8.0),
                mass: (size * size * random.log_range(0.01, 20.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect()
}

/// Largest difference from roundings: some fifty layers of 2^-24 on either side, twice the largest
/// seen (2.7e-7), and far below a flip at a threshold.
const ROUNDING: f32 = 2e-6;

/// Compares both, with the lists in one chunk and in three. Returns the CPU's results.
fn check(gpu: &Gpu, name: &str, frame: &Frame, spec: RasterSpec) -> Drawn {
    let background = Some([0.2, 0.4, 0.8]).filter(|_| spec.axes.depth);
    let bins = frame.bins();
    let cpu = on_cpu(frame, &bins, spec, background);
    for chunks in [1, 3] {
        let gpu = on_gpu(gpu, frame, &bins, spec, chunks, background);
        let flips = explained_flips(frame, &bins, &cpu.image, &gpu.image, ROUNDING);
        println!("{name}, {chunks} chunks: {flips} pixels differ at a threshold");
        assert!(flips <= cpu.image.pixels.len() / 1000, "{name}");
        // A kernel behind the eye counts until its depth underflows, which happens sooner on the
        // device.
        let tails = if frame.near.is_empty() {
            0
        } else {
            cpu.splat_pixels / 100
        };
        assert!(
            cpu.splat_pixels.abs_diff(gpu.splat_pixels) <= 300 * flips as u64 + tails,
            "{name}: {} and {} splat-pixels",
            cpu.splat_pixels,
            gpu.splat_pixels
        );
        assert_eq!(cpu.depth.is_some(), gpu.depth.is_some());
        if let (Some(a), Some(b)) = (&cpu.depth, &gpu.depth) {
            let differ = a.depths.iter().zip(&b.depths).filter(|(a, b)| a != b);
            // An opacity within rounding of one half passes it one kernel later.
            let differ = differ.count();
            assert!(differ <= a.depths.len() / 5000, "{name}: {differ} depths");
        }
    }
    cpu
}

fn spec_of(frame: &Frame) -> RasterSpec {
    RasterSpec {
        axes: Axes {
            may_be_exact: frame.any_exact,
            ..Axes::default()
        },
        near: !frame.near.is_empty(),
        ..RasterSpec::default()
    }
}

#[test]
fn pictures_are_alike_on_every_path() {
    let Some(gpu) = gpu() else { return };
    let perspective = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [203, 117]);
    let orthographic =
        Camera::orthographic(DVec3::Z * 1.5, DVec3::Z * 2.0, -DVec3::Y, 3.0, [130, 95]);
    let mut seen = [0; 4];
    for (camera, seed) in [(&perspective, 3), (&orthographic, 4)] {
        for filter in [Filter::Ewa, Filter::Exact, Filter::Adaptive] {
            let settings = Settings {
                filter,
                ..Settings::default()
            };
            let frame = frame(seed, 2000, 1.5, camera, &settings);
            for f in frame.footprints.iter().filter(|f| f.is_visible()) {
                seen[f.path as usize & 3] += 1;
            }
            for (depth, linear_opacity) in [(false, false), (true, true)] {
                let mut spec = spec_of(&frame);
                spec.axes.depth = depth;
                spec.axes.linear_opacity = linear_opacity;
                check(gpu, &format!("{filter:?}"), &frame, spec);
            }
        }
    }
    assert!(seen.iter().all(|n| *n > 0), "a path is missing: {seen:?}");
}

/// Makes one footprint per entry, all in every tile's list, drawn in their order.
fn by_hand(footprints: Vec<Footprint>, exact: Vec<ExactTerms>) -> Frame {
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [40, 24]);
    let mut frame = frame(1, 1, 0.1, &camera, &Settings::default());
    frame.any_exact = !exact.is_empty();
    frame.order = (0..footprints.len() as u64).collect();
    frame.near.clear();
    frame.footprints = footprints;
    frame.exact = exact;
    frame
}

/// Returns a round kernel of a pixel's width at the centre of pixel (16, 12).
fn round(tau: f32, cutoff_squared: f32) -> Footprint {
    Footprint {
        centre_px: [16.5, 12.5],
        form_p: [1.0, 0.0],
        form_r: [0.0, 1.0],
        tau,
        cutoff_squared,
        carried: Carried::of_colour([0.9, 0.5, 0.1]),
        depth: 3.0,
        path: PATH_AFFINE,
        columns: pack_range(0, 40),
        rows: pack_range(0, 24),
        key: 0,
    }
}

#[test]
fn thresholds_are_on_the_same_side() {
    let Some(gpu) = gpu() else { return };
    // (3, 4), (5, 0) and (0, 5) lie exactly on the cut-off and belong to the kernel.
    let frame = by_hand(vec![round(0.7, 25.0)], Vec::new());
    let drawn = check(gpu, "cut-off", &frame, spec_of(&frame));
    assert!(drawn.image.pixel(19, 16)[3] > 0.0 && drawn.image.pixel(21, 12)[3] > 0.0);
    assert_eq!(drawn.splat_pixels, 81);
    // The range ends before the kernel does, without the last row and the first column.
    let clipped = Footprint {
        rows: pack_range(10, 17),
        ..round(0.7, 25.0)
    };
    let frame = by_hand(vec![clipped], Vec::new());
    let drawn = check(gpu, "rows", &frame, spec_of(&frame));
    assert_eq!(drawn.image.pixel(16, 17)[3], 0.0);
    assert!(drawn.image.pixel(16, 16)[3] > 0.0);
    // Depths at which the series takes over from the exponential.
    for tau in [FAINT, FAINT.next_up()] {
        let frame = by_hand(vec![round(tau, 25.0); 40], Vec::new());
        check(gpu, "faint", &frame, spec_of(&frame));
    }
    // Opacities of one half reach one half with the first kernel, not before.
    let layer = |depth: f32, tau: f32| Footprint {
        depth,
        form_p: [0.0; 2],
        form_r: [0.0; 2],
        path: PATH_PEAK,
        ..round(tau, 1.0)
    };
    let half = by_hand(
        vec![layer(1.0, 0.25), layer(2.0, 1.0 / 3.0), layer(4.0, 0.1)],
        Vec::new(),
    );
    let mut spec = spec_of(&half);
    spec.axes.depth = true;
    let drawn = check(gpu, "half", &half, spec);
    let depths = drawn.depth.unwrap().depths;
    assert!(depths.iter().all(|d| *d == depths[0]), "{depths:?}");
    // An opaque layer stops a tile, but only at the next check.
    for count in [
        TERMINATION_INTERVAL,
        TERMINATION_INTERVAL + 1,
        3 * TERMINATION_INTERVAL,
    ] {
        let mut layers = vec![layer(1.0, 1.0)];
        layers.resize(count, layer(2.0, 0.5));
        let frame = by_hand(layers, Vec::new());
        let drawn = check(gpu, "opaque", &frame, spec_of(&frame));
        assert_eq!(
            drawn.splat_pixels,
            40 * 24 * TERMINATION_INTERVAL.min(count) as u64
        );
    }
}

#[test]
fn what_is_no_number_is_outside() {
    let Some(gpu) = gpu() else { return };
    let mut footprints = vec![round(0.3, 9.0)];
    let mut exact = vec![ExactTerms::default()];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38, 1e-40] {
        let base = round(0.5, 9.0);
        for footprint in [
            Footprint {
                form_p: [bad, 0.0],
                ..base
            },
            Footprint {
                form_r: [0.0, bad],
                ..base
            },
            Footprint {
                centre_px: [bad, 3.0],
                ..base
            },
        ] {
            footprints.push(footprint);
            exact.push(ExactTerms::default());
        }
        for terms in [
            ExactTerms {
                gradient: [bad, 0.0],
                ..ExactTerms::default()
            },
            ExactTerms {
                hessian: [0.0, bad, 0.0],
                ..ExactTerms::default()
            },
            ExactTerms {
                hessian: [-bad, 0.0, -1.0],
                ..ExactTerms::default()
            },
        ] {
            footprints.push(Footprint {
                path: PATH_EXACT,
                ..base
            });
            exact.push(terms);
        }
    }
    let frame = by_hand(footprints, exact);
    let drawn = check(gpu, "poison", &frame, spec_of(&frame));
    assert!(drawn.image.pixels.iter().flatten().all(|c| c.is_finite()));
}

#[test]
fn a_hundred_thousand_faint_layers_add_up() {
    let Some(gpu) = gpu() else { return };
    // 1e5 layers of 1e-5: 1 - exp(-1), and the colour times that.
    let frame = by_hand(
        vec![
            Footprint {
                form_p: [0.0; 2],
                form_r: [0.0; 2],
                ..round(1e-5, 1.0)
            };
            100_000
        ],
        Vec::new(),
    );
    let drawn = on_gpu(gpu, &frame, &frame.bins(), spec_of(&frame), 1, None);
    let expected = -(-1.0_f32).exp_m1();
    for pixel in &drawn.image.pixels {
        // A sum of 1e5 terms near .6, each rounded by 2^-25 at random: 1e-5, on both back ends.
        assert!((pixel[3] - expected).abs() < 2e-5, "{}", pixel[3]);
    }
}

#[test]
fn thousands_of_kernels_round_the_eye_add_up() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [20, 12]);
    let mut random = Random::new(5);
    let particles: Vec<Particle> = (0..8_000)
        .map(|_| Particle {
            position: random.point(0.2),
            factor: random.factor(0.3, 2.0),
            mass: 1e-5,
            colour: [0.4, 0.9, 0.2],
        })
        .collect();
    let frame = Frame::new(volume(&particles), &camera, &Settings::default());
    assert!(frame.near.len() > 7_000, "{}", frame.near.len());
    check(gpu, "round the eye", &frame, spec_of(&frame));
}

/// Returns the sum of kernels in a picture of counts, whose pixels must all be numbers.
fn sum_of_counts(image: &Image) -> u64 {
    let count = |p: &[f32; 4]| {
        assert_eq!(*p, [p[0].trunc(), p[0], p[0], 1.0]);
        p[0] as u64
    };
    image.pixels.iter().map(count).sum()
}

#[test]
fn counts_are_equal_and_add_up() {
    let Some(gpu) = gpu() else { return };
    let perspective = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [203, 117]);
    let orthographic =
        Camera::orthographic(DVec3::Z * 1.5, DVec3::Z * 2.0, -DVec3::Y, 3.0, [130, 95]);
    // Black leaves the numbers unchanged.
    let background = Some([0.0; 3]);
    for (camera, spread) in [
        (&perspective, 1.5),
        (&perspective, 0.9),
        (&orthographic, 0.4),
    ] {
        for filter in [Filter::Ewa, Filter::Adaptive] {
            let settings = Settings {
                filter,
                ..Settings::default()
            };
            let frame = frame(6, 2000, spread, camera, &settings);
            let bins = frame.bins();
            for depth in [false, true] {
                let mut shown = spec_of(&frame);
                shown.axes.depth = depth;
                let mut spec = shown;
                spec.axes.count = true;
                let on_cpu = on_cpu(&frame, &bins, spec, background);
                assert_eq!(sum_of_counts(&on_cpu.image), on_cpu.splat_pixels);
                for chunks in [1, 3] {
                    let scene = on_gpu(gpu, &frame, &bins, shown, chunks, None);
                    let on_gpu = on_gpu(gpu, &frame, &bins, spec, chunks, background);
                    assert_eq!(sum_of_counts(&on_gpu.image), on_gpu.splat_pixels);
                    assert_eq!(on_gpu.splat_pixels, scene.splat_pixels);
                    let depths = |drawn: &Drawn| drawn.depth.as_ref().map(|d| d.depths.clone());
                    assert_eq!(depths(&on_gpu), depths(&scene));
                    let pairs = on_cpu.image.pixels.iter().zip(&on_gpu.image.pixels);
                    if frame.near.is_empty() {
                        let differ = pairs.filter(|(a, b)| a != b).count();
                        println!("{spread}, {filter:?}: {differ} pixels differ");
                        let (a, b) = (&on_cpu.image, &on_gpu.image);
                        assert_eq!(explained_flips(&frame, &bins, a, b, 0.0), differ);
                        assert!(differ <= a.pixels.len() / 1000);
                    } else {
                        // A kernel behind the eye counts until its depth underflows, which happens
                        // sooner on the device.
                        let differ: f32 = pairs.map(|(a, b)| (a[0] - b[0]).abs()).sum();
                        println!("{spread}, {filter:?}: {differ} counts differ");
                        assert!(differ <= on_cpu.splat_pixels as f32 / 100.0);
                    }
                }
            }
        }
    }
}

#[test]
fn a_renderer_counts_on_either_back_end() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [70, 50]);
    let scene = volume(&particles(7, 500, 0.9));
    let mut on_cpu = Renderer::new(vec![scene.clone()]).unwrap();
    let on_gpu = Renderer::new(vec![scene]).unwrap();
    let mut on_gpu = on_gpu.on(gpu.clone()).unwrap();
    let shown = Settings {
        background: Some([0.2, 0.4, 0.8]),
        advanced: Advanced {
            simd: SimdLevel::Baseline,
            ..Advanced::default()
        },
        ..Settings::default()
    };
    let counted = Settings {
        show: Show::Count,
        ..shown.clone()
    };
    // The scene is drawn before and after.
    let before = on_gpu.render(&camera, &shown).unwrap().clone();
    let counts = on_gpu.render(&camera, &counted).unwrap().clone();
    assert_eq!(sum_of_counts(&counts), on_gpu.counts().splat_pixels);
    assert_eq!(*on_gpu.render(&camera, &shown).unwrap(), before);
    on_cpu.render(&camera, &counted).unwrap();
    let sum = sum_of_counts(on_cpu.image());
    assert_eq!(sum, on_cpu.counts().splat_pixels);
    assert!(sum > 20_000, "{sum}");
    let pairs = on_cpu.image().pixels.iter().zip(&counts.pixels);
    let differ = pairs.filter(|(a, b)| a != b).count();
    println!("{differ} of {} pixels differ", counts.pixels.len());
    // Each lies at a cut-off that rounding moves: one in a thousand.
    assert!(differ <= counts.pixels.len() / 1000, "{differ}");
}
