//! Draws tiles in which rays are cut: at clip planes, at depths of the caller's, and at opaque surfaces among
//! transparent volumes.
//!
//! The part of each pixel's ray between two depths is drawn; a surface divides it in two. Kernels are
//! integrated up to the surface and composited in front of it. If the surface covers a pixel only in
//! part, as along silhouettes, the parts of kernels behind it are composited separately and show through
//! the rest. For a cut kernel, the share of its optical depth between the depths a and b is Phi((b - z*)
//! / sigma_z) - Phi((a - z*) / sigma_z), the mass of a Gaussian on an interval.
//!
//! Twin: `shaders/tile/interval/cut.wgsl`.

use glam::Vec2;

use crate::constants::TILE_PIXELS;
use crate::cpu::tile::evaluate::Evaluate;
use crate::cpu::tile::pixels::{Plane, Tile, TilePlace, ray};
use crate::frame::backdrop::RayEnds;
use crate::record::ViewUniform;

/// The parts of a tile's rays that are drawn: depths z.
#[derive(Debug, Clone)]
pub(in crate::cpu::tile) struct Spans {
    /// Depth at which each ray begins.
    pub(in crate::cpu::tile) near: Plane,
    /// Depth at which a surface divides each ray; its end if there is no surface.
    pub(in crate::cpu::tile) middle: Plane,
    /// Depth at which each ray ends.
    pub(in crate::cpu::tile) far: Plane,
    /// Least and greatest value of each over the tile's pixels.
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
    pub(in crate::cpu::tile) fn fill(
        &mut self,
        place: &TilePlace<'_>,
        surface: Option<&Tile>,
        ends: Option<&RayEnds>,
    ) {
        const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];
        (self.nears, self.middles, self.fars) = (NONE, NONE, NONE);
        for i in place.pixels() {
            let [near, far] = clip_span(place.view, place.pixel(i));
            let end = ends.map_or(f32::INFINITY, |ends| ends.at(place.at(i)));
            let [near, far] = span_of(near, far.min(end));
            let middle = surface.map_or(far, |s| s.depth[i].max(near).min(far));
            (self.near[i], self.middle[i], self.far[i]) = (near, middle, far);
            let bounds = [&mut self.nears, &mut self.middles, &mut self.fars];
            for (bounds, depth) in bounds.into_iter().zip([near, middle, far]) {
                bounds[0] = bounds[0].min(depth);
                bounds[1] = bounds[1].max(depth);
            }
        }
    }

    /// Returns the depths between which all rays are drawn in full.
    pub(in crate::cpu::tile) fn whole(&self) -> [f32; 2] {
        [self.nears[1], self.fars[0]]
    }

    /// Returns the position of a kernel relative to the spans.
    ///
    /// - `is_partial`: whether anything is visible behind the surface.
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
        // Phrased so that NaN meets all ends.
        Side::Cut(Meets {
            near: !(first >= nears[1]),
            middle: !(last <= middles[0]),
            far: !(last <= fars[0]),
        })
    }
}

/// Returns the depths between which the ray through a point of the image lies inside the clip planes;
/// from infinity to infinity if no part does.
pub(in crate::cpu::tile) fn clip_span(view: &ViewUniform, pixel: Vec2) -> [f32; 2] {
    let (mut near, mut far) = (f32::NEG_INFINITY, f32::INFINITY);
    let direction = ray(view, pixel);
    for &[nx, ny, nz, d] in &view.clip_planes[..view.clip_count as usize] {
        // The ray is at z D, or (orthographic) at (X, Y, z); inside is rate z + start >= 0.
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
    span_of(near, far)
}

/// Returns the part of a ray between two depths; from infinity to infinity if there is none.
fn span_of(near: f32, far: f32) -> [f32; 2] {
    if near < far {
        [near, far]
    } else {
        [f32::INFINITY; 2]
    }
}

/// A tile with cut rays, and the picture behind its surface.
pub(in crate::cpu::tile) struct CutTile<'a> {
    surface: Option<&'a Tile>,
    /// The picture behind the surface, for pixels that it covers in part.
    pub(in crate::cpu::tile) behind: &'a mut Tile,
    pub(in crate::cpu::tile) spans: &'a Spans,
    /// True if the surface covers any pixel in part.
    pub(in crate::cpu::tile) is_partial: bool,
}

/// Position of a footprint in a cut tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cpu::tile) enum Side {
    /// In front of the surface and uncut.
    Front,
    /// Behind the surface and otherwise uncut.
    Behind,
    /// In an invisible part.
    Hidden,
    /// Possibly cut.
    Cut(Meets),
}

/// The ends of a tile's rays that a kernel reaches. It need not be evaluated at the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cpu::tile) struct Meets {
    /// The beginning.
    pub(in crate::cpu::tile) near: bool,
    /// The surface that divides the rays.
    pub(in crate::cpu::tile) middle: bool,
    /// The end.
    pub(in crate::cpu::tile) far: bool,
}

impl Meets {
    /// Possibly all ends.
    pub(in crate::cpu::tile) const ALL: Self = Self {
        near: true,
        middle: true,
        far: true,
    };
}

/// The parts of a tile's rays that are drawn, and the ends that a kernel reaches.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu::tile) struct Cut<'a> {
    pub(in crate::cpu::tile) spans: &'a Spans,
    pub(in crate::cpu::tile) meets: Meets,
}

impl<'a> CutTile<'a> {
    /// Prepares a tile; `None` if nothing is cut. Clears `behind`.
    ///
    /// - `has_depth`: whether depths are written.
    pub(in crate::cpu::tile) fn new(
        place: &TilePlace<'_>,
        has_depth: bool,
        surface: Option<&'a Tile>,
        ends: Option<&RayEnds>,
        behind: &'a mut Tile,
        spans: &'a mut Spans,
    ) -> Option<Self> {
        // Uncovered pixels have an infinite depth.
        let covers = |s: &&Tile| place.pixels().any(|i| s.depth[i] < f32::INFINITY);
        let surface = surface.filter(covers);
        let end = |ends: &&RayEnds| place.pixels().any(|i| ends.at(place.at(i)) < f32::INFINITY);
        let ends = ends.filter(end);
        if surface.is_none() && ends.is_none() && place.view.clip_count == 0 {
            return None;
        }
        spans.fill(place, surface, ends);
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

    /// Returns whether a surface lies in the tile.
    pub(in crate::cpu::tile) fn has_surface(&self) -> bool {
        self.surface.is_some()
    }

    /// Returns the position of a kernel.
    pub(in crate::cpu::tile) fn side(&self, evaluate: &Evaluate<'_>) -> Side {
        self.spans.side(evaluate, self.is_partial)
    }

    /// Composites the surface, and the picture that shows through it, behind the picture in front.
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
