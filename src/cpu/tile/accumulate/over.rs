//! Composites kernels one by one, front to back.
//!
//! The most frequent evaluations, affine and exact with the whole ray, are fused with compositing: a row
//! goes from Q to the pixels' colours in registers. All other evaluations pass rows.
//!
//! Twin: `shaders/tile/accumulate/over.wgsl`.

use super::into_over::{IntoOver, Light, depth_of};
use super::{AddRows, Into};
use crate::constants::{FAINT, MAX_CUTOFF, TILE_SIZE};
use crate::cpu::tile::evaluate::Evaluate;
use crate::cpu::tile::evaluate::affine::{RowForm, is_aligned};
use crate::cpu::tile::evaluate::exact::{ExactAt, RowOfExact};
use crate::cpu::tile::interval::cut::{Cut, CutTile, Side};
use crate::cpu::tile::pixels::{Plane, Tile, TilePlace};
use crate::math::lane::{exp_minus_half, madd, opacity};
use crate::record::{
    ExactTerms, Footprint, NearTerms, PATH_AFFINE, PATH_CAPPED, PATH_EXACT, PATH_PEAK,
};
use crate::simd::{SimdLevel, SimdWork, run_at};
use crate::splat::Axes;

/// A tile in which kernels are composited.
pub(in crate::cpu::tile) struct OverTile<'a, 'b> {
    pub(in crate::cpu::tile) place: TilePlace<'a>,
    pub(in crate::cpu::tile) axes: Axes,
    pub(in crate::cpu::tile) level: SimdLevel,
    /// |D| of each pixel's ray, if any footprint is on the exact path.
    pub(in crate::cpu::tile) rays: &'a Plane,
    pub(in crate::cpu::tile) cut: Option<CutTile<'b>>,
}

impl OverTile<'_, '_> {
    /// Adds a footprint to the tile, and the part behind the surface to the tile behind. Returns the
    /// number of pixels that evaluated it.
    #[inline]
    pub(in crate::cpu::tile) fn add(
        &mut self,
        front: &mut Tile,
        footprint: &Footprint,
        terms: Option<&ExactTerms>,
        near: &[NearTerms],
    ) -> u32 {
        let Some(cut) = &mut self.cut else {
            if let Some(fused) = Fused::of(&self.axes, footprint, terms) {
                return fused.add(self.level, &self.place, self.rays, front);
            }
            let evaluate = Evaluate::new(&self.place, footprint, terms, near);
            let into = IntoOver {
                cut: None,
                front,
                behind: None,
                light: Light::new(&self.axes, footprint),
            };
            let work = AddRows {
                evaluate: &evaluate,
                rays: self.rays,
                into: Into::Over(into),
            };
            return run_at(self.level, work);
        };
        let evaluate = Evaluate::new(&self.place, footprint, terms, near);
        let side = cut.side(&evaluate);
        let (of_kernel, into, behind) = match side {
            Side::Hidden => return 0,
            Side::Front => (None, front, None),
            Side::Behind => (None, &mut *cut.behind, None),
            Side::Cut(meets) => (
                Some(Cut {
                    spans: cut.spans,
                    meets,
                }),
                front,
                cut.is_partial.then_some(&mut *cut.behind),
            ),
        };
        if let (None, Some(fused)) = (of_kernel, Fused::of(&self.axes, footprint, terms)) {
            return fused.add(self.level, &self.place, self.rays, into);
        }
        let into = IntoOver {
            cut: of_kernel,
            front: into,
            behind,
            light: Light::new(&self.axes, footprint),
        };
        let work = AddRows {
            evaluate: &evaluate,
            rays: self.rays,
            into: Into::Over(into),
        };
        run_at(self.level, work)
    }

    /// Composites the surface and the part behind it.
    pub(in crate::cpu::tile) fn finish(self, front: &mut Tile) {
        if let Some(cut) = self.cut {
            cut.compose(self.axes.count, front);
        }
    }
}

/// A footprint that a single loop draws from Q to colours.
#[derive(Debug, Clone, Copy)]
struct Fused<'a> {
    footprint: &'a Footprint,
    /// Terms on the exact path.
    terms: Option<&'a ExactTerms>,
    /// Opacity min(tau, ceiling) instead of 1 - exp(-tau).
    ceiling: Option<f32>,
    has_depth: bool,
}

impl<'a> Fused<'a> {
    /// Returns `None` if the footprint must be drawn by rows.
    #[inline(always)]
    fn of(axes: &Axes, footprint: &'a Footprint, terms: Option<&'a ExactTerms>) -> Option<Self> {
        if axes.count || (axes.edges && terms.is_some_and(|terms| terms.edges != 0)) {
            return None;
        }
        let ceiling = footprint.ceiling().or(axes.linear_opacity.then_some(1.0));
        let terms = match (footprint.path, terms) {
            (PATH_AFFINE | PATH_PEAK | PATH_CAPPED, _) => None,
            (PATH_EXACT, Some(terms)) if ceiling.is_none() => Some(terms),
            _ => return None,
        };
        Some(Self {
            footprint,
            terms,
            ceiling,
            has_depth: axes.depth,
        })
    }

    /// Draws the footprint. Returns the number of pixels within the cut-off.
    #[inline(always)]
    fn add(self, level: SimdLevel, place: &TilePlace<'_>, rays: &Plane, tile: &mut Tile) -> u32 {
        let work = FusedWork {
            fused: self,
            place,
            rays,
            tile,
        };
        if self.has_depth {
            return add_with_depths(level, work);
        }
        run_at(level, work)
    }
}

/// Draws a footprint with depths. They follow from the opacities before and after, without loops of their
/// own.
#[inline(never)]
fn add_with_depths(level: SimdLevel, work: FusedWork<'_>) -> u32 {
    let FusedWork {
        fused, place, tile, ..
    } = work;
    let [first, end] = place.patch(fused.footprint).rows;
    let before = tile.alpha;
    let work = FusedWork {
        tile: &mut *tile,
        ..work
    };
    let count = run_at(level, work);
    let depth = depth_of(fused.footprint);
    let pixels = first * TILE_SIZE..end * TILE_SIZE;
    let alphas = before[pixels.clone()]
        .iter()
        .zip(&tile.alpha[pixels.clone()]);
    for (out, (before, after)) in tile.depth[pixels].iter_mut().zip(alphas) {
        let passes = (*before < 0.5) & (*after >= 0.5);
        *out = if passes { depth } else { *out };
    }
    count
}

struct FusedWork<'a> {
    fused: Fused<'a>,
    place: &'a TilePlace<'a>,
    rays: &'a Plane,
    tile: &'a mut Tile,
}

/// Opacity 1 - exp(-tau).
const EXPONENTIAL: u8 = 0;
/// The same for tau up to [`FAINT`], by a series, without a second exponential.
const SERIES: u8 = 1;
/// Opacity min(tau, ceiling).
const LINEAR: u8 = 2;

/// Greatest number of columns in the patches of small kernels.
const NARROW: usize = TILE_SIZE / 2;

/// Column and row of each lane in a few rows of such a patch. 32 bits each, because loop indices would
/// have 64.
const COLUMN_OF: [i32; TILE_SIZE] = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7];
const ROW_OF: [i32; TILE_SIZE] = [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1];

/// Returns [`NARROW`] columns of each of a few rows of a plane, one after the other.
#[inline(always)]
fn window<const LANES: usize>(plane: &Plane, at: usize) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for (n, row) in out.chunks_exact_mut(NARROW).enumerate() {
        row.copy_from_slice(&plane[at + n * TILE_SIZE..][..NARROW]);
    }
    out
}

/// Writes such columns back to the plane.
#[inline(always)]
fn put_window<const LANES: usize>(plane: &mut Plane, at: usize, window: [f32; LANES]) {
    for (n, row) in window.chunks_exact(NARROW).enumerate() {
        plane[at + n * TILE_SIZE..][..NARROW].copy_from_slice(row);
    }
}

/// Returns the opacity of an optical depth.
#[inline(always)]
fn opacity_of<const FMA: bool, const OPACITY: u8>(tau: f32, ceiling: f32) -> f32 {
    match OPACITY {
        LINEAR => tau.min(ceiling),
        SERIES => madd::<FMA>(tau * tau, madd::<FMA>(tau, 1.0 / 6.0, -0.5), tau),
        _ => opacity::<FMA>(tau),
    }
}

impl SimdWork for FusedWork<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) -> u32 {
        self.choose::<FMA, LANES>()
    }
}

impl FusedWork<'_> {
    #[inline(always)]
    fn choose<const FMA: bool, const LANES: usize>(self) -> u32 {
        let Fused {
            footprint,
            terms,
            ceiling,
            ..
        } = self.fused;
        if let Some(terms) = terms {
            return self.rows::<FMA, LANES, true, EXPONENTIAL, false>(terms);
        }
        let none = &ExactTerms::default();
        let patch = self.place.patch(footprint);
        let [first, end] = patch.columns;
        if ceiling.is_some() {
            self.rows::<FMA, LANES, false, LINEAR, false>(none)
        } else if end - first <= NARROW {
            match (footprint.tau <= FAINT, is_aligned(footprint)) {
                (true, true) => self.narrow::<FMA, LANES, SERIES, true>(),
                (true, false) => self.narrow::<FMA, LANES, SERIES, false>(),
                (false, true) => self.narrow::<FMA, LANES, EXPONENTIAL, true>(),
                (false, false) => self.narrow::<FMA, LANES, EXPONENTIAL, false>(),
            }
        } else {
            match (footprint.tau <= FAINT, is_aligned(footprint)) {
                (true, true) => self.rows::<FMA, LANES, false, SERIES, true>(none),
                (true, false) => self.rows::<FMA, LANES, false, SERIES, false>(none),
                (false, true) => self.rows::<FMA, LANES, false, EXPONENTIAL, true>(none),
                (false, false) => self.rows::<FMA, LANES, false, EXPONENTIAL, false>(none),
            }
        }
    }

    /// Loops over a patch of at most [`NARROW`] columns, with as many rows at once as fit into a vector.
    /// The results are those of [`rows`](Self::rows).
    #[inline(always)]
    fn narrow<const FMA: bool, const LANES: usize, const OPACITY: u8, const ALIGNED: bool>(
        self,
    ) -> u32 {
        let Self {
            fused, place, tile, ..
        } = self;
        let rows_at_once = LANES / NARROW;
        // A copy, which stores to the tile cannot alias.
        let footprint = &{ *fused.footprint };
        let patch = place.patch(footprint);
        let [red, green, blue] = footprint.carried.colour();
        let (tau_peak, cutoff) = (footprint.tau, footprint.cutoff_squared);
        let ceiling = fused.ceiling.unwrap_or(1.0);
        let first_column = patch.columns[0].min(TILE_SIZE - NARROW);
        let dx_first = place.px(0, 0) - footprint.centre_px[0];
        let dy_first = place.px(1, 0) - footprint.centre_px[1];
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        // Beyond the largest cut-off no pixel counts: there Q is no less than its parts.
        let factor = |d: f32| exp_minus_half::<FMA>((d * d).min(MAX_CUTOFF * MAX_CUTOFF));
        let width = place.width() as i32;
        let (mut dx, mut limit, mut of_column) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let column = first_column as i32 + COLUMN_OF[lane];
            dx[lane] = dx_first + column as f32;
            // Vectors extend beyond the image's right border, where no pixel may be within the cut-off.
            limit[lane] = if column < width { cutoff } else { -1.0 };
            of_column[lane] = if ALIGNED {
                factor((px + rx) * dx[lane])
            } else {
                0.0
            };
        }
        let mut of_rows = [0.0; TILE_SIZE];
        if ALIGNED {
            for (y, row) in of_rows.iter_mut().enumerate() {
                *row = tau_peak * factor((py + ry) * (dy_first + y as f32));
            }
        }
        let mut inside = [0_u32; LANES];
        let [first, end] = patch.rows;
        for y in (first..end).step_by(rows_at_once) {
            // The last rows of a tile may be loaded together with a row that was drawn before.
            let top = y.min(TILE_SIZE - rows_at_once);
            let at = top * TILE_SIZE + first_column;
            let mut of_row = [0.0; LANES];
            for (row, factor) in of_row.chunks_exact_mut(NARROW).zip(&of_rows[top..]) {
                row.fill(*factor);
            }
            let mut alphas = window::<LANES>(&tile.alpha, at);
            let mut reds = window::<LANES>(&tile.red, at);
            let mut greens = window::<LANES>(&tile.green, at);
            let mut blues = window::<LANES>(&tile.blue, at);
            for lane in 0..LANES {
                let row = top as i32 + ROW_OF[lane];
                let dy = dy_first + row as f32;
                let p = madd::<FMA>(px, dx[lane], py * dy);
                let r = madd::<FMA>(rx, dx[lane], ry * dy);
                let q = madd::<FMA>(p, p, r * r);
                // NaN compares false: outside.
                let is_inside = (q <= limit[lane]) & (row >= y as i32) & (row < end as i32);
                let tau = if ALIGNED {
                    of_row[lane] * of_column[lane]
                } else {
                    tau_peak * exp_minus_half::<FMA>(q)
                };
                let tau = if is_inside { tau } else { 0.0 };
                let weight = opacity_of::<FMA, OPACITY>(tau, ceiling) * (1.0 - alphas[lane]);
                alphas[lane] += weight;
                reds[lane] = madd::<FMA>(weight, red, reds[lane]);
                greens[lane] = madd::<FMA>(weight, green, greens[lane]);
                blues[lane] = madd::<FMA>(weight, blue, blues[lane]);
                inside[lane] += u32::from(is_inside);
            }
            put_window(&mut tile.alpha, at, alphas);
            put_window(&mut tile.red, at, reds);
            put_window(&mut tile.green, at, greens);
            put_window(&mut tile.blue, at, blues);
        }
        inside.iter().sum()
    }

    /// Loops over rows of the patch and chunks of `LANES` pixels of each row.
    ///
    /// `ALIGNED`: exp(-Q/2) is a factor of the column times one of the row, which saves an exponential
    /// for each pixel. Q itself is the same, and so are the pixels within the cut-off.
    #[inline(always)]
    fn rows<
        const FMA: bool,
        const LANES: usize,
        const EXACT: bool,
        const OPACITY: u8,
        const ALIGNED: bool,
    >(
        self,
        terms: &ExactTerms,
    ) -> u32 {
        let Self {
            fused,
            place,
            rays,
            tile,
        } = self;
        // Copies, which stores to the tile cannot alias: references would be loaded again for each row.
        let (footprint, terms) = (&{ *fused.footprint }, &{ *terms });
        let patch = place.patch(footprint);
        let [red, green, blue] = footprint.carried.colour();
        let (tau_peak, cutoff) = (footprint.tau, footprint.cutoff_squared);
        let ceiling = fused.ceiling.unwrap_or(1.0);
        let dx_first = place.px(0, 0) - footprint.centre_px[0];
        let dy_first = place.px(1, 0) - footprint.centre_px[1];
        // A row of one vector needs no loop.
        let chunks = if LANES == TILE_SIZE {
            0..1
        } else {
            patch.columns[0] / LANES..(patch.columns[1] - 1) / LANES + 1
        };
        let (alphas, _) = tile.alpha.as_chunks_mut::<LANES>();
        let (reds, _) = tile.red.as_chunks_mut::<LANES>();
        let (greens, _) = tile.green.as_chunks_mut::<LANES>();
        let (blues, _) = tile.blue.as_chunks_mut::<LANES>();
        let (rays, _) = rays.as_chunks::<LANES>();
        // Vectors extend beyond the image's right border, where no pixel may be within the cut-off.
        let mut limits = [cutoff; TILE_SIZE];
        for limit in limits.iter_mut().skip(place.width()) {
            *limit = -1.0;
        }
        let (mut of_columns, mut of_rows) = ([0.0; TILE_SIZE], [0.0; TILE_SIZE]);
        if ALIGNED {
            let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
            // Beyond the largest cut-off no pixel counts: there Q is no less than its parts.
            let factor = |d: f32| exp_minus_half::<FMA>((d * d).min(MAX_CUTOFF * MAX_CUTOFF));
            for (i, (column, row)) in of_columns.iter_mut().zip(&mut of_rows).enumerate() {
                *column = factor((px + rx) * (dx_first + i as f32));
                *row = tau_peak * factor((py + ry) * (dy_first + i as f32));
            }
        }
        let mut inside = [0_u32; LANES];
        #[allow(
            clippy::needless_range_loop,
            reason = "over an iterator of `of_rows` the inner loop becomes scalar code, four times slower"
        )]
        for y in patch.rows[0]..patch.rows[1] {
            let dy = dy_first + y as f32;
            let form = RowForm::new(footprint, dy);
            let exact = RowOfExact::new::<FMA>(footprint, terms, dy);
            for chunk in chunks.clone() {
                let at = y * (TILE_SIZE / LANES) + chunk;
                let (Some(a_row), Some(r_out), Some(g_out), Some(b_out), Some(ray)) = (
                    alphas.get_mut(at),
                    reds.get_mut(at),
                    greens.get_mut(at),
                    blues.get_mut(at),
                    rays.get(at),
                ) else {
                    continue;
                };
                let Some(of_column) = of_columns[chunk * LANES..].first_chunk::<LANES>() else {
                    continue;
                };
                let Some(limit) = limits[chunk * LANES..].first_chunk::<LANES>() else {
                    continue;
                };
                let ray = *ray;
                let dx_chunk = dx_first + (chunk * LANES) as f32;
                for lane in 0..LANES {
                    let dx = dx_chunk + lane as f32;
                    let (q, mut tau, mut is_inside);
                    if EXACT {
                        let ExactAt {
                            q: of_ray,
                            inverse,
                            is_ahead,
                        } = exact.at::<FMA>(dx);
                        q = of_ray;
                        tau = tau_peak * (ray[lane] * inverse.sqrt());
                        is_inside = is_ahead;
                    } else {
                        q = form.q::<FMA>(dx);
                        tau = tau_peak;
                        is_inside = true;
                    }
                    // NaN compares false, here and above: outside.
                    is_inside &= q <= limit[lane];
                    tau = if ALIGNED {
                        of_rows[y] * of_column[lane]
                    } else {
                        tau * exp_minus_half::<FMA>(q)
                    };
                    let tau = if is_inside { tau } else { 0.0 };
                    let opacity = opacity_of::<FMA, OPACITY>(tau, ceiling);
                    let before = a_row[lane];
                    let weight = opacity * (1.0 - before);
                    a_row[lane] = before + weight;
                    r_out[lane] = madd::<FMA>(weight, red, r_out[lane]);
                    g_out[lane] = madd::<FMA>(weight, green, g_out[lane]);
                    b_out[lane] = madd::<FMA>(weight, blue, b_out[lane]);
                    inside[lane] += u32::from(is_inside);
                }
            }
        }
        inside.iter().sum()
    }
}
