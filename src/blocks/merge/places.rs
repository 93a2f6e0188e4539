//! Measures how unevenly the values of a cluster's members fill their interval.

/// Returns the unevenness of values: the Wasserstein distance of first order from values spread evenly over `mean -
/// spread ..= mean + spread`. It is the mean distance by which the values must move to be spread evenly.
///
/// The averages over both of a function with slope at most 1 differ by no more than this.
///
/// - `members`: the share and the value of each; the shares add up to 1.
pub(super) fn unevenness(members: impl Iterator<Item = (f64, f64)>, mean: f64, spread: f64) -> f64 {
    let mut places = Places::new(mean, spread);
    members.for_each(|(share, value)| places.add(share, value));
    places.unevenness()
}

/// Number of points at which cumulative shares are compared.
const BINS: usize = 32;

/// Unit in which shares are counted, so that their sums do not depend on an order.
const SHARE: f64 = 1.0 / (1_u64 << 52) as f64;

/// Greatest distance of a value beyond the interval that counts, in units of the half width. Values lie closer to their
/// mean than half the width on average, so that the sum of the excess fits 63 bits.
const FARTHEST: f64 = 1024.0;

/// Distribution of values about their mean, which [`unevenness`] sums.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) struct Places {
    mean: f64,
    spread: f64,
    sums: PlaceSums,
}

/// Sums in units of [`SHARE`]: the share of the members in each bin, then the sum of distances beyond the interval.
pub(in crate::blocks) type PlaceSums = [i64; BINS + 1];

impl Places {
    /// Starts without values.
    pub(super) fn new(mean: f64, spread: f64) -> Self {
        Self {
            mean,
            spread,
            sums: [0; BINS + 1],
        }
    }

    #[inline]
    pub(super) fn add(&mut self, share: f64, value: f64) {
        let place = (value - self.mean) / self.spread;
        let inside = place.clamp(-1.0, 1.0);
        let beyond = (place - inside).abs().min(FARTHEST);
        let share = share / SHARE;
        let bin = (0.5 * (inside + 1.0) * BINS as f64) as usize;
        self.sums[bin.min(BINS - 1)] += share as i64;
        self.sums[BINS] += (share * beyond) as i64;
    }

    /// Adds another distribution.
    pub(super) fn and(self, other: &Self) -> Self {
        self.with(&other.sums)
    }

    /// Adds the sums of another distribution.
    pub(in crate::blocks) fn with(mut self, others: &PlaceSums) -> Self {
        for (own, other) in self.sums.iter_mut().zip(others) {
            *own += other;
        }
        self
    }

    /// Sums in units of [`SHARE`].
    pub(in crate::blocks) fn sums(&self) -> &PlaceSums {
        &self.sums
    }

    pub(super) fn unevenness(&self) -> f64 {
        if !(self.spread > 0.0) {
            return 0.0;
        }
        let [shares @ .., beyond] = self.sums.map(|sum| sum as f64 * SHARE);
        let mut below = 0.0;
        let mut between = 0.0;
        for (i, share) in shares.iter().enumerate() {
            below += share;
            between += (below - (i + 1) as f64 / BINS as f64).abs();
        }
        self.spread * (beyond + between * 2.0 / BINS as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> f64 {
        let share = 1.0 / values.len() as f64;
        let mean = values.iter().sum::<f64>() * share;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() * share;
        let members = values.iter().map(|&v| (share, v));
        unevenness(members, mean, (3.0 * variance).sqrt())
    }

    #[test]
    fn what_is_even_moves_nowhere_and_what_is_not_as_far_as_it_must() {
        assert!(of(&[7.0; 64]).abs() < 1e-12);
        let ramp: Vec<f64> = (0..4096).map(f64::from).collect();
        // Less than a bin of 32 over both ends.
        assert!(of(&ramp) < 4096.0 / 32.0, "{}", of(&ramp));
        // Two values, 2 apart: by quantiles, the integral of |sqrt(3) t - 1| over 0..1 is (1/2 + (sqrt(3) - 1)²/2) /
        // sqrt(3) = .443, to a bin's width.
        let halves: Vec<f64> = (0..64).map(|i| f64::from(i % 2) * 2.0).collect();
        assert!((of(&halves) - 0.443).abs() < 0.06, "{}", of(&halves));
        // One value of many differs: mostly its distance.
        let lone: Vec<f64> = (0..4096).map(|i| f64::from(u8::from(i == 9))).collect();
        let deviation = (1.0 / 4096.0_f64).sqrt();
        assert!(of(&lone) > 0.7 * deviation && of(&lone) < deviation);
        // NaN has no unevenness.
        assert!(unevenness([(1.0, f64::NAN)].into_iter(), 0.0, f64::NAN) == 0.0);
    }
}
