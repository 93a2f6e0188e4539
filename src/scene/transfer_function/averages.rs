//! Computes what merged particles need of a transfer function: averages over intervals of values, and bounds on
//! its slope.

use super::{LAST, TransferFunction, entries, narrowed, table_segment};
use crate::constants::CLASSIFICATION_TABLE_LEN;
use crate::scene::transfer_function::maxima::Maxima;

/// The weights with which the colours of several particles are averaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// Extinctions: for classified masses.
    Extinction,
    /// Equal weights: for given masses.
    Even,
}

/// The averaged quantities of an entry: e r, e g, e b and e with [`Weighting::Extinction`], r, g, b and e with
/// [`Weighting::Even`].
type Products = [f32; 4];

/// A distance in entries, beyond which the share of any value inside the table is negligible.
pub(crate) const FAR_ENTRIES: f32 = 1e30;

/// Integer value of the sum over all entries: just below 2^31.
const UNITS: f64 = 2e9;

/// Averages of a transfer function over intervals of values. The function is taken as it classifies: linear
/// between entries and constant beyond its ends.
///
/// Integrals from the first entry to each other entry are stored as integers, so that their differences are
/// exact. The average over a run of n entries errs by 2e-6 / n of the table's average. In f32 the error would
/// be a hundred times that, and faint values beside opaque ones would be lost. Twin:
/// `shaders/shared/averages.wgsl`.
#[derive(Debug, Clone)]
pub struct Averages {
    low: f32,
    scale: f32,
    table: Vec<[f32; 4]>,
    weighting: Weighting,
    integrals: Vec<[i32; 4]>,
    /// The value of 1 in `integrals`: for the first three components, for the last.
    units: [f32; 2],
}

impl Averages {
    fn new(transfer: &TransferFunction, weighting: Weighting) -> Self {
        let mut sums = [0.0_f64; 4];
        let mut sizes = [0.0_f64; 4];
        let exact: Vec<[f64; 4]> = std::iter::once([0.0; 4])
            .chain(transfer.table.windows(2).map(|pair| {
                let [from, to] = [pair[0], pair[1]].map(|e| e.map(f64::from));
                let difference = [0, 1, 2, 3].map(|c| to[c] - from[c]);
                let middle = [0, 1, 2, 3].map(|c| 0.5 * (from[c] + to[c]));
                for c in 0..4 {
                    let weighs = c < 3 && weighting == Weighting::Extinction;
                    let part = if weighs {
                        middle[c] * middle[3] + difference[c] * difference[3] / 12.0
                    } else {
                        middle[c]
                    };
                    sums[c] += part;
                    sizes[c] += part.abs();
                }
                sums
            }))
            .collect();
        let colours = sizes[0].max(sizes[1]).max(sizes[2]);
        let units = [colours, sizes[3]].map(|size| narrowed(size / UNITS));
        let whole = |sum: f64, unit: f32| {
            // The second case: the sum is zero, or so small that its unit is 0.
            #[expect(clippy::cast_possible_truncation, reason = "rounded, below 2^31")]
            if unit > 0.0 {
                (sum / f64::from(unit)).round() as i32
            } else {
                0
            }
        };
        let integrals = exact
            .into_iter()
            .map(|[r, g, b, e]| {
                let [r, g, b] = [r, g, b].map(|sum| whole(sum, units[0]));
                [r, g, b, whole(e, units[1])]
            })
            .collect();
        Self {
            low: transfer.range[0],
            scale: transfer.scale,
            table: transfer.table.clone(),
            weighting,
            integrals,
            units,
        }
    }

    /// The average colour and extinction \[1/length\] of values spread evenly over
    /// `value - spread ..= value + spread`.
    ///
    /// Colours are averaged with the weighting: \[∫ e c / ∫ e, mean e\] or \[mean c, mean e\]. With
    /// [`Weighting::Extinction`] the colours are 0 if the mean extinction is. Parts of the interval beyond the
    /// table count with the end's entry. NaN is transparent.
    ///
    /// Within one entry's width the average is computed in closed form. As the spread goes to 0, it goes to
    /// [`TransferFunction::classify`] without a discontinuity (for colours: if there is any extinction).
    pub fn classify_spread(&self, value: f32, spread: f32) -> [f32; 4] {
        if value.is_nan() || spread.is_nan() {
            return [0.0; 4];
        }
        // Clamped as in the twin, whose numbers are finite.
        const GREATEST: f32 = f32::MAX / 2.0;
        let difference = value.clamp(-GREATEST, GREATEST) - self.low;
        let x = (difference * self.scale).clamp(-FAR_ENTRIES, FAR_ENTRIES);
        let half = (spread.abs() * self.scale).min(FAR_ENTRIES);
        let (from, to) = (x - half, x + half);
        let (i, s) = table_segment(from);
        let (j, t) = table_segment(to);
        let width = to - from;
        if i == j && (s == t || width <= 0.0) {
            return self.weighted(self.part(i, s, t));
        }
        let mut sum = [0.0; 4];
        let mut add = |part: Products, length: f32| {
            let share = length / width;
            for (sum, part) in sum.iter_mut().zip(part) {
                *sum += part * share;
            }
        };
        if i == j {
            add(self.part(i, s, t), t - s);
        } else {
            add(self.part(i, s, 1.0), 1.0 - s);
            let between = [0, 1, 2, 3].map(|c| {
                let units = self.integrals[j][c].wrapping_sub(self.integrals[i + 1][c]);
                units as f32 * self.units[c / 3]
            });
            add(between, 1.0);
            add(self.part(j, 0.0, t), t);
        }
        if from < 0.0 {
            add(self.part(0, 0.0, 0.0), to.min(0.0) - from);
        }
        if to > LAST {
            let end = self.part(CLASSIFICATION_TABLE_LEN - 2, 1.0, 1.0);
            add(end, to - from.max(LAST));
        }
        self.weighted(sum)
    }

    /// The average from fraction `s` to fraction `t` of the way from entry `i` to the next.
    fn part(&self, i: usize, s: f32, t: f32) -> Products {
        let (a, b) = (&self.table[i], &self.table[i + 1]);
        let (middle, length) = (0.5 * (s + t), t - s);
        let difference = [0, 1, 2, 3].map(|c| b[c] - a[c]);
        let mean = [0, 1, 2, 3].map(|c| a[c] + difference[c] * middle);
        if self.weighting == Weighting::Even {
            return mean;
        }
        // Mean of the product of two linear functions.
        let curvature = difference[3] * (length * length * (1.0 / 12.0));
        [0, 1, 2, 3].map(|c| {
            if c < 3 {
                mean[c] * mean[3] + difference[c] * curvature
            } else {
                mean[3]
            }
        })
    }

    /// Colour and extinction from averaged products.
    fn weighted(&self, [r, g, b, e]: Products) -> [f32; 4] {
        match self.weighting {
            Weighting::Even => [r, g, b, e],
            Weighting::Extinction if e > 0.0 => [r / e, g / e, b / e, e],
            Weighting::Extinction => [0.0; 4],
        }
    }

    /// Integrals from the first entry to each, and the value of 1 in them: for the first three components, for
    /// the last.
    #[cfg(feature = "gpu")]
    pub(crate) fn integrals(&self) -> (&[[i32; 4]], [f32; 2]) {
        (&self.integrals, self.units)
    }
}

/// Bounds on the slope of a transfer function.
#[derive(Debug, Clone)]
pub struct Slopes {
    low: f32,
    scale: f32,
    /// Entry i: the slope from entry i of the table to the next; the last is 0.
    maxima: Maxima,
}

impl Slopes {
    fn new(transfer: &TransferFunction, weighting: Weighting) -> Self {
        // The slope of a product is linear between entries, so the greater one at its two ends bounds it.
        // Rounded up.
        let scale = f64::from(transfer.scale) * (1.0 + 4.0 * f64::from(f32::EPSILON));
        let mut slopes: Vec<f32> = transfer
            .table
            .windows(2)
            .map(|pair| {
                let [from, to] = [pair[0], pair[1]].map(|e| e.map(f64::from));
                let difference = [0, 1, 2, 3].map(|c| to[c] - from[c]);
                let steepest = (0..3).map(|c| match weighting {
                    Weighting::Even => difference[c].abs(),
                    Weighting::Extinction => {
                        let at = |e: &[f64; 4]| difference[3] * e[c] + e[3] * difference[c];
                        at(&from).abs().max(at(&to).abs())
                    }
                });
                let own = match weighting {
                    Weighting::Even => 0.0,
                    Weighting::Extinction => difference[3].abs(),
                };
                narrowed(steepest.fold(own, f64::max) * scale)
            })
            .collect();
        slopes.push(0.0);
        Self {
            low: transfer.range[0],
            scale: transfer.scale,
            maxima: Maxima::new(slopes),
        }
    }

    /// A bound on the slope, per unit of value, of the averaged quantities between the values `lo..=hi`, in
    /// constant time. With [`Weighting::Extinction`] these are the extinction and its products with red, green
    /// and blue; with [`Weighting::Even`] red, green and blue.
    ///
    /// The bound covers at most two entries more than the interval. NaN ends mean the whole range; swapped ends
    /// are put in order. Twin: `shaders/shared/maxima.wgsl`.
    pub fn max_slope(&self, lo: f32, hi: f32) -> f32 {
        let (first, last) = entries(self.low, self.scale, lo, hi);
        // Entry `last` and those after it lie outside.
        self.maxima.greatest(first, last - 1)
    }

    /// Maxima of runs of slopes. Row p, entry i: the greatest slope from entries i .. i + 2^p to the ones after
    /// them.
    #[cfg(feature = "gpu")]
    pub(crate) fn maxima(&self) -> &[Vec<f32>] {
        self.maxima.rows()
    }
}

impl TransferFunction {
    /// Computes averages over intervals of values.
    #[doc(hidden)]
    pub fn averages(&self, weighting: Weighting) -> Averages {
        Averages::new(self, weighting)
    }

    /// Computes bounds on the slope.
    #[doc(hidden)]
    pub fn slopes(&self, weighting: Weighting) -> Slopes {
        Slopes::new(self, weighting)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Steps, ramps, gaps, a faint range beside an opaque one, and colours that change with them.
    fn transfer() -> TransferFunction {
        let opacity = |v: f32| match v {
            v if v < -50.0 => 0.0,
            v if v < 0.0 => (v + 50.0) / 50.0,
            v if v < 30.0 => 1e-4,
            v if v < 60.0 => 0.0,
            v if v < 70.0 => 0.9,
            v if v < 140.0 => 0.0,
            _ => 0.2,
        };
        let colour = |v: f32| [(v * 0.1).sin().abs(), (v * 0.03).cos().abs(), 0.25];
        TransferFunction::from_curves(colour, opacity, [-100.0, 150.0], 2.0).unwrap()
    }

    /// The averaged quantities at a position in the table.
    fn products(t: &TransferFunction, weighting: Weighting, x: f64) -> [f64; 4] {
        let x = x.clamp(0.0, f64::from(LAST));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped"
        )]
        let i = (x as usize).min(CLASSIFICATION_TABLE_LEN - 2);
        let s = x - i as f64;
        let [a, b] = [t.table[i], t.table[i + 1]].map(|e| e.map(f64::from));
        let [r, g, b, e] = [0, 1, 2, 3].map(|c| a[c] + (b[c] - a[c]) * s);
        match weighting {
            Weighting::Even => [r, g, b, e],
            Weighting::Extinction => [r * e, g * e, b * e, e],
        }
    }

    /// The average of `products`: two-point Gauss quadrature between neighbouring entries, which is exact, and
    /// the shares beyond the ends.
    fn brute(t: &TransferFunction, weighting: Weighting, from: f64, to: f64) -> [f64; 4] {
        let last = f64::from(LAST);
        let mut cuts = vec![from, to];
        cuts.extend((0..CLASSIFICATION_TABLE_LEN).map(|i| i as f64));
        cuts.retain(|x| (from..=to).contains(x));
        cuts.sort_by(f64::total_cmp);
        let mut sum = [0.0; 4];
        for pair in cuts.windows(2) {
            let (middle, half) = ((pair[0] + pair[1]) / 2.0, (pair[1] - pair[0]) / 2.0);
            let beyond = middle < 0.0 || middle > last;
            let offset = if beyond { 0.0 } else { half / 3.0_f64.sqrt() };
            for x in [middle - offset, middle + offset] {
                let p = products(t, weighting, x);
                (0..4).for_each(|c| sum[c] += p[c] * half);
            }
        }
        if to > from {
            sum.map(|s| s / (to - from))
        } else {
            products(t, weighting, from)
        }
    }

    /// Compares the averages of an interval with brute force.
    ///
    /// Positions are rounded in f32: a difference, two products and a sum, each with an error of half an
    /// EPSILON of the farthest position. An end of the interval moves by that much, and the average by as much
    /// times the steepest slope nearby, or by the share of the width. Five terms, each of six roundings or
    /// fewer, err by 8 EPSILON of their sum; integers by one unit over the width.
    fn check(t: &TransferFunction, value: f32, spread: f32) {
        let epsilon = f64::from(f32::EPSILON);
        let scale = f64::from(t.scale);
        let x = (f64::from(value) - f64::from(t.range[0])) * scale;
        let half = f64::from(spread.abs()) * scale;
        let moved = 2.0 * epsilon * (x.abs() + half);
        let reach = spread.abs() + 2.0 / t.scale;
        let (lo, hi) = (value - reach, value + reach);
        let extinction = f64::from(t.max_extinction(lo, hi));
        let slope = |w| f64::from(t.slopes(w).max_slope(lo, hi)) / scale;
        let [weighted, even] = [Weighting::Extinction, Weighting::Even].map(slope);
        for weighting in [Weighting::Extinction, Weighting::Even] {
            let averages = t.averages(weighting);
            let got = averages.classify_spread(value, spread).map(f64::from);
            let truth = brute(t, weighting, x - half, x + half);
            let error = |c: usize| {
                let is_colour = weighting == Weighting::Even && c < 3;
                let (range, slope) = match is_colour {
                    true => (1.0, even),
                    false => (extinction, weighted),
                };
                let unit = f64::from(averages.units[c / 3]);
                moved * slope.min(range / (half + 1e-9))
                    + 8.0 * epsilon * truth[c].abs()
                    + unit / (2.0 * half).max(1.0)
                    + 1e-30
            };
            let context = || format!("{value} +- {spread}, {weighting:?}: {got:?}, {truth:?}");
            assert!((got[3] - truth[3]).abs() <= error(3), "{}", context());
            for c in 0..3 {
                match weighting {
                    Weighting::Even => {
                        assert!((got[c] - truth[c]).abs() <= error(c), "{}", context());
                    }
                    // Compares the emission; the precision of a colour is relative to its extinction.
                    Weighting::Extinction => {
                        let emitted = got[c] * got[3];
                        let bound = error(c) + 4.0 * f64::from(f32::EPSILON) * emitted;
                        assert!((emitted - truth[c]).abs() <= bound, "{}", context());
                    }
                }
            }
        }
    }

    #[test]
    fn averages_are_those_of_brute_force() {
        let t = transfer();
        for value in [
            -1e9, -300.0, -100.0, -99.99, -50.0, 0.0, 15.0, 59.99, 60.0, 69.97, 150.0,
        ] {
            for spread in [
                0.0, 1e-6, 1e-3, 0.03, 0.061, 0.09, 1.0, 10.0, 300.0, 1e7, 2e9,
            ] {
                check(&t, value, spread);
                check(&t, value, -spread);
            }
        }
    }

    proptest! {
        #[test]
        fn averages_of_any_interval_are_those_of_brute_force(
            value in -160.0f32..210.0, log_spread in -5.0f32..3.0,
        ) {
            check(&transfer(), value, 10_f32.powf(log_spread));
        }

        #[test]
        fn no_difference_passes_the_slope(a in -160.0f32..210.0, log_length in -3.0f32..2.5) {
            let t = transfer();
            let b = a + 10_f32.powf(log_length);
            for weighting in [Weighting::Extinction, Weighting::Even] {
                let slopes = t.slopes(weighting);
                let bound = slopes.max_slope(a, b);
                prop_assert_eq!(bound.to_bits(), slopes.max_slope(b, a).to_bits());
                prop_assert!(slopes.max_slope(f32::NAN, b) >= bound);
                let place = |v: f32| (f64::from(v) - f64::from(t.range[0])) * f64::from(t.scale);
                let (from, to) = (place(a), place(b));
                // Rounding of a position may leave out a segment that the interval touches by less than this.
                let margin = 1e-3;
                for n in 0..200 {
                    let x = from + margin + (to - from - 2.0 * margin) * f64::from(n) / 200.0;
                    let y = (x + 1e-3).min(to - margin);
                    if y <= x {
                        continue;
                    }
                    let (p, q) = (products(&t, weighting, x), products(&t, weighting, y));
                    for c in 0..if weighting == Weighting::Even { 3 } else { 4 } {
                        let rise = (q[c] - p[c]).abs() * f64::from(t.scale);
                        // 1e-9: f64's rounding in a difference of 1e-3 entries.
                        prop_assert!(rise <= f64::from(bound) * (y - x) + 1e-9, "{}", c);
                    }
                }
            }
        }
    }

    #[test]
    fn slopes_are_tight() {
        let t = transfer();
        let slopes = t.slopes(Weighting::Extinction);
        // Faint and constant, but colours change: .1 and .03 per unit.
        let faint = slopes.max_slope(5.0, 25.0);
        assert!(faint > 0.0 && faint < 0.11 * 1e-4, "{faint}");
        assert_eq!(slopes.max_slope(80.0, 130.0), 0.0);
        // The step at 60: ln(10) / 2 over an entry.
        let step = 10_f32.ln() / 2.0 * t.scale;
        let found = slopes.max_slope(59.0, 61.0);
        assert!((found / step - 1.0).abs() < 0.01, "{found} {step}");
    }

    #[test]
    fn no_spread_is_no_average() {
        let t = transfer();
        let averages = t.averages(Weighting::Extinction);
        for i in 0..10_000 {
            let value = -110.0 + 0.027 * i as f32;
            let plain = t.classify(value);
            let even = t.averages(Weighting::Even);
            for spread in [0.0, 1e-30, 1e-7] {
                let got = averages.classify_spread(value, spread);
                assert!(
                    (got[3] - plain[3]).abs() <= 1e-3 * plain[3] + 1e-6,
                    "{value}"
                );
                if i % 500 == 0 && spread == 0.0 {
                    assert_eq!(even.classify_spread(value, spread), plain);
                }
                for c in 0..3 {
                    // The quotient of a product.
                    let is_close = (got[c] - plain[c]).abs() <= 4.0 * f32::EPSILON;
                    assert!(is_close || plain[3] == 0.0 || spread > 0.0, "{value}");
                }
            }
        }
    }

    #[test]
    fn what_is_no_interval_has_an_answer() {
        let t = transfer();
        let (first, last) = (t.table[0], t.table[CLASSIFICATION_TABLE_LEN - 1]);
        for weighting in [Weighting::Extinction, Weighting::Even] {
            let averages = t.averages(weighting);
            let of = |value, spread| averages.classify_spread(value, spread);
            assert_eq!(of(f32::NAN, 1.0), [0.0; 4]);
            assert_eq!(of(1.0, f32::NAN), [0.0; 4]);
            assert_eq!(of(f32::INFINITY, 1.0)[3], last[3]);
            assert_eq!(of(f32::NEG_INFINITY, 1.0)[3], first[3]);
            // Half of the interval beyond either end.
            for spread in [f32::INFINITY, f32::MAX] {
                let half = (first[3] + last[3]) / 2.0;
                assert!((of(20.0, spread)[3] - half).abs() < 1e-6, "{spread}");
            }
            // No extinction gives exactly zero.
            assert_eq!(of(100.0, 29.0)[3].to_bits(), 0);
        }
        let nothing =
            TransferFunction::from_curves(|_| [1.0; 3], |_| 0.0, [0.0, 1.0], 1.0).unwrap();
        let averages = nothing.averages(Weighting::Extinction);
        assert_eq!(averages.classify_spread(0.5, 0.2), [0.0; 4]);
        assert_eq!(
            nothing.averages(Weighting::Even).classify_spread(0.5, 0.2)[0],
            1.0
        );
    }
}
