//! The tables of a function's lobes: moments of its extinction under Gaussians of many widths.
//!
//! A row has one width w. The extinction, linear between the entries of the function's table, is
//! smoothed by a hat of width h, an eighth of w or of a narrow lobe, and sampled h apart; sums of the
//! samples under a Gaussian of variance w² - h²/6, which has what the hat left, and its derivatives are
//! kappa_w, kappa_w' and kappa_w'': mu = w (ln kappa_w)', s² = 1 + w² (ln kappa_w)''.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "whole numbers of samples and cells, held to what there is; tables are f32"
)]

use rayon::prelude::*;

use super::{
    ALONE_DEPTH, LOBE_CELLS_PER_DEVIATION, LOBE_REACH, LOBE_ROWS_PER_OCTAVE, Lobe, Lobes,
    MAX_LOBE_CELLS, MAX_PIECE_WIDTH, Run,
};
use crate::math::FRAC_1_SQRT_TAU;
use crate::scene::TransferFunction;
use crate::scene::transfer_function::{CLASSIFICATION_TABLE_LEN, entry_value};

/// A row of a lobe's table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Row {
    /// Its first cell among those of all rows, and how many it has: two at least.
    pub(crate) first: u32,
    pub(crate) count: u32,
    /// Cells per unit of value.
    pub(crate) per_value: f32,
}

/// Samples to a standard deviation of the narrower of kernel and lobe.
const SAMPLES: f64 = 12.0;

/// How far a Gaussian is summed, standard deviations: beyond, 1e-15 of its peak.
const FAR: f64 = 8.5;

/// The first row has a w no smaller than this share of a lobe's width, and the last one so many times that
/// width: there a lobe is a point, and more of the same.
const LEAST_SHARE: f64 = 1.0 / 1024.0;
const GREATEST_MULTIPLE: f64 = 16.0;

/// The extinction of a lobe over the places of a table's entries, with its integrals.
struct Extinction {
    first: f64,
    last: f64,
    is_open: [bool; 2],
    /// At the entries from the first to the last.
    values: Vec<f64>,
    /// Its integral from the first entry to each, and that of the integral.
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

    /// The second integral at a place, from the first entry on.
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

    /// Smoothed by a hat that is `2 h` wide, times h, `h` apart: where the samples begin, and they.
    fn samples(&self, h: f64, reach: f64) -> (f64, Vec<f64>) {
        let open = |end: usize| if self.is_open[end] { reach } else { 0.0 };
        // Whole steps from the lobe's beginning, so that cells of a row lie on samples.
        let before = (open(0) / h).ceil() as usize + 1;
        let after = ((self.length() + open(1)) / h).ceil() as usize + 1;
        let begin = self.first - before as f64 * h;
        let at = |n: usize| self.second_integral(begin + (n as f64 - 1.0) * h);
        let integrals: Vec<f64> = (0..=before + after + 2).map(at).collect();
        let sample = |i: &[f64]| ((i[2] - 2.0 * i[1] + i[0]) / h).max(0.0);
        (begin, integrals.windows(3).map(sample).collect())
    }

    /// Of a row of width `w`: kappa_w at places `step` samples apart, the first at `begin`, and the first
    /// two moments of kappa N about each, over kappa_w.
    fn row(&self, w: f64, count: usize) -> Vec<[f64; 3]> {
        let per_cell = 1.0 / f64::from(LOBE_CELLS_PER_DEVIATION);
        let begin = self.first - f64::from(LOBE_REACH) * w;
        let narrow = if self.is_closed() {
            self.length() * 0.5
        } else {
            f64::INFINITY
        };
        // A whole number of samples to a cell.
        let h = w * per_cell / (SAMPLES * per_cell * (w / narrow).max(1.0)).ceil();
        let reach = (f64::from(LOBE_REACH) + FAR) * w;
        let (start, samples) = self.samples(h, reach);
        let variance = w * w - h * h / 6.0;
        let per_sample = h / variance.sqrt();
        // N at whole steps: exp(-(n h)²/(2 variance)).
        let far = (FAR / per_sample).ceil() as usize;
        let weights: Vec<f64> = (0..=far)
            .map(|n| (-0.5 * (n as f64 * per_sample).powi(2)).exp())
            .collect();
        let unit = 1.0 / (variance * std::f64::consts::TAU).sqrt();
        let ratio = w * w / variance;
        (0..count)
            .map(|cell| {
                let place = begin + cell as f64 * (w * per_cell);
                // Which sample lies there: exact to rounding.
                let centre = ((place - start) / h).round() as i64;
                let lowest = (centre - far as i64).max(0) as usize;
                let highest = (centre + far as i64 + 1).clamp(0, samples.len() as i64) as usize;
                let mut sums = [0.0; 3];
                // None where the cell lies beyond them.
                let near = samples.get(lowest..highest).unwrap_or_default();
                for (n, sample) in near.iter().enumerate() {
                    let away = (lowest + n) as i64 - centre;
                    let t = away as f64 * per_sample;
                    let part = sample * weights[away.unsigned_abs() as usize];
                    sums[0] += part;
                    sums[1] += part * t;
                    sums[2] += part * t * t;
                }
                let [mass, first, second] = sums;
                let mean = first / mass;
                let own = second / mass - mean * mean;
                // kappa_w'/kappa_w = mean / sqrt(variance); likewise the second.
                [mass * unit, mean * ratio.sqrt(), 1.0 + ratio * (own - 1.0)]
            })
            .collect()
    }

    /// The greatest integral of kappa_w - kappa up to any place, numerically: with kernels of a standard
    /// deviation sigma, sigma/w times it is the optical depth that has moved across that place of a ray along
    /// the gradient.
    fn moved(&self, w: f64) -> f64 {
        let h = (w / 6.0).min(self.length() / 64.0);
        let far = (6.0 * w / h).ceil() as usize;
        let (start, samples) = self.samples(h, 12.0 * w);
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

    /// The greatest w, in entries, with which kernels of a standard deviation `sigma` move no more than
    /// [`ALONE_DEPTH`] when they are classified at their values alone.
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

/// The tables of all lobes.
///
/// - `sigma`: the greatest standard deviation of a kernel, world units.
pub(super) fn build(transfer: &TransferFunction, runs: &[Run], sigma: f64) -> Lobes {
    let per_entry = 1.0 / f64::from(transfer.scale);
    let extinctions: Vec<(Extinction, f64)> = runs
        .par_iter()
        .map(|&run| {
            let extinction = Extinction::new(&transfer.table, run);
            let threshold = extinction.threshold(sigma);
            (extinction, threshold)
        })
        .collect();
    let mut least_share = LEAST_SHARE;
    let widths = loop {
        let widths: Vec<Vec<f64>> = extinctions
            .iter()
            .map(|(e, threshold)| row_widths(e, *threshold, least_share))
            .collect();
        let counts = extinctions.iter().zip(&widths);
        let cells: usize = counts
            .map(|((e, _), widths)| widths.iter().map(|&w| cell_count(e, w)).sum::<usize>())
            .sum();
        if cells <= MAX_LOBE_CELLS {
            break widths;
        }
        least_share *= 2.0;
    };
    let mut out = Lobes {
        lobes: Vec::with_capacity(runs.len()),
        rows: Vec::new(),
        cells: Vec::new(),
    };
    for (((extinction, threshold), widths), run) in extinctions.iter().zip(&widths).zip(runs) {
        let first_row = out.rows.len() as u32;
        let rows: Vec<Vec<[f32; 3]>> = widths
            .par_iter()
            .map(|&w| cells_of(extinction, w))
            .collect();
        for (cells, w) in rows.into_iter().zip(widths) {
            out.rows.push(Row {
                first: out.cells.len() as u32,
                count: cells.len() as u32,
                per_value: (f64::from(LOBE_CELLS_PER_DEVIATION) / (w * per_entry)) as f32,
            });
            out.cells.extend(cells);
        }
        out.lobes.push(Lobe {
            interval: [run.first, run.last].map(|i| entry_value(transfer.range, i)),
            beyond: [0, run.last].map(|i| {
                let is_open = extinction.is_open[usize::from(i > 0)];
                if is_open { transfer.table[i][3] } else { 0.0 }
            }),
            threshold: (threshold * per_entry) as f32,
            peak: extinction.values.iter().copied().fold(0.0, f64::max) as f32,
            first_row,
            row_count: widths.len() as u32,
            first_spread: (widths.first().map_or(1.0, |w| w * per_entry)) as f32,
        });
    }
    out
}

/// The widths of a lobe's rows, entries: two at least.
fn row_widths(extinction: &Extinction, threshold: f64, least_share: f64) -> Vec<f64> {
    let length = extinction.length();
    let first = threshold.min(length).max(length * least_share);
    let rows_per_octave = f64::from(LOBE_ROWS_PER_OCTAVE);
    let octaves = (length * GREATEST_MULTIPLE / first).log2();
    let count = (octaves * rows_per_octave).ceil().max(1.0) as usize + 1;
    let width = |n: usize| first * (n as f64 / rows_per_octave).exp2();
    (0..count).map(width).collect()
}

fn cell_count(extinction: &Extinction, w: f64) -> usize {
    let per_deviation = f64::from(LOBE_CELLS_PER_DEVIATION);
    let deviations = extinction.length() / w + 2.0 * f64::from(LOBE_REACH);
    (deviations * per_deviation).ceil() as usize + 2
}

/// The cells of a row.
fn cells_of(extinction: &Extinction, w: f64) -> Vec<[f32; 3]> {
    let per_deviation = f64::from(LOBE_CELLS_PER_DEVIATION);
    let reach = f64::from(LOBE_REACH);
    let inside = extinction.length() / w;
    let cells = extinction.row(w, cell_count(extinction, w));
    let peak = extinction.values.iter().copied().fold(0.0, f64::max);
    let narrow = |(i, [mass, mean, variance]): (usize, [f64; 3])| {
        let place = i as f64 / per_deviation - reach;
        let outside = place.min(0.0) + (place - inside).max(0.0);
        // A mass that f64 does not hold is none; logarithms of it must be numbers.
        let log_mass = (mass / peak).max(1e-300).ln() + 0.5 * outside * outside;
        [
            log_mass as f32,
            (mean + place - 0.5 * inside) as f32,
            (variance.max(1e-12).sqrt() / f64::from(MAX_PIECE_WIDTH))
                .ln()
                .min(0.0) as f32,
        ]
    };
    cells.into_iter().enumerate().map(narrow).collect()
}
