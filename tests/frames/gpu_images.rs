//! Compares whole pictures of the GPU back end with the CPU's on every fixture and every real data
//! set, with every filter, and split in every way that a smaller adapter would require.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::path::{Path, PathBuf};

use crate::common::gpu::{ALIKE, assert_alike, gpu, pictures};
use crate::common::scene::{Particle, difference, volume};
use crate::common::{Random, real_data, some};
use ewa_splat::Filter;
use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::render::{Advanced, Gpu};
use ewa_splat::sample::{FunctionOptions, SampleOptions, TransferChoice, volume as sample};
use ewa_splat::scene::{
    Classification, Lattice, LatticeSpacing, Particles, PointVolume, Strength, TransferFunction,
    Values,
};
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Backend, Renderer, Settings, Show};
use glam::{DMat3, DVec3};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name)
}

fn read_with(path: &Path, open_options: &OpenOptions, options: &SampleOptions) -> PointVolume {
    sample(open(path, open_options).unwrap(), options)
        .unwrap()
        .volume
}

fn read(path: &Path) -> PointVolume {
    read_with(path, &OpenOptions::default(), &SampleOptions::default())
}

fn wake() -> PointVolume {
    let options = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::File(fixture("wake_transfer.json")),
            ..FunctionOptions::default()
        },
        ..SampleOptions::default()
    };
    read_with(&fixture("wake.xyz"), &OpenOptions::default(), &options)
}

/// Returns the camera that the command line fits, at a size that a software adapter draws quickly.
fn fitted(scene: &PointVolume, lens: Lens, size: [usize; 2]) -> Camera {
    let renderer = Renderer::new(vec![scene.clone()]).unwrap();
    let viewpoint = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 25.0,
        zoom: 1.0,
        up: DVec3::Z,
    };
    viewpoint
        .camera(&renderer.visible_boxes(), lens, size)
        .unwrap()
}

/// Checks a perspective view with defaults, and an orthographic one with exact depth order and a
/// background.
fn check(name: &str, scene: &PointVolume) {
    let settings = Settings {
        background: Some([0.3, 0.1, 0.0]),
        tolerance: 1e-3,
        ..Settings::default()
    };
    let ways = [
        (Lens::FovDeg(35.0), [150, 130], Settings::default()),
        (Lens::OrthoHeight(None), [90, 110], settings),
    ];
    for (lens, size, settings) in some(ways, name.len(), 2) {
        let camera = fitted(scene, lens, size);
        let flips = assert_alike(name, scene, &camera, &settings);
        assert!(
            flips.is_none_or(|n| n <= size[0] * size[1] / 200),
            "{name}: {flips:?}"
        );
    }
}

#[test]
fn fixtures_look_alike() {
    check("wake", &wake());
    check("particles.csv", &read(&fixture("particles.csv")));
    if pictures().is_none() {
        return;
    }
    for name in [
        "phantom.h5",
        "swift.h5",
        "gadget_old.h5",
        "gadget_old_packed.h5",
        "gadget_big_endian.h5",
        "dark_matter.h5",
    ] {
        check(name, &read(&fixture(name)));
    }
}

#[test]
fn real_data_look_alike() {
    if pictures().is_none() {
        return;
    }
    for name in [
        "curvilinear/multicomb_0.vts",
        "curvilinear/bluntfin/bluntfinxyz.bin",
        "particles/phantom_mhd_00000.csv",
        "particles/phantom_mhd_00000.h5",
        "particles/halo_low_res.npy",
        "particles/bunny_frame_14_7705_particles.vtk",
        "rectilinear/RectGrid2.vtk",
        "unstructured/disk_out_ref.vtu",
        "unstructured/can.vtu",
        "unstructured/CylinderLinear.vtk",
        "splats/fruit_drops_minimal.ply",
        "splats/test-splat.3-points-from-train.ply",
        "splats/test-splat.3-points-from-train.splat",
        "splats/test-splat.3-points-from-train.spz",
    ] {
        if let Some(path) = real_data(name) {
            check(name, &read(&path));
        }
    }
    for (name, dims) in [
        ("volumes/engine_256x256x128_uint8.raw.gz", [256, 256, 128]),
        ("volumes/nucleon_41x41x41_uint8.raw", [41; 3]),
    ] {
        if let Some(path) = real_data(name) {
            let raw = Some(RawLayout::new(dims, RawType::U8));
            let options = OpenOptions {
                raw,
                ..OpenOptions::default()
            };
            check(name, &read_with(&path, &options, &SampleOptions::default()));
        }
    }
}

#[test]
fn every_filter_looks_alike() {
    if pictures().is_none() {
        return;
    }
    let scene = wake();
    let mut camera = fitted(&scene, Lens::FovDeg(50.0), [120, 90]);
    for filter in Filter::ALL {
        for linear_opacity in [false, true] {
            let settings = Settings {
                filter,
                advanced: Advanced {
                    linear_opacity,
                    ..Advanced::default()
                },
                cutoff: linear_opacity.then_some(2.5),
                ..Settings::default()
            };
            let name = format!("{}, linear {linear_opacity}", filter.name());
            assert_alike(&name, &scene, &camera, &settings);
        }
    }
    // Views from inside, where kernels cross the camera plane; without and with a wide low-pass
    // filter.
    camera.eye += camera.forward() * 0.6 * camera.eye.length();
    for low_pass_variance_px2 in [0.0, 1.0, 9.0] {
        let settings = Settings {
            low_pass_variance_px2,
            ..Settings::default()
        };
        assert_alike("from within", &scene, &camera, &settings);
    }
}

/// Returns ellipsoids of many sizes, some around the eye.
fn cloud(count: usize) -> PointVolume {
    let mut random = Random::new(7);
    let particles: Vec<Particle> = (0..count)
        .map(|_| {
            let size = random.log_range(2e-3, 0.2);
            Particle {
                position: random.point(1.5) + DVec3::Z * 2.0,
                factor: random.factor(size, 6.0),
                mass: (size * size * random.log_range(0.01, 3.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect();
    volume(&particles)
}

#[test]
fn pictures_do_not_depend_on_how_the_frame_is_cut() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [203, 117]);
    let settings = Settings {
        depth: true,
        background: Some([0.1, 0.2, 0.3]),
        ..Settings::default()
    };
    // The limit is so small that there are several parts, chunks and bands. With classification, it
    // includes the transfer function's table.
    let scenes = [
        (vec![cloud(12_000)], 361_000),
        (vec![wake(), cloud(24_000)], 822_000),
    ];
    for (scene, limit) in scenes {
        let draw = |gpu| {
            let mut renderer = Renderer::new(scene.clone()).unwrap().on(gpu).unwrap();
            renderer.render(&camera, &settings).unwrap();
            let counts = renderer.counts();
            let depth = renderer.depth().unwrap().clone();
            (renderer.image().clone(), depth, counts)
        };
        let whole = draw(gpu.clone());
        assert!(whole.2.footprints > 300);
        let cut = draw(gpu.clone().with_binding_limit(limit));
        assert_eq!(difference(&whole.0, &cut.0), 0.0);
        assert_eq!(whole.1, cut.1);
        assert_eq!(whole.2, cut.2);
    }
}

/// Returns a smooth field on a lattice, whose cells vary little from one to the next.
fn waves(spacing: LatticeSpacing, dims: [usize; 3]) -> PointVolume {
    let lattice = Lattice { dims, spacing };
    let values = (0..lattice.len())
        .map(|n| {
            let cell = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
            let p = lattice.position(cell);
            (127.0 + 60.0 * (2.0 * p.x).sin() + 60.0 * (3.0 * p.y + p.z).cos()) as u8
        })
        .collect();
    PointVolume::new(
        Particles::Lattice {
            lattice,
            kernel_width: 0.7,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(Values::U8(values), bands(0.1))
}

/// Returns bands of opacity over 0 to 255, the greatest `most` per length of .1.
fn bands(most: f32) -> TransferFunction {
    let opacity = |v: f32| most * (v * 0.05).sin().max(0.0);
    let colour = |v: f32| [v / 255.0, 0.5, 1.0 - v / 255.0];
    TransferFunction::from_curves(colour, opacity, [0.0, 255.0], 0.1).unwrap()
}

/// Returns faint points that fill a ball evenly, so many that most are merged from afar.
fn dust(count: usize, is_classified: bool) -> PointVolume {
    let mut random = Random::new(31);
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(1.0)).collect();
    let strengths = (0..count)
        .map(|_| random.log_range(1e-7, 1e-5) as f32)
        .collect();
    let values = positions
        .iter()
        .map(|p| (127.0 + 100.0 * p.x) as f32)
        .collect();
    PointVolume::new(
        Particles::Isotropic {
            sigmas: vec![0.01; count],
            positions,
        },
        if is_classified {
            Strength::Classified { volumes: strengths }
        } else {
            Strength::Mass(strengths)
        },
    )
    .classified(Values::F32(values), bands(0.3))
}

/// Returns scenes of which much is merged from afar: points, and lattices of every kind.
fn mergeable() -> Vec<(&'static str, PointVolume)> {
    let dims = [64, 56, 48];
    let axis = |n: usize| -> Vec<f64> {
        let even = |i: usize| 2.0 * i as f64 / n as f64 - 1.0;
        (0..n).map(|i| even(i) * (1.0 + 0.2 * even(i))).collect()
    };
    let step = dims.map(|n| 2.0 / n as f64);
    let sheared = DMat3::from_cols(
        DVec3::new(step[0], 0.2 * step[0], 0.0),
        DVec3::new(0.0, step[1], 0.0),
        DVec3::new(0.1 * step[2], 0.0, step[2]),
    );
    let origin = DVec3::splat(-1.0);
    let straight = DMat3::from_diagonal(DVec3::from(step));
    vec![
        ("dust of masses", dust(20_000, false)),
        ("dust of volumes", dust(20_000, true)),
        (
            "lattice",
            waves(
                LatticeSpacing::Uniform {
                    origin,
                    step: straight,
                },
                dims,
            ),
        ),
        (
            "sheared lattice",
            waves(
                LatticeSpacing::Uniform {
                    origin,
                    step: sheared,
                },
                dims,
            ),
        ),
        (
            "rectilinear lattice",
            waves(
                LatticeSpacing::Rectilinear {
                    coordinates: dims.map(axis),
                },
                dims,
            ),
        ),
    ]
}

#[test]
fn merged_scenes_look_alike_at_every_zoom() {
    if pictures().is_none() {
        return;
    }
    for (number, (name, scene)) in mergeable().into_iter().enumerate() {
        let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
        let mut merged = Vec::new();
        let distances = [4.0, 12.0, 40.0, 150.0, 600.0];
        for (step, distance) in distances.into_iter().enumerate() {
            let tolerance = match distance {
                12.0 => 0.05,
                // Values between the steps of a transfer function are merged only if merging may
                // cost half of everything visible.
                600.0 => 0.5,
                _ => 1.0 / 255.0,
            };
            let eye = DVec3::new(0.6, -0.7, 0.4) * distance;
            let size = [90, 80];
            let cameras = [
                Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 40.0, size),
                Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 0.8 * distance, size),
            ];
            for camera in some(cameras, number + step, 2) {
                let shows = [Show::Scene, Show::Choice, Show::Scene, Show::Count];
                for show in some(shows, number + step, 4) {
                    // Kernels classified over their extents are not merged.
                    let settings = Settings {
                        classify: Classification::Particle,
                        show,
                        depth: show == Show::Scene,
                        tolerance,
                        ..Settings::default()
                    };
                    let name = format!("{name} from {distance}, {show:?}");
                    let flips = assert_alike(&name, &scene, &camera, &settings);
                    assert!(flips.is_none_or(|n| n <= 8), "{name}: {flips:?}");
                }
                let settings = Settings {
                    classify: Classification::Particle,
                    tolerance,
                    ..Settings::default()
                };
                renderer.render(&camera, &settings).unwrap();
                merged.push(renderer.counts().blocks_merged);
            }
        }
        println!("{name}: {merged:?} blocks merged");
        assert!(
            merged.iter().filter(|&&n| n > 0).count() >= 2,
            "{name}: {merged:?}"
        );
    }
}

#[test]
fn an_edit_reaches_what_is_merged() {
    let Some(gpu) = pictures() else { return };
    let eye = DVec3::new(0.6, -0.7, 0.4) * 150.0;
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 1.5, [60, 50]);
    // With two families, the second one's levels are counted after the first's.
    let scene: Vec<_> = [0, 2].map(|i| mergeable().swap_remove(i).1).into();
    for volume in 0..2 {
        let mut edited = Renderer::new(scene.clone())
            .unwrap()
            .on(gpu.clone())
            .unwrap();
        let settings = Settings {
            classify: Classification::Particle,
            tolerance: 0.2,
            ..Settings::default()
        };
        let before = edited.render(&camera, &settings).unwrap().clone();
        let merged = edited.counts().blocks_merged;
        edited.set_transfer_function(volume, bands(0.9)).unwrap();
        let after = edited.render(&camera, &settings).unwrap().clone();
        let mut other = scene.clone();
        other[volume].transfer_function = Some(bands(0.9));
        let mut fresh = Renderer::new(other).unwrap().on(gpu.clone()).unwrap();
        let expected = fresh.render(&camera, &settings).unwrap();
        println!(
            "{merged} and {} blocks merged",
            edited.counts().blocks_merged
        );
        assert!(merged > 0 && edited.counts().blocks_merged > 0);
        assert!(
            volume == 0 || difference(&before, &after) > 1e-3,
            "the edit shows nothing"
        );
        assert_eq!(difference(expected, &after), 0.0);
        assert_eq!(edited.counts(), fresh.counts());
    }
}

#[test]
fn frames_follow_one_another() {
    let Some(gpu) = pictures() else { return };
    // Sizes, filters, projections and needs change between frames. No frame affects the next.
    let scene = cloud(3_000);
    let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
    renderer = renderer.on(gpu.clone()).unwrap();
    let near = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [64, 48]);
    let far = Camera::perspective(-DVec3::Z * 40.0, DVec3::Z, -DVec3::Y, 8.0, [100, 33]);
    let flat = Camera::orthographic(-DVec3::Z, DVec3::Z, -DVec3::Y, 4.0, [48, 64]);
    let away = Camera::perspective(DVec3::ZERO, -DVec3::Z * 9.0, DVec3::Y, 20.0, [16, 16]);
    for camera in [&near, &far, &away, &flat, &near] {
        for filter in [Filter::Adaptive, Filter::LowPass] {
            let settings = Settings {
                filter,
                depth: filter == Filter::LowPass,
                ..Settings::default()
            };
            renderer.render(camera, &settings).unwrap();
            let again = renderer.image().clone();
            let mut fresh = Renderer::new(vec![scene.clone()]).unwrap();
            fresh = fresh.on(gpu.clone()).unwrap();
            fresh.render(camera, &settings).unwrap();
            // A compiler may round the code with and without the exact path differently.
            let allowed = if gpu.is_software() { 0.0 } else { ALIKE };
            assert!(difference(&again, fresh.image()) <= allowed);
            assert_eq!(renderer.depth(), fresh.depth());
            assert_eq!(renderer.counts(), fresh.counts());
        }
    }
}

#[test]
fn a_transfer_function_edit_is_the_new_function() {
    let Some(gpu) = gpu() else { return };
    let scene = wake();
    let camera = fitted(&scene, Lens::FovDeg(35.0), [90, 70]);
    let other = read(&fixture("wake.xyz")).transfer_function.unwrap();
    let mut edited = Renderer::new(vec![scene.clone()]).unwrap();
    edited = edited.on(gpu.clone()).unwrap();
    let settings = Settings::default();
    let before = edited.render(&camera, &settings).unwrap().clone();
    edited.set_transfer_function(0, other.clone()).unwrap();
    let after = edited.render(&camera, &settings).unwrap().clone();
    assert!(difference(&before, &after) > 0.05, "the edit shows nothing");
    let fresh = PointVolume {
        transfer_function: Some(other),
        ..scene
    };
    let mut fresh = Renderer::new(vec![fresh]).unwrap().on(gpu.clone()).unwrap();
    assert_eq!(
        difference(fresh.render(&camera, &settings).unwrap(), &after),
        0.0
    );
    assert!(
        edited
            .set_transfer_function(1, edited.volumes()[0].transfer_function.clone().unwrap())
            .is_err()
    );
}

#[test]
fn nothing_to_draw_is_an_empty_picture() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, [33, 17]);
    for scene in [Vec::new(), vec![volume(&[])], vec![cloud(1)]] {
        let mut renderer = Renderer::new(scene).unwrap().on(gpu.clone()).unwrap();
        let settings = Settings {
            background: Some([0.5; 3]),
            ..Settings::default()
        };
        let image = renderer.render(&camera, &settings).unwrap();
        assert_eq!((image.width, image.height), (33, 17));
        assert_eq!(image.pixel(0, 0)[3], 1.0);
    }
}

#[test]
fn back_ends_are_chosen_as_asked() {
    let cpu = Renderer::with_options(vec![cloud(1)], Backend::Cpu).unwrap();
    assert_eq!(cpu.adapter(), None);
    let Some(gpu) = gpu() else { return };
    let on_gpu = Renderer::with_options(vec![cloud(1)], Backend::Gpu).unwrap();
    assert!(on_gpu.adapter().is_some());
    let auto = Renderer::with_options(vec![cloud(1)], Backend::Auto).unwrap();
    // A named adapter is used, whatever it is.
    if gpu.is_software() && !Gpu::is_adapter_named() {
        assert_eq!(
            auto.adapter(),
            None,
            "the CPU path is faster than a software adapter"
        );
    } else {
        assert!(auto.adapter().is_some());
    }
}
