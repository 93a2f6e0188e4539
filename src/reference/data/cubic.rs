//! Represents a field along a piece of a ray by a cubic polynomial over the unit interval.

/// The polynomial c0 + c1 s + c2 s² + c3 s³ for s in \[0, 1\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cubic(pub(super) [f64; 4]);

/// Zeros of the Chebyshev polynomial of degree 4, on \[0, 1\]. A cubic through a function's values there
/// differs from it by at most h⁴/3072 times its fourth derivative, most in the middle and at the ends. No zero
/// is at an end, where the maps of collapsed cells may be singular.
pub(super) const CHEBYSHEV: [f64; 4] = [
    0.038_060_233_744_356_63,
    0.308_658_283_817_455_1,
    0.691_341_716_182_544_9,
    0.961_939_766_255_643_4,
];

/// Greatest number of steps of the root search; bisection alone would finish within it.
const MOST_STEPS: u32 = 60;

impl Cubic {
    /// Returns the straight line from one value to another.
    pub(super) fn line(from: f64, to: f64) -> Self {
        Self([from, to - from, 0.0, 0.0])
    }

    /// Returns the cubic through values at [`CHEBYSHEV`], by divided differences.
    pub(super) fn through(values: [f64; 4]) -> Self {
        let x = CHEBYSHEV;
        let mut d = values;
        for order in 1..4 {
            for i in (order..4).rev() {
                d[i] = (d[i] - d[i - 1]) / (x[i] - x[i - order]);
            }
        }
        // Newton's form multiplied out, from the highest term.
        let mut c = [d[3], 0.0, 0.0, 0.0];
        for i in (0..3).rev() {
            for power in (1..4).rev() {
                c[power] = c[power - 1] - x[i] * c[power];
            }
            c[0] = d[i] - x[i] * c[0];
        }
        Self(c)
    }

    pub(super) fn at(&self, s: f64) -> f64 {
        let [a, b, c, d] = self.0;
        a + s * (b + s * (c + s * d))
    }

    fn slope(&self, s: f64) -> f64 {
        let [_, b, c, d] = self.0;
        b + s * (2.0 * c + s * 3.0 * d)
    }

    /// Returns the extrema within (0, 1), in order; 1 replaces missing ones. The cubic is monotone between
    /// these and the ends.
    pub(super) fn turns(&self) -> [f64; 2] {
        let [_, b, c, d] = self.0;
        let (p, q) = (3.0 * d, 2.0 * c);
        let discriminant = q * q - 4.0 * p * b;
        if !(discriminant > 0.0) {
            return [1.0; 2];
        }
        let larger = -0.5 * (q + discriminant.sqrt().copysign(q));
        // A missing extremum is infinite or NaN, and so not within.
        let within = |s: f64| if s > 0.0 && s < 1.0 { s } else { 1.0 };
        let (s, t) = (within(larger / p), within(b / larger));
        if s <= t { [s, t] } else { [t, s] }
    }

    /// Returns the argument of a value between `a` and `b`, where the cubic is monotone and takes the value.
    /// Newton's method starts on the straight line between the ends, and stays within the bracket.
    pub(super) fn solve(&self, value: f64, a: f64, b: f64) -> f64 {
        let ends = [self.at(a), self.at(b)];
        let rises = ends[1] >= ends[0];
        let (mut low, mut high) = (a, b);
        let share = (value - ends[0]) / (ends[1] - ends[0]);
        let mut s = if share > 0.0 && share < 1.0 {
            a + (b - a) * share
        } else {
            0.5 * (a + b)
        };
        for _ in 0..MOST_STEPS {
            let miss = self.at(s) - value;
            if (miss < 0.0) == rises {
                low = s;
            } else {
                high = s;
            }
            let step = miss / self.slope(s);
            if step.abs() <= 2.0 * f64::EPSILON {
                break;
            }
            let next = s - step;
            s = if next > low && next < high {
                next
            } else {
                0.5 * (low + high)
            };
        }
        s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_through_values_turns_and_roots_are_right() {
        let cubic = Cubic([0.3, -2.0, 5.0, -3.5]);
        let again = Cubic::through(CHEBYSHEV.map(|s| cubic.at(s)));
        for (a, b) in cubic.0.iter().zip(again.0) {
            assert!((a - b).abs() < 1e-13, "{again:?}");
        }
        // The derivative -10.5 s² + 10 s - 2 vanishes at (10 ± 4)/21.
        let [first, second] = cubic.turns();
        assert!((first - 6.0 / 21.0).abs() < 1e-15 && (second - 14.0 / 21.0).abs() < 1e-15);
        for [a, b] in [[0.0, first], [first, second], [second, 1.0]] {
            for share in [1e-9, 0.1, 0.5, 0.999] {
                let value = cubic.at(a) + (cubic.at(b) - cubic.at(a)) * share;
                let root = cubic.solve(value, a, b);
                assert!((cubic.at(root) - value).abs() < 1e-15 && root >= a && root <= b);
            }
        }
        assert_eq!(Cubic::line(1.0, 2.0).turns(), [1.0; 2]);
        assert_eq!(Cubic::line(1.0, 1.0).turns(), [1.0; 2]);
    }
}
