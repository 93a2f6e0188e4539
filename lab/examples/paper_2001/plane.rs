//! Reproduces figure 9 for a textured plane. Claim: spheres, whose projections are nearly circles, blur a texture seen
//! at a slant as an isotropic filter does. Kernels that are flattened onto the plane are EWA texture filtering.
//!
//! The scene is a checkerboard to the horizon (864 x 732 texels; the paper's has 512 x 512). The reference image takes
//! 80 x 80 samples under each pixel's filter.
#![allow(
    clippy::cast_possible_truncation,
    reason = "counts and colours are rounded on purpose"
)]

use ewa_splat::Filter;
use ewa_splat::math::flatten;
use ewa_splat::measure::compare;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use crate::papers::Arguments;
use crate::papers::pictures::{as_sheet, contrast, hit};

/// Height of the eye above the plane, squares of the board.
const EYE: f64 = 3.0;
/// Beginning and end of the board in front of the eye, and half its width, squares.
const NEAR: f64 = 3.0;
const FAR: f64 = 64.0;
const HALF_WIDTH: f64 = 36.0;
/// Kernels along the side of a square.
const PER_SQUARE: i32 = 12;
/// Standard deviation over spacing.
const KERNEL_WIDTH: f64 = 0.6;
/// Samples along each side of a pixel's filter in the reference image, out to four standard deviations.
const SAMPLES: i32 = 80;
/// Optical depth of the board, whatever the flatness of its kernels: so small that nothing in it hides anything, to the
/// horizon.
const DEPTH: f64 = 1e-4;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let width = arguments.size * 5 / 4;
    let size = [width, width / 2];
    // The camera looks slightly downwards: the horizon is near the upper edge.
    let camera = Camera::perspective(
        DVec3::new(0.3, 0.0, EYE),
        DVec3::new(0.8, 10.0, 0.4),
        DVec3::Z,
        40.0,
        size,
    );

    let mut renderer = Renderer::new(vec![board(Surfels)])?;
    let ewa = renderer.render(&camera, &Settings::default())?.clone();
    let counts = renderer.counts();
    println!(
        "{} x {}, {} surfels, {} splat-pixels in {:.0} ms",
        size[0],
        size[1],
        counts.surfels,
        counts.splat_pixels,
        renderer.times().frame
    );
    let truth = draw(&camera, |pixel| {
        filtered(pixel, 1.0, |p| square_at(&camera, p))
    });
    let point = draw(&camera, |pixel| square_at(&camera, pixel));
    // A round filter in the texture, as wide as the pixel is long there.
    let isotropic = draw(&camera, |pixel| isotropic(&camera, pixel));

    let mut pictures = vec![
        ("surfels".to_owned(), ewa),
        ("isotropic filter".to_owned(), isotropic),
        ("point sampling".to_owned(), point),
    ];
    // From spheres to kernels that are nearly surfels.
    for (at, flatness) in [1.0, 2.0, 4.0, 100.0].into_iter().enumerate() {
        let mut renderer = Renderer::new(vec![board(Flattened(flatness))])?;
        let settings = Settings {
            filter: Filter::Ewa,
            ..Settings::default()
        };
        let faint = renderer.render(&camera, &settings)?;
        let image = as_sheet(faint, |i| truth.pixels[i][3]);
        pictures.insert(at, (format!("kernels 1:1:1/{flatness}"), image));
    }
    println!(
        "{:>22} {:>8} {:>10} {:>8} {:>9}",
        "", "PSNR", "RMSE", "FLIP", "contrast"
    );
    for (name, image) in &pictures {
        let errors = compare(image, &truth)?;
        println!(
            "{name:>22} {:>8.1} {:>10.2e} {:>8.4} {:>9.3}",
            errors.psnr.unwrap_or(f64::INFINITY),
            errors.rmse,
            errors.flip.unwrap_or(f64::NAN),
            contrast(image, &truth)
        );
        let file = name.replace(' ', "-").replace([':', '/'], "_");
        arguments.write(&format!("plane-{file}.png"), image)?;
    }
    arguments.write("plane-truth.png", &truth)
}

/// Returns the colour of the board at a point of its plane; `None` beside the board.
fn square(at: DVec2) -> Option<f64> {
    let is_board = at.x.abs() <= HALF_WIDTH && (NEAR..=FAR).contains(&at.y);
    is_board.then(|| {
        let even = (at.x.floor() + at.y.floor()).rem_euclid(2.0) < 1.0;
        if even { 0.9 } else { 0.05 }
    })
}

/// Kernels that the board is made of.
#[derive(Clone, Copy)]
enum Kernels {
    /// Opaque surfels.
    Surfels,
    /// Faint spheres, flattened along the plane's normal by this factor.
    Flattened(f64),
}
use Kernels::{Flattened, Surfels};

/// One kernel in the middle of each texel.
fn board(kernels: Kernels) -> PointVolume {
    let step = 1.0 / f64::from(PER_SQUARE);
    let steps = |length: f64| (length * f64::from(PER_SQUARE)).round() as usize;
    let (columns, rows) = (steps(2.0 * HALF_WIDTH), steps(FAR - NEAR));
    let at = |i: usize| {
        DVec2::new(
            (i % columns) as f64 * step - HALF_WIDTH,
            (i / columns) as f64 * step + NEAR,
        ) + step / 2.0
    };
    let count = columns * rows;
    let positions = (0..count).map(|i| at(i).extend(0.0)).collect();
    let sigma = KERNEL_WIDTH * step;
    let area = step * step;
    let (particles, strength) = match kernels {
        Surfels => (
            Particles::Surfels {
                positions,
                tangents: vec![[sigma as f32, 0.0, 0.0, 0.0, sigma as f32, 0.0]; count],
                is_one_sided: true,
            },
            Strength::Surface(vec![area as f32; count]),
        ),
        Flattened(flatness) => {
            let factor = flatten(
                DMat3::from_diagonal(DVec3::splat(sigma)),
                DVec3::Z,
                flatness,
            );
            let [x, y, z] = [factor.x_axis.x, factor.y_axis.y, factor.z_axis.z].map(|v| v as f32);
            (
                Particles::Anisotropic {
                    positions,
                    factors: vec![[x, 0.0, y, 0.0, 0.0, z]; count],
                },
                Strength::Mass(vec![(DEPTH * area) as f32; count]),
            )
        }
    };
    PointVolume {
        particles,
        strength,
        colour: Colour::PerParticle(
            (0..count)
                .map(|i| [square(at(i)).unwrap_or(0.0) as f32; 3])
                .collect(),
        ),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns premultiplied grey and alpha.
fn square_at(camera: &Camera, pixel: DVec2) -> DVec2 {
    let colour = hit(camera, pixel).and_then(square);
    colour.map_or(DVec2::ZERO, |c| DVec2::new(c, 1.0))
}

/// Returns the mean of `at` under a Gaussian of standard deviation `sigma` around `centre`.
fn filtered(centre: DVec2, sigma: f64, at: impl Fn(DVec2) -> DVec2) -> DVec2 {
    let (mut sum, mut weights) = (DVec2::ZERO, 0.0);
    for j in 0..SAMPLES {
        for i in 0..SAMPLES {
            let d = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) * (8.0 / f64::from(SAMPLES))
                - 4.0;
            let weight = (-0.5 * d.length_squared()).exp();
            sum += weight * at(centre + d * sigma);
            weights += weight;
        }
    }
    sum / weights
}

/// Evaluates a round filter in the texture, as a mipmap blurs. It is as wide as the low-pass filter along the longer
/// axis of the pixel's image there.
fn isotropic(camera: &Camera, pixel: DVec2) -> DVec2 {
    let Some(centre) = hit(camera, pixel) else {
        return DVec2::ZERO;
    };
    let beside = [DVec2::X, DVec2::Y].map(|axis| hit(camera, pixel + axis * 0.5));
    let reach = beside.map(|p| p.map_or(FAR, |p| 2.0 * (p - centre).length()));
    let colour = |p: DVec2| square(p).map_or(DVec2::ZERO, |c| DVec2::new(c, 1.0));
    filtered(centre, reach[0].max(reach[1]), colour)
}

fn draw(camera: &Camera, pixel: impl Fn(DVec2) -> DVec2 + Sync) -> Image {
    let mut image = Image::new(camera.width, camera.height);
    image
        .pixels
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, out)| {
            let at = DVec2::new((i % camera.width) as f64, (i / camera.width) as f64) + 0.5;
            let [grey, alpha] = pixel(at).to_array();
            *out = [grey as f32, grey as f32, grey as f32, alpha as f32];
        });
    image
}
