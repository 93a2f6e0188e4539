//! Computes how much a value is worth seeing.

use super::background::Background;
use super::value_sample::{Surroundings, ValueSample};

/// Number of the histogram's bins, if there are enough values.
const BIN_COUNT: usize = 256;

/// Least worth of a visible value, on a scale to 1, beside a background. Values worth less are fully
/// transparent, so that particles with them are never projected.
const VISIBLE_WEIGHT: f64 = 0.02;

/// Least worth of any value of a body, so that no part of it disappears.
const LEAST_OF_A_BODY: f64 = 0.1;

/// How much a value is worth seeing, 0..1, by its distance from the ordinary value and how rare such distances
/// are.
pub(super) struct Worth {
    pub(super) lo: f64,
    pub(super) hi: f64,
    /// The background's value; a body's median.
    ordinary: f64,
    /// Distances from the ordinary value in rising order, each with the volume up to it.
    distances: Vec<(f64, f64)>,
    /// The volume of all samples.
    total: f64,
    /// Share of the volume that is background: within its half width of its middle.
    background_share: f64,
    /// The value of the background that lies farthest out.
    background_outer: f64,
    /// Whether the low end is padding and belongs to the background.
    is_padded: bool,
    /// Lengths that count as distance 1, below and above the ordinary value.
    scales: [f64; 2],
    surroundings: Surroundings,
}

impl Worth {
    /// - `sample`: on the function's scale, as the range is.
    /// - `neutral`: the ordinary value; `None` to find it.
    pub(super) fn new(sample: &ValueSample, [lo, hi]: [f32; 2], neutral: Option<f32>) -> Self {
        let (lo, hi) = (f64::from(lo), f64::from(hi));
        let samples = &sample.samples;
        let bin_count = (samples.len() / 32).clamp(16, BIN_COUNT);
        let background = match (neutral, sample.surroundings) {
            (None, Surroundings::Included) => Background::of(sample, [lo, hi], bin_count),
            (neutral, _) => {
                let median = || sample.at_volume(0.5).unwrap_or(lo).clamp(lo, hi);
                let ordinary = neutral.map_or_else(median, f64::from);
                Background::narrow(ordinary, [lo, hi], bin_count)
            }
        };
        let ordinary = background.ordinary;
        let mut distances: Vec<(f64, f64)> = samples
            .iter()
            .map(|s| ((s.value.clamp(lo, hi) - ordinary).abs(), s.volume))
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
            // The running sum itself, so that the last share is 1.
            total: up_to,
            background_share: 0.0,
            background_outer: background.outer,
            is_padded: background.is_padded,
            scales: [below, above].map(|side| (side * longer).sqrt()),
            surroundings: sample.surroundings,
        };
        if sample.surroundings == Surroundings::Included {
            worth.background_share = worth.share_within(background.half);
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
            Surroundings::Included if self.is_padded && value < self.ordinary => 0.0,
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

    /// The background's position in the range, 0..1; 0 for constant data.
    pub(super) fn background_place(&self) -> f64 {
        (self.background_outer - self.lo) / (self.hi - self.lo).max(f64::MIN_POSITIVE)
    }
}
