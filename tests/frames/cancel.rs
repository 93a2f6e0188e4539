//! Tests long work: it reports progress, gives the same result with or without an observer, and
//! ends if cancelled in any of its stages.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::fmt::Debug;
use std::path::Path;
use std::sync::{Arc, Mutex};

use ewa_splat::io::{Association, CellKind, CellMesh, Dataset, Geometry, Mesh, OpenOptions, open};
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceSettings};
use ewa_splat::render::Composite;
use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
use ewa_splat::sample::{
    KernelOptions, ParticleShape, PurposeOptions, SampleOptions, SampledScene, points, scene,
};
use ewa_splat::scene::{Lattice, PointVolume, TransferFunction};
use ewa_splat::view::Camera;
use ewa_splat::{ColumnSettings, Error, Renderer, Result, SceneOptions, Settings, Task};
use glam::DVec3;

use crate::common::{Random, scalar};

/// Runs `work` unobserved, observed, and cancelled at the beginning of each of the `expected`
/// stages.
fn check<T: Debug + PartialEq>(
    name: &str,
    expected: &[&str],
    mut work: impl FnMut(Option<Task>) -> Result<T>,
) {
    let alone = work(None).unwrap();
    let told = Arc::new(Mutex::new(Vec::new()));
    let listener = Arc::clone(&told);
    let task = Task::observed(move |progress| listener.lock().unwrap().push(progress));
    assert!(work(Some(task)).unwrap() == alone, "{name}: watched");
    let told = std::mem::take(&mut *told.lock().unwrap());
    let mut stages: Vec<&str> = told.iter().map(|p| p.stage).collect();
    stages.dedup();
    assert_eq!(stages, expected, "{name}");
    for stage in told.chunk_by(|a, b| a.stage == b.stage) {
        assert!(stage[0].done <= 0.0, "{name}: {:?}", stage[0]);
        let most = stage.iter().map(|p| p.done).fold(0.0, f64::max);
        assert!(most >= 1.0, "{name}: {} ends at {most}", stage[0].stage);
    }
    // Some stages occur several times.
    for last in 0..stages.len() {
        let told = Arc::new(Mutex::new(Vec::<&str>::new()));
        let listener = Arc::clone(&told);
        let own = Arc::new(Mutex::new(Task::new()));
        let held = Arc::clone(&own);
        let task = Task::observed(move |progress| {
            let mut told = listener.lock().unwrap();
            if told.last() != Some(&progress.stage) {
                told.push(progress.stage);
            }
            if told.len() == last + 1 {
                held.lock().unwrap().cancel();
            }
        });
        *own.lock().unwrap() = task.clone();
        let result = work(Some(task.clone()));
        assert!(
            matches!(result, Err(Error::Cancelled)),
            "{name}: {result:?}"
        );
        assert!(task.is_cancelled());
        let told = told.lock().unwrap();
        assert_eq!(
            *told,
            stages[..=last],
            "{name}: goes on after {}",
            stages[last]
        );
    }
    assert!(
        work(None).unwrap() == alone,
        "{name}: after it was cancelled"
    );
}

fn fixture(name: &str) -> Dataset {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name);
    open(&path, &OpenOptions::default()).unwrap()
}

/// Formats a sampled scene to the bit.
fn text(sampled: &SampledScene) -> String {
    format!("{:?}", sampled.volumes)
}

fn cloud(count: usize) -> Vec<DVec3> {
    let mut random = Random::new(7);
    (0..count).map(|_| random.point(1.0)).collect()
}

/// Returns balls of one colour that fill a cube.
fn balls(count: usize) -> PointVolume {
    PointVolume::spheres(cloud(count), vec![0.05; count])
        .with_masses(vec![1e-3; count])
        .with_colour([1.0, 0.5, 0.2])
}

fn camera() -> Camera {
    let eye = DVec3::new(0.0, -6.0, 1.0);
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, [96, 64])
}

#[test]
fn sampling() {
    let values = |count: usize| (0..count).map(|i| i as f32).collect::<Vec<_>>();
    let shapes = [
        (
            ParticleShape::Isotropic,
            vec![
                "finding neighbours",
                "shaping kernels",
                "fitting local models",
            ],
        ),
        (
            ParticleShape::Covariance,
            vec![
                "finding neighbours",
                "shaping kernels",
                "fitting local models",
            ],
        ),
    ];
    for (shape, expected) in shapes {
        check(&format!("{shape:?}"), &expected, |task| {
            let options = SampleOptions {
                kernels: KernelOptions {
                    shape,
                    ..KernelOptions::default()
                },
                task,
                ..SampleOptions::default()
            };
            let sampled = points(cloud(6000), values(6000), &options)?;
            Ok(format!("{:?}", sampled.volume))
        });
    }
    let corrected = [
        "finding neighbours",
        "shaping kernels",
        "summing kernels",
        "fitting gradients",
        "fitting local models",
    ];
    check("corrected", &corrected, |task| {
        let options = SampleOptions {
            kernels: KernelOptions {
                shape: ParticleShape::Isotropic,
                shepard_passes: 1,
                ..KernelOptions::default()
            },
            purpose: PurposeOptions {
                normals: true,
                ..PurposeOptions::default()
            },
            task,
            ..SampleOptions::default()
        };
        Ok(format!(
            "{:?}",
            points(cloud(6000), values(6000), &options)?.volume
        ))
    });
}

#[test]
fn sampling_of_files() {
    for (name, expected) in [
        ("wake.xyz", &["shaping kernels", "fitting local models"][..]),
        ("vase.obj", &["spreading surfels", "shaping surfels"]),
        ("swift.h5", &["shaping kernels", "fitting local models"]),
    ] {
        check(name, expected, |task| {
            let options = SampleOptions {
                kernels: KernelOptions {
                    spread: Spread::Count(2000),
                    ..KernelOptions::default()
                },
                task,
                ..SampleOptions::default()
            };
            Ok(text(&scene(fixture(name), &options)?))
        });
    }
}

#[test]
fn sampling_of_cells() {
    let mut mesh = CellMesh::default();
    let [nx, ny, nz] = [5, 4, 2];
    let node = |i: u32, j: u32, k: u32| i + nx * (j + ny * k);
    for n in 0..nx * ny * nz {
        let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)].map(f64::from);
        mesh.nodes.push(DVec3::new(i, j, k));
    }
    mesh.offsets.push(0);
    for (i, j) in (0..nx - 1).flat_map(|i| (0..ny - 1).map(move |j| (i, j))) {
        mesh.kinds.push(CellKind::HEXAHEDRON);
        for k in [0, 1] {
            let face = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
            mesh.connectivity.extend(face.map(|[i, j]| node(i, j, k)));
        }
        mesh.offsets.push(mesh.connectivity.len() as u32);
    }
    let values = (0..mesh.nodes.len()).map(|i| i as f32).collect();
    let field = scalar("value", Association::Nodes, values);
    let geometry = Geometry::Cells(mesh);
    let dataset = Dataset::new(Path::new("cells"), "cells", geometry, vec![field]);
    check(
        "cells",
        &["cutting cells", "shaping kernels", "fitting local models"],
        |task| {
            let options = SampleOptions {
                task,
                ..SampleOptions::default()
            };
            Ok(text(&scene(dataset.clone(), &options)?))
        },
    );
}

/// Returns a ball of values on a lattice.
fn lattice() -> PointVolume {
    let n = 24;
    let value = |i: usize| {
        let cell = [i % n, i / n % n, i / (n * n)].map(|c| (c as f32 - 11.5) / 12.0);
        1.0 - cell.iter().map(|c| c * c).sum::<f32>().sqrt().min(1.0)
    };
    let values: Vec<f32> = (0..n * n * n).map(value).collect();
    let grey = TransferFunction::from_curves(|v| [v; 3], |v| 0.3 * v, [0.0, 1.0], 0.1).unwrap();
    let step = DVec3::splat(2.0 / n as f64);
    let lattice = Lattice::uniform([n; 3], DVec3::splat(-1.0), step);
    PointVolume::lattice(lattice, values, grey)
}

#[test]
fn blocks_and_levels() {
    let volumes = [
        (
            balls(20_000),
            &["sorting into blocks", "levels of detail"][..],
        ),
        (lattice(), &["levels of detail"]),
    ];
    for (volume, expected) in volumes {
        for keep_shapes in [false, true] {
            check("levels", expected, |task| {
                let options = SceneOptions {
                    level_of_detail: true,
                    keep_shapes,
                    keep_indices: true,
                    task,
                };
                let mut renderer = Renderer::with_options(vec![volume.clone()], &options)?;
                Ok(renderer.render(&camera(), &Settings::default())?.clone())
            });
        }
    }
}

/// Returns two crossing squares of surfels, and balls around them.
fn hybrid() -> Vec<PointVolume> {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let corners = corners.map(|[x, z]| DVec3::new(x, 0.4 * x, z));
    let mesh = Mesh::of_triangles(corners, [[0, 1, 2], [0, 2, 3]]);
    let options = MeshOptions {
        spread: Spread::Spacing(0.1),
        ..MeshOptions::default()
    };
    let mut volumes = surfels(&mesh, &options).unwrap().volumes;
    volumes.push(balls(2000));
    volumes
}

/// Checks frames, on the CPU unless `on` moves the renderer elsewhere.
fn frames(drawing: &[&str], hybrids: &[&str], on: impl Fn(Renderer) -> Renderer) {
    for composite in Composite::ALL {
        let mut renderer = on(Renderer::new(vec![balls(2000)]).unwrap());
        check(&format!("{composite:?}"), drawing, |task| {
            let settings = Settings {
                composite,
                task,
                ..Settings::default()
            };
            Ok(renderer.render(&camera(), &settings)?.clone())
        });
    }
    let mut renderer = on(Renderer::new(hybrid()).unwrap());
    check("hybrid", hybrids, |task| {
        let settings = Settings {
            task,
            depth: true,
            normals: true,
            ..Settings::default()
        };
        let image = renderer.render(&camera(), &settings)?.clone();
        Ok((
            image,
            renderer.depth().cloned(),
            renderer.normals().cloned(),
        ))
    });
}

#[test]
fn frames_of_the_cpu() {
    frames(&["drawing"], &["drawing surfaces", "drawing"], |r| r);
    let mut renderer = Renderer::new(vec![balls(2000)]).unwrap();
    check("column", &["summing"], |task| {
        let settings = ColumnSettings {
            task,
            ..ColumnSettings::default()
        };
        Ok(renderer.column_density(&camera(), &settings)?.clone())
    });
}

#[cfg(feature = "gpu")]
#[test]
fn frames_of_a_device() {
    let Some(gpu) = crate::common::gpu::gpu() else {
        return;
    };
    frames(&["drawing"], &["drawing"], |r| r.on(gpu.clone()).unwrap());
    // Cancelled work is not drawn again elsewhere.
    let mut renderer = Renderer::new(vec![balls(50)])
        .unwrap()
        .on(ewa_splat::render::OpenBackend::or_cpu(gpu.clone()))
        .unwrap();
    let task = Task::new();
    task.cancel();
    let settings = Settings {
        task: Some(task),
        ..Settings::default()
    };
    let result = renderer.render(&camera(), &settings);
    assert!(matches!(result, Err(Error::Cancelled)), "{result:?}");
    assert_eq!(renderer.fallback(), None);
}

#[test]
fn picking() {
    let options = SceneOptions {
        keep_indices: true,
        ..SceneOptions::default()
    };
    let mut renderer = Renderer::with_options(vec![balls(500)], &options).unwrap();
    let task = Task::new();
    let mut settings = Settings {
        task: Some(task.clone()),
        ..Settings::default()
    };
    assert!(
        !renderer
            .pick(&camera(), &settings, [48, 32])
            .unwrap()
            .is_empty()
    );
    task.cancel();
    let result = renderer.pick(&camera(), &settings, [48, 32]);
    assert!(matches!(result, Err(Error::Cancelled)), "{result:?}");
    settings.task = None;
    assert!(renderer.pick(&camera(), &settings, [48, 32]).is_ok());
}

#[test]
fn the_reference() {
    let integrator = Integrator::new(&[balls(20)]).unwrap();
    let camera = Camera::perspective(DVec3::Y * -6.0, DVec3::ZERO, DVec3::Z, 30.0, [20, 14]);
    for pixel_filter in [PixelFilter::Image, PixelFilter::Kernels] {
        check(&format!("{pixel_filter:?}"), &["integrating"], |task| {
            let settings = ReferenceSettings {
                error: 1e-2,
                pixel_filter,
                task,
                ..ReferenceSettings::default()
            };
            Ok(integrator.render(&camera, &settings)?.image)
        });
    }
}
