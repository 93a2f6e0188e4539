//! A checkerboard that recedes to the horizon, as surfels: EWA against point sampling, against an
//! isotropic filter and against the truth (figures 8 and 9 of Zwicker et al. 2001 ask the same of
//! volumes).
//!
//!     cargo run --release --example textured_plane [FOLDER [WIDTH]]
#![allow(
    clippy::cast_possible_truncation,
    reason = "counts and colours are rounded on purpose"
)]

use std::path::PathBuf;

use ewa_splat::measure::compare;
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use ewa_splat::{Backend, Image, Renderer, Settings, io};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Height of the eye above the plane, squares of the board.
const EYE: f64 = 3.0;
/// Where the board begins and ends before the eye, and half its width, squares.
const NEAR: f64 = 3.0;
const FAR: f64 = 64.0;
const HALF_WIDTH: f64 = 36.0;
/// Surfels along the side of a square.
const PER_SQUARE: i32 = 12;
/// Samples along each side of a pixel's filter for the truth, out to four standard deviations.
const SAMPLES: i32 = 80;

fn main() -> ewa_splat::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let folder = arguments.next().map_or_else(PathBuf::new, PathBuf::from);
    let width: usize = arguments
        .next()
        .and_then(|n| n.to_str()?.parse().ok())
        .unwrap_or(640);
    let size = [width, width / 2];
    // Slightly downwards: the horizon lies near the upper edge.
    let camera = Camera::perspective(
        DVec3::new(0.3, 0.0, EYE),
        DVec3::new(0.8, 10.0, 0.4),
        DVec3::Z,
        40.0,
        size,
    );

    let mut renderer = Renderer::with_backend(vec![board()], Backend::Cpu)?;
    let ewa = renderer.render(&camera, &Settings::default())?.clone();
    let counts = renderer.counts();
    println!(
        "{} surfels, {} splat-pixels in {:.0} ms",
        counts.surfels,
        counts.splat_pixels,
        renderer.times().frame
    );
    let truth = draw(&camera, |pixel| {
        filtered(pixel, |_| DVec2::ONE, |p| square_at(&camera, p))
    });
    let point = draw(&camera, |pixel| square_at(&camera, pixel));
    // Round in the texture: as wide all around as the pixel is long there.
    let isotropic = draw(&camera, |pixel| isotropic(&camera, pixel));

    println!("{:>22} {:>8} {:>10} {:>8}", "", "PSNR", "RMSE", "FLIP");
    for (name, image) in [
        ("EWA surfels", &ewa),
        ("isotropic filter", &isotropic),
        ("point sampling", &point),
    ] {
        let errors = compare(image, &truth)?;
        println!(
            "{name:>22} {:>8.1} {:>10.2e} {:>8.4}",
            errors.psnr.unwrap_or(f64::INFINITY),
            errors.rmse,
            errors.flip.unwrap_or(f64::NAN)
        );
    }
    for (name, image) in [
        ("plane-ewa.png", &ewa),
        ("plane-isotropic.png", &isotropic),
        ("plane-point.png", &point),
        ("plane-truth.png", &truth),
    ] {
        io::write_image(&folder.join(name), image)?;
    }
    Ok(())
}

/// The colour of the board at a point of its plane; `None` beside it.
fn square(at: DVec2) -> Option<f64> {
    let is_board = at.x.abs() <= HALF_WIDTH && (NEAR..=FAR).contains(&at.y);
    is_board.then(|| {
        let even = (at.x.floor() + at.y.floor()).rem_euclid(2.0) < 1.0;
        if even { 0.9 } else { 0.05 }
    })
}

/// One surfel in the middle of each texel.
fn board() -> PointVolume {
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
    let sigma = (0.6 * step) as f32;
    PointVolume {
        particles: Particles::Surfels {
            positions: (0..count).map(|i| at(i).extend(0.0)).collect(),
            tangents: vec![[sigma, 0.0, 0.0, 0.0, sigma, 0.0]; count],
            is_one_sided: true,
        },
        strength: Strength::Surface(vec![(step * step) as f32; count]),
        colour: Colour::PerParticle(
            (0..count)
                .map(|i| [square(at(i)).unwrap_or(0.0) as f32; 3])
                .collect(),
        ),
        values: None,
        transfer_function: None,
        normals: None,
    }
}

/// Where the ray through a point of the image meets the plane, and how far along its axis.
fn hit(camera: &Camera, pixel: DVec2) -> Option<DVec2> {
    let slope = (pixel - camera.centre_px) / camera.focal_px;
    let ray = camera.camera_from_world.transpose() * slope.extend(1.0);
    (ray.z < 0.0).then(|| (camera.eye - ray * (camera.eye.z / ray.z)).truncate())
}

/// Premultiplied grey and alpha.
fn square_at(camera: &Camera, pixel: DVec2) -> DVec2 {
    let colour = hit(camera, pixel).and_then(square);
    colour.map_or(DVec2::ZERO, |c| DVec2::new(c, 1.0))
}

/// The mean of `at` under a Gaussian around `centre`, with standard deviations `sigma` there.
fn filtered(centre: DVec2, sigma: impl Fn(DVec2) -> DVec2, at: impl Fn(DVec2) -> DVec2) -> DVec2 {
    let sigma = sigma(centre);
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

/// A round filter in the texture: the low-pass filter's length along the longer axis of the pixel's
/// image there, as a mipmap blurs.
fn isotropic(camera: &Camera, pixel: DVec2) -> DVec2 {
    let Some(centre) = hit(camera, pixel) else {
        return DVec2::ZERO;
    };
    let beside = [DVec2::X, DVec2::Y].map(|axis| hit(camera, pixel + axis * 0.5));
    let reach = beside.map(|p| p.map_or(FAR, |p| 2.0 * (p - centre).length()));
    let colour = |p: DVec2| square(p).map_or(DVec2::ZERO, |c| DVec2::new(c, 1.0));
    filtered(centre, |_| DVec2::splat(reach[0].max(reach[1])), colour)
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
