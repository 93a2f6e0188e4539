//! Reproduces table 5: the time of an edit of the transfer function, up to the image, against building everything
//! again. The paper replaces the list of visible voxels, which each edit rebuilt, by lists of voxels sorted by value.
//! Claims: an edit is shown 9 to 13 times as fast, and frames without edits take a little longer. Here each block of
//! particles has a range of values, and nothing is kept of what is visible.
//!
//! The scenes are particles with values, a lattice of 16.8 times as many bytes (256³ for a million), and the engine.
//! "Anew" builds everything from the volume as read. "List" rebuilds the list of visible particles, as a renderer does
//! that keeps only these. Timed on the processor, and on a graphics card if there is one.

use std::hint::black_box;
use std::time::Instant;

use ewa_splat::scene::{
    Colour, ColourSpace, ControlPoint, Lattice, Particles, PointVolume, Strength, TransferFunction,
    Values,
};
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;

use crate::papers::volumes::engine;
use crate::papers::{Arguments, median};
use crate::scenes::{camera, particles, uniform};

/// Number of times of which long times are medians.
const SLOW_EDITS: usize = 3;

/// Visible parts of the range of values.
const WIDTHS: [(&str, [f32; 2]); 3] = [
    ("narrow", [0.50, 0.52]),
    ("medium", [0.45, 0.60]),
    ("wide", [0.15, 1.00]),
];

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    println!(
        "the processor, {} threads; medians of {} edits, ms",
        rayon::current_num_threads(),
        arguments.frames
    );
    time_scenes(arguments.size, arguments.frames, Ok)?;
    #[cfg(feature = "gpu")]
    {
        use ewa_splat::render::{AdapterChoice, Gpu};
        match Gpu::open(AdapterChoice::Hardware) {
            Ok(gpu) => {
                println!("{}", gpu.adapter());
                let on = |renderer: Renderer| renderer.on(gpu.clone());
                time_scenes(arguments.size, arguments.frames, on)?;
            }
            Err(e) => println!("no graphics card: {e}"),
        }
    }
    Ok(())
}

/// Prints a line for each scene and transfer function, in images of `size` in which cells of the lattice are two pixels
/// wide. `on` moves a renderer to its device.
fn time_scenes(size: usize, edits: usize, on: impl Fn(Renderer) -> Result<Renderer>) -> Result<()> {
    println!(
        "{:>18} {:>8} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7} {:>7}",
        "scene",
        "function",
        "visible",
        "edit",
        "anew",
        "list",
        "frame",
        "list's",
        "anew:1",
        "list:1",
        "frames"
    );
    let side = (size / 2).max(2);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a million for 256³ cells"
    )]
    let count = (1e6 * (side as f64 / 256.0).powi(3)) as usize;
    let time = |name: &str, volume| time_edits(name, volume, size, edits, &on);
    time(&format!("{count} particles"), with_values(count, size))?;
    time(&format!("{side}³ bytes"), lattice([side; 3], blobs(side)))?;
    if let Some(engine) = engine()? {
        time(engine.name, lattice(engine.dims, engine.values))?;
    }
    Ok(())
}

fn time_edits(
    name: &str,
    mut volume: PointVolume,
    size: usize,
    edits: usize,
    on: &impl Fn(Renderer) -> Result<Renderer>,
) -> Result<()> {
    let camera = camera([size; 2]);
    let settings = Settings::default();
    volume.transfer_function = Some(transfer(WIDTHS[0].1, 0.02)?);
    let mut renderer = on(Renderer::new(vec![volume.clone()])?)?;
    for (width, interval) in WIDTHS {
        // Edited back and forth.
        let functions = [transfer(interval, 0.02)?, transfer(interval, 0.01)?];
        let mut times: [Vec<f64>; 5] = Default::default();
        for i in 0..=edits {
            let function = &functions[i % 2];
            // The data to build again are copied before the clock runs.
            let mut anew = volume.clone();
            anew.transfer_function = Some(function.clone());
            let edited = function.clone();

            let mut starts = vec![Instant::now()];
            renderer.set_transfer_function(0, edited)?;
            renderer.render(&camera, &settings)?;
            starts.push(Instant::now());
            renderer.render(&camera, &settings)?;
            starts.push(Instant::now());
            if (1..=SLOW_EDITS).contains(&i) {
                let listed = visible(&anew, function);
                let mut list = on(Renderer::new(vec![listed])?)?;
                list.render(&camera, &settings)?;
                starts.push(Instant::now());
                list.render(&camera, &settings)?;
                starts.push(Instant::now());
                let mut rebuilt = on(Renderer::new(vec![anew])?)?;
                rebuilt.render(&camera, &settings)?;
                starts.push(Instant::now());
                black_box((&list, &rebuilt));
            }
            if i > 0 {
                for (times, pair) in times.iter_mut().zip(starts.windows(2)) {
                    times.push((pair[1] - pair[0]).as_secs_f64() * 1e3);
                }
            }
        }
        let [edit, frame, list, list_frame, rebuilt] = times.map(|mut times| median(&mut times));
        println!(
            "{name:>18} {width:>8} {:>9} {edit:>8.1} {rebuilt:>8.1} {list:>8.1} {frame:>8.1} \
             {list_frame:>8.1} {:>7.1} {:>7.1} {:>7.2}",
            renderer.counts().classified,
            rebuilt / edit,
            list / edit,
            frame / list_frame,
        );
    }
    Ok(())
}

/// Returns the visible particles only, as pre-classification lists them; spheres for a lattice.
fn visible(volume: &PointVolume, transfer: &TransferFunction) -> PointVolume {
    let class = |i| {
        volume
            .values
            .as_ref()
            .map_or([0.0; 4], |v| transfer.classify(v.get(i)))
    };
    let classes: Vec<(usize, [f32; 4])> = (0..volume.particles.len())
        .map(|i| (i, class(i)))
        .filter(|(_, class)| class[3] > 0.0)
        .collect();
    let seen = || classes.iter().map(|&(i, _)| i);
    let (particles, cell) = match &volume.particles {
        Particles::Anisotropic { positions, factors } => {
            let positions = seen().map(|i| positions[i]).collect();
            let factors = seen().map(|i| factors[i]).collect();
            (Particles::Anisotropic { positions, factors }, 0.0)
        }
        Particles::Surfels { .. } => unreachable!("none of these data are surfels"),
        Particles::Isotropic { positions, sigmas } => {
            let positions = seen().map(|i| positions[i]).collect();
            let sigmas = seen().map(|i| sigmas[i]).collect();
            (Particles::Isotropic { positions, sigmas }, 0.0)
        }
        Particles::Lattice {
            lattice,
            kernel_width,
        } => {
            let [nx, ny, _] = lattice.dims;
            let cell = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
            let side = lattice.step([0; 3]).x_axis.length();
            let positions: Vec<DVec3> = seen().map(|i| lattice.position(cell(i))).collect();
            #[expect(clippy::cast_possible_truncation, reason = "kernels are stored in f32")]
            let (sigma, volume) = ((kernel_width * side) as f32, side.powi(3) as f32);
            let sigmas = vec![sigma; positions.len()];
            (Particles::Isotropic { positions, sigmas }, volume)
        }
    };
    let own = |i: usize| match &volume.strength {
        Strength::Classified { volumes } => volumes.get(i).copied().unwrap_or(cell),
        _ => 0.0,
    };
    PointVolume {
        particles,
        strength: Strength::Mass(classes.iter().map(|&(i, c)| c[3] * own(i)).collect()),
        colour: Colour::PerParticle(classes.iter().map(|(_, c)| [c[0], c[1], c[2]]).collect()),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns [`particles`] of 2 px with values that rise along x and vary, evenly spread over 0 to 255.
fn with_values(count: usize, size: usize) -> PointVolume {
    let mut volume = particles(count, size, 2.0);
    if let (Particles::Anisotropic { positions, .. }, Strength::Mass(masses)) =
        (&volume.particles, &volume.strength)
    {
        #[expect(clippy::cast_possible_truncation, reason = "values are stored in f32")]
        let value = |p: &DVec3| {
            let along = 0.5 + 0.5 * p.x + 0.1 * (4.0 * p.y).sin() * (3.0 * p.z).cos();
            (255.0 * along) as f32
        };
        volume.values = Some(Values::F32(positions.iter().map(value).collect()));
        let volumes = masses.iter().map(|m| m * 20.0).collect();
        volume.strength = Strength::Classified { volumes };
        volume.colour = Colour::Classified;
    }
    volume
}

/// Returns a lattice of cubes, its longest side 2, the origin in its middle.
fn lattice(dims: [usize; 3], values: Values) -> PointVolume {
    let [x, y, z] = dims.map(|n| n as f64);
    let step = 2.0 / x.max(y).max(z);
    let first = DVec3::new(x - 1.0, y - 1.0, z - 1.0) * (-0.5 * step);
    PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform(dims, first, DVec3::splat(step)),
            kernel_width: 0.6,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(values),
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns twelve smooth blobs in a cube of cells.
fn blobs(side: usize) -> Values {
    let mut random = uniform(3);
    let blobs: Vec<([f32; 3], f32)> = (0..12)
        .map(|_| {
            let centre = [0; 3].map(|_| 0.2 + 0.6 * random());
            (centre, 0.06 + 0.08 * random())
        })
        .collect();
    // A Gaussian is a product of three, one for each axis.
    let profiles: Vec<[Vec<f32>; 3]> = blobs
        .iter()
        .map(|(centre, sigma)| {
            centre.map(|c| {
                let at = |i: usize| ((i as f32 + 0.5) / side as f32 - c) / sigma;
                (0..side).map(|i| (-0.5 * at(i).powi(2)).exp()).collect()
            })
        })
        .collect();
    let mut values = Vec::with_capacity(side.pow(3));
    for z in 0..side {
        for y in 0..side {
            let rows: Vec<f32> = profiles.iter().map(|[_, v, w]| v[y] * w[z]).collect();
            for x in 0..side {
                let sum: f32 = profiles
                    .iter()
                    .zip(&rows)
                    .map(|([u, ..], r)| u[x] * r)
                    .sum();
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "held to a byte"
                )]
                values.push((255.0 * sum.min(1.0)) as u8);
            }
        }
    }
    Values::U8(values)
}

/// Shows a part of 0 to 255, with a slope on either side; `opacity` at the scale of a lattice's cells.
fn transfer([from, to]: [f32; 2], opacity: f32) -> Result<TransferFunction> {
    let (from, to) = (255.0 * from, 255.0 * to);
    let slope = 0.1 * (to - from);
    let point = |value, colour, opacity| ControlPoint {
        value,
        colour: Some(colour),
        opacity: Some(opacity),
    };
    let (cold, warm) = ([0.1, 0.3, 0.8], [1.0, 0.7, 0.2]);
    let points = [
        point(from, cold, 0.0),
        point(from + slope, cold, opacity),
        point(to - slope, warm, opacity),
        point(to, warm, 0.0),
    ];
    TransferFunction::from_points(&points, ColourSpace::Linear, [0.0, 255.0], 2.0 / 256.0)
}
