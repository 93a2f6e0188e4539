//! How much a value is worth seeing.

use super::value_sample::{Surroundings, ValueSample};

/// Bins of the histogram, where there are values enough.
const BIN_COUNT: usize = 256;

/// How many times its even share the fullest bin must hold to count as the background.
const BACKGROUND_DOMINANCE: f64 = 3.0;

/// Beside a background, values less worth seeing than this, on a scale to 1, are left quite transparent: what is
/// nowhere visible is never projected.
const VISIBLE_WEIGHT: f64 = 0.02;

/// What any value of a body is worth at least: none of it disappears.
const LEAST_OF_A_BODY: f64 = 0.1;

/// How much a value is worth seeing, 0..1, by how far it lies from the ordinary one and how rare it is that far.
pub(super) struct Worth {
    pub(super) lo: f64,
    pub(super) hi: f64,
    /// The background's; a body's median.
    ordinary: f64,
    /// Distances from the ordinary value in rising order, each with the volume up to it.
    distances: Vec<(f64, f64)>,
    /// The volume of all samples.
    total: f64,
    /// Share of the volume that is background: nearer to it than half a bin.
    background_share: f64,
    /// Lengths that count as distance 1, below and above the ordinary value.
    scales: [f64; 2],
    surroundings: Surroundings,
}

impl Worth {
    /// - `sample`: on the scale that the function lies on, as the range is.
    /// - `neutral`: the ordinary value, where it is not looked for.
    pub(super) fn new(sample: &ValueSample, [lo, hi]: [f32; 2], neutral: Option<f32>) -> Self {
        let (lo, hi) = (f64::from(lo), f64::from(hi));
        let samples = &sample.samples;
        let bin_count = (samples.len() / 32).clamp(16, BIN_COUNT);
        let width = (hi - lo) / bin_count as f64;
        let ordinary = match (neutral, sample.surroundings) {
            (Some(neutral), _) => f64::from(neutral),
            (None, Surroundings::Included) => {
                fullest_bin(sample, [lo, hi], bin_count).unwrap_or(lo)
            }
            (None, Surroundings::Absent) => {
                let median = sample.at_volume(0.5).map_or(lo, f64::from);
                median.clamp(lo, hi)
            }
        };
        let mut distances: Vec<(f64, f64)> = samples
            .iter()
            .map(|s| {
                (
                    (f64::from(s.value).clamp(lo, hi) - ordinary).abs(),
                    s.volume,
                )
            })
            .collect();
        distances.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut up_to = 0.0;
        for (_, volume) in &mut distances {
            up_to += *volume;
            *volume = up_to;
        }
        let (below, above) = (ordinary - lo, hi - ordinary);
        let longer = below.max(above);
        let mut worth = Self {
            lo,
            hi,
            ordinary,
            distances,
            // As the running sum has it, so that the last share is 1.
            total: up_to,
            background_share: 0.0,
            scales: [below, above].map(|side| (side * longer).sqrt()),
            surroundings: sample.surroundings,
        };
        if sample.surroundings == Surroundings::Included {
            worth.background_share = worth.share_within(0.5 * width);
        }
        worth
    }

    /// The share of the volume whose values lie within a distance of the ordinary one.
    fn share_within(&self, distance: f64) -> f64 {
        let count = self.distances.partition_point(|d| d.0 <= distance);
        match count.checked_sub(1) {
            Some(last) => self.distances[last].1 / self.total,
            None => 0.0,
        }
    }

    pub(super) fn of(&self, value: f64) -> f64 {
        if self.hi <= self.lo {
            return 1.0;
        }
        let distance = (value - self.ordinary).abs();
        let scale = self.scales[usize::from(value > self.ordinary)];
        let is_far = if distance > 0.0 { 1.0 } else { 0.0 };
        match self.surroundings {
            Surroundings::Included if scale <= 0.0 || self.background_share >= 1.0 => is_far,
            Surroundings::Included => {
                let rank = ((self.share_within(distance) - self.background_share)
                    / (1.0 - self.background_share))
                    .max(0.0);
                let worth = rank * rank * (distance / scale).min(1.0);
                ((worth - VISIBLE_WEIGHT) / (1.0 - VISIBLE_WEIGHT)).max(0.0)
            }
            Surroundings::Absent => {
                let far = match scale > 0.0 {
                    true => (distance / scale).min(1.0),
                    false => is_far,
                };
                let rare = self.share_within(distance);
                LEAST_OF_A_BODY + (1.0 - LEAST_OF_A_BODY) * far * rare
            }
        }
    }

    /// Where in the range the background lies, 0..1; 0 for constant data.
    pub(super) fn background_place(&self) -> f64 {
        (self.ordinary - self.lo) / (self.hi - self.lo).max(f64::MIN_POSITIVE)
    }
}

/// The middle of the bin with the greatest volume, if that is three times its even share.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a bin's index, within the histogram"
)]
fn fullest_bin(sample: &ValueSample, [lo, hi]: [f64; 2], bin_count: usize) -> Option<f64> {
    let width = (hi - lo) / bin_count as f64;
    if width <= 0.0 {
        return None;
    }
    let mut histogram = vec![0.0; bin_count];
    for s in &sample.samples {
        let bin = ((f64::from(s.value).clamp(lo, hi) - lo) / width) as usize;
        histogram[bin.min(bin_count - 1)] += s.volume;
    }
    let total: f64 = histogram.iter().sum();
    let (fullest, volume) =
        histogram.iter().enumerate().fold(
            (0, 0.0),
            |best, (i, &v)| if v > best.1 { (i, v) } else { best },
        );
    // The lowest one is the low end itself.
    let is_background = volume >= BACKGROUND_DOMINANCE * total / bin_count as f64 && fullest > 0;
    is_background.then_some(lo + (fullest as f64 + 0.5) * width)
}
