//! Chooses a transfer function from the data, for a first look.

mod background;
mod silhouette;
mod value_sample;
mod worth;

pub(crate) use self::value_sample::Surroundings;
pub use self::value_sample::ValueSample;
pub(crate) use self::value_sample::{PickedRow, Tiling};

use self::worth::Worth;
use super::TransferFunction;
use super::colour_maps::{DIVERGING, is_diverging, known_map, over_range};
use super::value_scale::{ScaleName, ValueScale};
use crate::error::{Error, Result};
use crate::math::narrowed;

/// Target optical depth. With a background: along a line, if values were spread evenly. For a body: along a
/// line through its middle. Interesting values of lattices lie together: medians over the axis-parallel lines
/// through the middle quarter are, by axis, 2.3, 3.2, 1.6 for an engine (CT) and 4.9, 4.9, 5.0 for a nucleon.
const DEPTH: f64 = 1.5;

/// Greatest optical depth per unit distance (opacity .95). Beyond it a single sample hides all behind it, and
/// the image shows single kernels.
const MAX_DEPTH_PER_UNIT: f64 = 3.0;

/// Greatest unit distance of flat data, as a share of their thickness: a view that crosses few samples needs
/// more opacity in each.
const PART_OF_FLAT: f64 = 0.25;

/// Least ratio of the values at the ends of a range that may span decades.
const LEAST_DECADES_RATIO: f64 = 1e3;

/// Values over decades have their median in this lowest share of the range, by volume and by count.
const LOW_SHARE: f64 = 0.05;

/// A zero-centred field reaches at least this share of its greatest value on the other side of 0, and
const LEAST_OTHER_SIDE: f64 = 0.25;
/// its median lies within this share of the greatest value around 0.
const ZERO_SHARE: f64 = 0.1;

/// Options of an automatic transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutomaticOptions<'a> {
    /// Name of a map ([`super::COLOUR_MAP_NAMES`]), from the low end to the high one; `None` chooses one.
    pub colour_map: Option<&'a str>,
    /// The range \[values\]; values outside take its ends. `None` uses the values' own range.
    pub range: Option<[f64; 2]>,
    /// The scale; `None` chooses one.
    pub scale: Option<ScaleName>,
    /// Length \[world units\] over which opacities are stated; for flat data at most a quarter of their
    /// thickness.
    pub unit_distance: f64,
}

impl Default for AutomaticOptions<'_> {
    fn default() -> Self {
        Self {
            colour_map: None,
            range: None,
            scale: None,
            unit_distance: 1.0,
        }
    }
}

impl TransferFunction {
    /// Chooses a transfer function that shows rare values far from the ordinary one.
    ///
    /// - Range: the finite values without a thousandth at either end.
    /// - Scale: logarithmic if all values are above 0, the ends of the range differ by a factor of 1000, and
    ///   the medians by count and by volume both lie in its lowest twentieth; else linear.
    /// - Ordinary value, **with surroundings** (lattices, grids): the bin of the histogram with the greatest
    ///   volume (air in a scan, the free stream of a flow), if it holds three times its even share; else the
    ///   low end. If that bin is one saturated level (a least or a greatest value) or padding below all else,
    ///   the broad mode at an end of the other values takes its place, if it holds more. **Without
    ///   surroundings** (cells of a mesh, particles): the median by volume.
    /// - Zero-centred fields have the ordinary value 0, and a range that is symmetric around it. Such a field
    ///   reaches a quarter of its greatest value on the other side of 0, and its median lies within a tenth of
    ///   that value around 0.
    /// - Worth of a value, with surroundings: rank² x distance. Distance is from the ordinary value, 0 there
    ///   and at most 1 (a shorter side counts as the geometric mean of both sides). Rank is the share of the
    ///   volume outside the background whose values lie no farther from the ordinary one. Values worth less
    ///   than .02 are transparent. Without surroundings: .1 + .9 rank x distance, so that no value is
    ///   transparent.
    /// - Extinction: proportional to worth. With surroundings, a line through the whole volume, as long as its
    ///   cube root, has an optical depth of 1.5 on average. Without, lines through the middle have that depth
    ///   (the median of three along the axes, over a quarter of the data's width). For flat data, thinner than
    ///   half the cube root of their volume, the depth is increasingly that across them. The depth is at most 3
    ///   per unit distance; for flat data the unit distance is at most a quarter of their thickness.
    /// - Colours: coolwarm for zero-centred fields. Inferno on a logarithmic scale, and if the background lies
    ///   in the lowest tenth of the range; inferno from bright to dark if it lies in the highest, so that
    ///   values far from it are bright. Else viridis. A named map replaces the colours alone. A diverging one
    ///   (`coolwarm`) has its neutral colour at 0 if the values lie on both sides of it, else in the middle of
    ///   their range; that is then the ordinary value.
    ///
    /// Constant data are evenly translucent. If no value is finite, the range is 0 to 1 and nothing is visible.
    ///
    /// # Errors
    /// An unknown map; a range whose ends do not rise, or that is not above 0 on a logarithmic scale; no values
    /// above 0 on such a scale; a unit distance that is not positive.
    pub fn automatic(sample: &ValueSample, options: &AutomaticOptions<'_>) -> Result<Self> {
        let named = options.colour_map.map(known_map).transpose()?;
        if let Some(range) = options.range {
            check_range(range)?;
        }
        // An opacity over a length far greater than the data has no digits left for the extinctions that would
        // show them.
        let unit = match sample.flat() {
            Some((thickness, _)) if options.unit_distance > 0.0 => {
                (PART_OF_FLAT * thickness).min(options.unit_distance)
            }
            _ => options.unit_distance,
        };
        let Some(own) = sample.trimmed_range() else {
            let range = options.range.unwrap_or([0.0, 1.0]);
            let scale = ValueScale::Linear;
            let positions = range.map(|end| scale.position(end));
            return Self::from_curves(|_| [1.0; 3], |_| 0.0, positions, 1.0)?
                .with_unit_distance(unit);
        };
        let values = options.range.unwrap_or(own);
        // Values that single precision can represent are positions themselves.
        let linear = match sample.is_wide() {
            true => ValueScale::linear_over(values),
            false => ValueScale::Linear,
        };
        let scale = match options.scale {
            Some(ScaleName::Linear) => linear,
            // Over such a small part of their magnitude, logarithms differ from a line by less than an entry of
            // the table.
            Some(_) if linear.is_shifted() => linear,
            Some(name) => ScaleName::over(values, name),
            None if spans_decades(sample, own) && values[0] > 0.0 => ValueScale::Log,
            None => linear,
        };
        let sample = &sample.on(scale);
        let own = sample.trimmed_range().unwrap_or_default();
        let mut range = match options.range {
            None if own.iter().all(|end| end.is_finite()) => own.map(narrowed),
            _ => positions_of(values, scale)?,
        };
        let diverges = match options.colour_map {
            Some(name) => is_diverging(name),
            // The sign must be the value's: a logarithm changes sign at 1.
            None => scale.has_signs() && is_zero_centred(sample, range),
        };
        let [lo, hi] = range;
        let neutral = diverges.then(|| match lo < 0.0 && hi > 0.0 && scale.has_signs() {
            true => 0.0,
            false => lo + 0.5 * (hi - lo),
        });
        if let (Some(middle), None) = (neutral, options.range) {
            let half = (hi - middle).max(middle - lo);
            range = [middle - half, middle + half];
        }
        let worth = Worth::new(sample, range, neutral);
        let length = sample.length_in(|s| worth.of(s.value.clamp(worth.lo, worth.hi)));
        // Depth per unit distance of a value worth 1.
        let peak = (DEPTH * unit / length.max(f64::MIN_POSITIVE)).min(MAX_DEPTH_PER_UNIT);
        let place = worth.background_place();
        let (own_name, is_reversed) = match sample.surroundings {
            _ if diverges => (DIVERGING, false),
            Surroundings::Included if place <= 0.1 => ("inferno", false),
            Surroundings::Included if place > 0.9 => ("inferno", true),
            Surroundings::Absent if scale == ValueScale::Log => ("inferno", false),
            _ => ("viridis", false),
        };
        let is_reversed = is_reversed && named.is_none();
        let map = match named {
            Some(map) => map,
            None => known_map(own_name)?,
        };
        let over_range = over_range(range);
        let fraction = |position: f32| {
            let fraction = over_range(position);
            if is_reversed {
                1.0 - fraction
            } else {
                fraction
            }
        };
        let function = Self::from_curves(
            |position| map(fraction(position)),
            |position| {
                let depth = peak * worth.of(f64::from(position));
                #[expect(clippy::cast_possible_truncation, reason = "0..1")]
                {
                    -(-depth).exp_m1() as f32
                }
            },
            range,
            unit,
        )?;
        Ok(function.on_scale(scale))
    }
}

impl TransferFunction {
    /// An opaque function with the colours of a named map over a range of values.
    ///
    /// # Errors
    /// An unknown map; a range whose ends do not rise, or that is not above 0 on a logarithmic scale.
    pub(crate) fn of_colours(map: &str, range: [f64; 2], scale: ScaleName) -> Result<Self> {
        let map = known_map(map)?;
        let scale = ScaleName::over(range, scale);
        let positions = positions_of(range, scale)?;
        let over_range = over_range(positions);
        let function = Self::from_curves(|p| map(over_range(p)), |_| 1.0, positions, 1.0)?;
        Ok(function.on_scale(scale))
    }
}

/// The positions of a range's ends on a scale; an error if they have none.
fn positions_of([lo, hi]: [f64; 2], scale: ValueScale) -> Result<[f32; 2]> {
    let positions = [lo, hi].map(|end| scale.position(end));
    if positions.iter().all(|end| end.is_finite()) && lo <= hi {
        return Ok(positions);
    }
    Err(Error::invalid(
        "transfer function",
        "range",
        "values that rise, above 0 for a logarithmic scale",
        format!("{lo},{hi}"),
        "take a symlog scale, or a range above 0",
    ))
}

fn check_range([lo, hi]: [f64; 2]) -> Result<()> {
    if lo < hi && lo.is_finite() && hi.is_finite() {
        return Ok(());
    }
    Err(Error::invalid(
        "transfer function",
        "range",
        "two finite numbers that rise",
        format!("{lo},{hi}"),
        "give the lower end first",
    ))
}

/// Whether values are spread over decades, as densities and masses may be.
fn spans_decades(sample: &ValueSample, [lo, hi]: [f64; 2]) -> bool {
    let is_positive = sample.samples.first().is_some_and(|s| s.value > 0.0);
    let is_low = |median: Option<f64>| median.is_some_and(|m| m - lo < LOW_SHARE * (hi - lo));
    is_positive
        && hi / lo >= LEAST_DECADES_RATIO
        && is_low(sample.at_count(0.5))
        && is_low(sample.at_volume(0.5))
}

/// Whether values lie around 0, as components of a velocity or charges may.
fn is_zero_centred(sample: &ValueSample, [lo, hi]: [f32; 2]) -> bool {
    let (lo, hi) = (f64::from(lo), f64::from(hi));
    let greatest = hi.max(-lo);
    let other = hi.min(-lo);
    let median = sample.at_volume(0.5).unwrap_or(f64::INFINITY);
    other >= LEAST_OTHER_SIDE * greatest && other > 0.0 && median.abs() <= ZERO_SHARE * greatest
}

#[cfg(test)]
#[allow(
    clippy::cast_possible_truncation,
    reason = "numbers are narrowed to values on purpose"
)]
mod tests {
    use super::value_sample::split_mix;
    use super::*;
    use crate::scene::transfer_function::colour_maps::colour_map;
    use crate::scene::values::Values;
    use glam::DVec3;

    const OPTIONS: AutomaticOptions<'_> = AutomaticOptions {
        colour_map: None,
        range: None,
        scale: None,
        unit_distance: 0.5,
    };

    fn automatic(values: Values) -> TransferFunction {
        of_lattice(&values, &OPTIONS).unwrap()
    }

    fn of_lattice(values: &Values, options: &AutomaticOptions<'_>) -> Result<TransferFunction> {
        TransferFunction::automatic(&ValueSample::of_grid(values, &[], 0.5), options)
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
        assert!((depth(&t, &values) - DEPTH).abs() < 0.1);
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
        assert!((depth(&t, &values) - DEPTH).abs() < 0.1);
    }

    #[test]
    fn the_background_is_what_fills_the_volume() {
        // Most particles lie in a dense cloud, which has little of the volume.
        let values = Values::F32(
            (0..10_000)
                .map(|i| if i < 9000 { 5.0 } else { 1.0 })
                .collect(),
        );
        let volumes: Vec<f32> = (0..10_000)
            .map(|i| if i < 9000 { 0.01 } else { 1.0 })
            .collect();
        let sample = ValueSample::of_grid(&values, &volumes, 0.5);
        let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
        assert!(t.classify(1.0)[3] <= 0.0 && t.classify(5.0)[3] > 0.0);
    }

    /// Whole numbers from 0 to 99, about equally many of each.
    fn hundred() -> Values {
        let value = |i: u64| (split_mix(i) % 100) as f32;
        Values::F32((0..50_000).map(value).collect())
    }

    fn named(name: &'static str) -> AutomaticOptions<'static> {
        AutomaticOptions {
            colour_map: Some(name),
            ..OPTIONS
        }
    }

    #[test]
    fn a_named_map_replaces_colours_alone() {
        let values = hundred();
        let own = automatic(values.clone());
        let plasma = of_lattice(&values, &named("Plasma")).unwrap();
        let map = colour_map("plasma").unwrap();
        for i in 0..100 {
            let value = i as f32;
            assert!((plasma.classify(value)[3] - own.classify(value)[3]).abs() < 1e-5);
            let expected = map(value / 99.0);
            for (a, b) in plasma.classify(value).iter().zip(expected) {
                assert!((a - b).abs() < 0.01, "{value}");
            }
        }
        assert!(of_lattice(&values, &named("no-such-map")).is_err());
    }

    #[test]
    fn a_given_range_holds() {
        let values = hundred();
        let of = |range| {
            let options = AutomaticOptions {
                range: Some(range),
                ..OPTIONS
            };
            of_lattice(&values, &options)
        };
        let t = of([20.0, 60.0]).unwrap();
        assert_eq!(t.range(), [20.0, 60.0]);
        // Values beyond the range take its end.
        assert_eq!(t.classify(90.0), t.classify(60.0));
        assert!((depth(&t, &values) - DEPTH).abs() < 0.1);
        for range in [
            [3.0, 3.0],
            [4.0, 3.0],
            [f64::NAN, 3.0],
            [0.0, f64::INFINITY],
        ] {
            assert!(of(range).is_err());
        }
    }

    #[test]
    fn a_diverging_map_is_clear_in_its_middle() {
        let of = |low: f32| {
            let value = |i: u64| low + (split_mix(i) % 1000) as f32 / 100.0;
            let values = Values::F32((0..50_000).map(value).collect());
            of_lattice(&values, &named("coolwarm")).unwrap()
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

    /// Values at random positions in a cube of edge 20.
    fn body(count: usize, value: impl Fn(DVec3, f64) -> f64) -> (ValueSample, Values, Vec<DVec3>) {
        let random = |i: u64| split_mix(i) as f64 / u64::MAX as f64;
        let places: Vec<DVec3> = (0..count as u64)
            .map(|i| 20.0 * DVec3::from([0, 1, 2].map(|a| random(4 * i + a))))
            .collect();
        let value = |i: usize| value(places[i], random(4 * i as u64 + 3)) as f32;
        let values = Values::F32((0..count).map(value).collect());
        let volumes = vec![(8000.0 / count as f64) as f32; count];
        let sample = ValueSample::of_body(&values, &volumes, &places);
        (sample, values, places)
    }

    #[test]
    fn a_body_has_no_background() {
        // A shock tube: the dense half has one value, the other half another.
        let tube = |at: DVec3, _: f64| if at.x < 10.0 { 1.0 } else { 0.125 };
        let (sample, ..) = body(20_000, tube);
        let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
        for value in [0.125, 0.5, 1.0] {
            assert!(t.classify(value)[3] > 0.0, "{value}");
        }
        // The greatest is not more than ten times the least.
        let table = t.table().iter().map(|e| e[3]);
        let (least, greatest) = table.fold((f32::MAX, 0f32), |(a, b), e| (a.min(e), b.max(e)));
        assert!(greatest <= 10.01 * least, "{least} {greatest}");
    }

    #[test]
    fn opacity_of_a_body_grows_away_from_its_median() {
        let (sample, ..) = body(20_000, |_, u| 10.0 * u * u);
        let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
        let at = |value: f32| t.classify(value)[3];
        for (near, far) in [(2.6, 4.0), (4.0, 7.0), (7.0, 9.5), (2.3, 1.0), (1.0, 0.1)] {
            assert!(at(far) > at(near), "{near} {far}: {} {}", at(near), at(far));
        }
    }

    #[test]
    fn a_line_through_the_middle_of_a_body_has_the_depth_aimed_at() {
        // Rare values lie in the middle, where the depth is measured: sums over particles in a column.
        let blob = |at: DVec3, u: f64| (-(at - 10.0).length_squared() / 8.0).exp() + 0.01 * u;
        for count in [4_000, 64_000] {
            let (sample, values, places) = body(count, blob);
            let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
            let is_middle = |at: &DVec3| (at.x - 10.0).abs() < 2.5 && (at.y - 10.0).abs() < 2.5;
            let volume = 8000.0 / count as f64;
            let column = (0..count).filter(|&i| is_middle(&places[i]));
            let position = |i: usize| t.value_scale().position(values.wide(i));
            let depths = column.map(|i| f64::from(t.classify(position(i))[3]) * volume / 25.0);
            let depth: f64 = depths.sum();
            // The median of three lines; of 4,000 particles a column has 250, ± 6 %.
            assert!((depth - DEPTH).abs() < 0.3, "{count}: {depth}");
        }
    }

    #[test]
    fn values_over_decades_have_a_logarithmic_scale() {
        // Evenly over 6 decades: the median by count lies at a thousandth of the range.
        let (sample, ..) = body(20_000, |_, u| 10f64.powf(6.0 * u - 27.0));
        let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
        assert_eq!(t.value_scale(), ValueScale::Log);
        let [lo, hi] = t.range();
        assert!(
            (lo + 27.0).abs() < 0.1 && (hi + 21.0).abs() < 0.1,
            "{lo} {hi}"
        );
        let linear = AutomaticOptions {
            scale: Some(ScaleName::Linear),
            ..OPTIONS
        };
        let t = TransferFunction::automatic(&sample, &linear).unwrap();
        assert_eq!(t.value_scale(), ValueScale::Linear);
        // Not for values that reach 0, nor over two decades, nor for decades at the other end.
        for value in [
            |u: f64| if u < 0.01 { 0.0 } else { 10f64.powf(6.0 * u) },
            |u: f64| 10f64.powf(2.0 * u),
            |u: f64| 1e6 - 10f64.powf(5.9 * u),
        ] {
            let (sample, ..) = body(20_000, |_, u| value(u));
            let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
            assert_eq!(t.value_scale(), ValueScale::Linear);
        }
    }

    #[test]
    fn a_logarithmic_scale_wants_values_above_0() {
        let log = |range| AutomaticOptions {
            scale: Some(ScaleName::Log),
            range,
            ..OPTIONS
        };
        let values = Values::F32((0..1000).map(|i| (i - 500) as f32).collect());
        assert!(of_lattice(&values, &log(Some([-1.0, 10.0]))).is_err());
        let t = of_lattice(&values, &log(Some([1.0, 100.0]))).unwrap();
        assert_eq!(t.range(), [0.0, 2.0]);
        // Values below 0 count as the least one above it.
        let [lo, hi] = of_lattice(&values, &log(None)).unwrap().range();
        assert!(lo.abs() < 1e-6 && hi > 2.6);
        let negative = Values::F32(vec![-1.0, -2.0]);
        assert!(of_lattice(&negative, &log(None)).is_err());
        let symlog = AutomaticOptions {
            scale: Some(ScaleName::Symlog),
            ..OPTIONS
        };
        let t = of_lattice(&values, &symlog).unwrap();
        let linear = 1e-3 * 499.0;
        assert_eq!(t.value_scale(), ValueScale::Symlog { linear });
    }

    #[test]
    fn zero_centred_fields_diverge() {
        let (sample, ..) = body(20_000, |_, u| 4.0 * (u - 0.5).powi(3));
        for surroundings in [Surroundings::Absent, Surroundings::Included] {
            let sample = ValueSample {
                surroundings,
                ..sample.clone()
            };
            let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
            let [lo, hi] = t.range();
            assert!((lo + hi).abs() < 1e-6 && hi > 0.4);
            let [red, _, blue, high] = t.classify(0.45);
            assert!(red > blue && high > 3.0 * t.classify(0.02)[3]);
            let [red, _, blue, low] = t.classify(-0.45);
            assert!(blue > red && (low - high).abs() < 0.05 * high);
        }
        // A flow in one direction is not zero-centred, nor is a field that hardly passes 0.
        for value in [|u: f64| 1.2 * u - 0.3, |u: f64| u * u - 0.01] {
            let (sample, ..) = body(20_000, |_, u| value(u));
            let t = TransferFunction::automatic(&sample, &OPTIONS).unwrap();
            assert!((t.range()[0] + t.range()[1]).abs() > 0.1);
        }
    }

    #[test]
    fn pieces_of_a_field_share_a_function() {
        let of = |values: std::ops::Range<u32>| {
            let values = Values::F32(values.map(|i| i as f32).collect());
            ValueSample::of_grid(&values, &[], 0.5)
        };
        let joined = ValueSample::joined([of(0..5000), of(5000..10_000)]).unwrap();
        let whole = of(0..10_000);
        let of = |sample: &ValueSample| TransferFunction::automatic(sample, &OPTIONS).unwrap();
        assert_eq!(of(&joined), of(&whole));
        assert!(ValueSample::joined([]).is_none());
    }
}
