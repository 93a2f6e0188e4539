//! Adds up optical depths of kernels in a grid of cells.

use std::ops::Range;

use glam::Vec2;
use rayon::prelude::*;

use super::lookup::{SHADOW_DIRECTIONS, SHADOW_TAPS};
use super::occluder::{Occluder, REACH};
use crate::error::Result;
use crate::task::{Task, check};

/// Rows of cells of a strip.
const STRIP: usize = 8;

/// Entries of the table of the normal distribution, per standard deviation.
const STEPS: f32 = 128.0;

/// Optical depths between a light and the boundaries of cells.
pub(super) struct Grid {
    /// Columns, rows, layers.
    size: [usize; 3],
    /// Column by column, one number for each boundary: before [`Grid::finish`] that of the layer before.
    pub(super) depths: Vec<f32>,
    table: Vec<f32>,
}

impl Grid {
    pub(super) fn new(size: [u32; 3]) -> Self {
        let size = size.map(|n| n as usize);
        let count = (2.0 * REACH * STEPS) as usize + 2;
        let value = |i: usize| crate::math::normal_cdf(i as f32 / STEPS - REACH);
        Self {
            size,
            depths: vec![0.0; size[0] * size[1] * (size[2] + 1)],
            table: (0..count).map(value).collect(),
        }
    }

    /// Adds kernels.
    pub(super) fn add(&mut self, kernels: &[Occluder]) {
        let [columns, rows, layers] = self.size;
        let lists = strips(kernels, rows, STRIP);
        let words = columns * (layers + 1);
        let (size, table) = (self.size, &self.table);
        self.depths
            .par_chunks_mut(STRIP * words)
            .zip(lists)
            .enumerate()
            .for_each(|(n, (strip, list))| {
                let rows = n * STRIP..n * STRIP + strip.len() / words;
                for i in list {
                    add_one(size, table, &kernels[i as usize], &rows, strip);
                }
            });
    }

    /// Turns the depths of layers into depths up to the layers' boundaries; for a light with a size into the
    /// logarithm of the mean transmittance over its directions.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn finish(&mut self, softness: f32, task: Option<&Task>) -> Result<()> {
        let words = self.size[2] + 1;
        if softness > 0.0 {
            self.depths = self.softened(softness, task)?;
            return Ok(());
        }
        self.depths.par_chunks_mut(words).for_each(|column| {
            let mut sum = 0.0;
            for depth in column {
                sum += *depth;
                *depth = sum;
            }
        });
        Ok(())
    }

    /// Returns the negative logarithms of mean transmittances over the light's directions.
    ///
    /// Along the direction of slope s, light reaches the cell x of layer k through the cells x + s (k - j) of the
    /// layers j before. With X = x + s k these are X - s j: sums along rays that all layers share.
    fn softened(&self, softness: f32, task: Option<&Task>) -> Result<Vec<f32>> {
        let [columns, rows, layers] = self.size;
        let words = layers + 1;
        let mut passed = vec![0.0_f32; self.depths.len()];
        let mut sums = Vec::new();
        for tap in SHADOW_TAPS {
            check(task)?;
            let slope = Vec2::from(tap) * softness;
            let reach = slope * layers as f32;
            // Cells of X before the first and behind the last cell of x.
            let before = (-reach).max(Vec2::ZERO).ceil().as_uvec2() + 1;
            let behind = reach.max(Vec2::ZERO).ceil().as_uvec2() + 1;
            let wide = columns + (before.x + behind.x) as usize;
            let high = rows + (before.y + behind.y) as usize;
            sums.clear();
            sums.resize(wide * high * words, 0.0_f32);
            let origin = before.as_vec2();
            let own = Columns {
                size: [columns, rows],
                words,
                of: &self.depths,
            };
            sums.par_chunks_mut(wide * words)
                .enumerate()
                .for_each(|(y, row)| {
                    for (x, column) in row.chunks_mut(words).enumerate() {
                        let place = Vec2::new(x as f32, y as f32) - origin;
                        let mut sum = 0.0;
                        for (j, depth) in column.iter_mut().enumerate().skip(1) {
                            sum += own.sample(place - slope * j as f32, j);
                            *depth = sum;
                        }
                    }
                });
            let along = Columns {
                size: [wide, high],
                words,
                of: &sums,
            };
            passed
                .par_chunks_mut(columns * words)
                .enumerate()
                .for_each(|(y, row)| {
                    for (x, column) in row.chunks_mut(words).enumerate() {
                        let place = Vec2::new(x as f32, y as f32) + origin;
                        for (k, passed) in column.iter_mut().enumerate() {
                            *passed += (-along.sample(place + slope * k as f32, k)).exp();
                        }
                    }
                });
        }
        passed.par_iter_mut().for_each(|passed| {
            let mean = *passed * (1.0 / SHADOW_DIRECTIONS as f32);
            *passed = -mean.max(f32::MIN_POSITIVE).ln();
        });
        Ok(passed)
    }
}

/// Columns of numbers on a grid.
struct Columns<'a> {
    size: [usize; 2],
    words: usize,
    of: &'a [f32],
}

impl Columns<'_> {
    /// Returns number `k` between the columns around a place; 0 outside.
    #[inline]
    fn sample(&self, place: Vec2, k: usize) -> f32 {
        let [columns, rows] = self.size;
        let first = place.floor();
        let f = place - first;
        let (x, y) = (first.x as isize, first.y as isize);
        let get = |x: isize, y: isize| {
            let is_inside = x >= 0 && y >= 0 && (x as usize) < columns && (y as usize) < rows;
            match is_inside {
                true => self.of[(y as usize * columns + x as usize) * self.words + k],
                false => 0.0,
            }
        };
        let (a, b, c, d) = (get(x, y), get(x + 1, y), get(x, y + 1), get(x + 1, y + 1));
        let (near, far) = (a + (b - a) * f.x, c + (d - c) * f.x);
        near + (far - near) * f.y
    }
}

/// Returns, for each strip of rows, the indices of the particles that touch it, in order.
pub(super) fn strips(kernels: &[Occluder], rows: usize, strip: usize) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); rows.div_ceil(strip)];
    for (i, kernel) in (0..).zip(kernels) {
        let touched = middles(kernel.centre.y, kernel.half.y, rows);
        if touched.is_empty() {
            continue;
        }
        for list in &mut lists[touched.start / strip..=(touched.end - 1) / strip] {
            list.push(i);
        }
    }
    lists
}

/// Returns the cells whose middles lie within `half` of `centre`.
pub(super) fn middles(centre: f32, half: f32, count: usize) -> Range<usize> {
    // Casts saturate.
    let first = (centre - half - 0.5).ceil().max(0.0) as usize;
    let end = ((centre + half - 0.5).floor() + 1.0).max(0.0) as usize;
    first.min(count)..end.min(count).max(first.min(count))
}

/// Adds a kernel to the rows of a strip.
fn add_one(
    [columns, _, layers]: [usize; 3],
    table: &[f32],
    kernel: &Occluder,
    rows: &Range<usize>,
    strip: &mut [f32],
) {
    let own = middles(kernel.centre.y, kernel.half.y, rows.end);
    let across = middles(kernel.centre.x, kernel.half.x, columns);
    let [a, b, c] = kernel.form;
    let words = layers + 1;
    for y in own.start.max(rows.start)..own.end {
        let dy = y as f32 + 0.5 - kernel.centre.y;
        for x in across.clone() {
            let dx = x as f32 + 0.5 - kernel.centre.x;
            let q = a * dx * dx + 2.0 * b * dx * dy + c * dy * dy;
            if !(q < REACH * REACH) {
                continue;
            }
            let weight = (-0.5 * q).exp();
            let depth = match kernel.is_opacity {
                true => -(-kernel.peak * weight).ln_1p(),
                false => kernel.peak * weight,
            };
            let mean = kernel.centre.z + kernel.slope.x * dx + kernel.slope.y * dy;
            let column = &mut strip[((y - rows.start) * columns + x) * words + 1..][..layers];
            add_column(table, column, depth, mean, kernel.sigma);
        }
    }
}

/// Divides an optical depth, distributed normally along a column, among the column's layers.
#[inline]
fn add_column(table: &[f32], column: &mut [f32], depth: f32, mean: f32, sigma: f32) {
    let last = (column.len() - 1) as f32;
    let first = (mean - REACH * sigma).floor().clamp(0.0, last) as usize;
    let end = (mean + REACH * sigma).floor().clamp(0.0, last) as usize;
    let per_cell = if sigma > 0.0 { STEPS / sigma } else { 0.0 };
    let mut place = REACH * STEPS + (first as f32 + 1.0 - mean) * per_cell;
    let mut before = 0.0;
    let greatest = (table.len() - 2) as f32;
    for layer in &mut column[first..end] {
        let at = place.clamp(0.0, greatest);
        let i = at as usize;
        let up_to = table[i] + (table[i + 1] - table[i]) * (at - i as f32);
        *layer += depth * (up_to - before);
        before = up_to;
        place += per_cell;
    }
    column[end] += depth * (1.0 - before);
}
