//! Stores scalar values in the type of their file.

use rayon::prelude::*;

use super::storage::{Owned, Shared, Storage, picked};
use crate::math::narrowed;

/// Scalar values in vectors.
pub type Values = ValuesIn<Owned>;

/// One scalar per particle, cell or node, not widened in memory.
#[derive(Debug, Clone, PartialEq)]
pub enum ValuesIn<S: Storage> {
    /// Unsigned bytes.
    U8(S::Of<u8>),
    /// Signed 16-bit integers.
    I16(S::Of<i16>),
    /// Unsigned 16-bit integers.
    U16(S::Of<u16>),
    /// Single precision.
    F32(S::Of<f32>),
    /// Double precision, for numbers that single precision cannot represent. A volume's values are never wider
    /// than single precision: [`ValueScale::positions`](super::ValueScale::positions) narrows them.
    F64(S::Of<f64>),
}

/// Evaluates an expression with the column of values, of whatever type they are.
macro_rules! of_any_type {
    ($values:expr, $column:pat => $result:expr) => {
        match $values {
            $crate::scene::ValuesIn::U8($column) => $result,
            $crate::scene::ValuesIn::I16($column) => $result,
            $crate::scene::ValuesIn::U16($column) => $result,
            $crate::scene::ValuesIn::F32($column) => $result,
            $crate::scene::ValuesIn::F64($column) => $result,
        }
    };
}

/// Makes values of the same type as others, of the column that an expression makes of theirs.
macro_rules! of_same_type {
    ($values:expr, $column:pat => $result:expr) => {
        match $values {
            $crate::scene::ValuesIn::U8($column) => $crate::scene::ValuesIn::U8($result),
            $crate::scene::ValuesIn::I16($column) => $crate::scene::ValuesIn::I16($result),
            $crate::scene::ValuesIn::U16($column) => $crate::scene::ValuesIn::U16($result),
            $crate::scene::ValuesIn::F32($column) => $crate::scene::ValuesIn::F32($result),
            $crate::scene::ValuesIn::F64($column) => $crate::scene::ValuesIn::F64($result),
        }
    };
}

pub(crate) use {of_any_type, of_same_type};

impl From<Vec<u8>> for Values {
    fn from(values: Vec<u8>) -> Self {
        Self::U8(values)
    }
}

impl From<Vec<i16>> for Values {
    fn from(values: Vec<i16>) -> Self {
        Self::I16(values)
    }
}

impl From<Vec<u16>> for Values {
    fn from(values: Vec<u16>) -> Self {
        Self::U16(values)
    }
}

impl From<Vec<f32>> for Values {
    fn from(values: Vec<f32>) -> Self {
        Self::F32(values)
    }
}

impl From<Vec<f64>> for Values {
    /// Stores the values in single precision if all of them are the same in it.
    fn from(values: Vec<f64>) -> Self {
        let is_same = |v: &f64| f64::from(narrowed(*v)).to_bits() == v.to_bits() || v.is_nan();
        match values.par_iter().with_min_len(BATCH).all(is_same) {
            true => Self::F32(
                values
                    .par_iter()
                    .with_min_len(BATCH)
                    .map(|v| narrowed(*v))
                    .collect(),
            ),
            false => Self::F64(values),
        }
    }
}

/// Number of values that a thread processes at a time.
const BATCH: usize = 1 << 16;

impl<S: Storage> ValuesIn<S> {
    /// Number of values.
    pub fn len(&self) -> usize {
        of_any_type!(self, v => v.len())
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Value `i` in single precision.
    #[inline]
    pub fn get(&self, i: usize) -> f32 {
        match self {
            Self::U8(v) => f32::from(v[i]),
            Self::I16(v) => f32::from(v[i]),
            Self::U16(v) => f32::from(v[i]),
            Self::F32(v) => v[i],
            Self::F64(v) => narrowed(v[i]),
        }
    }

    /// Value `i` in double precision.
    #[inline]
    pub fn wide(&self, i: usize) -> f64 {
        match self {
            Self::F64(v) => v[i],
            _ => f64::from(self.get(i)),
        }
    }

    /// Appends a run of values to `out` in single precision, matching their type once.
    pub(crate) fn append_to(&self, run: std::ops::Range<usize>, out: &mut Vec<f32>) {
        match self {
            Self::U8(v) => out.extend(v[run].iter().map(|&v| f32::from(v))),
            Self::I16(v) => out.extend(v[run].iter().map(|&v| f32::from(v))),
            Self::U16(v) => out.extend(v[run].iter().map(|&v| f32::from(v))),
            Self::F32(v) => out.extend_from_slice(&v[run]),
            Self::F64(v) => out.extend(v[run].iter().map(|&v| narrowed(v))),
        }
    }

    /// The values at `indices`, in that order.
    pub fn gather(&self, indices: &[u32]) -> Self {
        of_same_type!(self, v => picked(v, 1, indices).into())
    }

    /// Bytes per value.
    pub fn bytes_per_value(&self) -> usize {
        match self {
            Self::U8(_) => 1,
            Self::I16(_) | Self::U16(_) => 2,
            Self::F32(_) => 4,
            Self::F64(_) => 8,
        }
    }

    /// The type's name as the command line spells it: `u8`, `i16`, `u16`, `f32` or `f64`.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "u8",
            Self::I16(_) => "i16",
            Self::U16(_) => "u16",
            Self::F32(_) => "f32",
            Self::F64(_) => "f64",
        }
    }

    /// The type's name, but `f32` for either floating-point precision.
    pub(crate) fn kind_name(&self) -> &'static str {
        match self {
            Self::F64(_) => "f32",
            other => other.type_name(),
        }
    }

    /// Number of values that are NaN or infinite.
    pub fn non_finite_count(&self) -> usize {
        match self {
            Self::F32(v) => v.iter().filter(|x| !x.is_finite()).count(),
            Self::F64(v) => v.iter().filter(|x| !x.is_finite()).count(),
            _ => 0,
        }
    }

    /// Whether all finite values are whole numbers.
    pub(crate) fn are_whole(&self) -> bool {
        match self {
            Self::F32(v) => v.iter().all(|x| x.fract() == 0.0 || !x.is_finite()),
            Self::F64(v) => v.iter().all(|x| x.fract() == 0.0 || !x.is_finite()),
            _ => true,
        }
    }

    /// Whether any value is infinite.
    pub(crate) fn has_infinite(&self) -> bool {
        match self {
            Self::F32(v) => v.iter().any(|x| x.is_infinite()),
            Self::F64(v) => v.iter().any(|x| x.is_infinite()),
            _ => false,
        }
    }
}

impl ValuesIn<Shared> {
    /// Whether the values are in a mapped file, whose pages are read on first access:
    /// [`Column::is_mapped`](super::Column).
    pub(crate) fn is_mapped(&self) -> bool {
        of_any_type!(self, v => v.is_mapped())
    }
}

impl Values {
    /// Converts the values to a renderer's storage, in single precision at most.
    pub(crate) fn shared(self) -> ValuesIn<Shared> {
        match self {
            Self::U8(v) => ValuesIn::U8(v.into()),
            Self::I16(v) => ValuesIn::I16(v.into()),
            Self::U16(v) => ValuesIn::U16(v.into()),
            Self::F32(v) => ValuesIn::F32(v.into()),
            Self::F64(v) => ValuesIn::F32(v.into_iter().map(narrowed).collect::<Vec<_>>().into()),
        }
    }

    /// Converts values to the type of this name ([`ValuesIn::type_name`]), clamped to its range.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "what a type does not have ends at its bounds"
    )]
    pub(crate) fn of_type(type_name: &str, values: &[f64]) -> Self {
        match type_name {
            "u8" => Self::U8(values.iter().map(|v| *v as u8).collect()),
            "i16" => Self::I16(values.iter().map(|v| *v as i16).collect()),
            "u16" => Self::U16(values.iter().map(|v| *v as u16).collect()),
            _ => values.to_vec().into(),
        }
    }

    /// Appends values of the same type; the two floating-point precisions count as one type. Values of another
    /// type are not appended. Empty values are replaced.
    pub(crate) fn append(&mut self, more: Self) {
        if self.is_empty() && self.kind_name() == more.kind_name() {
            *self = more;
            return;
        }
        if let (Self::F32(v), Self::F64(_)) = (&*self, &more) {
            *self = Self::F64(v.iter().map(|&v| v.into()).collect());
        }
        match (self, more) {
            (Self::F64(v), Self::F64(more)) => v.extend(more),
            (Self::F64(v), Self::F32(more)) => v.extend(more.into_iter().map(f64::from)),
            (Self::U8(v), Self::U8(more)) => v.extend(more),
            (Self::I16(v), Self::I16(more)) => v.extend(more),
            (Self::U16(v), Self::U16(more)) => v.extend(more),
            (Self::F32(v), Self::F32(more)) => v.extend(more),
            _ => {}
        }
    }

    /// Converts all floating-point arrays to double precision if one of them has it.
    pub(crate) fn alike(all: Vec<Self>) -> Vec<Self> {
        let is_wide = all.iter().any(|values| matches!(values, Self::F64(_)));
        let widened = |values: Self| match values {
            Self::F32(v) if is_wide => Self::F64(v.into_iter().map(f64::from).collect()),
            other => other,
        };
        all.into_iter().map(widened).collect()
    }

    /// Keeps the first `count` values and frees the memory of the others.
    pub(crate) fn truncate(&mut self, count: usize) {
        of_any_type!(self, v => {
            v.truncate(count);
            v.shrink_to_fit();
        });
    }

    /// A run of the values.
    pub(crate) fn part(&self, run: std::ops::Range<usize>) -> Self {
        of_same_type!(self, v => v[run].to_vec())
    }

    /// The least and the greatest finite value; `None` if there is none.
    pub fn finite_range(&self) -> Option<[f64; 2]> {
        fn of_all<T: Copy + PartialOrd + Into<f64>>(values: &[T]) -> Option<[f64; 2]> {
            let finite = values
                .iter()
                .map(|&v| v.into())
                .filter(|v: &f64| v.is_finite());
            finite.fold(None, |r, v| {
                Some(r.map_or([v, v], |[a, b]: [f64; 2]| [a.min(v), b.max(v)]))
            })
        }
        // Integers are compared as such, which is many times faster.
        fn of_integers<T: Copy + Ord + Into<f64>>(values: &[T]) -> Option<[f64; 2]> {
            let (least, greatest) = (values.iter().min()?, values.iter().max()?);
            Some([(*least).into(), (*greatest).into()])
        }
        match self {
            Self::U8(v) => of_integers(v),
            Self::I16(v) => of_integers(v),
            Self::U16(v) => of_integers(v),
            Self::F32(v) => of_all(v),
            Self::F64(v) => of_all(v),
        }
    }
}
