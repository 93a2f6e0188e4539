//! Measures crawling: the change between frames as the view rotates, against the change in the field's reference
//! images. Thin sheets seen edge-on ripple according to the low-pass filter's variance.

use ewa_splat::render::Classification;
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};
use glam::{DQuat, DVec3};

use crate::{EYE, FOV_DEG, RAYS, STEPS, analytic, grids, widened};

const FRAMES: usize = 9;

/// Angle between frames: at the silhouette a point moves by about a third of a pixel of 256.
const STEP_DEG: f64 = 0.25;

/// Prints one row for each low-pass filter: the root mean square change, over pixels, channels and pairs of frames, in
/// the reference images, in those of splats, and in the difference of both; levels of 255.
pub(crate) fn rows(
    name: &str,
    renderer: &mut Renderer,
    transfer: &TransferFunction,
    size: usize,
) -> Result<()> {
    let cameras: Vec<Camera> = (0..FRAMES)
        .map(|n| {
            let turn = DQuat::from_rotation_z((n as f64 * STEP_DEG).to_radians());
            let eye = turn * DVec3::from(EYE);
            Camera::perspective(eye, DVec3::ZERO, DVec3::Z, FOV_DEG, [size; 2])
        })
        .collect();
    let truths: Vec<Vec<[f64; 4]>> = cameras
        .iter()
        .map(|camera| analytic::truth(camera, transfer, grids::field, RAYS, STEPS))
        .collect();
    for low_pass in [1.0, 0.3, 0.15, 0.1] {
        let settings = Settings {
            classify: Classification::Extent,
            low_pass_variance_px2: low_pass,
            ..Settings::default()
        };
        let mut frames = Vec::with_capacity(FRAMES);
        for camera in &cameras {
            let image = renderer.render(camera, &settings)?;
            frames.push(image.pixels.iter().map(widened).collect::<Vec<_>>());
        }
        let mut sums = [0.0; 3];
        for n in 1..FRAMES {
            let of = |pictures: &[Vec<[f64; 4]>], i: usize, c: usize| {
                255.0 * (pictures[n][i][c] - pictures[n - 1][i][c])
            };
            for i in 0..size * size {
                for c in 0..3 {
                    let (own, found) = (of(&truths, i, c), of(&frames, i, c));
                    for (sum, change) in sums.iter_mut().zip([own, found, found - own]) {
                        *sum += change * change;
                    }
                }
            }
        }
        let count = ((FRAMES - 1) * size * size * 3) as f64;
        let [own, found, between] = sums.map(|sum| (sum / count).sqrt());
        println!("| {name} | {low_pass} | {own:.2} | {found:.2} | {between:.2} |");
    }
    Ok(())
}
