//! Stage: converts tiles to an image.

use glam::Vec3;
use rayon::prelude::*;

use super::tile::{NormalTile, Tile};
use crate::constants::TILE_SIZE;
use crate::image::{
    DepthImage, Image, NormalImage, linear_from_srgb, of_straight, over, srgb_from_linear,
};
use crate::view::Camera;

/// Writes the tiles' pixels, over a background if there is one, into an image of the right size.
///
/// - `background`: linear RGB.
/// - `is_encoded`: whether tiles store sRGB codes times opacity. The background is then encoded, and the
///   result is decoded. Without a background, the straight colour is decoded and multiplied by the
///   opacity again.
pub fn resolve(tiles: &[Tile], background: Option<[f32; 3]>, is_encoded: bool, image: &mut Image) {
    let width = image.width;
    if width == 0 {
        return;
    }
    let columns = width.div_ceil(TILE_SIZE);
    let background = match is_encoded {
        true => background.map(|colour| colour.map(srgb_from_linear)),
        false => background,
    };
    image
        .pixels
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            let band = y / TILE_SIZE * columns;
            for (t, pixels) in row.chunks_mut(TILE_SIZE).enumerate() {
                let tile = &tiles[band + t];
                let start = y % TILE_SIZE * TILE_SIZE;
                for (i, pixel) in (start..).zip(pixels) {
                    let alpha = tile.alpha[i];
                    *pixel = [tile.red[i], tile.green[i], tile.blue[i], alpha];
                    if let Some(background) = background {
                        *pixel = over(*pixel, background);
                    }
                    if is_encoded {
                        *pixel = of_straight(*pixel, linear_from_srgb);
                    }
                }
            }
        });
}

/// Writes the tiles' depths into an image of the right size.
pub fn resolve_depth(tiles: &[Tile], out: &mut DepthImage) {
    let width = out.width;
    let columns = width.div_ceil(TILE_SIZE);
    for (i, depth) in out.depths.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        let tile = &tiles[y / TILE_SIZE * columns + x / TILE_SIZE];
        let at = y % TILE_SIZE * TILE_SIZE + x % TILE_SIZE;
        // Tiles of a surface have a depth wherever it covers anything, the image only from one half on.
        *depth = if tile.alpha[at] >= 0.5 {
            tile.depth[at]
        } else {
            f32::INFINITY
        };
    }
}

/// Writes the tiles' normals, rotated into the world, into an image of the right size; zeros if there is
/// no tile.
pub fn resolve_normals(tiles: &[NormalTile], camera: &Camera, out: &mut NormalImage) {
    let width = out.width;
    let columns = width.div_ceil(TILE_SIZE);
    let world_from_camera = camera.camera_from_world.as_mat3().transpose();
    for (i, normal) in out.normals.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        let tile = tiles.get(y / TILE_SIZE * columns + x / TILE_SIZE);
        let at = y % TILE_SIZE * TILE_SIZE + x % TILE_SIZE;
        *normal = tile.map_or([0.0; 3], |t| (world_from_camera * Vec3::from(t[at])).into());
    }
}
