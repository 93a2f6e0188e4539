//! Times every stage of a frame on generated particles, and the rasteriser with every instruction set of this
//! processor; then column densities of the same number of particles.
//!
//!     cargo run --release -p ewa-splat-lab --example time_stages [PARTICLES] [WIDTH] [HEIGHT]

mod scenes;

use ewa_splat::Filter;
use ewa_splat::render::{Advanced, SimdLevel};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use ewa_splat::{ColumnSettings, Renderer, Settings};
use glam::DVec3;
use scenes::{camera, particles, uniform};

fn main() -> ewa_splat::Result<()> {
    let number = |i: usize, default: usize| {
        std::env::args()
            .nth(i)
            .and_then(|a| a.parse().ok())
            .unwrap_or(default)
    };
    let (count, width, height) = (number(1, 1_000_000), number(2, 512), number(3, 512));
    time_pictures(count, width, height)?;
    time_columns(count)
}

fn time_pictures(count: usize, width: usize, height: usize) -> ewa_splat::Result<()> {
    let mut renderer = Renderer::new(vec![particles(count, height, 2.0)])?;
    let camera = camera([width, height]);
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
    for filter in [
        Filter::Ewa,
        Filter::Isotropic,
        Filter::Exact,
        Filter::Adaptive,
    ] {
        for simd in SimdLevel::available() {
            let settings = Settings {
                filter,
                advanced: Advanced {
                    simd,
                    ..Advanced::default()
                },
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

/// Times column densities at 1024 x 1024, orthographic: spheres as in smoothed-particle hydrodynamics, spheres of very
/// unequal size, and ellipsoids.
fn time_columns(count: usize) -> ewa_splat::Result<()> {
    const SIZE: usize = 1024;
    /// Support of a cubic spline, 2h, in standard deviations of its Gaussian, sqrt(.3) h.
    const SUPPORT: f64 = 3.651_483_716_701_107;
    println!("\ncolumn density, {SIZE} x {SIZE}, orthographic");
    println!(
        "{:>34} {:>9} {:>6} {:>6} {:>8} {:>6} {:>6} {:>7} {:>7}  {:>9} {:>9} {:>12} {:>10}",
        "particles",
        "level",
        "cull",
        "class",
        "project",
        "bin",
        "sum",
        "resolve",
        "frame",
        "M kernel",
        "M splat",
        "M/core-s",
        "mass error"
    );
    // World units are pixels: the cube's face fills the image, and its corners are in view.
    let eye = DVec3::new(0.0, -4.0 * SIZE as f64, 0.0);
    let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, SIZE as f64, [SIZE; 2]);
    let scenes = [
        (
            "SPH, support 18.6 px on average",
            spheres(count, [9.0 / SUPPORT, 32.87 / SUPPORT], 400.0),
        ),
        (
            "support .01 to 1,000 px",
            spheres(count / 10, [1e-2 / SUPPORT, 1e3 / SUPPORT], 400.0),
        ),
        ("sigma .01 px", spheres(count, [1e-2, 1e-2], 500.0)),
        ("ellipsoids of 2 px", particles_in_pixels(count)),
    ];
    for (name, scene) in scenes {
        // Pixels within the support, the usual count in that field.
        let kernel_pixels = match &scene.particles {
            Particles::Isotropic { sigmas, .. } => sigmas
                .iter()
                .map(|s| std::f64::consts::PI * (f64::from(*s) * SUPPORT).powi(2))
                .sum(),
            _ => 0.0,
        };
        let mut renderer = Renderer::new(vec![scene])?;
        for simd in SimdLevel::available() {
            let settings = ColumnSettings {
                simd,
                ..ColumnSettings::default()
            };
            let mut best: Option<ewa_splat::render::StageTimes> = None;
            let mut sum = 0.0;
            for frame in 0..6 {
                let image = renderer.column_density(&camera, &settings)?;
                sum = image.sum_times_area().unwrap_or(f64::NAN);
                let times = renderer.times();
                if frame > 0 && best.is_none_or(|b| times.frame < b.frame) {
                    best = Some(times);
                }
            }
            let Some(t) = best else { continue };
            let splat_pixels = renderer.counts().splat_pixels as f64;
            let core_ms = t.rasterise * rayon::current_num_threads() as f64;
            println!(
                "{name:>34} {:>9} {:6.1} {:6.1} {:8.1} {:6.1} {:6.1} {:7.1} {:7.1}  {:9.0} {:9.0} {:12.0} {:10.1e}",
                format!("{simd:?}"),
                t.cull,
                t.classify,
                t.project,
                t.bin,
                t.rasterise,
                t.resolve,
                t.frame,
                kernel_pixels * 1e-6,
                splat_pixels * 1e-6,
                splat_pixels / (core_ms * 1e3),
                sum / renderer.amplitudes().sum - 1.0
            );
        }
    }
    Ok(())
}

/// Returns spheres in a cube of `half_side`, standard deviations uniform in their logarithm.
fn spheres(count: usize, [smallest, largest]: [f64; 2], half_side: f64) -> PointVolume {
    let mut random = uniform(2);
    let mut positions = Vec::with_capacity(count);
    let mut sigmas = Vec::with_capacity(count);
    let mut masses = Vec::with_capacity(count);
    for _ in 0..count {
        let mut coordinate = || half_side * (2.0 * f64::from(random()) - 1.0);
        positions.push(DVec3::new(coordinate(), coordinate(), coordinate()));
        let sigma = smallest * (largest / smallest).powf(f64::from(random()));
        #[allow(clippy::cast_possible_truncation, reason = "kernels are stored in f32")]
        sigmas.push(sigma as f32);
        masses.push(0.5 + random());
    }
    PointVolume {
        particles: Particles::Isotropic { positions, sigmas },
        strength: Strength::Mass(masses),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns [`particles`], scaled so that a pixel of the column densities is a world unit.
fn particles_in_pixels(count: usize) -> PointVolume {
    const SCALE: f64 = 480.0;
    // Standard deviations of 2 px at a distance of 4 half sides: `particles` for this focal length.
    let mut volume = particles(count, 1024, 2.0);
    if let Particles::Anisotropic { positions, factors } = &mut volume.particles {
        let focal_px = 1024.0 / (2.0 * 15_f32.to_radians().tan());
        let shape_scale = focal_px / 4.0;
        for position in positions {
            *position *= SCALE;
        }
        for factor in factors {
            *factor = factor.map(|l| l * shape_scale);
        }
    }
    volume
}
