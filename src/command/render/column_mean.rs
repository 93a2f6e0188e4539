//! Loads the fields of `ewa-splat render --column-density --column-mean FIELD`: the mean of a field along each ray, or on a
//! slice.
//!
//! The weight is the quantity that the columns integrate: the mass, if it is known.

use crate::Result;
use crate::render::ColumnMeans;
use crate::sample::{MeanPart, PurposeOptions, SampleOptions};
use crate::scene::PointVolume;
use indicatif::ProgressBar;

use crate::command::input::DataOptions;
use crate::load::Input;

/// A mean along rays.
pub(crate) struct ColumnMean {
    /// Name of the field in a legend.
    pub(crate) title: String,
    pub(crate) means: ColumnMeans,
}

impl ColumnMean {
    /// Loads a field, and makes the scenes of its mean.
    ///
    /// - `is_slice`: whether the mean is drawn on a plane.
    ///
    /// # Errors
    /// The errors of loading, and of [`ColumnMeans::new`].
    pub(crate) fn new(
        data: &DataOptions,
        inputs: &[Input],
        (volumes, field, is_slice): (&[PointVolume], &str, bool),
        options: &SampleOptions,
        progress: &ProgressBar,
    ) -> Result<Self> {
        let options = SampleOptions {
            field: Some(field.into()),
            purpose: PurposeOptions {
                mean: MeanPart::Field,
                ..options.purpose
            },
            ..options.clone()
        };
        let scene = data.scene(inputs, &options, &|_, _| Ok(Vec::new()), progress)?;
        let mut titles = scene.titles.into_iter().flatten();
        Ok(Self {
            title: titles.next().unwrap_or_else(|| field.to_owned()),
            means: ColumnMeans::new(volumes, &scene.volumes, is_slice)?,
        })
    }
}
