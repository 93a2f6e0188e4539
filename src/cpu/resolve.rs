//! Stage: from tiles to an image.

use glam::Vec3;
use rayon::prelude::*;

use super::tile::{NormalTile, Tile};
use crate::constants::TILE_SIZE;
use crate::image::{DepthImage, Image, NormalImage, over};
use crate::view::Camera;

/// Writes the tiles' pixels, over a background where there is one, into an image whose size is
/// set.
pub fn resolve(tiles: &[Tile], background: Option<[f32; 3]>, image: &mut Image) {
    let width = image.width;
    if width == 0 {
        return;
    }
    let columns = width.div_ceil(TILE_SIZE);
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
                }
            }
        });
}

/// Writes the tiles' depths, into an image whose size is set.
pub fn resolve_depth(tiles: &[Tile], out: &mut DepthImage) {
    let width = out.width;
    let columns = width.div_ceil(TILE_SIZE);
    for (i, depth) in out.depths.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        let tile = &tiles[y / TILE_SIZE * columns + x / TILE_SIZE];
        let at = y % TILE_SIZE * TILE_SIZE + x % TILE_SIZE;
        // A surface has a depth wherever it covers anything.
        *depth = if tile.alpha[at] >= 0.5 {
            tile.depth[at]
        } else {
            f32::INFINITY
        };
    }
}

/// Writes the tiles' normals, turned into the world, into an image whose size is set; zeros where there
/// is no tile.
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
