//! Finds the background of data that include surroundings: air in a scan, the free stream of a flow.

use super::value_sample::{Sample, ValueSample};

/// Least ratio of the fullest bin to its even share, for the bin to count as the background.
const DOMINANCE: f64 = 3.0;

/// Number of bins in which a broad mode is looked for.
const MODE_BINS: usize = 64;

/// A mode extends to where a bin has less than this share of the peak.
const MODE_EDGE: f64 = 0.25;

/// A mode is broad if no value has more than this share of it.
const BROAD_SHARE: f64 = 0.25;

/// The greatest shares of the volume of a saturated level and of padding; a level with more is a background.
const MOST_SATURATED: f64 = 0.1;
const MOST_PADDING: f64 = 0.25;

/// Greatest gap in bins between a mode and the end of the values, and between padding and a mode.
const BINS_BESIDE: usize = 2;

/// The background of a range of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Background {
    /// Middle of the background.
    pub(super) ordinary: f64,
    /// Half width: values no farther from the middle belong to the background.
    pub(super) half: f64,
    /// The background's value that lies farthest out.
    pub(super) outer: f64,
    /// Whether the low end of the range belongs to the background, too.
    pub(super) is_padded: bool,
}

impl Background {
    /// - `bin_count`: the number of bins of the fine histogram.
    pub(super) fn of(sample: &ValueSample, [lo, hi]: [f64; 2], bin_count: usize) -> Self {
        let histogram = Histogram::new(&sample.samples, [lo, hi], bin_count);
        let fullest = histogram.fullest();
        let is_background = |bin: usize| {
            // Bin 0 is the low end itself.
            histogram.bins[bin] >= DOMINANCE * histogram.total() / bin_count as f64 && bin > 0
        };
        let chosen = fullest.filter(|&bin| is_background(bin));
        let ordinary = chosen.map_or(lo, |bin| histogram.middle(bin));
        broad_mode(sample, [lo, hi], chosen, bin_count)
            .unwrap_or_else(|| Self::narrow(ordinary, [lo, hi], bin_count))
    }

    /// A background as wide as one bin.
    pub(super) fn narrow(ordinary: f64, [lo, hi]: [f64; 2], bin_count: usize) -> Self {
        Self {
            ordinary,
            half: 0.5 * ((hi - lo) / bin_count as f64),
            outer: ordinary,
            is_padded: false,
        }
    }
}

/// Finds the broad mode at an end of the values, if the fullest bin is one saturated or padded level.
fn broad_mode(
    sample: &ValueSample,
    [lo, hi]: [f64; 2],
    fullest: Option<usize>,
    bin_count: usize,
) -> Option<Background> {
    let samples = sample.samples.as_slice();
    let volume = |of: &[Sample]| of.iter().map(|s| s.volume).sum::<f64>();
    let total = volume(samples);
    let below = samples.partition_point(|s| s.value <= lo);
    let above = samples.partition_point(|s| s.value < hi);
    let least = DOMINANCE * total / bin_count as f64;
    let [low, high] = [volume(&samples[..below]), volume(&samples[above..])];
    let is_level = |level: f64, most: f64| level >= least && level <= most * total;
    // The level that the fine histogram takes for the background: at either end, or between.
    let level = match fullest {
        Some(bin) if bin + 1 == bin_count && is_level(high, MOST_SATURATED) => high,
        None if is_level(low, MOST_PADDING) => low,
        _ => return None,
    };
    let first = if is_level(low, MOST_PADDING) {
        below
    } else {
        0
    };
    let last = match is_level(high, MOST_SATURATED) {
        true => above,
        false => samples.len(),
    };
    let inner = samples.get(first..last).filter(|inner| !inner.is_empty())?;
    let ends = [inner[0].value.max(lo), inner[inner.len() - 1].value.min(hi)];
    let mut histogram = Histogram::new(inner, ends, MODE_BINS);
    histogram.smooth();
    let bin = histogram.width();
    let found = histogram.modes().filter_map(|(start, end)| {
        let (is_low, is_high) = (start <= BINS_BESIDE, end + BINS_BESIDE >= MODE_BINS);
        let [from, to] = [start, end].map(|bin_end| ends[0] + bin_end as f64 * bin);
        let of_mode = inner.partition_point(|s| s.value < from);
        let of_mode = &inner[of_mode..inner.partition_point(|s| s.value <= to)];
        let is_broad = fullest_level(of_mode) <= BROAD_SHARE * volume(of_mode);
        (is_low != is_high && is_broad).then(|| (volume(of_mode), from, to, is_low))
    });
    let (mode, from, to, is_low) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if mode <= level {
        return None;
    }
    let has_gap = ends[0] - lo > BINS_BESIDE as f64 * bin;
    let is_padded = is_low && first > 0 && has_gap;
    // Noise that is cut off at the low end has its background there; padding on the other side does not count.
    let is_found = match fullest {
        Some(_) => true,
        None => is_padded || (!is_low && is_level(low, MOST_SATURATED)),
    };
    is_found.then_some(Background {
        ordinary: from.midpoint(to),
        half: 0.5 * (to - from),
        outer: if is_low { from } else { to },
        is_padded,
    })
}

/// The greatest volume of a single value.
fn fullest_level(samples: &[Sample]) -> f64 {
    let levels = samples.chunk_by(|a, b| a.value >= b.value);
    let volumes = levels.map(|level| level.iter().map(|s| s.volume).sum());
    volumes.fold(0.0, f64::max)
}

/// Volumes by values.
struct Histogram {
    bins: Vec<f64>,
    ends: [f64; 2],
}

impl Histogram {
    /// - `ends`: ends of the bins; values outside are counted in the first and the last one.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a bin's index, within the histogram"
    )]
    fn new(samples: &[Sample], [lo, hi]: [f64; 2], count: usize) -> Self {
        let mut bins = vec![0.0; count];
        let width = (hi - lo) / count as f64;
        if width > 0.0 {
            for s in samples {
                let bin = ((s.value.clamp(lo, hi) - lo) / width) as usize;
                bins[bin.min(count - 1)] += s.volume;
            }
        }
        let ends = [lo, hi];
        Self { bins, ends }
    }

    fn width(&self) -> f64 {
        (self.ends[1] - self.ends[0]) / self.bins.len() as f64
    }

    fn middle(&self, bin: usize) -> f64 {
        self.ends[0] + (bin as f64 + 0.5) * self.width()
    }

    fn total(&self) -> f64 {
        self.bins.iter().sum()
    }

    /// The first of the fullest bins; `None` if all are empty.
    fn fullest(&self) -> Option<usize> {
        let bins = self.bins.iter().enumerate();
        let none = (None, 0.0);
        bins.fold(
            none,
            |best, (i, &v)| if v > best.1 { (Some(i), v) } else { best },
        )
        .0
    }

    /// The modes, the fullest first, each from its first bin to the bin after its last. A mode extends around a
    /// peak over bins that have a share of it and belong to no earlier mode.
    fn modes(&self) -> impl Iterator<Item = (usize, usize)> {
        let mut left = self.bins.clone();
        std::iter::from_fn(move || {
            let peak = (0..left.len()).max_by(|&a, &b| left[a].total_cmp(&left[b]))?;
            let edge = MODE_EDGE * left[peak];
            if edge <= 0.0 {
                return None;
            }
            let start = (0..peak).rev().take_while(|&bin| left[bin] >= edge).last();
            let end = (peak..left.len())
                .take_while(|&bin| left[bin] >= edge)
                .last();
            let (start, end) = (start.unwrap_or(peak), end.unwrap_or(peak) + 1);
            left[start..end].fill(0.0);
            Some((start, end))
        })
    }

    /// Averages each bin with its neighbours, with weights 1, 2 and 1; the end bins are repeated beyond the
    /// ends.
    fn smooth(&mut self) {
        let of = |i: usize| self.bins[i];
        let last = self.bins.len().saturating_sub(1);
        let mean =
            |i: usize| 0.25 * (of(i.saturating_sub(1)) + 2.0 * of(i) + of((i + 1).min(last)));
        self.bins = (0..self.bins.len()).map(mean).collect();
    }
}
