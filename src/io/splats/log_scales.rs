//! Resolves scales that may be logarithms: those of splats in glTF files, and the columns `scale_0..2` of tables.
//!
//! By definition, both are standard deviations, but natural logarithms also occur. Drafts of the glTF extension used
//! them, and programs export the columns of PLY splats unchanged. Standard deviations are never negative; nearly all
//! logarithms in a scene are.

use crate::data::dataset::{Dataset, FieldSource, Geometry};
use crate::data::shape_columns::SCALES;
use crate::scene::Values;

/// Meaning of the scales of splats in glTF files and of the columns `scale_0..2` of tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaleMeaning {
    /// Standard deviations.
    Linear,
    /// Their natural logarithms.
    Logarithms,
}

/// Converts scales that are logarithms to standard deviations. If `meaning` is `None`, they are logarithms if any is
/// negative. Returns the number of converted scales.
pub(in crate::io) fn settle_splats(
    scales: &mut [[f32; 3]],
    meaning: Option<ScaleMeaning>,
) -> usize {
    let is_negative = || scales.iter().flatten().any(|s| *s < 0.0);
    if !are_logarithms(meaning, is_negative) {
        return 0;
    }
    for scale in scales.iter_mut().flatten() {
        *scale = scale.exp();
    }
    scales.len()
}

/// Converts the columns of a table with scales and rotations, and adds a note. Returns true if there are such columns.
pub(in crate::io) fn settle_table(data: &mut Dataset, meaning: Option<ScaleMeaning>) -> bool {
    let Geometry::Points { positions } = &data.geometry else {
        return false;
    };
    let count = positions.len();
    let column = |name: &str| {
        let is_it =
            |f: &crate::io::Field| f.name == name && matches!(f.source, FieldSource::Scalar(_));
        data.fields.iter().position(is_it)
    };
    let places: Option<Vec<usize>> = SCALES.iter().map(|name| column(name)).collect();
    let Some(places) = places else {
        return false;
    };
    let scales = &places[..3];
    let values = |place: &usize| match &data.fields[*place].source {
        FieldSource::Scalar(values) => values.clone(),
        _ => Values::F32(Vec::new()),
    };
    let columns: Vec<Values> = scales.iter().map(values).collect();
    let is_negative = || {
        let mut all = columns.iter().flat_map(|c| (0..c.len()).map(|i| c.get(i)));
        all.any(|s| s < 0.0)
    };
    if are_logarithms(meaning, is_negative) {
        for (place, column) in scales.iter().zip(&columns) {
            let exponentials = (0..column.len()).map(|i| column.get(i).exp()).collect();
            data.fields[*place].source = FieldSource::Scalar(Values::F32(exponentials));
        }
        data.notes.push(note(count, "particles", meaning));
    }
    true
}

fn are_logarithms(meaning: Option<ScaleMeaning>, is_negative: impl FnOnce() -> bool) -> bool {
    match meaning {
        Some(meaning) => meaning == ScaleMeaning::Logarithms,
        None => is_negative(),
    }
}

/// Returns the note on scales that were taken as logarithms.
pub(in crate::io) fn note(count: usize, of: &str, meaning: Option<ScaleMeaning>) -> String {
    match meaning {
        Some(_) => format!("The scales of {count} {of} are taken as logarithms."),
        None => format!(
            "The scales of {count} {of} are taken as logarithms, because some are negative, which standard deviations are not."
        ),
    }
}
