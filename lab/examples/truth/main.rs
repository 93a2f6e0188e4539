//! Measures how far splats are from the field that they represent. An analytic field on lattices, on a warped grid and
//! on jittered tetrahedra is rendered in several ways. The images are compared with the emission-absorption integrals
//! of the field, and with those of the interpolated data.
//!
//!     cargo run --release -p ewa-splat-lab --example truth -- [--size N] [--export DIR | --turn] [GRID|FUNCTION|WAY ...]
//!
//! Prints the rows of docs/truth.md; with `--turn`, the rows of changes between frames. Words select grids, functions
//! and ways, such as `lattice-65 shells "extent .15"`; without a word of a kind, all of that kind are run. `--export`
//! writes grids and reference images for `lab/examples/vtk_truth.py`.

#![allow(
    clippy::cast_possible_truncation,
    reason = "pictures and values are f32"
)]

#[path = "../scenes/analytic.rs"]
mod analytic;
mod export;
mod functions;
mod grids;
mod turn;

use std::path::PathBuf;
use std::time::Instant;

use ewa_splat::io::Dataset;
use ewa_splat::reference::DataIntegrator;
use ewa_splat::render::{Advanced, Classification, Composite};
use ewa_splat::sample::{
    self, BoundaryChoice, FunctionOptions, KernelOptions, Refinement, SampleOptions, TransferChoice,
};
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::Camera;
use ewa_splat::{Error, Renderer, Result, Settings};
use functions::FUNCTIONS;
use glam::{DVec2, DVec3};
use grids::GRIDS;
use rayon::prelude::*;

const EYE: [f64; 3] = [2.3, -4.2, 1.9];
const FOV_DEG: f64 = 35.0;

/// Rays along each side of a pixel, in both kinds of reference images.
const RAYS: usize = 4;

/// Steps of a ray through the box.
const STEPS: usize = 400;

/// Reference images of the data have every third pixel along each side, because their rays are slow.
const EVERY: usize = 3;

/// Error of these rays, full scale 1.
const DATA_ERROR: f64 = 2e-4;

/// Number of frames of which the time is the median, after a warm-up frame; fewer if frames are slow.
const FRAMES: usize = 3;

/// Milliseconds of frames after which no more are timed.
const ENOUGH_MS: f64 = 1500.0;

struct Wanted {
    size: usize,
    export: Option<PathBuf>,
    turn: bool,
    words: Vec<String>,
}

impl Wanted {
    fn of(arguments: impl Iterator<Item = String>) -> Result<Self> {
        let mut wanted = Self {
            size: 256,
            export: None,
            turn: false,
            words: Vec::new(),
        };
        let mut arguments = arguments.skip(1);
        while let Some(argument) = arguments.next() {
            let known = GRIDS.iter().map(|g| g.0).chain(FUNCTIONS.map(|f| f.0));
            let known: Vec<String> = known.map(String::from).chain(names()).collect();
            match argument.as_str() {
                "--size" => {
                    let size = arguments.next().and_then(|a| a.parse().ok());
                    wanted.size = size.unwrap_or(wanted.size);
                }
                "--turn" => wanted.turn = true,
                "--export" => wanted.export = arguments.next().map(PathBuf::from),
                word if known.iter().any(|k| k == word) => wanted.words.push(argument),
                _ => {
                    let list = format!("one of {}", known.join(", "));
                    return Err(Error::invalid(
                        "truth",
                        "argument",
                        list,
                        argument,
                        "see the head of the example",
                    ));
                }
            }
        }
        Ok(wanted)
    }

    /// Whether a name is wanted, or no name of its kind was given.
    fn has(&self, name: &str, kind: &[String]) -> bool {
        let named = |n: &str| self.words.iter().any(|w| w == n);
        named(name) || !kind.iter().any(|n| named(n))
    }
}

/// A way to render.
struct Way {
    name: String,
    boundary: BoundaryChoice,
    /// True for kernels that are refined for the picture.
    is_refined: bool,
    settings: Settings,
}

fn ways() -> Vec<Way> {
    let way = |name: &str, low_pass: f32, boundary, classify, composite| Way {
        name: format!("{name} {low_pass}").replace(" 0.", " ."),
        boundary,
        is_refined: false,
        settings: Settings {
            classify,
            composite,
            low_pass_variance_px2: low_pass,
            advanced: Advanced {
                opaque_edges: false,
                ..Advanced::default()
            },
            ..Settings::default()
        },
    };
    let (soft, sharp) = (BoundaryChoice::Soft, BoundaryChoice::Sharp);
    let (alone, extent) = (Classification::Particle, Classification::Extent);
    let slabs = Composite::SLABS;
    let mut ways = Vec::new();
    for low_pass in [1.0, 0.3, 0.15, 0.1] {
        ways.push(way("particle", low_pass, soft, alone, Composite::Over));
    }
    for low_pass in [1.0, 0.3, 0.15, 0.1] {
        ways.push(way("extent", low_pass, soft, extent, Composite::Over));
    }
    ways.push(way("sharp", 0.15, sharp, extent, Composite::Over));
    // As the program draws by default.
    let mut refined = way(
        "refined",
        0.15,
        BoundaryChoice::Automatic,
        extent,
        Composite::Over,
    );
    refined.is_refined = true;
    refined.settings.advanced.opaque_edges = true;
    ways.push(refined);
    ways.push(way("post", 0.15, soft, Classification::Slab, slabs));
    ways.push(way("sharp-post", 0.15, sharp, Classification::Slab, slabs));
    ways
}

fn names() -> Vec<String> {
    ways().into_iter().map(|way| way.name).collect()
}

fn main() -> Result<()> {
    let wanted = Wanted::of(std::env::args())?;
    let list = |names: &[&str]| names.iter().map(|&n| n.to_owned()).collect::<Vec<_>>();
    let (grids, functions) = (list(&GRIDS.map(|g| g.0)), list(&FUNCTIONS.map(|f| f.0)));
    let size = wanted.size;
    let camera = Camera::perspective(EYE.into(), DVec3::ZERO, DVec3::Z, FOV_DEG, [size; 2]);
    if wanted.turn {
        println!("| function, grid | low-pass | field | splats | between them |");
        println!("|---|---|---|---|---|");
        for (name, kind, n) in GRIDS.into_iter().filter(|g| wanted.has(g.0, &grids)) {
            let dataset = grids::dataset(kind, n);
            for (function, points) in FUNCTIONS.iter().filter(|f| wanted.has(f.0, &functions)) {
                let transfer = functions::transfer(points)?;
                let mut renderer = renderer(&dataset, &transfer, BoundaryChoice::Soft, None)?;
                let name = format!("{function}, {name}");
                turn::rows(&name, &mut renderer, &transfer, size)?;
            }
        }
        return Ok(());
    }
    if let Some(folder) = &wanted.export {
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::io(folder, "making the folder", e, "name another"))?;
        export::scene(folder, size, &FUNCTIONS)?;
    }
    let mut truths = Vec::new();
    for (name, points) in FUNCTIONS.iter().filter(|f| wanted.has(f.0, &functions)) {
        let transfer = functions::transfer(points)?;
        let truth = analytic::truth(&camera, &transfer, grids::field, RAYS, STEPS);
        if let Some(folder) = &wanted.export {
            export::truth(folder, name, size, &truth)?;
        }
        truths.push((*name, transfer, truth));
    }
    println!(
        "| function | grid | way | from the field | from the data | ms | kernels | bytes a particle |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (name, kind, n) in GRIDS.into_iter().filter(|g| wanted.has(g.0, &grids)) {
        let dataset = grids::dataset(kind, n);
        if let Some(folder) = &wanted.export {
            export::grid(folder, name, &dataset)?;
        }
        rows(name, &dataset, &camera, &truths, &wanted)?;
    }
    Ok(())
}

/// Name of a function, the function, and its reference image.
type Truth = (&'static str, TransferFunction, Vec<[f64; 4]>);

fn rows(
    grid: &str,
    dataset: &Dataset,
    camera: &Camera,
    truths: &[Truth],
    wanted: &Wanted,
) -> Result<()> {
    let mut soft = renderer(dataset, &truths[0].1, BoundaryChoice::Soft, None)?;
    let mut sharp = renderer(dataset, &truths[0].1, BoundaryChoice::Sharp, None)?;
    for (function, transfer, truth) in truths {
        let start = Instant::now();
        let data = of_data(dataset, transfer, camera)?;
        let seconds = start.elapsed().as_secs_f64();
        let seen: Vec<[f64; 4]> = places(camera).map(|i| truth[i]).collect();
        println!(
            "| {function} | {grid} | the data | {} | 0 | {:.0} | | |",
            errors(&data, &seen),
            seconds * 1e3
        );
        for way in ways().iter().filter(|w| wanted.has(&w.name, &names())) {
            let mut refined;
            let renderer = match way.boundary {
                _ if way.is_refined => {
                    let refinement = Refinement {
                        cameras: vec![camera.clone()],
                        ..Refinement::for_tolerance(way.settings.tolerance)
                    };
                    refined = renderer(dataset, transfer, way.boundary, Some(refinement))?;
                    &mut refined
                }
                BoundaryChoice::Sharp => &mut sharp,
                _ => &mut soft,
            };
            if !way.is_refined {
                renderer.set_transfer_function(0, transfer.clone())?;
            }
            renderer.render(camera, &way.settings)?;
            let mut times: Vec<f64> = Vec::new();
            while times.len() < FRAMES && times.iter().sum::<f64>() < ENOUGH_MS {
                let start = Instant::now();
                renderer.render(camera, &way.settings)?;
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            times.sort_by(f64::total_cmp);
            let pixels: Vec<[f64; 4]> = renderer.image().pixels.iter().map(widened).collect();
            let some: Vec<[f64; 4]> = places(camera).map(|i| pixels[i]).collect();
            println!(
                "| {function} | {grid} | {} | {} | {} | {:.0} | {} | {:.1} |",
                way.name,
                errors(&pixels, truth),
                errors(&some, &data),
                times[times.len() / 2],
                renderer.counts().footprints,
                renderer.bytes_per_particle(),
            );
        }
    }
    Ok(())
}

fn widened(pixel: &[f32; 4]) -> [f64; 4] {
    pixel.map(f64::from)
}

fn renderer(
    dataset: &Dataset,
    transfer: &TransferFunction,
    boundary: BoundaryChoice,
    refinement: Option<Refinement>,
) -> Result<Renderer> {
    let options = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::Given(transfer.clone()),
            ..FunctionOptions::default()
        },
        refinement,
        kernels: KernelOptions {
            boundary,
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let volume = sample::volume(dataset.clone(), &options)?.volume;
    Renderer::new(vec![volume])
}

/// Pixels at which the reference image of the data is computed.
fn places(camera: &Camera) -> impl Iterator<Item = usize> {
    let [width, height] = [camera.width, camera.height];
    let row = move |y| {
        (EVERY / 2..width)
            .step_by(EVERY)
            .map(move |x| y * width + x)
    };
    (EVERY / 2..height).step_by(EVERY).flat_map(row)
}

/// Renders the reference image of the data, interpolated in their cells, with as many rays as that of the field.
fn of_data(
    dataset: &Dataset,
    transfer: &TransferFunction,
    camera: &Camera,
) -> Result<Vec<[f64; 4]>> {
    let integrator = DataIntegrator::new(dataset.clone(), "field", transfer.clone())?;
    let pixel = |i: usize| {
        let corner = DVec2::new((i % camera.width) as f64, (i / camera.width) as f64);
        let mut sum = [0.0; 4];
        for n in 0..RAYS * RAYS {
            let at = DVec2::new((n % RAYS) as f64, (n / RAYS) as f64) + 0.5;
            let ray = integrator.ray(camera, corner + at / RAYS as f64, DATA_ERROR);
            for (sum, c) in sum.iter_mut().zip(ray.rgba) {
                *sum += c / (RAYS * RAYS) as f64;
            }
        }
        sum
    };
    let places: Vec<usize> = places(camera).collect();
    Ok(places.into_par_iter().map(pixel).collect())
}

/// Returns the root mean square and the 99.9th percentile (largest channel of a pixel) of the error, in levels of 255,
/// linear RGB.
fn errors(pixels: &[[f64; 4]], truth: &[[f64; 4]]) -> String {
    let mut squares = 0.0;
    let mut largest: Vec<f64> = pixels
        .iter()
        .zip(truth)
        .map(|(pixel, truth)| {
            let differences = [0, 1, 2].map(|c| (pixel[c] - truth[c]) * 255.0);
            squares += differences.iter().map(|d| d * d).sum::<f64>() / 3.0;
            differences.iter().map(|d| d.abs()).fold(0.0, f64::max)
        })
        .collect();
    largest.sort_by(f64::total_cmp);
    let count = largest.len();
    let rms = (squares / count as f64).sqrt();
    format!("{rms:.2} / {:.1}", largest[count * 999 / 1000])
}
