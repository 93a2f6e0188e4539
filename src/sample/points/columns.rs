//! The columns of a table, by name.

use super::super::{FieldChoice, TakenScalar, check_len, describes_the_grid};
use super::neighbourhoods::Neighbourhoods;
use crate::error::{Error, Result};
use crate::image::linear_from_srgb;
use crate::io::{Association, Dataset, Field, FieldSource, SCALES, Smoothing, VARIANCE};
use crate::scene::Values;

pub(super) const RGB: [&str; 3] = ["r", "g", "b"];
/// The names that scanners give to colours: bytes, as displays take them.
pub(super) const RED_GREEN_BLUE: [&str; 3] = ["red", "green", "blue"];

/// Columns with a meaning of their own: none is the field to show by default.
pub(super) const RESERVED: [&str; 12] = [
    "x",
    "y",
    "z",
    "sigma",
    "h",
    "radius",
    "mass",
    "m",
    "extinction",
    "volume",
    "opacity",
    "id",
];

/// Fields preferred where none is named.
pub(super) const DENSITIES: [&str; 2] = ["rho", "density"];

/// What scanners measure beside places.
pub(super) const INTENSITIES: [&str; 2] = ["intensity", "reflectance"];

/// A channel of a colour: as it is, or decoded from sRGB where it is a byte.
pub(super) fn linear_channel(column: &Values, i: usize) -> f32 {
    match column {
        Values::U8(bytes) => linear_from_srgb(f32::from(bytes[i]) / 255.0),
        _ => column.get(i),
    }
}

/// The columns of a table, by name.
#[derive(Clone, Copy)]
pub(super) struct Columns<'a> {
    pub(super) dataset: &'a Dataset,
    pub(super) count: usize,
    /// What neighbours say of bare points, where it is known already.
    pub(super) neighbourhoods: Option<&'a Neighbourhoods>,
}

impl<'a> Columns<'a> {
    pub(super) fn of(dataset: &'a Dataset, count: usize) -> Self {
        Self {
            dataset,
            count,
            neighbourhoods: None,
        }
    }
}

impl<'a> Columns<'a> {
    pub(super) fn get(&self, name: &str) -> Result<Option<&'a Values>> {
        let stored = self.dataset.fields.iter().find_map(|f| match &f.source {
            FieldSource::Scalar(values)
                if f.association == Association::Nodes && f.name.eq_ignore_ascii_case(name) =>
            {
                Some(values)
            }
            _ => None,
        });
        match stored {
            Some(values) if values.len() != self.count => Err(Error::format(
                &self.dataset.path,
                format!("column `{name}`"),
                format!("{} values", self.count),
                format!("{} values", values.len()),
                "the file is damaged",
            )),
            stored => Ok(stored),
        }
    }

    /// Red, green and blue of the first array that holds colours ([`Field::is_colour`]).
    pub(super) fn colours(&self) -> Option<[&'a Values; 3]> {
        let of_nodes = |f: &&Field| f.association == Association::Nodes && f.is_colour();
        let found = self.dataset.fields.iter().find(of_nodes)?;
        match &found.source {
            FieldSource::Vector(components) => match components.as_slice() {
                [r, g, b, ..] if r.len() == self.count => Some([r, g, b]),
                _ => None,
            },
            _ => None,
        }
    }

    /// A column whose name has a meaning in tables, which says nothing of a snapshot's fields.
    pub(super) fn of_table(&self, name: &str) -> Result<Option<&'a Values>> {
        match self.dataset.smoothing {
            None => self.get(name),
            Some(_) => Ok(None),
        }
    }

    /// The first column that may be a density, if it is not constant: whichever rows these are, that is the one.
    #[cfg(feature = "prepared")]
    pub(super) fn first_density(&self) -> Option<String> {
        let densities = [&DENSITIES[..], &[self.names().2]].concat();
        let chosen = self.varying(&densities)?;
        let is_density = |f: &&Field| densities.iter().any(|d| d.eq_ignore_ascii_case(&f.name));
        let first = self.dataset.fields.iter().find(is_density)?;
        (first.name == chosen).then_some(chosen)
    }

    /// Whether there are shapes, of a table, whose meaning does not depend on others: scales are logarithms where any is
    /// negative.
    #[cfg(feature = "prepared")]
    pub(super) fn states_shape(&self) -> bool {
        let lengths = ["sigma", "radius", self.names().0];
        let is_there = |name: &str| matches!(self.of_table(name), Ok(Some(_)));
        lengths.into_iter().any(is_there) || matches!(self.set(VARIANCE), Ok(Some(_)))
    }

    /// Whether there are colours.
    #[cfg(feature = "prepared")]
    pub(super) fn states_colour(&self) -> bool {
        let is_there = |rgb| !matches!(self.set(rgb), Ok(None));
        [RGB, RED_GREEN_BLUE].into_iter().any(is_there) || self.colours().is_some()
    }

    /// Whether there are strengths, of a table.
    #[cfg(feature = "prepared")]
    pub(super) fn states_strength(&self) -> bool {
        let is_there = |name: &str| matches!(self.of_table(name), Ok(Some(_)));
        ["mass", "extinction", "opacity"].into_iter().any(is_there)
    }

    /// All columns of a set, or none; some of them are an error.
    pub(super) fn set<const N: usize>(&self, names: [&str; N]) -> Result<Option<[&'a Values; N]>> {
        let mut columns = Vec::with_capacity(N);
        for name in names {
            columns.push(self.get(name)?);
        }
        let present: Vec<&'a Values> = columns.iter().copied().flatten().collect();
        if present.is_empty() {
            return Ok(None);
        }
        if let Some(missing) = columns.iter().position(Option::is_none) {
            return Err(Error::format(
                &self.dataset.path,
                "columns",
                names.join(", "),
                format!("no `{}`", names[missing]),
                "give all of these or none",
            ));
        }
        Ok(present.try_into().ok())
    }

    /// The only one present of several alternatives.
    pub(super) fn one_of<T, const N: usize>(
        &self,
        what: &str,
        alternatives: [(&str, Option<T>); N],
    ) -> Result<Option<T>> {
        let present: Vec<(&str, T)> = alternatives
            .into_iter()
            .filter_map(|(name, t)| t.map(|t| (name, t)))
            .collect();
        if present.len() > 1 {
            let names: Vec<&str> = present.iter().map(|(name, _)| *name).collect();
            return Err(Error::format(
                &self.dataset.path,
                "columns",
                format!("one kind of {what}"),
                names.join(" and "),
                "drop all but one",
            ));
        }
        Ok(present.into_iter().next().map(|(_, t)| t))
    }

    /// A scalar that no column stores: a vector's magnitude or component, or a derived one.
    pub(super) fn derived(&self, selector: &str) -> Result<Values> {
        let (association, values) = self.dataset.scalar(selector)?;
        let taken = TakenScalar {
            name: selector.into(),
            association,
            values,
        };
        check_len(self.dataset, &taken, self.count)?;
        Ok(taken.values)
    }

    /// The fields with lengths, masses and densities of smoothed particles; empty where the format
    /// has none.
    pub(super) fn names(&self) -> (&'a str, &'a str, &'a str) {
        match &self.dataset.smoothing {
            Some(Smoothing {
                length,
                mass,
                density,
                ..
            }) => {
                let or_none = |name: &'a Option<String>| name.as_deref().unwrap_or("");
                (or_none(length), or_none(mass), or_none(density))
            }
            None => ("h", "m", "rho"),
        }
    }

    /// A density if there is one, else, where `any` will do, the first column without a meaning of
    /// its own that is not constant.
    ///
    /// - `preferred`: chosen before others, if it is one of these, constant or not.
    pub(super) fn default_field(&self, any: bool, preferred: Option<&str>) -> Option<String> {
        let of_all = || {
            let name = preferred?;
            let found = self.first_that(&[name], &|_, _| true)?;
            (any || self.is_density(&found)).then_some(found)
        };
        of_all().or_else(|| self.default_field_that(any, &is_varied))
    }

    fn is_density(&self, name: &str) -> bool {
        let (_, _, density) = self.names();
        let mut densities = DENSITIES.iter().chain(std::iter::once(&density));
        densities.any(|known| known.eq_ignore_ascii_case(name))
    }

    /// The columns among which [`Self::default_field`] chooses, in the data's order.
    pub(super) fn choices(&self) -> Vec<FieldChoice> {
        let mut choices = Vec::new();
        for field in &self.dataset.fields {
            let name = field.name.as_str();
            if self.first_that(&[name], &|_, _| true).as_deref() == Some(name) {
                let rank = if self.is_density(name) { 0 } else { 1 };
                choices.push(FieldChoice::of(name.to_owned(), field, rank));
            }
        }
        choices
    }

    /// The same, where something else tells which columns vary.
    pub(super) fn default_field_that(
        &self,
        any: bool,
        varies: &dyn Fn(&str, &Values) -> bool,
    ) -> Option<String> {
        let (_, _, density) = self.names();
        let densities = [&DENSITIES[..], &[density]].concat();
        let first = self.first_that(&densities, varies);
        first.or_else(|| any.then(|| self.first_that(&[], varies)).flatten())
    }

    /// The first column of these names, or of any, without a meaning of its own that is not constant.
    pub(super) fn varying(&self, names: &[&str]) -> Option<String> {
        self.first_that(names, &is_varied)
    }

    /// The first such column that something else tells to vary.
    pub(super) fn first_that(
        &self,
        names: &[&str],
        varies: &dyn Fn(&str, &Values) -> bool,
    ) -> Option<String> {
        let is = |name: &str, list: &[&str]| list.iter().any(|l| l.eq_ignore_ascii_case(name));
        let (length, mass, _) = self.names();
        let own = [length, mass];
        let kept: [&[&str]; 6] = [&RESERVED, &VARIANCE, &SCALES, &RGB, &RED_GREEN_BLUE, &own];
        let mut varying = self.dataset.fields.iter().filter(|f| match &f.source {
            FieldSource::Scalar(values) => {
                (names.is_empty() || is(&f.name, names))
                    && !kept.iter().any(|list| is(&f.name, list))
                    && !describes_the_grid(&f.name)
                    && varies(&f.name, values)
            }
            _ => false,
        });
        varying.next().map(|f| f.name.clone())
    }
}

fn is_varied(_: &str, values: &Values) -> bool {
    values.finite_range().is_some_and(|[lo, hi]| lo < hi)
}
