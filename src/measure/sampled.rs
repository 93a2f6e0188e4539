//! Measures the error of a picture from a sample of its tiles, drawn again with everything exact, and finds the
//! tolerance that a scene allows.
//!
//! Error bounds hold for kernels in the worst places; the error of a whole picture is measured instead. A tile
//! is a picture of its own: the same camera with a window of sixteen pixels. A hundredth of a picture therefore
//! costs about a hundredth of its time.

use crate::constants::TILE_SIZE;
use crate::error::Result;
use crate::image::Image;
use crate::measure::variants::accurate;
use crate::render::{Renderer, Settings};
use crate::view::Camera;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use serde::Serialize;

/// Least number of tiles in a sample, if that many show anything.
const LEAST_TILES: usize = 32;
/// Stride of the sample: one tile among this many is drawn again.
const STRIDE: usize = 100;
/// Number in a thousand for which the stated error holds, as [`Settings::tolerance`] promises.
const PER_MILLE: usize = 999;
/// Share of the tolerance below which the greatest error of a sample must stay, so that 99.9 % of the whole
/// picture stay below the tolerance: tiles differ. With a share of 1, one picture in eight erred by 1.1
/// tolerances.
const MARGIN: f32 = 0.5;
/// Factor of the tolerance from step to step.
const GROWTH: f32 = std::f32::consts::SQRT_2;
/// Greatest number of steps of a calibration in either direction: up to 2^(12/2) = 64 times the tolerance, or
/// down to a 64th.
const STEPS: i32 = 12;

/// Difference of a picture from the same scene with everything exact, over a sample of its tiles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SampledError {
    /// 99.9th percentile of the sample's differences: in colours, premultiplied and linear, and opacities.
    pub percentile_999: f32,
    /// Greatest difference.
    pub greatest: f32,
    /// Number of tiles of 16 x 16 pixels that were drawn again: an equal number for each depth complexity.
    pub tiles: usize,
    /// Number of pixels in these tiles.
    pub pixels: usize,
}

/// A sample of a picture's tiles, drawn with everything exact: the reference for its errors.
///
/// Tiles are ordered by depth complexity, the number of blocks of particles behind them, and divided into
/// strata of equal size. One tile of each stratum is drawn. Empty tiles, which never err, are left out, so that
/// the figures describe the visible part. The sample depends on the picture alone.
#[derive(Debug, Clone)]
pub struct ErrorSample {
    camera: Camera,
    settings: Settings,
    /// First pixel of each tile, and its reference image.
    tiles: Vec<([usize; 2], Image)>,
}

impl ErrorSample {
    /// Draws the sample: a hundredth of the tiles that show anything, at least 32.
    ///
    /// - `settings`: settings of the picture. If they leave the thickness of layers open, set it to the
    ///   picture's ([`Renderer::layers`]), because it depends on the view.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; an aperture, whose error is that of the number of its pictures.
    pub fn draw(renderer: &mut Renderer, camera: &Camera, settings: &Settings) -> Result<Self> {
        settings.refuse_aperture("measured error")?;
        let settings = Settings {
            depth: false,
            normals: false,
            ..settings.clone()
        };
        let finest = (settings.tolerance / STRIDE as f32).min(1e-4);
        let exact = Settings {
            tolerance: finest,
            ..accurate(&settings)
        };
        let mut tiles = Vec::new();
        for tile in chosen(camera, &renderer.visible_boxes()) {
            let (camera, exact) = window(camera, &exact, tile);
            let image = renderer.render(&camera, &exact)?;
            tiles.push((tile, image.clone()));
        }
        Ok(Self {
            camera: camera.clone(),
            settings,
            tiles,
        })
    }

    /// Returns the error of a picture by the sample's camera; zero if no tile shows anything.
    ///
    /// # Panics
    /// Panics if the picture is smaller than the camera's.
    pub fn error_of(&self, image: &Image) -> SampledError {
        let mut differences = Differences::default();
        for ([x0, y0], truth) in &self.tiles {
            for y in 0..truth.height {
                for x in 0..truth.width {
                    differences.add(truth.pixel(x, y), image.pixel(x0 + x, y0 + y));
                }
            }
        }
        differences.summary(self.tiles.len())
    }

    /// Returns the error of the sample's tiles when they are drawn at a tolerance.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`].
    pub fn error_at(&self, renderer: &mut Renderer, tolerance: f32) -> Result<SampledError> {
        let settings = Settings {
            tolerance,
            ..self.settings.clone()
        };
        let mut differences = Differences::default();
        for (tile, truth) in &self.tiles {
            let (camera, settings) = window(&self.camera, &settings, *tile);
            let image = renderer.render(&camera, &settings)?;
            for (exact, drawn) in truth.pixels.iter().zip(&image.pixels) {
                differences.add(*exact, *drawn);
            }
        }
        Ok(differences.summary(self.tiles.len()))
    }

    /// Returns the tolerance at which the greatest error of the sample stays below half of the requested one,
    /// and the error at it. It is usually greater than requested, because bounds describe the worst case. It is
    /// less if even the requested tolerance gives a larger error.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`].
    pub fn calibrated(&self, renderer: &mut Renderer) -> Result<(f32, SampledError)> {
        let asked = self.settings.tolerance;
        let fits = |error: &SampledError| error.greatest <= MARGIN * asked;
        let mut fitting = (asked, self.error_at(renderer, asked)?);
        let is_wide = fits(&fitting.1);
        if !is_wide && fitting.1.percentile_999 <= asked {
            // Kept, with a smaller margin.
            return Ok(fitting);
        }
        // Bisect between a number of steps that fits and one that does not.
        let (mut inside, mut outside) = if is_wide { (0, STEPS) } else { (-STEPS, 0) };
        while outside - inside > 1 {
            let steps = (inside + outside) / 2;
            let tolerance = asked * GROWTH.powi(steps);
            let error = match tolerance < 1.0 {
                true => Some(self.error_at(renderer, tolerance)?),
                false => None,
            };
            match error.filter(fits) {
                Some(error) => {
                    fitting = (tolerance, error);
                    inside = steps;
                }
                None => outside = steps,
            }
        }
        if !is_wide && inside == -STEPS {
            let tolerance = asked * GROWTH.powi(inside);
            fitting = (tolerance, self.error_at(renderer, tolerance)?);
        }
        Ok(fitting)
    }
}

/// Returns the camera and the settings of one tile of a picture.
fn window(camera: &Camera, settings: &Settings, [x, y]: [usize; 2]) -> (Camera, Settings) {
    let camera = Camera {
        centre_px: camera.centre_px - DVec2::new(x as f64, y as f64),
        width: TILE_SIZE.min(camera.width - x),
        height: TILE_SIZE.min(camera.height - y),
        ..camera.clone()
    };
    let backdrop = settings.backdrop.as_ref();
    let part = backdrop.map(|all| Arc::new(all.part([x, y], [camera.width, camera.height])));
    let settings = Settings {
        backdrop: part,
        ..settings.clone()
    };
    (camera, settings)
}

/// Returns the first pixels of the tiles of a sample.
///
/// - `boxes`: centres and half extents of the visible blocks.
fn chosen(camera: &Camera, boxes: &[(DVec3, DVec3)]) -> Vec<[usize; 2]> {
    let columns = camera.width.div_ceil(TILE_SIZE);
    let rows = camera.height.div_ceil(TILE_SIZE);
    let mut depths = vec![0_u32; columns * rows];
    for &(middle, half) in boxes {
        let Some([[x0, y0], [x1, y1]]) = tiles_of(camera, middle, half, [columns, rows]) else {
            continue;
        };
        for y in y0..y1 {
            for depth in &mut depths[y * columns + x0..y * columns + x1] {
                *depth += 1;
            }
        }
    }
    let mut tiles: Vec<usize> = (0..depths.len()).filter(|&t| depths[t] > 0).collect();
    tiles.sort_by_key(|&t| depths[t]);
    let count = tiles
        .len()
        .div_ceil(STRIDE)
        .max(LEAST_TILES)
        .min(tiles.len());
    (0..count)
        .map(|n| {
            let stratum = n * tiles.len() / count..(n + 1) * tiles.len() / count;
            // Anywhere within the stratum, but reproducibly: steps of the golden ratio.
            let place = n * 618_034 % 1_000_000 * stratum.len() / 1_000_000;
            let tile = tiles[stratum.start + place];
            [tile % columns, tile / columns].map(|at| at * TILE_SIZE)
        })
        .collect()
}

/// Returns the first and one past the last columns and rows of tiles that a box may touch; `None` if it lies
/// outside. A box around the eye touches all.
#[allow(
    clippy::cast_possible_truncation,
    reason = "casts saturate: what lies beside the picture ends at its edge"
)]
fn tiles_of(
    camera: &Camera,
    middle: DVec3,
    half: DVec3,
    tiles: [usize; 2],
) -> Option<[[usize; 2]; 2]> {
    let mut low = DVec2::INFINITY;
    let mut high = DVec2::NEG_INFINITY;
    let mut ahead = 0;
    for corner in 0..8 {
        let sign = |bit: i32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let place = middle + half * DVec3::new(sign(0), sign(1), sign(2));
        if let Some(px) = camera.project(place) {
            (low, high) = (low.min(px), high.max(px));
            ahead += 1;
        }
    }
    match ahead {
        0 => return None,
        8 => {}
        _ => return Some([[0, 0], tiles]),
    }
    let size = TILE_SIZE as f64;
    let range = |low: f64, high: f64, count: usize| {
        let first = (low / size).floor().max(0.0) as usize;
        let end = ((high / size).floor() + 1.0).clamp(0.0, count as f64) as usize;
        (first < end).then_some([first, end])
    };
    let ([x0, x1], [y0, y1]) = (
        range(low.x, high.x, tiles[0])?,
        range(low.y, high.y, tiles[1])?,
    );
    Some([[x0, y0], [x1, y1]])
}

/// Absolute differences of all channels of pixels.
#[derive(Debug, Default)]
struct Differences(Vec<f32>);

impl Differences {
    fn add(&mut self, exact: [f32; 4], drawn: [f32; 4]) {
        let differences = exact.iter().zip(drawn).map(|(a, b)| (a - b).abs());
        self.0.extend(differences);
    }

    fn summary(mut self, tiles: usize) -> SampledError {
        // NaN sorts last: it counts as the greatest.
        self.0.sort_unstable_by(f32::total_cmp);
        let rank = (self.0.len() * PER_MILLE).div_ceil(1000);
        let at = |i: usize| self.0.get(i).copied().unwrap_or(0.0);
        SampledError {
            percentile_999: at(rank.saturating_sub(1)),
            greatest: at(self.0.len().saturating_sub(1)),
            tiles,
            pixels: self.0.len() / 4,
        }
    }
}
