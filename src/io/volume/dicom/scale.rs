//! Converts stored numbers to values: by a slope, an intercept and padding values that mean "no value".

use super::data_set::DataSet;
use super::groups::Groups;
use super::pixels::Layout;
use super::tags;
use crate::io::bytes::scalars::ScalarType;
use crate::scene::Values;

/// Conversion of the numbers of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    slope: f64,
    intercept: f64,
    /// Range of the numbers that mean "no value", both ends included.
    padding: Option<[f64; 2]>,
}

impl Scale {
    pub(super) fn of(groups: &Groups<'_, '_>, layout: &Layout) -> Self {
        let number = |tag| groups.number(tags::PIXEL_VALUE_TRANSFORMATION, tag);
        let dose = groups.root.number(tags::DOSE_SCALING);
        let slope = number(tags::RESCALE_SLOPE).or(dose);
        Self {
            // A slope of 0 comes from headers that were never filled in.
            slope: slope.filter(|slope| *slope != 0.0).unwrap_or(1.0),
            intercept: number(tags::RESCALE_INTERCEPT).unwrap_or(0.0),
            padding: padding(groups.root, layout),
        }
    }

    /// Returns true if numbers may become floats.
    pub(super) fn makes_floats(&self) -> bool {
        self.padding.is_some() || !self.keeps_integers()
    }

    fn keeps_integers(&self) -> bool {
        self.slope == 1.0 && self.intercept.fract() == 0.0
    }

    /// Converts numbers; integers stay integers if possible.
    pub(super) fn apply(&self, components: Vec<Values>) -> Vec<Values> {
        components.into_iter().map(|v| self.values(v)).collect()
    }

    fn values(&self, values: Values) -> Values {
        let padding = self.padding.filter(|[low, high]| {
            let is_padding = |x: f64| (*low..=*high).contains(&x);
            (0..values.len()).any(|i| is_padding(values.wide(i)))
        });
        if padding.is_none() && self.slope == 1.0 && self.intercept == 0.0 {
            return values;
        }
        if padding.is_none()
            && self.keeps_integers()
            && let Some(integers) = self.integers(&values)
        {
            return integers;
        }
        let number = |i: usize| {
            let x = values.wide(i);
            match padding {
                Some([low, high]) if (low..=high).contains(&x) => f64::NAN,
                _ => self.slope * x + self.intercept,
            }
        };
        (0..values.len()).map(number).collect::<Vec<f64>>().into()
    }

    /// Adds the intercept to integers; returns `None` unless all sums fit into signed 16 bits.
    fn integers(&self, values: &Values) -> Option<Values> {
        if matches!(values, Values::F32(_) | Values::F64(_)) {
            return None;
        }
        let range = values.finite_range()?.map(|x| x + self.intercept);
        let most = [f64::from(i16::MIN), f64::from(i16::MAX)];
        if range[0] < most[0] || range[1] > most[1] {
            return None;
        }
        #[allow(clippy::cast_possible_truncation, reason = "within the range above")]
        let numbers = (0..values.len()).map(|i| (values.wide(i) + self.intercept) as i16);
        Some(Values::I16(numbers.collect()))
    }
}

/// Returns the range of numbers that mean "no value", from the data set's padding elements.
fn padding(root: &DataSet<'_>, layout: &Layout) -> Option<[f64; 2]> {
    let float = [
        (tags::FLOAT_PADDING, ScalarType::F32),
        (tags::DOUBLE_PADDING, ScalarType::F64),
    ];
    if layout.is_float() {
        let float = float.into_iter().find_map(|(tag, of)| root.float(tag, of));
        return float.map(|x| [x, x]);
    }
    let first = layout.padding_of(root.short(tags::PADDING)?);
    let last = root.short(tags::PADDING_LIMIT);
    let last = last.map_or(first, |word| layout.padding_of(word));
    Some([first.min(last), first.max(last)])
}
