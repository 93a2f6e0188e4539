//! Tiles in which opaque surfaces lie among what light passes through.
//!
//! A surface cuts a pixel's ray in two. Kernels are integrated up to it and composited in front of it;
//! where it covers a pixel in part, as along silhouettes, what is left of them behind it is
//! composited on its own and shows through the rest. A kernel that the surface cuts has the share
//! Phi((z_s - z*) / sigma_z) of its optical depth in front, the mass of a Gaussian on a half line.
//!
//! Twin: `shaders/rasterise.wgsl` with `HAS_SURFACE`.

use glam::Vec2;

use super::lanes::{Kernel, Mode, Patch, Tile, exp_minus_half, madd, opacity, run_at, splat};
use super::rasterise::{TileRaster, near_depth, ray};
use crate::constants::{TILE_PIXELS, TILE_SIZE};
use crate::layout::{
    ExactTerms, Footprint, NearTerms, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK,
};
use crate::math::normal_cdf;
use crate::splat::near_share;

/// The surface of a tile, and what lies behind it.
pub(super) struct SurfaceOfTile<'a> {
    surface: &'a Tile,
    /// What is seen behind it, where it covers a pixel in part.
    behind: &'a mut Tile,
    /// Least and greatest depth of it; infinite where a pixel has none.
    nearest: f32,
    farthest: f32,
    /// Whether it covers any pixel in part.
    is_partial: bool,
}

impl<'a> SurfaceOfTile<'a> {
    /// `None` where the tile has no surface. `behind` is cleared.
    pub(super) fn new(
        raster: &TileRaster<'_>,
        surface: &'a Tile,
        behind: &'a mut Tile,
    ) -> Option<Self> {
        let (mut nearest, mut farthest) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut is_partial = false;
        for i in raster.pixels() {
            // Uncovered pixels have an infinite depth.
            nearest = nearest.min(surface.depth[i]);
            farthest = farthest.max(surface.depth[i]);
            is_partial |= surface.alpha[i] > 0.0 && surface.alpha[i] < 1.0;
        }
        if nearest == f32::INFINITY {
            return None;
        }
        raster.clear(behind);
        Some(Self {
            surface,
            behind,
            nearest,
            farthest,
            is_partial,
        })
    }

    /// Adds a footprint to the tile in front of the surface and to what lies behind; returns how
    /// many pixels evaluated it.
    pub(super) fn add(
        &mut self,
        raster: &TileRaster<'_>,
        front: &mut Tile,
        footprint: &Footprint,
        terms: Option<&ExactTerms>,
        near: &[NearTerms],
    ) -> u32 {
        let patch = raster.patch(footprint);
        let mode = raster.mode(footprint);
        let none = ExactTerms::default();
        let terms = terms.unwrap_or(&none);
        let is_exact = footprint.path == PATH_EXACT;
        let exact = is_exact.then_some(terms);
        let near_terms = match footprint.path & 3 {
            PATH_NEAR | PATH_HALF_LINE => near.get((footprint.path >> 2) as usize),
            _ => None,
        };
        if near_terms.is_none() {
            let reach = depth_reach(footprint, terms);
            if footprint.depth + reach <= self.nearest {
                return splat(raster.settings.level, mode, front, footprint, exact, patch);
            }
            if footprint.depth - reach >= self.farthest {
                if !self.is_partial {
                    return 0;
                }
                let level = raster.settings.level;
                return splat(level, mode, self.behind, footprint, exact, patch);
            }
        }
        if let Some(near) = near_terms {
            return self.add_near(raster, front, footprint, near, patch, mode);
        }
        let cut = Cut {
            surface: self.surface,
            behind: self.is_partial.then_some(&mut *self.behind),
            front,
            footprint,
            terms,
            patch,
            mode,
        };
        run_at(raster.settings.level, cut)
    }

    /// Adds a kernel that crosses the plane of the eye, pixel by pixel.
    fn add_near(
        &mut self,
        raster: &TileRaster<'_>,
        front: &mut Tile,
        footprint: &Footprint,
        terms: &NearTerms,
        patch: Patch,
        mode: Mode,
    ) -> u32 {
        let depth = footprint.depth.max(0.0);
        let mut inside = 0;
        for y in patch.rows[0]..patch.rows[1] {
            for x in patch.columns[0]..patch.columns[1] {
                let i = y * TILE_SIZE + x;
                let pixel = Vec2::from(patch.first_px) + Vec2::new(x as f32, y as f32);
                let tau = near_depth(raster.view, footprint, terms, pixel);
                if !(tau > 0.0) {
                    continue;
                }
                inside += 1;
                let share = near_cut(raster, footprint, terms, pixel, self.surface.depth[i]);
                let opacity = |tau: f32| {
                    if mode.linear {
                        tau.min(1.0)
                    } else {
                        -(-tau).exp_m1()
                    }
                };
                let colour = if mode.count {
                    [1.0; 3]
                } else {
                    footprint.colour
                };
                accumulate(front, i, opacity(tau * share), colour, depth, mode);
                if self.is_partial && !mode.count {
                    let rest = opacity(tau * (1.0 - share));
                    accumulate(self.behind, i, rest, colour, depth, mode);
                }
            }
        }
        inside
    }

    /// Puts the surface, and what shows through it, behind what is in front.
    pub(super) fn compose(&self, raster: &TileRaster<'_>, front: &mut Tile) {
        let is_count = raster.settings.count;
        for i in 0..TILE_PIXELS {
            let (surface, behind) = (self.surface, &*self.behind);
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

/// How far a kernel reaches along z on either side of its centre: r sqrt(V_zz), V_zz the variance at
/// the centre of the footprint and what its slope adds.
fn depth_reach(footprint: &Footprint, terms: &ExactTerms) -> f32 {
    let slope = if footprint.path == PATH_EXACT {
        // z* = z (1 + g . d / 2) / w.
        Vec2::from(terms.gradient) * (-0.5 * footprint.depth)
    } else {
        Vec2::from(terms.gradient)
    };
    // slopeᵀ S slope = |A⁻ᵀ slope|², A the rows p and r of the form.
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let determinant = px * ry - py * rx;
    let solved = Vec2::new(ry * slope.x - rx * slope.y, px * slope.y - py * slope.x) / determinant;
    let squared = solved.length_squared() + terms.depth_sigma * terms.depth_sigma;
    let reach = (footprint.cutoff_squared * squared).sqrt();
    // NaN reaches everywhere.
    if reach.is_finite() {
        reach
    } else {
        f32::INFINITY
    }
}

/// A footprint that the surface of a tile may cut: each pixel has its own share in front.
struct Cut<'a> {
    surface: &'a Tile,
    /// Where it is seen through the surface.
    behind: Option<&'a mut Tile>,
    front: &'a mut Tile,
    footprint: &'a Footprint,
    terms: &'a ExactTerms,
    patch: Patch,
    mode: Mode,
}

/// From this many standard deviations on, a kernel lies on one side: what is left is below f32's
/// rounding of the other side.
pub(crate) const ONE_SIDED: f32 = 5.5;

impl Kernel for Cut<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> u32 {
        let Self {
            surface,
            mut behind,
            front,
            footprint,
            terms,
            patch,
            mode,
        } = self;
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
        let is_exact = footprint.path == PATH_EXACT;
        let is_peak = footprint.path == PATH_PEAK;
        let depth = footprint.depth.max(0.0);
        let colour = if mode.count {
            [1.0; 3]
        } else {
            footprint.colour
        };
        let per_sigma = 1.0 / terms.depth_sigma.max(f32::MIN_POSITIVE);
        let dx_first = patch.first_px[0] - footprint.centre_px[0];
        let dy_first = patch.first_px[1] - footprint.centre_px[1];
        let mut limits = [-1.0; TILE_SIZE];
        limits[patch.columns[0]..patch.columns[1]].fill(footprint.cutoff_squared);
        let mut inside_count = 0;
        for y in patch.rows[0]..patch.rows[1] {
            let row = y * TILE_SIZE..(y + 1) * TILE_SIZE;
            let dy = dy_first + y as f32;
            let mut taus = [0.0_f32; TILE_SIZE];
            // How far in front of the surface the kernel's mean lies, in its standard deviations.
            let mut ahead = [0.0_f32; TILE_SIZE];
            let mut inside = [0_u32; TILE_SIZE];
            let (depths, lengths) = (&surface.depth[row.clone()], &front.ray_length[row.clone()]);
            for lane in 0..TILE_SIZE {
                let dx = dx_first + lane as f32;
                let p = madd::<FMA>(px, dx, py * dy);
                let r = madd::<FMA>(rx, dx, ry * dy);
                let mut q = madd::<FMA>(p, p, r * r);
                let slope = madd::<FMA>(gx, dx, gy * dy);
                let (mut tau, mut per_sigma) = (footprint.tau, per_sigma);
                let mut z = footprint.depth + slope;
                let mut is_inside = true;
                if is_exact {
                    let w = 1.0 + slope + dx * (hxx * dx + hxy * dy) + hyy * dy * dy;
                    let root = w.sqrt();
                    q /= w;
                    tau *= lengths[lane] / root;
                    per_sigma *= root;
                    z = footprint.depth * (1.0 + 0.5 * slope) / w;
                    is_inside = w > 0.0;
                }
                // NaN compares false: outside.
                is_inside &= q <= limits[lane];
                taus[lane] = if is_inside {
                    tau * exp_minus_half::<FMA>(q)
                } else {
                    0.0
                };
                ahead[lane] = (depths[lane] - z) * per_sigma;
                inside[lane] = u32::from(is_inside);
            }
            let count = inside.iter().sum::<u32>();
            inside_count += count;
            if count == 0 {
                continue;
            }
            let mut shares = [0.0_f32; TILE_SIZE];
            for (share, ahead) in shares.iter_mut().zip(ahead) {
                *share = f32::from(u8::from(ahead > 0.0));
            }
            // A splat that states its opacity is not divided: it lies where its centre does.
            if !is_peak {
                for lane in 0..TILE_SIZE {
                    if inside[lane] != 0 && ahead[lane].abs() < ONE_SIDED {
                        shares[lane] = normal_cdf(ahead[lane]);
                    }
                }
            }
            let opacity = |tau: f32| {
                if mode.linear {
                    tau.min(1.0)
                } else {
                    opacity::<FMA>(tau)
                }
            };
            for lane in 0..TILE_SIZE {
                if mode.count && inside[lane] == 0 {
                    continue;
                }
                let alpha = opacity(taus[lane] * shares[lane]);
                accumulate(front, row.start + lane, alpha, colour, depth, mode);
            }
            if let (Some(behind), false) = (&mut behind, mode.count) {
                for lane in 0..TILE_SIZE {
                    let alpha = opacity(taus[lane] * (1.0 - shares[lane]));
                    accumulate(behind, row.start + lane, alpha, colour, depth, mode);
                }
            }
        }
        inside_count
    }
}

/// Of a kernel that crosses the camera plane: the share of what lies in front of the eye that lies
/// in front of a depth, too.
fn near_cut(
    raster: &TileRaster<'_>,
    footprint: &Footprint,
    terms: &NearTerms,
    pixel: Vec2,
    at: f32,
) -> f32 {
    if at == f32::INFINITY {
        return 1.0;
    }
    if footprint.path & 3 == PATH_NEAR {
        return near_share(terms, ray(raster.view, pixel), at);
    }
    let d = pixel - Vec2::from(footprint.centre_px);
    let [gx, gy, z] = terms.half_line;
    let z = z + gx * d.x + gy * d.y;
    let sigma = terms.sigma.max(f32::MIN_POSITIVE);
    let behind_eye = normal_cdf(-z / sigma);
    let share = (normal_cdf((at - z) / sigma) - behind_eye) / (1.0 - behind_eye);
    if share.is_nan() {
        return 0.0;
    }
    share.clamp(0.0, 1.0)
}

/// Puts an opacity behind what a pixel has; counts it, where pixels count kernels.
#[inline(always)]
fn accumulate(
    tile: &mut Tile,
    i: usize,
    opacity: f32,
    [red, green, blue]: [f32; 3],
    depth: f32,
    mode: Mode,
) {
    let before = tile.alpha[i];
    let weight = opacity * (1.0 - before);
    let after = before + weight;
    tile.alpha[i] = after;
    let share = if mode.count { 1.0 } else { weight };
    tile.red[i] += share * red;
    tile.green[i] += share * green;
    tile.blue[i] += share * blue;
    if mode.depth && before < 0.5 && after >= 0.5 {
        tile.depth[i] = depth;
    }
}
