//! `ewa-splat render --column-density --column-mean FIELD`: the mean of a field along each ray. Weights are the quantity that
//! the columns integrate: masses, if they are known.

use crate::sample::SampleOptions;
use crate::scene::{Colour, PointVolume, Strength, Values};
use crate::view::Camera;
use crate::{
    Backend, ColumnImage, ColumnSettings, Error, Image, Renderer, Result, SceneOptions, Settings,
    Show,
};
use indicatif::ProgressBar;

use super::input::DataOptions;
use super::source::Input;

/// The option's name, for errors.
const OPTION: &str = "--column-mean";

/// How far from a kernel's centre there is a mean, standard deviations: beyond, less than a ninetieth of its peak.
const REACH: f32 = 3.0;

/// The volumes from which columns of a mean are drawn.
pub(crate) struct ColumnMean {
    /// The name of the field in a legend.
    pub(crate) title: String,
    /// Volumes whose columns are the numerators: weight times field.
    pub(crate) weighed: Vec<PointVolume>,
    /// Volumes whose kernels mark where a mean may stand: see [`shown`].
    pub(crate) places: Vec<PointVolume>,
}

/// The numerators of columns of the mean: volumes whose columns are those of `volumes` times a field, particle by particle.
///
/// # Errors
/// A field that is absent, or that lacks a value of some particle; weights below 0.
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
        places: volumes.iter().map(places).collect(),
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
    if volume.particles.positions() != of_field.particles.positions() {
        return Err(fault(expected, "values of other particles".into()));
    }
    match (&volume.strength, &volume.values) {
        (Strength::Classified { .. }, Some(weights)) => {
            if weights.finite_range().is_some_and(|[least, _]| least < 0.0) {
                return Err(Error::invalid(
                    OPTION,
                    "weights",
                    "values from 0 up",
                    "values below 0",
                    "weigh by another field: --field DENSITY",
                ));
            }
            let products = (0..count).map(|i| weights.get(i) * field.get(i));
            Ok(PointVolume {
                values: Some(Values::F32(products.collect())),
                ..volume.clone()
            })
        }
        // Values times masses, in the place of values times volumes: a mass has no sign, a field may.
        (Strength::Mass(masses), _) => Ok(PointVolume {
            strength: Strength::Classified {
                volumes: masses.clone(),
            },
            colour: of_field.colour.clone(),
            values: of_field.values.clone(),
            transfer_function: of_field.transfer_function.clone(),
            ..volume.clone()
        }),
        _ => Err(fault("a volume or particles", "surfaces or splats".into())),
    }
}

/// Kernels where those of a volume have weights, each as deep as the others: where a mean may stand.
fn places(volume: &PointVolume) -> PointVolume {
    let weight = |i: usize| match (&volume.strength, &volume.values) {
        (Strength::Mass(masses), _) => masses[i],
        (_, Some(values)) => values.get(i),
        (_, None) => 0.0,
    };
    let depth = |i: usize| {
        let (_, factor, _) = volume.particles.shape(i);
        let columns = [factor.x_axis, factor.y_axis, factor.z_axis];
        let longest = columns
            .map(|column| column.length_squared())
            .into_iter()
            .fold(0.0, f64::max);
        match weight(i) > 0.0 {
            true => narrowed(longest),
            false => 0.0,
        }
    };
    PointVolume {
        particles: volume.particles.clone(),
        strength: Strength::Mass((0..volume.particles.len()).map(depth).collect()),
        colour: Colour::Uniform([1.0; 3]),
        values: None,
        transfer_function: None,
        boundary: volume.boundary.clone(),
        normals: None,
        local_models: None,
    }
}

/// As f32, a positive number within its normal ones.
#[allow(clippy::cast_possible_truncation, reason = "clamped to what f32 holds")]
fn narrowed(x: f64) -> f32 {
    x.clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)) as f32
}

/// Counts the kernels within [`REACH`] at each pixel: a mean stands at a pixel if there is one.
///
/// # Errors
/// The errors of any picture.
pub(crate) fn shown(
    places: Vec<PointVolume>,
    on: impl FnOnce(&Renderer) -> Backend,
    camera: &Camera,
    columns: &ColumnSettings,
) -> Result<Image> {
    let options = SceneOptions {
        level_of_detail: false,
        ..SceneOptions::default()
    };
    let renderer = Renderer::with_options(places, &options)?;
    let backend = on(&renderer);
    let mut renderer = renderer.on_backend(backend)?;
    let settings = Settings {
        show: Show::Count,
        cutoff: Some(REACH),
        filter: columns.filter,
        low_pass_variance_px2: columns.low_pass_variance_px2,
        clip: columns.clip.clone(),
        ..Settings::default()
    };
    Ok(renderer.render(camera, &settings)?.clone())
}

/// One column over another, pixel by pixel; NaN where no kernel is, or there is nothing to divide by.
pub(crate) fn quotient(sums: &ColumnImage, weights: &ColumnImage, shown: &Image) -> ColumnImage {
    let pairs = sums.values.iter().zip(&weights.values);
    let mean = |((sum, weight), [count, ..]): ((&f32, &f32), &[f32; 4])| match *weight > 0.0
        && *count > 0.0
    {
        true => sum / weight,
        false => f32::NAN,
    };
    ColumnImage {
        values: pairs.zip(&shown.pixels).map(mean).collect(),
        ..sums.clone()
    }
}
