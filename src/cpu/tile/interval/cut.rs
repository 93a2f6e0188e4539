//! Tiles in which what is drawn of a ray ends: at planes that clip, and at opaque surfaces among what
//! light passes through.
//!
//! Of each pixel's ray the part between two depths is drawn; a surface divides it in two. Kernels are
//! integrated up to the surface and composited in front of it; where it covers a pixel in part, as along
//! silhouettes, what is left of them behind it is composited on its own and shows through the rest. Of
//! a kernel that is cut, the share Phi((b - z*) / sigma_z) - Phi((a - z*) / sigma_z) of its optical depth
//! lies between the depths a and b, the mass of a Gaussian on an interval.
//!
//! Twin: `shaders/tile/interval/cut.wgsl`.

use glam::Vec2;

use crate::constants::TILE_PIXELS;
use crate::cpu::tile::evaluate::Evaluate;
use crate::cpu::tile::pixels::{Plane, Tile, TilePlace, ray};
use crate::record::ViewUniform;

/// What is drawn of the rays of a tile's pixels: depths z.
#[derive(Debug, Clone)]
pub(in crate::cpu::tile) struct Spans {
    /// Where it begins.
    pub(in crate::cpu::tile) near: Plane,
    /// Where a surface divides it; its end where there is none.
    pub(in crate::cpu::tile) middle: Plane,
    /// Where it ends.
    pub(in crate::cpu::tile) far: Plane,
    /// What the tile's pixels have in common: least and greatest of each.
    nears: [f32; 2],
    middles: [f32; 2],
    fars: [f32; 2],
}

impl Default for Spans {
    fn default() -> Self {
        Self {
            near: [f32::NEG_INFINITY; TILE_PIXELS],
            middle: [f32::INFINITY; TILE_PIXELS],
            far: [f32::INFINITY; TILE_PIXELS],
            nears: [f32::NEG_INFINITY; 2],
            middles: [f32::INFINITY; 2],
            fars: [f32::INFINITY; 2],
        }
    }
}

impl Spans {
    pub(in crate::cpu::tile) fn fill(&mut self, place: &TilePlace<'_>, surface: Option<&Tile>) {
        const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];
        (self.nears, self.middles, self.fars) = (NONE, NONE, NONE);
        for i in place.pixels() {
            let [near, far] = clip_span(place.view, place.pixel(i));
            let middle = surface.map_or(far, |s| s.depth[i].max(near).min(far));
            (self.near[i], self.middle[i], self.far[i]) = (near, middle, far);
            let bounds = [&mut self.nears, &mut self.middles, &mut self.fars];
            for (bounds, depth) in bounds.into_iter().zip([near, middle, far]) {
                bounds[0] = bounds[0].min(depth);
                bounds[1] = bounds[1].max(depth);
            }
        }
    }

    /// Between which depths all of every ray is drawn.
    pub(in crate::cpu::tile) fn whole(&self) -> [f32; 2] {
        [self.nears[1], self.fars[0]]
    }

    /// Where a kernel lies.
    ///
    /// - `is_partial`: whether anything is seen behind the surface.
    pub(in crate::cpu::tile) fn side(&self, evaluate: &Evaluate<'_>, is_partial: bool) -> Side {
        let Self {
            nears,
            middles,
            fars,
            ..
        } = self;
        if let Evaluate::Near(_) = evaluate {
            return Side::Cut(Meets::ALL);
        }
        let (depth, reach) = (evaluate.footprint().depth, evaluate.depth_reach());
        let (first, last) = (depth - reach, depth + reach);
        if first >= fars[1] || last <= nears[0] {
            return Side::Hidden;
        }
        if first >= nears[1] && last <= middles[0] {
            return Side::Front;
        }
        if first >= middles[1] {
            if !is_partial {
                return Side::Hidden;
            }
            if last <= fars[0] {
                return Side::Behind;
            }
        }
        // Phrased so that NaN meets all.
        Side::Cut(Meets {
            near: !(first >= nears[1]),
            middle: !(last <= middles[0]),
            far: !(last <= fars[0]),
        })
    }
}

/// Between which depths planes leave something of the ray through a point of the image; from infinity to
/// infinity where they leave nothing.
pub(in crate::cpu::tile) fn clip_span(view: &ViewUniform, pixel: Vec2) -> [f32; 2] {
    let (mut near, mut far) = (f32::NEG_INFINITY, f32::INFINITY);
    let direction = ray(view, pixel);
    for &[nx, ny, nz, d] in &view.clip_planes[..view.clip_count as usize] {
        // The ray is at z D, or (orthographic) at (X, Y, z): inside where rate z + start >= 0.
        let across = nx * direction.x + ny * direction.y;
        let (rate, start) = if view.orthographic == 0 {
            (across + nz, d)
        } else {
            (nz, across + d)
        };
        let at = -start / rate;
        if rate > 0.0 {
            near = near.max(at);
        } else if rate < 0.0 {
            far = far.min(at);
        } else if start < 0.0 {
            far = f32::NEG_INFINITY;
        }
    }
    if near < far {
        [near, far]
    } else {
        [f32::INFINITY; 2]
    }
}

/// What is cut of a tile, and what lies behind its surface.
pub(in crate::cpu::tile) struct CutTile<'a> {
    surface: Option<&'a Tile>,
    /// What is seen behind it, where it covers a pixel in part.
    pub(in crate::cpu::tile) behind: &'a mut Tile,
    pub(in crate::cpu::tile) spans: &'a Spans,
    /// Whether it covers any pixel in part.
    pub(in crate::cpu::tile) is_partial: bool,
}

/// Where a footprint lies in a cut tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cpu::tile) enum Side {
    /// In front of the surface, cut by nothing.
    Front,
    /// Behind it, and cut by nothing else.
    Behind,
    /// Where nothing is seen.
    Hidden,
    /// Maybe cut.
    Cut(Meets),
}

/// Which ends of the parts of a tile's rays a kernel reaches: beyond the others it has nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cpu::tile) struct Meets {
    /// Where they begin.
    pub(in crate::cpu::tile) near: bool,
    /// Where the surface divides them.
    pub(in crate::cpu::tile) middle: bool,
    /// Where they end.
    pub(in crate::cpu::tile) far: bool,
}

impl Meets {
    /// Maybe all.
    pub(in crate::cpu::tile) const ALL: Self = Self {
        near: true,
        middle: true,
        far: true,
    };
}

/// What is drawn of the rays of a tile's pixels, and which of its ends a kernel reaches.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu::tile) struct Cut<'a> {
    pub(in crate::cpu::tile) spans: &'a Spans,
    pub(in crate::cpu::tile) meets: Meets,
}

impl<'a> CutTile<'a> {
    /// `None` where nothing is cut. `behind` is cleared.
    ///
    /// - `has_depth`: whether depths are wanted.
    pub(in crate::cpu::tile) fn new(
        place: &TilePlace<'_>,
        has_depth: bool,
        surface: Option<&'a Tile>,
        behind: &'a mut Tile,
        spans: &'a mut Spans,
    ) -> Option<Self> {
        // Uncovered pixels have an infinite depth.
        let covers = |s: &&Tile| place.pixels().any(|i| s.depth[i] < f32::INFINITY);
        let surface = surface.filter(covers);
        if surface.is_none() && place.view.clip_count == 0 {
            return None;
        }
        spans.fill(place, surface);
        if surface.is_some() {
            behind.clear(has_depth);
        }
        let is_part = |s: &Tile| place.pixels().any(|i| s.alpha[i] > 0.0 && s.alpha[i] < 1.0);
        Some(Self {
            is_partial: surface.is_some_and(is_part),
            surface,
            behind,
            spans,
        })
    }

    /// Whether a surface lies in the tile.
    pub(in crate::cpu::tile) fn has_surface(&self) -> bool {
        self.surface.is_some()
    }

    /// Where a kernel lies.
    pub(in crate::cpu::tile) fn side(&self, evaluate: &Evaluate<'_>) -> Side {
        self.spans.side(evaluate, self.is_partial)
    }

    /// Puts the surface, and what shows through it, behind what is in front.
    ///
    /// - `is_count`: whether pixels count kernels.
    pub(in crate::cpu::tile) fn compose(&self, is_count: bool, front: &mut Tile) {
        let Some(surface) = self.surface else {
            return;
        };
        for i in 0..TILE_PIXELS {
            let behind = &*self.behind;
            let covered = surface.alpha[i];
            let before = front.alpha[i];
            let through = 1.0 - before;
            let channels = [
                (&mut front.red, &surface.red, &behind.red),
                (&mut front.green, &surface.green, &behind.green),
                (&mut front.blue, &surface.blue, &behind.blue),
            ];
            for (channel, of_surface, of_behind) in channels {
                if is_count {
                    channel[i] += of_surface[i] + of_behind[i];
                } else {
                    channel[i] += through * (of_surface[i] + (1.0 - covered) * of_behind[i]);
                }
            }
            let at_surface = before + through * covered;
            let after = at_surface + through * (1.0 - covered) * behind.alpha[i];
            front.alpha[i] = after;
            if before < 0.5 && at_surface >= 0.5 {
                front.depth[i] = surface.depth[i];
            } else if at_surface < 0.5 && after >= 0.5 {
                front.depth[i] = behind.depth[i].min(f32::MAX);
            }
        }
    }
}
