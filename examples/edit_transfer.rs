//! Times edits of a transfer function, to the picture, against making everything anew: what Table 5
//! of Chen et al. 2004 compares. There lists of voxels by value replace the list of visible voxels
//! that each edit rebuilt, and an edit is 9 to 13 times as fast. Here blocks of particles know their
//! range of values, and nothing is kept of what is visible.
//!
//!     cargo run --release --example edit_transfer [PARTICLES [FILE X Y Z]]
//!
//! Particles with values, a lattice of 16.8 times as many bytes (256³ for a million), and a raw file
//! of X x Y x Z bytes. Rebuilt is either everything, from the volume as it was read, or, where a
//! renderer keeps the visible ones alone, their list. Times are medians of [`EDITS`], in
//! milliseconds, on the processor and on an adapter; a software adapter gets a twentieth.

mod scenes;

use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::scene::{
    Colour, ColourSpace, ControlPoint, Lattice, Particles, PointVolume, Strength, TransferFunction,
    Values,
};
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;
use scenes::{camera, particles, uniform};

/// Edits that are timed, after one that fills buffers.
const EDITS: usize = 5;

/// Parts of the range of values that are visible.
const WIDTHS: [(&str, [f32; 2]); 3] = [
    ("narrow", [0.50, 0.52]),
    ("medium", [0.45, 0.60]),
    ("wide", [0.15, 1.00]),
];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments.get(i).and_then(|a: &String| a.parse().ok());
    let count: usize = number(0).unwrap_or(1_000_000);
    let raw = match (arguments.get(1), number(2), number(3), number(4)) {
        (Some(path), Some(x), Some(y), Some(z)) => Some((PathBuf::from(path), [x, y, z])),
        _ => None,
    };
    println!("the processor, {} threads", rayon::current_num_threads());
    time_scenes(count, raw.as_ref(), Ok)?;
    #[cfg(feature = "gpu")]
    {
        use ewa_splat::gpu::{AdapterChoice, Gpu};
        let gpu = match Gpu::open(AdapterChoice::Any) {
            Ok(gpu) => gpu,
            Err(e) => {
                println!("\nno adapter: {e}");
                return Ok(());
            }
        };
        println!("\n{}", gpu.adapter());
        let on = |renderer: Renderer| renderer.on(gpu.clone());
        if gpu.is_software() {
            println!("a software adapter: its times say nothing of a graphics card's");
            time_scenes(count / 20, None, on)?;
        } else {
            time_scenes(count, raw.as_ref(), on)?;
        }
    }
    Ok(())
}

/// A line for every scene and transfer function; `on` moves a renderer to its device.
fn time_scenes(
    count: usize,
    raw: Option<&(PathBuf, [usize; 3])>,
    on: impl Fn(Renderer) -> Result<Renderer>,
) -> Result<()> {
    println!(
        "{:>26} {:>8} {:>10} {:>8} {:>8} {:>8} {:>8} {:>6} {:>6}",
        "scene", "function", "visible", "frame", "edit", "anew", "list", "anew:1", "list:1"
    );
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the side of a small cube"
    )]
    let side = ((count as f64).cbrt() * 2.56).round().max(2.0) as usize;
    // A cell is two pixels wide.
    let size = 2 * side;
    let time = |name: &str, volume| time_edits(name, volume, size, &on);
    time(&format!("{count} particles"), with_values(count, size))?;
    time(&format!("{side}³ bytes"), lattice([side; 3], blobs(side)))?;
    if let Some((path, dims)) = raw {
        let options = OpenOptions {
            raw: Some(RawLayout::new(*dims, RawType::U8)),
            ..OpenOptions::default()
        };
        let (_, values) = open(path, &options)?.scalar("value")?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        time(&name, lattice(*dims, values))?;
    }
    Ok(())
}

fn time_edits(
    name: &str,
    mut volume: PointVolume,
    size: usize,
    on: &impl Fn(Renderer) -> Result<Renderer>,
) -> Result<()> {
    let camera = camera([size; 2]);
    let settings = Settings::default();
    volume.transfer_function = Some(transfer(WIDTHS[0].1, 0.02)?);
    let mut renderer = on(Renderer::new(vec![volume.clone()])?)?;
    for (width, interval) in WIDTHS {
        // Edited to and fro.
        let functions = [transfer(interval, 0.02)?, transfer(interval, 0.01)?];
        let mut times: [Vec<f64>; 4] = Default::default();
        for i in 0..=EDITS {
            let function = &functions[i % 2];
            // What is made anew is copied before the clock runs.
            let mut anew = volume.clone();
            anew.transfer_function = Some(function.clone());
            let edited = function.clone();

            let mut starts = vec![Instant::now()];
            renderer.set_transfer_function(0, edited)?;
            renderer.render(&camera, &settings)?;
            starts.push(Instant::now());
            renderer.render(&camera, &settings)?;
            starts.push(Instant::now());
            let listed = visible(&anew, function);
            let mut list = on(Renderer::new(vec![listed])?)?;
            list.render(&camera, &settings)?;
            starts.push(Instant::now());
            let mut rebuilt = on(Renderer::new(vec![anew])?)?;
            rebuilt.render(&camera, &settings)?;
            starts.push(Instant::now());
            black_box((&list, &rebuilt));
            if i > 0 {
                for (times, pair) in times.iter_mut().zip(starts.windows(2)) {
                    times.push((pair[1] - pair[0]).as_secs_f64() * 1e3);
                }
            }
        }
        let [edit, frame, list, rebuilt] = times.map(|mut times| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        });
        println!(
            "{name:>26} {width:>8} {:10} {frame:8.1} {edit:8.1} {rebuilt:8.1} {list:8.1} {:6.1} {:6.1}",
            renderer.counts().classified,
            rebuilt / edit,
            list / edit,
        );
    }
    Ok(())
}

/// The visible particles alone, as pre-classification lists them; of a lattice, spheres.
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
        normals: None,
    }
}

/// [`particles`] of 2 px with values that rise along x and waver, evenly spread over 0 to 255.
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

/// A lattice of cubes, its longest side 2, the origin in its middle.
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
        normals: None,
    }
}

/// Twelve smooth blobs in a cube of cells.
fn blobs(side: usize) -> Values {
    let mut random = uniform(3);
    let blobs: Vec<([f32; 3], f32)> = (0..12)
        .map(|_| {
            let centre = [0; 3].map(|_| 0.2 + 0.6 * random());
            (centre, 0.06 + 0.08 * random())
        })
        .collect();
    // A Gaussian is a product of three, each of one axis alone.
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

/// Visible in a part of 0 to 255, with a slope on either side of it; `opacity` at the scale of
/// a lattice's cells.
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
