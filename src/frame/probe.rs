//! Chooses the places of a picture at which coarser lattices err most by estimates of their blocks' errors, so that the
//! errors can be measured there.

use std::ops::Range;

use super::plan::FramePlan;
use crate::blocks::{BlockError, BlockedVolume, tiles_of};
use crate::constants::TILE_SIZE;
use crate::image::Image;

/// Tiles along each side of a place. Around a place, kernels are drawn that reach into it: of a single tile they are
/// several times as many as those whose centres it shows.
const PLACE: usize = 2;

/// Estimated errors at all places of a picture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ErrorMap {
    /// Places in a row, and rows.
    size: [usize; 2],
    errors: Vec<f32>,
    /// Transmittance in front of the block that is added next.
    transmittances: Vec<f32>,
}

impl ErrorMap {
    /// Estimates the errors in a picture of coarser lattices: those of the blocks along a ray add up, behind what is in
    /// front of them.
    ///
    /// - `volumes`: volumes with the errors of their blocks.
    /// - `edges`: whether to estimate the errors at edges of domains in place of the others.
    pub(crate) fn new<'a>(
        volumes: impl Iterator<Item = (&'a BlockedVolume, &'a [BlockError])>,
        edges: bool,
        plan: &FramePlan,
    ) -> Self {
        let camera = &plan.camera;
        let tiles = [camera.width, camera.height].map(|n| n.div_ceil(TILE_SIZE));
        let size = tiles.map(|n| n.div_ceil(PLACE));
        let mut map = Self {
            size,
            errors: vec![0.0; size[0] * size[1]],
            transmittances: vec![1.0; size[0] * size[1]],
        };
        let blocks = volumes.flat_map(|(volume, errors)| volume.blocks.iter().zip(errors));
        let mut blocks: Vec<_> = blocks
            .map(|(block, own)| (camera.camera_point(block.origin).z, block, own))
            .collect();
        blocks.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, block, own) in blocks {
            let Some(pixels) = plan.frustum.reached(camera, block, false) else {
                continue;
            };
            let length = 2.0 * block.half_extent.max_element() + block.max_sigma;
            let error = if edges { own.at_edge } else { own.error };
            map.add(tiles_of(pixels, tiles), error, own.extinction, length);
        }
        map
    }

    fn add(&mut self, tiles: [Range<usize>; 2], error: f32, extinction: f32, length: f32) {
        let [x, y] = tiles.map(|of| of.start / PLACE..of.end.div_ceil(PLACE));
        for y in y {
            for x in x.clone() {
                let place = x + self.size[0] * y;
                let transmittance = &mut self.transmittances[place];
                self.errors[place] += *transmittance * (error * length).min(1.0);
                *transmittance *= (-extinction * length).exp();
            }
        }
    }

    /// Returns the place of the greatest error that is neither one of some places nor beside one; `None` if the others
    /// have no error.
    fn worst(&self, except: &[usize]) -> Option<usize> {
        let at = |place: usize| [place % self.size[0], place / self.size[0]];
        let is_apart = |place: usize| {
            except.iter().all(|other| {
                let ([x, y], [u, v]) = (at(place), at(*other));
                x.abs_diff(u).max(y.abs_diff(v)) > 1
            })
        };
        let places = (0..self.errors.len()).filter(|&place| self.errors[place] > 0.0);
        places
            .filter(|place| is_apart(*place))
            .max_by(|a, b| self.errors[*a].total_cmp(&self.errors[*b]))
    }
}

/// Chooses the worst place of each map in turn, until there are enough or no others.
///
/// - `maps`: maps of the same picture.
pub(crate) fn worst_places(maps: &[ErrorMap], count: usize) -> Vec<usize> {
    let mut places = Vec::with_capacity(count);
    for map in maps.iter().cycle().take(count) {
        places.extend(map.worst(&places));
    }
    places
}

/// Places of a picture that are compared.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Probes {
    /// Places in a row of the picture.
    columns: usize,
    places: Vec<usize>,
    /// True for their tiles, over all tiles of the picture.
    pub(crate) mask: Vec<bool>,
}

impl Probes {
    /// Compares some places of a picture.
    pub(crate) fn new(places: &[usize], plan: &FramePlan) -> Self {
        let tiles = [plan.camera.width, plan.camera.height].map(|n| n.div_ceil(TILE_SIZE));
        let columns = tiles[0].div_ceil(PLACE);
        let is_chosen = |tile: usize| {
            let [x, y] = [tile % tiles[0], tile / tiles[0]].map(|n| n / PLACE);
            places.contains(&(x + columns * y))
        };
        let mask = (0..tiles[0] * tiles[1]).map(is_chosen).collect();
        Self {
            columns,
            places: places.to_vec(),
            mask,
        }
    }

    /// Returns the greatest error of a place: what a share of its pixels exceed in any channel. NaN differs by infinity.
    pub(crate) fn error(&self, a: &Image, b: &Image, share: f32) -> f32 {
        const PIXELS: usize = PLACE * TILE_SIZE;
        let of_place = |place: &usize| {
            let [x0, y0] = [place % self.columns, place / self.columns].map(|n| n * PIXELS);
            let [x1, y1] = [(x0, a.width), (y0, a.height)].map(|(n, end)| end.min(n + PIXELS));
            let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
            let differ = |(a, b): (f32, f32)| match (a - b).abs() {
                error if error.is_nan() => f32::INFINITY,
                error => error,
            };
            let error = |(x, y)| {
                let pairs = a.pixel(x, y).into_iter().zip(b.pixel(x, y));
                pairs.map(differ).fold(0.0, f32::max)
            };
            let mut errors: Vec<f32> = pixels.map(error).collect();
            errors.sort_unstable_by(|a, b| b.total_cmp(a));
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a share of some pixels"
            )]
            let rank = (share * errors.len() as f32) as usize;
            errors.get(rank).copied().unwrap_or(0.0)
        };
        self.places.iter().map(of_place).fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(errors: Vec<f32>) -> ErrorMap {
        ErrorMap {
            size: [4, 3],
            transmittances: vec![1.0; errors.len()],
            errors,
        }
    }

    #[test]
    fn worst_places_are_apart() {
        let mut errors = vec![0.0; 12];
        (errors[0], errors[1], errors[3], errors[11]) = (0.5, 0.9, 0.4, 0.7);
        let map = map(errors);
        assert_eq!(map.worst(&[]), Some(1));
        // Places 0 and 6 are beside place 1.
        assert_eq!(map.worst(&[1]), Some(11));
        assert_eq!(map.worst(&[1, 11]), Some(3));
        assert_eq!(map.worst(&[1, 11, 3]), None);
    }

    #[test]
    fn what_is_in_front_hides_errors() {
        let mut map = map(vec![0.0; 12]);
        map.add([0..2, 0..2], 0.1, 2.0, 1.0);
        map.add([0..4, 0..2], 0.2, 0.0, 1.0);
        assert!((map.errors[0] - (0.1 + 0.2 * (-2.0_f32).exp())).abs() < 1e-6);
        assert_eq!(map.errors[1], 0.2);
        assert_eq!(map.errors[2], 0.0);
    }

    #[test]
    fn the_worst_place_counts() {
        let (a, mut b) = (Image::new(72, 40), Image::new(72, 40));
        let probes = Probes {
            columns: 3,
            places: vec![0, 2],
            mask: Vec::new(),
        };
        // Place 0 has 32 x 32 pixels, place 2 has 8 x 32, and pixel 40 is in neither.
        b.pixels[71] = [0.0, 0.2, 0.0, 0.0];
        b.pixels[40] = [0.0, 0.9, 0.0, 0.0];
        b.pixels[3] = [0.0, 0.0, -0.1, 0.1];
        assert_eq!(probes.error(&a, &b, 0.0), 0.2);
        // One of 256 pixels is less than half a hundredth, one of 1,024 is too.
        assert_eq!(probes.error(&a, &b, 0.005), 0.0);
        b.pixels[0] = [0.0, f32::NAN, 0.0, 0.0];
        assert_eq!(probes.error(&a, &b, 0.0), f32::INFINITY);
    }
}
