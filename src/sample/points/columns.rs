//! Finds the columns of a table by name.

use super::neighbourhoods::Neighbourhoods;
use crate::data::association::Association;
use crate::data::colour_columns::{
    COLOUR_SETS, ColourNumbers, ColourScale, ColourSet, colour_sets,
};
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::shape_columns::{SCALES, VARIANCE};
use crate::data::smoothing::Smoothing;
use crate::error::{Error, Result};
use crate::sample::field::field_choice::{FieldChoice, describes_the_grid};
use crate::sample::scalar::{TakenScalar, check_len};
use crate::scene::Values;

/// Columns with a meaning of their own: none of them is the default field to show.
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

/// Fields preferred if none is named.
pub(super) const DENSITIES: [&str; 2] = ["rho", "density"];

/// Quantities that scanners measure besides positions.
pub(super) const INTENSITIES: [&str; 2] = ["intensity", "reflectance"];

/// The colours of a table.
#[derive(Clone, Copy)]
pub(super) struct Colours<'a> {
    /// The set of their columns' names; `None` for a vector.
    pub(super) set: Option<&'static ColourSet>,
    pub(super) channels: [&'a Values; 3],
    /// True if the table has further colours.
    pub(super) has_others: bool,
}

impl Colours<'_> {
    /// The facts that decide the scale of the numbers.
    pub(super) fn numbers(&self) -> ColourNumbers {
        ColourNumbers::of(self.channels)
    }

    /// The scale of the numbers.
    ///
    /// - `all`: the facts about all rows; `None` if these rows are all.
    pub(super) fn scale(&self, all: Option<ColourNumbers>) -> ColourScale {
        ColourScale::of(self.set, all.unwrap_or_else(|| self.numbers()))
    }
}

/// The columns of a table, by name.
#[derive(Clone, Copy)]
pub(super) struct Columns<'a> {
    pub(super) dataset: &'a Dataset,
    pub(super) count: usize,
    /// Sizes of bare points from their neighbours, if known already.
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

    /// Returns red, green and blue: the first complete set of columns named as colours, or else the first array
    /// that holds colours ([`Field::is_colour`]).
    ///
    /// # Errors
    /// Columns of different lengths.
    pub(super) fn colours(&self) -> Result<Option<Colours<'a>>> {
        let sets = self.colour_sets();
        let Some((set, _)) = sets.first() else {
            return Ok(self.colour_vector());
        };
        Ok(self.set(set.names)?.map(|channels| Colours {
            set: Some(set),
            channels,
            has_others: sets.len() > 1 || self.colour_vector().is_some(),
        }))
    }

    fn colour_vector(&self) -> Option<Colours<'a>> {
        let of_nodes = |f: &&Field| f.association == Association::Nodes && f.is_colour();
        let mut found = self.dataset.fields.iter().filter(of_nodes);
        match &found.next()?.source {
            FieldSource::Vector(components) => match components.as_slice() {
                [r, g, b, ..] if r.len() == self.count => Some(Colours {
                    set: None,
                    channels: [r, g, b],
                    has_others: found.next().is_some(),
                }),
                _ => None,
            },
            _ => None,
        }
    }

    /// Returns true if one or two columns of a set are present whose names mean colours and nothing else.
    pub(super) fn has_part_of_colours(&self) -> bool {
        let is_there = |name: &str| matches!(self.get(name), Ok(Some(_)));
        let named = COLOUR_SETS.iter().filter(|set| set.alpha.len() > 1);
        let count = |set: &ColourSet| set.names.iter().filter(|name| is_there(name)).count();
        named.map(count).any(|count| count == 1 || count == 2)
    }

    /// Returns the sets of colour columns of which all three are present.
    fn colour_sets(&self) -> Vec<(&'static ColourSet, [(); 3])> {
        colour_sets(|name| {
            let is_it = |f: &Field| {
                f.association == Association::Nodes
                    && matches!(f.source, FieldSource::Scalar(_))
                    && f.name.eq_ignore_ascii_case(name)
            };
            self.dataset.fields.iter().any(is_it).then_some(())
        })
    }

    /// Returns a column whose name has a meaning in tables; `None` for snapshots, whose fields do not follow
    /// it.
    pub(super) fn of_table(&self, name: &str) -> Result<Option<&'a Values>> {
        match self.dataset.smoothing {
            None => self.get(name),
            Some(_) => Ok(None),
        }
    }

    /// Returns the first column that may be a density, if it is not constant. The result is the same for any
    /// subset of the rows.
    #[cfg(feature = "prepared")]
    pub(super) fn first_density(&self) -> Option<String> {
        let densities = [&DENSITIES[..], &[self.names().2]].concat();
        let chosen = self.varying(&densities)?;
        let is_density = |f: &&Field| densities.iter().any(|d| d.eq_ignore_ascii_case(&f.name));
        let first = self.dataset.fields.iter().find(is_density)?;
        (first.name == chosen).then_some(chosen)
    }

    /// Returns true if a table states shapes whose meaning does not depend on other rows. Scales do not count:
    /// they are logarithms if any is negative.
    pub(super) fn states_shape(&self) -> bool {
        let lengths = ["sigma", "radius", self.names().0];
        let is_there = |name: &str| matches!(self.of_table(name), Ok(Some(_)));
        lengths.into_iter().any(is_there) || matches!(self.set(VARIANCE), Ok(Some(_)))
    }

    /// Returns true if some rows of a table state colours.
    pub(super) fn states_colour(&self) -> bool {
        !self.colour_sets().is_empty() || self.named_vectors().next().is_some()
    }

    /// Returns true if an array may hold colours, which depends on all rows.
    #[cfg(feature = "prepared")]
    pub(super) fn may_have_colour_vector(&self) -> bool {
        let is_typed = |f: &Field| f.arrays().iter().all(|a| matches!(a, Values::U8(_)));
        self.named_vectors().any(|f| !is_typed(f))
    }

    /// Returns arrays with names of colours.
    fn named_vectors(&self) -> impl Iterator<Item = &'a Field> {
        let is_vector = |f: &&Field| matches!(f.source, FieldSource::Vector(_));
        let vectors = self.dataset.fields.iter().filter(is_vector);
        vectors.filter(|f| f.is_named_colour())
    }

    /// Returns true if a table states strengths.
    pub(super) fn states_strength(&self) -> bool {
        let is_there = |name: &str| matches!(self.of_table(name), Ok(Some(_)));
        ["mass", "extinction", "opacity"].into_iter().any(is_there)
    }

    /// Returns all columns of a set, or `None` if none is present; a part of them is an error.
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

    /// Returns the only one present among several alternatives.
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

    /// Returns a scalar that no column stores: a vector's magnitude or component, or a derived one.
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

    /// Returns the names of the fields with lengths, masses and densities of smoothed particles; empty if the
    /// format has none.
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

    /// Returns the default field: a density if there is one, else, if `any` is true, the first varying column
    /// without a meaning of its own.
    ///
    /// - `preferred`: takes precedence if it is one of these, constant or not.
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

    /// Returns the columns among which [`Self::default_field`] chooses, in the data's order.
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

    /// Returns the default field, with `varies` deciding which columns vary.
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

    /// Returns the first varying column without a meaning of its own, among these names or among all.
    pub(super) fn varying(&self, names: &[&str]) -> Option<String> {
        self.first_that(names, &is_varied)
    }

    /// Returns the first such column, with `varies` deciding which columns vary.
    pub(super) fn first_that(
        &self,
        names: &[&str],
        varies: &dyn Fn(&str, &Values) -> bool,
    ) -> Option<String> {
        let is = |name: &str, list: &[&str]| list.iter().any(|l| l.eq_ignore_ascii_case(name));
        let (length, mass, _) = self.names();
        let own = [length, mass];
        let sets = self.colour_sets();
        let of_colours: Vec<&str> = sets.iter().flat_map(|(set, _)| set.names).collect();
        let kept: [&[&str]; 5] = [&RESERVED, &VARIANCE, &SCALES, &of_colours, &own];
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
