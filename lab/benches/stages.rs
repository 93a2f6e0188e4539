//! Times each stage of a frame: 200,000 random ellipsoids of about 2 px at 512 x 512. Also times whole column densities
//! of as many ellipsoids, and of spheres.
#![allow(
    missing_docs,
    clippy::cast_possible_truncation,
    reason = "criterion's macros write the entry point; inputs are narrowed on purpose"
)]

#[path = "../../tests/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::Duration;

use common::Random;
use common::frame::Frame;
use common::scene::{self, Particle, volume};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ewa_splat::Filter;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::stages::blocks::{BlockedVolume, cull};
use ewa_splat::stages::cpu::{
    Bins, RasteriseSettings, Tile, bin, classify, count_classified, rasterise, resolve, sort,
};
use ewa_splat::stages::record::ChoiceUniform;
use ewa_splat::stages::splat::Axes;
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{ColumnSettings, Image, Renderer, Settings};
use glam::DVec3;

const COUNT: usize = 200_000;
const SIZE: usize = 512;
/// Distance of the cloud's middle, in half sides of the cloud: the image shows all of it.
const DISTANCE: f64 = 3.5;
const FOCAL: f64 = 600.0;

fn camera() -> Camera {
    scene::camera(Projection::Perspective, [FOCAL; 2], [SIZE; 2])
}

/// Axis ratios up to 5, largest standard deviations about 3 px, geometric means about 2 px.
fn cloud() -> PointVolume {
    let mut random = Random::new(1);
    let pixel = DISTANCE / FOCAL;
    let particles: Vec<Particle> = (0..COUNT)
        .map(|_| {
            let ratio = random.log_range(1.0, 5.0);
            Particle {
                position: random.point(1.0) + DVec3::Z * DISTANCE,
                factor: random.factor(2.0 * ratio.sqrt() * pixel, ratio),
                mass: (0.3 * pixel * pixel) as f32,
                colour: [0.9, 0.6, 0.3],
            }
        })
        .collect();
    volume(&particles)
}

fn settings(filter: Filter) -> Settings {
    Settings {
        filter,
        ..Settings::default()
    }
}

fn stages(c: &mut Criterion) {
    let scene = cloud();
    let camera = camera();
    let mut group = c.benchmark_group("stages");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));

    group.throughput(Throughput::Elements(COUNT as u64));
    group.bench_function("build blocks", |b| {
        b.iter_batched(
            || scene.clone(),
            |scene| black_box(BlockedVolume::new(scene)),
            criterion::BatchSize::LargeInput,
        );
    });

    let mut frame = Frame::new(scene.clone(), &camera, &settings(Filter::Ewa));
    group.throughput(Throughput::Elements(frame.volume.blocks.len() as u64));
    let mut views = Vec::new();
    let choice: ChoiceUniform = bytemuck::Zeroable::zeroed();
    group.bench_function("cull", |b| {
        b.iter(|| {
            cull(
                &frame.volume,
                &camera,
                Some(&frame.frustum),
                &choice,
                black_box(&mut views),
            )
        });
    });

    let particles = frame.classified.len() as u64;
    group.throughput(Throughput::Elements(particles));
    let mut views = frame.views.clone();
    let mut classified = frame.classified.clone();
    group.bench_function("classify, masses given", |b| {
        b.iter(|| {
            count_classified(&frame.volume, &mut views);
            classify(&frame.volume, &views, black_box(&mut classified));
        });
    });

    group.bench_function("project, affine", |b| b.iter(|| frame.project()));
    let mut exact = Frame::new(scene.clone(), &camera, &settings(Filter::Exact));
    group.bench_function("project, exact", |b| b.iter(|| exact.project()));
    exact.uniform.filter_kind = Filter::Adaptive as u32;
    group.bench_function("project, adaptive", |b| b.iter(|| exact.project()));
    exact.uniform.filter_kind = Filter::Exact as u32;
    exact.project();
    let round = Frame::new(scene, &camera, &settings(Filter::Isotropic));

    let mut order = Vec::new();
    group.throughput(Throughput::Elements(frame.order.len() as u64));
    group.bench_function("sort", |b| {
        b.iter(|| sort(&frame.footprints, black_box(&mut order)))
    });

    let mut bins = Bins::default();
    for (name, frame) in [("affine", &frame), ("exact", &exact)] {
        group.throughput(Throughput::Elements(frame.bins().len() as u64));
        group.bench_function(format!("bin, {name}"), |b| {
            b.iter(|| {
                bin(
                    &frame.footprints,
                    frame.terms(),
                    &frame.order,
                    frame.tiles[0],
                    0..frame.tiles[0] * frame.tiles[1],
                    &mut bins,
                );
            });
        });
    }

    let mut tiles = vec![Tile::default(); frame.tiles[0] * frame.tiles[1]];
    for (name, frame) in [("affine", &frame), ("exact", &exact), ("round", &round)] {
        let bins = frame.bins();
        let raster = RasteriseSettings {
            axes: Axes {
                linear_opacity: false,
                depth: false,
                count: false,
                may_be_exact: frame.any_exact,
                ..Axes::default()
            },
            level: frame.settings.advanced.simd,
            ends: None,
            task: None,
        };
        let mut draw = || {
            rasterise(
                &frame.uniform,
                raster,
                &frame.footprints,
                &frame.exact,
                &frame.near,
                &bins,
                frame.tiles[0],
                &[],
                None,
                &mut tiles,
            )
        };
        group.throughput(Throughput::Elements(draw()));
        group.bench_function(format!("rasterise, {name}"), |b| b.iter(&mut draw));
    }

    let mut image = Image::new(SIZE, SIZE);
    group.throughput(Throughput::Elements((SIZE * SIZE) as u64));
    group.bench_function("resolve", |b| {
        b.iter(|| resolve(&tiles, Some([0.1; 3]), false, black_box(&mut image)));
    });
    group.finish();
}

fn column_density(c: &mut Criterion) {
    let mut group = c.benchmark_group("column density");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    let camera = scene::camera(Projection::Orthographic, [FOCAL / DISTANCE; 2], [SIZE; 2]);
    let mut random = Random::new(2);
    let mut ellipsoids = cloud();
    // The whole cloud lies in front of the plane of the eye.
    if let Particles::Anisotropic { positions, .. } = &mut ellipsoids.particles {
        for position in positions {
            position.z += DISTANCE;
        }
    }
    let spheres = PointVolume {
        particles: Particles::Isotropic {
            positions: (0..COUNT)
                .map(|_| random.point(1.0) + DVec3::Z * (2.0 * DISTANCE))
                .collect(),
            sigmas: (0..COUNT)
                .map(|_| (random.log_range(1.0, 10.0) * DISTANCE / FOCAL) as f32)
                .collect(),
        },
        strength: Strength::Mass(vec![1.0; COUNT]),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    };
    let settings = ColumnSettings::default();
    for (name, scene) in [
        ("ellipsoids of 2 px", ellipsoids),
        ("spheres of 1 to 10 px", spheres),
    ] {
        let Ok(mut renderer) = Renderer::new(vec![scene]) else {
            continue;
        };
        let mut draw = || renderer.column_density(&camera, &settings).is_ok();
        assert!(draw(), "a frame");
        group.bench_function(name, |b| b.iter(&mut draw));
    }
    group.finish();
}

criterion_group!(benches, stages, column_density);
criterion_main!(benches);
