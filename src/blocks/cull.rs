//! Finds the blocks that a frame sees.

use std::ops::Range;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::choose::merge_fits;
use crate::blocks::block::Block;
use crate::blocks::volume::BlockedVolume;
use crate::constants::{DEPTH_KEY_BITS, MAX_CUTOFF, TILE_SIZE};
use crate::record::{BlockView, ChoiceUniform, ClassifiedBy};
use crate::scene::{LOBE_REACH, MAX_PIECE_WIDTH, StrengthIn};
use crate::view::{Camera, Projection};

/// Greatest distance of a piece of a kernel from its particle's centre, standard deviations: pieces are shifted, and a
/// little wider.
pub(crate) const PIECE_REACH: f32 = LOBE_REACH + MAX_PIECE_WIDTH * MAX_CUTOFF;

/// Planes that bound the visible space: the sides, widened by the reach of the low-pass filter; the plane of the eye;
/// and clipping planes.
#[derive(Debug, Clone, PartialEq)]
pub struct Frustum {
    /// Inward unit normals in camera space and distances: inside where n . u + d >= 0.
    planes: Vec<(DVec3, f64)>,
    /// Reach of the low-pass filter beyond the image.
    margin_px: f64,
    /// Distance by which the sides are moved out, world units.
    margin: f64,
}

/// Indices of the planes through the image's sides.
const SIDES: Range<usize> = 0..4;

impl Frustum {
    /// The frustum of a camera whose low-pass filter reaches `margin_px` pixels beyond the image.
    pub fn new(camera: &Camera, margin_px: f64) -> Self {
        let lower = (-camera.centre_px - margin_px) / camera.focal_px;
        let size = DVec2::new(camera.width as f64, camera.height as f64);
        let upper = (size - camera.centre_px + margin_px) / camera.focal_px;
        let side = |axis: DVec3, sign: f64, bound: f64| match camera.projection {
            Projection::Perspective => ((axis - DVec3::Z * bound).normalize() * sign, 0.0),
            Projection::Orthographic => (axis * sign, -bound * sign),
        };
        Self {
            planes: vec![
                side(DVec3::X, 1.0, lower.x),
                side(DVec3::X, -1.0, upper.x),
                side(DVec3::Y, 1.0, lower.y),
                side(DVec3::Y, -1.0, upper.y),
                (DVec3::Z, 0.0),
            ],
            margin_px,
            margin: 0.0,
        }
    }

    /// Moves the sides out by a distance, world units.
    pub(crate) fn widened(mut self, margin: f64) -> Self {
        self.margin += margin;
        for (_, distance) in &mut self.planes[SIDES] {
            *distance += margin;
        }
        self
    }

    /// Returns the frustum of a part of the image's pixels.
    pub(crate) fn of_part(&self, camera: &Camera, [columns, rows]: &[Range<usize>; 2]) -> Self {
        let part = Camera {
            width: columns.len(),
            height: rows.len(),
            centre_px: camera.centre_px - DVec2::new(columns.start as f64, rows.start as f64),
            ..camera.clone()
        };
        let mut cut = self.clone();
        let sides = Self::new(&part, self.margin_px).widened(self.margin).planes;
        cut.planes[SIDES].copy_from_slice(&sides[SIDES]);
        cut
    }

    /// Adds clipping planes, in camera space.
    pub fn clipped(mut self, planes: impl Iterator<Item = (DVec3, f64)>) -> Self {
        self.planes.extend(planes);
        self
    }

    /// Inward unit normals in camera space and distances: inside where n . u + d >= 0.
    pub fn planes(&self) -> &[(DVec3, f64)] {
        &self.planes
    }

    /// Whether a kernel of the block may reach inside. Conservative.
    ///
    /// - `is_spread`: whether its kernels are classified over their extents, and may be shifted.
    pub fn sees(&self, camera: &Camera, block: &Block, is_spread: bool) -> bool {
        let centre = camera.camera_point(block.origin);
        let half_extent = block.half_extent.as_dvec3();
        let deviations = if is_spread { PIECE_REACH } else { MAX_CUTOFF };
        let reach = f64::from(block.max_sigma) * f64::from(deviations);
        self.planes.iter().all(|(n, d)| {
            let world_normal = camera.camera_from_world.transpose() * *n;
            n.dot(centre) + d + world_normal.abs().dot(half_extent) + reach >= 0.0
        })
    }

    /// Returns the pixels that a kernel of the block may reach: half-open ranges of columns and rows, not limited to the
    /// image. `None` if a kernel may reach the plane of the eye, and with it any pixel. Conservative.
    ///
    /// - `is_spread`: as for [`Self::sees`].
    pub(crate) fn reached(
        &self,
        camera: &Camera,
        block: &Block,
        is_spread: bool,
    ) -> Option<[[f64; 2]; 2]> {
        let deviations = if is_spread { PIECE_REACH } else { MAX_CUTOFF };
        let reach = f64::from(block.max_sigma) * f64::from(deviations);
        let half = block.half_extent.as_dvec3() + (reach + self.margin);
        let mut low = DVec2::INFINITY;
        let mut high = DVec2::NEG_INFINITY;
        for corner in 0..8 {
            let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
            let at = block.origin + half * DVec3::new(sign(0), sign(1), sign(2));
            let px = camera.project(at)?;
            (low, high) = (low.min(px), high.max(px));
        }
        let (low, high) = (low - self.margin_px, high + self.margin_px);
        Some([[low.x, high.x], [low.y, high.y]])
    }
}

/// Returns the columns and rows of tiles that pixels lie in.
///
/// - `pixels`: as [`Frustum::reached`] returns them. NaN could lie anywhere.
/// - `size`: tiles in a row, and rows.
pub(crate) fn tiles_of(pixels: [[f64; 2]; 2], size: [usize; 2]) -> [Range<usize>; 2] {
    if pixels.as_flattened().iter().any(|px| px.is_nan()) {
        return size.map(|count| 0..count);
    }
    [0, 1].map(|axis: usize| {
        let tile = |px: f64| (px / TILE_SIZE as f64).clamp(0.0, size[axis] as f64);
        let [first, end] = pixels[axis];
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the tiles"
        )]
        let range = tile(first).floor() as usize..tile(end).ceil() as usize;
        range
    })
}

/// Finds the blocks that may reach the image and hold something visible, in their own order. Without a frustum (for a
/// filter that enlarges kernels without a bound), only transparent blocks are left out. Later stages set keys and
/// counts.
pub fn cull(
    volume: &BlockedVolume,
    camera: &Camera,
    frustum: Option<&Frustum>,
    choice: &ChoiceUniform,
    views: &mut Vec<BlockView>,
) {
    let shown = |block: &Block| shown_by(volume, choice, block);
    cull_where(volume, camera, frustum, shown, views);
}

/// Chooses the blocks of a volume and its levels of detail that represent its particles in a frame: the coarsest that
/// fit. Otherwise as [`cull`], without merged particles.
///
/// - `family`: the volume and its levels, the finest first; `views`: the result for each.
/// - `closed`: for each merged block, whether it or one of its ancestors decides about its members; overwritten.
pub fn cull_detail(
    family: &[BlockedVolume],
    camera: &Camera,
    frustum: Option<&Frustum>,
    choice: &ChoiceUniform,
    closed: &mut Vec<bool>,
    views: &mut [Vec<BlockView>],
) {
    let ([base, levels @ ..], [base_views, level_views @ ..]) = (family, views) else {
        return;
    };
    closed.clear();
    closed.resize(levels.iter().map(|level| level.blocks.len()).sum(), false);
    let rotation = camera.camera_from_world.as_mat3();
    let mut end = closed.len();
    for (level, views) in levels.iter().zip(level_views).rev() {
        views.clear();
        let first = end - level.blocks.len();
        end = first;
        let bounds = level.merged.iter().flat_map(|merged| &merged.bounds);
        // Parents come before their children.
        for ((i, block), bounds) in level.blocks.iter().enumerate().zip(bounds) {
            let is_covered = closed.get(block.parent as usize) == Some(&true);
            let seen = shown_by(level, choice, block).filter(|by| {
                let is_spread = *by == ClassifiedBy::Extent;
                !is_covered && frustum.is_none_or(|f| f.sees(camera, block, is_spread))
            });
            let Some(by) = seen else {
                closed[first + i] = true;
                continue;
            };
            let is_spread = by == ClassifiedBy::Extent;
            let view = view_of(camera, i, block, ClassifiedBy::Value);
            let centre = view.origin_camera.into();
            // Merged particles are classified by their means.
            if !is_spread && merge_fits(level, choice, &rotation, block, bounds, centre) {
                closed[first + i] = true;
                views.push(view);
            }
        }
    }
    let is_open = |block: &Block| closed.get(block.parent as usize) != Some(&true);
    let shown = |block: &Block| {
        let is_open = is_open(block);
        is_open.then(|| shown_by(base, choice, block)).flatten()
    };
    cull_where(base, camera, frustum, shown, base_views);
}

/// Returns the view of a block; other stages set keys, counts and filters.
fn view_of(camera: &Camera, index: usize, block: &Block, by: ClassifiedBy) -> BlockView {
    BlockView {
        origin_camera: camera.camera_point(block.origin).as_vec3().into(),
        block: u32::try_from(index).unwrap_or(u32::MAX),
        first: 0,
        count: 0,
        key: 0,
        filter_kind: 0,
        level: block.level,
        classified_by: by as u32,
    }
}

/// Finds the blocks that may reach the image, also those that hold nothing visible; otherwise as [`cull`].
pub fn cull_outside(
    volume: &BlockedVolume,
    camera: &Camera,
    frustum: Option<&Frustum>,
    views: &mut Vec<BlockView>,
) {
    let shown = |_: &Block| Some(ClassifiedBy::Value);
    cull_where(volume, camera, frustum, shown, views);
}

/// Finds the blocks that are shown and may reach the image.
///
/// - `shown`: returns how to classify a block's kernels, or `None` if the block holds nothing visible.
fn cull_where(
    volume: &BlockedVolume,
    camera: &Camera,
    frustum: Option<&Frustum>,
    shown: impl Fn(&Block) -> Option<ClassifiedBy> + Sync,
    views: &mut Vec<BlockView>,
) {
    views.clear();
    views.par_extend(
        volume
            .blocks
            .par_iter()
            .enumerate()
            .filter_map(|(i, block)| {
                let by = shown(block)?;
                let is_spread = by == ClassifiedBy::Extent;
                if frustum.is_some_and(|f| !f.sees(camera, block, is_spread)) {
                    return None;
                }
                Some(view_of(camera, i, block, by))
            }),
    );
}

/// Returns how to classify a block's kernels; `None` if the transfer function shows no value of the block's range, or
/// of the range that its kernels' extents reach.
fn shown_by(volume: &BlockedVolume, choice: &ChoiceUniform, block: &Block) -> Option<ClassifiedBy> {
    let by = volume.classified_by(choice, block);
    let (StrengthIn::Classified { .. }, Some(transfer)) =
        (&volume.strength, &volume.transfer_function)
    else {
        return Some(by);
    };
    let [lo, hi] = block.classified_range(by == ClassifiedBy::Extent);
    // No value at all (lo > hi): nothing is classified, so nothing is visible.
    let is_transparent = lo > hi || transfer.max_extinction(lo, hi) <= 0.0;
    (!is_transparent).then_some(by)
}

/// Number of keys from the nearest to the farthest distance: four keys of slack for roundings at either end.
pub(crate) const DEPTH_KEY_SPAN: f64 = ((1_u64 << DEPTH_KEY_BITS) - 8) as f64;

/// Range of distances of a frame's depth keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    near: f64,
    keys_per_unit: f64,
}

impl DepthRange {
    /// Returns the range from the nearest to the farthest of some (distance, radius) intervals.
    ///
    /// Pass visible intervals only, so that a far outlier outside the image costs no bits.
    pub fn of(intervals: impl Iterator<Item = (f64, f64)>) -> Self {
        let (near, far) = intervals
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(near, far), (d, r)| {
                (near.min(d - r), far.max(d + r))
            });
        let span = (far - near).max(f64::MIN_POSITIVE);
        Self {
            near,
            keys_per_unit: (DEPTH_KEY_SPAN / span).min(f64::from(f32::MAX)),
        }
    }

    /// Returns the range with `keys_per_unit` keys per unit of distance, in which `near` has the key 4.
    pub(crate) fn given(near: f64, keys_per_unit: f64) -> Self {
        Self {
            near,
            keys_per_unit,
        }
    }

    /// The key of a distance: smaller is nearer.
    pub fn key(&self, distance: f64) -> u32 {
        // A float to integer cast saturates; NaN gives 0.
        let key = ((distance - self.near) * self.keys_per_unit) as u32;
        key.saturating_add(4).min((1 << DEPTH_KEY_BITS) - 4)
    }

    /// Keys per unit of distance.
    pub fn keys_per_unit(&self) -> f32 {
        self.keys_per_unit as f32
    }
}

/// Returns the distance of a block's origin and the radius of its kernels' centres, as depth keys measure them.
///
/// - `is_spread`: whether its kernels are classified over their extents, and may be shifted.
pub fn distance_interval(camera: &Camera, block: &Block, is_spread: bool) -> (f64, f64) {
    let centre = camera.camera_point(block.origin);
    let distance = match camera.projection {
        Projection::Perspective => centre.length(),
        Projection::Orthographic => centre.z,
    };
    let shift = if is_spread {
        LOBE_REACH * block.max_sigma
    } else {
        0.0
    };
    let radius = block.half_extent.as_dvec3().length() + f64::from(shift);
    (distance, radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_keep_the_order_of_depths_that_tie_in_f32() {
        // The `depth_key_ties` case: six depths at 1e6 that are two numbers in f32.
        let depths = [
            1000000.03, 1000000.01, 1000000.02, 1000000.01, 999999.99, 1000000.04,
        ];
        let range = DepthRange::of(depths.iter().map(|&d| (d, 0.0)));
        let mut order: Vec<usize> = (0..depths.len()).collect();
        order.sort_by_key(|&i| (range.key(depths[i]), i));
        assert_eq!(order, [4, 1, 3, 2, 0, 5]);
    }
}
