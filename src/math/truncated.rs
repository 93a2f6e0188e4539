//! Computes moments of the normal distribution truncated to an interval.

use super::normal::normal_density_and_cdf;

/// Moments of the unit Gaussian truncated to an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Truncated {
    /// Share of the integral within the interval; 0 if negligible.
    pub(crate) share: f64,
    /// Mean of the truncated distribution.
    pub(crate) mean: f64,
    /// Variance.
    pub(crate) variance: f64,
    /// Third central moment.
    pub(crate) third: f64,
}

impl Truncated {
    /// Truncates to `lower ..= upper`; the ends may be infinite. Johnson, Kotz and Balakrishnan 1994, section
    /// 10.1.
    pub(crate) fn new(lower: f64, upper: f64) -> Self {
        /// Shares below this are negligible, and their moments would be rounding errors.
        const LEAST: f64 = 1e-9;
        let ([low, high], [below, upto]) = normal_density_and_cdf([lower, upper]);
        let share = upto - below;
        if !(share > LEAST) {
            return Self {
                share: 0.0,
                mean: 0.0,
                variance: 1.0,
                third: 0.0,
            };
        }
        // phi times any power is 0 at infinity.
        let ends = |power: i32| {
            let of = |x: f64, density: f64| {
                if x.is_finite() {
                    x.powi(power) * density
                } else {
                    0.0
                }
            };
            (of(lower, low) - of(upper, high)) / share
        };
        let mean = ends(0);
        let second = 1.0 + ends(1);
        let third = 2.0 * mean + ends(2);
        Self {
            share,
            mean,
            variance: (second - mean * mean).max(0.0),
            third: third - 3.0 * mean * second + 2.0 * mean * mean * mean,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_sums() {
        for (lower, upper) in [
            (f64::NEG_INFINITY, f64::INFINITY),
            (0.0, f64::INFINITY),
            (-1.0 / 0.6, 1.0 / 0.6),
            (1.7, f64::INFINITY),
            (-0.3, 2.0),
        ] {
            let [mut share, mut first, mut second, mut third] = [0.0; 4];
            let (a, b) = (f64::max(lower, -9.0), f64::min(upper, 9.0));
            let step = (b - a) / 20_000.0;
            for n in 0..20_000 {
                let x = a + (f64::from(n) + 0.5) * step;
                let weight = step * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
                share += weight;
                first += weight * x;
                second += weight * x * x;
                third += weight * x * x * x;
            }
            let (mean, square) = (first / share, second / share);
            let found = Truncated::new(lower, upper);
            // The midpoint rule errs by some h²/24.
            assert!((found.share - share).abs() < 1e-7);
            assert!((found.mean - mean).abs() < 1e-7);
            assert!((found.variance - (square - mean * mean)).abs() < 1e-6);
            let central = third / share - 3.0 * mean * square + 2.0 * mean.powi(3);
            assert!((found.third - central).abs() < 1e-6);
        }
        assert_eq!(Truncated::new(7.0, f64::INFINITY).share, 0.0);
    }
}
