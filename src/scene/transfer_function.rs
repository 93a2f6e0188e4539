//! Maps values to colours and extinctions.

mod automatic;
mod averages;
mod colour_maps;
mod file;
mod lobes;
mod maxima;
mod value_scale;

pub use automatic::{AutomaticOptions, ValueSample};
pub(crate) use automatic::{PickedRow, Surroundings, Tiling};
#[cfg(feature = "gpu")]
pub(crate) use averages::FAR_ENTRIES;
pub use averages::{Averages, Slopes, Weighting};
pub(crate) use colour_maps::is_diverging;
pub use colour_maps::{COLOUR_MAP_NAMES, ColourSpace};
pub(crate) use file::FileFunction;
pub use lobes::{
    ALONE_DEPTH, LEAST_WINDOW_SHARE, LOBE_REACH, Lobe, Lobes, MAX_LOBES, MAX_PIECE_WIDTH,
    MAX_WINDOWS, Piece, Window,
};
#[cfg(feature = "gpu")]
pub(crate) use lobes::{
    LOBE_CELLS_PER_DEVIATION, LOBE_ROWS_PER_OCTAVE, MAX_LOBE_CELLS, MAX_LOBE_ROWS,
    MAX_WINDOW_CELLS, Row as LobeRow,
};
pub use value_scale::{ScaleName, ValueScale};

use crate::constants::CLASSIFICATION_TABLE_LEN;
use std::ops::Range;

use self::maxima::Maxima;
use crate::error::{Error, Result};

/// Greatest opacity distinguished from 1, whose extinction would be infinite: 1 - 2^-16, one step of a 16-bit
/// image; -ln(1 - opacity) is then 11.09.
pub const MAX_OPACITY: f64 = 1.0 - 1.0 / 65536.0;

/// Margin for rounding in interpolation: a + (b - a) s may exceed the greater of a and b by an ulp or two.
pub(crate) const MAXIMUM_ROUNDING: f32 = 1.0 + 4.0 * f32::EPSILON;

/// A transfer function, sampled once into a table of colours and extinctions.
///
/// The table has [`CLASSIFICATION_TABLE_LEN`] entries, evenly over [`Self::range`], and is interpolated
/// linearly. Values outside the range take its ends. A step in the function is therefore a ramp of h = 1/4095
/// of the range. Within one entry of a control point the table stays between the function's least and greatest
/// value there. Elsewhere the extinction errs by h²/8 of its second derivative: (h o'/(1 - o))² / (8
/// unit_distance) where the opacity o is linear. Rounding in f32 adds EPSILON times the value, if that is not
/// small compared with h.
///
/// Values are positions on a [`ValueScale`], on which they are spaced evenly; it is linear unless set by
/// [`Self::on_scale`].
///
/// Opacities are stated per `unit_distance`: extinction = -ln(1 - opacity) / unit_distance, with the opacity
/// clamped to [0, [`MAX_OPACITY`]].
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    /// Positions on the values' scale.
    range: [f32; 2],
    value_scale: ValueScale,
    /// Entries per unit of value.
    scale: f32,
    unit_distance: f64,
    table: Vec<[f32; 4]>,
    /// Maxima of the extinctions.
    maxima: Maxima,
    /// From the first entry with an extinction above 0 to after the last.
    support: Range<usize>,
}

/// Parameters taken from the data, for a transfer function whose source does not state them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransferDefaults {
    /// Least and greatest value of the data.
    pub range: [f32; 2],
    /// The length \[world units\] over which opacities are stated.
    pub unit_distance: f64,
}

/// A point of a piecewise linear transfer function. Colour and opacity are each interpolated over the points
/// that have them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlPoint {
    /// The value.
    pub value: f32,
    /// Red, green, blue, 0..1, encoded in the function's [`ColourSpace`].
    pub colour: Option<[f32; 3]>,
    /// Opacity per unit distance, 0..1.
    pub opacity: Option<f32>,
}

impl TransferFunction {
    /// Samples a piecewise linear function.
    ///
    /// - `points`: values not decreasing; two points at one value make a step (the second applies at the value
    ///   itself). The first and the last point's colour and opacity extend beyond them. If no point has a
    ///   colour, the function is white.
    /// - `range`: range of the table; values outside take its ends.
    /// - `unit_distance`: world units, for the opacities.
    ///
    /// # Errors
    /// No points, no opacity, numbers that are not finite or out of order, colours or
    /// opacities outside 0..1, an empty range, a unit distance that is not positive.
    pub fn from_points(
        points: &[ControlPoint],
        space: ColourSpace,
        range: [f32; 2],
        unit_distance: f64,
    ) -> Result<Self> {
        check_points(points).map_err(|(place, expected, found)| {
            Error::invalid(
                "transfer function",
                place,
                expected,
                found,
                "correct the points",
            )
        })?;
        let colours: Vec<(f32, [f32; 3])> = points
            .iter()
            .filter_map(|p| p.colour.map(|c| (p.value, c)))
            .collect();
        let opacities: Vec<(f32, f32)> = points
            .iter()
            .filter_map(|p| p.opacity.map(|o| (p.value, o)))
            .collect();
        Self::from_curves(
            |value| match segment(&colours, |p| p.0, value) {
                Some((a, b, s)) => space.mix_to_linear(colours[a].1, colours[b].1, s),
                None => [1.0; 3],
            },
            |value| match segment(&opacities, |p| p.0, value) {
                Some((a, b, s)) => opacities[a].1 + (opacities[b].1 - opacities[a].1) * s,
                None => 0.0,
            },
            range,
            unit_distance,
        )
    }

    /// Samples any function: `colour` returns linear RGB, `opacity` the opacity per unit distance.
    ///
    /// # Errors
    /// An empty range or a unit distance that is not positive.
    pub fn from_curves(
        colour: impl Fn(f32) -> [f32; 3],
        opacity: impl Fn(f32) -> f32,
        range: [f32; 2],
        unit_distance: f64,
    ) -> Result<Self> {
        check_unit_distance(unit_distance)?;
        let range = widened(range)?;
        let table = (0..CLASSIFICATION_TABLE_LEN)
            .map(|i| {
                let value = entry_value(range, i);
                let [r, g, b] = colour(value);
                [r, g, b, extinction(opacity(value), unit_distance)]
            })
            .collect();
        Ok(Self::from_table(table, range, unit_distance))
    }

    /// Returns the lobes of the function, each with tables of the piece that it leaves of a kernel.
    ///
    /// - `sigma`: greatest standard deviation of a kernel, world units. It decides which kernels may be
    ///   classified at their values alone.
    #[doc(hidden)]
    pub fn lobes(&self, sigma: f32) -> Lobes {
        Lobes::new(self, sigma)
    }

    /// The lobes of the function, without tables.
    pub(crate) fn shown(&self) -> Lobes {
        Lobes::without_tables(self)
    }

    /// The greatest extinction \[1/length\] of any value.
    pub(crate) fn greatest_extinction(&self) -> f32 {
        self.maxima.greatest(0, CLASSIFICATION_TABLE_LEN - 1)
    }

    /// A function under which particles carry their values: red, green and blue are the value's share of the
    /// range, and the extinction is everywhere this function's greatest. Classifying a mixture of particles
    /// with it gives a mean value and a length, from which this function computes a colour and a depth.
    pub(crate) fn carrier(&self) -> Self {
        let greatest = self.greatest_extinction();
        let table = (0..CLASSIFICATION_TABLE_LEN).map(|i| {
            let share = i as f32 / (CLASSIFICATION_TABLE_LEN - 1) as f32;
            [share, share, share, greatest]
        });
        Self::from_table(table.collect(), self.range, self.unit_distance).on_scale(self.value_scale)
    }

    /// Linear red, green, blue and the extinction \[1/length\] of the value at a share of the range.
    #[inline]
    pub(crate) fn classify_share(&self, share: f32) -> [f32; 4] {
        self.between(table_segment(share * (CLASSIFICATION_TABLE_LEN - 1) as f32))
    }

    /// Makes a function from a finished table of [`CLASSIFICATION_TABLE_LEN`] entries and a widened range.
    fn from_table(table: Vec<[f32; 4]>, range: [f32; 2], unit_distance: f64) -> Self {
        debug_assert_eq!(table.len(), CLASSIFICATION_TABLE_LEN);
        let span = f64::from(range[1]) - f64::from(range[0]);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "rounding to f32; the widened range keeps it finite"
        )]
        let scale = ((CLASSIFICATION_TABLE_LEN - 1) as f64 / span) as f32;
        let maxima = Maxima::new(table.iter().map(|e| e[3]).collect());
        let is_seen = |e: &[f32; 4]| e[3] > 0.0;
        let support = match table.iter().position(is_seen) {
            Some(first) => first..table.iter().rposition(is_seen).map_or(first, |i| i + 1),
            None => 0..0,
        };
        Self {
            range,
            value_scale: ValueScale::Linear,
            scale,
            unit_distance,
            table,
            maxima,
            support,
        }
    }

    /// Makes a function from the parts of another: [`Self::table`], [`Self::range`], [`Self::unit_distance`]
    /// and [`Self::value_scale`]. `None` if no function has such parts.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_entries(
        table: Vec<[f32; 4]>,
        range: [f32; 2],
        unit_distance: f64,
        value_scale: ValueScale,
    ) -> Option<Self> {
        let is_finite = table.as_flattened().iter().all(|x| x.is_finite());
        let is_table = table.len() == CLASSIFICATION_TABLE_LEN && is_finite;
        let is_range = widened(range).is_ok_and(|wide| wide == range);
        let is_unit = check_unit_distance(unit_distance).is_ok();
        (is_table && is_range && is_unit)
            .then(|| Self::from_table(table, range, unit_distance).on_scale(value_scale))
    }

    /// Linear red, green, blue and the extinction \[1/length\] of a value.
    ///
    /// Values outside the range, infinities included, take its ends; NaN is transparent.
    #[inline]
    pub fn classify(&self, value: f32) -> [f32; 4] {
        if value.is_nan() {
            return [0.0; 4];
        }
        self.between(self.position(value))
    }

    /// Interpolates between an entry of the table and the next.
    #[inline]
    fn between(&self, (i, s): (usize, f32)) -> [f32; 4] {
        let (a, b) = (&self.table[i], &self.table[i + 1]);
        [0, 1, 2, 3].map(|c| a[c] + (b[c] - a[c]) * s)
    }

    /// The entry below a value, at most the last but one, and the fraction to the next.
    #[inline]
    fn position(&self, value: f32) -> (usize, f32) {
        table_segment((value - self.range[0]) * self.scale)
    }

    /// A bound on the extinction \[1/length\] of every value in `lo..=hi`, in constant time.
    ///
    /// Never less than what [`Self::classify`] returns there; the bound covers at most two entries more than
    /// the interval. NaN ends mean the whole range; swapped ends are put in order.
    pub fn max_extinction(&self, lo: f32, hi: f32) -> f32 {
        let (first, last) = entries(self.range[0], self.scale, lo, hi);
        self.maxima.greatest(first, last) * MAXIMUM_ROUNDING
    }

    /// The run of sorted values that may have an extinction above 0, by bisection. Values ascend, with NaN
    /// last; value i of `count` is `value(i)`. Values outside the run have no extinction; some within it may
    /// have none either.
    pub(crate) fn seen_run(&self, count: usize, value: impl Fn(usize) -> f32) -> Range<usize> {
        // Values are interpolated between an entry and the next, as in `classify`.
        let is_below = |v: f32| !v.is_nan() && self.position(v).0 + 1 < self.support.start;
        let is_not_above = |v: f32| !v.is_nan() && self.position(v).0 < self.support.end;
        let bisect = |holds: &dyn Fn(f32) -> bool, mut first: usize| {
            let mut end = count;
            while first < end {
                let middle = first.midpoint(end);
                if holds(value(middle)) {
                    first = middle + 1;
                } else {
                    end = middle;
                }
            }
            first
        };
        let first = bisect(&is_below, 0);
        first..bisect(&is_not_above, first)
    }

    /// The same function on another linear scale. `None` if either scale is not linear and they differ, or if
    /// the new scale has no finite position for the range.
    #[must_use]
    pub fn moved_to(&self, value_scale: ValueScale) -> Option<Self> {
        if !(self.value_scale.is_linear() && value_scale.is_linear()) {
            return (self.value_scale == value_scale).then(|| self.clone());
        }
        if self.value_scale == value_scale {
            return Some(self.clone());
        }
        let end = |end: f32| value_scale.position(self.value_scale.value(end));
        let range = widened(self.range.map(end)).ok()?;
        let function = Self::from_table(self.table.clone(), range, self.unit_distance);
        Some(function.on_scale(value_scale))
    }

    /// Reinterprets values as positions on a scale: in the range, in the table and in the argument of
    /// [`Self::classify`].
    #[must_use]
    pub fn on_scale(self, value_scale: ValueScale) -> Self {
        Self {
            value_scale,
            ..self
        }
    }

    /// The scale of the function's values.
    pub fn value_scale(&self) -> ValueScale {
        self.value_scale
    }

    /// The least and the greatest value of the table, as positions on [`Self::value_scale`].
    pub fn range(&self) -> [f32; 2] {
        self.range
    }

    /// The entries: linear red, green, blue and extinction \[1/length\], evenly over
    /// [`Self::range`], the first and the last at its ends.
    pub fn table(&self) -> &[[f32; 4]] {
        &self.table
    }

    /// Entries per unit of value.
    #[cfg(feature = "gpu")]
    pub(crate) fn scale(&self) -> f32 {
        self.scale
    }

    /// Maxima of runs of entries. Row p, entry i: the greatest extinction \[1/length\] of entries i .. i + 2^p.
    #[cfg(feature = "gpu")]
    pub(crate) fn maxima(&self) -> &[Vec<f32>] {
        self.maxima.rows()
    }

    /// The length \[world units\] over which the opacities were stated.
    pub fn unit_distance(&self) -> f64 {
        self.unit_distance
    }

    /// States the same opacities over another length: extinctions change in proportion.
    ///
    /// # Errors
    /// A unit distance that is not positive and finite.
    pub fn with_unit_distance(self, unit_distance: f64) -> Result<Self> {
        check_unit_distance(unit_distance)?;
        let factor = self.unit_distance / unit_distance;
        let mut table = self.table;
        for entry in &mut table {
            entry[3] = narrowed(f64::from(entry[3]) * factor);
        }
        Ok(Self::from_table(table, self.range, unit_distance).on_scale(self.value_scale))
    }
}

/// Index of the table's last entry.
const LAST: f32 = (CLASSIFICATION_TABLE_LEN - 1) as f32;

/// The entry below a position in the table, at most the last but one, and the fraction to the next.
#[inline]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the table's indices"
)]
fn table_segment(x: f32) -> (usize, f32) {
    let x = x.clamp(0.0, LAST);
    let i = (x as usize).min(CLASSIFICATION_TABLE_LEN - 2);
    (i, x - i as f32)
}

/// The first and the last entry from which values in `lo..=hi` are interpolated; at least two. The table begins
/// at `low` with `scale` entries per unit. If an end is NaN, all entries.
fn entries(low: f32, scale: f32, lo: f32, hi: f32) -> (usize, usize) {
    if lo.is_nan() || hi.is_nan() {
        return (0, CLASSIFICATION_TABLE_LEN - 1);
    }
    let (lo, hi) = if lo <= hi { (lo, hi) } else { (hi, lo) };
    let entry = |value: f32| table_segment((value - low) * scale).0;
    (entry(lo), entry(hi) + 1)
}

/// -ln(1 - opacity) / unit_distance \[1/length\]; NaN opacity gives 0.
fn extinction(opacity: f32, unit_distance: f64) -> f32 {
    let opacity = f64::from(opacity);
    if opacity > 0.0 {
        narrowed(-(-opacity.min(MAX_OPACITY)).ln_1p() / unit_distance)
    } else {
        0.0
    }
}

/// Rounds to f32, clamped to be finite.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
fn narrowed(x: f64) -> f32 {
    x.min(f64::from(f32::MAX)) as f32
}

/// The value at entry `i` of a table over `range`.
fn entry_value(range: [f32; 2], i: usize) -> f32 {
    let s = i as f64 / (CLASSIFICATION_TABLE_LEN - 1) as f64;
    let (lo, hi) = (f64::from(range[0]), f64::from(range[1]));
    #[expect(clippy::cast_possible_truncation, reason = "between two f32")]
    {
        (lo * (1.0 - s) + hi * s) as f32
    }
}

/// Widens a range so that f32 can represent its differences and their reciprocals: an empty range (constant
/// data) grows by a millionth of its value.
fn widened([lo, hi]: [f32; 2]) -> Result<[f32; 2]> {
    // A smaller span overflows 4095 / span; greater ends overflow the difference of two values.
    const LEAST_SPAN: f32 = 1e-30;
    const GREATEST: f32 = f32::MAX / 4.0;
    if !(lo.is_finite() && hi.is_finite() && lo <= hi) {
        return Err(Error::invalid(
            "transfer function",
            "range",
            "two numbers within single precision (3.4e38), the first not greater",
            format!("[{lo}, {hi}]"),
            "correct the range",
        ));
    }
    let (lo, hi) = (lo.max(-GREATEST), hi.min(GREATEST));
    if hi - lo >= LEAST_SPAN {
        Ok([lo, hi])
    } else {
        Ok([lo, lo + (lo.abs() * 1e-6).max(LEAST_SPAN)])
    }
}

fn check_unit_distance(unit_distance: f64) -> Result<()> {
    if unit_distance > 0.0 && unit_distance.is_finite() {
        return Ok(());
    }
    Err(Error::invalid(
        "transfer function",
        "unit_distance",
        "a positive length",
        unit_distance.to_string(),
        "give the length over which opacities are meant, in the data's units",
    ))
}

/// The place of the first fault in a list of points, what was expected and what was found.
fn check_points(points: &[ControlPoint]) -> Result<(), (String, &'static str, String)> {
    if points.is_empty() {
        return Err(("points".into(), "at least one point", "none".into()));
    }
    let unit = |x: f32| (0.0..=1.0).contains(&x);
    for (i, p) in points.iter().enumerate() {
        let place = |key: &str| format!("points[{i}].{key}");
        if !p.value.is_finite() {
            return Err((place("value"), "a finite number", p.value.to_string()));
        }
        if i > 0 && p.value < points[i - 1].value {
            return Err((
                place("value"),
                "values in rising order",
                format!("{} after {}", p.value, points[i - 1].value),
            ));
        }
        if let Some(c) = p.colour
            && !c.iter().all(|&x| unit(x))
        {
            return Err((place("color"), "three numbers in 0..1", format!("{c:?}")));
        }
        if let Some(o) = p.opacity
            && !unit(o)
        {
            return Err((place("opacity"), "a number in 0..1", o.to_string()));
        }
    }
    if points.iter().all(|p| p.opacity.is_none()) {
        return Err((
            "points".into(),
            "an opacity at one point at least",
            "none".into(),
        ));
    }
    Ok(())
}

/// The two points around a value and the fraction between them; the same point twice before the first and from
/// the last on. `None` if there are no points.
fn segment<T>(
    points: &[T],
    value_of: impl Fn(&T) -> f32,
    value: f32,
) -> Option<(usize, usize, f32)> {
    let last = points.len().checked_sub(1)?;
    let after = points.partition_point(|p| value_of(p) <= value);
    Some(if after == 0 {
        (0, 0, 0.0)
    } else if after > last {
        (last, last, 0.0)
    } else {
        let (a, b) = (value_of(&points[after - 1]), value_of(&points[after]));
        (after - 1, after, (value - a) / (b - a))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(value: f32, colour: Option<[f32; 3]>, opacity: Option<f32>) -> ControlPoint {
        ControlPoint {
            value,
            colour,
            opacity,
        }
    }

    fn ramp() -> TransferFunction {
        TransferFunction::from_points(
            &[
                point(0.0, Some([0.0; 3]), Some(0.0)),
                point(10.0, Some([1.0; 3]), Some(1.0)),
            ],
            ColourSpace::Linear,
            [0.0, 10.0],
            2.0,
        )
        .unwrap()
    }

    #[test]
    fn extinction_follows_the_formula() {
        let t = ramp();
        // Opacity .5 over a length of 2. The table's interpolation adds |second derivative| h^2/8.
        let expected = 2f32.ln() / 2.0;
        assert!((t.classify(5.0)[3] - expected).abs() < 1e-6);
        assert!((t.classify(5.0)[0] - 0.5).abs() < 1e-6);
        let clamped = 65536f64.ln() / 2.0;
        assert!((f64::from(t.classify(10.0)[3]) - clamped).abs() < 1e-5);
        assert_eq!(t.classify(f32::NAN)[3].to_bits(), 0);
        assert_eq!(t.classify(-3.0), t.classify(0.0));
        assert_eq!(t.classify(f32::INFINITY), t.classify(10.0));
        assert_eq!(t.classify(f32::NEG_INFINITY), t.classify(0.0));
        let halved = t.clone().with_unit_distance(4.0).unwrap();
        assert!((halved.classify(5.0)[3] - expected / 2.0).abs() < 1e-6);
    }

    #[test]
    fn two_points_at_one_value_make_a_step() {
        let t = TransferFunction::from_points(
            &[
                point(0.0, None, Some(0.0)),
                point(1.0, None, Some(0.0)),
                point(1.0, None, Some(0.5)),
                point(2.0, None, Some(0.5)),
            ],
            ColourSpace::Srgb,
            [0.0, 2.0],
            1.0,
        )
        .unwrap();
        assert!(t.classify(0.999)[3] < 1e-6);
        assert!((t.classify(1.001)[3] - 2f32.ln()).abs() < 1e-6);
        assert_eq!(t.classify(1.5)[..3], [1.0; 3]);
    }

    #[test]
    fn colour_and_opacity_run_over_their_own_points() {
        let t = TransferFunction::from_points(
            &[
                point(0.0, Some([0.0; 3]), None),
                point(1.0, None, Some(0.25)),
                point(4.0, Some([1.0; 3]), None),
            ],
            ColourSpace::Srgb,
            [0.0, 4.0],
            1.0,
        )
        .unwrap();
        let expected = crate::image::linear_from_srgb(0.5);
        // 1e-3: half a table step, between entries, at the slope of the sRGB curve.
        assert!((t.classify(2.0)[0] - expected).abs() < 1e-3);
        assert!((t.classify(3.0)[3] + 0.75f32.ln()).abs() < 1e-6);
    }

    #[test]
    fn faults_are_named() {
        let fails = |points: &[ControlPoint], range, unit| {
            TransferFunction::from_points(points, ColourSpace::Srgb, range, unit)
                .unwrap_err()
                .to_string()
        };
        let good = [point(0.0, None, Some(0.5))];
        assert!(fails(&[], [0.0, 1.0], 1.0).contains("at least one point"));
        assert!(fails(&good, [1.0, 0.0], 1.0).contains("range"));
        assert!(fails(&good, [0.0, 1.0], 0.0).contains("unit_distance"));
        assert!(fails(&good, [0.0, 1.0], f64::NAN).contains("unit_distance"));
        let unsorted = [point(1.0, None, Some(0.5)), point(0.0, None, None)];
        assert!(fails(&unsorted, [0.0, 1.0], 1.0).contains("points[1].value"));
        let nan = [point(f32::NAN, None, Some(0.5))];
        assert!(fails(&nan, [0.0, 1.0], 1.0).contains("points[0].value"));
        let high = [point(0.0, None, Some(1.5))];
        assert!(fails(&high, [0.0, 1.0], 1.0).contains("points[0].opacity"));
        let none = [point(0.0, Some([0.0; 3]), None)];
        assert!(fails(&none, [0.0, 1.0], 1.0).contains("an opacity"));
    }

    #[test]
    fn a_range_of_one_value_classifies() {
        let points = [point(7.0, Some([0.5; 3]), Some(0.5))];
        let t = TransferFunction::from_points(&points, ColourSpace::Linear, [7.0, 7.0], 1.0);
        let e = t.unwrap().classify(7.0);
        assert!((e[3] - 2f32.ln()).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn max_extinction_bounds_classify(
            heights in prop::collection::vec(0.0f32..=1.0, 2..20),
            lo in -2.0f32..12.0,
            length in 0.0f32..12.0,
            s in 0.0f32..=1.0,
        ) {
            let n = heights.len();
            let points: Vec<_> = heights
                .iter()
                .enumerate()
                .map(|(i, &h)| point(10.0 * i as f32 / (n - 1) as f32, None, Some(h)))
                .collect();
            let t = TransferFunction::from_points(
                &points, ColourSpace::Linear, [0.0, 10.0], 0.5,
            ).unwrap();
            let (hi, inside) = (lo + length, lo + s * length);
            let bound = t.max_extinction(lo, hi);
            prop_assert!(t.classify(inside.clamp(lo, hi))[3] <= bound);
            prop_assert_eq!(bound.to_bits(), t.max_extinction(hi, lo).to_bits());
            prop_assert!(t.max_extinction(f32::NAN, hi) >= bound);
            // Tight: no greater than the largest entry within two entries of the interval.
            let step = 2.0 * 10.0 / 4095.0;
            let near = t.table().iter().enumerate().filter(|(i, _)| {
                let v = 10.0 * *i as f32 / 4095.0;
                let inside = |x: f32| x.clamp(0.0, 10.0);
                v >= inside(lo) - step && v <= inside(hi) + step
            });
            let greatest = near.map(|(_, e)| e[3]).fold(0.0, f32::max);
            prop_assert!(bound <= greatest * 1.000_001);
        }

        #[test]
        fn a_rising_opacity_classifies_to_a_rising_extinction(a in -20.0f32..20.0, b in -20.0f32..20.0) {
            let t = ramp();
            let (a, b) = if a <= b { (a, b) } else { (b, a) };
            // One ulp: interpolation rounds.
            prop_assert!(t.classify(a)[3] <= t.classify(b)[3] * (1.0 + 2.0 * f32::EPSILON));
        }
    }
}
