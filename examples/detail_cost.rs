//! What a frame costs against how many particles there are, with and without level of detail: the
//! same cube, filling the same picture, at the same optical depth, of 10⁴ spheres to 10⁷; and a
//! million of them (or as many as are asked for) from 16 times the distance.
//!
//!     cargo run --release --example detail_cost -- [SVG] [LARGEST] [SIZE] [FRAMES]

mod scenes;

use std::path::Path;

use ewa_splat::measure::median_times;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::{Error, Renderer, Result, Settings, io};
use glam::DVec3;
use plotters::prelude::*;
use scenes::{camera, uniform};

/// Optical depth through the cube, on average.
const DEPTH: f32 = 3.0;
/// Of the view from afar.
const FAR: f64 = 16.0;
const FAR_COUNT: usize = 1_000_000;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |i: usize, default: usize| {
        let given = arguments.get(i).and_then(|a| a.parse().ok());
        given.unwrap_or(default)
    };
    let largest = number(2, 10_000_000);
    let (size, frames) = (number(3, 512), number(4, 5).max(1));
    println!(
        "{size} x {size} pixels, {} threads, medians of {frames} frames\n\n\
         {:>9} {:>4} {:>7} {:>10} {:>10} {:>8} {:>8} {:>9} {:>9} {:>6}",
        rayon::current_num_threads(),
        "particles",
        "",
        "bytes",
        "footprints",
        "without",
        "M sp-px",
        "without",
        "ms",
        "without",
        "ratio"
    );
    let mut rows = Vec::new();
    let mut count = 10_000.min(largest);
    while count <= largest {
        let mut renderer = Renderer::new(vec![spheres(count)])?;
        rows.push(measure(&mut renderer, size, 1.0, frames)?);
        let is_last = count * 10 > largest;
        if count == FAR_COUNT || count < FAR_COUNT && is_last {
            measure(&mut renderer, size, FAR, frames)?;
        }
        count *= 10;
    }
    if let Some(path) = arguments.get(1) {
        let svg = plot(&rows)
            .map_err(|e| Error::format(path, "plot", "a drawing", e.to_string(), "report this"))?;
        io::write_bytes_atomically(Path::new(path), svg.as_bytes())?;
    }
    Ok(())
}

/// A number of particles, and milliseconds per frame with and without level of detail.
struct Row {
    count: usize,
    ms: [f64; 2],
}

fn measure(renderer: &mut Renderer, size: usize, away: f64, frames: usize) -> Result<Row> {
    let near = camera([size; 2]);
    let camera = ewa_splat::view::Camera {
        eye: near.eye * away,
        ..near
    };
    let with = Settings::default();
    let settings = [
        with.clone(),
        Settings {
            level_of_detail: false,
            ..with
        },
    ];
    let mut counts = [renderer.counts(); 2];
    let mut times = [Vec::new(), Vec::new()];
    // In rounds, after one that warms up.
    for frame in 0..=frames {
        for i in 0..2 {
            renderer.render(&camera, &settings[i])?;
            counts[i] = renderer.counts();
            if frame > 0 {
                times[i].push(renderer.times());
            }
        }
    }
    let ms = times.map(|t| median_times(&t).frame);
    let count = renderer.particle_count();
    let place = if away > 1.0 { "far" } else { "" };
    println!(
        "{count:>9} {place:>4} {:>7.1} {:>10} {:>10} {:>8.1} {:>8.1} {:>9.1} {:>9.1} {:>6.2}",
        renderer.bytes_per_particle(),
        counts[0].footprints,
        counts[1].footprints,
        counts[0].splat_pixels as f64 * 1e-6,
        counts[1].splat_pixels as f64 * 1e-6,
        ms[0],
        ms[1],
        ms[0] / ms[1]
    );
    Ok(Row { count, ms })
}

/// Spheres at random in a cube of side 2, as wide as gas particles of their density: standard
/// deviations of .66 mean distances (a cubic spline whose smoothing length is 1.2 of them).
fn spheres(count: usize) -> PointVolume {
    let mut random = uniform(3);
    let sigma = 0.3_f32.sqrt() * 1.2 * 2.0 / (count as f32).cbrt();
    // Masses of .5 to 1.5 over a face of 4.
    let mass = DEPTH * 4.0 / count as f32;
    let mut positions = Vec::with_capacity(count);
    let mut masses = Vec::with_capacity(count);
    let mut colours = Vec::with_capacity(count);
    for _ in 0..count {
        let place = [random(), random(), random()];
        positions.push(DVec3::from(place.map(|x| 2.0 * f64::from(x) - 1.0)));
        masses.push(mass * (0.5 + random()));
        // Waves across the cube, and noise from neighbour to neighbour.
        colours.push(place.map(|x| 0.5 + 0.3 * (9.0 * x).sin() + 0.2 * random()));
    }
    PointVolume {
        particles: Particles::Isotropic {
            positions,
            sigmas: vec![sigma; count],
        },
        strength: Strength::Mass(masses),
        colour: Colour::PerParticle(colours),
        values: None,
        transfer_function: None,
        normals: None,
    }
}

/// Milliseconds against particles, both logarithmic, as SVG.
fn plot(rows: &[Row]) -> std::result::Result<String, Box<dyn std::error::Error>> {
    let counts = || rows.iter().map(|row| row.count as f64);
    let all_ms = || rows.iter().flat_map(|row| row.ms);
    // Whole decades, whose ends have labels.
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let logs = values.map(f64::log10);
        let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v.floor()), b.max(v.ceil()))
        });
        (10_f64.powf(low)..10_f64.powf(high.max(low + 1.0))).log_scale()
    };
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, (720, 480)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .margin_right(40)
        .x_label_area_size(48)
        .y_label_area_size(64)
        .build_cartesian_2d(range(&mut counts()), range(&mut all_ms()))?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| {
            if *y < 1.0 {
                y.to_string()
            } else {
                format!("{y:.0}")
            }
        })
        .x_desc("particles")
        .y_desc("milliseconds per frame")
        .draw()?;
    let ink = [RGBColor(0xb3, 0x3c, 0x2e), RGBColor(0x2b, 0x2f, 0x36)];
    for (i, name) in ["with level of detail", "without"].into_iter().enumerate() {
        let points = || rows.iter().map(|row| (row.count as f64, row.ms[i]));
        chart
            .draw_series(LineSeries::new(points(), ink[i].stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], ink[i]));
        chart.draw_series(points().map(|at| Circle::new(at, 4, ink[i].filled())))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .border_style(BLACK.mix(0.3))
        .background_style(WHITE)
        .draw()?;
    root.present()?;
    drop(chart);
    drop(root);
    Ok(svg)
}
