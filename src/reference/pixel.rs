//! Applies the pixel's low-pass filter, a Gaussian over the image, by supersampling.
//!
//! The filtered image at a pixel is the integral of Gaussian times image over the plane. On a lattice of
//! samples, the error of such an integral is the image's content at the lattice's frequencies. It falls faster
//! than any power of the spacing once the smallest detail is resolved. The lattice is therefore doubled
//! (squares, then squares with their centres, and so on) until the pixel no longer changes. Samples serve all
//! the pixels around them and every finer lattice.

use std::sync::atomic::{AtomicI64, Ordering};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::kernel::{Kernel, REACH};
use super::ray::RayIntegral;
use super::settings::{PixelFilter, ReferenceFrame, ReferenceSettings};
use crate::error::Result;
use crate::image::Image;
use crate::task::Stage;
use crate::view::{Camera, Projection};

/// Name of the stage in progress reports.
const STAGE: &str = "integrating";

// Distribution of the requested error. The change due to the last lattice estimates the error of the lattices
// before it; with the last lattice included, the error is far smaller.
const CHANGE_SHARE: f64 = 0.7;
const RAY_SHARE: f64 = 0.1;
const UNRESOLVED_SHARE: f64 = 0.1;
const TAIL_SHARE: f64 = 0.1;

/// Side, in pixels, of a region that is sampled at once. It trades memory (64 MiB at 4096 rays per pixel)
/// against the margin around the region, which is sampled in addition.
const REGION: usize = 128;

/// Source of light along a camera's rays.
pub(super) trait Rays: Sync {
    /// Buffers that rays reuse.
    type Scratch: Default;

    fn camera(&self) -> &Camera;

    /// Returns the light along the ray through a place of the image, to about `error`.
    fn integrate(&self, pixel_px: DVec2, error: f64, scratch: &mut Self::Scratch) -> RayIntegral;

    /// Returns the features that the first lattices of samples may miss.
    fn details(&self, settings: &ReferenceSettings) -> Vec<Detail>;
}

/// Renders the image for `settings`, over their background.
pub(super) fn image<R: Rays>(view: &R, settings: &ReferenceSettings) -> Result<ReferenceFrame> {
    let mut frame = match settings.pixel_filter {
        PixelFilter::Image if settings.low_pass_variance_px2 > 0.0 => supersampled(view, settings)?,
        _ => sampled(view, settings)?,
    };
    if let Some(background) = settings.background {
        for pixel in &mut frame.pixels {
            let through = 1.0 - pixel[3];
            for (channel, b) in pixel.iter_mut().zip(background) {
                *channel += through * f64::from(b);
            }
            pixel[3] = 1.0;
        }
    }
    for (narrow, wide) in frame.image.pixels.iter_mut().zip(&frame.pixels) {
        *narrow = wide.map(|c| c as f32);
    }
    Ok(frame)
}

/// Renders with one ray through the centre of each pixel.
fn sampled<R: Rays>(view: &R, settings: &ReferenceSettings) -> Result<ReferenceFrame> {
    let (width, height) = (view.camera().width, view.camera().height);
    let stage = Stage::new(settings.task.as_ref(), STAGE, height);
    let rows: Vec<Vec<_>> = (0..height)
        .into_par_iter()
        .map_init(R::Scratch::default, |scratch, y| {
            let row = (0..width)
                .take_while(|_| stage.goes_on())
                .map(|x| {
                    let centre = DVec2::new(x as f64, y as f64) + 0.5;
                    view.integrate(centre, settings.error, scratch)
                })
                .collect();
            stage.advance(1);
            row
        })
        .collect();
    stage.check()?;
    let mut frame = blank(width, height);
    for (pixel, ray) in frame.pixels.iter_mut().zip(rows.iter().flatten()) {
        *pixel = ray.rgba;
        frame.error = frame.error.max(ray.error);
        frame.unconverged += usize::from(ray.error > settings.error);
    }
    frame.rays = (width * height) as u64;
    Ok(frame)
}

fn blank(width: usize, height: usize) -> ReferenceFrame {
    ReferenceFrame {
        image: Image::new(width, height),
        pixels: vec![[0.0; 4]; width * height],
        error: 0.0,
        unconverged: 0,
        rays: 0,
    }
}

/// Renders the filtered image, region by region.
fn supersampled<R: Rays>(view: &R, settings: &ReferenceSettings) -> Result<ReferenceFrame> {
    let (width, height) = (view.camera().width, view.camera().height);
    let stage = Stage::new(settings.task.as_ref(), STAGE, 1000);
    let mut frame = blank(width, height);
    let columns = width.div_ceil(REGION);
    let regions = columns * height.div_ceil(REGION);
    let details = view.details(settings);
    for r in 0..regions {
        let first = [r % columns * REGION, r / columns * REGION];
        let size = [
            (width - first[0]).min(REGION),
            (height - first[1]).min(REGION),
        ];
        let mut region = Region::new(first, size, settings);
        region.plan(&details);
        let part = |share: f64| {
            stage.reach((r as f64 + share) / regions as f64);
            stage.goes_on()
        };
        frame.rays += region.sample(view, &part);
        stage.check()?;
        region.copy_to(&mut frame);
    }
    stage.reach(1.0);
    Ok(frame)
}

/// A kernel, or another feature, smaller than the spacing of the first lattices.
pub(super) struct Detail {
    centre_px: DVec2,
    /// Half the size of the box of pixels that it affects.
    half_px: DVec2,
    /// Number of the lattice that resolves it.
    level: u32,
    /// Greatest change of a pixel that it can cause.
    weight: f64,
}

impl Detail {
    /// Returns `None` if even the coarsest lattice resolves the kernel, or if it is not visible.
    pub(super) fn of(
        kernel: &Kernel,
        camera: &Camera,
        settings: &ReferenceSettings,
    ) -> Option<Self> {
        let (centre_px, across) = match camera.projection {
            Projection::Orthographic => {
                let centre = camera.focal_px * kernel.centre.truncate() + camera.centre_px;
                (centre, [DVec3::X, DVec3::Y])
            }
            Projection::Perspective => {
                let u = kernel.centre;
                let reach = REACH * kernel.factor.row(2).length();
                if u.z <= -reach {
                    return None;
                }
                // A kernel at the camera plane counts as being its own reach in front of it; it looks larger
                // than that.
                let z = u.z.max(reach);
                let slope = u.truncate() / z;
                let centre = camera.focal_px * slope + camera.centre_px;
                let x = DVec3::new(1.0, 0.0, -slope.x) / z;
                let y = DVec3::new(0.0, 1.0, -slope.y) / z;
                (centre, [x, y])
            }
        };
        let rows = [0, 1].map(|i| kernel.factor.transpose() * across[i] * camera.focal_px[i]);
        let [a, b, c] = [
            rows[0].length_squared(),
            rows[0].dot(rows[1]),
            rows[1].length_squared(),
        ];
        let determinant = rows[0].cross(rows[1]).length_squared();
        let widest = 0.5 * (a + c + ((a - c).powi(2) + 4.0 * b * b).sqrt());
        let narrowest = determinant / widest.max(f64::MIN_POSITIVE);
        let level = level_for(2.0 * narrowest.sqrt());
        if level == 0 {
            return None;
        }
        // Integral of the opacity over the image, bounded by that of min(tau, 1). If tau's peak is p, that is 2
        // pi sqrt(det) times p or 1 + ln p. A rod or a point has none.
        let (origin, direction) = match camera.projection {
            Projection::Perspective => (DVec3::ZERO, kernel.centre.normalize_or(DVec3::Z)),
            Projection::Orthographic => (kernel.centre.with_z(0.0), DVec3::Z),
        };
        let peak = kernel.along(origin, direction)?.tau;
        let area = std::f64::consts::TAU * determinant.sqrt();
        let opacity = area * if peak <= 1.0 { peak } else { 1.0 + peak.ln() };
        let h2 = settings.low_pass_variance_px2;
        let filtered = std::f64::consts::TAU * ((h2 + widest) * (h2 + narrowest)).sqrt();
        let brightest = kernel.colour.iter().fold(1.0_f64, |m, c| m.max(c.abs()));
        let weight = brightest * (opacity / filtered).min(1.0);
        let half_px = 4.0 * DVec2::new(a, c).map(f64::sqrt) + filter_reach(settings);
        (weight > 0.0).then_some(Self {
            centre_px,
            half_px,
            level,
            weight,
        })
    }

    /// Returns the whole scene as one detail if it lies within a ball, camera space; `None` if the coarsest
    /// lattice does not miss it.
    pub(super) fn of_ball(
        centre: DVec3,
        radius: f64,
        camera: &Camera,
        settings: &ReferenceSettings,
    ) -> Option<Self> {
        let depth = match camera.projection {
            Projection::Orthographic => 1.0,
            // Nearer than its own size, it fills the image.
            Projection::Perspective if centre.z <= 2.0 * radius => return None,
            Projection::Perspective => centre.z,
        };
        let half_px = radius / depth * camera.focal_px;
        let level = level_for(half_px.min_element());
        (level > 0).then(|| Self {
            centre_px: camera.focal_px * centre.truncate() / depth + camera.centre_px,
            half_px: half_px + filter_reach(settings),
            level,
            weight: 1.0,
        })
    }
}

/// Returns the cut-off of the filter, in pixels: the tail beyond is a tenth of the requested error.
fn filter_reach(settings: &ReferenceSettings) -> f64 {
    (2.0 * (20.0 / settings.error).ln()).sqrt() * settings.low_pass_variance_px2.sqrt()
}

/// Returns the first lattice whose samples, with those of all before, are at most `spacing` pixels apart:
/// together they are 2^level per pixel.
fn level_for(spacing: f64) -> u32 {
    // Casts saturate.
    (-2.0 * spacing.log2()).ceil().max(0.0) as u32
}

/// Returns row n of the samples that lattice `level` adds, in pixels from the first pixel's centre: (y, x of a
/// sample, distance between samples).
///
/// Level 0 is the pixels' centres. Odd levels add the centres of the squares, even ones the middles of their
/// sides.
fn lattice_row(level: u32, n: i64) -> (f64, f64, f64) {
    let spacing = 0.5_f64.powi(level.saturating_sub(1) as i32 / 2);
    let n = n as f64;
    if level == 0 {
        (n, 0.0, 1.0)
    } else if level % 2 == 1 {
        ((n + 0.5) * spacing, 0.5 * spacing, spacing)
    } else if n % 2.0 == 0.0 {
        (0.5 * n * spacing, 0.5 * spacing, spacing)
    } else {
        (0.5 * n * spacing, 0.0, spacing)
    }
}

/// Returns the distance between the rows of [`lattice_row`].
fn row_spacing(level: u32) -> f64 {
    0.5_f64.powi(level as i32 / 2)
}

/// A part of the image, and the margin that its filter reaches into.
struct Region {
    first: [usize; 2],
    size: [usize; 2],
    error: f64,
    /// Standard deviation of the filter, px.
    h: f64,
    /// Cut-off of the filter, px.
    reach: f64,
    /// Margin in whole pixels.
    margin: usize,
    last_level: u32,
    pixels: Vec<Pixel>,
}

#[derive(Clone)]
struct Pixel {
    mean: [f64; 4],
    /// Sum of the filter's weights over all samples so far.
    weight: f64,
    /// Change of the mean due to the last lattice.
    change: f64,
    /// Estimated error.
    estimate: f64,
    /// Greatest estimate among the pixel and its neighbours.
    worst: f64,
    ray_error: f64,
    /// Greatest contribution of kernels too small to be resolved.
    unresolved: f64,
    /// First lattice after which `change` is meaningful.
    level: u32,
    done: bool,
}

/// Possible change of a pixel by kernels that a lattice may miss.
#[derive(Clone, Copy, Default)]
struct Unresolved {
    sum: f64,
    squares: f64,
}

impl Unresolved {
    fn add(&mut self, weight: f64) {
        self.sum += weight;
        self.squares += weight * weight;
    }

    fn join(&mut self, other: Self) {
        self.sum += other.sum;
        self.squares += other.squares;
    }

    /// Returns true if they are many of similar weight: their effective number is (sum w)²/sum w².
    fn is_crowd(self) -> bool {
        self.sum * self.sum >= CROWD * self.squares
    }
}

/// Number of kernels of similar weight within the reach of a pixel's filter from which they are sampled like
/// any other texture: some samples meet some of them.
const CROWD: f64 = 32.0;
/// First lattice for which that holds: four samples per pixel, some four hundred in the filter's reach.
const CROWD_LEVEL: usize = 2;

/// A row of samples, filtered along x.
struct Line {
    y: f64,
    columns: Vec<[f64; 4]>,
    /// Sum along the row of the filter's weights for the samples around a pixel.
    weight: f64,
    error: f64,
    rays: u64,
}

impl Region {
    fn new(first: [usize; 2], size: [usize; 2], settings: &ReferenceSettings) -> Self {
        let h = settings.low_pass_variance_px2.sqrt();
        let reach = filter_reach(settings);
        let pixel = Pixel {
            mean: [0.0; 4],
            weight: 0.0,
            change: 0.0,
            estimate: 0.0,
            worst: 0.0,
            ray_error: 0.0,
            unresolved: 0.0,
            // At a spacing of h the lattice's own ripple is 1e-8.
            level: level_for(h).max(1),
            done: false,
        };
        Self {
            first,
            size,
            error: settings.error,
            h,
            reach,
            margin: reach.ceil() as usize,
            last_level: settings.max_rays_per_pixel.max(1).ilog2(),
            pixels: vec![pixel; size[0] * size[1]],
        }
    }

    /// Finds the pixels at which small kernels need fine lattices.
    ///
    /// All samples of a lattice that is too coarse for a kernel may miss it, and no change from lattice to
    /// lattice would reveal that. A pixel therefore trusts only lattices from a certain level on. From there
    /// on, either the unresolved kernels can change the pixel by no more than their share of the error, or they
    /// are so many alike that samples meet some of them.
    fn plan(&mut self, details: &[Detail]) {
        let levels = self.last_level as usize + 1;
        let mut rest = vec![Unresolved::default(); self.pixels.len() * (levels + 1)];
        for detail in details {
            let range = |i: usize| {
                let centre = detail.centre_px[i] - 0.5 - self.first[i] as f64;
                let half = detail.half_px[i];
                // Casts saturate.
                let start = (centre - half).ceil().max(0.0) as usize;
                let end = (centre + half).floor() + 1.0;
                start..(end.max(0.0) as usize).min(self.size[i])
            };
            let level = (detail.level as usize).min(levels);
            for y in range(1) {
                for x in range(0) {
                    rest[(y * self.size[0] + x) * (levels + 1) + level].add(detail.weight);
                }
            }
        }
        let affordable = UNRESOLVED_SHARE * self.error;
        for (pixel, rest) in self.pixels.iter_mut().zip(rest.chunks(levels + 1)) {
            // From the finest lattice down: the kernels that it and the coarser ones leave unresolved.
            let mut left = Unresolved::default();
            let mut needed = self.last_level;
            for level in (0..levels).rev() {
                left.join(rest[level + 1]);
                if left.sum <= affordable || left.is_crowd() && level >= CROWD_LEVEL {
                    needed = level as u32;
                    pixel.unresolved = left.sum.min(affordable);
                } else if level + 1 == levels {
                    pixel.unresolved = left.sum;
                }
            }
            pixel.level = pixel.level.max(needed);
        }
    }

    /// Adds lattices until no pixel changes any more; returns the number of rays.
    ///
    /// - `goes_on`: receives the finished share, 0 to 1; returns false if the work is cancelled.
    fn sample<R: Rays>(&mut self, view: &R, goes_on: &(dyn Fn(f64) -> bool + Sync)) -> u64 {
        let mut rays = 0;
        for level in 0..=self.last_level {
            let needed = self.needed_cells();
            let rows = self.rows(level);
            let (count, done) = (rows.end - rows.start, AtomicI64::new(0));
            let lines: Vec<Line> = rows
                .into_par_iter()
                .map_init(R::Scratch::default, |scratch, n| {
                    let part = done.fetch_add(1, Ordering::Relaxed) as f64 / count as f64;
                    // The number of further lattices is unknown: each gets half of the remaining share.
                    goes_on(1.0 - 0.5_f64.powf(f64::from(level) + part))
                        .then(|| self.line(view, level, n, &needed, scratch))
                })
                .while_some()
                .collect();
            if lines.len() as i64 != count {
                break;
            }
            rays += lines.iter().map(|l| l.rays).sum::<u64>();
            self.add(level, &lines);
            if self.pixels.iter().all(|p| p.done) {
                break;
            }
        }
        rays
    }

    /// Returns the rows of a lattice that reach a pixel of the region.
    fn rows(&self, level: u32) -> std::ops::Range<i64> {
        let spacing = row_spacing(level);
        let (lowest, highest) = (-self.reach, (self.size[1] - 1) as f64 + self.reach);
        ((lowest / spacing).floor() as i64 - 1)..((highest / spacing).ceil() as i64 + 1)
    }

    /// Returns, for each pixel-sized cell of the region and its margin, true if its samples may reach a pixel
    /// that is not done.
    fn needed_cells(&self) -> Vec<bool> {
        let [w, h] = self.size;
        let m = self.margin + 1;
        let (columns, rows) = (w + 2 * m, h + 2 * m);
        // Numbers of pixels not done, summed over all above and to the left.
        let mut sums = vec![0_u32; (w + 1) * (h + 1)];
        for y in 0..h {
            for x in 0..w {
                sums[(y + 1) * (w + 1) + x + 1] = u32::from(!self.pixels[y * w + x].done)
                    + sums[y * (w + 1) + x + 1]
                    + sums[(y + 1) * (w + 1) + x]
                    - sums[y * (w + 1) + x];
            }
        }
        // Cell c is pixel c - m; it reaches the pixels up to m away.
        let around = |c: usize, size: usize| (c.saturating_sub(2 * m), (c + 1).min(size));
        (0..columns * rows)
            .map(|i| {
                let (x0, x1) = around(i % columns, w);
                let (y0, y1) = around(i / columns, h);
                let at = |x: usize, y: usize| sums[y * (w + 1) + x];
                x0 < x1 && y0 < y1 && at(x1, y1) + at(x0, y0) > at(x0, y1) + at(x1, y0)
            })
            .collect()
    }

    /// Integrates the rays of one row where they are needed.
    fn line<R: Rays>(
        &self,
        view: &R,
        level: u32,
        n: i64,
        needed: &[bool],
        scratch: &mut R::Scratch,
    ) -> Line {
        let (y, offset, spacing) = lattice_row(level, n);
        let m = self.margin + 1;
        let columns = self.size[0] + 2 * m;
        // Cell of a place: cell m is around the first pixel's centre.
        let cell = |v: f64| (v + m as f64 + 0.5).floor();
        let mut line = Line {
            y,
            columns: vec![[0.0; 4]; self.size[0]],
            weight: 0.0,
            error: 0.0,
            rays: 0,
        };
        let row = cell(y);
        if row < 0.0 || row as usize >= self.size[1] + 2 * m {
            return line;
        }
        let needed = &needed[row as usize * columns..][..columns];
        // Spacings divide a pixel, so samples lie alike around all pixels.
        let phase = (-self.reach - offset).div_euclid(spacing) as i64;
        let weights: f64 = (phase..)
            .map(|i| offset + i as f64 * spacing)
            .take_while(|x| *x <= self.reach)
            .filter(|x| *x >= -self.reach)
            .map(|x| self.weight(x))
            .sum();
        line.weight = weights;
        let first = ((-self.reach - offset) / spacing).ceil() as i64;
        let last = (((self.size[0] - 1) as f64 + self.reach - offset) / spacing).floor() as i64;
        for i in first..=last {
            let x = offset + i as f64 * spacing;
            if !needed[cell(x) as usize] {
                continue;
            }
            let place = DVec2::new(
                self.first[0] as f64 + 0.5 + x,
                self.first[1] as f64 + 0.5 + y,
            );
            let ray = view.integrate(place, RAY_SHARE * self.error, scratch);
            line.rays += 1;
            line.error = line.error.max(ray.error);
            if ray.rgba == [0.0; 4] {
                continue;
            }
            let start = (x - self.reach).ceil().max(0.0) as usize;
            let end = ((x + self.reach).floor() + 1.0).max(0.0) as usize;
            for c in start..end.min(self.size[0]) {
                let weight = self.weight(c as f64 - x) / weights;
                for (sum, v) in line.columns[c].iter_mut().zip(ray.rgba) {
                    *sum += weight * v;
                }
            }
        }
        line
    }

    /// Returns the filter along one axis, not normalised.
    fn weight(&self, distance: f64) -> f64 {
        (-0.5 * (distance / self.h).powi(2)).exp()
    }

    /// Adds a lattice's lines to the pixels' means.
    fn add(&mut self, level: u32, lines: &[Line]) {
        let [w, h] = self.size;
        for y in 0..h {
            let near: Vec<(f64, &Line)> = lines
                .iter()
                .filter(|l| (l.y - y as f64).abs() <= self.reach)
                .map(|l| (self.weight(l.y - y as f64) * l.weight, l))
                .collect();
            let ray_error = near.iter().map(|(_, l)| l.error).fold(0.0, f64::max);
            for x in 0..w {
                if self.pixels[y * w + x].done {
                    continue;
                }
                let (mut sum, mut weights) = ([0.0; 4], 0.0);
                for (weight, line) in &near {
                    for (s, v) in sum.iter_mut().zip(line.columns[x]) {
                        *s += weight * v;
                    }
                    weights += weight;
                }
                if weights == 0.0 {
                    // The filter is too narrow for the lattice: no sample is near the pixel.
                    continue;
                }
                let pixel = &mut self.pixels[y * w + x];
                pixel.ray_error = pixel.ray_error.max(ray_error);
                pixel.weight += weights;
                if level == 0 {
                    pixel.mean = sum.map(|s| s / weights);
                    continue;
                }
                // One half for lattices finer than the filter: each has as many samples as all before.
                let share = weights / pixel.weight;
                let before = pixel.change;
                pixel.change = 0.0;
                for (mean, s) in pixel.mean.iter_mut().zip(sum) {
                    let change = share * (s / weights - *mean);
                    *mean += change;
                    pixel.change = pixel.change.max(change.abs());
                }
                // The last lattice's change, unless it is by chance far smaller than the changes before
                // suggest: changes halve where the image has sharp edges.
                pixel.estimate = pixel.change.max(0.5 * before);
            }
        }
        // A pixel may stay unchanged by chance; with its neighbours that is unlikely.
        let around = |v: usize, size: usize| v.saturating_sub(1)..(v + 2).min(size);
        let worst: Vec<f64> = (0..w * h)
            .map(|i| {
                around(i / w, h)
                    .flat_map(|y| around(i % w, w).map(move |x| y * w + x))
                    .map(|j| self.pixels[j].estimate)
                    .fold(0.0, f64::max)
            })
            .collect();
        for (pixel, worst) in self.pixels.iter_mut().zip(worst) {
            if !pixel.done {
                pixel.worst = worst;
                pixel.done = level >= pixel.level && worst <= CHANGE_SHARE * self.error;
            }
        }
    }

    fn copy_to(&self, frame: &mut ReferenceFrame) {
        for (i, pixel) in self.pixels.iter().enumerate() {
            let (x, y) = (i % self.size[0], i / self.size[0]);
            let place = (self.first[1] + y) * frame.image.width + self.first[0] + x;
            frame.pixels[place] = pixel.mean;
            // The tail of the filter that is cut off: see `filter_reach`.
            let error = pixel.worst + pixel.ray_error + pixel.unresolved + TAIL_SHARE * self.error;
            frame.error = frame.error.max(error);
            frame.unconverged += usize::from(error > self.error);
        }
    }
}
