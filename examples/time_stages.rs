//! Times every stage of a frame on generated particles, and the rasteriser at every instruction
//! set of this processor.
//!
//!     cargo run --release --example time_stages [PARTICLES] [WIDTH] [HEIGHT]

use ewa_splat::cpu::SimdLevel;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::splat::Filter;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Settings};
use glam::DVec3;

fn main() -> ewa_splat::Result<()> {
    let number = |i: usize, default: usize| {
        std::env::args()
            .nth(i)
            .and_then(|a| a.parse().ok())
            .unwrap_or(default)
    };
    let (count, width, height) = (number(1, 1_000_000), number(2, 512), number(3, 512));
    let mut renderer = Renderer::new(vec![particles(count, height)])?;
    let eye = DVec3::new(0.0, -4.0, 0.0);
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, [width, height]);
    println!(
        "{count} particles of 2 px, {width} x {height}, {} threads",
        rayon::current_num_threads()
    );
    println!(
        "{:>10} {:>9} {:>6} {:>6} {:>8} {:>6} {:>6} {:>9} {:>7} {:>7}  {:>12} {:>16}",
        "filter",
        "level",
        "cull",
        "class",
        "project",
        "sort",
        "bin",
        "rasterise",
        "resolve",
        "frame",
        "splat-pixels",
        "M/core-second"
    );
    for filter in [Filter::Ewa, Filter::Exact, Filter::Adaptive] {
        for simd in SimdLevel::available() {
            let settings = Settings {
                filter,
                simd,
                ..Settings::default()
            };
            let mut best = None;
            for frame in 0..6 {
                renderer.render(&camera, &settings)?;
                let times = renderer.times();
                if frame > 0
                    && best.is_none_or(|b: ewa_splat::render::StageTimes| times.frame < b.frame)
                {
                    best = Some(times);
                }
            }
            let Some(t) = best else { continue };
            let splat_pixels = renderer.counts().splat_pixels;
            let rate =
                splat_pixels as f64 / (t.rasterise * 1e3 * rayon::current_num_threads() as f64);
            println!(
                "{:>10} {:>9} {:6.1} {:6.1} {:8.1} {:6.1} {:6.1} {:9.1} {:7.1} {:7.1}  {:12} {:16.0}",
                filter.name(),
                format!("{simd:?}"),
                t.cull,
                t.classify,
                t.project,
                t.sort,
                t.bin,
                t.rasterise,
                t.resolve,
                t.frame,
                splat_pixels,
                rate
            );
        }
    }
    Ok(())
}

/// Random needles, discs and blobs in a cube of side 2: standard deviations about 2 px when seen
/// from a distance of 4, faint enough that hundreds overlap.
fn particles(count: usize, height: usize) -> PointVolume {
    let mut state = 1_u64;
    let mut random = || {
        // A linear congruential generator: the same particles everywhere.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    };
    let focal_px = height as f32 / (2.0 * 15_f32.to_radians().tan());
    let sigma = 2.0 * 4.0 / focal_px;
    let mut positions = Vec::with_capacity(count);
    let mut factors = Vec::with_capacity(count);
    let mut masses = Vec::with_capacity(count);
    let mut colours = Vec::with_capacity(count);
    for _ in 0..count {
        let mut coordinate = || f64::from(random()) * 2.0 - 1.0;
        positions.push(DVec3::new(coordinate(), coordinate(), coordinate()));
        let mut scale = || sigma * (0.5 + random());
        let diagonal = [scale(), scale(), scale()];
        let mut skew = || sigma * (random() - 0.5);
        factors.push([
            diagonal[0],
            skew(),
            diagonal[1],
            skew(),
            skew(),
            diagonal[2],
        ]);
        masses.push(2e-6 * random());
        colours.push([random(), random(), random()]);
    }
    PointVolume {
        particles: Particles::Anisotropic { positions, factors },
        strength: Strength::Mass(masses),
        colour: Colour::PerParticle(colours),
        values: None,
        transfer_function: None,
    }
}
