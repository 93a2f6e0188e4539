//! Reproduces figure 10: a CT under a series of transfer functions. Flattened kernels draw one translucent iso-surface,
//! and volume kernels the softer matter. Claim: semi-transparent objects are rendered correctly. A piece of the volume
//! is compared with the reference integrator, which uses neither footprints nor an order.

use ewa_splat::measure::compare;
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceSettings};
use ewa_splat::scene::{Colour, PointVolume, Strength, TransferFunction};
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings};
use glam::DVec3;

use crate::papers::pictures::table_of;
use crate::papers::volumes::{Volume, engine, head, transfer};
use crate::papers::{Arguments, fitted_camera};

/// Voxels along each side of the piece, and pixels of its image.
const PIECE: usize = 16;
const PIECE_PX: usize = 40;
const BONE: [f32; 3] = [1.0, 0.75, 0.35];
/// Optical depth of the surface: an opacity of .8.
const SURFACE_DEPTH: f32 = 1.609;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    // The surface's value, and the first voxel of the piece, which contains the surface and its surroundings.
    let (data, value, first) = match engine()? {
        Some(engine) => (engine, 200.0, [112, 128, 32]),
        None => {
            let head = head(arguments.size);
            let at = |n: usize| n * head.dims[0] / 128;
            let first = [at(56), at(6), at(60)];
            (head, 150.0, first)
        }
    };
    let piece = data.part(first, [PIECE; 3]);
    println!(
        "{}, iso-surface at {value}; {} x {}; from the true integral: a piece of {PIECE}³ voxels, \
         {PIECE_PX} x {PIECE_PX}",
        data.name, arguments.size, arguments.size
    );
    println!(
        "{:>24} {:>9} {:>9} {:>9} {:>8} {:>9} {:>9}",
        "transfer function", "surfels", "visible", "ms", "opacity", "RMSE", "99.9 %"
    );
    let series = series(value)?;
    // The same camera for all: it fits the fullest transfer function.
    let fullest = Renderer::new(scene(&data, None, &series[2].2)?)?;
    let Some(camera) = fitted_camera(&fullest, arguments.size) else {
        println!("nothing to see");
        return Ok(());
    };
    let mut pictures = Vec::new();
    for (name, is_surface, transfer) in series {
        let on_surface = is_surface.then_some(f64::from(value));
        let scene = scene(&data, on_surface, &transfer)?;
        let surfels = scene.get(1).map_or(0, |surface| surface.particles.len());
        let mut renderer = Renderer::new(scene)?;
        let settings = Settings {
            background: Some([0.0; 3]),
            ..Settings::default()
        };
        let image = renderer.render(&camera, &settings)?.clone();
        let (counts, ms) = (renderer.counts(), renderer.times().frame);
        let (truth, drawn) = true_piece(&piece, on_surface, &transfer)?;
        let errors = compare(&drawn, &truth)?;
        let opacity =
            truth.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / truth.pixels.len() as f64;
        println!(
            "{name:>24} {surfels:>9} {:>9} {ms:>9.0} {opacity:>8.2} {:>9.4} {:>9.4}",
            counts.classified, errors.rmse, errors.p999
        );
        let file = name.replace(' ', "-");
        arguments.write(&format!("semi-{file}.png"), &image)?;
        pictures.push(image);
    }
    let rows: Vec<Vec<&Image>> = pictures.chunks(2).map(|row| row.iter().collect()).collect();
    arguments.write("semi-transparent.png", &table_of(&rows))
}

/// Returns the volume's kernels, and its iso-surface as translucent surfels.
fn scene(
    data: &Volume,
    on_surface: Option<f64>,
    transfer: &TransferFunction,
) -> Result<Vec<PointVolume>> {
    let mut volumes = data.scene(transfer)?;
    let Some(value) = on_surface else {
        return Ok(volumes);
    };
    for mut surface in data.surface(value)? {
        if let Strength::Surface(areas) = surface.strength {
            let depths = areas.iter().map(|area| SURFACE_DEPTH * area);
            surface.strength = Strength::Translucent(depths.collect());
        }
        surface.colour = Colour::Uniform(BONE);
        volumes.push(surface);
    }
    Ok(volumes)
}

/// Returns transfer functions from the surface alone to everything, and whether surfels draw the surface.
fn series(value: f32) -> Result<[(&'static str, bool, TransferFunction); 4]> {
    let (bone, flesh, haze) = (BONE, [0.15, 0.35, 0.8], [0.3, 0.6, 0.4]);
    let (below, rise) = (0.92 * value, 0.05 * value);
    let hard = |opacity| [(below, bone, 0.0), (below + rise, bone, opacity)];
    let nothing = [(0.0, bone, 0.0)];
    let soft = |opacity| {
        [
            (0.25 * value, haze, 0.0),
            (0.5 * value, flesh, opacity),
            (below - rise, flesh, opacity),
        ]
    };
    let all = |a, b| [soft(a).as_slice(), hard(b).as_slice()].concat();
    let soft_alone = |a| [soft(a).as_slice(), &[(below, flesh, 0.0)]].concat();
    Ok([
        ("surface alone", true, transfer(&nothing)?),
        ("in a haze", true, transfer(&soft_alone(0.006))?),
        ("in denser flesh", true, transfer(&soft_alone(0.04))?),
        (
            "translucent, no surface",
            false,
            transfer(&all(0.015, 0.15))?,
        ),
    ])
}

/// Returns the reference image of a piece of the volume, and the rendered one. Both apply the low-pass filter to the
/// kernels, so that they differ only by the order and the overlap of kernels.
fn true_piece(
    piece: &Volume,
    on_surface: Option<f64>,
    transfer: &TransferFunction,
) -> Result<(Image, Image)> {
    let scene = scene(piece, on_surface, transfer)?;
    let eye = DVec3::new(1.6, -2.6, 1.7) * PIECE as f64;
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 30.0, [PIECE_PX; 2]);
    let settings = ReferenceSettings {
        error: 1e-3,
        pixel_filter: PixelFilter::Kernels,
        ..ReferenceSettings::default()
    };
    let truth = Integrator::new(&scene)?.render(&camera, &settings)?;
    let drawn = Renderer::new(scene)?
        .render(&camera, &Settings::default())?
        .clone();
    Ok((truth.image, drawn))
}
