//! Chooses the field to show if none is named, for one data set or several together.

use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Hint, Result};
use crate::scene::Values;

use crate::sample::field::field_choice::{FieldChoice, describes_the_grid};
use crate::sample::options::SampleOptions;
use crate::sample::points::choices_of_points;

/// The rank of vectors: the last rank of fields whose values are stored.
const OF_VECTORS: u8 = 3;

/// Rank of a field of a grid or a mesh: lower for a field that is more likely meant.
fn rank(dataset: &Dataset, field: &Field) -> u8 {
    let is_plot3d = dataset.format.contains("PLOT3D");
    match (&field.source, field.association) {
        (FieldSource::Scalar(_), _) if is_plot3d && field.name.eq_ignore_ascii_case("density") => 0,
        (FieldSource::Scalar(_), Association::Nodes) => 1,
        (FieldSource::Scalar(_), Association::Cells) => 2,
        (FieldSource::Vector(_), _) => OF_VECTORS,
        (FieldSource::Derived(_), _) => OF_VECTORS + 1,
    }
}

/// Fields of a grid or a mesh that are worth showing.
fn shown(dataset: &Dataset) -> impl Iterator<Item = &Field> {
    let fields = dataset.fields.iter();
    fields.filter(|f| !describes_the_grid(&f.name) && !f.is_colour())
}

/// Returns true if a grid or a mesh has any field to show.
pub(in crate::sample) fn has_choice(dataset: &Dataset) -> bool {
    shown(dataset).next().is_some()
}

/// Returns the fields among which one is chosen if none is named, in the data's order. The list is empty for
/// splats and for meshes with colours of their own.
pub fn field_choices(dataset: &Dataset) -> Vec<FieldChoice> {
    let has_colours = match &dataset.geometry {
        Geometry::Mesh(mesh) => mesh.has_colours(),
        Geometry::Splats(_) => true,
        Geometry::Points { .. } => return choices_of_points(dataset),
        _ => false,
    };
    if has_colours {
        return Vec::new();
    }
    let choice = |f: &Field| FieldChoice::of(dataset.selector_of(f), f, rank(dataset, f));
    shown(dataset).map(choice).collect()
}

/// Chooses the fields that data sets show together if none is named: one field for as many data sets as have
/// it, then another for those that lack it.
///
/// - `choices`: the choices of each data set ([`field_choices`]).
///
/// Preferred are fields that vary over all data sets, then fields that more of the data sets have, then fields
/// of lower rank.
///
/// ```
/// use ewa_splat::sample::{FieldChoice, shared_fields};
///
/// let choice = |name: &str, ranges: &[[f64; 2]]| FieldChoice {
///     name: name.into(),
///     ranges: ranges.to_vec(),
///     rank: 1,
/// };
/// // T is the first of the first block, and p is in both.
/// let blocks = [
///     vec![choice("T", &[[0.0, 1.0]]), choice("p", &[[0.0, 1.0]])],
///     vec![choice("p", &[[2.0, 2.0]])],
/// ];
/// assert_eq!(shared_fields(&blocks), [Some("p".into()), Some("p".into())]);
/// ```
pub fn shared_fields(choices: &[Vec<FieldChoice>]) -> Vec<Option<String>> {
    let mut shared: Vec<Option<String>> = vec![None; choices.len()];
    loop {
        let left: Vec<usize> = (0..choices.len())
            .filter(|&i| shared[i].is_none() && !choices[i].is_empty())
            .collect();
        let Some(best) = best_of(left.iter().map(|&i| choices[i].as_slice())) else {
            return shared;
        };
        for i in left {
            let own = choices[i].iter().find(|own| is_named(own, &best));
            shared[i] = own.map(|own| own.name.clone());
        }
    }
}

fn is_named(choice: &FieldChoice, name: &str) -> bool {
    choice.name.eq_ignore_ascii_case(name)
}

/// Returns the best name among those of several data sets.
fn best_of<'a>(choices: impl Iterator<Item = &'a [FieldChoice]>) -> Option<String> {
    struct Candidate<'a> {
        name: &'a str,
        ranges: Vec<[f64; 2]>,
        rank: u8,
        count: usize,
    }
    let mut all: Vec<Candidate<'_>> = Vec::new();
    let mut places = std::collections::HashMap::new();
    for choice in choices.flatten() {
        let next = all.len();
        let place = *places
            .entry(choice.name.to_ascii_lowercase())
            .or_insert(next);
        if place == next {
            all.push(Candidate {
                name: &choice.name,
                ranges: choice.ranges.clone(),
                rank: choice.rank,
                count: 1,
            });
            continue;
        }
        let own = &mut all[place];
        own.count += 1;
        own.rank = own.rank.min(choice.rank);
        for (i, range) in choice.ranges.iter().enumerate() {
            match own.ranges.get_mut(i) {
                Some([low, high]) => (*low, *high) = (low.min(range[0]), high.max(range[1])),
                None => own.ranges.push(*range),
            }
        }
    }
    let is_constant = |own: &Candidate<'_>| !own.ranges.iter().any(|[low, high]| low < high);
    // The first of equally good ones.
    all.iter()
        .min_by_key(|own| (is_constant(own), std::cmp::Reverse(own.count), own.rank))
        .map(|own| own.name.to_owned())
}

/// Returns the field to show: the named one, else the preferred one if the data set has it, else the likeliest.
///
/// # Errors
/// No field is named and the data set has none.
pub(crate) fn shown_field(dataset: &Dataset, options: &SampleOptions) -> Result<String> {
    let preferred = options.preferred_field.as_ref();
    let preferred = preferred.filter(|name| dataset.selected(name).is_some());
    if let Some(name) = options.field.as_ref().or(preferred) {
        return Ok(name.clone());
    }
    let is_varied = |values: &Values| values.finite_range().is_some_and(|[lo, hi]| lo < hi);
    let varies = |f: &&Field| f.arrays().iter().any(is_varied);
    // Rank by rank, so that no more values are searched than needed.
    let of_rank = |wanted: u8| shown(dataset).filter(move |f| rank(dataset, f) == wanted);
    (0..=OF_VECTORS)
        .find_map(|wanted| of_rank(wanted).find(varies))
        .or_else(|| shown(dataset).next())
        .map(|field| dataset.selector_of(field))
        .ok_or_else(|| {
            let (expected, advice) = ("a field to show", Hint::NameSolution);
            Error::format(&dataset.path, "fields", expected, "none", advice)
        })
}
