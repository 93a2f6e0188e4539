//! Emission and absorption along a ray on which the field is a cubic, piece by piece.

use super::super::ray::RayIntegral;
use super::cubic::Cubic;
use super::function::Function;
use super::running::{PLACES, of_3, of_5, of_9};

/// The light of a ray, from the eye on.
///
/// I = ∫ c(v(t)) κ(v(t)) T(t) dt, T(t) = exp(-∫ κ(v) dt), v the field. Pieces are divided where v
/// turns and where it passes a knot of the transfer function; what is left is smooth but for
/// interpolated turns too blunt for a knot, and halved until two rules agree.
#[derive(Debug)]
pub(super) struct Emission<'a> {
    function: &'a Function,
    error: f64,
    /// One over the length that the error is shared out over.
    per_length: f64,
    light: [f64; 3],
    depth: f64,
    transmittance: f64,
    /// What the error may be so far.
    spent: f64,
    bisections: u32,
}

/// Bisections of one ray, so that no field can hang.
const MOST_BISECTIONS: u32 = 100_000;

/// Share of the error that may be left behind what is opaque.
const TAIL_SHARE: f64 = 0.05;

/// A rule of 5 places is believed where it differs from that of 3 by this share of what it may: the
/// one of 3 is often right by chance.
const STRICT: f64 = 0.1;

impl<'a> Emission<'a> {
    /// - `error`: of each channel, full scale 1.
    /// - `length`: of the part of the ray that may be within the field.
    pub(super) fn new(function: &'a Function, error: f64, length: f64) -> Self {
        Self {
            function,
            error,
            per_length: 1.0 / length.max(f64::MIN_POSITIVE),
            light: [0.0; 3],
            depth: 0.0,
            transmittance: 1.0,
            spent: 0.0,
            bisections: 0,
        }
    }

    /// Whether what comes next is still seen.
    pub(super) fn goes_on(&self) -> bool {
        self.transmittance >= TAIL_SHARE * self.error
    }

    /// Whether a field between two values neither emits nor absorbs.
    pub(super) fn is_transparent(&self, low: f64, high: f64) -> bool {
        self.function.most_extinction(low, high) <= 0.0
    }

    /// How far values of a field that lie between two may be off.
    pub(super) fn value_tolerance(&self, low: f64, high: f64) -> f64 {
        (VALUE_SHARE * self.error * (high - low)).max(1e-14 * low.abs().max(high.abs()))
    }

    /// The next piece, of a length, over which the field is `field`.
    pub(super) fn add(&mut self, length: f64, field: &Cubic) {
        if !(length > 0.0) {
            return;
        }
        let [first, second] = field.turns();
        let mut from = 0.0;
        for to in [first, second, 1.0] {
            if to > from {
                self.add_monotone(length, field, from, to);
            }
            from = to;
        }
    }

    /// A part that nobody can say the values of, but for two that they lie between.
    pub(super) fn lose(&mut self, length: f64, low: f64, high: f64) {
        let most = self.function.most_extinction(low, high) * length;
        self.spent += self.transmittance * -(-most).exp_m1();
    }

    pub(super) fn finish(self) -> RayIntegral {
        let [r, g, b] = self.light;
        let tail = if self.goes_on() {
            0.0
        } else {
            self.transmittance
        };
        RayIntegral {
            rgba: [r, g, b, -(-self.depth).exp_m1()],
            error: self.spent + tail,
        }
    }

    fn add_monotone(&mut self, length: f64, field: &Cubic, from: f64, to: f64) {
        let (a, b) = (field.at(from), field.at(to));
        let (low, high) = (a.min(b), a.max(b));
        if self.is_transparent(low, high) {
            return;
        }
        let function = self.function;
        let knots = function.knots(low, high);
        let mut last = from;
        for i in 0..knots.len() {
            let knot = knots[if a <= b { i } else { knots.len() - 1 - i }];
            let place = field.solve(knot, last, to);
            self.add_smooth(length, field, last, place);
            last = place;
        }
        self.add_smooth(length, field, last, to);
    }

    fn add_smooth(&mut self, length: f64, field: &Cubic, from: f64, to: f64) {
        if !(to > from) || self.is_transparent_between(field.at(from), field.at(to)) {
            return;
        }
        if !self.take(length * (to - from), field, [from, to], true) {
            self.add_halves(length, field, [from, to]);
        }
    }

    /// A part that is too long for the rules.
    #[cold]
    fn add_halves(&mut self, length: f64, field: &Cubic, [from, to]: [f64; 2]) {
        let middle = 0.5 * (from + to);
        // Parts that wait, the nearest on top: one more than bisections in a row.
        let mut waiting = [[0.0; 2]; 64];
        waiting[0] = [middle, to];
        waiting[1] = [from, middle];
        let mut count = 2;
        while count > 0 && self.goes_on() {
            count -= 1;
            let [a, b] = waiting[count];
            let middle = 0.5 * (a + b);
            let may_halve = a < middle
                && middle < b
                && count + 2 <= waiting.len()
                && self.bisections < MOST_BISECTIONS;
            if !self.take(length * (b - a), field, [a, b], may_halve) {
                waiting[count] = [middle, b];
                waiting[count + 1] = [a, middle];
                count += 2;
                self.bisections += 1;
            }
        }
    }

    fn is_transparent_between(&self, a: f64, b: f64) -> bool {
        self.is_transparent(a.min(b), a.max(b))
    }

    /// Adds a part if a rule says that it is good enough, or it may not be halved.
    fn take(&mut self, length: f64, field: &Cubic, [a, b]: [f64; 2], may_halve: bool) -> bool {
        let mut values = [[0.0; 4]; 9];
        let places = &*PLACES;
        let ask = |i: usize| self.function.light(field.at(a + (b - a) * places[i]));
        for i in [0, 2, 4, 6, 8] {
            values[i] = ask(i);
        }
        let coarse = of_5(&values, length);
        // Half by length, half by opacity. The difference of two depths is rounded.
        let share = length * self.per_length - self.transmittance * (-coarse.depth).exp_m1();
        let rounding = 8.0 * f64::EPSILON * (1.0 + coarse.depth);
        let allowed = (0.5 * self.error * share / self.transmittance).max(rounding);
        let mut best = coarse;
        let mut error = coarse.error(&of_3(&values, length));
        if error > STRICT * allowed {
            for i in [1, 3, 5, 7] {
                values[i] = ask(i);
            }
            best = of_9(&values, length);
            error = best.error(&coarse);
            if error > allowed && may_halve {
                return false;
            }
        }
        for (sum, light) in self.light.iter_mut().zip(best.light) {
            *sum += self.transmittance * light;
        }
        self.spent += self.transmittance * error;
        self.depth += best.depth;
        self.transmittance = (-self.depth).exp();
        true
    }
}

/// How far a field's values may be off, in the error aimed at and the values' range within a cell:
/// the optical depth of a crossing of a cell changes by about that share, and all crossings that are
/// seen have an optical depth of a few together.
const VALUE_SHARE: f64 = 0.01;
