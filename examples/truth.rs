//! How far splats are from the field that they stand for: an analytic field on lattices, drawn by each
//! way to classify it, against its own emission-absorption integrals.
//!
//!     cargo run --release --example truth -- [SIZE [NODES...]]
//!
//! Prints a row of docs/truth.md for each lattice and way: root mean square and 99.9th percentile of the
//! error in levels of 255, linear colour, kernels drawn and the frame's time.

#![allow(
    clippy::cast_possible_truncation,
    reason = "pictures and values are f32"
)]

#[path = "scenes/analytic.rs"]
mod analytic;

use std::time::Instant;

use ewa_splat::render::Classification;
use ewa_splat::scene::{ColourSpace, ControlPoint, Lattice, PointVolume, TransferFunction};
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;
use rayon::prelude::*;

/// Centre, standard deviation and height of each blob.
const BLOBS: [([f64; 3], f64, f64); 6] = [
    ([-0.35, -0.30, -0.20], 0.34, 0.95),
    ([0.40, -0.25, 0.15], 0.28, 0.85),
    ([0.05, 0.45, -0.30], 0.30, 0.80),
    ([-0.30, 0.25, 0.45], 0.24, 0.70),
    ([0.35, 0.40, 0.40], 0.22, 0.75),
    ([0.05, -0.50, -0.50], 0.20, 0.60),
];

/// A sum of Gaussian blobs, 0 to about 1.
fn field(x: DVec3) -> f64 {
    BLOBS
        .iter()
        .map(|(centre, sigma, height)| {
            let away = x.distance_squared(DVec3::from(*centre));
            height * (-0.5 * away / (sigma * sigma)).exp()
        })
        .sum()
}

/// Rays to a pixel along each side, of the truth.
const RAYS: usize = 4;

/// Steps of a ray through the box.
const STEPS: usize = 400;

fn main() -> Result<()> {
    let numbers: Vec<usize> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let size = numbers.first().copied().unwrap_or(256);
    let nodes = match numbers.get(1..) {
        Some(nodes) if !nodes.is_empty() => nodes.to_vec(),
        _ => vec![33, 65, 129],
    };
    let camera = Camera::perspective(
        DVec3::new(2.3, -4.2, 1.9),
        DVec3::ZERO,
        DVec3::Z,
        35.0,
        [size, size],
    );
    for (name, transfer) in functions()? {
        let truth = analytic::truth(&camera, &transfer, field, RAYS, STEPS);
        for &n in &nodes {
            for (way, settings) in ways() {
                let row = measure(&camera, &transfer, n, &settings, &truth)?;
                println!("| {name} | {n}³ | {way} | {row} |");
            }
        }
    }
    Ok(())
}

fn functions() -> Result<Vec<(&'static str, TransferFunction)>> {
    let point = |value, opacity, colour| ControlPoint {
        value,
        colour: Some(colour),
        opacity: Some(opacity),
    };
    let (blue, orange) = ([0.2, 0.5, 1.0], [1.0, 0.6, 0.2]);
    let shells = [
        point(0.27, 0.0, blue),
        point(0.30, 0.9, blue),
        point(0.33, 0.0, blue),
        point(0.57, 0.0, orange),
        point(0.60, 0.98, orange),
        point(0.63, 0.0, orange),
    ];
    let smooth = [point(0.15, 0.0, blue), point(1.0, 0.7, orange)];
    let step = [
        point(0.3, 0.0, blue),
        point(0.3, 0.95, blue),
        point(1.0, 0.95, orange),
    ];
    let of = |points: &[ControlPoint]| {
        TransferFunction::from_points(points, ColourSpace::Linear, [0.0, 1.25], 0.1)
    };
    Ok(vec![
        ("shells", of(&shells)?),
        ("smooth", of(&smooth)?),
        ("step", of(&step)?),
    ])
}

fn ways() -> Vec<(String, Settings)> {
    let mut ways = Vec::new();
    for low_pass in [1.0, 0.3, 0.15, 0.1] {
        for (name, classify) in [
            ("particle", Classification::Particle),
            ("extent", Classification::Extent),
        ] {
            let settings = Settings {
                classify,
                low_pass_variance_px2: low_pass,
                ..Settings::default()
            };
            ways.push((format!("{name}, {low_pass}"), settings));
        }
    }
    ways
}

fn measure(
    camera: &Camera,
    transfer: &TransferFunction,
    nodes: usize,
    settings: &Settings,
    truth: &[[f64; 4]],
) -> Result<String> {
    let spacing = 2.0 / (nodes - 1) as f64;
    let lattice = Lattice::uniform([nodes; 3], DVec3::NEG_ONE, DVec3::splat(spacing));
    let values: Vec<f32> = (0..nodes.pow(3))
        .into_par_iter()
        .map(|i| {
            let at = [i % nodes, i / nodes % nodes, i / (nodes * nodes)];
            field(DVec3::from(at.map(|n| n as f64)) * spacing - 1.0) as f32
        })
        .collect();
    let volume = PointVolume::lattice(lattice, values, transfer.clone());
    let mut renderer = Renderer::new(vec![volume])?;
    renderer.render(camera, settings)?;
    let start = Instant::now();
    let image = renderer.render(camera, settings)?.clone();
    let time = start.elapsed().as_secs_f64() * 1e3;
    let mut squares = 0.0;
    let mut errors: Vec<f64> = image
        .pixels
        .iter()
        .zip(truth)
        .map(|(pixel, truth)| {
            let differences = [0, 1, 2].map(|c| (f64::from(pixel[c]) - truth[c]) * 255.0);
            squares += differences.iter().map(|d| d * d).sum::<f64>() / 3.0;
            differences.iter().map(|d| d.abs()).fold(0.0, f64::max)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let rms = (squares / errors.len() as f64).sqrt();
    let p999 = errors[errors.len() * 999 / 1000];
    let counts = renderer.counts();
    let times = renderer.times();
    Ok(format!(
        "{rms:.2} / {p999:.1} | {} of {} | {time:.0} ms (classify {:.0}, project {:.0}, sort {:.0}, bin {:.0}, rasterise {:.0})",
        counts.footprints,
        counts.classified,
        times.classify,
        times.project,
        times.sort,
        times.bin,
        times.rasterise
    ))
}
