//! Sums numbers exactly, so that the result does not depend on their order.

#![allow(
    clippy::cast_possible_truncation,
    reason = "limbs are the low bits of what is cut up, and there are few of them"
)]

/// Number of bits of a limb.
const BITS: u32 = 32;

/// Number of limbs that hold a sum of 2^64 finite numbers of double precision.
const LIMBS: usize = 68;

/// Exponent of the least bit of a number.
const LEAST: i32 = -1074;

/// Greatest number of terms between carries: each adds less than 2^32 to a limb.
const MOST: u32 = 1 << 30;

/// The exact sum of finite numbers. [`Self::value`] is the same to the last bit for any order of the numbers,
/// and for any partition into sums that are added afterwards.
///
/// The sum is a fixed-point number with a place for every bit of every finite double: Kulisch's long
/// accumulator.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ExactSum {
    /// Limbs in units of 2^(32 i - 1074); the last one has the sign.
    limbs: [i64; LIMBS],
    /// Number of terms added since the last carry.
    pending: u32,
}

impl Default for ExactSum {
    fn default() -> Self {
        Self {
            limbs: [0; LIMBS],
            pending: 0,
        }
    }
}

impl ExactSum {
    /// Adds a number; numbers that are not finite are ignored.
    pub(crate) fn add(&mut self, x: f64) {
        if !x.is_finite() {
            return;
        }
        let bits = x.to_bits();
        let exponent = (bits >> 52 & 0x7ff) as u32;
        let fraction = bits & ((1 << 52) - 1);
        // Subnormal numbers have the exponent of the least normal ones and no leading bit.
        let (mantissa, shift) = match exponent {
            0 => (fraction, 0),
            _ => (fraction | 1 << 52, exponent - 1),
        };
        let (first, within) = ((shift / BITS) as usize, shift % BITS);
        let wide = u128::from(mantissa) << within;
        for (i, limb) in self.limbs[first..first + 3].iter_mut().enumerate() {
            let part = (wide >> (BITS * i as u32)) as u32;
            *limb += if x < 0.0 {
                -i64::from(part)
            } else {
                i64::from(part)
            };
        }
        self.pending += 1;
        if self.pending == MOST {
            self.carry();
        }
    }

    /// Adds another sum.
    pub(crate) fn add_all(&mut self, mut other: Self) {
        self.carry();
        other.carry();
        for (own, other) in self.limbs.iter_mut().zip(other.limbs) {
            *own += other;
        }
        self.carry();
    }

    /// Carries: leaves 32 bits in each limb but the last.
    fn carry(&mut self) {
        let mut above = 0;
        for limb in &mut self.limbs[..LIMBS - 1] {
            let sum = *limb + above;
            above = sum >> BITS;
            *limb = sum & i64::from(u32::MAX);
        }
        self.limbs[LIMBS - 1] += above;
        self.pending = 0;
    }

    /// Returns the sum, within a rounding error or two.
    pub(crate) fn value(&self) -> f64 {
        let mut sum = self.clone();
        sum.carry();
        let is_negative = sum.limbs[LIMBS - 1] < 0;
        if is_negative {
            sum.limbs.iter_mut().for_each(|limb| *limb = -*limb);
            sum.carry();
        }
        // From the greatest limb: three limbs have at least 65 bits, and what follows the fourth does not
        // affect the last bit.
        let limbs = sum.limbs.iter().enumerate().rev();
        let terms = limbs.filter(|(_, limb)| **limb != 0).take(4);
        let value: f64 = terms
            .map(|(i, limb)| scaled(*limb as f64, BITS as i32 * i as i32 + LEAST))
            .sum();
        if is_negative { -value } else { value }
    }

    /// Returns the limbs, carried, for sending.
    pub(crate) fn to_limbs(&self) -> Vec<i64> {
        let mut sum = self.clone();
        sum.carry();
        sum.limbs.to_vec()
    }

    /// Restores a sum from [`Self::to_limbs`]; `None` if the number of limbs differs.
    pub(crate) fn of_limbs(limbs: &[i64]) -> Option<Self> {
        let mut sum = Self {
            limbs: limbs.try_into().ok()?,
            pending: 0,
        };
        // Clamped, so that received limbs have room for another addition.
        sum.limbs
            .iter_mut()
            .for_each(|limb| *limb = (*limb).clamp(-1 << 61, 1 << 61));
        sum.carry();
        Some(sum)
    }
}

/// Returns x 2^exponent, in two steps, because the power alone may overflow or underflow.
fn scaled(x: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    x * 2.0_f64.powi(half) * 2.0_f64.powi(exponent - half)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum_of(numbers: impl IntoIterator<Item = f64>) -> ExactSum {
        let mut sum = ExactSum::default();
        numbers.into_iter().for_each(|x| sum.add(x));
        sum
    }

    #[test]
    fn sums_of_small_whole_numbers_are_those_of_floating_point() {
        for numbers in [
            vec![],
            vec![1.0],
            vec![-3.0, 1.0],
            vec![0.5, 0.25, -7.0],
            vec![1e15, 1.0, -1e15],
        ] {
            let expected: f64 = numbers.iter().sum();
            assert_eq!(sum_of(numbers).value(), expected);
        }
        let tiny = f64::from_bits(1);
        assert_eq!(
            sum_of([tiny, tiny, -f64::MIN_POSITIVE, f64::MIN_POSITIVE]).value(),
            2.0 * tiny
        );
        assert_eq!(sum_of([f64::MAX]).value(), f64::MAX);
        assert_eq!(sum_of([f64::MAX, f64::MAX, -f64::MAX]).value(), f64::MAX);
        assert_eq!(sum_of([f64::MAX, f64::MAX]).value(), f64::INFINITY);
        assert_eq!(sum_of([1.0, f64::NAN, f64::INFINITY]).value(), 1.0);
    }

    #[test]
    fn what_cancels_is_not_lost() {
        // In floating point the result would be 0.
        assert_eq!(sum_of([1e300, 1.0, 1e-300, -1e300, -1.0]).value(), 1e-300);
        assert_eq!(sum_of([-1e300, -1.0, -1e-300, 1e300, 1.0]).value(), -1e-300);
    }

    #[test]
    fn no_order_and_no_sharing_out_changes_a_bit() {
        let mut state = 1_u64;
        let mut number = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let x = (state >> 11) as f64 / (1_u64 << 53) as f64;
            (x - 0.4) * 10.0_f64.powi((state % 60) as i32 - 30)
        };
        let numbers: Vec<f64> = (0..10_000).map(|_| number()).collect();
        let all = sum_of(numbers.iter().copied());
        let turned = sum_of(numbers.iter().rev().copied());
        assert_eq!(all.value().to_bits(), turned.value().to_bits());
        let mut parts = ExactSum::default();
        for part in numbers.chunks(777) {
            let own = sum_of(part.iter().copied());
            parts.add_all(ExactSum::of_limbs(&own.to_limbs()).unwrap());
        }
        assert_eq!(parts.value().to_bits(), all.value().to_bits());
        // A plain sum rounds at each step.
        let plain: f64 = numbers.iter().sum();
        let greatest = numbers.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        assert!((plain - all.value()).abs() < 1e-12 * greatest * 1e4);
        assert!(ExactSum::of_limbs(&[1, 2]).is_none());
    }
}
