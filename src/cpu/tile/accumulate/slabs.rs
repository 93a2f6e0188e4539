//! Cuts kernels into the layers that they reach, by differences of their integral along the ray.
//!
//! Twin: `shaders/tile/accumulate/slabs.wgsl`.

use super::ring::{Ring, Wants, layer_end, layer_start};
use crate::constants::TILE_SIZE;
use crate::cpu::tile::classify::slab::RowEdge;
use crate::cpu::tile::evaluate::{Along, Evaluate, Row, RowSlope};
use crate::cpu::tile::interval::cut::{Cut, Spans};
use crate::cpu::tile::interval::{between, shares_at, shares_up_to};
use crate::cpu::tile::pixels::{Plane, Tile, count_row};
use crate::math::lane::{cdf, cdf_near};
use crate::record::ViewUniform;

/// Receives rows and adds them to layers.
pub(in crate::cpu::tile) struct IntoSlabs<'a> {
    pub(super) view: &'a ViewUniform,
    pub(super) ring: &'a mut Ring,
    /// Data of the cut, if the kernel may be cut.
    pub(super) cut: Option<Cut<'a>>,
    /// First and last layer that the kernel reaches.
    pub(super) layers: [u32; 2],
    /// True if a surface divides the layers.
    pub(super) has_surface: bool,
    /// True if kernels carry values, and not colours.
    pub(super) has_values: bool,
    /// True if lighting needs the derivatives of layers.
    pub(super) has_slopes: bool,
    /// The tile in which kernels are counted, for a picture of counts.
    pub(super) count: Option<&'a mut Tile>,
}

/// Optical depth up to which the error of [`cdf_near`] is negligible: 2.4e-6.
const MOST_NEAR: f32 = 8.0;

impl IntoSlabs<'_> {
    #[inline(always)]
    pub(super) fn take<const FMA: bool>(&mut self, evaluate: &Evaluate<'_>, row: &Row) {
        if let Some(tile) = &mut self.count {
            count_row(tile, row.first(), &row.inside);
        }
        self.slice::<FMA>(evaluate, row);
        if self.has_slopes
            && let Some(slope) = evaluate.slope(row.y)
        {
            self.slope::<FMA>(evaluate, row, &slope);
        }
    }

    /// Adds a row to its layers. The first layer receives everything in front of it, the last everything
    /// behind it.
    #[inline(always)]
    fn slice<const FMA: bool>(&mut self, evaluate: &Evaluate<'_>, row: &Row) {
        let (view, first) = (self.view, row.first());
        let footprint = evaluate.footprint();
        let is_gaussian = evaluate.along() == Along::Gaussian;
        let is_thin = row.tau.iter().fold(0.0, |most: f32, tau| most.max(*tau)) <= MOST_NEAR;
        let wants = Wants {
            colour: !self.has_values,
            // A slab has its own depth.
            depth: false,
        };
        let [nearest, last] = self.layers;
        let [begins, ends] = row.domain.unwrap_or([[0.0; TILE_SIZE], [1.0; TILE_SIZE]]);
        // No closures: they would be compiled without the level's features.
        let (mut below, mut divide_at) = (begins, [1.0; TILE_SIZE]);
        if let Some(Cut { spans, meets }) = self.cut {
            below = shares_at::<FMA>(evaluate, row, &spans.near, meets.near, 0.0);
            divide_at = shares_at::<FMA>(evaluate, row, &spans.middle, meets.middle, 1.0);
        }
        for number in nearest..=last {
            let start = layer_start(view, number);
            let end = layer_end(view, number, last);
            let mut until = [end; TILE_SIZE];
            let mut above = ends;
            match self.cut {
                Some(Cut { spans, .. }) => {
                    let of_rays = spans.near[first..].iter().zip(&spans.far[first..]);
                    for (end, (near, far)) in until.iter_mut().zip(of_rays) {
                        *end = end.max(*near).min(*far);
                    }
                    above = shares_up_to::<FMA>(evaluate, row, &until);
                }
                None if number == last => {}
                None if is_gaussian && is_thin && row.domain.is_none() => {
                    for (lane, share) in above.iter_mut().enumerate() {
                        *share = cdf_near::<FMA>(row.ahead(lane, end));
                    }
                }
                None if is_gaussian && row.domain.is_none() => {
                    for (lane, share) in above.iter_mut().enumerate() {
                        *share = cdf::<FMA>(row.ahead(lane, end));
                    }
                }
                None => above = shares_up_to::<FMA>(evaluate, row, &until),
            }
            let mut own_end = above;
            if let Some(Cut { spans, .. }) = self.cut.filter(|_| self.has_surface) {
                own_end = divide_at;
                for lane in 0..TILE_SIZE {
                    // A layer behind the surface lies wholly behind it.
                    if !(start < spans.middle[first + lane] && own_end[lane] < above[lane]) {
                        own_end[lane] = above[lane];
                    }
                }
                let behind = between(row, &own_end, &above);
                self.ring.divided.add(first, &behind, footprint, wants);
            }
            let own = between(row, &below, &own_end);
            self.ring.layer(number).add(first, &own, footprint, wants);
            below = above;
        }
    }

    /// Adds the derivatives of [`Self::slice`] from pixel to pixel.
    #[inline(always)]
    fn slope<const FMA: bool>(&mut self, evaluate: &Evaluate<'_>, row: &Row, slope: &RowSlope) {
        const NONE: [f32; TILE_SIZE] = [f32::INFINITY; TILE_SIZE];
        let (view, first) = (self.view, row.first());
        let [nearest, last] = self.layers;
        let carried = evaluate.footprint().carried.value();
        let of_rays = |plane: fn(&Spans) -> &Plane| {
            let spans = self
                .cut
                .and_then(|cut| plane(cut.spans)[first..].first_chunk::<TILE_SIZE>());
            spans.copied()
        };
        let nears = of_rays(|s| &s.near).unwrap_or(NONE.map(|x| -x));
        let middles = of_rays(|s| &s.middle).filter(|_| self.has_surface);
        let fars = of_rays(|s| &s.far).unwrap_or(NONE);
        let mut begins = nears;
        let mut below = RowEdge::new::<FMA>(evaluate, row, &begins);
        for number in nearest..=last {
            let start = layer_start(view, number);
            let end = layer_end(view, number, last);
            let mut ends = [end; TILE_SIZE];
            for lane in 0..TILE_SIZE {
                ends[lane] = end.max(nears[lane]).min(fars[lane]);
            }
            let above = RowEdge::new::<FMA>(evaluate, row, &ends);
            let own = self.ring.layer(number).slopes.get_or_insert_default();
            if let Some(middles) = &middles {
                let mut divides = ends;
                for lane in 0..TILE_SIZE {
                    if start < middles[lane] {
                        divides[lane] = middles[lane].min(ends[lane]).max(begins[lane]);
                    }
                }
                let divide = RowEdge::new::<FMA>(evaluate, row, &divides);
                own.add(first, row, slope, [&below, &divide], carried);
                let behind = self.ring.divided.slopes.get_or_insert_default();
                behind.add(first, row, slope, [&divide, &above], carried);
            } else {
                own.add(first, row, slope, [&below, &above], carried);
            }
            (begins, below) = (ends, above);
        }
    }
}
