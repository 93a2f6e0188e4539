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

/// Tiles along each side of a region. It bounds the memory of the samples to those of 2048 x 2048 pixels.
const REGION_TILES: usize = 64;

/// Share of the tolerance that the filter on depths may use of a pixel. The estimate is of second order:
/// with a share of 1 it missed errors of 1.4 tolerances in thin shells, with half of it none above one.
const SHARE: f32 = 0.5;

/// A part of a picture with tiles that are drawn again.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Region {
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
        && settings.advanced.opaque_edges
        && !settings.advanced.linear_opacity
        && !matches!(settings.composite, Composite::Maximum { .. })
        && !scene.has_splats()
}

/// Returns 1 for each tile of a picture in which the filter on depths could err by more than its share of
/// the tolerance, and 0 for others. The result for a tile depends on its own pixels and those beside it.
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

/// Returns the regions of a picture that contain chosen tiles.
///
/// - `chosen`: as [`choose`] returns it.
pub(crate) fn regions(camera: &Camera, chosen: &[u8]) -> Vec<Region> {
    let [columns, rows] = [camera.width, camera.height].map(|n| n.div_ceil(TILE_SIZE));
    let mut regions = Vec::new();
    for y in (0..rows).step_by(REGION_TILES) {
        for x in (0..columns).step_by(REGION_TILES) {
            let ends = [(x, columns), (y, rows)].map(|(i, end)| end.min(i + REGION_TILES));
            let row = |row: usize| &chosen[row * columns + x..row * columns + ends[0]];
            let tiles = (y..ends[1]).flat_map(row);
            let tiles: Vec<bool> = tiles.map(|&is_chosen| is_chosen != 0).collect();
            if tiles.contains(&true) {
                let end = |i: usize, size: usize| size.min(ends[i] * TILE_SIZE);
                let first = [x * TILE_SIZE, y * TILE_SIZE];
                let size = [
                    end(0, camera.width) - first[0],
                    end(1, camera.height) - first[1],
                ];
                regions.push(Region { first, size, tiles });
            }
        }
    }
    regions
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
        // From the pixel before the tile to the one behind it.
        for x in x0.max(1)..(x1 + 1).min(image.width) {
            greatest = greatest.max(of_pair(image.pixel(x - 1, y), image.pixel(x, y)));
        }
    }
    for y in y0.max(1)..(y1 + 1).min(image.height) {
        for x in x0..x1 {
            greatest = greatest.max(of_pair(image.pixel(x, y - 1), image.pixel(x, y)));
        }
    }
    greatest
}

impl Region {
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
            // Its eye and its rotation are the picture's.
            shadows: picture.shadows.clone(),
            background: picture.background,
            ends: picture
                .ends
                .as_ref()
                .map(|ends| ends.part(self.first, SAMPLES)),
            ..FramePlan::new(scene, &finer, &settings)?
        })
    }

    /// Returns which tiles of samples are drawn.
    fn tiles_of_samples(&self) -> Vec<bool> {
        let columns = self.size[0].div_ceil(TILE_SIZE);
        let [width, height] = self.size.map(|n| (n * SAMPLES).div_ceil(TILE_SIZE));
        let is_drawn = |t: usize| self.tiles[t / width / SAMPLES * columns + t % width / SAMPLES];
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::cpu::CpuFrames;
    use crate::frame::backend::{DrawFrames, FrameReport, Images};
    use crate::frame::settings::Advanced;
    use crate::image::over;
    use crate::math::narrowed;
    use crate::render::Renderer;
    use crate::scene::{Lattice, PointVolume, TransferFunction};
    use crate::stats::FrameCounts;

    /// Returns two balls on a lattice, whose opacity rises from 0 at a step.
    fn balls(opacity: f32) -> PointVolume {
        let nodes = 21;
        let spacing = 2.0 / (nodes - 1) as f64;
        let lattice = Lattice::uniform([nodes; 3], DVec3::NEG_ONE, DVec3::splat(spacing));
        let value = |i: usize| {
            let at = [i % nodes, i / nodes % nodes, i / (nodes * nodes)].map(|n| n as f64);
            let at = DVec3::from(at) * spacing - 1.0;
            let ball = |middle: DVec3| (-4.0 * at.distance_squared(middle)).exp();
            narrowed(ball(DVec3::new(-0.4, 0.1, -0.3)) + ball(DVec3::new(0.4, -0.2, 0.3)))
        };
        let values: Vec<f32> = (0..nodes.pow(3)).map(value).collect();
        let colour = |v: f32| [1.0 - 0.5 * v, 0.3, v];
        let shown = |v: f32| if v > 0.3 { opacity } else { 0.0 };
        let transfer = TransferFunction::from_curves(colour, shown, [0.0, 1.2], 0.1).unwrap();
        PointVolume::lattice(lattice, values, transfer)
    }

    fn camera(size: [usize; 2]) -> Camera {
        Camera::perspective(
            DVec3::new(2.3, -4.2, 1.9),
            DVec3::ZERO,
            DVec3::Z,
            35.0,
            size,
        )
    }

    fn narrow() -> Settings {
        Settings {
            low_pass_variance_px2: 0.15,
            advanced: Advanced {
                opaque_edges: true,
                ..Advanced::default()
            },
            ..Settings::default()
        }
    }

    /// Draws one sample a pixel.
    fn plain(scene: &BlockedScene, camera: &Camera, settings: &Settings) -> Image {
        let plan = FramePlan::new(scene, camera, settings).unwrap();
        let mut frames = CpuFrames::default();
        frames.upload(scene).unwrap();
        let mut images = Images::default();
        let _: FrameReport = frames.draw(scene, &plan, &mut images).unwrap();
        images.image
    }

    fn drawn(volume: &PointVolume, camera: &Camera, settings: &Settings) -> (Image, FrameCounts) {
        let mut renderer = Renderer::new(vec![volume.clone()]).unwrap();
        let image = renderer.render(camera, settings).unwrap().clone();
        (image, renderer.counts())
    }

    fn larger(camera: &Camera, factor: usize) -> Camera {
        Camera {
            focal_px: camera.focal_px * factor as f64,
            centre_px: camera.centre_px * factor as f64,
            width: camera.width * factor,
            height: camera.height * factor,
            ..camera.clone()
        }
    }

    fn scene(volume: &PointVolume) -> BlockedScene {
        BlockedScene::new(
            vec![volume.clone()],
            &crate::blocks::SceneOptions::default(),
        )
        .unwrap()
    }

    #[test]
    fn pixels_at_opaque_edges_are_means_of_samples_and_others_stay() {
        let volume = balls(0.99);
        let scene = scene(&volume);
        let slabs = Composite::SLABS.with_thickness(Some(0.1));
        for (size, composite, background) in [
            ([150, 101], Composite::Over, None),
            ([150, 101], Composite::Over, Some([0.1, 0.9, 0.2])),
            ([64, 80], slabs, None),
        ] {
            let settings = Settings {
                composite,
                background,
                ..narrow()
            };
            let camera = camera(size);
            let (image, counts) = drawn(&volume, &camera, &settings);
            // Tiles are chosen, and samples averaged, without a background.
            let bare = Settings {
                background: None,
                ..settings.clone()
            };
            let before = plain(&scene, &camera, &bare);
            let samples = plain(&scene, &larger(&camera, SAMPLES), &bare);
            let chosen = choose(&before, &settings);
            let count = chosen.iter().filter(|is| **is != 0).count();
            assert_eq!(counts.supersampled_tiles, count);
            assert!((5..chosen.len() * 3 / 4).contains(&count), "{count}");
            let columns = size[0].div_ceil(TILE_SIZE);
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let expected = match chosen[y / TILE_SIZE * columns + x / TILE_SIZE] {
                        0 => before.pixel(x, y),
                        _ => mean(&samples, x, y),
                    };
                    let expected = background.map_or(expected, |b| over(expected, b));
                    let bits = |pixel: [f32; 4]| pixel.map(f32::to_bits);
                    assert_eq!(
                        bits(image.pixel(x, y)),
                        bits(expected),
                        "{composite:?} {x} {y}"
                    );
                }
            }
        }
    }

    /// The reference has 64 samples a pixel. At 128 x 128 the opaque area and the root mean square error were
    /// four times nearer to it; half of that is asked for.
    #[test]
    fn opaque_silhouettes_are_nearer_to_those_of_many_samples() {
        let volume = balls(0.99);
        let scene = scene(&volume);
        let (camera, settings) = (camera([64, 64]), narrow());
        let many = plain(&scene, &larger(&camera, 8), &settings);
        let alpha = |x: usize, y: usize| many.pixel(x, y)[3];
        let of_pixel = |i: usize| {
            let [x, y] = [i % 64 * 8, i / 64 * 8];
            let sum: f32 = (0..64).map(|n| alpha(x + n % 8, y + n / 8)).sum();
            sum / 64.0
        };
        let error = |image: &Image| {
            let all = image.pixels.iter().enumerate();
            all.fold([0.0; 2], |[area, squares], (i, pixel)| {
                let error = f64::from(pixel[3] - of_pixel(i));
                [area + error, squares + error * error]
            })
        };
        let before = error(&plain(&scene, &camera, &settings));
        let after = error(&drawn(&volume, &camera, &settings).0);
        println!("{before:?} {after:?}");
        assert!(before[0] > 0.0 && after[0].abs() < 0.5 * before[0]);
        assert!(after[1] < 0.5 * 0.5 * before[1]);
    }

    #[test]
    fn pictures_without_opaque_edges_or_with_wide_filters_stay() {
        let camera = camera([150, 101]);
        let wide = Settings {
            low_pass_variance_px2: 1.0,
            ..narrow()
        };
        let one_sample = Settings {
            advanced: Advanced {
                opaque_edges: false,
                ..Advanced::default()
            },
            ..narrow()
        };
        for (opacity, settings) in [(0.01, narrow()), (0.99, wide), (0.99, one_sample)] {
            let volume = balls(opacity);
            let (image, counts) = drawn(&volume, &camera, &settings);
            assert!(image.pixels.iter().any(|p| p[3] > 0.02));
            assert_eq!(counts.supersampled_tiles, 0);
            assert!(image == plain(&scene(&volume), &camera, &settings));
        }
    }

    #[test]
    fn regions_share_the_chosen_tiles_of_large_pictures() {
        let camera = camera([2_500, 1_100]);
        let [columns, rows] = [157, 69];
        let chosen: Vec<u8> = (0..columns * rows).map(|t| u8::from(t % 7 == 3)).collect();
        let regions = regions(&camera, &chosen);
        assert_eq!(regions.len(), 6);
        let mut found = vec![0; columns * rows];
        for region in &regions {
            let [width, height] = region.size;
            assert!(region.first[0] + width <= 2_500 && region.first[1] + height <= 1_100);
            let across = width.div_ceil(TILE_SIZE);
            for (t, _) in region.tiles.iter().enumerate().filter(|(_, is)| **is) {
                let [x, y] = [t % across, t / across];
                found[(region.first[1] / TILE_SIZE + y) * columns
                    + region.first[0] / TILE_SIZE
                    + x] += 1;
            }
            let samples = region.tiles_of_samples();
            assert!(samples.iter().filter(|is| **is).count() <= 4 * region.count());
        }
        assert_eq!(found, chosen);
    }

    #[test]
    fn estimates_are_of_neighbours_in_the_tile_and_beside_it() {
        let mut image = Image::new(40, 20);
        let estimate = |image: &Image, at| error_of_tile(image, at, 0.2, 1e-3);
        assert_eq!(estimate(&image, [16, 0]), 0.0);
        // .2 / 2 (.8 - 0)² / (1 - .8) = .32.
        image.pixels[31] = [0.0, 0.0, 0.0, 0.8];
        assert!((estimate(&image, [16, 0]) - 0.32).abs() < 1e-6);
        assert!((estimate(&image, [32, 0]) - 0.32).abs() < 1e-6);
        assert_eq!(estimate(&image, [0, 0]), 0.0);
        // Colours: .2 x .5².
        image.pixels[31] = [0.0, 0.5, 0.0, 0.0];
        assert!((estimate(&image, [16, 0]) - 0.05).abs() < 1e-6);
        image.pixels[31] = [f32::NAN; 4];
        assert_eq!(estimate(&image, [16, 0]), 0.0);
    }
}
