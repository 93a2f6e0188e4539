//! Integrates emission and absorption along a ray on which the field is piecewise cubic.

use super::super::ray::RayIntegral;
use super::cubic::Cubic;
use super::function::Function;
use super::running::{PLACES, of_3, of_5, of_9};

/// The light of a ray, accumulated from the eye.
///
/// I = ∫ c(v(t)) κ(v(t)) T(t) dt, T(t) = exp(-∫ κ(v) dt), v the field. Pieces are divided at extrema of v and
/// where v passes a knot of the transfer function. The parts are smooth, apart from bends of the interpolated
/// function that are too slight for a knot. They are halved until two rules agree.
#[derive(Debug)]
pub(super) struct Emission<'a> {
    function: &'a Function,
    error: f64,
    /// Inverse of the length over which the error is distributed.
    per_length: f64,
    light: [f64; 3],
    depth: f64,
    transmittance: f64,
    /// Bound of the error so far.
    spent: f64,
    bisections: u32,
}

/// Greatest number of bisections of one ray, so that no field can hang the program.
const MOST_BISECTIONS: u32 = 100_000;

/// Share of the error that may remain behind opaque parts.
const TAIL_SHARE: f64 = 0.05;

/// Share of the allowed error within which the rules of 5 and of 3 nodes must agree for the former to be
/// accepted: the rule of 3 is often right by chance.
const STRICT: f64 = 0.1;

impl<'a> Emission<'a> {
    /// - `error`: error of each channel, full scale 1.
    /// - `length`: length of the part of the ray that may be within the field.
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

    /// Returns true while further parts would still be visible.
    pub(super) fn goes_on(&self) -> bool {
        self.transmittance >= TAIL_SHARE * self.error
    }

    /// Returns true if a field between two values neither emits nor absorbs.
    pub(super) fn is_transparent(&self, low: f64, high: f64) -> bool {
        self.function.most_extinction(low, high) <= 0.0
    }

    /// Returns the tolerance for values of a field between two values.
    pub(super) fn value_tolerance(&self, low: f64, high: f64) -> f64 {
        (VALUE_SHARE * self.error * (high - low)).max(1e-14 * low.abs().max(high.abs()))
    }

    /// Adds the next piece, of length `length`, over which the field is `field`.
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

    /// Adds a part whose values are unknown except for their bounds; it counts towards the error.
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

    /// Adds a part that is too long for the rules.
    #[cold]
    fn add_halves(&mut self, length: f64, field: &Cubic, [from, to]: [f64; 2]) {
        let middle = 0.5 * (from + to);
        // Stack of pending parts, the nearest on top: one more than the depth of bisection.
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

    /// Adds a part if a rule is accurate enough, or if the part may not be halved.
    fn take(&mut self, length: f64, field: &Cubic, [a, b]: [f64; 2], may_halve: bool) -> bool {
        let mut values = [[0.0; 4]; 9];
        let places = &*PLACES;
        let ask = |i: usize| self.function.light(field.at(a + (b - a) * places[i]));
        for i in [0, 2, 4, 6, 8] {
            values[i] = ask(i);
        }
        let coarse = of_5(&values, length);
        // Half by length, half by opacity. The difference of two depths has a rounding error.
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

/// Tolerance of a field's values, as a share of the requested error and of the values' range within a cell. The
/// optical depth of a crossing of a cell changes by about that share, and all visible crossings together have
/// an optical depth of a few.
const VALUE_SHARE: f64 = 0.01;
