//! Finds the lobes of a transfer function, and computes the Gaussian that a kernel becomes in each:
//! classification over a kernel's extent.
//!
//! Over a kernel of variance V the field is taken as linear, f + g . (x - x_i), so that its values have a
//! Gaussian distribution of standard deviation w = sqrt(gᵀ V g). A *lobe* is a maximal interval of values whose
//! extinction is above 0. The piece that a lobe leaves of the kernel has the moments
//!
//! M_j = ∫ N(t; 0, 1) kappa(f + w t) tʲ dt
//!
//! along the gradient. It is replaced by the Gaussian of equal mass M_0, mean mu = M_1/M_0 and variance s² =
//! M_2/M_0 - mu², in standard deviations of the kernel: shifted along u = V g / w and flattened across it. If
//! the field is steep compared with the lobe, that is a piece of the iso-surface: a splat of a surface. If it
//! is flat, the piece is the whole kernel.
//!
//! A lobe with steps (jumps of its extinction) is divided by smooth windows ([`windows`]), each of which leaves
//! a Gaussian of its own. A single Gaussian would be off by half a kernel where the step is seen edge-on.
//!
//! Mass, mean and variance are tabulated over value and ln w ([`table`]). An edit of the function costs
//! milliseconds and a kernel a look-up; [`Lobes::piece`] states the errors. Twin: `shaders/shared/lobes.wgsl`.
//! milliseconds and a kernel a look-up; [`Lobes::piece`] has the errors. Twin: `shaders/shared/lobes.wgsl`.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "places in tables are held to their ends"
)]

mod table;
mod windows;

use super::{CLASSIFICATION_TABLE_LEN, TransferFunction, entry_value};
pub(crate) use table::Row;
pub(crate) use windows::Shape;

/// Greatest number of lobes of a function; if there are more, the nearest are joined.
pub const MAX_LOBES: usize = 16;

/// Greatest number of cells in the tables of all lobes: 128 KiB of device memory.
pub(crate) const MAX_LOBE_CELLS: usize = 1 << 13;

/// Greatest number of windows of all lobes: a bit each.
pub const MAX_WINDOWS: usize = 32;

/// Greatest number of additional cells, for the windows of steps: 512 KiB of device memory.
pub(crate) const MAX_WINDOW_CELLS: usize = 1 << 15;

/// Greatest number of rows in the tables of all windows.
#[cfg(feature = "gpu")]
pub(crate) const MAX_LOBE_ROWS: usize = 64 * MAX_WINDOWS;

/// Least share of a kernel's mass in a lobe that a window has; smaller shares are left to the other windows.
pub const LEAST_WINDOW_SHARE: f64 = 1e-3;

/// Reach of kernels, in standard deviations of a kernel's values. A lobe farther away has too little of the
/// kernel to be visible: 1e-4 of what it would have inside.
pub const LOBE_REACH: f32 = 4.0;

/// Greatest width of a piece. If a function has two peaks far apart, the piece between them may be wider, and
/// is no Gaussian.
pub const MAX_PIECE_WIDTH: f32 = 1.5;

/// Rows of a table per factor of two in w.
pub(crate) const LOBE_ROWS_PER_OCTAVE: f32 = 4.0;

/// Cells of a row per standard deviation.
pub(crate) const LOBE_CELLS_PER_DEVIATION: f32 = 4.0;

/// Optical depth that classifying kernels at their values alone may move across any position in a lobe: a grey
/// level of 255 if nothing lies in front.
pub const ALONE_DEPTH: f64 = 1.0 / 255.0;

/// A maximal interval of values whose extinction is above 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lobe {
    /// Ends of the lobe: values without extinction, or the ends of the function's range if the extinction is
    /// above 0 there.
    pub interval: [f32; 2],
    /// The extinction \[1/length\] beyond the ends: above 0 if the lobe reaches the end of the function's
    /// range, beyond which the function is constant.
    pub beyond: [f32; 2],
    /// The greatest standard deviation w of a kernel's values at which the kernel is classified at its value
    /// alone ([`ALONE_DEPTH`]); infinite for a constant function.
    pub threshold: f32,
    /// Greatest extinction \[1/length\].
    pub(crate) peak: f32,
    /// Index of the lobe's first window among those of all lobes, and their number: one if there are no steps.
    pub(crate) first_window: u32,
    pub(crate) window_count: u32,
    /// The w of the first row.
    pub(crate) first_spread: f32,
}

/// A part of a lobe: the whole, or the part inside a smooth window beside a step or far from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The interval of values over which the table's columns follow values; beyond it they follow deviations.
    /// It is a step's value, twice, or lies between ends of the lobe and steps.
    pub(crate) interval: [f32; 2],
    /// The extinction beyond the interval, as in [`Lobe::beyond`]; 0 if the window ends there.
    pub(crate) beyond: [f32; 2],
    /// Number of deviations that the table reaches beyond its interval.
    pub(crate) reach: [f32; 2],
    /// Index of the window's first row among those of all windows, and their number.
    pub(crate) first_row: u32,
    pub(crate) row_count: u32,
}

/// The piece that a lobe leaves of a kernel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Extinction \[1/length\]: times the kernel's volume, the mass.
    pub extinction: f32,
    /// Shift of the centre along u, standard deviations of the kernel.
    pub shift: f32,
    /// Standard deviation across the gradient's planes, in those of the kernel; may exceed 1.
    pub width: f32,
}

/// The lobes of a transfer function and their tables.
#[derive(Debug, Clone, PartialEq)]
pub struct Lobes {
    pub(crate) lobes: Vec<Lobe>,
    pub(crate) windows: Vec<Window>,
    /// Shape of each window, in entries of the function's table.
    shapes: Vec<Shape>,
    /// The function's first value, and entries per unit of value.
    origin: f64,
    scale: f64,
    pub(crate) rows: Vec<Row>,
    /// Cells of each row, from `reach` deviations before the window's interval to `reach` after it. Four
    /// numbers each: ln(m / the lobe's peak) + d²/2, with d the deviations outside the interval; the mean
    /// value's deviations from the interval's middle; ln(s / [`MAX_PIECE_WIDTH`]); and ln(the window's share of
    /// the lobe's mass / [`LEAST_WINDOW_SHARE`]), clamped to -1 and 1.
    pub(crate) cells: Vec<[f32; 4]>,
}

impl Lobes {
    pub(super) fn new(transfer: &TransferFunction, sigma: f32) -> Self {
        let runs = runs(transfer.table());
        table::build(transfer, &runs, f64::from(sigma))
    }

    /// The lobes without tables, so that no pieces can be looked up.
    pub(super) fn without_tables(transfer: &TransferFunction) -> Self {
        let runs = runs(transfer.table());
        Self {
            lobes: runs.iter().map(|run| Lobe::of(transfer, *run)).collect(),
            ..Self::none_of(transfer)
        }
    }

    fn none_of(transfer: &TransferFunction) -> Self {
        Self {
            lobes: Vec::new(),
            windows: Vec::new(),
            shapes: Vec::new(),
            origin: f64::from(transfer.range[0]),
            scale: f64::from(transfer.scale),
            rows: Vec::new(),
            cells: Vec::new(),
        }
    }

    /// The lobes in the order of their values.
    pub fn lobes(&self) -> &[Lobe] {
        &self.lobes
    }

    /// The windows of a lobe: one, or more if it has steps.
    #[inline]
    pub fn windows(&self, lobe: &Lobe) -> &[Window] {
        let first = lobe.first_window as usize;
        &self.windows[first..first + lobe.window_count as usize]
    }

    /// The share of each of a lobe's windows in a value, for kernels whose values have the standard deviation
    /// `spread`. The shares add up to 1.
    pub fn weights(&self, lobe: &Lobe, value: f64, spread: f64) -> [f64; MAX_WINDOWS] {
        let first = lobe.first_window as usize;
        let shapes = &self.shapes[first..first + lobe.window_count as usize];
        let place = (value - self.origin) * self.scale;
        windows::weights(shapes, place, spread * self.scale)
    }

    /// Whether any of the values `lo..=hi` has an extinction.
    #[inline]
    pub(crate) fn show(&self, lo: f32, hi: f32) -> bool {
        self.lobes.iter().any(|lobe| lobe.meets(lo, hi))
    }

    /// The greatest spread of values w at which every lobe that meets `lo..=hi` classifies kernels at their
    /// values alone; infinite if no lobe does.
    pub fn threshold(&self, lo: f32, hi: f32) -> f32 {
        let met = self.lobes.iter().filter(|lobe| lobe.meets(lo, hi));
        met.fold(f32::INFINITY, |least, lobe| least.min(lobe.threshold))
    }

    /// The piece that a window of a lobe leaves of a kernel whose values have the mean `value` and the standard
    /// deviation `spread`, above the lobe's threshold; `None` if nothing is left.
    ///
    /// Errors against the integrals, over hats, trapezia and steps of any width (a unit test measures them):
    /// the extinction within 1.2 % where it is above a hundredth of its greatest, shift within .01, width
    /// within .007. In lobes with windows the sum of extinctions is within 1 %, that of a window 2.2 %. In
    /// boxes as wide as a kernel, whose windows fade, these are 3 and 8 %, shift is within .02 and width within
    /// .011. Width is at most [`MAX_PIECE_WIDTH`].
    #[inline]
    pub fn piece(&self, lobe: &Lobe, window: &Window, value: f32, spread: f32) -> Option<Piece> {
        let [lo, hi] = window.interval;
        let nearest = value.clamp(lo, hi);
        let outside = (value - nearest) / spread;
        // Phrased so that NaN gives none.
        let [before, after] = window.reach;
        if !(outside >= -before && outside <= after) {
            // Beyond an open end the function is constant over the whole kernel.
            let extinction = window.beyond[usize::from(outside > 0.0)];
            let is_inside = outside.is_finite() && extinction > 0.0;
            return is_inside.then_some(Piece {
                extinction,
                shift: 0.0,
                width: 1.0,
            });
        }
        let last = (window.row_count - 1) as f32;
        let row = (spread / lobe.first_spread).log2() * LOBE_ROWS_PER_OCTAVE;
        let place = row.clamp(0.0, last);
        let below = (place as u32).min(window.row_count.max(2) - 2);
        let share = place - below as f32;
        let middle = lo + 0.5 * (hi - lo);
        let [a, b] = [0, 1].map(|n| {
            let row = self.rows[(window.first_row + below + n) as usize];
            let [log_mass, mean, log_width, log_share] =
                self.cell(row, (nearest - lo) * row.per_value, outside + before);
            let from_middle = (nearest - middle) * (row.per_value / LOBE_CELLS_PER_DEVIATION);
            [log_mass, mean - from_middle, log_width, log_share]
        });
        let [log_mass, mean, log_width, log_share] =
            [0, 1, 2, 3].map(|c| a[c] + (b[c] - a[c]) * share);
        // Other windows have the mass.
        if !(log_share > 0.0) {
            return None;
        }
        // A kernel wider than the last row sees a closed lobe as a point.
        let shrink = if row > last && lobe.beyond == [0.0; 2] {
            ((last - row) / LOBE_ROWS_PER_OCTAVE).exp2()
        } else {
            1.0
        };
        // A kernel narrower than the first row changes less, in proportion.
        let change = (spread / lobe.first_spread).min(1.0);
        let width = MAX_PIECE_WIDTH * log_width.min(0.0).exp() * shrink;
        let log_extinction = (log_mass - 0.5 * outside * outside).min(0.0);
        Some(Piece {
            extinction: lobe.peak * log_extinction.exp() * shrink,
            shift: (mean * shrink - outside) * change,
            width: 1.0 + (width - 1.0) * change,
        })
    }

    /// Interpolates the cells of a row: `inside` cells from the interval's start, plus `from_first` deviations
    /// from the first cell.
    #[inline]
    fn cell(&self, row: Row, inside: f32, from_first: f32) -> [f32; 4] {
        let place = inside + from_first * LOBE_CELLS_PER_DEVIATION;
        let below = (place.max(0.0) as u32).min(row.count - 2);
        let share = place - below as f32;
        let at = (row.first + below) as usize;
        let (a, b) = (self.cells[at], self.cells[at + 1]);
        [0, 1, 2, 3].map(|c| a[c] + (b[c] - a[c]) * share)
    }
}

impl Lobe {
    /// Makes the lobe of a run of entries, without tables.
    fn of(transfer: &TransferFunction, run: Run) -> Self {
        let entries = &transfer.table()[run.first..=run.last];
        // At an end, an entry's extinction is above 0 only if the function ends there.
        let ends = [entries[0][3], entries[entries.len() - 1][3]];
        Self {
            interval: [run.first, run.last].map(|i| entry_value(transfer.range, i)),
            beyond: ends,
            threshold: 0.0,
            peak: entries.iter().fold(0.0, |peak, entry| entry[3].max(peak)),
            first_window: 0,
            window_count: 0,
            first_spread: 1.0,
        }
    }

    /// Whether a value has an extinction in this lobe.
    #[inline]
    pub fn holds(&self, value: f32) -> bool {
        self.meets(value, value)
    }

    /// Whether any of the values `lo..=hi` has an extinction in this lobe.
    #[inline]
    pub fn meets(&self, lo: f32, hi: f32) -> bool {
        let [first, last] = self.interval;
        (lo < last || self.beyond[1] > 0.0) && (hi > first || self.beyond[0] > 0.0)
    }
}

/// A lobe among the entries of a function's table: its first and last entry, which are 0 unless the end is
/// open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    first: usize,
    last: usize,
}

/// The lobes of a table: maximal runs of entries above 0, with the zeros next to them. If there are more than
/// [`MAX_LOBES`], those with the narrowest gaps between them are joined.
fn runs(table: &[[f32; 4]]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (i, entry) in table.iter().enumerate() {
        if !(entry[3] > 0.0) {
            continue;
        }
        let last = (i + 1).min(CLASSIFICATION_TABLE_LEN - 1);
        match runs.last_mut() {
            Some(run) if table[i - 1][3] > 0.0 => run.last = last,
            _ => runs.push(Run {
                first: i.saturating_sub(1),
                last,
            }),
        }
    }
    while runs.len() > MAX_LOBES {
        let gap = |i: &usize| runs[i + 1].first - runs[*i].last;
        let Some(narrowest) = (0..runs.len() - 1).min_by_key(gap) else {
            break;
        };
        let merged = runs.remove(narrowest + 1);
        runs[narrowest].last = merged.last;
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::lobe::window_moments;

    /// A function of extinction `kappa`, over 0 to 1.
    fn transfer(kappa: impl Fn(f32) -> f32) -> TransferFunction {
        let opacity = |v: f32| 1.0 - (-kappa(v)).exp();
        TransferFunction::from_curves(|_| [1.0; 3], opacity, [0.0, 1.0], 1.0).unwrap()
    }

    fn hat(v: f32, middle: f32, half: f32) -> f32 {
        (1.0 - (v - middle).abs() / half).max(0.0)
    }

    /// The knots of a lobe, continued for `reach` beyond open ends.
    fn knots(transfer: &TransferFunction, lobe: &Lobe, reach: f64) -> Vec<[f64; 2]> {
        let [lo, hi] = lobe.interval.map(f64::from);
        let last = (CLASSIFICATION_TABLE_LEN - 1) as f64;
        let mut knots: Vec<[f64; 2]> = transfer
            .table()
            .iter()
            .enumerate()
            .map(|(i, e)| [i as f64 / last, f64::from(e[3])])
            .filter(|k| k[0] >= lo - 1e-6 && k[0] <= hi + 1e-6)
            .collect();
        if lobe.beyond[0] > 0.0 {
            knots.insert(0, [lo - reach, f64::from(lobe.beyond[0])]);
        }
        if lobe.beyond[1] > 0.0 {
            knots.push([hi + reach, f64::from(lobe.beyond[1])]);
        }
        knots
    }

    /// The greatest errors of mass (as a share of the function's peak, where the mass is above a hundredth of
    /// it), shift and width, over all windows of all lobes; and that of the sum of all windows' masses.
    fn errors(transfer: &TransferFunction) -> [f64; 4] {
        let lobes = transfer.lobes(0.1);
        let peak = f64::from(transfer.greatest_extinction());
        let mut worst = [0.0_f64; 4];
        for lobe in lobes.lobes() {
            let [lo, hi] = lobe.interval;
            let windows = lobes.windows(lobe);
            for n in 0..60 {
                // Up to four times the range.
                let spread = lobe.threshold.max(lobe.first_spread) * 1.17_f32.powi(n);
                if spread > 4.0 {
                    break;
                }
                let knots = knots(transfer, lobe, 20.0 * f64::from(spread));
                for m in 0..=160 {
                    let share = m as f32 / 160.0;
                    let value = lo - 4.5 * spread + share * (hi - lo + 9.0 * spread);
                    let truth = window_moments(&lobes, lobe, &knots, value.into(), spread.into());
                    let all: f64 = truth.iter().flatten().map(|t| t[0]).sum();
                    let mut sum = 0.0;
                    for (truth, window) in truth.into_iter().zip(windows) {
                        let found = lobes.piece(lobe, window, value, spread);
                        sum += found.map_or(0.0, |piece| f64::from(piece.extinction));
                        let (Some([mass, mean, variance]), Some(piece)) = (truth, found) else {
                            let least = (2e-4 * peak).max(1.5 * LEAST_WINDOW_SHARE * all);
                            assert!(truth.is_none_or(|t| t[0] < least), "{value} {spread}");
                            continue;
                        };
                        if mass < 0.01 * peak {
                            continue;
                        }
                        let found = [
                            (f64::from(piece.extinction) / mass - 1.0).abs(),
                            (f64::from(piece.shift) - mean).abs(),
                            (f64::from(piece.width) - variance.sqrt()).abs(),
                        ];
                        for (w, e) in worst.iter_mut().zip(found) {
                            *w = w.max(e);
                        }
                    }
                    if all > 0.01 * peak {
                        worst[3] = worst[3].max((sum / all - 1.0).abs());
                    } else if all > 2e-4 * peak {
                        // Faint masses matter less, and are right to a tenth. Beside a narrow box, the windows
                        // of its far step do not reach as far, so their share is missing.
                        let ratio = sum / all;
                        let least = if windows.len() > 1 { 0.85 } else { 0.9 };
                        assert!((least..1.1).contains(&ratio), "{value} {spread} {ratio}");
                    }
                }
            }
        }
        worst
    }

    #[test]
    fn tables_hold_the_moments() {
        for (name, kappa) in [
            (
                "narrow hat",
                Box::new(|v| 20.0 * hat(v, 0.3, 0.03)) as Box<dyn Fn(f32) -> f32>,
            ),
            ("wide hat", Box::new(|v| hat(v, 0.5, 0.3))),
            ("spike", Box::new(|v| 100.0 * hat(v, 0.7, 0.0005))),
            (
                "two hats",
                Box::new(|v| hat(v, 0.3, 0.05) + 3.0 * hat(v, 0.6, 0.1)),
            ),
            ("step", Box::new(|v| f32::from(u8::from(v >= 0.3)))),
            (
                "box",
                Box::new(|v| f32::from(u8::from((0.25..0.45).contains(&v)))),
            ),
            (
                "trapezium",
                Box::new(|v| {
                    ((v - 0.1) / 0.15)
                        .clamp(0.0, 1.0)
                        .min(((0.7 - v) / 0.2).max(0.0))
                }),
            ),
            (
                "opaque hat",
                Box::new(|v| -(1.0 - 0.98 * hat(v, 0.6, 0.03)).ln()),
            ),
            ("ramp", Box::new(|v| (v - 0.15).max(0.0))),
            ("falls", Box::new(|v| (0.4 - v).max(0.0) + 0.1)),
        ] {
            let transfer = transfer(kappa);
            let errors = errors(&transfer);
            println!("{name}: {errors:.4?}");
            // In a box as wide as a kernel, a window's share changes fast from row to row; the sum of all
            // windows stays right.
            let lobes = transfer.lobes(0.1);
            let bounds = if lobes.windows.len() > lobes.lobes.len() {
                [0.085, 0.02, 0.012, 0.032]
            } else {
                [0.012, 0.01, 0.007, 0.012]
            };
            let holds = errors.iter().zip(bounds).all(|(e, most)| *e < most);
            assert!(holds, "{name}: {errors:?}");
        }
    }
}
