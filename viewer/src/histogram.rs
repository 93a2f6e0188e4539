//! Counts values along the range of a transfer function.

use ewa_splat::scene::{TransferFunction, Values};

/// Number of bars of a histogram.
const BARS: usize = 128;

/// Counts of values in equal parts of a transfer function's range.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Histogram {
    pub(crate) counts: Vec<u32>,
}

impl Histogram {
    /// Counts the values of a volume, which are positions on its function's scale. Values beyond
    /// the range count in the outermost bars; NaN does not count.
    pub(crate) fn of(values: &Values, function: &TransferFunction) -> Self {
        let mut counts = vec![0_u32; BARS];
        let [lo, hi] = function.range();
        for i in 0..values.len() {
            let share = (values.get(i) - lo) / (hi - lo);
            if share.is_finite() {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "from 0 to the number of bars"
                )]
                let bar = (share.clamp(0.0, 1.0) * BARS as f32) as usize;
                let count = &mut counts[bar.min(BARS - 1)];
                *count = count.saturating_add(1);
            }
        }
        Self { counts }
    }

    /// Returns the heights of the bars, scaled to a maximum of 1.
    pub(crate) fn heights(&self, is_logarithmic: bool) -> Vec<f32> {
        let height = |count: &u32| {
            let count = *count as f32;
            if is_logarithmic { count.ln_1p() } else { count }
        };
        let heights: Vec<f32> = self.counts.iter().map(height).collect();
        let greatest = heights.iter().copied().fold(0.0, f32::max);
        heights.iter().map(|h| h / greatest.max(1e-9)).collect()
    }
}

#[cfg(test)]
mod tests {
    use ewa_splat::scene::{AutomaticOptions, ScaleName, ValueSample};

    use super::*;

    #[test]
    fn values_are_counted_along_the_range() {
        let function =
            TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, [0.0, 128.0], 1.0).unwrap();
        let values = Values::F32(vec![-5.0, 0.5, 64.5, 64.6, 127.9, 500.0, f32::NAN]);
        let histogram = Histogram::of(&values, &function);
        assert_eq!(histogram.counts[0], 2);
        assert_eq!(histogram.counts[64], 2);
        assert_eq!(histogram.counts[127], 2);
        assert_eq!(histogram.counts.iter().sum::<u32>(), 6);
        assert_eq!(histogram.heights(false)[64], 1.0);
        assert_eq!(histogram.heights(true)[1], 0.0);
    }

    /// The values of a field that spans decades are stored in a volume as logarithms.
    #[test]
    fn logarithms_are_not_taken_twice() {
        let values = Values::F32((0..128).map(|i| 10_f32.powi(i / 32)).collect());
        let positions: Vec<glam::DVec3> = (0..128).map(|i| glam::DVec3::X * f64::from(i)).collect();
        let sample = ValueSample::of_body(&values, &[1.0; 128], &positions);
        let options = AutomaticOptions {
            range: Some([1.0, 1e4]),
            scale: Some(ScaleName::Log),
            ..AutomaticOptions::default()
        };
        let function = TransferFunction::automatic(&sample, &options).unwrap();
        let positions = function.value_scale().positions(values);
        let counts = Histogram::of(&positions, &function).counts;
        // 1, 10, 100 and 1000 divide the range into equal parts.
        let high: Vec<usize> = (0..128).filter(|&i| counts[i] > 0).collect();
        assert_eq!(high.len(), 4);
        for (bar, quarter) in high.iter().zip([0, 32, 64, 96]) {
            assert!(bar.abs_diff(quarter) <= 1, "{high:?}");
            assert_eq!(counts[*bar], 32);
        }
    }
}
