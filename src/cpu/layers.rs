//! Tiles whose kernels are summed in layers, sheets or slabs, before these are composited.
//!
//! Footprints come in the order in which their layers (of slabs: the first ones that they reach) lie.
//! A tile keeps the layers that are open in a ring: what a footprint adds goes to its own layer (sheets)
//! or, by differences of its integral along the ray, to all that it reaches (slabs). Before a footprint
//! whose layer lies farther is drawn, nearer layers are composited: an optical depth, the sum of those
//! of the kernels, and their mean colour, weighted by it.
//!
//! A surface divides one layer of each pixel: what lies in it behind the surface is kept apart.
//!
//! Twin: `shaders/rasterise.wgsl` with `COMPOSITE`.

use glam::Vec2;

use super::cut::{CutTile, Side, Spans, depth_reach, near_cut, near_terms_of, within};
use super::lanes::{Kernel, Plane, SimdLevel, Tile, add_scaled, cdf, opacity, run_at};
use super::post::{PostClassification, RowEdge, Slopes};
use super::rasterise::{TileRaster, near_depth};
use super::row::{Row, RowSlope, RowWalk};
use crate::blocks::MOST_SLABS;
use crate::constants::{TILE_PIXELS, TILE_SIZE};
use crate::layout::{ExactTerms, Footprint, NearTerms, ViewUniform};
use crate::splat::Composite;

/// Sums over the kernels of a layer, for each pixel.
#[derive(Debug, Clone)]
#[repr(align(64))]
struct Layer {
    tau: Plane,
    /// Optical depth times linear colour.
    red: Plane,
    green: Plane,
    blue: Plane,
    /// Optical depth times depth; of sheets, where depths are wanted.
    depth: Plane,
    /// How the sums change, where light asks for it.
    slopes: Option<Box<Slopes>>,
    /// Whether anything was added since it was cleared.
    is_used: bool,
}

impl Default for Layer {
    fn default() -> Self {
        Self {
            tau: [0.0; TILE_PIXELS],
            red: [0.0; TILE_PIXELS],
            green: [0.0; TILE_PIXELS],
            blue: [0.0; TILE_PIXELS],
            depth: [0.0; TILE_PIXELS],
            slopes: None,
            is_used: false,
        }
    }
}

impl Layer {
    fn clear(&mut self) {
        if self.is_used {
            let mut slopes = self.slopes.take();
            if let Some(slopes) = &mut slopes {
                **slopes = Slopes::default();
            }
            *self = Self {
                slopes,
                ..Self::default()
            };
        }
    }

    /// Forgets pixel `i`.
    fn clear_pixel(&mut self, i: usize) {
        for plane in [
            &mut self.tau,
            &mut self.red,
            &mut self.green,
            &mut self.blue,
            &mut self.depth,
        ] {
            plane[i] = 0.0;
        }
        if let Some(slopes) = &mut self.slopes {
            slopes.clear_pixel(i);
        }
    }

    /// Adds optical depths to the pixels from `first` on.
    ///
    /// - `has_depth`: whether depths are wanted.
    #[inline(always)]
    fn add<const N: usize>(
        &mut self,
        first: usize,
        taus: [f32; N],
        footprint: &Footprint,
        has_depth: bool,
    ) {
        let [red, green, blue] = footprint.colour;
        add_scaled(&mut self.tau, first, &taus, 1.0);
        add_scaled(&mut self.red, first, &taus, red);
        add_scaled(&mut self.green, first, &taus, green);
        add_scaled(&mut self.blue, first, &taus, blue);
        if has_depth {
            add_scaled(&mut self.depth, first, &taus, footprint.depth);
        }
    }
}

/// The open layers of a tile.
#[derive(Debug)]
pub(super) struct Ring {
    /// Layer n lies at n modulo their number, a power of two.
    layers: Vec<Layer>,
    /// The nearest open layer.
    first: u32,
    /// What lies behind the surface in the layer that it divides.
    divided: Layer,
}

impl Default for Ring {
    fn default() -> Self {
        Self {
            layers: vec![Layer::default()],
            first: 0,
            divided: Layer::default(),
        }
    }
}

/// Where a layer of slabs begins: depth z.
pub(super) fn layer_start(view: &ViewUniform, layer: u32) -> f32 {
    view.layer_near + layer as f32 * view.layer_thickness
}

/// The layer that holds a depth, `first` where that lies in front of it.
fn layer_at(view: &ViewUniform, depth: f32, first: u32) -> u32 {
    // A cast saturates, and NaN gives 0.
    (((depth - view.layer_near) / view.layer_thickness) as u32).max(first)
}

impl Ring {
    /// Forgets another tile.
    pub(super) fn clear(&mut self) {
        self.layers.iter_mut().for_each(Layer::clear);
        self.divided.clear();
        self.first = 0;
    }

    /// Makes room for layers up to `last`.
    fn grow(&mut self, last: u32) {
        let wanted = (last - self.first + 1) as usize;
        if wanted <= self.layers.len() {
            return;
        }
        let old = std::mem::take(&mut self.layers);
        self.layers
            .resize_with(wanted.next_power_of_two(), Layer::default);
        let n = old.len();
        for (i, layer) in old.into_iter().enumerate() {
            // The layer from `first` on that lay at i.
            let ahead = (i + n - self.first as usize % n) % n;
            let at = (self.first as usize + ahead) % self.layers.len();
            self.layers[at] = layer;
        }
    }

    fn place(&self, layer: u32) -> usize {
        layer as usize & (self.layers.len() - 1)
    }
}

/// A tile drawn in layers.
pub(super) struct LayeredTile<'a, 'b> {
    pub(super) raster: &'a TileRaster<'a>,
    pub(super) post: Option<PostClassification<'a>>,
    pub(super) ring: &'a mut Ring,
    pub(super) cut: Option<CutTile<'b>>,
}

impl LayeredTile<'_, '_> {
    /// Adds a footprint to its layers, after those in front of them went into the tile; returns how
    /// many pixels evaluated it.
    pub(super) fn add(
        &mut self,
        tile: &mut Tile,
        footprint: &Footprint,
        terms: Option<&ExactTerms>,
        near: &[NearTerms],
    ) -> u32 {
        let view = self.raster.view;
        let first = footprint.key >> view.layer_shift;
        self.flush(tile, first);
        // Keys of sheets are in order; of slabs, within their rounding.
        let own_first = first;
        let first = first.max(self.ring.first);
        let is_slabs = self.raster.settings.composite == Composite::Slabs;
        let none = ExactTerms::default();
        let terms = terms.unwrap_or(&none);
        let near = near_terms_of(footprint, near);
        let side = match (&self.cut, near) {
            (None, _) => Side::Front,
            (Some(_), Some(_)) => Side::Cut,
            (Some(cut), None) => cut.side(footprint, terms),
        };
        if side == Side::Hidden {
            return 0;
        }
        let last = if is_slabs {
            let reach = match near {
                Some(_) => near_reach(footprint, near),
                // No farther behind its centre than it begins before that: slopes are rounded.
                None => {
                    let before = footprint.depth - layer_start(view, own_first);
                    depth_reach(footprint, terms).min(before)
                }
            };
            let last = layer_at(view, footprint.depth + reach, first);
            last.min(first.saturating_add(MOST_SLABS))
        } else {
            first
        };
        self.ring.grow(last);
        for layer in first..=last {
            let place = self.ring.place(layer);
            self.ring.layers[place].is_used = true;
        }
        let has_cut = side != Side::Front;
        let spans = self.cut.as_ref().filter(|_| has_cut).map(|cut| cut.spans);
        let has_surface = self.cut.as_ref().is_some_and(CutTile::has_surface);
        self.ring.divided.is_used |= has_surface && has_cut;
        let work = Add {
            raster: self.raster,
            ring: self.ring,
            spans,
            footprint,
            terms,
            near,
            layers: [first, last],
            is_slabs,
            has_surface,
            has_slopes: self.post.is_some_and(|post| post.lighting.is_some()),
            tile,
        };
        run_at(self.raster.settings.level, work)
    }

    /// Composites all layers that are open, and what is cut.
    pub(super) fn finish(mut self, tile: &mut Tile) {
        self.flush(tile, u32::MAX);
        if let Some(cut) = self.cut {
            cut.compose(self.raster, tile);
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
            let flush = |layer: &Layer, front: &mut Tile, part: Part<'_>, bounds: Bounds<'_>| {
                let work = Flush {
                    raster: self.raster,
                    post: self.post,
                    number,
                    layer,
                    tile: front,
                    part,
                    bounds,
                };
                run_at(level(self.raster), work);
            };
            let layer = &self.ring.layers[place];
            match &mut self.cut {
                None => flush(layer, tile, Part::All, None),
                Some(cut) => {
                    let is_slabs = self.raster.settings.composite == Composite::Slabs;
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
                    // Of sheets the whole is done with; of slabs what belongs to this layer.
                    match middle {
                        None => self.ring.divided.clear(),
                        Some(middle) => {
                            let end = layer_start(self.raster.view, number + 1);
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

fn level(raster: &TileRaster<'_>) -> SimdLevel {
    raster.settings.level
}

/// How far a kernel that crosses the plane of the eye reaches along z.
fn near_reach(footprint: &Footprint, near: Option<&NearTerms>) -> f32 {
    match near {
        Some(terms) if footprint.path & 3 == crate::layout::PATH_HALF_LINE => {
            let [gx, gy, _] = terms.half_line;
            let as_exact = ExactTerms {
                gradient: [gx, gy],
                depth_sigma: terms.sigma,
                ..ExactTerms::default()
            };
            depth_reach(footprint, &as_exact)
        }
        _ => footprint.form_p[0],
    }
}

/// Which pixels of a layer are composited.
#[derive(Debug, Clone, Copy)]
enum Part<'a> {
    /// All.
    All,
    /// Those whose surface lies beyond its beginning.
    Front(&'a Plane),
    /// The others.
    Behind(&'a Plane),
    /// Those whose surface divides it.
    Divided(&'a Plane),
}

/// A layer on its way into a tile.
struct Flush<'a> {
    raster: &'a TileRaster<'a>,
    post: Option<PostClassification<'a>>,
    number: u32,
    layer: &'a Layer,
    tile: &'a mut Tile,
    part: Part<'a>,
    bounds: Bounds<'a>,
}

/// Between which depths a pixel's ray is drawn, where anything cuts it.
type Bounds<'a> = Option<[&'a Plane; 2]>;

impl Kernel for Flush<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Self {
            raster,
            post,
            number,
            layer,
            tile,
            part,
            bounds,
        } = self;
        let settings = raster.settings;
        let start = layer_start(raster.view, number);
        let end = layer_start(raster.view, number + 1);
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
                let [red, green, blue, tau] = post.classify(raster, i, sums, slopes, depth);
                classified.tau[i] = tau;
                classified.red[i] = tau * red;
                classified.green[i] = tau * green;
                classified.blue[i] = tau * blue;
            }
            layer = &classified;
            taus = layer.tau;
        }
        // Of each pixel what the layer adds, for one of its optical depth.
        let mut per_tau = [0.0; TILE_PIXELS];
        for ((per_tau, alpha), &tau) in per_tau.iter_mut().zip(&mut tile.alpha).zip(&taus) {
            let opacity = if settings.linear_opacity {
                tau.min(1.0)
            } else {
                opacity::<FMA>(tau)
            };
            let weight = opacity * (1.0 - *alpha);
            *alpha += weight;
            *per_tau = weight / tau.max(f32::MIN_POSITIVE);
        }
        if !settings.count {
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
        if settings.depth {
            for i in 0..TILE_PIXELS {
                let after = tile.alpha[i];
                if after >= 0.5 && tile.depth[i] == f32::INFINITY {
                    let depth = depth_of_half(settings.composite, layer, i, [start, end]);
                    let bounds = bounds.map(|[from, to]| [from[i], to[i]]);
                    tile.depth[i] = bounds.map_or(depth, |bounds| within(depth, bounds));
                }
            }
        }
    }
}

/// The depth at which a layer made half of a pixel opaque: of sheets the mean of its kernels, of slabs
/// its middle.
fn depth_of_half(composite: Composite, layer: &Layer, i: usize, [start, end]: [f32; 2]) -> f32 {
    if composite == Composite::Slabs {
        (0.5 * (start + end)).max(0.0)
    } else {
        (layer.depth[i] / layer.tau[i]).max(0.0)
    }
}

/// A footprint on its way into layers.
struct Add<'a> {
    raster: &'a TileRaster<'a>,
    ring: &'a mut Ring,
    /// Where it may be cut.
    spans: Option<&'a Spans>,
    footprint: &'a Footprint,
    terms: &'a ExactTerms,
    near: Option<&'a NearTerms>,
    /// The first and the last layer that it reaches.
    layers: [u32; 2],
    is_slabs: bool,
    /// Whether a surface divides them.
    has_surface: bool,
    /// Whether light asks how layers change.
    has_slopes: bool,
    /// For counts.
    tile: &'a mut Tile,
}

impl Kernel for Add<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<const FMA: bool>(mut self) -> u32 {
        let patch = self.raster.patch(self.footprint);
        let walk = RowWalk::new(self.footprint, self.terms, patch);
        let mut count = 0;
        for y in patch.rows[0]..patch.rows[1] {
            let first = y * TILE_SIZE;
            if let Some(near) = self.near {
                for x in patch.columns[0]..patch.columns[1] {
                    count += self.add_near(near, first + x);
                }
                continue;
            }
            let row = walk.row::<FMA>(y, &self.tile.ray_length[first..]);
            count += row.count;
            if row.count == 0 {
                continue;
            }
            if self.raster.settings.count {
                for lane in 0..TILE_SIZE {
                    self.count(first + lane, row.inside[lane] as f32);
                }
            }
            if self.is_slabs {
                self.slice_row::<FMA>(&row, first);
                if self.has_slopes {
                    self.slope_row::<FMA>(&row, &walk.slope(y), first);
                }
            } else {
                self.add_row::<FMA>(&row, first);
            }
        }
        count
    }
}

impl Add<'_> {
    #[inline(always)]
    fn count(&mut self, i: usize, n: f32) {
        self.tile.red[i] += n;
        self.tile.green[i] += n;
        self.tile.blue[i] += n;
    }

    /// Adds whole kernels to their sheet.
    #[inline(always)]
    fn add_row<const FMA: bool>(&mut self, row: &Row, first: usize) {
        let place = self.ring.place(self.layers[0]);
        let has_depth = self.raster.settings.depth;
        let Some(spans) = self.spans else {
            self.ring.layers[place].add(first, row.tau, self.footprint, has_depth);
            return;
        };
        let [near, middle, far] = [&spans.near, &spans.middle, &spans.far]
            .map(|plane| row.shares_up_to::<FMA>(&plane[first..], false));
        let in_front = row.between(&near, &middle);
        self.ring.layers[place].add(first, in_front, self.footprint, has_depth);
        let behind = row.between(&middle, &far);
        self.ring
            .divided
            .add(first, behind, self.footprint, has_depth);
    }

    /// Cuts kernels into slabs: the first takes what lies in front of it, the last what lies behind.
    #[inline(always)]
    fn slice_row<const FMA: bool>(&mut self, row: &Row, first: usize) {
        let view = self.raster.view;
        // A slab's depth is its own.
        let has_depth = false;
        let [nearest, last] = self.layers;
        let share_of = |plane: &Plane| row.shares_up_to::<FMA>(&plane[first..], false);
        let mut below = self.spans.map_or([0.0; TILE_SIZE], |s| share_of(&s.near));
        let divide_at = self.spans.map_or([1.0; TILE_SIZE], |s| share_of(&s.middle));
        for number in nearest..=last {
            let (start, end) = (layer_start(view, number), layer_start(view, number + 1));
            let place = self.ring.place(number);
            let mut ends = [f32::INFINITY; TILE_SIZE];
            if number < last {
                ends = [end; TILE_SIZE];
            }
            let Some(spans) = self.spans else {
                let mut above = [1.0; TILE_SIZE];
                if number < last {
                    let kernels = row.depth.iter().zip(&row.per_sigma);
                    for (above, (depth, per_sigma)) in above.iter_mut().zip(kernels) {
                        *above = cdf::<FMA>((end - depth) * per_sigma);
                    }
                }
                let own = row.between(&below, &above);
                self.ring.layers[place].add(first, own, self.footprint, has_depth);
                below = above;
                continue;
            };
            let of_rays = spans.near[first..].iter().zip(&spans.far[first..]);
            for (end, (near, far)) in ends.iter_mut().zip(of_rays) {
                *end = end.max(*near).min(*far);
            }
            let above = row.shares_up_to::<FMA>(&ends, false);
            if !self.has_surface {
                let own = row.between(&below, &above);
                self.ring.layers[place].add(first, own, self.footprint, has_depth);
                below = above;
                continue;
            }
            let mut divide = divide_at;
            for lane in 0..TILE_SIZE {
                // A layer behind the surface is all behind it.
                if !(start < spans.middle[first + lane] && divide[lane] < above[lane]) {
                    divide[lane] = above[lane];
                }
            }
            let own = row.between(&below, &divide);
            self.ring.layers[place].add(first, own, self.footprint, has_depth);
            let behind = row.between(&divide, &above);
            self.ring
                .divided
                .add(first, behind, self.footprint, has_depth);
            below = above;
        }
    }

    /// What [`Self::slice_row`] adds, by how it changes from pixel to pixel.
    #[inline(always)]
    fn slope_row<const FMA: bool>(&mut self, row: &Row, slope: &RowSlope, first: usize) {
        const NONE: [f32; TILE_SIZE] = [f32::INFINITY; TILE_SIZE];
        let view = self.raster.view;
        let [nearest, last] = self.layers;
        let carried = self.footprint.colour[0];
        let of_rays = |plane: fn(&Spans) -> &Plane| {
            let spans = self
                .spans
                .and_then(|s| plane(s)[first..].first_chunk::<TILE_SIZE>());
            spans.copied()
        };
        let nears = of_rays(|s| &s.near).unwrap_or(NONE.map(|x| -x));
        let middles = of_rays(|s| &s.middle).filter(|_| self.has_surface);
        let fars = of_rays(|s| &s.far).unwrap_or(NONE);
        let mut begins = nears;
        let mut below = RowEdge::new::<FMA>(row, &begins);
        for number in nearest..=last {
            let start = layer_start(view, number);
            let end = if number < last {
                layer_start(view, number + 1)
            } else {
                f32::INFINITY
            };
            let mut ends = [end; TILE_SIZE];
            for lane in 0..TILE_SIZE {
                ends[lane] = end.max(nears[lane]).min(fars[lane]);
            }
            let above = RowEdge::new::<FMA>(row, &ends);
            let place = self.ring.place(number);
            let own = self.ring.layers[place].slopes.get_or_insert_default();
            if let Some(middles) = &middles {
                let mut divides = ends;
                for lane in 0..TILE_SIZE {
                    if start < middles[lane] {
                        divides[lane] = middles[lane].min(ends[lane]).max(begins[lane]);
                    }
                }
                let divide = RowEdge::new::<FMA>(row, &divides);
                own.add(first, row, slope, [&below, &divide], carried);
                let behind = self.ring.divided.slopes.get_or_insert_default();
                behind.add(first, row, slope, [&divide, &above], carried);
            } else {
                own.add(first, row, slope, [&below, &above], carried);
            }
            (begins, below) = (ends, above);
        }
    }

    /// Adds a pixel of a kernel that crosses the plane of the eye.
    fn add_near(&mut self, terms: &NearTerms, i: usize) -> u32 {
        let (raster, footprint) = (self.raster, self.footprint);
        let has_depth = raster.settings.depth;
        let pixel: Vec2 = raster.pixel(i);
        let tau = near_depth(raster.view, footprint, terms, pixel);
        if !(tau > 0.0) {
            return 0;
        }
        if raster.settings.count {
            self.count(i, 1.0);
        }
        let up_to = |at: f32| near_cut(raster, footprint, terms, pixel, at);
        let [near, middle, far] = match self.spans {
            None => [f32::NEG_INFINITY, f32::INFINITY, f32::INFINITY],
            Some(spans) => [spans.near[i], spans.middle[i], spans.far[i]],
        };
        let mut below = up_to(near);
        let [nearest, last] = self.layers;
        for number in nearest..=last {
            let start = layer_start(raster.view, number);
            let end = if number < last {
                layer_start(raster.view, number + 1)
            } else {
                f32::INFINITY
            };
            let above = up_to(end.max(near).min(far)).max(below);
            let divide = if !self.is_slabs || start < middle {
                up_to(middle).clamp(below, above)
            } else {
                above
            };
            let place = self.ring.place(number);
            let (own, behind) = (tau * (divide - below), tau * (above - divide));
            self.ring.layers[place].add(i, [own], footprint, has_depth);
            self.ring.divided.add(i, [behind], footprint, has_depth);
            below = above;
        }
        1
    }
}
