//! A transfer function from the data themselves, for a first look.

use super::colour_maps::{ColourMap, DIVERGING, colour_map, known_map, over_range};
use super::{TransferDefaults, TransferFunction};
use crate::error::{Error, Result};
use crate::scene::Values;

/// Share of the values left outside the range at either end.
const TAIL: f64 = 0.001;

/// Values looked at; more are sampled evenly. At 2^18 the thousandth at either end is still
/// 262 values.
const SAMPLE_LEN: usize = 1 << 18;

/// Bins of the histogram, where there are values enough.
const BIN_COUNT: usize = 256;

/// How many times its even share the fullest bin must hold to count as the background.
const BACKGROUND_DOMINANCE: f64 = 3.0;

/// Values less worth seeing than this, on a scale to 1, are left quite transparent: what is
/// nowhere visible is never projected.
const VISIBLE_WEIGHT: f64 = 0.02;

/// The optical depth aimed at along a line through the data, were its values spread evenly.
/// Interesting values lie together. Medians over the axis-parallel lines through the middle
/// quarter, by axis: engine (CT) 2.3, 3.2, 1.6; nucleon 4.9, 4.9, 5.0.
const MEAN_DEPTH: f64 = 1.5;

/// The greatest optical depth per unit distance (opacity .95): beyond it a single sample hides
/// all behind it and the picture shows its kernels.
const MAX_DEPTH_PER_UNIT: f64 = 3.0;

impl TransferFunction {
    /// A transfer function that shows what is rare in the values and far from their background.
    ///
    /// - Range: the finite values less the thousandth at either end.
    /// - Background: the bin of the histogram with the greatest volume (air in a scan, the free
    ///   stream of a flow, what lies around a cloud), if it holds three times its even share, and else the low end.
    /// - Worth of a value: rank² x distance. Distance is from the background, 0 there and
    ///   at most 1 (a shorter side counts as the geometric mean of both sides); rank is the
    ///   share of the volume outside the background whose values lie no farther from it. What is
    ///   worth less than .02 is transparent.
    /// - Extinction: in proportion to worth, such that a line through the whole volume, as long
    ///   as its cube root, has an optical depth of 1.5 on average; at most 3 per unit distance.
    /// - Colours: inferno where the background lies in the lowest tenth of the range, inferno
    ///   from bright to dark where in the highest, so that what is far from it is bright; else
    ///   viridis.
    ///
    /// `volumes` are those that the values stand for \[length³\], one each; if empty, each value
    /// stands for a cube of the unit distance, as on a lattice. `range` is taken in place of the values' own,
    /// where it is given: those outside count as its ends. `defaults.range` is used where
    /// no value is finite. Constant data are evenly translucent.
    ///
    /// # Errors
    /// A range whose ends do not rise; a unit distance that is not positive.
    pub fn automatic(
        values: &Values,
        volumes: &[f32],
        range: Option<[f32; 2]>,
        defaults: &TransferDefaults,
    ) -> Result<Self> {
        Self::fitted(
            values,
            volumes,
            range,
            defaults,
            |_| None,
            |worth| {
                let place = worth.background_place();
                let at_an_end = !(0.1..=0.9).contains(&place);
                let map = colour_map(if at_an_end { "inferno" } else { "viridis" });
                (map, place > 0.9)
            },
        )
    }

    /// [`TransferFunction::automatic`] in the colours of a named map, from the low end to the high one. A map that
    /// diverges (`coolwarm`) has its neutral colour at 0, if the values lie on both sides of that, and else in the middle
    /// of their range, which it makes even to either side: that is then the background, and opacity grows away from it.
    ///
    /// # Errors
    /// An unknown name; a range whose ends do not rise; a unit distance that is not positive.
    pub fn automatic_in(
        name: &str,
        values: &Values,
        volumes: &[f32],
        range: Option<[f32; 2]>,
        defaults: &TransferDefaults,
    ) -> Result<Self> {
        let map = known_map(name)?;
        let neutral = |[lo, hi]: [f32; 2]| {
            let is_diverging = DIVERGING.contains(&name.to_ascii_lowercase().as_str());
            let middle = if lo < 0.0 && hi > 0.0 {
                0.0
            } else {
                lo + 0.5 * (hi - lo)
            };
            is_diverging.then_some(middle)
        };
        Self::fitted(values, volumes, range, defaults, neutral, |_| {
            (Some(map), false)
        })
    }

    /// - `neutral`: the background of a range, where it is not looked for.
    /// - `colours`: the map, and whether it is taken from bright to dark.
    fn fitted(
        values: &Values,
        volumes: &[f32],
        range: Option<[f32; 2]>,
        defaults: &TransferDefaults,
        neutral: impl Fn([f32; 2]) -> Option<f32>,
        colours: impl FnOnce(&Worth) -> (Option<ColourMap>, bool),
    ) -> Result<Self> {
        let sorted = sorted_sample(values, volumes);
        if let Some([lo, hi]) = range
            && !(lo < hi && lo.is_finite() && hi.is_finite())
        {
            return Err(Error::invalid(
                "transfer function",
                "range",
                "two finite numbers that rise",
                format!("{lo},{hi}"),
                "give the lower end first",
            ));
        }
        let Some(own) = trimmed_range(&sorted) else {
            let range = range.unwrap_or(defaults.range);
            return Self::from_curves(|_| [1.0; 3], |_| 0.0, range, 1.0)?
                .with_unit_distance(defaults.unit_distance);
        };
        let is_given = range.is_some();
        let mut range = range.unwrap_or(own);
        let neutral = neutral(range);
        if let (Some(middle), false) = (neutral, is_given) {
            let half = (range[1] - middle).max(middle - range[0]);
            range = [middle - half, middle + half];
        }
        let worth = Worth::new(&sorted, range, neutral);
        let path = if volumes.is_empty() {
            (values.len() as f64).cbrt()
        } else {
            let total: f64 = volumes.iter().copied().map(f64::from).sum();
            total.cbrt() / defaults.unit_distance
        };
        let weighted =
            |s: &Sample| s.volume * worth.of(f64::from(s.value).clamp(worth.lo, worth.hi));
        let mean = sorted.iter().map(weighted).sum::<f64>() / worth.total;
        // Depth per unit distance of a value worth 1.
        let peak = (MEAN_DEPTH / (path * mean.max(f64::MIN_POSITIVE))).min(MAX_DEPTH_PER_UNIT);
        let (map, is_reversed) = colours(&worth);
        let over_range = over_range(range);
        let fraction = |value: f32| {
            let fraction = over_range(value);
            if is_reversed {
                1.0 - fraction
            } else {
                fraction
            }
        };
        Self::from_curves(
            |value| {
                map.as_ref()
                    .map_or([1.0; 3], |colour| colour(fraction(value)))
            },
            |value| {
                let depth = peak * worth.of(f64::from(value));
                #[expect(clippy::cast_possible_truncation, reason = "0..1")]
                {
                    -(-depth).exp_m1() as f32
                }
            },
            range,
            defaults.unit_distance,
        )
    }
}

/// A value and the volume it stands for.
#[derive(Clone, Copy)]
struct Sample {
    value: f32,
    volume: f64,
}

/// The finite values in rising order: all, or [`SAMPLE_LEN`] spread over them.
#[expect(
    clippy::cast_possible_truncation,
    reason = "an index below the count of values"
)]
fn sorted_sample(values: &Values, volumes: &[f32]) -> Vec<Sample> {
    let n = values.len();
    let at = |i: usize| Sample {
        value: values.get(i),
        volume: volumes.get(i).copied().map_or(1.0, f64::from),
    };
    let mut sample: Vec<Sample> = if n <= SAMPLE_LEN {
        (0..n).map(at).collect()
    } else {
        // One from each of SAMPLE_LEN equal runs, at a place that hashing picks: a fixed
        // stride would meet the same columns of every row.
        (0..SAMPLE_LEN as u64)
            .map(|k| {
                let first = (u128::from(k) * n as u128 / SAMPLE_LEN as u128) as u64;
                let next = (u128::from(k + 1) * n as u128 / SAMPLE_LEN as u128) as u64;
                at((first + split_mix(k) % (next - first).max(1)) as usize)
            })
            .collect()
    };
    sample.retain(|s| s.value.is_finite() && s.volume > 0.0 && s.volume.is_finite());
    sample.sort_unstable_by(|a, b| a.value.total_cmp(&b.value));
    sample
}

/// The output function of SplitMix64 (Steele, Lea, Flood 2014).
fn split_mix(k: u64) -> u64 {
    let z = k.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The values without their tails; with them where nothing would be left between.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a length"
)]
fn trimmed_range(sorted: &[Sample]) -> Option<[f32; 2]> {
    let last = sorted.len().checked_sub(1)?;
    let tail = (TAIL * last as f64) as usize;
    let trimmed = [sorted[tail].value, sorted[last - tail].value];
    Some(if trimmed[0] < trimmed[1] {
        trimmed
    } else {
        [sorted[0].value, sorted[last].value]
    })
}

/// How much a value is worth seeing, 0..1.
struct Worth {
    lo: f64,
    hi: f64,
    background: f64,
    /// Distances from the background in rising order, each with the volume up to it.
    distances: Vec<(f64, f64)>,
    /// The volume of all samples.
    total: f64,
    /// Share of the volume that is background: nearer to it than half a bin.
    background_share: f64,
    /// Lengths that count as distance 1, below and above the background.
    scales: [f64; 2],
}

impl Worth {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a bin's index, within the histogram"
    )]
    fn new(sorted: &[Sample], [lo, hi]: [f32; 2], neutral: Option<f32>) -> Self {
        let (lo, hi) = (f64::from(lo), f64::from(hi));
        let clamped = |s: &Sample| f64::from(s.value).clamp(lo, hi);
        let total: f64 = sorted.iter().map(|s| s.volume).sum();
        let bin_count = (sorted.len() / 32).clamp(16, BIN_COUNT);
        let width = (hi - lo) / bin_count as f64;
        let mut histogram = vec![0.0; bin_count];
        if width > 0.0 {
            for s in sorted {
                let bin = ((clamped(s) - lo) / width) as usize;
                histogram[bin.min(bin_count - 1)] += s.volume;
            }
        }
        let (fullest, volume) =
            histogram.iter().enumerate().fold(
                (0, 0.0),
                |best, (i, &v)| if v > best.1 { (i, v) } else { best },
            );
        let even_share = total / bin_count as f64;
        let background = if let Some(neutral) = neutral {
            f64::from(neutral)
        } else if volume >= BACKGROUND_DOMINANCE * even_share && fullest > 0 {
            lo + (fullest as f64 + 0.5) * width
        } else {
            lo
        };
        let mut distances: Vec<(f64, f64)> = sorted
            .iter()
            .map(|s| ((clamped(s) - background).abs(), s.volume))
            .collect();
        distances.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut up_to = 0.0;
        for (_, volume) in &mut distances {
            up_to += *volume;
            *volume = up_to;
        }
        let (below, above) = (background - lo, hi - background);
        let longer = below.max(above);
        let mut worth = Self {
            lo,
            hi,
            background,
            distances,
            // As the running sum has it, so that the last share is 1.
            total: up_to,
            background_share: 0.0,
            scales: [below, above].map(|side| (side * longer).sqrt()),
        };
        worth.background_share = worth.share_within(0.5 * width);
        worth
    }

    /// The share of the volume whose values lie within a distance of the background.
    fn share_within(&self, distance: f64) -> f64 {
        let count = self.distances.partition_point(|d| d.0 <= distance);
        match count.checked_sub(1) {
            Some(last) => self.distances[last].1 / self.total,
            None => 0.0,
        }
    }

    fn of(&self, value: f64) -> f64 {
        if self.hi <= self.lo {
            return 1.0;
        }
        let distance = (value - self.background).abs();
        let scale = self.scales[usize::from(value > self.background)];
        if scale <= 0.0 || self.background_share >= 1.0 {
            return if distance > 0.0 { 1.0 } else { 0.0 };
        }
        let rank = ((self.share_within(distance) - self.background_share)
            / (1.0 - self.background_share))
            .max(0.0);
        let worth = rank * rank * (distance / scale).min(1.0);
        ((worth - VISIBLE_WEIGHT) / (1.0 - VISIBLE_WEIGHT)).max(0.0)
    }

    /// Where in the range the background lies, 0..1; 0 for constant data.
    fn background_place(&self) -> f64 {
        (self.background - self.lo) / (self.hi - self.lo).max(f64::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn automatic(values: Values) -> TransferFunction {
        let defaults = TransferDefaults {
            range: [0.0, 1.0],
            unit_distance: 0.5,
        };
        TransferFunction::automatic(&values, &[], None, &defaults).unwrap()
    }

    /// Mean optical depth of a line through values in random order.
    fn depth(t: &TransferFunction, values: &Values) -> f64 {
        let n = values.len();
        let mean = (0..n)
            .map(|i| f64::from(t.classify(values.get(i))[3]))
            .sum::<f64>()
            / n as f64;
        mean * (n as f64).cbrt() * t.unit_distance()
    }

    #[test]
    fn air_is_transparent_and_metal_is_not() {
        // 60 % air with noise, 30 % aluminium, 10 % steel.
        let values = Values::U8(
            (0..100_000u64)
                .map(|i| {
                    let (kind, noise) = (split_mix(i) % 10, (split_mix(i + 1_000_000) % 9) as u8);
                    match kind {
                        0..6 => noise / 4,
                        6..9 => 96 + noise,
                        _ => 196 + noise,
                    }
                })
                .collect(),
        );
        let t = automatic(values.clone());
        assert!(t.classify(0.0)[3] <= 0.0 && t.classify(2.0)[3] <= 0.0);
        assert!(t.classify(100.0)[3] > 0.0);
        assert!(t.classify(200.0)[3] > 2.0 * t.classify(100.0)[3]);
        assert!((depth(&t, &values) - MEAN_DEPTH).abs() < 0.1);
    }

    #[test]
    fn a_free_stream_inside_the_range_is_transparent() {
        let values = Values::F32(
            (0..40_000u64)
                .map(|i| match split_mix(i) % 10 {
                    0 => 0.2 + 0.8 * i as f32 / 40_000.0,
                    1 | 2 => 1.0 + 4.0 * i as f32 / 40_000.0,
                    _ => 1.0,
                })
                .collect(),
        );
        let t = automatic(values.clone());
        assert!(t.classify(1.0)[3] <= 0.0);
        assert!(t.classify(0.25)[3] > 0.0);
        assert!(t.classify(4.5)[3] > t.classify(0.25)[3]);
        assert!((depth(&t, &values) - MEAN_DEPTH).abs() < 0.1);
    }

    #[test]
    fn the_background_is_what_fills_the_volume() {
        // Most particles lie in a dense cloud, most of the volume around it.
        let values = Values::F32(
            (0..10_000)
                .map(|i| if i < 9000 { 5.0 } else { 1.0 })
                .collect(),
        );
        let volumes: Vec<f32> = (0..10_000)
            .map(|i| if i < 9000 { 0.01 } else { 1.0 })
            .collect();
        let defaults = TransferDefaults {
            range: [1.0, 5.0],
            unit_distance: 0.5,
        };
        let t = TransferFunction::automatic(&values, &volumes, None, &defaults).unwrap();
        assert!(t.classify(1.0)[3] <= 0.0 && t.classify(5.0)[3] > 0.0);
    }

    /// Whole numbers from 0 to 99, as many of each.
    fn hundred() -> (Values, TransferDefaults) {
        let values = (0..50_000u64)
            .map(|i| (split_mix(i) % 100) as f32)
            .collect();
        let defaults = TransferDefaults {
            range: [0.0, 99.0],
            unit_distance: 0.5,
        };
        (Values::F32(values), defaults)
    }

    #[test]
    fn a_named_map_replaces_colours_alone() {
        let (values, defaults) = hundred();
        let named = |name| TransferFunction::automatic_in(name, &values, &[], None, &defaults);
        let own = automatic(values.clone());
        let plasma = named("Plasma").unwrap();
        let map = colour_map("plasma").unwrap();
        for i in 0..100 {
            let value = i as f32;
            assert!((plasma.classify(value)[3] - own.classify(value)[3]).abs() < 1e-5);
            let expected = map(value / 99.0);
            for (a, b) in plasma.classify(value).iter().zip(expected) {
                assert!((a - b).abs() < 0.01, "{value}");
            }
        }
        assert!(named("jet").is_err());
    }

    #[test]
    fn a_given_range_holds() {
        let (values, defaults) = hundred();
        let of = |range| TransferFunction::automatic(&values, &[], Some(range), &defaults);
        let t = of([20.0, 60.0]).unwrap();
        assert_eq!(t.range(), [20.0, 60.0]);
        // What lies beyond counts as the end.
        assert_eq!(t.classify(90.0), t.classify(60.0));
        assert!((depth(&t, &values) - MEAN_DEPTH).abs() < 0.1);
        for range in [
            [3.0, 3.0],
            [4.0, 3.0],
            [f32::NAN, 3.0],
            [0.0, f32::INFINITY],
        ] {
            assert!(of(range).is_err());
        }
    }

    #[test]
    fn a_diverging_map_is_clear_in_its_middle() {
        let of = |low: f32| {
            let value = |i: u64| low + (split_mix(i) % 1000) as f32 / 100.0;
            let values = Values::F32((0..50_000).map(value).collect());
            let defaults = TransferDefaults {
                range: [low, low + 10.0],
                unit_distance: 0.5,
            };
            TransferFunction::automatic_in("coolwarm", &values, &[], None, &defaults).unwrap()
        };
        // From -2 to 8: neutral at 0; from 5 to 15: in the middle.
        for (t, middle) in [(of(-2.0), 0.0), (of(5.0), 10.0)] {
            let alpha = |value: f32| t.classify(middle + value)[3];
            assert!(alpha(0.0) <= 0.0);
            assert!(alpha(1.9) > alpha(1.0) && alpha(-1.9) > alpha(-1.0));
            assert!((alpha(1.9) - alpha(-1.9)).abs() < 0.05 * alpha(1.9));
            let [red, _, blue, _] = t.classify(middle + 1.9);
            assert!(red > blue);
            let [red, _, blue, _] = t.classify(middle - 1.9);
            assert!(blue > red);
        }
    }

    #[test]
    fn poor_data_still_give_a_function() {
        let t = automatic(Values::F32(vec![f32::NAN; 10]));
        assert!(t.classify(0.5)[3] <= 0.0);
        let t = automatic(Values::U8(vec![7; 1000]));
        assert!(t.classify(7.0)[3] > 0.0);
        let t = automatic(Values::F32(vec![]));
        assert!(t.classify(0.5)[3] <= 0.0);
        let mut one = vec![0u8; 10_000];
        one[17] = 255;
        let t = automatic(Values::U8(one));
        assert!(t.classify(0.0)[3] <= 0.0 && t.classify(255.0)[3] > 0.0);
        let t = automatic(Values::F32(vec![f32::MAX, -f32::MAX, 0.0, f32::INFINITY]));
        assert!(t.classify(f32::MAX)[3].is_finite());
    }
}
