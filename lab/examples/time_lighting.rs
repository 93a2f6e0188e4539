//! Measures how much lighting once per particle saves over lighting at every pixel of every splat: the claim of
//! two-pass shading, section 4.4 of Chen et al. 2004.
//!
//!     cargo run --release -p ewa-splat-lab --example time_lighting [FILE] [SIZE] [X,Y,Z of a raw volume of bytes]
//!
//! The same function lights the particles of a frame once each, and then as often as the rasteriser evaluates a splat
//! at a pixel.

use std::path::PathBuf;
use std::time::Instant;

use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::sample::{PurposeOptions, SampleOptions, volume};
use ewa_splat::scene::Lighting;
use ewa_splat::stages::blocks::{BlockedVolume, cull};
use ewa_splat::stages::cpu;
use ewa_splat::stages::record::{ChoiceUniform, ClassifiedParticle, LightingUniform};
use ewa_splat::view::{Lens, Viewpoint};
use ewa_splat::{Renderer, Settings};
use glam::DVec3;

/// Number of frames, of which the fastest counts.
const FRAMES: usize = 5;

fn main() -> ewa_splat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let wake = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/wake.xyz");
    let file = arguments
        .next()
        .map_or_else(|| PathBuf::from(wake), Into::into);
    let size = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(512);
    let dims = arguments.next().and_then(|a| {
        let dims: Option<Vec<usize>> = a.split(',').map(|n| n.parse().ok()).collect();
        <[usize; 3]>::try_from(dims?).ok()
    });
    let options = OpenOptions {
        raw: dims.map(|dims| RawLayout::new(dims, RawType::U8)),
        ..OpenOptions::default()
    };
    let with_normals = SampleOptions {
        purpose: PurposeOptions {
            normals: true,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    };
    let scene = volume(open(&file, &options)?, &with_normals)?.volume;

    let blocked = BlockedVolume::new(scene.clone());
    let mut renderer = Renderer::new(vec![scene])?;
    let viewpoint = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 30.0,
        zoom: 1.0,
        up: DVec3::Z,
    };
    let boxes = renderer.visible_boxes();
    let Some(camera) = viewpoint.camera(&boxes, Lens::FovDeg(30.0), [size; 2]) else {
        println!("nothing to see");
        return Ok(());
    };
    let lighting = Lighting::default();
    let mut frame_ms = |lighting: Option<&Lighting>| {
        let settings = Settings {
            lighting: lighting.cloned(),
            // A volume with normals is lit without levels of detail.
            level_of_detail: false,
            ..Settings::default()
        };
        let mut best = f64::INFINITY;
        for _ in 0..FRAMES {
            renderer.render(&camera, &settings)?;
            best = best.min(renderer.times().frame);
        }
        Ok::<_, ewa_splat::Error>((best, renderer.counts()))
    };
    let (unlit_ms, _) = frame_ms(None)?;
    let (lit_ms, counts) = frame_ms(Some(&lighting))?;

    let mut views = Vec::new();
    let choice: ChoiceUniform = bytemuck::Zeroable::zeroed();
    cull(&blocked, &camera, None, &choice, &mut views);
    let count = cpu::count_classified(&blocked, &mut views);
    let mut particles = vec![bytemuck::Zeroable::zeroed(); count];
    cpu::classify(&blocked, &views, &mut particles);
    let uniform = LightingUniform::new(&lighting, &camera);
    let rotation = camera.camera_from_world.as_mat3();
    // Milliseconds to light so many, repeatedly from the first particle on. Colours are restored while no clock runs,
    // so that they stay those of particles.
    let light_ms = |mut left: u64| {
        let mut total = 0.0;
        let mut colours: Vec<ClassifiedParticle> = particles.clone();
        while left > 0 {
            colours.copy_from_slice(&particles);
            let batch = usize::try_from(left).map_or(count, |left| left.min(count));
            let start = Instant::now();
            let lit = &mut colours[..batch];
            cpu::light(&blocked, &views, &[], rotation, &uniform, None, lit);
            total += start.elapsed().as_secs_f64() * 1e3;
            left -= batch as u64;
        }
        total
    };
    if count == 0 {
        println!("nothing to light");
        return Ok(());
    }
    let per_particle = (0..FRAMES)
        .map(|_| light_ms(count as u64))
        .fold(f64::INFINITY, f64::min);
    let per_pixel = light_ms(counts.splat_pixels);

    println!(
        "{}, {size} x {size}, {} threads",
        file.display(),
        rayon::current_num_threads()
    );
    println!("frame: {unlit_ms:.1} ms unlit, {lit_ms:.1} ms lit");
    println!("lit once per particle:    {count:>12} times, {per_particle:>9.2} ms");
    println!(
        "lit once per splat-pixel: {:>12} times, {per_pixel:>9.2} ms: a frame of {:.1} ms",
        counts.splat_pixels,
        unlit_ms + per_pixel
    );
    println!(
        "once per particle is {:.1} times less lighting, and a frame {:.0} % shorter",
        counts.splat_pixels as f64 / count as f64,
        100.0 * (1.0 - (unlit_ms + per_particle) / (unlit_ms + per_pixel))
    );
    Ok(())
}
