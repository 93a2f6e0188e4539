//! Measures the cost of a frame against the number of particles, with and without level of detail. The scene is the
//! same cube, filling the same image at the same optical depth, of 10⁴ to 10⁷ spheres. A million spheres (or as many as
//! requested) are also seen from 16 times the distance.
//!
//!     cargo run --release -p ewa-splat-lab --example detail_cost -- [SVG] [LARGEST] [SIZE] [FRAMES]

mod scenes;

use std::path::Path;

use ewa_splat::measure::median_times;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::{Renderer, Result, Settings, io};
use glam::DVec3;
use scenes::{camera, uniform};

/// Mean optical depth through the cube.
const DEPTH: f32 = 3.0;
/// Distance of the far view, as a multiple of the near one.
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
        io::write_bytes_atomically(Path::new(path), plot(&rows).as_bytes())?;
    }
    Ok(())
}

/// Number of particles, and milliseconds per frame with and without level of detail.
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
    // In rounds, after a warm-up round.
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

/// Returns spheres at random in a cube of side 2, as wide as gas particles of their density: standard deviations of .66
/// mean distances (a cubic spline with a smoothing length of 1.2 mean distances).
fn spheres(count: usize) -> PointVolume {
    let mut random = uniform(3);
    let sigma = 0.3_f32.sqrt() * 1.2 * 2.0 / (count as f32).cbrt();
    // Masses of .5 to 1.5 shares of the total, over a face of area 4.
    let mass = DEPTH * 4.0 / count as f32;
    let mut positions = Vec::with_capacity(count);
    let mut masses = Vec::with_capacity(count);
    let mut colours = Vec::with_capacity(count);
    for _ in 0..count {
        let place = [random(), random(), random()];
        positions.push(DVec3::from(place.map(|x| 2.0 * f64::from(x) - 1.0)));
        masses.push(mass * (0.5 + random()));
        // Waves across the cube, and noise between neighbours.
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
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Plots milliseconds against particles as SVG, both axes logarithmic.
fn plot(rows: &[Row]) -> String {
    const INK: [&str; 2] = ["#b33c2e", "#2b2f36"];
    /// Left, right, top and bottom of the plot in an image of 720 x 480 pixels.
    const FRAME: [f64; 4] = [76.0, 680.0, 12.0, 420.0];
    let [left, right, top, bottom] = FRAME;
    // Whole decades, with labels at their ends.
    let decades = |values: &mut dyn Iterator<Item = f64>| {
        let logs = values.map(f64::log10);
        let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v.floor()), b.max(v.ceil()))
        });
        (low, high.max(low + 1.0))
    };
    let (first, last) = decades(&mut rows.iter().map(|row| row.count as f64));
    let (least, most) = decades(&mut rows.iter().flat_map(|row| row.ms));
    let x = |count: f64| left + (count.log10() - first) / (last - first) * (right - left);
    let y = |ms: f64| bottom - (ms.log10() - least) / (most - least) * (bottom - top);
    // Powers of ten from one whole logarithm to another.
    let powers = |low: f64, high: f64| {
        let logs = std::iter::successors(Some(low), |log| Some(log + 1.0));
        let logs = logs.take_while(move |log| *log <= high).take(20);
        logs.map(|log| 10_f64.powf(log))
    };
    let number = |x: f64| {
        if x < 1.0 {
            x.to_string()
        } else {
            format!("{x:.0}")
        }
    };

    let mut svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"720\" height=\"480\" \
                   font-family=\"sans-serif\" font-size=\"13\" text-anchor=\"middle\">\n\
                   <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        .to_owned();
    for count in powers(first, last) {
        let (x, count) = (x(count), number(count));
        svg += &format!("<path d=\"M{x:.1} {top}V{bottom}\" stroke=\"#ccc\"/>");
        svg += &format!("<text x=\"{x:.1}\" y=\"440\">{count}</text>\n");
    }
    for ms in powers(least, most) {
        let (y, ms) = (y(ms), number(ms));
        svg += &format!("<path d=\"M{left} {y:.1}H{right}\" stroke=\"#ccc\"/>");
        svg += &format!("<text x=\"48\" y=\"{y:.1}\" dy=\".35em\">{ms}</text>\n");
    }
    svg += "<text x=\"378\" y=\"466\">particles</text>\n\
            <text transform=\"translate(18 216) rotate(-90)\">milliseconds per frame</text>\n";
    for (i, name) in ["with level of detail", "without"].into_iter().enumerate() {
        let ink = INK[i];
        let points = rows.iter().map(|row| (x(row.count as f64), y(row.ms[i])));
        let places: Vec<String> = points
            .clone()
            .map(|(x, y)| format!("{x:.1},{y:.1}"))
            .collect();
        let line = places.join(" ");
        svg += &format!("<polyline points=\"{line}\" fill=\"none\" stroke=\"{ink}\"/>\n");
        for (x, y) in points {
            svg += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{ink}\"/>");
        }
        let below = 32 + 20 * i;
        svg += &format!("<text x=\"170\" y=\"{below}\" fill=\"{ink}\">{name}</text>\n");
    }
    svg + "</svg>\n"
}
