//! Sums kernels of a tile in layers (sheets or slabs), and composites the layers.
//!
//! Footprints arrive in the order of their layers; with slabs, of the first layer that they reach. A tile
//! keeps the open layers in a ring. A footprint adds to its own layer (sheets) or to all layers that it
//! reaches, by differences of its integral along the ray (slabs). Before a footprint of a farther layer
//! is drawn, nearer layers are composited. A layer has the sum of its kernels' optical depths and their
//! mean colour, weighted by optical depth.
//!
//! A surface divides one layer of each pixel: the part behind the surface is kept separately.
//!
//! Twin: `shaders/tile/accumulate/layers.wgsl`.

use super::ring::{Layer, Ring, layer_at, layer_start};
use super::sheets::IntoSheet;
use super::slabs::IntoSlabs;
use super::{AddRows, Into, maximum};
use crate::blocks::MOST_SLABS;
use crate::constants::TILE_PIXELS;
use crate::cpu::tile::classify::slab::PostClassification;
use crate::cpu::tile::evaluate::Evaluate;
use crate::cpu::tile::interval::cut::{Cut, CutTile, Meets, Side};
use crate::cpu::tile::interval::within;
use crate::cpu::tile::pixels::{Plane, Tile, TilePlace};
use crate::math::lane::opacity;
use crate::record::{ExactTerms, Footprint, NearTerms};
use crate::simd::{SimdLevel, SimdWork, run_at};
use crate::splat::{Accumulate, Axes};

/// A tile in which kernels are summed layer by layer.
pub(in crate::cpu::tile) struct LayeredTile<'a, 'b> {
    pub(in crate::cpu::tile) place: TilePlace<'a>,
    pub(in crate::cpu::tile) axes: Axes,
    pub(in crate::cpu::tile) level: SimdLevel,
    /// |D| of each pixel's ray, if any footprint is on the exact path.
    pub(in crate::cpu::tile) rays: &'a Plane,
    pub(in crate::cpu::tile) post: Option<PostClassification<'a>>,
    pub(in crate::cpu::tile) ring: &'a mut Ring,
    pub(in crate::cpu::tile) cut: Option<CutTile<'b>>,
}

impl LayeredTile<'_, '_> {
    /// Adds a footprint to its layers, after compositing the layers in front of them into the tile.
    /// Returns the number of pixels that evaluated it.
    pub(in crate::cpu::tile) fn add(
        &mut self,
        tile: &mut Tile,
        footprint: &Footprint,
        terms: Option<&ExactTerms>,
        near: &[NearTerms],
    ) -> u32 {
        let view = self.place.view;
        let own_first = footprint.key >> view.layer_shift;
        self.flush(tile, own_first);
        // Keys of sheets are in order; keys of slabs are in order within their rounding.
        let first = own_first.max(self.ring.first);
        let evaluate = Evaluate::new(&self.place, footprint, terms, near);
        let side = match &self.cut {
            None => Side::Front,
            Some(cut) => cut.side(&evaluate),
        };
        if side == Side::Hidden {
            return 0;
        }
        let is_slabs = self.axes.accumulate.cuts_slabs();
        let last = if is_slabs {
            let reach = evaluate.depth_reach();
            // No farther behind its centre than its beginning is before it: slopes are rounded.
            let reach = match evaluate {
                Evaluate::Near(_) => reach,
                _ => reach.min(footprint.depth - layer_start(view, own_first)),
            };
            let last = layer_at(view, footprint.depth + reach, first);
            last.min(first.saturating_add(MOST_SLABS))
        } else {
            first
        };
        self.ring.grow(last);
        for layer in first..=last {
            self.ring.layer(layer).is_used = true;
        }
        let has_cut = side != Side::Front;
        let cut = self.cut.as_ref().filter(|_| has_cut).map(|cut| Cut {
            spans: cut.spans,
            meets: match side {
                Side::Cut(meets) => meets,
                _ => Meets::ALL,
            },
        });
        let has_surface = self.cut.as_ref().is_some_and(CutTile::has_surface);
        self.ring.divided.is_used |= has_surface && has_cut;
        let ring = &mut *self.ring;
        let count = self.axes.count.then_some(tile);
        let into = if is_slabs {
            Into::Slabs(IntoSlabs {
                view,
                ring,
                cut,
                layers: [first, last],
                has_surface,
                has_values: self.post.is_some(),
                has_slopes: self.post.is_some_and(|post| post.lighting.is_some()),
                count,
            })
        } else {
            Into::Sheet(IntoSheet {
                ring,
                cut,
                layer: first,
                has_depth: self.axes.depth,
                count,
            })
        };
        let work = AddRows {
            evaluate: &evaluate,
            rays: self.rays,
            into,
        };
        run_at(self.level, work)
    }

    /// Composites all open layers, and the parts behind the surface.
    pub(in crate::cpu::tile) fn finish(mut self, tile: &mut Tile) {
        self.flush(tile, u32::MAX);
        if let (Accumulate::Maximum, Some(post)) = (self.axes.accumulate, self.post) {
            maximum::colour(tile, &post, self.axes.count);
            return;
        }
        if let Some(cut) = self.cut {
            cut.compose(self.axes.count, tile);
        }
    }

    /// Composites the layers in front of one.
    fn flush(&mut self, tile: &mut Tile, until: u32) {
        let count = until.saturating_sub(self.ring.first);
        for ahead in 0..count.min(self.ring.layers.len() as u32) {
            let number = self.ring.first + ahead;
            let place = self.ring.place(number);
            if !self.ring.layers[place].is_used {
                continue;
            }
            if self.axes.accumulate == Accumulate::Maximum {
                if !self.axes.count {
                    let layer = &self.ring.layers[place];
                    maximum::take(self.place.view, number, &layer.tau, &layer.red, tile);
                }
                self.ring.layers[place].clear();
                continue;
            }
            let flush = |layer: &Layer, front: &mut Tile, part: Part<'_>, bounds: Bounds<'_>| {
                let work = Flush {
                    place: &self.place,
                    axes: &self.axes,
                    post: self.post,
                    number,
                    layer,
                    tile: front,
                    part,
                    bounds,
                };
                run_at(self.level, work);
            };
            let layer = &self.ring.layers[place];
            match &mut self.cut {
                None => flush(layer, tile, Part::All, None),
                Some(cut) => {
                    let is_slabs = self.axes.accumulate == Accumulate::Slabs;
                    let spans = cut.spans;
                    let middle = (is_slabs && cut.has_surface()).then_some(&spans.middle);
                    let in_front = Some([&spans.near, &spans.middle]);
                    let beyond = Some([&spans.middle, &spans.far]);
                    flush(layer, tile, middle.map_or(Part::All, Part::Front), in_front);
                    if cut.is_partial {
                        if let Some(middle) = middle {
                            flush(layer, cut.behind, Part::Behind(middle), beyond);
                        }
                        let divided = middle.map_or(Part::All, Part::Divided);
                        flush(&self.ring.divided, cut.behind, divided, beyond);
                    }
                    // The divided part of a sheet is finished as a whole; that of a slab only within this
                    // layer.
                    match middle {
                        None => self.ring.divided.clear(),
                        Some(middle) => {
                            let end = layer_start(self.place.view, number + 1);
                            let divided = &mut self.ring.divided;
                            for i in (0..TILE_PIXELS).filter(|&i| middle[i] < end) {
                                divided.clear_pixel(i);
                            }
                        }
                    }
                }
            }
            self.ring.layers[place].clear();
        }
        self.ring.first = self.ring.first.max(until);
    }
}

/// The pixels of a layer that are composited.
#[derive(Debug, Clone, Copy)]
enum Part<'a> {
    /// All pixels.
    All,
    /// Pixels whose surface lies beyond the layer's beginning.
    Front(&'a Plane),
    /// All other pixels.
    Behind(&'a Plane),
    /// Pixels whose surface divides the layer.
    Divided(&'a Plane),
}

/// A layer to be composited into a tile.
struct Flush<'a> {
    place: &'a TilePlace<'a>,
    axes: &'a Axes,
    post: Option<PostClassification<'a>>,
    number: u32,
    layer: &'a Layer,
    tile: &'a mut Tile,
    part: Part<'a>,
    bounds: Bounds<'a>,
}

/// Depths between which a pixel's ray is drawn, if anything cuts it.
type Bounds<'a> = Option<[&'a Plane; 2]>;

impl SimdWork for Flush<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) {
        let Self {
            place,
            axes,
            post,
            number,
            layer,
            tile,
            part,
            bounds,
        } = self;
        let start = layer_start(place.view, number);
        let end = layer_start(place.view, number + 1);
        let mut taus = layer.tau;
        let keep = |taus: &mut Plane, middle: &Plane, is_kept: fn(f32, [f32; 2]) -> bool| {
            for (tau, middle) in taus.iter_mut().zip(middle) {
                if !is_kept(*middle, [start, end]) {
                    *tau = 0.0;
                }
            }
        };
        match part {
            Part::All => {}
            Part::Front(middle) => keep(&mut taus, middle, |m, [start, _]| start < m),
            Part::Behind(middle) => keep(&mut taus, middle, |m, [start, _]| start >= m),
            Part::Divided(middle) => {
                keep(&mut taus, middle, |m, [start, end]| start < m && m < end);
            }
        }
        let mut classified;
        let mut layer = layer;
        if let Some(post) = post {
            classified = Layer::default();
            for (i, length) in taus.into_iter().enumerate().filter(|(_, tau)| *tau > 0.0) {
                let sums = [length, layer.red[i]];
                let depth = 0.5 * (start + end);
                let slopes = layer.slopes.as_deref();
                let [red, green, blue, tau] = post.classify(place, i, sums, slopes, depth);
                classified.tau[i] = tau;
                classified.red[i] = tau * red;
                classified.green[i] = tau * green;
                classified.blue[i] = tau * blue;
            }
            layer = &classified;
            taus = layer.tau;
        }
        // Contribution of the layer to each pixel, per unit of its optical depth.
        let mut per_tau = [0.0; TILE_PIXELS];
        for ((per_tau, alpha), &tau) in per_tau.iter_mut().zip(&mut tile.alpha).zip(&taus) {
            let opacity = if axes.linear_opacity {
                tau.min(1.0)
            } else {
                opacity::<FMA>(tau)
            };
            let weight = opacity * (1.0 - *alpha);
            *alpha += weight;
            *per_tau = weight / tau.max(f32::MIN_POSITIVE);
        }
        if !axes.count {
            let colours = [
                (&mut tile.red, &layer.red),
                (&mut tile.green, &layer.green),
                (&mut tile.blue, &layer.blue),
            ];
            for (sums, of_layer) in colours {
                for ((sum, c), per_tau) in sums.iter_mut().zip(of_layer).zip(&per_tau) {
                    *sum += per_tau * c;
                }
            }
        }
        if axes.depth {
            for i in 0..TILE_PIXELS {
                let after = tile.alpha[i];
                if after >= 0.5 && tile.depth[i] == f32::INFINITY {
                    let depth = depth_of_half(axes.accumulate, layer, i, [start, end]);
                    let bounds = bounds.map(|[from, to]| [from[i], to[i]]);
                    tile.depth[i] = bounds.map_or(depth, |bounds| within(depth, bounds));
                }
            }
        }
    }
}

/// Returns the depth at which a layer made half of a pixel opaque: for sheets the mean of its kernels,
/// for slabs its middle.
fn depth_of_half(accumulate: Accumulate, layer: &Layer, i: usize, [start, end]: [f32; 2]) -> f32 {
    if accumulate == Accumulate::Slabs {
        (0.5 * (start + end)).max(0.0)
    } else {
        (layer.depth[i] / layer.tau[i]).max(0.0)
    }
}
