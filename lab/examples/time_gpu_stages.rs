//! Times every stage of a frame on the GPU, on generated scenes at 1920 x 1080: one and ten million particles of 2 px,
//! and a lattice of 256 x 256 x 128 bytes of which 670,000 are visible. Also times an edit of the transfer function
//! against a rebuild, and the sort.
//!
//!     cargo run --release -p ewa-splat-lab --example time_gpu_stages [WIDTH HEIGHT [PARTICLES ...]]
//!
//! Without PARTICLES, a software adapter gets a twentieth of the particles, and the lattice a quarter of the
//! resolution. A stage's time is measured by the device; a frame's is the time its caller waits, which includes reading
//! back the image and everything else. Times are medians of [`FRAMES`].

mod scenes;

use std::time::Instant;

use ewa_splat::render::{AdapterChoice, Gpu};
use ewa_splat::scene::{
    Colour, ColourSpace, ControlPoint, Lattice, Particles, PointVolume, Strength, TransferFunction,
    Values,
};
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;
use scenes::{camera, particles};

/// Number of timed frames, after one that creates buffers and pipelines.
const FRAMES: usize = 5;

fn main() -> Result<()> {
    let numbers: Vec<usize> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let gpu = match Gpu::open(AdapterChoice::Any) {
        Ok(gpu) => gpu,
        Err(e) => {
            println!("nothing to time: {e}");
            return Ok(());
        }
    };
    let is_software = gpu.is_software();
    let size = match numbers[..] {
        [width, height, ..] => [width, height],
        _ => [1920, 1080],
    };
    let share = if is_software { 20 } else { 1 };
    let counts = match numbers.get(2..) {
        Some(counts) if !counts.is_empty() => counts.to_vec(),
        _ => vec![1_000_000 / share, 10_000_000 / share],
    };
    println!("{}, {} x {}", gpu.adapter(), size[0], size[1]);
    if is_software {
        println!("a software adapter: its times say nothing of a graphics card's");
    }
    println!("milliseconds; counts in millions");
    println!(
        "{:>22} {:>6} {:>6} {:>7} {:>7} {:>7} {:>9} {:>8} {:>7} {:>7} {:>8} {:>11} {:>12} {:>11}",
        "scene",
        "cull",
        "class",
        "project",
        "sort",
        "bin",
        "rasterise",
        "frame",
        "visible",
        "entries",
        "splat-px",
        "M splat-px/s",
        "M pairs/s",
        "frames/s"
    );
    for count in counts {
        let scene = particles(count, size[1], 2.0);
        let mut renderer = Renderer::new(vec![scene])?.on(gpu.clone())?;
        time_frames(&format!("{count} of 2 px"), &mut renderer, &camera(size))?;
    }
    let shrunk = if is_software { 4 } else { 1 };
    time_lattice(&gpu, size, shrunk)
}

/// Milliseconds since `start`.
fn since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// Returns the median of the times.
fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Prints a line of the table.
fn time_frames(name: &str, renderer: &mut Renderer, camera: &Camera) -> Result<()> {
    let settings = Settings::default();
    let mut times = Vec::new();
    for frame in 0..=FRAMES {
        renderer.render(camera, &settings)?;
        if frame > 0 {
            times.push(renderer.times());
        }
    }
    let of = |stage: fn(&ewa_splat::render::StageTimes) -> f64| {
        median(times.iter().map(stage).collect())
    };
    let (sort, rasterise, frame) = (of(|t| t.sort), of(|t| t.rasterise), of(|t| t.frame));
    let c = renderer.counts();
    let millions = |n: usize| n as f64 * 1e-6;
    println!(
        "{name:>22} {:6.2} {:6.2} {:7.2} {:7.2} {:7.2} {:9.2} {:8.2} {:7.2} {:7.2} {:8.1} {:12.0} {:11.0} {:11.1}",
        of(|t| t.cull),
        of(|t| t.classify),
        of(|t| t.project),
        sort,
        of(|t| t.bin),
        rasterise,
        frame,
        millions(c.footprints),
        millions(c.tile_entries),
        c.splat_pixels as f64 * 1e-6,
        c.splat_pixels as f64 / (rasterise * 1e3),
        c.classified as f64 / (sort * 1e3),
        1e3 / frame
    );
    Ok(())
}

/// Prints the lattice's line, and the cost of an edit of its transfer function.
fn time_lattice(gpu: &Gpu, size: [usize; 2], shrunk: usize) -> Result<()> {
    let [sharp, soft] = [transfer_function(0.02)?, transfer_function(0.01)?];
    let volume = hollow_ball([256 / shrunk, 256 / shrunk, 128 / shrunk], &sharp);
    let start = Instant::now();
    let mut renderer = Renderer::new(vec![volume.clone()])?.on(gpu.clone())?;
    let camera = Camera::perspective(
        DVec3::new(300.0, -500.0, 250.0) / shrunk as f64,
        DVec3::ZERO,
        DVec3::Z,
        30.0,
        size,
    );
    renderer.render(&camera, &Settings::default())?;
    let first = since(start);
    let name = format!("lattice of {}", renderer.particle_count());
    time_frames(&name, &mut renderer, &camera)?;

    let mut edits = Vec::new();
    for i in 0..FRAMES {
        let start = Instant::now();
        let transfer = if i % 2 == 0 { &soft } else { &sharp };
        renderer.set_transfer_function(0, transfer.clone())?;
        renderer.render(&camera, &Settings::default())?;
        edits.push(since(start));
    }
    let start = Instant::now();
    let mut rebuilt = Renderer::new(vec![volume])?.on(gpu.clone())?;
    rebuilt.render(&camera, &Settings::default())?;
    println!(
        "\ntransfer function of the lattice, to the picture: an edit {:.2} ms, all made anew {:.2} ms \
         (the first time, with shaders compiled: {first:.0} ms)",
        median(edits),
        since(start),
    );
    Ok(())
}

/// Returns bytes on a lattice of unit cells: a hollow ball, flattened to fit, whose wall has 8 % of the cells; its
/// middle is the origin.
fn hollow_ball(dims: [usize; 3], transfer: &TransferFunction) -> PointVolume {
    let middle = DVec3::from_array(dims.map(|n| (n - 1) as f64 * 0.5));
    let mut values = Vec::with_capacity(dims.iter().product());
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let offset = DVec3::new(x as f64, y as f64, z as f64) - middle;
                let radius = (offset / (middle * 0.9)).length();
                let is_wall = (0.924..1.0).contains(&radius);
                // Stripes of different colours.
                #[allow(clippy::cast_possible_truncation, reason = "fewer than 16")]
                let stripe = ((x / 16 + y / 16 + z / 16) % 16) as u8;
                values.push(if is_wall { 100 + 10 * stripe } else { 0 });
            }
        }
    }
    PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform(dims, -middle, DVec3::ONE),
            kernel_width: 0.5,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(Values::U8(values)),
        transfer_function: Some(transfer.clone()),
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Shows nothing below 90, and `opacity` per cell above 100.
fn transfer_function(opacity: f32) -> Result<TransferFunction> {
    let point = |value, colour, opacity| ControlPoint {
        value,
        colour: Some(colour),
        opacity: Some(opacity),
    };
    TransferFunction::from_points(
        &[
            point(90.0, [0.1, 0.2, 0.6], 0.0),
            point(100.0, [0.1, 0.2, 0.6], opacity),
            point(255.0, [1.0, 0.8, 0.3], opacity),
        ],
        ColourSpace::Linear,
        [0.0, 255.0],
        1.0,
    )
}
