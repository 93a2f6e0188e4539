//! Finds vectors at the points of data sets.

use glam::DVec3;

use super::association::Association;
use super::dataset::{Dataset, Field, FieldSource};
use crate::error::{Error, Result};
use crate::scene::Values;

/// Returns whether a field has vectors of two or three components at points.
pub(crate) fn is_vector(field: &Field) -> bool {
    field.association == Association::Nodes && matches!(field.arrays().len(), 2 | 3)
}

/// Returns the place that an error on vectors names.
pub(crate) fn place(what: &str, name: &str) -> String {
    format!("{what} `{}`", name.chars().take(60).collect::<String>())
}

/// Returns the vectors of the field of this name, ignoring case. Vectors of two components have
/// z = 0.
///
/// - `what`: the use of the vectors, for errors.
///
/// # Errors
/// No field of that name at points; a field of one component or more than three.
pub(crate) fn vectors(dataset: &Dataset, what: &str, name: &str) -> Result<Vec<DVec3>> {
    let name = name.strip_suffix("@nodes").unwrap_or(name);
    let is_named = |field: &&Field| field.name.eq_ignore_ascii_case(name);
    let named = || dataset.fields.iter().filter(is_named);
    if let Some(field) = named().find(|field| is_vector(field)) {
        let at = |values: Option<&Values>, i: usize| values.map_or(0.0, |values| values.wide(i));
        let [x, y, z] = [0, 1, 2].map(|axis| field.arrays().get(axis));
        let count = x.map_or(0, Values::len);
        return Ok((0..count)
            .map(|i| DVec3::new(at(x, i), at(y, i), at(z, i)))
            .collect());
    }
    let found = match named().next() {
        None => "no field of that name".to_owned(),
        Some(field) if field.association == Association::Cells => "a field of cells".to_owned(),
        Some(Field {
            source: FieldSource::Vector(all),
            ..
        }) => format!("{} components", all.len()),
        Some(_) => "a scalar".to_owned(),
    };
    let names: Vec<&str> = dataset
        .fields
        .iter()
        .filter(|f| is_vector(f))
        .map(|f| f.name.as_str())
        .collect();
    let expected = match names.is_empty() {
        true => "a vector field at points, of which there is none".to_owned(),
        false => format!("a vector field at points: one of {}", names.join(", ")),
    };
    let advice = match names.is_empty() {
        true => "leave it out",
        false => "name one of these",
    };
    Err(Error::format(
        &dataset.path,
        place(what, name),
        expected,
        found,
        advice,
    ))
}

/// Returns the vectors of a field, or of three scalars, given as `NAME,NAME,NAME`.
///
/// # Errors
/// The errors of [`vectors`]; no scalars of these names at points.
pub(crate) fn vectors_or_scalars(dataset: &Dataset, what: &str, name: &str) -> Result<Vec<DVec3>> {
    let components: Vec<&str> = name.split(',').collect();
    if components.len() != 3 {
        return vectors(dataset, what, name);
    }
    let mut columns = Vec::with_capacity(3);
    for component in components {
        let (association, values) = dataset.scalar(component.trim())?;
        if association == Association::Cells {
            return Err(Error::format(
                &dataset.path,
                place(what, name),
                "scalars at points",
                "one of cells",
                "name others",
            ));
        }
        columns.push(values);
    }
    let count = columns.iter().map(Values::len).min().unwrap_or(0);
    let at = |i: usize| DVec3::from([0, 1, 2].map(|axis: usize| columns[axis].wide(i)));
    Ok((0..count).map(at).collect())
}
