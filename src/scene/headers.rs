//! Defines headers of strengths, colours and values: their kinds without columns, as files and ranks have them.

use serde::{Deserialize, Serialize};

use super::storage::Storage;
use crate::scene::point_volume::{ColourIn, StrengthIn};
use crate::scene::splat_rule::SplatRule;
#[cfg(feature = "prepared")]
use crate::scene::values::ValuesIn;

/// Kind of a [`Strength`](super::Strength).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename = "Strength", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum StrengthHeader {
    Classified,
    Mass,
    PeakOpacity {
        /// Absent from files of earlier programs.
        #[serde(default)]
        rule: Option<SplatRule>,
        /// In files of earlier programs: whether the rule is that of anti-aliased splats.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        is_anti_aliased: bool,
        /// Absent from files of earlier programs.
        #[serde(default)]
        by_distance: bool,
    },
    Surface,
    Translucent,
}

impl StrengthHeader {
    pub(crate) fn of<S: Storage>(strength: &StrengthIn<S>) -> Self {
        match strength {
            StrengthIn::Classified { .. } => Self::Classified,
            StrengthIn::Mass(_) => Self::Mass,
            StrengthIn::PeakOpacity {
                rule, by_distance, ..
            } => Self::PeakOpacity {
                rule: Some(*rule),
                is_anti_aliased: false,
                by_distance: *by_distance,
            },
            StrengthIn::Surface(_) => Self::Surface,
            StrengthIn::Translucent(_) => Self::Translucent,
        }
    }

    /// A strength of this kind without entries.
    pub(crate) fn empty<S: Storage>(self) -> StrengthIn<S> {
        self.with(S::Of::default())
    }

    /// A strength of this kind with these entries.
    pub(crate) fn with<S: Storage>(self, numbers: S::Of<f32>) -> StrengthIn<S> {
        match self {
            Self::Classified => StrengthIn::Classified { volumes: numbers },
            Self::Mass => StrengthIn::Mass(numbers),
            Self::PeakOpacity {
                rule,
                is_anti_aliased,
                by_distance,
            } => StrengthIn::PeakOpacity {
                opacities: numbers,
                rule: match rule {
                    Some(rule) => rule,
                    None if is_anti_aliased => SplatRule::Mip,
                    None => SplatRule::Exact,
                },
                by_distance,
            },
            Self::Surface => StrengthIn::Surface(numbers),
            Self::Translucent => StrengthIn::Translucent(numbers),
        }
    }
}

/// Kind of a [`Colour`](super::Colour).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename = "Colour", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ColourHeader {
    Classified,
    PerParticle,
    Uniform([f32; 3]),
    Harmonics {
        degree: u8,
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        is_linear: bool,
    },
}

impl ColourHeader {
    pub(crate) fn of<S: Storage>(colour: &ColourIn<S>) -> Self {
        match colour {
            ColourIn::Classified => Self::Classified,
            ColourIn::PerParticle(_) => Self::PerParticle,
            ColourIn::Uniform(colour) => Self::Uniform(*colour),
            ColourIn::Harmonics {
                degree, is_linear, ..
            } => Self::Harmonics {
                degree: *degree,
                is_linear: *is_linear,
            },
        }
    }

    /// A colour of this kind without entries.
    pub(crate) fn empty<S: Storage>(self) -> ColourIn<S> {
        match self {
            Self::Classified => ColourIn::Classified,
            Self::PerParticle => ColourIn::PerParticle(S::Of::default()),
            Self::Uniform(colour) => ColourIn::Uniform(colour),
            Self::Harmonics { degree, is_linear } => ColourIn::Harmonics {
                degree,
                coefficients: S::Of::default(),
                is_linear,
            },
        }
    }
}

/// Type of a volume's values.
#[cfg(feature = "prepared")]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ValuesHeader {
    U8,
    I16,
    U16,
    F32,
    /// Values of a volume, which blocks narrow.
    F64,
}

#[cfg(feature = "prepared")]
impl ValuesHeader {
    pub(crate) fn of<S: Storage>(values: &ValuesIn<S>) -> Self {
        match values {
            ValuesIn::U8(_) => Self::U8,
            ValuesIn::I16(_) => Self::I16,
            ValuesIn::U16(_) => Self::U16,
            ValuesIn::F32(_) => Self::F32,
            ValuesIn::F64(_) => Self::F64,
        }
    }

    /// Values of this type without entries.
    pub(crate) fn empty<S: Storage>(self) -> ValuesIn<S> {
        match self {
            Self::U8 => ValuesIn::U8(S::Of::default()),
            Self::I16 => ValuesIn::I16(S::Of::default()),
            Self::U16 => ValuesIn::U16(S::Of::default()),
            Self::F32 => ValuesIn::F32(S::Of::default()),
            Self::F64 => ValuesIn::F64(S::Of::default()),
        }
    }
}
