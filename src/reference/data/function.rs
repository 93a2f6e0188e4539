//! Evaluates the transfer function in f64, from the same table, and finds where it is not smooth.

use crate::scene::TransferFunction;

/// A table of colours and extinctions, interpolated linearly, like [`TransferFunction::classify`] in f32.
#[derive(Debug, Clone)]
pub(super) struct Function {
    source: TransferFunction,
    table: Vec<[f64; 4]>,
    low: f64,
    /// Number of entries per unit of value.
    scale: f64,
    /// Values at which the slope of extinction or emission changes sharply, ascending.
    knots: Vec<f64>,
}

/// Least change of slope that is sharp, relative to the greatest entry of the table, per entry. A ramp over
/// half of the range begins with 4.9e-4. Slighter bends are left to bisection: functions made from histograms
/// have a thousand of them (1080 of at least 1e-4 in one of a smooth field), and knots there would divide rays
/// for nothing.
const SHARP: f64 = 4e-4;

impl Function {
    pub(super) fn new(source: TransferFunction) -> Self {
        let table: Vec<[f64; 4]> = source.table().iter().map(|e| e.map(f64::from)).collect();
        let [low, high] = source.range().map(f64::from);
        let last = table.len() - 1;
        let scale = last as f64 / (high - low);
        let lights: Vec<[f64; 4]> = table.iter().map(|e| light(*e)).collect();
        let mut greatest = [f64::MIN_POSITIVE; 4];
        for light in &lights {
            for (most, v) in greatest.iter_mut().zip(light) {
                *most = most.max(v.abs());
            }
        }
        let is_sharp = |&i: &usize| {
            // Beyond the ends the function is constant.
            let [before, here, after] = [i.saturating_sub(1), i, (i + 1).min(last)];
            (0..4).any(|c| {
                let [a, b, d] = [before, here, after].map(|i| lights[i][c]);
                let starts = (a == 0.0 && b == 0.0) != (b == 0.0 && d == 0.0);
                starts || (a - 2.0 * b + d).abs() > SHARP * greatest[c]
            })
        };
        let knots: Vec<f64> = (0..=last)
            .filter(is_sharp)
            .map(|i| low + i as f64 / scale)
            .collect();
        Self {
            knots,
            source,
            table,
            low,
            scale,
        }
    }

    /// Returns red, green and blue times extinction, and extinction \[1/length\].
    #[inline]
    pub(super) fn light(&self, value: f64) -> [f64; 4] {
        let last = (self.table.len() - 1) as f64;
        let x = ((value - self.low) * self.scale).clamp(0.0, last);
        // Casts saturate, and NaN becomes 0.
        let i = (x as usize).min(self.table.len() - 2);
        let s = x - i as f64;
        let (a, b) = (&self.table[i], &self.table[i + 1]);
        light([0, 1, 2, 3].map(|c| a[c] + (b[c] - a[c]) * s))
    }

    /// Returns an upper bound of the extinction over all values between two.
    pub(super) fn most_extinction(&self, a: f64, b: f64) -> f64 {
        // The bound is wider by two entries, far more than rounding.
        f64::from(self.source.max_extinction(a as f32, b as f32))
    }

    /// Returns the knots strictly between two values, `low` not greater than `high`.
    pub(super) fn knots(&self, low: f64, high: f64) -> &[f64] {
        let first = self.knots.partition_point(|k| *k <= low);
        let end = self.knots.partition_point(|k| *k < high);
        self.knots.get(first..end).unwrap_or(&[])
    }
}

fn light([r, g, b, extinction]: [f64; 4]) -> [f64; 4] {
    [r * extinction, g * extinction, b * extinction, extinction]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ColourSpace, ControlPoint};

    #[test]
    fn the_table_is_that_of_classify_and_its_corners_are_knots() {
        let point = |value: f32, opacity: f32| ControlPoint {
            value,
            colour: Some([1.0, value / 10.0, 0.2]),
            opacity: Some(opacity),
        };
        let points = [
            point(0.0, 0.0),
            point(2.0, 0.0),
            point(4.0, 0.5),
            point(4.0, 0.1),
            point(10.0, 0.1),
        ];
        let source =
            TransferFunction::from_points(&points, ColourSpace::Linear, [0.0, 10.0], 0.1).unwrap();
        let function = Function::new(source.clone());
        for i in 0..1000_u16 {
            let value = f64::from(i) * 0.012 - 1.0;
            let [r, g, b, extinction] = source.classify(value as f32).map(f64::from);
            let light = function.light(value);
            let expected = [r * extinction, g * extinction, b * extinction, extinction];
            for (a, b) in light.iter().zip(expected) {
                // A value in f32 is off by 6e-8 of 10: 2.5e-3 of the step's ramp, which is 7 high.
                assert!((a - b).abs() < 0.02, "{value}: {a} {b}");
            }
        }
        // Knots where opacity begins and falls, and at the ends of the table, where colours stop.
        assert!(!function.knots(1.99, 2.01).is_empty());
        assert!(!function.knots(3.99, 4.01).is_empty());
        assert!(function.knots(2.5, 3.5).is_empty() && function.knots(5.0, 9.0).is_empty());
        assert_eq!(function.most_extinction(0.1, 1.9), 0.0);
        assert!(function.most_extinction(0.0, 3.0) >= function.light(3.0)[3]);
    }
}
