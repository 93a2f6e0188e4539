//! Defines the scales of values, linear or logarithmic, on which transfer functions are evaluated.

use std::borrow::Cow;

use crate::math::narrowed;
use crate::scene::values::Values;

/// Least number of steps that single precision must have within a range. If values are so far from 0 that there
/// are fewer, positions are counted from an origin among the values. A transfer function's table has a fourth
/// as many entries.
const LEAST_STEPS: f64 = 16_384.0;

/// Values whose differences reach this magnitude, or fall below its inverse, are rescaled before single
/// precision is used.
const GREATEST: f64 = 1e30;

/// The scale on which a transfer function is evaluated. Its table, colours and kernels' extents are even on
/// this scale: a field over decades is classified, interpolated and shown by its logarithm.
///
/// A *position* is a place on the scale. A volume's values are positions on the scale of its transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ValueScale {
    /// Positions are values.
    #[default]
    Linear,
    /// (value - origin) / unit: for values that single precision cannot represent, or whose differences it
    /// cannot.
    Shifted {
        /// The value at position 0.
        origin: f64,
        /// The difference of values whose positions differ by 1, above 0; a power of two.
        unit: f64,
    },
    /// log10 of the value; for values above 0.
    Log,
    /// sign(v) log10(1 + |v| / linear), for values of either sign: about linear within `linear` of 0 and
    /// logarithmic beyond.
    Symlog {
        /// Distance from 0 \[value units\] up to which the scale is about linear, above 0.
        linear: f32,
    },
}

/// The name of a scale; its parameters are computed from the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaleName {
    /// [`ValueScale::Linear`]
    Linear,
    /// [`ValueScale::Log`]
    Log,
    /// [`ValueScale::Symlog`], linear within a thousandth of the range's greatest distance from 0
    Symlog,
}

impl ScaleName {
    /// The name in `--scale` and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Log => "log",
            Self::Symlog => "symlog",
        }
    }

    /// The scale over a range of values.
    pub(super) fn over([lo, hi]: [f64; 2], name: Self) -> ValueScale {
        match name {
            Self::Linear => ValueScale::Linear,
            Self::Log => ValueScale::Log,
            Self::Symlog => ValueScale::Symlog {
                linear: narrowed(1e-3 * lo.abs().max(hi.abs())).max(f32::MIN_POSITIVE),
            },
        }
    }
}

impl ValueScale {
    /// The linear scale over a range of values in double precision. It is [`Self::Linear`], unless single
    /// precision distinguishes less than some 2^14 values within the range, or the range exceeds single
    /// precision.
    pub(super) fn linear_over([lo, hi]: [f64; 2]) -> Self {
        let greatest = lo.abs().max(hi.abs());
        let width = hi - lo;
        let is_far = width > 0.0 && width < LEAST_STEPS * f64::from(f32::EPSILON) * greatest;
        // The size of differences; or that of the values themselves, if these are all equal or their difference
        // overflows.
        let size = match width > 0.0 && width.is_finite() {
            true => width,
            false => greatest,
        };
        let is_ordinary = size <= 0.0 || (1.0 / GREATEST..GREATEST).contains(&size);
        if is_ordinary && !is_far {
            return Self::Linear;
        }
        Self::Shifted {
            origin: if is_far { lo.midpoint(hi) } else { 0.0 },
            // Powers of two keep the digits of differences; the clamped exponents have inverses.
            unit: match is_ordinary {
                true => 1.0,
                false => size.log2().floor().clamp(-1000.0, 1000.0).exp2(),
            },
        }
    }

    /// The scale for taking differences in single precision of values that may need double precision.
    ///
    /// - `range`: range of all values; `is_wide`: whether any are in double precision.
    pub(crate) fn of_differences(range: Option<[f64; 2]>, is_wide: bool) -> Self {
        match range {
            Some(range) if is_wide => Self::linear_over(range),
            _ => Self::Linear,
        }
    }

    /// Whether positions are counted from a value other than 0.
    pub(super) fn is_shifted(self) -> bool {
        matches!(self, Self::Shifted { origin, .. } if origin.abs() > 0.0)
    }

    /// Whether positions have the signs of their values.
    pub(super) fn has_signs(self) -> bool {
        self != Self::Log && !self.is_shifted()
    }

    /// Whether equal differences of values are equal on the scale.
    pub fn is_linear(self) -> bool {
        matches!(self, Self::Linear | Self::Shifted { .. })
    }

    /// The position of a value: minus infinity if a logarithmic scale has none.
    pub fn position(self, value: f64) -> f32 {
        let position = match self {
            Self::Linear => value,
            Self::Shifted { origin, unit } => (value - origin) / unit,
            Self::Log if value <= 0.0 => f64::NEG_INFINITY,
            Self::Log => value.log10(),
            Self::Symlog { linear } => {
                (value.abs() / f64::from(linear)).ln_1p()
                    * std::f64::consts::LOG10_E
                    * value.signum()
            }
        };
        narrowed(position)
    }

    /// The value at a position: the inverse of [`ValueScale::position`].
    pub fn value(self, position: f32) -> f64 {
        let p = f64::from(position);
        match self {
            Self::Linear => p,
            Self::Shifted { origin, unit } => origin + unit * p,
            Self::Log => 10f64.powf(p),
            Self::Symlog { linear } => {
                let decades = p.abs() * std::f64::consts::LN_10;
                f64::from(linear) * decades.exp_m1() * p.signum()
            }
        }
    }

    /// The positions of values. On a logarithmic scale, a value without a position takes that of the least
    /// value above 0, because any other would be infinite beside its neighbours.
    pub fn positions(self, values: Values) -> Values {
        let lowest = self.lowest(&values);
        self.positions_from(values, lowest)
    }

    /// The positions of values that stay in place; copied only if they differ from the values.
    pub(crate) fn seen(self, values: &Values) -> Cow<'_, Values> {
        match values {
            Values::F64(_) => Cow::Owned(self.positions(values.clone())),
            _ if self == Self::Linear => Cow::Borrowed(values),
            _ => Cow::Owned(self.positions(values.clone())),
        }
    }

    /// The least value above 0 on a logarithmic scale; minus infinity on others.
    pub(crate) fn lowest(self, values: &Values) -> f64 {
        match self {
            Self::Log => (0..values.len())
                .map(|i| values.wide(i))
                .filter(|v| *v > 0.0)
                .fold(f64::INFINITY, f64::min),
            _ => f64::NEG_INFINITY,
        }
    }

    /// The positions of some values, in single precision at most.
    ///
    /// - `lowest`: [`Self::lowest`] of all values.
    pub(crate) fn positions_from(self, values: Values, lowest: f64) -> Values {
        if self == Self::Linear && !matches!(values, Values::F64(_)) {
            return values;
        }
        let position = |i: usize| {
            let value = values.wide(i);
            self.position(if value < lowest { lowest } else { value })
        };
        Values::F32((0..values.len()).map(position).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_from_their_positions() {
        let symlog = ValueScale::Symlog { linear: 0.5 };
        for value in [1e-30, 3e-7, 0.02, 1.0, 7.5, 4e12] {
            for scale in [ValueScale::Linear, ValueScale::Log, symlog] {
                let back = scale.value(scale.position(value));
                // A position near 38 is known to 4e-6: as an exponent of ten 9e-6.
                assert!(
                    (back / value - 1.0).abs() < 2e-5,
                    "{scale:?} {value} {back}"
                );
            }
            assert!((symlog.position(-value) + symlog.position(value)).abs() <= 0.0);
        }
        assert!((ValueScale::Log.position(1000.0) - 3.0).abs() < 1e-6);
        assert!((symlog.position(4.5) - 1.0).abs() < 1e-6);
        assert!(symlog.position(0.0).abs() <= 0.0);
    }

    #[test]
    fn what_has_no_logarithm_counts_as_the_least_that_has() {
        let values = Values::F32(vec![0.0, 0.01, -3.0, 100.0, f32::NAN]);
        let Values::F32(positions) = ValueScale::Log.positions(values) else {
            panic!("positions are f32")
        };
        assert!(positions[4].is_nan());
        for (position, expected) in positions.iter().zip([-2.0, -2.0, -2.0, 2.0]) {
            assert!((position - expected).abs() < 1e-6);
        }
        let bytes = Values::U8(vec![1, 2]);
        assert_eq!(ValueScale::Linear.positions(bytes.clone()), bytes);
    }
}
