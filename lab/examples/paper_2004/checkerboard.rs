//! Reproduces figure 8 and table 2: a slab of 512 x 512 x 3 opaque black and white voxels. Claims: the reconstruction
//! kernel alone aliases where voxels are smaller than pixels. The low-pass filter alone leaves holes where they are
//! larger. EWA does neither. Choosing a filter for each block looks the same and costs less.

use ewa_splat::Filter;
use ewa_splat::measure::{ImageErrors, PAPER_THRESHOLDS, compare};
use ewa_splat::render::Advanced;
use ewa_splat::scene::{
    Colour, Lattice, Particles, PointVolume, Strength, TransferFunction, Values,
};
use ewa_splat::stages::constants::MAX_CUTOFF;
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings, Show};
use glam::DVec3;

use crate::papers::pictures::{part, table_of};
use crate::papers::truth::supersampled;
use crate::papers::{Arguments, times};

/// Voxels along each side of the slab in images 512 pixels wide, and along a side of a square.
const VOXELS: usize = 512;
const SQUARE: usize = 8;
/// Layers of voxels.
const LAYERS: usize = 3;
const FOV_DEG: f64 = 45.0;
/// Linear RGB behind the slab: neither black nor white.
const SKY: [f32; 3] = [0.1, 0.25, 0.5];
/// Fine pixels along a pixel of the reference image.
const FACTOR: usize = 4;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let voxels = (VOXELS * arguments.size / 512).max(2 * SQUARE);
    let mut renderer = Renderer::new(vec![checkerboard(voxels)?])?;
    let [c_min, c_max] = PAPER_THRESHOLDS;
    println!(
        "{voxels} x {voxels} x {LAYERS} voxels, {0} x {0} pixels, {1} threads, medians of {2} frames; \
         errors in 255ths: from the same kernels supersampled {FACTOR} x {FACTOR} (the truth), from \
         everything exact, from EWA; thresholds: c_min {c_min}, c_max {c_max} (1 + 2 tan²(fov/2))",
        arguments.size,
        rayon::current_num_threads(),
        arguments.frames
    );
    let mut drawn = Vec::new();
    for (view, camera) in views(voxels as f64, arguments.size) {
        drawn.push(measure(&mut renderer, &camera, view, arguments)?);
    }
    // The colour plate: a part of each image.
    let side = arguments.size / 2;
    let [far, near, along, above] = [0, 1, 2, 3].map(|i| &drawn[i]);
    let cut = |pictures: &[(&str, Image)], name: &str, corner| {
        let found = pictures.iter().find(|(n, _)| *n == name);
        found.map_or_else(|| Image::new(1, 1), |(_, i)| part(i, corner, [side; 2]))
    };
    let rows = [
        [
            (far, "reconstruction"),
            (far, "ewa"),
            (near, "low-pass"),
            (near, "ewa"),
        ],
        [
            (along, "thresholds"),
            (along, "ewa"),
            (above, "thresholds"),
            (above, "ewa"),
        ],
    ]
    .map(|row| row.map(|(pictures, name)| cut(pictures, name, [side / 2, side / 2])));
    let rows: Vec<Vec<&Image>> = rows.iter().map(|row| row.iter().collect()).collect();
    arguments.write("checkerboard.png", &table_of(&rows))
}

/// Returns four views: from afar, where a voxel is half a pixel; from near the edge, where it is tens of pixels; along
/// the slab, from voxels of several pixels to the horizon; and from high above.
fn views(side: f64, size: usize) -> [(&'static str, Camera); 4] {
    let eye = |distance: f64, height: f64| DVec3::new(0.0, -(0.5 + distance) * side, height * side);
    let near = eye(0.02, 0.03);
    // Below the horizon by an eighth of the view's height.
    let dip = DVec3::new(0.0, 1.0, -(FOV_DEG.to_radians() / 2.0).tan() / 4.0);
    let along = DVec3::new(0.0, -0.30 * side, 0.10 * side);
    let camera = |eye, target| Camera::perspective(eye, target, DVec3::Z, FOV_DEG, [size; 2]);
    [
        ("far", camera(eye(2.0, 0.4), DVec3::ZERO)),
        ("near", camera(near, near + dip)),
        ("along", camera(along, along + 2.0 * dip.with_y(1.2))),
        ("above", camera(eye(0.9, 1.5), DVec3::ZERO)),
    ]
}

/// Returns the rows of the table: single filters and adaptive choices.
fn rows() -> Vec<(&'static str, Settings)> {
    let base = Settings {
        background: Some(SKY),
        ..Settings::default()
    };
    let of = |filter| Settings {
        filter,
        ..base.clone()
    };
    vec![
        ("ewa", of(Filter::Ewa)),
        ("reconstruction", of(Filter::Reconstruction)),
        ("low-pass", of(Filter::LowPass)),
        (
            "thresholds",
            Settings {
                advanced: Advanced {
                    thresholds: Some(PAPER_THRESHOLDS),
                    ..base.advanced
                },
                ..base.clone()
            },
        ),
        ("adaptive", base.clone()),
        ("exact", of(Filter::Exact)),
        (
            "everything-exact",
            Settings {
                tolerance: 1e-6,
                cutoff: Some(MAX_CUTOFF),
                level_of_detail: false,
                ..of(Filter::Exact)
            },
        ),
    ]
}

/// Prints the table of a view; returns its images by the names of the rows.
fn measure(
    renderer: &mut Renderer,
    camera: &Camera,
    view: &str,
    arguments: &Arguments,
) -> Result<Vec<(&'static str, Image)>> {
    let rows = rows();
    let truth = supersampled(renderer, camera, &rows[0].1, FACTOR)?;
    arguments.write(&format!("{view}-truth.png"), &truth)?;
    let mut pictures = Vec::new();
    let mut paths = Vec::new();
    for (name, settings) in &rows {
        let image = renderer.render(camera, settings)?.clone();
        let counts = renderer.counts();
        paths.push((counts.footprints, counts.block_filters));
        arguments.write(&format!("{view}-{name}.png"), &image)?;
        if settings.filter == Filter::Adaptive {
            let choice = Settings {
                show: Show::Choice,
                ..settings.clone()
            };
            let image = renderer.render(camera, &choice)?;
            arguments.write(&format!("{view}-{name}-choice.png"), image)?;
        }
        pictures.push((*name, image));
    }
    let settings: Vec<Settings> = rows.iter().map(|(_, settings)| settings.clone()).collect();
    // The slowest once, outside the rounds.
    let (exact, others) = settings.split_last().unwrap_or((&rows[0].1, &[]));
    let mut measured = times(renderer, camera, others, arguments.frames)?;
    measured.extend(times(renderer, camera, std::slice::from_ref(exact), 1)?);
    let times = measured;
    println!(
        "\n{view:<18} {:>8} {:>9} | {:>9} {:>8} | {:>9} {:>8} | {:>9} {:>8} | {:>10} {:>17}",
        "ms",
        "ewa's:1",
        "truth rms",
        "99.9 %",
        "exact rms",
        "99.9 %",
        "EWA rms",
        "FLIP",
        "footprints",
        "blocks R, L, EWA"
    );
    let [ewa, .., exact] = pictures.as_slice() else {
        return Ok(pictures);
    };
    for (((name, image), ms), (footprints, filters)) in pictures.iter().zip(&times).zip(&paths) {
        let from = |other: &Image| -> Result<ImageErrors> { compare(other, image) };
        let [a, b, c] = [from(&truth)?, from(&exact.1)?, from(&ewa.1)?];
        let of = |filter: Filter| filters[filter as usize];
        println!(
            "{name:<18} {ms:>8.1} {:>9.2} | {:>9.2} {:>8.2} | {:>9.2} {:>8.2} | {:>9.2} {:>8.4} | \
             {footprints:>10} {:>17}",
            times[0] / ms,
            a.rmse * 255.0,
            a.p999 * 255.0,
            b.rmse * 255.0,
            b.p999 * 255.0,
            c.rmse * 255.0,
            c.flip.unwrap_or(f64::NAN),
            format!(
                "{} {} {}",
                of(Filter::Reconstruction),
                of(Filter::LowPass),
                of(Filter::Ewa)
            )
        );
    }
    Ok(pictures)
}

/// Returns the slab around the origin, a unit between voxels, z up.
pub(crate) fn checkerboard(voxels: usize) -> Result<PointVolume> {
    let dims = [voxels, voxels, LAYERS];
    let origin = dims.map(|n| 0.5 - 0.5 * n as f64);
    let values = (0..voxels * voxels * LAYERS)
        .map(|i| (i % voxels / SQUARE, i / voxels % voxels / SQUARE))
        .map(|(x, y)| if (x + y) % 2 == 0 { 0 } else { u8::MAX })
        .collect();
    let transfer = TransferFunction::from_curves(|v| [v / 255.0; 3], |_| 0.99, [0.0, 255.0], 1.0)?;
    Ok(PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform(dims, DVec3::from(origin), DVec3::ONE),
            kernel_width: ewa_splat::sample::DEFAULT_KERNEL_WIDTH,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(Values::U8(values)),
        transfer_function: Some(transfer),
        boundary: None,
        normals: None,
        local_models: None,
    })
}
