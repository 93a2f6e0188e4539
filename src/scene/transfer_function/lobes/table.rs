//! Tabulates the lobes of a function: moments of its extinction under Gaussians of many widths.
//!
//! A row has one width w. The extinction, linear between the entries of the function's table, is smoothed by a
//! hat of width h, an eighth of w or of a narrow lobe, and sampled h apart. The samples are summed under a
//! Gaussian of variance w² - h²/6, the rest of the smoothing, and under its derivatives. The sums are kappa_w,
//! kappa_w' and kappa_w'': mu = w (ln kappa_w)', s² = 1 + w² (ln kappa_w)''.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "whole numbers of samples and cells, held to what there is; tables are f32"
)]

use rayon::prelude::*;

use super::windows::{Jump, jumps, shapes, weights};
use super::{
    ALONE_DEPTH, LEAST_WINDOW_SHARE, LOBE_CELLS_PER_DEVIATION, LOBE_REACH, LOBE_ROWS_PER_OCTAVE,
    Lobe, Lobes, MAX_LOBE_CELLS, MAX_PIECE_WIDTH, MAX_WINDOW_CELLS, MAX_WINDOWS, Run, Window,
};
use crate::constants::CLASSIFICATION_TABLE_LEN;
use crate::math::FRAC_1_SQRT_TAU;
use crate::scene::transfer_function::lobes::windows::Shape;
use crate::scene::transfer_function::{TransferFunction, entry_value};

/// A row of a lobe's table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Row {
    /// Index of the first cell among those of all rows, and number of cells: two at least.
    pub(crate) first: u32,
    pub(crate) count: u32,
    /// Cells per unit of value.
    pub(crate) per_value: f32,
}

/// Samples per standard deviation of the narrower of kernel and lobe.
const SAMPLES: f64 = 12.0;

/// Samples for lobes with windows, some of which are a sixth of a kernel wide.
const WINDOW_SAMPLES: f64 = 24.0;

/// Least optical depth of a jump across a kernel's standard deviation, for it to get windows: without them one
/// of .042 has an error of .8 grey levels, one of .084 an error of 1.9.
const JUMP_DEPTH: f64 = 0.05;

/// Range of the sum under a Gaussian, standard deviations: beyond it, 1e-15 of the peak.
const FAR: f64 = 8.5;

/// The first row's w is at least `LEAST_SHARE` of a lobe's width; the last row's is `GREATEST_MULTIPLE` times
/// that width, beyond which the lobe is a point.
const LEAST_SHARE: f64 = 1.0 / 1024.0;
const GREATEST_MULTIPLE: f64 = 16.0;

/// The extinction of a lobe as a function of position in the table, with its integrals.
struct Extinction {
    first: f64,
    last: f64,
    is_open: [bool; 2],
    /// At the entries from the first to the last.
    values: Vec<f64>,
    /// The first integral from the first entry to each, and the second.
    once: Vec<f64>,
    twice: Vec<f64>,
}

impl Extinction {
    fn new(table: &[[f32; 4]], run: Run) -> Self {
        let values: Vec<f64> = table[run.first..=run.last]
            .iter()
            .map(|entry| f64::from(entry[3]))
            .collect();
        let mut once = vec![0.0];
        let mut twice = vec![0.0];
        for (i, pair) in values.windows(2).enumerate() {
            once.push(once[i] + 0.5 * (pair[0] + pair[1]));
            twice.push(twice[i] + once[i] + pair[0] / 3.0 + pair[1] / 6.0);
        }
        Self {
            first: run.first as f64,
            last: run.last as f64,
            is_open: [
                run.first == 0 && values[0] > 0.0,
                run.last == CLASSIFICATION_TABLE_LEN - 1 && values[values.len() - 1] > 0.0,
            ],
            values,
            once,
            twice,
        }
    }

    fn length(&self) -> f64 {
        self.last - self.first
    }

    fn is_closed(&self) -> bool {
        !(self.is_open[0] || self.is_open[1])
    }

    /// The second integral from the first entry to a position.
    fn second_integral(&self, place: f64) -> f64 {
        let x = place - self.first;
        let end = self.values.len() - 1;
        if x <= 0.0 {
            return if self.is_open[0] {
                0.5 * self.values[0] * x * x
            } else {
                0.0
            };
        }
        let i = (x as usize).min(end);
        let s = x - i as f64;
        let from_entry = self.twice[i] + self.once[i] * s;
        let value = self.values[i];
        if i == end {
            let beyond = if self.is_open[1] { value } else { 0.0 };
            return from_entry + 0.5 * beyond * s * s;
        }
        let slope = self.values[i + 1] - value;
        from_entry + s * s * (0.5 * value + slope * s / 6.0)
    }

    /// The extinction smoothed by a hat that is `2 h` wide, times h, sampled `h` apart. Returns the position of
    /// the first sample, and the samples.
    ///
    /// - `origin`: position of one sample.
    /// - `reach`: distance beyond open ends.
    /// - `near`: greatest distance from the origin to either side.
    fn samples(&self, h: f64, reach: f64, origin: f64, near: [f64; 2]) -> (f64, Vec<f64>) {
        let open = |end: usize| if self.is_open[end] { reach } else { 0.0 };
        let inside = origin - self.first;
        let steps = |length: f64| (length / h).ceil();
        let [before, after] = [inside + open(0), self.length() - inside + open(1)];
        let before = steps(before).min(steps(near[0])).max(0.0) as usize + 1;
        let after = steps(after).min(steps(near[1])).max(0.0) as usize + 1;
        let begin = origin - before as f64 * h;
        let at = |n: usize| self.second_integral(begin + (n as f64 - 1.0) * h);
        let integrals: Vec<f64> = (0..=before + after + 2).map(at).collect();
        let sample = |i: &[f64]| ((i[2] - 2.0 * i[1] + i[0]) / h).max(0.0);
        (begin, integrals.windows(3).map(sample).collect())
    }

    /// Computes a window's row of width `w`. Each cell has kappa_w, the first two moments of kappa N about the
    /// cell over kappa_w, and the window's share of the lobe's mass.
    ///
    /// - `shapes`: all windows of the lobe.
    fn row(&self, shapes: &[Shape], table: &TableOf, w: f64) -> Vec<[f64; 4]> {
        let per_cell = 1.0 / f64::from(LOBE_CELLS_PER_DEVIATION);
        let begin = table.from - table.reach[0] * w;
        let narrow = if self.is_closed() {
            self.length() * 0.5
        } else {
            f64::INFINITY
        };
        // A whole number of samples per cell.
        let per_deviation = if shapes.len() > 1 {
            WINDOW_SAMPLES
        } else {
            SAMPLES
        };
        let h = w * per_cell / (per_deviation * per_cell * (w / narrow).max(1.0)).ceil();
        let [before, after] = table.reach.map(|reach| (reach + FAR) * w);
        let near = [before, after + table.to - table.from];
        let (start, samples) = self.samples(h, before.max(after), table.from, near);
        // Each window's part of the samples, and the span of those above 0.
        let mut parts = vec![samples; shapes.len()];
        let mut spans = vec![[0, parts[0].len()]; shapes.len()];
        if shapes.len() > 1 {
            spans.fill([usize::MAX, 0]);
            for n in 0..parts[0].len() {
                let weights = weights(shapes, start + n as f64 * h, w);
                for ((part, span), weight) in parts.iter_mut().zip(&mut spans).zip(weights) {
                    part[n] *= weight;
                    if part[n] > 0.0 {
                        *span = [span[0].min(n), n + 1];
                    }
                }
            }
        }
        let variance = w * w - h * h / 6.0;
        let per_sample = h / variance.sqrt();
        // N at whole steps: exp(-(n h)²/(2 variance)).
        let far = (FAR / per_sample).ceil() as usize;
        let near: Vec<f64> = (0..=far)
            .map(|n| (-0.5 * (n as f64 * per_sample).powi(2)).exp())
            .collect();
        let unit = 1.0 / (variance * std::f64::consts::TAU).sqrt();
        let ratio = w * w / variance;
        (0..cell_count(table, w))
            .map(|cell| {
                let place = begin + cell as f64 * (w * per_cell);
                // Index of the sample at this position: exact to rounding.
                let centre = ((place - start) / h).round() as i64;
                let sums = |window: usize| {
                    let [first, end] = spans[window];
                    let lowest = ((centre - far as i64).max(0) as usize).max(first);
                    let highest = (centre + far as i64 + 1).clamp(0, end as i64) as usize;
                    let mut sums = [0.0; 3];
                    // None if the cell lies beyond them.
                    let samples = parts[window].get(lowest..highest).unwrap_or_default();
                    for (n, sample) in samples.iter().enumerate() {
                        let away = (lowest + n) as i64 - centre;
                        let t = away as f64 * per_sample;
                        let part = sample * near[away.unsigned_abs() as usize];
                        sums[0] += part;
                        sums[1] += part * t;
                        sums[2] += part * t * t;
                    }
                    sums
                };
                let [mass, first, second] = sums(table.window);
                let mean = first / mass;
                let own = second / mass - mean * mean;
                let [share, kept] = self.shares(shapes, table.window, |i| sums(i)[0]);
                // kappa_w'/kappa_w = mean / sqrt(variance); likewise the second.
                [
                    mass * unit / kept,
                    mean * ratio.sqrt(),
                    1.0 + ratio * (own - 1.0),
                    share,
                ]
            })
            .collect()
    }

    /// A window's share of a lobe's mass, and the share of all windows that are drawn.
    fn shares(&self, shapes: &[Shape], own: usize, mass: impl Fn(usize) -> f64) -> [f64; 2] {
        if shapes.len() == 1 {
            return [1.0; 2];
        }
        let masses: Vec<f64> = (0..shapes.len()).map(mass).collect();
        let all: f64 = masses.iter().sum();
        if !(all > 0.0) {
            return [0.0, 1.0];
        }
        let drawn = masses.iter().filter(|&&m| m > LEAST_WINDOW_SHARE * all);
        [masses[own] / all, drawn.sum::<f64>() / all]
    }

    /// The greatest integral of kappa_w - kappa up to any position, computed numerically. For kernels of a
    /// standard deviation sigma, sigma/w times this integral is the optical depth that has moved across that
    /// position on a ray along the gradient.
    fn moved(&self, w: f64) -> f64 {
        let h = (w / 6.0).min(self.length() / 64.0);
        let far = (6.0 * w / h).ceil() as usize;
        let (start, samples) = self.samples(h, 12.0 * w, self.first, [f64::INFINITY; 2]);
        let weights: Vec<f64> = (0..=far)
            .map(|n| (-0.5 * (n as f64 * h / w).powi(2)).exp())
            .collect();
        let sum: f64 = weights.iter().sum::<f64>() * 2.0 - 1.0;
        let first = ((self.first - 4.0 * w - start) / h).round() as i64;
        let last = ((self.last + 4.0 * w - start) / h).round() as i64;
        let sample = |n: i64| match usize::try_from(n) {
            Ok(n) if n < samples.len() => samples[n],
            _ => 0.0,
        };
        let (mut moved, mut greatest) = (0.0_f64, 0.0_f64);
        for n in first..=last {
            let mut smooth = sample(n);
            for (away, weight) in (1_i64..).zip(&weights[1..]) {
                smooth += weight * (sample(n - away) + sample(n + away));
            }
            moved += smooth / sum - sample(n);
            greatest = greatest.max(moved.abs());
        }
        greatest
    }

    /// The greatest w, in entries, at which kernels of a standard deviation `sigma` move no more than
    /// [`ALONE_DEPTH`] when classified at their values alone.
    fn threshold(&self, sigma: f64) -> f64 {
        let mut variation = 0.0;
        let mut turning = 0.0;
        let mut last = 0.0;
        for pair in self.values.windows(2) {
            let slope = pair[1] - pair[0];
            variation += slope.abs();
            turning += (slope - last).abs();
            last = slope;
        }
        turning += last.abs();
        // A jump of 1 moves w/sqrt(2 pi), a kink of 1 w²/4: bounds that hold for any function.
        let by_steps = variation * sigma * FRAC_1_SQRT_TAU;
        if by_steps <= ALONE_DEPTH {
            return f64::INFINITY;
        }
        let most = self.length() * GREATEST_MULTIPLE;
        let moves = |w: f64| self.moved(w) * sigma / w > ALONE_DEPTH;
        let least = self.length() * LEAST_SHARE;
        let mut threshold = 4.0 * ALONE_DEPTH / (turning * sigma);
        if threshold < least {
            if moves(least) {
                return 0.0;
            }
            threshold = least;
        }
        let step = f64::from(1.0 / LOBE_ROWS_PER_OCTAVE).exp2();
        while threshold < most && !moves(threshold * step) {
            threshold *= step;
        }
        threshold
    }
}

/// The extent of a window's table.
#[derive(Debug, Clone, Copy)]
struct TableOf {
    /// Index among the lobe's windows.
    window: usize,
    /// Between these entries the table follows values, beyond them deviations.
    from: f64,
    to: f64,
    /// Number of deviations before and after.
    reach: [f64; 2],
}

impl TableOf {
    fn new(extinction: &Extinction, shapes: &[Shape], window: usize) -> Self {
        let shape = &shapes[window];
        let reach = f64::from(LOBE_REACH);
        let [from, to] = shape.anchors;
        let is_graded = shape.is_graded;
        // A step at the lobe's end is half an entry inside of it.
        let [first, last] = [extinction.first, extinction.last];
        // The reach over which the window's share may count.
        let of_window = reach * (1.0 + shape.deviation * shape.deviation).sqrt();
        let reach = if is_graded {
            [-shape.offsets[0], shape.offsets[0]].map(|offset| (of_window + offset).max(reach))
        } else {
            [reach; 2]
        };
        Self {
            window,
            from: if is_graded || from > first + 0.5 {
                from
            } else {
                first
            },
            to: if is_graded || to < last - 0.5 {
                to
            } else {
                last
            },
            reach,
        }
    }
}

/// The inputs of a lobe's tables.
struct Source {
    run: Run,
    extinction: Extinction,
    threshold: f64,
    shapes: Vec<Shape>,
}

/// Builds the tables of all lobes.
///
/// - `sigma`: greatest standard deviation of a kernel, world units.
pub(super) fn build(transfer: &TransferFunction, runs: &[Run], sigma: f64) -> Lobes {
    let scale = f64::from(transfer.scale);
    let per_entry = 1.0 / scale;
    let mut sources: Vec<Source> = runs
        .par_iter()
        .map(|&run| {
            let extinction = Extinction::new(&transfer.table, run);
            let threshold = extinction.threshold(sigma);
            Source {
                run,
                extinction,
                threshold,
                shapes: Vec::new(),
            }
        })
        .collect();
    let mut jumps = jumps_of(&sources, sigma);
    let widths = loop {
        for (lobe, source) in sources.iter_mut().enumerate() {
            source.find_shapes(lobe, &jumps);
        }
        let widths = widths_of(&sources);
        if cells_of_all(&sources, &widths, true) <= MAX_WINDOW_CELLS {
            break widths;
        }
        jumps.pop();
    };
    let mut out = Lobes::none_of(transfer);
    for (source, widths) in sources.into_iter().zip(&widths) {
        let Source {
            run,
            extinction,
            threshold,
            shapes,
        } = &source;
        let lobe = Lobe::of(transfer, *run);
        let tables: Vec<TableOf> = source.tables().collect();
        let rows: Vec<Vec<Vec<[f32; 4]>>> = tables
            .par_iter()
            .map(|table| {
                let rows = widths[..source.row_count(table, widths)].par_iter();
                rows.map(|&w| cells_of(extinction, shapes, table, w))
                    .collect()
            })
            .collect();
        out.lobes.push(Lobe {
            threshold: (threshold * per_entry) as f32,
            first_window: out.windows.len() as u32,
            window_count: tables.len() as u32,
            first_spread: (widths.first().map_or(1.0, |w| w * per_entry)) as f32,
            ..lobe
        });
        for (table, rows) in tables.iter().zip(rows) {
            let is_at_end = [table.from <= extinction.first, table.to >= extinction.last];
            let value = |place: f64| {
                // Equal to the bit at an entry.
                if place.fract() == 0.0 {
                    entry_value(transfer.range, place as usize)
                } else {
                    (f64::from(transfer.range[0]) + place * per_entry) as f32
                }
            };
            out.windows.push(Window {
                interval: [table.from, table.to].map(value),
                beyond: [0, 1].map(|end| {
                    if is_at_end[end] {
                        lobe.beyond[end]
                    } else {
                        0.0
                    }
                }),
                reach: table.reach.map(|reach| reach as f32),
                first_row: out.rows.len() as u32,
                row_count: rows.len() as u32,
            });
            for (cells, w) in rows.into_iter().zip(widths) {
                out.rows.push(Row {
                    first: out.cells.len() as u32,
                    count: cells.len() as u32,
                    per_value: (f64::from(LOBE_CELLS_PER_DEVIATION) / (w * per_entry)) as f32,
                });
                out.cells.extend(cells);
            }
        }
        out.shapes.extend(&source.shapes);
    }
    out
}

impl Source {
    /// - `jumps`: jumps of all lobes.
    fn find_shapes(&mut self, lobe: usize, jumps: &[(usize, Jump)]) {
        let own = jumps.iter().filter(|(l, _)| *l == lobe);
        let mut own: Vec<Jump> = own.map(|(_, jump)| *jump).collect();
        own.sort_by(|a, b| a.place.total_cmp(&b.place));
        let Extinction {
            first,
            last,
            is_open,
            ..
        } = self.extinction;
        self.shapes = shapes([first, last], is_open, &own);
    }

    fn tables(&self) -> impl Iterator<Item = TableOf> + '_ {
        let windows = 0..self.shapes.len();
        windows.map(|window| TableOf::new(&self.extinction, &self.shapes, window))
    }

    /// Number of a lobe's rows that a window has: at least two. If the window fades, the last row is empty;
    /// otherwise the last row holds for all greater widths.
    fn row_count(&self, table: &TableOf, widths: &[f64]) -> usize {
        let shape = &self.shapes[table.window];
        if !shape.is_graded {
            return widths.len();
        }
        let last = shape.gone().min(4.0 * self.extinction.length());
        let count = widths.partition_point(|&w| w < last) + 1;
        count.clamp(2, widths.len())
    }
}

/// The jumps for which lobes get windows, the greatest first: the greatest of those that are deep enough, as
/// far as there are windows.
fn jumps_of(sources: &[Source], sigma: f64) -> Vec<(usize, Jump)> {
    let mut all: Vec<(usize, Jump)> = Vec::new();
    for (lobe, source) in sources.iter().enumerate() {
        let extinction = &source.extinction;
        let jumps = jumps(&extinction.values, extinction.first, JUMP_DEPTH / sigma);
        all.extend(jumps.into_iter().map(|jump| (lobe, jump)));
    }
    all.sort_by(|a, b| b.1.size.total_cmp(&a.1.size));
    let mut rest = MAX_WINDOWS - sources.len();
    all.retain(|(_, jump)| {
        let count = jump.window_count();
        let fits = count <= rest;
        rest -= if fits { count } else { 0 };
        fits
    });
    all
}

/// The widths of each lobe's rows: as narrow as fits into the tables.
fn widths_of(sources: &[Source]) -> Vec<Vec<f64>> {
    let mut least_share = LEAST_SHARE;
    loop {
        let widths: Vec<Vec<f64>> = sources
            .iter()
            .map(|s| row_widths(&s.extinction, s.threshold, least_share))
            .collect();
        if cells_of_all(sources, &widths, false) <= MAX_LOBE_CELLS {
            return widths;
        }
        least_share *= 2.0;
    }
}

/// Number of cells in the tables of steps' windows, or of all others.
fn cells_of_all(sources: &[Source], widths: &[Vec<f64>], of_steps: bool) -> usize {
    let mut count = 0;
    for (source, widths) in sources.iter().zip(widths) {
        for table in source.tables() {
            if source.shapes[table.window].is_graded == of_steps {
                let widths = &widths[..source.row_count(&table, widths)];
                count += widths.iter().map(|&w| cell_count(&table, w)).sum::<usize>();
            }
        }
    }
    count
}

/// The widths of a lobe's rows, in entries: at least two.
fn row_widths(extinction: &Extinction, threshold: f64, least_share: f64) -> Vec<f64> {
    let length = extinction.length();
    let first = threshold.min(length).max(length * least_share);
    let rows_per_octave = f64::from(LOBE_ROWS_PER_OCTAVE);
    let octaves = (length * GREATEST_MULTIPLE / first).log2();
    let count = (octaves * rows_per_octave).ceil().max(1.0) as usize + 1;
    let width = |n: usize| first * (n as f64 / rows_per_octave).exp2();
    (0..count).map(width).collect()
}

fn cell_count(table: &TableOf, w: f64) -> usize {
    let per_deviation = f64::from(LOBE_CELLS_PER_DEVIATION);
    let deviations = (table.to - table.from) / w + table.reach[0] + table.reach[1];
    (deviations * per_deviation).ceil() as usize + 2
}

/// The cells of a row.
fn cells_of(extinction: &Extinction, shapes: &[Shape], table: &TableOf, w: f64) -> Vec<[f32; 4]> {
    let per_deviation = f64::from(LOBE_CELLS_PER_DEVIATION);
    let inside = (table.to - table.from) / w;
    let cells = extinction.row(shapes, table, w);
    let peak = extinction.values.iter().copied().fold(0.0, f64::max);
    let narrow = |(i, [mass, mean, variance, share]): (usize, [f64; 4])| {
        let place = i as f64 / per_deviation - table.reach[0];
        let outside = place.min(0.0) + (place - inside).max(0.0);
        // A mass that f64 cannot represent is none; its logarithm must be a number.
        let log_mass = (mass / peak).max(1e-300).ln() + 0.5 * outside * outside;
        [
            log_mass as f32,
            (mean + place - 0.5 * inside) as f32,
            (variance.max(1e-12).sqrt() / f64::from(MAX_PIECE_WIDTH))
                .ln()
                .min(0.0) as f32,
            (share / LEAST_WINDOW_SHARE).ln().clamp(-1.0, 1.0) as f32,
        ]
    };
    cells.into_iter().enumerate().map(narrow).collect()
}
