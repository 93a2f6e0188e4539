//! Interprets columns of colours: one rule for points, vertices, faces and splats in all file formats.
//!
//! | columns | linear numbers | encoded numbers (sRGB) |
//! |---|---|---|
//! | `r`, `g`, `b` | up to 1, and fractions up to 16 | integers of 8 and 16 bits, whole numbers above 1, all above 16 |
//! | `red`, `green`, `blue`; the same after `diffuse_` | none | all |
//! | vectors `rgb`, `Colors`, ... | none | all |
//!
//! Encoded numbers are divided by the number that stands for 1. That is the greatest of their type for unsigned integers of
//! 8 and 16 bits; those of 16 bits that do not exceed 255 count as bytes. For other types it is 1, or 255 if the greatest
//! number exceeds 1, or 65535 if it exceeds 255. Three columns of a set are a colour; one or two are numbers like any other.

use serde::{Deserialize, Serialize};

use crate::image::{linear_from_srgb, srgb_from_linear};
use crate::math::narrowed;
use crate::scene::Values;

/// Names of columns that hold a colour together.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct ColourSet {
    pub(crate) names: [&'static str; 3],
    /// Column of the opacity of vertices and faces. It is scaled as the colours are, and linear.
    pub(crate) alpha: &'static str,
    /// True if small numbers are linear.
    may_be_linear: bool,
}

/// All sets, in order of precedence.
pub(crate) const COLOUR_SETS: [ColourSet; 3] = [
    ColourSet {
        names: ["r", "g", "b"],
        alpha: "a",
        may_be_linear: true,
    },
    ColourSet {
        names: ["red", "green", "blue"],
        alpha: "alpha",
        may_be_linear: false,
    },
    ColourSet {
        names: ["diffuse_red", "diffuse_green", "diffuse_blue"],
        alpha: "diffuse_alpha",
        may_be_linear: false,
    },
];

/// Returns the sets whose three columns all exist, with the results of `find` for them.
pub(crate) fn colour_sets<T>(
    mut find: impl FnMut(&str) -> Option<T>,
) -> Vec<(&'static ColourSet, [T; 3])> {
    let mut whole = |set: &'static ColourSet| {
        let [r, g, b] = set.names.map(&mut find);
        Some((set, [r?, g?, b?]))
    };
    COLOUR_SETS.iter().filter_map(&mut whole).collect()
}

/// Properties of the numbers of a colour, over all of its columns, that decide their scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ColourNumbers {
    /// Greatest finite number.
    greatest: f32,
    are_whole: bool,
    /// Number that represents 1, if all columns have the same type of unsigned integers.
    of_type: Option<f32>,
}

impl ColourNumbers {
    /// Collects the properties of the columns of a colour.
    pub(crate) fn of<'a>(columns: impl IntoIterator<Item = &'a Values>) -> Self {
        columns
            .into_iter()
            .map(|column| {
                let range = column.finite_range();
                Self {
                    greatest: range.map_or(0.0, |[_, greatest]| narrowed(greatest)),
                    are_whole: column.are_whole(),
                    of_type: match column {
                        Values::U8(_) => Some(255.0),
                        Values::U16(_) => Some(65535.0),
                        _ => None,
                    },
                }
            })
            .reduce(Self::and)
            .unwrap_or(Self {
                greatest: 0.0,
                are_whole: true,
                of_type: None,
            })
    }

    /// Collects the properties of floats that are in no column.
    pub(crate) fn of_floats(numbers: impl Iterator<Item = f32> + Clone) -> Self {
        let finite = numbers.filter(|x| x.is_finite());
        Self {
            greatest: finite.clone().fold(0.0, f32::max),
            are_whole: finite.clone().all(|x| x.fract() == 0.0),
            of_type: None,
        }
    }

    /// Combines the properties of these numbers with those of others.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            greatest: self.greatest.max(other.greatest),
            are_whole: self.are_whole && other.are_whole,
            of_type: self.of_type.filter(|_| self.of_type == other.of_type),
        }
    }
}

/// Scale by which numbers represent colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ColourScale {
    /// Number that represents 1.
    full: f32,
    is_encoded: bool,
    /// True if the numbers decided the scale, and not their type.
    is_guessed: bool,
}

impl ColourScale {
    /// Returns the scale of the numbers of a set; `set` is `None` for a vector.
    pub(crate) fn of(set: Option<&ColourSet>, numbers: ColourNumbers) -> Self {
        /// Greatest excess over 1 through rounding.
        const ROUNDING: f32 = 1e-3;
        /// Brightest linear number: four stops above white.
        const BRIGHTEST: f32 = 16.0;
        let may_be_linear = set.is_some_and(|set| set.may_be_linear);
        let ColourNumbers {
            greatest,
            are_whole,
            of_type,
        } = numbers;
        let is_share = greatest <= 1.0 + ROUNDING;
        let is_bright = may_be_linear && !are_whole && greatest <= BRIGHTEST;
        let by_greatest = match greatest {
            _ if is_share || is_bright => 1.0,
            g if g <= 255.5 => 255.0,
            _ => 65535.0,
        };
        let (full, is_guessed) = match of_type {
            Some(full) if full > 255.0 && greatest <= 255.0 && !is_share => (255.0, true),
            Some(full) => (full, false),
            None => (by_greatest, by_greatest > 1.0),
        };
        Self {
            full,
            is_encoded: !may_be_linear || full > 1.0,
            is_guessed,
        }
    }

    /// Converts a channel to a linear number, at least 0; NaN stays NaN.
    pub(crate) fn linear(self, number: f32) -> f32 {
        let share = self.share(number);
        match self.is_encoded {
            true => linear_from_srgb(share),
            false => share,
        }
    }

    /// Converts a channel to an sRGB-encoded number.
    pub(crate) fn encoded(self, number: f32) -> f32 {
        let share = self.share(number);
        match self.is_encoded {
            true => share,
            false => srgb_from_linear(share),
        }
    }

    /// Returns the number that represents 1.
    pub(crate) fn full(self) -> f32 {
        self.full
    }

    /// Divides a number by the one that represents 1. The result is at least 0; NaN stays NaN.
    pub(crate) fn share(self, number: f32) -> f32 {
        (number / self.full).clamp(0.0, f32::INFINITY)
    }

    /// Returns the assumption about the scale, as the end of a sentence about colours; `None` if nothing was guessed.
    pub(crate) fn assumed(self) -> Option<&'static str> {
        self.is_guessed.then_some(match self.full {
            full if full > 255.0 => "exceed 255 and are taken as 0 to 65535, encoded by sRGB",
            _ => "exceed 1 and are taken as 0 to 255, encoded by sRGB",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_names_say_how_colours_are_stored() {
        let [rgb, red, _] = &COLOUR_SETS;
        let floats = |x: f32| Values::F32(vec![0.0, x, f32::NAN]);
        let scale = |set, column: Values| ColourScale::of(set, ColourNumbers::of([&column]));
        // Half of full linear intensity encodes to 188 of 255.
        for (set, column, number, linear) in [
            (Some(rgb), floats(1.0), 0.5, 0.5),
            (Some(rgb), floats(2.5), 2.5, 2.5),
            (Some(rgb), floats(255.0), 255.0, 1.0),
            (Some(rgb), floats(200.5), 188.0, 0.5),
            (Some(rgb), Values::U8(vec![1]), 188.0, 0.5),
            (Some(red), floats(0.9), 0.737, 0.5),
            (Some(red), floats(2.5), 255.0, 1.0),
            (Some(red), floats(60_000.0), 65535.0, 1.0),
            (Some(red), Values::U16(vec![256]), 65535.0, 1.0),
            (Some(red), Values::U16(vec![200]), 255.0, 1.0),
            (None, floats(1.0), 0.737, 0.5),
            (None, Values::U8(vec![0]), 255.0, 1.0),
        ] {
            let found = scale(set, column.clone()).linear(number);
            assert!((found - linear).abs() < 6e-3, "{set:?} {column:?}: {found}");
        }
    }
}
