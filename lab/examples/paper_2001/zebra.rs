//! Reproduces figure 8: a square zebra of 1024 x 512 and of 1024 x 256 voxels, whose kernels are ellipses of 2:1 and
//! 4:1. Claims: the EWA filter neither aliases nor blurs. Swan's uniform scaling of kernels equals it for round
//! kernels, but blurs along the longer axis, the more so the longer it is.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a grey value is held to a byte"
)]

use std::f64::consts::TAU;

use ewa_splat::Filter;
use ewa_splat::measure::compare;
use ewa_splat::scene::{
    Colour, Lattice, Particles, PointVolume, Strength, TransferFunction, Values,
};
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings};
use glam::{DVec2, DVec3};

use crate::papers::Arguments;
use crate::papers::pictures::{as_sheet, contrast, doubled, from_above, hit, part, table_of};
use crate::papers::truth::supersampled;

/// Voxels from left to right; the square is 2 wide.
const COLUMNS: usize = 1024;
/// Standard deviation over spacing, as in the paper (section 4.3).
const PAPER_WIDTH: f64 = 1.0;
const FOV_DEG: f64 = 30.0;
/// Optical depth of the slice: so small that nothing in it hides anything.
const DEPTH: f64 = 1e-3;
/// Fine pixels along a pixel of the reference image; half as many show how well it has converged.
const FACTOR: usize = 4;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    println!(
        "errors over full scale, from the same kernels supersampled {FACTOR} x {FACTOR} (the truth); \
         contrast from pixel to pixel, the truth's is 1"
    );
    println!(
        "{:>9} {:>6} {:>10} {:>16} {:>9} {:>9} {:>8} {:>9}",
        "kernels", "width", "view", "filter", "RMSE", "99.9 %", "FLIP", "contrast"
    );
    let mut pictures = Vec::new();
    for (rows, width) in [
        (1024, PAPER_WIDTH),
        (512, PAPER_WIDTH),
        (256, PAPER_WIDTH),
        (256, ewa_splat::sample::DEFAULT_KERNEL_WIDTH),
    ] {
        let mut renderer = Renderer::new(vec![slice(rows, width)?])?;
        for (view, camera) in views(arguments.size) {
            let truth = supersampled(&mut renderer, &camera, &Settings::default(), FACTOR)?;
            let truth = sheet(&camera, &truth);
            for filter in [Filter::Ewa, Filter::UniformScaling, Filter::Reconstruction] {
                let settings = Settings {
                    filter,
                    ..Settings::default()
                };
                let image = sheet(&camera, renderer.render(&camera, &settings)?);
                let errors = compare(&image, &truth)?;
                println!(
                    "{:>9} {width:>6} {view:>10} {:>16} {:>9.4} {:>9.4} {:>8.4} {:>9.3}",
                    format!("{}:1", COLUMNS / rows),
                    filter.name(),
                    errors.rmse,
                    errors.p999,
                    errors.flip.unwrap_or(f64::NAN),
                    contrast(&image, &truth)
                );
                let name = format!("zebra-{rows}-{width}-{view}-{}.png", filter.name());
                arguments.write(&name, &image)?;
                pictures.push((rows, width, view, filter, image));
            }
            if view == "tilted" {
                let half = supersampled(&mut renderer, &camera, &Settings::default(), FACTOR / 2)?;
                let errors = compare(&sheet(&camera, &half), &truth)?;
                println!(
                    "{:>9} {width:>6} {view:>10} {:>16} {:>9.4} {:>9.4}",
                    format!("{}:1", COLUMNS / rows),
                    "truth, half",
                    errors.rmse,
                    errors.p999
                );
            }
            arguments.write(&format!("zebra-{rows}-{width}-{view}-truth.png"), &truth)?;
        }
    }
    // Colour plate: a row for 1024 x 512 and one for 1024 x 256, EWA and uniform scaling side by side.
    let side = arguments.size / 2;
    let of = |rows: usize, view: &str, filter: Filter| {
        let found = pictures.iter().find(|p| {
            p.0 == rows && p.1.total_cmp(&PAPER_WIDTH).is_eq() && p.2 == view && p.3 == filter
        });
        found.map_or_else(
            || Image::new(1, 1),
            |(.., image)| {
                if image.width <= side {
                    return doubled(image);
                }
                part(image, [(image.width - side) / 2; 2], [side; 2])
            },
        )
    };
    let plate = [512, 256].map(|rows| {
        ["filling", "minified"]
            .map(|view| [Filter::Ewa, Filter::UniformScaling].map(|filter| of(rows, view, filter)))
    });
    let rows: Vec<Vec<&Image>> = plate.iter().map(|r| r.iter().flatten().collect()).collect();
    arguments.write("zebra.png", &table_of(&rows))
}

/// Returns views of the square: from straight above, small, filling the image and magnified; and from low above its
/// left edge. The last one both magnifies and minifies it, and minifies it most across the kernels.
fn views(size: usize) -> [(&'static str, Camera); 4] {
    // The square is a little wider than the image.
    let height = 0.8 / (FOV_DEG / 2.0).to_radians().tan();
    let above = |height, size| from_above(DVec2::new(0.1, 0.05), height, FOV_DEG, [size; 2]);
    let low = Camera::perspective(
        DVec3::new(-1.35, 0.0, 0.30),
        DVec3::new(-0.25, 0.0, 0.0),
        DVec3::Z,
        FOV_DEG,
        [size; 2],
    );
    [
        ("minified", above(height, size / 4)),
        ("filling", above(height, size)),
        ("magnified", above(height / 8.0, size)),
        ("tilted", low),
    ]
}

/// Returns the contents of a sheet buffer where the image shows the square, a little within its edges.
fn sheet(camera: &Camera, faint: &Image) -> Image {
    as_sheet(faint, |i| {
        let pixel = DVec2::new((i % camera.width) as f64, (i / camera.width) as f64) + 0.5;
        let is_inside = hit(camera, pixel).is_some_and(|p| p.abs().max_element() < 0.95);
        f32::from(u8::from(is_inside))
    })
}

/// Returns one slice of voxels, `rows` of them from front to back, in the square from -1 to 1.
fn slice(rows: usize, kernel_width: f64) -> Result<PointVolume> {
    let [dx, dy] = [COLUMNS, rows].map(|n| 2.0 / n as f64);
    let first = DVec3::new(0.5 * dx - 1.0, 0.5 * dy - 1.0, 0.0);
    let at = |i: usize| {
        first.truncate() + DVec2::new((i % COLUMNS) as f64 * dx, (i / COLUMNS) as f64 * dy)
    };
    let values = (0..COLUMNS * rows).map(|i| (255.0 * zebra(at(i))).round() as u8);
    // Grey according to the value; the opacity of the slice's thickness.
    let opacity = -(-DEPTH).exp_m1() as f32;
    let transfer =
        TransferFunction::from_curves(|v| [v / 255.0; 3], |_| opacity, [0.0, 255.0], dx)?;
    Ok(PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform([COLUMNS, rows, 1], first, DVec3::new(dx, dy, dx)),
            kernel_width,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(Values::U8(values.collect())),
        transfer_function: Some(transfer),
        boundary: None,
        normals: None,
        local_models: None,
    })
}

/// Evaluates a zebra's flank: stripes that bend in all directions and fork; 0.03 to 0.95.
fn zebra(p: DVec2) -> f64 {
    let bend = 4.4 * (2.6 * p.y + 1.2 * p.x + 0.7).sin() + 2.0 * (5.1 * p.x - 3.7 * p.y).sin();
    let phase = TAU * (11.0 * p.x + bend);
    // Half as many stripes again in some places: forks.
    let fork = 0.5 + 0.5 * (4.0 * p.y - 3.0 * p.x).sin();
    let wave = phase.sin() + 0.8 * fork * (1.5 * phase + 1.0).sin();
    0.03 + 0.46 * (1.0 + (4.0 * wave).tanh())
}
