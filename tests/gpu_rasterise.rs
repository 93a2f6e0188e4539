//! The rasteriser and the background on the GPU against the CPU's, fed with the same lists.
#![cfg(feature = "gpu")]
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

mod common;

use common::Random;
use common::frame::Frame;
use common::gpu::gpu;
use common::scene::{Particle, volume};
use ewa_splat::Settings;
use ewa_splat::cpu::{self, Bins, RasteriseSettings, SimdLevel, Tile};
use ewa_splat::gpu::{Gpu, RasterSpec, rasterise};
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::layout::{PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK};
use ewa_splat::splat::Filter;
use ewa_splat::view::Camera;
use glam::DVec3;

/// The stages' last results on the CPU.
struct Drawn {
    image: Image,
    depth: Option<DepthImage>,
    splat_pixels: u64,
}

fn on_cpu(frame: &Frame, bins: &Bins, spec: RasterSpec, background: Option<[f32; 3]>) -> Drawn {
    let [width, height] = frame.uniform.size.map(|n| n as usize);
    let mut tiles = vec![Tile::default(); frame.tiles[0] * frame.tiles[1]];
    let settings = RasteriseSettings {
        linear_opacity: spec.linear_opacity,
        depth: spec.depth,
        exact: spec.exact,
        // No fused operations: the order of roundings of the plainest code.
        level: SimdLevel::Baseline,
    };
    let splat_pixels = cpu::rasterise(
        &frame.uniform,
        settings,
        &frame.footprints,
        &frame.exact,
        &frame.near,
        bins,
        frame.tiles[0],
        &mut tiles,
    );
    let mut image = Image::new(width, height);
    cpu::resolve(&tiles, background, &mut image);
    Drawn {
        image,
        depth: spec
            .depth
            .then(|| cpu::resolve_depth(&tiles, width, height)),
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
        background,
    )
    .unwrap();
    Drawn {
        image,
        depth,
        splat_pixels,
    }
}

/// Ellipsoids before and around the eye.
fn frame(seed: u64, count: usize, spread: f64, camera: &Camera, settings: &Settings) -> Frame {
    let mut random = Random::new(seed);
    let particles: Vec<Particle> = (0..count)
        .map(|_| {
            let size = random.log_range(3e-3, 0.3);
            Particle {
                position: random.point(spread) + DVec3::Z * 2.0,
                factor: random.factor(size, 8.0),
                mass: (size * size * random.log_range(0.01, 20.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect();
    Frame::new(volume(&particles), camera, settings)
}

#[test]
fn probe() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [203, 117]);
    for filter in [Filter::Ewa, Filter::Exact, Filter::Adaptive] {
        for depth in [false, true] {
            let settings = Settings {
                filter,
                depth,
                ..Settings::default()
            };
            let frame = frame(3, 2000, 1.5, &camera, &settings);
            let bins = frame.bins();
            let spec = RasterSpec {
                exact: frame.any_exact,
                near: !frame.near.is_empty(),
                depth,
                linear_opacity: false,
            };
            for chunks in [1, 3] {
                let a = on_cpu(&frame, &bins, spec, None);
                let b = on_gpu(gpu, &frame, &bins, spec, chunks, None);
                let worst = common::scene::difference(&a.image, &b.image);
                let n = a
                    .image
                    .pixels
                    .iter()
                    .zip(&b.image.pixels)
                    .filter(|(a, b)| a.iter().zip(*b).any(|(x, y)| (x - y).abs() > 2e-5))
                    .count();
                let same = a
                    .image
                    .pixels
                    .iter()
                    .zip(&b.image.pixels)
                    .filter(|(a, b)| a == b)
                    .count();
                println!(
                    "{filter:?} {depth} {chunks}: worst {worst}, over {n}, same {same} of {}, near {}, splat-pixels {} {}",
                    a.image.pixels.len(),
                    frame.near.len(),
                    a.splat_pixels,
                    b.splat_pixels
                );
                if depth {
                    println!(
                        "depths differ {}",
                        a.depth
                            .as_ref()
                            .unwrap()
                            .depths
                            .iter()
                            .zip(&b.depth.as_ref().unwrap().depths)
                            .filter(|(a, b)| a != b)
                            .count()
                    );
                }
            }
        }
    }
}
