//! Reproduces figure 9: splatting every sample by itself against adding up slices, under a series of transfer
//! functions. Claims: every sample by itself is darker, because its visibility is wrong, and faster. Slices across an
//! axis of the volume pop where the axis changes. The reference images are slabs so thin that thinner ones change
//! nothing.

use ewa_splat::Composite;
use ewa_splat::measure::compare;
use ewa_splat::render::Advanced;
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Image, Renderer, Result, Settings};
use glam::DVec3;

use crate::papers::pictures::table_of;
use crate::papers::volumes::{engine, head, transfer};
use crate::papers::{Arguments, times};

/// Thickness of the slabs in the reference images, voxels.
const THIN: f64 = 0.25;
/// A small rotation, degrees: across the angle at which the axis nearest to the view changes, and beside it.
const TURN_DEG: f64 = 0.02;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let data = match engine()? {
        Some(engine) => engine,
        None => head(arguments.size),
    };
    // The reference images are slow.
    let size = arguments.size / 2;
    println!(
        "{}, {1} x {1}, {2} threads, medians of {3} frames; brightness: mean green, as a share of the truth's; errors in 255ths from the truth (slabs of {THIN} voxels)",
        data.name,
        size,
        rayon::current_num_threads(),
        arguments.frames
    );
    println!(
        "{:>10} {:>9} {:>13} {:>8} {:>8} {:>10} {:>7} {:>8} {:>11} {:>10}",
        "function",
        "visible",
        "composition",
        "ms",
        "over's:1",
        "brightness",
        "rms",
        "99.9 %",
        "pop, rms",
        "beside it"
    );
    let mut rows = Vec::new();
    for (name, transfer) in series()? {
        let mut renderer = Renderer::new(data.scene(&transfer)?)?;
        let boxes = renderer.visible_boxes();
        let camera = |azimuth_deg: f64| {
            let view = Viewpoint {
                azimuth_deg,
                elevation_deg: 20.0,
                zoom: 1.0,
                up: DVec3::Z,
            };
            view.camera(&boxes, Lens::FovDeg(30.0), [size; 2])
        };
        let Some(fitted) = camera(30.0) else { continue };
        let of = |composite, linear_opacity| Settings {
            composite,
            advanced: Advanced {
                linear_opacity,
                ..Advanced::default()
            },
            ..Settings::default()
        };
        let names = [
            "over",
            "over, linear",
            "axis-sheets",
            "axis, linear",
            "sheets",
        ];
        let settings = [
            of(Composite::Over, false),
            of(Composite::Over, true),
            of(Composite::AXIS_SHEETS, false),
            of(Composite::AXIS_SHEETS, true),
            of(Composite::SHEETS, false),
        ];
        let truth = Settings {
            composite: Composite::SLABS.with_thickness(Some(THIN)),
            ..Settings::default()
        };
        let truth = renderer.render(&fitted, &truth)?.clone();
        let times = times(&mut renderer, &fitted, &settings, arguments.frames)?;
        let mut row = vec![truth.clone()];
        for ((settings, ms), composite) in settings.iter().zip(&times).zip(names) {
            let image = renderer.render(&fitted, settings)?.clone();
            let visible = renderer.counts().classified;
            let errors = compare(&truth, &image)?;
            // The same eye, rotated about the volume's axis: at 45 degrees the nearest axis changes.
            let mut jump = |azimuth_deg: f64| -> Result<f64> {
                let [before, after] = [-TURN_DEG, TURN_DEG].map(|turn| camera(azimuth_deg + turn));
                let (Some(before), Some(after)) = (before, after) else {
                    return Ok(f64::NAN);
                };
                difference(&mut renderer, &before, &after, settings)
            };
            let (pop, beside) = (jump(45.0)?, jump(43.0)?);
            println!(
                "{name:>10} {visible:>9} {:>13} {ms:>8.0} {:>8.2} {:>10.3} {:>7.2} {:>8.2} {:>11.2} \
                 {:>10.2}",
                composite,
                times[0] / ms,
                brightness(&image) / brightness(&truth),
                errors.rmse * 255.0,
                errors.p999 * 255.0,
                pop * 255.0,
                beside * 255.0
            );
            row.push(image);
        }
        rows.push(row);
    }
    let black = |image: &Image| Image {
        pixels: image
            .pixels
            .iter()
            .map(|&[r, g, b, _]| [r, g, b, 1.0])
            .collect(),
        ..*image
    };
    let rows: Vec<Vec<Image>> = rows
        .iter()
        .map(|row| row.iter().map(black).collect())
        .collect();
    let rows: Vec<Vec<&Image>> = rows.iter().map(|row| row.iter().collect()).collect();
    arguments.write("composition.png", &table_of(&rows))
}

/// Dark outside, bright within: translucent, opaque, and the inside only.
fn series() -> Result<[(&'static str, TransferFunction); 3]> {
    let (dark, bright) = ([0.12, 0.10, 0.08], [1.0, 0.85, 0.6]);
    let from = |value: f32, opacity| {
        transfer(&[
            (value, dark, 0.0),
            (value + 10.0, dark, opacity),
            (190.0, bright, opacity),
        ])
    };
    Ok([
        ("faint", from(20.0, 0.05)?),
        ("opaque", from(100.0, 0.95)?),
        ("inside", from(145.0, 0.3)?),
    ])
}

/// Returns the root mean square change that a rotation makes.
fn difference(
    renderer: &mut Renderer,
    before: &Camera,
    after: &Camera,
    settings: &Settings,
) -> Result<f64> {
    let first = renderer.render(before, settings)?.clone();
    Ok(compare(&first, renderer.render(after, settings)?)?.rmse)
}

/// Returns the mean of green, premultiplied.
fn brightness(image: &Image) -> f64 {
    let sum: f64 = image.pixels.iter().map(|p| f64::from(p[1])).sum();
    sum / image.pixels.len() as f64
}
