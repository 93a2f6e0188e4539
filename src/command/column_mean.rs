//! `ewa-splat render --column-density --column-mean FIELD`: the mean of a field along each ray, weighed by what columns
//! are of.

use crate::sample::SampleOptions;
use crate::scene::{PointVolume, Strength, Values};
use crate::{ColumnImage, Error, Result};
use indicatif::ProgressBar;

use super::input::DataOptions;
use super::source::Input;

/// The option's name, for errors.
const OPTION: &str = "--column-mean";

/// What the columns of a mean are divided by others for.
pub(crate) struct ColumnMean {
    /// What a legend calls the field.
    pub(crate) title: String,
    /// What its sums are of.
    pub(crate) weighed: Vec<PointVolume>,
}

/// What columns of the mean are divided from: the volumes whose columns are those of `volumes` times a field, particle
/// by particle.
///
/// # Errors
/// A field that is not there, or that some particle has no value of.
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
    let pairs = volumes.iter().zip(scene.volumes);
    let weighed = pairs.map(|(volume, of_field)| times(volume, &of_field));
    Ok(ColumnMean {
        title: titles.next().unwrap_or_else(|| field.to_owned()),
        weighed: weighed.collect::<Result<_>>()?,
    })
}

fn times(volume: &PointVolume, of_field: &PointVolume) -> Result<PointVolume> {
    let fault = |expected: &str, found: String| {
        let advice = "name a field that all particles have";
        Error::invalid(OPTION, "field", expected, found, advice)
    };
    let (count, expected) = (volume.particles.len(), "a value for each particle");
    let field = of_field.values.as_ref();
    let field = field.ok_or_else(|| fault(expected, "none".into()))?;
    if field.len() != count {
        return Err(fault(&format!("{count} values"), field.len().to_string()));
    }
    let mut product = volume.clone();
    let scaled = |own: f32, i: usize| own * field.get(i);
    match (&mut product.strength, &volume.values) {
        (Strength::Classified { .. }, Some(values)) => {
            let values = (0..count).map(|i| scaled(values.get(i), i));
            product.values = Some(Values::F32(values.collect()));
        }
        (Strength::Mass(masses), _) => {
            // A mass is positive: the sign of the field has no place in it.
            if field.finite_range().is_some_and(|[least, _]| least < 0.0) {
                return Err(fault(
                    "values from 0 up, beside masses",
                    "values below 0".into(),
                ));
            }
            for (i, mass) in masses.iter_mut().enumerate() {
                *mass = scaled(*mass, i);
            }
        }
        _ => return Err(fault("a volume or particles", "surfaces or splats".into())),
    }
    Ok(product)
}

/// One column over another, pixel by pixel; NaN where there is nothing to divide by.
pub(crate) fn quotient(sums: &ColumnImage, weights: &ColumnImage) -> ColumnImage {
    let mean = |(sum, weight): (&f32, &f32)| match *weight > 0.0 {
        true => sum / weight,
        false => f32::NAN,
    };
    ColumnImage {
        values: sums.values.iter().zip(&weights.values).map(mean).collect(),
        ..sums.clone()
    }
}
