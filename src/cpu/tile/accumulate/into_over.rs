//! Composites rows of optical depths into a tile, one kernel behind another.

use crate::constants::TILE_SIZE;
use crate::cpu::tile::evaluate::{Evaluate, Row};
use crate::cpu::tile::interval::cut::Cut;
use crate::cpu::tile::interval::{between, shares_at, whole, within};
use crate::cpu::tile::pixels::{RowOf, Tile};
use crate::math::lane::{madd, opacity};
use crate::record::Footprint;
use crate::splat::Axes;

/// Returns the depth of a kernel: its centre's, but not less than the eye's, which a kernel may contain.
#[inline(always)]
pub(super) fn depth_of(footprint: &Footprint) -> f32 {
    footprint.depth.max(0.0)
}

/// Appearance of a kernel: its effect on a pixel, given its opacity.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light {
    colour: [f32; 3],
    depth: f32,
    /// Opacity min(tau, ceiling) instead of 1 - exp(-tau).
    ceiling: Option<f32>,
    has_depth: bool,
    /// True if pixels count kernels instead of showing them.
    is_count: bool,
}

impl Light {
    #[inline(always)]
    pub(super) fn new(axes: &Axes, footprint: &Footprint) -> Self {
        Self {
            colour: footprint.carried.colour(),
            depth: depth_of(footprint),
            ceiling: footprint.ceiling().or(axes.linear_opacity.then_some(1.0)),
            has_depth: axes.depth,
            is_count: axes.count,
        }
    }
}

/// Receives rows and composites them into a tile.
pub(in crate::cpu::tile) struct IntoOver<'a> {
    /// Data of the cut, if the kernel may be cut.
    pub(super) cut: Option<Cut<'a>>,
    pub(super) front: &'a mut Tile,
    /// The tile behind the surface, if the kernel shows through the surface.
    pub(super) behind: Option<&'a mut Tile>,
    pub(super) light: Light,
}

impl IntoOver<'_> {
    #[inline(always)]
    pub(super) fn take<const FMA: bool>(&mut self, evaluate: &Evaluate<'_>, row: &Row) {
        let depth = self.light.depth;
        let Some(Cut { spans, meets }) = self.cut else {
            put::<FMA>(self.front, row, &whole(row), &self.light, |_| depth);
            return;
        };
        // Three calls: a closure would be compiled without the level's features.
        let near = shares_at::<FMA>(evaluate, row, &spans.near, meets.near, 0.0);
        let middle = shares_at::<FMA>(evaluate, row, &spans.middle, meets.middle, 1.0);
        let in_front = between(row, &near, &middle);
        put::<FMA>(self.front, row, &in_front, &self.light, |i| {
            within(depth, [spans.near[i], spans.middle[i]])
        });
        if let (Some(behind), false) = (&mut self.behind, self.light.is_count) {
            let far = shares_at::<FMA>(evaluate, row, &spans.far, meets.far, 1.0);
            let beyond = between(row, &middle, &far);
            put::<FMA>(behind, row, &beyond, &self.light, |i| {
                within(depth, [spans.middle[i], spans.far[i]])
            });
        }
    }
}

/// Composites a row of optical depths behind its pixels' contents. In a picture of counts it counts the
/// kernel instead.
#[inline(always)]
fn put<const FMA: bool>(
    tile: &mut Tile,
    row: &Row,
    taus: &RowOf<f32>,
    light: &Light,
    depth_of: impl Fn(usize) -> f32,
) {
    let first = row.first();
    let (Some(alphas), Some(reds), Some(greens), Some(blues)) = (
        tile.alpha[first..].first_chunk_mut::<TILE_SIZE>(),
        tile.red[first..].first_chunk_mut::<TILE_SIZE>(),
        tile.green[first..].first_chunk_mut::<TILE_SIZE>(),
        tile.blue[first..].first_chunk_mut::<TILE_SIZE>(),
    ) else {
        return;
    };
    let [red, green, blue] = if light.is_count {
        [1.0; 3]
    } else {
        light.colour
    };
    let mut opacities = [0.0; TILE_SIZE];
    for (out, &tau) in opacities.iter_mut().zip(taus) {
        *out = match light.ceiling {
            Some(ceiling) => tau.min(ceiling),
            None => opacity::<FMA>(tau),
        };
    }
    let before = *alphas;
    for lane in 0..TILE_SIZE {
        let weight = opacities[lane] * (1.0 - before[lane]);
        alphas[lane] = before[lane] + weight;
        let share = if light.is_count {
            row.inside[lane] as f32
        } else {
            weight
        };
        reds[lane] = madd::<FMA>(share, red, reds[lane]);
        greens[lane] = madd::<FMA>(share, green, greens[lane]);
        blues[lane] = madd::<FMA>(share, blue, blues[lane]);
    }
    if light.has_depth {
        for lane in 0..TILE_SIZE {
            if before[lane] < 0.5 && alphas[lane] >= 0.5 {
                tile.depth[first + lane] = depth_of(first + lane);
            }
        }
    }
}
