//! Tests adapters, and failures of a device: no adapter, a lost device, too little memory.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use crate::common::Random;
use crate::common::gpu::{assert_alike, gpu};
use crate::common::scene::{Particle, camera, difference, volume};
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::render::{AdapterChoice, Gpu, OpenBackend};
use ewa_splat::scene::{Lattice, Particles, PointVolume, Strength, TransferFunction, Values};
use ewa_splat::stages::record::NearTerms;
use ewa_splat::stats::FrameCounts;
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{ColumnSettings, Composite, Error, Renderer, Settings};
use glam::{DMat3, DVec3};

/// Returns `count` kernels of some pixels before a camera at the origin.
fn cloud(count: usize) -> PointVolume {
    let mut random = Random::new(31);
    let particles: Vec<_> = (0..count)
        .map(|_| Particle {
            position: DVec3::Z * 4.0 + random.point(1.0),
            factor: random.factor(0.05, 3.0),
            mass: 2e-3,
            colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect();
    volume(&particles)
}

fn view(size: [usize; 2]) -> Camera {
    camera(Projection::Perspective, [size[0] as f64; 2], size)
}

fn with_depth() -> Settings {
    Settings {
        depth: true,
        ..Settings::default()
    }
}

type Drawn = (Image, DepthImage, FrameCounts);

fn draw(gpu: Gpu, scene: &PointVolume, camera: &Camera) -> ewa_splat::Result<Drawn> {
    let mut renderer = Renderer::new(vec![scene.clone()])?.on(gpu)?;
    renderer.render(camera, &with_depth())?;
    let depth = renderer.depth().unwrap().clone();
    Ok((renderer.image().clone(), depth, renderer.counts()))
}

/// Asserts that the picture with bindings of at most `bytes` equals that of a device with more.
fn assert_cut_is_whole(name: &str, scene: &PointVolume, camera: &Camera, bytes: u64) {
    let Some(gpu) = gpu() else { return };
    let start = Instant::now();
    let whole = draw(gpu.clone(), scene, camera).unwrap();
    let whole_time = start.elapsed();
    let cut = draw(gpu.clone().with_binding_limit(bytes), scene, camera).unwrap();
    println!(
        "{name}: {:?}, {whole_time:.1?} whole, {:.1?} cut",
        whole.2,
        start.elapsed() - whole_time
    );
    assert_eq!(difference(&whole.0, &cut.0), 0.0, "{name}");
    assert_eq!(whole.1, cut.1, "{name}");
    assert_eq!(whole.2, cut.2, "{name}");
}

#[test]
fn adapters_are_found_by_name() {
    let Some(gpu) = gpu() else { return };
    let name = gpu.adapter();
    let missing = Gpu::open_named(AdapterChoice::Any, Some("no such name"));
    let error = missing.unwrap_err().to_string();
    assert!(
        error.contains("'no such name'") && error.contains(&name) && error.contains("EWA_ADAPTER"),
        "{error}"
    );
    // A part of the name, in either case.
    let part: String = name.chars().take(6).collect();
    for part in [part.to_uppercase(), part.to_lowercase()] {
        let opened = Gpu::open_named(AdapterChoice::Any, Some(&part)).unwrap();
        let part = part.to_lowercase();
        assert!(opened.adapter().to_lowercase().contains(&part));
    }
}

#[test]
fn a_software_adapter_is_no_hardware() {
    if gpu().is_none() {
        return;
    }
    match Gpu::open_named(AdapterChoice::Hardware, None) {
        Ok(gpu) => assert!(!gpu.is_software(), "{}", gpu.adapter()),
        Err(e) => {
            assert!(
                matches!(e, Error::NoAdapter { .. }) && e.is_of_device(),
                "{e:?}"
            );
            let error = e.to_string();
            assert!(error.contains("expected a hardware adapter"), "{error}");
            assert!(error.contains("a software adapter"), "{error}");
            assert!(error.contains("draw on the CPU"), "{error}");
        }
    }
}

/// Opens a separate device, to lose it.
fn own_gpu() -> Option<Gpu> {
    gpu()?;
    Some(Gpu::open(AdapterChoice::Any).unwrap())
}

fn assert_fails_soon(renderer: &mut Renderer, camera: &Camera) {
    let start = Instant::now();
    let error = renderer.render(camera, &with_depth()).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("expected a device that answers") && error.contains("closed"),
        "{error}"
    );
    assert!(start.elapsed() < Duration::from_secs(10));
}

#[test]
fn a_closed_device_is_an_error_now_and_later() {
    let Some(gpu) = own_gpu() else { return };
    let scene = cloud(2_000);
    let (small, large) = (view([64, 48]), view([96, 80]));
    // The device is lost before its first frame, and after one.
    let mut new = Renderer::new(vec![scene.clone()]).unwrap();
    new = new.on(gpu.clone()).unwrap();
    let mut used = Renderer::new(vec![scene.clone()]).unwrap();
    used = used.on(gpu.clone()).unwrap();
    used.render(&small, &with_depth()).unwrap();
    gpu.close();
    gpu.close();
    for camera in [&small, &small, &large] {
        assert_fails_soon(&mut new, camera);
        assert_fails_soon(&mut used, camera);
    }
    // Uploads fail, too, or the frame after them.
    let late = Renderer::new(vec![scene]).unwrap().on(gpu);
    if let Ok(mut late) = late {
        assert_fails_soon(&mut late, &small);
    }
    drop((new, used));
    assert!(own_gpu().is_some(), "the adapter opens again");
}

#[test]
fn a_device_lost_within_a_frame_is_an_error() {
    let scene = cloud(3_000);
    let camera = view([200, 160]);
    // The device is lost while the first frame compiles its shaders, and while later ones run.
    for (is_used, after_ms) in [(false, 0), (false, 50), (true, 0), (true, 3), (true, 200)] {
        let Some(gpu) = own_gpu() else { return };
        let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
        renderer = renderer.on(gpu.clone()).unwrap();
        if is_used {
            renderer.render(&camera, &with_depth()).unwrap();
        }
        let frames = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(after_ms));
                gpu.close();
            });
            let start = Instant::now();
            // Draws until a frame meets the loss.
            let mut frames = 0;
            while renderer.render(&camera, &with_depth()).is_ok() {
                frames += 1;
                assert!(start.elapsed() < Duration::from_secs(60), "closed long ago");
            }
            frames
        });
        println!("lost after {after_ms} ms, {frames} frames");
        assert_fails_soon(&mut renderer, &camera);
    }
}

#[test]
fn what_finds_no_room_is_said_with_its_bytes() {
    let Some(gpu) = gpu() else { return };
    let scene = cloud(256);
    let camera = view([64, 48]);
    let error = |bytes: u64, camera: &Camera| {
        let gpu = gpu.clone().with_binding_limit(bytes);
        let error = draw(gpu, &scene, camera).unwrap_err();
        assert!(error.is_of_device(), "{error:?}");
        let error = error.to_string();
        println!("{bytes}: {error}");
        assert!(error.contains("on the CPU"), "{error}");
        error
    };
    // A block's particles: nine words each of offset and shape.
    let e = error(4096, &camera);
    assert!(
        e.contains(&format!("{} bytes for the shapes", 256 * 36)),
        "{e}"
    );
    assert!(e.contains("at most 4096 bytes"), "{e}");
    assert!(e.contains("fewer particles"), "{e}");
    // A row of tiles: five words a pixel, with depth.
    let e = error(60_000, &view([200, 5]));
    assert!(
        e.contains(&format!("{} bytes for one of 200", 200 * 16 * 20)),
        "{e}"
    );
    assert!(e.contains("at most 60000 bytes"), "{e}");
    assert!(e.contains("narrower image"), "{e}");
    // Any limit, however small, gives an error and no panic.
    for bytes in [0, 1, 16, 100, 300, 1000, 20_000] {
        let gpu = gpu.clone().with_binding_limit(bytes);
        if let Err(e) = draw(gpu, &scene, &camera) {
            assert!(e.to_string().contains(" bytes for "), "{bytes}: {e}");
        }
    }
}

#[test]
fn a_device_that_had_no_room_draws_what_fits() {
    let Some(gpu) = gpu() else { return };
    let scene = cloud(700);
    let limited = gpu.clone().with_binding_limit(60_000);
    let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
    renderer = renderer.on(limited).unwrap();
    let (fits, wide) = (view([64, 48]), view([300, 5]));
    for camera in [&wide, &fits, &wide, &fits] {
        match renderer.render(camera, &with_depth()) {
            Ok(image) => {
                let alone = draw(gpu.clone(), &scene, camera).unwrap();
                assert_eq!(difference(image, &alone.0), 0.0);
                assert_eq!(camera.width, 64);
            }
            Err(_) => assert_eq!(camera.width, 300),
        }
    }
}

/// Returns kernels that contain the eye.
fn around_the_eye(count: usize) -> PointVolume {
    let mut random = Random::new(32);
    let particles: Vec<_> = (0..count)
        .map(|_| Particle {
            position: random.point(0.5),
            factor: random.factor(0.5, 2.0),
            mass: 1e-3,
            colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect();
    volume(&particles)
}

#[test]
fn kernels_across_the_camera_plane_find_room() {
    let camera = view([32, 17]);
    for count in [1, 2, 65, 300] {
        let scene = around_the_eye(count);
        assert_alike("around the eye", &scene, &camera, &Settings::default());
        assert_cut_is_whole("around the eye", &scene, &camera, 181_000);
    }
    // There are more than a binding holds.
    let Some(gpu) = gpu() else { return };
    let limited = gpu.clone().with_binding_limit(40_000);
    let mut renderer = Renderer::new(vec![around_the_eye(300)]).unwrap();
    renderer = renderer.on(limited).unwrap();
    for _ in 0..2 {
        let error = renderer.render(&camera, &Settings::default());
        let error = error.unwrap_err().to_string();
        // A count precedes them.
        let most = (40_000 - 4) / size_of::<NearTerms>();
        let expected = format!("at most {most} kernels across the camera plane");
        assert!(error.contains(&expected), "{error}");
        assert!(error.contains("found 300"), "{error}");
    }
    // From afar, none of them is near.
    let away = Camera {
        eye: -DVec3::Z * 30.0,
        ..camera
    };
    assert!(renderer.render(&away, &Settings::default()).is_ok());
}

/// Returns kernels that each cover the whole image.
fn veils(count: usize, tau: f64) -> PointVolume {
    let mut random = Random::new(33);
    let particles: Vec<_> = (0..count)
        .map(|_| Particle {
            position: DVec3::Z * random.range(20.0, 30.0),
            factor: DMat3::from_diagonal(DVec3::new(20.0, 20.0, 0.5)),
            mass: (tau * TAU * 20.0 * 20.0) as f32,
            colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect();
    volume(&particles)
}

#[test]
fn footprints_over_the_whole_image_find_room() {
    // 30 tiles: 90,000 entries of 3,000 footprints, of which a binding holds 45,000.
    let camera = view([96, 80]);
    assert_cut_is_whole("veils", &veils(3_000, 1e-3), &camera, 181_000);
    // There are more entries than the initial capacity, 2^20. The kernels turn opaque after some,
    // to save time.
    let camera = view([640, 480]);
    assert_cut_is_whole("many entries", &veils(1_000, 0.2), &camera, 2 << 20);
}

#[test]
fn the_widest_and_the_highest_image_are_drawn() {
    for size in [[65_535, 3], [3, 65_535]] {
        let mut camera = camera(Projection::Perspective, [16_000.0; 2], size);
        camera.eye = -DVec3::Z;
        let name = format!("{} x {}", size[0], size[1]);
        let mut scene = cloud(300);
        if let Particles::Anisotropic { positions, .. } = &mut scene.particles {
            // Kernels lie along the long side.
            for p in positions {
                p.x *= if size[0] > 3 { 5.0 } else { 0.01 };
                p.y *= if size[1] > 3 { 5.0 } else { 0.01 };
            }
        }
        let flips = assert_alike(&name, &scene, &camera, &Settings::default());
        assert!(flips.is_none_or(|n| n < 1_000), "{flips:?}");
    }
    // Bands are one row of tiles.
    let camera = view([1_000, 40]);
    assert_cut_is_whole("bands", &cloud(300), &camera, 1_000 * 16 * 20);
}

#[test]
fn more_visible_particles_than_a_part_had_room_for() {
    // A part initially has space for 2^18, if some may be transparent.
    let dims = [66; 3];
    let count: usize = dims.iter().product();
    let colour = |value: f32| [value, 1.0 - value, 0.5];
    let transfer = TransferFunction::from_curves(colour, |_| 0.02, [0.0, 255.0], 1.0).unwrap();
    let scene = PointVolume::new(
        Particles::Lattice {
            lattice: Lattice::uniform(dims, DVec3::new(-33.0, -33.0, 100.0), DVec3::ONE),
            kernel_width: 0.6,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(
        Values::U8((0..count).map(|i| (i * 7) as u8).collect()),
        transfer,
    );
    let camera = view([40, 32]);
    // Uncut: 287,496 in one part. Cut: parts of 2^17.
    assert_cut_is_whole("a lattice", &scene, &camera, 8 << 20);
}

/// Returns the CPU's picture.
fn alone(scene: &PointVolume, camera: &Camera, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(vec![scene.clone()]).unwrap();
    renderer.render(camera, settings).unwrap().clone()
}

/// Returns a renderer that may draw on the CPU if the device cannot.
fn on_if_it_can(gpu: Gpu, scene: &PointVolume) -> Renderer {
    let renderer = Renderer::new(vec![scene.clone()]).unwrap();
    renderer.on(OpenBackend::or_cpu(gpu)).unwrap()
}

#[test]
fn what_the_device_cannot_draw_the_processor_does() {
    let Some(gpu) = gpu() else { return };
    let scene = cloud(300);
    let (fits, wide) = (view([64, 48]), view([300, 5]));
    let mut renderer = on_if_it_can(gpu.clone().with_binding_limit(60_000), &scene);
    assert_eq!(renderer.fallback(), None);
    for _ in 0..2 {
        // A row of tiles is more than a binding holds.
        let image = renderer.render(&wide, &with_depth()).unwrap().clone();
        assert_eq!(
            difference(&image, &alone(&scene, &wide, &with_depth())),
            0.0
        );
        let why = renderer.fallback().unwrap().to_string();
        assert!(why.contains("at most 60000 bytes"), "{why}");
        // The device draws again once it can.
        renderer.render(&fits, &with_depth()).unwrap();
        assert_eq!(renderer.fallback(), None);
        let own = draw(gpu.clone(), &scene, &fits).unwrap();
        assert_eq!(difference(renderer.image(), &own.0), 0.0);
    }
    // The binding limit is too small for the scene itself.
    let mut renderer = on_if_it_can(gpu.clone().with_binding_limit(4096), &scene);
    assert_eq!(renderer.adapter(), None);
    for _ in 0..2 {
        let why = renderer.fallback().unwrap().to_string();
        assert!(why.contains("bytes for the shapes"), "{why}");
        let image = renderer.render(&fits, &with_depth()).unwrap();
        assert_eq!(difference(image, &alone(&scene, &fits, &with_depth())), 0.0);
    }
}

#[test]
fn more_slabs_than_the_device_keeps_open_fall_back() {
    let Some(gpu) = gpu() else { return };
    let scene = cloud(40);
    let camera = view([24, 16]);
    let slabs = |thickness| Settings {
        composite: Composite::Slabs {
            thickness: Some(thickness),
        },
        ..Settings::default()
    };
    let mut renderer = on_if_it_can(gpu.clone(), &scene);
    // Some kernels extend half a unit along z.
    let thin = slabs(1e-3);
    let image = renderer.render(&camera, &thin).unwrap().clone();
    let why = renderer.fallback().unwrap().to_string();
    assert!(why.contains("at most 256 slabs"), "{why}");
    assert_eq!(difference(&image, &alone(&scene, &camera, &thin)), 0.0);
    renderer.render(&camera, &slabs(0.1)).unwrap();
    assert_eq!(renderer.fallback(), None);
    // If the device was asked for explicitly, it reports the error.
    let mut asked_for = Renderer::new(vec![scene]).unwrap().on(gpu.clone()).unwrap();
    assert!(asked_for.render(&camera, &thin).is_err());
}

#[test]
fn a_device_that_is_lost_falls_back() {
    let Some(gpu) = own_gpu() else { return };
    let scene = cloud(300);
    let camera = view([64, 48]);
    let mut renderer = on_if_it_can(gpu.clone(), &scene);
    renderer.render(&camera, &with_depth()).unwrap();
    assert_eq!(renderer.fallback(), None);
    gpu.close();
    for _ in 0..2 {
        let image = renderer.render(&camera, &with_depth()).unwrap().clone();
        assert_eq!(
            difference(&image, &alone(&scene, &camera, &with_depth())),
            0.0
        );
        let why = renderer.fallback().unwrap();
        assert!(why.contains("a device that answers"), "{why}");
        let columns = renderer.column_density(&camera, &ColumnSettings::default());
        assert!(columns.is_ok() && renderer.fallback().is_some());
    }
}

#[test]
fn what_the_caller_does_wrong_is_no_fault_of_the_device() {
    let Some(gpu) = gpu() else { return };
    let scene = cloud(40);
    let camera = view([24, 16]);
    let mut renderer = on_if_it_can(gpu.clone(), &scene);
    let wrong = Settings {
        tolerance: f32::NAN,
        ..Settings::default()
    };
    let expected = Renderer::new(vec![scene]).unwrap();
    let expected = { expected }
        .render(&camera, &wrong)
        .unwrap_err()
        .to_string();
    assert_eq!(
        renderer.render(&camera, &wrong).unwrap_err().to_string(),
        expected
    );
    assert_eq!(renderer.fallback(), None);
}
