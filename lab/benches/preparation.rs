//! Times each step of a command before its first frame: reading a file, sampling it into particles, and sorting these
//! into blocks with their levels of detail. The data are those of `lab/examples/time_to_picture`, smaller, and read
//! from memory: no disk is timed.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    reason = "criterion's macros write the entry point; data that cannot be made end the benchmark"
)]

#[allow(
    dead_code,
    reason = "the example, which these data are shared with, needs more of them"
)]
#[path = "../examples/time_to_picture/files.rs"]
mod files;
#[path = "../examples/scenes/mod.rs"]
mod scenes;

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{
    BatchSize, BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main,
};
use ewa_splat::io::{self, Dataset, OpenOptions, RawLayout, RawType};
use ewa_splat::sample::mesh::Spread;
use ewa_splat::sample::{self, BoundaryChoice, KernelOptions, PurposeOptions, SampleOptions};
use ewa_splat::scene::PointVolume;
use ewa_splat::{Renderer, SceneOptions};

const SPH_COUNT: usize = 100_000;
const GRID_NODES: usize = 64;
/// Cubes along each axis, six tetrahedra each: 48,000.
const TETRAHEDRA_CUBES: usize = 20;
const SURFEL_COUNT: usize = 100_000;
const ELLIPSOID_COUNT: usize = 200_000;
const LATTICE_SIDE: usize = 128;

/// Few samples: the slowest steps take a second, and differences of a tenth are looked for.
fn group<'a>(c: &'a mut Criterion, name: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = c.benchmark_group(name);
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
    group
}

/// Returns the bytes of a file.
fn written(write: impl FnOnce(&mut Vec<u8>) -> std::io::Result<()>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes).unwrap();
    bytes
}

fn sph() -> Vec<u8> {
    written(|out| files::write_sph(out, SPH_COUNT))
}

fn curvilinear() -> Vec<u8> {
    written(|out| files::write_curvilinear(out, GRID_NODES))
}

fn tetrahedra() -> Vec<u8> {
    written(|out| files::write_tetrahedra(out, TETRAHEDRA_CUBES))
}

fn read(name: &str, bytes: &[u8]) -> Dataset {
    io::read(name, bytes, &OpenOptions::default()).unwrap()
}

/// Options of the program without arguments.
fn options() -> SampleOptions {
    SampleOptions {
        kernels: KernelOptions {
            boundary: BoundaryChoice::Automatic,
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    }
}

fn reading(c: &mut Criterion) {
    let mut group = group(c, "read");
    for (name, file, bytes) in [
        ("particles, .npy", "sph.npy", sph()),
        ("curvilinear grid, .vts", "sector.vts", curvilinear()),
        ("tetrahedra, .vtu", "tetrahedra.vtu", tetrahedra()),
    ] {
        group.throughput(Throughput::Bytes(bytes.len() as u64));
        group.bench_function(name, |b| b.iter(|| read(file, black_box(&bytes))));
    }
    group.finish();
}

fn sampling(c: &mut Criterion) {
    let mut group = group(c, "sample");
    let folder = tempfile::tempdir().unwrap();
    let textured_box = files::textured_box(folder.path()).unwrap();
    let by_density = || SampleOptions {
        field: Some("rho".into()),
        ..options()
    };
    for (name, data, options) in [
        ("SPH particles", read("sph.npy", &sph()), by_density()),
        (
            "SPH particles, for column densities",
            read("sph.npy", &sph()),
            SampleOptions {
                purpose: PurposeOptions {
                    for_columns: true,
                    local_models: false,
                    ..by_density().purpose
                },
                ..by_density()
            },
        ),
        (
            "curvilinear grid",
            read("sector.vts", &curvilinear()),
            options(),
        ),
        (
            "tetrahedra",
            read("tetrahedra.vtu", &tetrahedra()),
            options(),
        ),
        (
            "textured mesh",
            io::open(&textured_box, &OpenOptions::default()).unwrap(),
            SampleOptions {
                kernels: KernelOptions {
                    spread: Spread::Count(SURFEL_COUNT),
                    ..options().kernels
                },
                ..options()
            },
        ),
    ] {
        let sampled = sample::scene(data.clone(), &options).unwrap();
        let count: usize = sampled.volumes.iter().map(|v| v.particles.len()).sum();
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(name, |b| {
            b.iter_batched(
                || data.clone(),
                |data| sample::scene(data, &options),
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

fn lattice() -> PointVolume {
    let bytes = written(|out| files::write_lattice(out, LATTICE_SIDE));
    let layout = RawLayout::new([LATTICE_SIDE; 3], RawType::U8);
    let open = OpenOptions {
        raw: Some(layout),
        ..OpenOptions::default()
    };
    let data = io::read("lattice.raw", &bytes, &open).unwrap();
    sample::volume(data, &options()).unwrap().volume
}

fn preparing(c: &mut Criterion) {
    let mut group = group(c, "prepare");
    for (name, volume) in [
        ("ellipsoids", scenes::particles(ELLIPSOID_COUNT, 512, 2.0)),
        ("lattice of bytes", lattice()),
    ] {
        group.throughput(Throughput::Elements(volume.particles.len() as u64));
        for (detail, level_of_detail) in [("with", true), ("without", false)] {
            let options = SceneOptions {
                level_of_detail,
                ..SceneOptions::default()
            };
            group.bench_function(format!("{name}, {detail} levels of detail"), |b| {
                b.iter_batched(
                    || vec![volume.clone()],
                    |scene| Renderer::with_options(scene, &options),
                    BatchSize::LargeInput,
                );
            });
        }
    }
    group.finish();
}

criterion_group!(benches, reading, sampling, preparing);
criterion_main!(benches);
