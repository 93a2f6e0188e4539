//! Tests pictures that stay on a device, from which the window draws.

use std::sync::Arc;
use std::time::Instant;

use ewa_splat::Settings;
use ewa_splat::command::ViewArguments;
use ewa_splat::render::{AdapterChoice, Gpu};
use glam::DVec3;

use super::{LONGEST, fixture};
use crate::orbit::{Lens, Orbit};
use crate::screenshot::texels;
use crate::wanted::{Load, View};
use crate::worker::{Drawn, Loaded, News, Picture, Worker};

const SIZE: [usize; 2] = [150, 100];

/// Draws the finished picture of the vase on the device or the CPU.
fn drawn(gpu: Option<Gpu>) -> (Box<Loaded>, Drawn) {
    let words = ["ewa-splat-view", &fixture("vase.glb"), "--count", "5000"];
    let backend = match gpu {
        Some(_) => "gpu",
        None => "cpu",
    };
    let words = words.into_iter().chain(["--backend", backend]);
    let arguments = ViewArguments::parse(words.map(Into::into)).unwrap();
    let worker = Worker::new(|| ());
    worker.load(Load {
        scene: 1,
        request: Arc::new(arguments.request),
        field: None,
        chosen: vec![true],
        step: 0,
        gpu,
    });
    let begun = Instant::now();
    let mut loaded = None;
    loop {
        for news in worker.news() {
            match news {
                News::Loaded(read) => {
                    worker.show(view(&read));
                    loaded = Some(read);
                }
                News::Drawn(drawn) if drawn.is_final => return (loaded.unwrap(), *drawn),
                News::NotLoaded(_, why) => panic!("{why:?}"),
                News::Failed(why) => panic!("{why}"),
                _ => {}
            }
        }
        assert!(begun.elapsed() < LONGEST);
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

fn view(loaded: &Loaded) -> View {
    let (centre, half) = loaded.bounds.unwrap();
    let orbit = Orbit {
        eye: centre + DVec3::new(1.0, 0.4, 2.5) * half.length(),
        target: centre,
        up: DVec3::Y,
        world_up: DVec3::Y,
        lens: Lens::Perspective(35.0),
    };
    View {
        scene: 1,
        number: 1,
        camera: orbit.camera(SIZE),
        settings: Settings {
            background: Some([0.1, 0.2, 0.4]),
            ..loaded.settings.clone()
        },
        instead: None,
        functions: vec![None; loaded.volumes.len()],
    }
}

/// The device draws the same picture into the window's texture as the CPU. Its error is measured
/// all the same, and the rest of the result is equal.
#[test]
fn devices_draw_into_the_windows_texture() {
    let gpu = match Gpu::open(AdapterChoice::Any) {
        Ok(gpu) => gpu,
        Err(error) => {
            let is_required = std::env::var_os("EWA_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!is_required, "{error}");
            println!("skipped: {error}");
            return;
        }
    };
    let (loaded, on_device) = drawn(Some(gpu.clone()));
    assert_eq!(loaded.device, gpu.adapter());
    let Picture::Texture(texture) = &on_device.picture else {
        panic!("it has left the device");
    };
    let (_, on_processor) = drawn(None);
    let Picture::Pixels(image) = &on_processor.picture else {
        panic!("no device was asked for");
    };
    let a = texels(gpu.device(), gpu.queue(), texture).unwrap();
    let b = image.to_srgb8();
    assert_eq!(a.len(), b.len());
    // Both the vase and the background are visible.
    assert!(b.chunks(4).filter(|p| *p != &b[..4]).count() > 1000);
    // Values that differ by 2e-5 may round to different bytes.
    let apart = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(apart <= Some(1), "{apart:?}");
    let [a, b] = [on_device, on_processor].map(|drawn| drawn.error.unwrap().percentile_999);
    assert!((a - b).abs() < 1e-4 && a > 0.0, "{a} {b}");
}
