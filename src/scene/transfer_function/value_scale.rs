//! Where values lie before a transfer function is asked: linearly, or by their logarithm.

use crate::scene::Values;

/// The scale on which a transfer function lies over its values. A table, colours and kernels' extents are even on
/// it: a field over decades is classified, interpolated and shown by its logarithm.
///
/// A *position* is a place on the scale. A volume's values are positions on the scale of its transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ValueScale {
    /// Positions are values.
    #[default]
    Linear,
    /// log10 of the value; of values above 0.
    Log,
    /// sign(v) log10(1 + |v| / linear): of either sign, linear within `linear` of 0 and logarithmic beyond.
    Symlog {
        /// The distance from 0 \[value units\] up to which it is about linear, above 0.
        linear: f32,
    },
}

/// A scale by its name; what a symmetric one needs comes from the values.
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
    /// The name that `--scale` and files have for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Log => "log",
            Self::Symlog => "symlog",
        }
    }

    /// The scale over a range of values.
    pub(super) fn over([lo, hi]: [f32; 2], name: Self) -> ValueScale {
        match name {
            Self::Linear => ValueScale::Linear,
            Self::Log => ValueScale::Log,
            Self::Symlog => ValueScale::Symlog {
                linear: (1e-3 * lo.abs().max(hi.abs())).max(f32::MIN_POSITIVE),
            },
        }
    }
}

impl ValueScale {
    /// Where a value lies: minus infinity for what a logarithm has no place for.
    pub fn position(self, value: f32) -> f32 {
        let v = f64::from(value);
        let position = match self {
            Self::Linear => return value,
            Self::Log if v <= 0.0 => f64::NEG_INFINITY,
            Self::Log => v.log10(),
            Self::Symlog { linear } => {
                (v.abs() / f64::from(linear)).ln_1p() * std::f64::consts::LOG10_E * v.signum()
            }
        };
        narrowed(position)
    }

    /// The value at a position: the inverse of [`ValueScale::position`].
    pub fn value(self, position: f32) -> f32 {
        let p = f64::from(position);
        let value = match self {
            Self::Linear => return position,
            Self::Log => 10f64.powf(p),
            Self::Symlog { linear } => {
                let decades = p.abs() * std::f64::consts::LN_10;
                f64::from(linear) * decades.exp_m1() * p.signum()
            }
        };
        narrowed(value)
    }

    /// The positions of values. What a logarithm has no place for counts as the least value above 0: beside its
    /// neighbours nothing else is finite.
    pub fn positions(self, values: Values) -> Values {
        let lowest = self.lowest(&values);
        self.positions_from(values, lowest)
    }

    /// The least value above 0, on a scale that has a place for no other.
    pub(crate) fn lowest(self, values: &Values) -> f32 {
        match self {
            Self::Log => (0..values.len())
                .map(|i| values.get(i))
                .filter(|v| *v > 0.0)
                .fold(f32::INFINITY, f32::min),
            _ => f32::NEG_INFINITY,
        }
    }

    /// The positions of some values.
    ///
    /// - `lowest`: [`Self::lowest`] of all.
    pub(crate) fn positions_from(self, values: Values, lowest: f32) -> Values {
        if self == Self::Linear {
            return values;
        }
        let position = |i: usize| {
            let value = values.get(i);
            self.position(if value < lowest { lowest } else { value })
        };
        Values::F32((0..values.len()).map(position).collect())
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
fn narrowed(x: f64) -> f32 {
    x as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_from_their_positions() {
        let symlog = ValueScale::Symlog { linear: 0.5 };
        for value in [1e-30f32, 3e-7, 0.02, 1.0, 7.5, 4e12] {
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
