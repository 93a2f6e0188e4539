//! Loads the fields of `ewa-splat render --column-density --column-mean FIELD`: the mean of a field along each ray, or on a
//! slice.
//!
//! The weight is the quantity that the columns integrate: the mass, if it is known.

use crate::Result;
use crate::sample::SampleOptions;
use crate::scene::PointVolume;
use indicatif::ProgressBar;

use crate::command::input::DataOptions;
use crate::load::Input;

/// Volumes from which the columns of a mean are drawn.
pub(crate) struct ColumnMean {
    /// Name of the field in a legend.
    pub(crate) title: String,
    /// The volumes whose columns are the weights.
    pub(crate) weights: Vec<PointVolume>,
    /// The same volumes with the values of the field.
    pub(crate) fields: Vec<PointVolume>,
}

/// Returns the volumes of a mean.
///
/// # Errors
/// The errors of loading; a field that is absent.
pub(crate) fn weighed(
    data: &DataOptions,
    inputs: &[Input],
    (volumes, field): (&[PointVolume], &str),
    options: &SampleOptions,
    progress: &ProgressBar,
) -> Result<ColumnMean> {
    let options = SampleOptions {
        field: Some(field.into()),
        ..options.clone()
    };
    let scene = data.scene(inputs, &options, &|_, _| Ok(Vec::new()), progress)?;
    let mut titles = scene.titles.into_iter().flatten();
    Ok(ColumnMean {
        title: titles.next().unwrap_or_else(|| field.to_owned()),
        weights: volumes.to_vec(),
        fields: scene.volumes,
    })
}
