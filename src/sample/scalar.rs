//! Takes the scalar that is shown out of a data set.

use std::path::Path;

use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::{Advice, Error, Hint, Result};
use crate::sample::report::SampleReport;
use crate::scene::Values;

/// Least memory \[bytes\] per node of a curvilinear grid or of cells during sampling and sorting, beyond the
/// data read. Measured with local models: three million nodes, 28 bytes each once read, take 179 bytes each at
/// the peak.
pub(crate) const LEAST_PER_NODE: usize = 60;

/// The field to show and its values, taken out of the data set.
pub(crate) struct TakenScalar {
    pub(crate) name: String,
    pub(crate) association: Association,
    pub(crate) values: Values,
}

/// Takes the scalar of a selector ([`Dataset::scalar`]); moves it if the data set stores it.
pub(crate) fn take_scalar(dataset: &mut Dataset, selector: &str) -> Result<TakenScalar> {
    let whole = match dataset.selected(selector) {
        Some((field, None)) => {
            let mut fields = dataset.fields.iter();
            fields.position(|other| std::ptr::eq(other, field))
        }
        _ => None,
    };
    let stored = whole.and_then(|i| match &mut dataset.fields[i] {
        Field {
            association,
            source: FieldSource::Scalar(values),
            ..
        } => Some((*association, values)),
        _ => None,
    });
    let (association, values) = match stored {
        Some((association, values)) => (
            association,
            std::mem::replace(values, Values::U8(Vec::new())),
        ),
        None => dataset.scalar(selector)?,
    };
    Ok(TakenScalar {
        name: selector.to_owned(),
        association,
        values,
    })
}

/// Checks that there is one value per sample.
pub(crate) fn check_len(dataset: &Dataset, taken: &TakenScalar, expected: usize) -> Result<()> {
    if taken.values.len() == expected {
        return Ok(());
    }
    Err(Error::format(
        &dataset.path,
        format!("field `{}`", taken.name),
        format!("{expected} values"),
        format!("{} values", taken.values.len()),
        "the file is damaged",
    ))
}

/// Returns the error for a data set without anything to draw.
pub(crate) fn nothing_left(path: &Path, report: &SampleReport) -> Error {
    let found = report.warnings().join(", ");
    Error::format(
        path,
        "samples",
        "at least one that can be drawn",
        if found.is_empty() {
            "none".into()
        } else {
            found
        },
        Hint::LookAtFile,
    )
}

/// Checks that there is at least one sample and fewer than 2³².
pub(crate) fn check_count(dataset: &Dataset, count: usize) -> Result<()> {
    if count == 0 || u32::try_from(count).is_err() {
        return Err(Error::format(
            &dataset.path,
            "samples",
            "between 1 and 2^32 - 1 samples",
            count.to_string(),
            match count {
                0 => Advice::no_data("the file holds no data: save another"),
                _ => "split the data set".into(),
            },
        ));
    }
    Ok(())
}
