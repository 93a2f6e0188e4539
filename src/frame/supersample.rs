//! Chooses the tiles of a picture that contain opaque edges, and averages the colours of their samples.
//!
//! The low-pass filter acts on optical depths. Opacity is a concave function of depth, so a pixel that
//! something opaque half covers becomes far more than half opaque. Tiles where this error could exceed
//! the tolerance are drawn again at twice the size. The colours of four samples are then averaged to a
//! pixel: premultiplied, linear colours, as light adds up. The filter of a sample has the variance of the
//! settings in pixels of the larger picture.
//!
//! Depths and normals stay those of the first drawing, at the centres of pixels.

use glam::DVec2;
use rayon::prelude::*;

use super::plan::FramePlan;
use super::settings::{Composite, Settings, Show};
use crate::blocks::BlockedScene;
use crate::constants::{PARTICLE_LOW_PASS_VARIANCE_PX2, TILE_SIZE};
use crate::error::Result;
use crate::image::Image;
use crate::view::Camera;

/// Samples along each side of a pixel.
const SAMPLES: usize = 2;

/// Tiles along each side of a window. It bounds the memory of the samples to those of 2048 x 2048 pixels.
const WINDOW_TILES: usize = 64;

/// Share of the tolerance that the filter on depths may use of a pixel. The estimate is of second order:
/// with a share of 1 it missed errors of 2.6 tolerances in thin shells, with half of it none above one.
const SHARE: f32 = 0.5;

/// A part of a picture with tiles that are drawn again.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Window {
    /// First pixel of the part in the picture.
    first: [usize; 2],
    /// Width and height of the part, pixels.
    size: [usize; 2],
    /// Tiles of the part that are drawn again, row by row.
    tiles: Vec<bool>,
}

/// Returns whether pictures of a scene may have tiles that are drawn again.
///
/// Filters wider than those of volumes and particles are asked for, and blur by themselves. Splats that
/// state their opacity are drawn by the rule of their format. Maxima have no opacity.
pub(crate) fn may_supersample(scene: &BlockedScene, settings: &Settings) -> bool {
    settings.show == Show::Scene
        && settings.low_pass_variance_px2 <= PARTICLE_LOW_PASS_VARIANCE_PX2
        && !settings.advanced.linear_opacity
        && !matches!(settings.composite, Composite::Maximum { .. })
        && !scene.has_splats()
}

/// Returns 1 for each tile of a picture in which the filter on depths could err by more than its share of
/// the tolerance, and 0 for others. The result for a tile depends on its own pixels alone.
pub(crate) fn choose(image: &Image, settings: &Settings) -> Vec<u8> {
    let [columns, rows] = [image.width, image.height].map(|n| n.div_ceil(TILE_SIZE));
    let variance = settings.low_pass_variance_px2;
    let most = settings.tolerance * SHARE;
    let errs = |t: usize| {
        let [x, y] = [t % columns * TILE_SIZE, t / columns * TILE_SIZE];
        u8::from(error_of_tile(image, [x, y], variance, settings.tolerance) > most)
    };
    (0..columns * rows).into_par_iter().map(errs).collect()
}

/// Returns the windows of a picture that contain chosen tiles.
///
/// - `chosen`: as [`choose`] returns it.
pub(crate) fn windows(camera: &Camera, chosen: &[u8]) -> Vec<Window> {
    let [columns, rows] = [camera.width, camera.height].map(|n| n.div_ceil(TILE_SIZE));
    let mut windows = Vec::new();
    for y in (0..rows).step_by(WINDOW_TILES) {
        for x in (0..columns).step_by(WINDOW_TILES) {
            let ends = [(x, columns), (y, rows)].map(|(i, end)| end.min(i + WINDOW_TILES));
            let row = |row: usize| &chosen[row * columns + x..row * columns + ends[0]];
            let tiles = (y..ends[1]).flat_map(row);
            let tiles: Vec<bool> = tiles.map(|&is_chosen| is_chosen != 0).collect();
            if tiles.contains(&true) {
                let end = |i: usize, size: usize| size.min(ends[i] * TILE_SIZE);
                let first = [x * TILE_SIZE, y * TILE_SIZE];
                let size = [end(0, camera.width) - first[0], end(1, camera.height) - first[1]];
                windows.push(Window { first, size, tiles });
            }
        }
    }
    windows
}

/// Estimates the greatest error of a tile's pixels by the filter on depths.
///
/// The filter of variance v adds v T''/2 to a transmittance of optical depth, which is v |grad a|² / 2 /
/// (1 - a) in terms of the opacity a of the picture. The opacity of what is in front of something else is
/// unknown: for colours it counts as one half.
fn error_of_tile(image: &Image, [x0, y0]: [usize; 2], variance: f32, tolerance: f32) -> f32 {
    let [x1, y1] = [(x0, image.width), (y0, image.height)].map(|(i, end)| end.min(i + TILE_SIZE));
    let of_pair = |a: [f32; 4], b: [f32; 4]| {
        let squared = |c: usize| (a[c] - b[c]) * (a[c] - b[c]);
        let colours = squared(0).max(squared(1)).max(squared(2));
        let left = (1.0 - a[3].max(b[3])).max(tolerance);
        variance * colours.max(0.5 * squared(3) / left)
    };
    let mut greatest = 0.0_f32;
    for y in y0..y1 {
        for x in x0..x1 {
            let pixel = image.pixel(x, y);
            if x + 1 < x1 {
                greatest = greatest.max(of_pair(pixel, image.pixel(x + 1, y)));
            }
            if y + 1 < y1 {
                greatest = greatest.max(of_pair(pixel, image.pixel(x, y + 1)));
            }
        }
    }
    greatest
}

impl Window {
    /// Returns the number of tiles that are drawn again.
    pub(crate) fn count(&self) -> usize {
        self.tiles.iter().filter(|is| **is).count()
    }

    /// Plans the drawing of the samples.
    ///
    /// - `picture`: plan of the picture.
    ///
    /// # Errors
    /// The errors of [`FramePlan::new`].
    pub(crate) fn plan(
        &self,
        scene: &BlockedScene,
        picture: &FramePlan,
        settings: &Settings,
    ) -> Result<FramePlan> {
        let camera = &picture.camera;
        let first = DVec2::new(self.first[0] as f64, self.first[1] as f64);
        let finer = Camera {
            focal_px: camera.focal_px * SAMPLES as f64,
            centre_px: (camera.centre_px - first) * SAMPLES as f64,
            width: self.size[0] * SAMPLES,
            height: self.size[1] * SAMPLES,
            ..camera.clone()
        };
        // Layers are those of the picture: their thickness depends on the view.
        let layers = picture.of_volumes().and_then(|pass| pass.layers);
        let thickness = layers.map(|layers| layers.thickness);
        let settings = Settings {
            composite: settings.composite.with_thickness(thickness),
            depth: false,
            normals: false,
            ..settings.clone()
        };
        Ok(FramePlan {
            tiles: Some(self.tiles_of_samples()),
            ..FramePlan::new(scene, &finer, &settings)?
        })
    }

    /// Returns which tiles of samples are drawn.
    fn tiles_of_samples(&self) -> Vec<bool> {
        let columns = self.size[0].div_ceil(TILE_SIZE);
        let [width, height] = self.size.map(|n| (n * SAMPLES).div_ceil(TILE_SIZE));
        let is_drawn = |t: usize| {
            self.tiles[t / width / SAMPLES * columns + t % width / SAMPLES]
        };
        (0..width * height).map(is_drawn).collect()
    }

    /// Replaces the pixels of the tiles by the means of their samples.
    pub(crate) fn average(&self, samples: &Image, picture: &mut Image) {
        let columns = self.size[0].div_ceil(TILE_SIZE);
        let width = picture.width;
        let rows = picture.pixels.par_chunks_mut(width);
        let rows = rows.skip(self.first[1]).take(self.size[1]).enumerate();
        rows.for_each(|(y, row)| {
            let tiles = &self.tiles[y / TILE_SIZE * columns..];
            let row = &mut row[self.first[0]..self.first[0] + self.size[0]];
            for (x, pixel) in row.iter_mut().enumerate() {
                if tiles[x / TILE_SIZE] {
                    *pixel = mean(samples, x, y);
                }
            }
        });
    }
}

/// Returns the mean of the samples of a pixel.
fn mean(samples: &Image, x: usize, y: usize) -> [f32; 4] {
    let mut sum = [0.0; 4];
    for row in 0..SAMPLES {
        for column in 0..SAMPLES {
            let sample = samples.pixel(x * SAMPLES + column, y * SAMPLES + row);
            for (sum, channel) in sum.iter_mut().zip(sample) {
                *sum += channel;
            }
        }
    }
    sum.map(|sum| sum / (SAMPLES * SAMPLES) as f32)
}
