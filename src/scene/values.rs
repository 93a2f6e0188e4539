//! Scalar values in the type that their file holds them in.

use super::storage::{Owned, Shared, Storage};

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
    /// Single precision; wider file types are narrowed to this.
    F32(S::Of<f32>),
}

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

impl<S: Storage> ValuesIn<S> {
    /// How many values there are.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::F32(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Value `i`, widened.
    #[inline]
    pub fn get(&self, i: usize) -> f32 {
        match self {
            Self::U8(v) => f32::from(v[i]),
            Self::I16(v) => f32::from(v[i]),
            Self::U16(v) => f32::from(v[i]),
            Self::F32(v) => v[i],
        }
    }

    /// Adds a run of values to `out`, widened, in one pass of their type.
    pub(crate) fn append_to(&self, run: std::ops::Range<usize>, out: &mut Vec<f32>) {
        match self {
            Self::U8(v) => out.extend(v[run].iter().map(|&v| f32::from(v))),
            Self::I16(v) => out.extend(v[run].iter().map(|&v| f32::from(v))),
            Self::U16(v) => out.extend(v[run].iter().map(|&v| f32::from(v))),
            Self::F32(v) => out.extend_from_slice(&v[run]),
        }
    }

    /// The values at `indices`, in that order.
    pub fn gather(&self, indices: &[u32]) -> Self {
        fn pick<T: Copy, C: From<Vec<T>>>(v: &[T], indices: &[u32]) -> C {
            indices
                .iter()
                .map(|&i| v[i as usize])
                .collect::<Vec<T>>()
                .into()
        }
        match self {
            Self::U8(v) => Self::U8(pick(v, indices)),
            Self::I16(v) => Self::I16(pick(v, indices)),
            Self::U16(v) => Self::U16(pick(v, indices)),
            Self::F32(v) => Self::F32(pick(v, indices)),
        }
    }

    /// Bytes per value.
    pub fn bytes_per_value(&self) -> usize {
        match self {
            Self::U8(_) => 1,
            Self::I16(_) | Self::U16(_) => 2,
            Self::F32(_) => 4,
        }
    }

    /// The type's name as the command line spells it: `u8`, `i16`, `u16` or `f32`.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "u8",
            Self::I16(_) => "i16",
            Self::U16(_) => "u16",
            Self::F32(_) => "f32",
        }
    }

    /// How many values are NaN or infinite.
    pub fn non_finite_count(&self) -> usize {
        match self {
            Self::F32(v) => v.iter().filter(|x| !x.is_finite()).count(),
            _ => 0,
        }
    }

    /// Whether any value is infinite.
    pub(crate) fn has_infinite(&self) -> bool {
        matches!(self, Self::F32(v) if v.iter().any(|x| x.is_infinite()))
    }
}

impl ValuesIn<Shared> {
    /// Whether they lie in memory that is taken page by page, as it is looked at: [`Column::is_mapped`](super::Column).
    pub(crate) fn is_mapped(&self) -> bool {
        match self {
            Self::U8(v) => v.is_mapped(),
            Self::I16(v) => v.is_mapped(),
            Self::U16(v) => v.is_mapped(),
            Self::F32(v) => v.is_mapped(),
        }
    }
}

impl Values {
    /// The same as a renderer keeps them.
    pub(crate) fn shared(self) -> ValuesIn<Shared> {
        match self {
            Self::U8(v) => ValuesIn::U8(v.into()),
            Self::I16(v) => ValuesIn::I16(v.into()),
            Self::U16(v) => ValuesIn::U16(v.into()),
            Self::F32(v) => ValuesIn::F32(v.into()),
        }
    }

    /// Values of the type that [`ValuesIn::type_name`] names so, as far as it has them.
    #[cfg(feature = "cli")]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "what a type does not have ends at its bounds"
    )]
    pub(crate) fn of_type(type_name: &str, values: &[f32]) -> Self {
        match type_name {
            "u8" => Self::U8(values.iter().map(|v| *v as u8).collect()),
            "i16" => Self::I16(values.iter().map(|v| *v as i16).collect()),
            "u16" => Self::U16(values.iter().map(|v| *v as u16).collect()),
            _ => Self::F32(values.to_vec()),
        }
    }

    /// Appends values of the same type; of another none. Where there are none yet these are taken as they are.
    pub(crate) fn append(&mut self, more: Self) {
        if self.is_empty() && self.type_name() == more.type_name() {
            *self = more;
            return;
        }
        match (self, more) {
            (Self::U8(v), Self::U8(more)) => v.extend(more),
            (Self::I16(v), Self::I16(more)) => v.extend(more),
            (Self::U16(v), Self::U16(more)) => v.extend(more),
            (Self::F32(v), Self::F32(more)) => v.extend(more),
            _ => {}
        }
    }

    /// Leaves out all but the first, and gives their memory back.
    pub(crate) fn truncate(&mut self, count: usize) {
        fn cut<T>(v: &mut Vec<T>, count: usize) {
            v.truncate(count);
            v.shrink_to_fit();
        }
        match self {
            Self::U8(v) => cut(v, count),
            Self::I16(v) => cut(v, count),
            Self::U16(v) => cut(v, count),
            Self::F32(v) => cut(v, count),
        }
    }

    /// A run of the values.
    pub(crate) fn part(&self, run: std::ops::Range<usize>) -> Self {
        match self {
            Self::U8(v) => Self::U8(v[run].to_vec()),
            Self::I16(v) => Self::I16(v[run].to_vec()),
            Self::U16(v) => Self::U16(v[run].to_vec()),
            Self::F32(v) => Self::F32(v[run].to_vec()),
        }
    }

    /// The least and the greatest finite value, or `None` where there is none.
    pub fn finite_range(&self) -> Option<[f32; 2]> {
        match self {
            Self::U8(v) => {
                let (lo, hi) = (v.iter().min()?, v.iter().max()?);
                Some([f32::from(*lo), f32::from(*hi)])
            }
            Self::I16(v) => {
                let (lo, hi) = (v.iter().min()?, v.iter().max()?);
                Some([f32::from(*lo), f32::from(*hi)])
            }
            Self::U16(v) => {
                let (lo, hi) = (v.iter().min()?, v.iter().max()?);
                Some([f32::from(*lo), f32::from(*hi)])
            }
            Self::F32(v) => v.iter().filter(|x| x.is_finite()).fold(None, |r, &x| {
                Some(r.map_or([x, x], |[a, b]: [f32; 2]| [a.min(x), b.max(x)]))
            }),
        }
    }
}
