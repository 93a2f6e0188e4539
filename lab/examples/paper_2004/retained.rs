//! Reproduces table 4: the cost of a frame if the scene is sent with each frame, and if it stays. Claim: seven to
//! twenty-four times as many frames if it stays, in a compressed form.
//!
//! On a graphics card, sending is the upload of all particles and blocks. The processor has no other memory to send to:
//! there it is the building of blocks and levels of detail, which a renderer does once.

use std::time::Instant;

use ewa_splat::scene::PointVolume;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;

use crate::checkerboard::checkerboard;
use crate::papers::{Arguments, median};
use crate::volumes::volumes;

/// Uncompressed bytes of a voxel with four vertices and indices of three orders (section 4.2).
const QUAD_BYTES: f64 = 164.0;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    println!(
        "{0} x {0}, {1} threads, medians of {2} frames",
        arguments.size,
        rayon::current_num_threads(),
        arguments.frames
    );
    println!(
        "{:>14} {:>10} {:>9} {:>11} {:>10} {:>8} {:>12}",
        "data", "drawn on", "visible", "immediate", "retained", "times", "bytes/voxel"
    );
    let mut scenes = vec![(
        "checkerboard",
        vec![checkerboard(arguments.size.max(16))?],
        arguments.size as f64,
    )];
    for (volume, transfer) in volumes(arguments.size)? {
        let side = volume.dims.into_iter().max().unwrap_or(1) as f64;
        scenes.push((volume.name, volume.scene(&transfer)?, side));
    }
    for (name, scene, side) in &scenes {
        on_processor(name, scene, *side, arguments)?;
    }
    #[cfg(feature = "gpu")]
    on_adapter(&scenes, arguments)?;
    Ok(())
}

/// Returns a camera that sees all of a scene of that width.
fn camera(side: f64, size: usize) -> Camera {
    let eye = DVec3::new(0.9, -1.6, 0.9) * side;
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 35.0, [size; 2])
}

fn on_processor(name: &str, scene: &[PointVolume], side: f64, arguments: &Arguments) -> Result<()> {
    let (camera, settings) = (camera(side, arguments.size), Settings::default());
    let mut kept = Renderer::new(scene.to_vec())?;
    let mut times = [Vec::new(), Vec::new()];
    for i in 0..=arguments.frames {
        // The scene is copied before the clock runs.
        let copy = scene.to_vec();
        let start = Instant::now();
        Renderer::new(copy)?.render(&camera, &settings)?;
        let sent = start.elapsed().as_secs_f64() * 1e3;
        kept.render(&camera, &settings)?;
        // The first frame fills buffers.
        if i > 0 {
            times[0].push(sent);
            times[1].push(kept.times().frame);
        }
    }
    print(name, "processor", &kept, times);
    Ok(())
}

/// Times a graphics card.
#[cfg(feature = "gpu")]
fn on_adapter(scenes: &[(&str, Vec<PointVolume>, f64)], arguments: &Arguments) -> Result<()> {
    use ewa_splat::render::{AdapterChoice, Gpu};
    let gpu = match Gpu::open(AdapterChoice::Hardware) {
        Ok(gpu) => gpu,
        Err(e) => {
            println!("no graphics card: {e}");
            return Ok(());
        }
    };
    println!("{}", gpu.adapter());
    for (name, scene, side) in scenes {
        let (camera, settings) = (camera(*side, arguments.size), Settings::default());
        let mut kept = Renderer::new(scene.clone())?.on(gpu.clone())?;
        let mut sent = Renderer::new(scene.clone())?;
        let mut times = [Vec::new(), Vec::new()];
        for i in 0..=arguments.frames {
            let start = Instant::now();
            sent = sent.on(gpu.clone())?;
            sent.render(&camera, &settings)?;
            let immediate = start.elapsed().as_secs_f64() * 1e3;
            kept.render(&camera, &settings)?;
            if i > 0 {
                times[0].push(immediate);
                times[1].push(kept.times().frame);
            }
        }
        print(name, "card", &kept, times);
    }
    Ok(())
}

fn print(name: &str, device: &str, kept: &Renderer, mut times: [Vec<f64>; 2]) {
    let [sent, retained] = [0, 1].map(|i| median(&mut times[i]));
    let bytes = kept.bytes_per_particle();
    println!(
        "{name:>14} {device:>10} {:>9} {sent:>8.1} ms {retained:>7.1} ms {:>8.1} {:>5.2} (1:{:.0})",
        kept.counts().classified,
        sent / retained,
        bytes,
        QUAD_BYTES / bytes
    );
}
