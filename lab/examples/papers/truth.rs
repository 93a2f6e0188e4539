//! Renders the reference image of splatting by supersampling.
#![allow(
    clippy::cast_possible_truncation,
    reason = "weights are narrowed on purpose"
)]

use ewa_splat::Filter;
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings};
use rayon::prelude::*;

/// Pixels around an image that its filter reaches: standard deviations of a low-pass filter of 1 px.
const MARGIN: usize = 5;

/// Renders the image of eq. 6 of Zwicker et al. 2001: the low-pass filter is applied to the image, not to each kernel.
/// The image is rendered `factor` times as large, with exact footprints under a filter of one fine pixel. It is then
/// filtered by the rest and sampled. As in splatting, kernels are sorted as wholes.
///
/// # Errors
/// The errors of the renderer.
pub(crate) fn supersampled(
    renderer: &mut Renderer,
    camera: &Camera,
    settings: &Settings,
    factor: usize,
) -> Result<Image> {
    let scale = factor as f64;
    let fine = Camera {
        focal_px: camera.focal_px * scale,
        centre_px: (camera.centre_px + MARGIN as f64) * scale,
        width: (camera.width + 2 * MARGIN) * factor,
        height: (camera.height + 2 * MARGIN) * factor,
        ..camera.clone()
    };
    let settings = Settings {
        filter: Filter::Exact,
        tolerance: 1e-4,
        level_of_detail: false,
        low_pass_variance_px2: 1.0,
        ..settings.clone()
    };
    let drawn = renderer.render(&fine, &settings)?;
    // Number of fine pixels across the filter around a pixel's centre.
    let reach = (2 * MARGIN + 1) * factor;
    let variance = scale * scale - 1.0;
    let weights: Vec<f64> = (0..reach)
        .map(|j| j as f64 + 0.5 - 0.5 * reach as f64)
        .map(|d| (-0.5 * d * d / variance).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    let weights: Vec<f32> = weights.iter().map(|w| (w / sum) as f32).collect();
    // Filters one place along a line of fine pixels, `stride` apart.
    let filtered = |pixels: &[[f32; 4]], first: usize, stride: usize| {
        let mut out = [0.0; 4];
        for (j, w) in weights.iter().enumerate() {
            for (out, channel) in out.iter_mut().zip(pixels[first + j * stride]) {
                *out += w * channel;
            }
        }
        out
    };
    let rows: Vec<[f32; 4]> = (0..camera.width * drawn.height)
        .into_par_iter()
        .map(|i| (i % camera.width, i / camera.width))
        .map(|(x, y)| filtered(&drawn.pixels, y * drawn.width + x * factor, 1))
        .collect();
    let mut image = Image::new(camera.width, camera.height);
    image
        .pixels
        .par_iter_mut()
        .enumerate()
        .map(|(i, out)| (i % camera.width, i / camera.width, out))
        .for_each(|(x, y, out)| {
            *out = filtered(&rows, y * factor * camera.width + x, camera.width)
        });
    Ok(image)
}
