//! Scales that may be logarithms: those of splats in glTF files, and the columns `scale_0..2` of tables.
//!
//! Both are standard deviations by their definitions, and both are met as natural logarithms: drafts of the glTF extension had them,
//! and programs export the columns of PLY splats as they are. Of standard deviations none is negative; of the logarithms of
//! a scene nearly all are.

use super::dataset::{Dataset, FieldSource, Geometry};
use super::shape_columns::SCALES;
use crate::scene::Values;

/// What scales of splats in glTF files and columns `scale_0..2` of tables are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaleMeaning {
    /// Standard deviations.
    Linear,
    /// Their natural logarithms.
    Logarithms,
}

/// Takes scales as what they are said to be or, where nothing is said, as logarithms if any is negative. How many became standard
/// deviations.
pub(super) fn settle_splats(scales: &mut [[f32; 3]], meaning: Option<ScaleMeaning>) -> usize {
    let is_negative = || scales.iter().flatten().any(|s| *s < 0.0);
    if !are_logarithms(meaning, is_negative) {
        return 0;
    }
    for scale in scales.iter_mut().flatten() {
        *scale = scale.exp();
    }
    scales.len()
}

/// The same of a table's columns, where it has scales and rotations; a note says so. Whether there are such columns.
pub(super) fn settle_table(data: &mut Dataset, meaning: Option<ScaleMeaning>) -> bool {
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

/// What is said of logarithms that were taken as such.
pub(super) fn note(count: usize, of: &str, meaning: Option<ScaleMeaning>) -> String {
    match meaning {
        Some(_) => format!("The scales of {count} {of} are taken as logarithms."),
        None => format!(
            "The scales of {count} {of} are taken as logarithms, because some are negative, which standard deviations are not."
        ),
    }
}
