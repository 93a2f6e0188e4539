//! Computes `ewa-splat render --column-density --column-mean FIELD`: the mean of a field along each
//! ray.
//!
//! The weight is the quantity that the columns integrate: the mass, if it is known.

use crate::sample::SampleOptions;
use crate::scene::{Colour, PointVolume, Strength, Values};
use crate::view::Camera;
use crate::{
    Backend, ColumnImage, ColumnSettings, Error, Image, Renderer, Result, SceneOptions, Settings,
    Show,
};
use indicatif::ProgressBar;

use crate::command::input::DataOptions;
use crate::load::Input;

/// Name of the option in errors.
const OPTION: &str = "--column-mean";

/// Distance from a kernel's centre up to which a mean is given, standard deviations. Beyond it, the
/// kernel is below a ninetieth of its peak.
pub(crate) const REACH: f32 = 3.0;

/// Volumes from which the columns of a mean are drawn.
pub(crate) struct ColumnMean {
    /// Name of the field in a legend.
    pub(crate) title: String,
    /// Volumes whose columns are the numerators: weight times field.
    pub(crate) weighed: Vec<PointVolume>,
    /// Volumes whose kernels mark the pixels that get a mean: see [`shown`].
    pub(crate) places: Vec<PointVolume>,
}

/// Returns the volumes of the numerators: those of `volumes`, with each weight multiplied by the
/// field.
///
/// # Errors
/// A field that is absent or that lacks a value for some particle; weights below 0.
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
        // Multiplies the values by masses instead of volumes, and stores the masses as volumes: a
        // mass has no sign, whereas a field may have one.
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

/// Returns the kernels of a volume that have positive weight, all with equal optical depth. They
/// mark the pixels that get a mean.
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

/// Converts to f32, clamped to the positive normal numbers.
#[allow(clippy::cast_possible_truncation, reason = "clamped to what f32 holds")]
fn narrowed(x: f64) -> f32 {
    x.clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)) as f32
}

/// The pictures from which means along rays are computed, besides that of the weights.
pub(crate) struct Quotients {
    /// Numerators.
    sums: Renderer,
    /// Counts the kernels within [`REACH`] of each pixel's ray: a pixel gets a mean if there are any. `None` for slices,
    /// which have weights only where kernels reach.
    places: Option<Renderer>,
}

impl Quotients {
    /// # Errors
    /// The errors of scenes and of back ends.
    pub(crate) fn new(
        mean: ColumnMean,
        columns: &ColumnSettings,
        on: impl Fn(&Renderer) -> Backend,
    ) -> Result<Self> {
        let options = SceneOptions {
            level_of_detail: false,
            ..SceneOptions::default()
        };
        let opened = |volumes| {
            let renderer = Renderer::with_options(volumes, &options)?;
            let backend = on(&renderer);
            renderer.on(backend.open()?)
        };
        let counts = columns.slice.is_none();
        Ok(Self {
            sums: opened(mean.weighed)?,
            places: counts.then(|| opened(mean.places)).transpose()?,
        })
    }

    /// Draws the means.
    ///
    /// # Errors
    /// The errors of rendering.
    pub(crate) fn drawn(
        &mut self,
        weights: &ColumnImage,
        camera: &Camera,
        columns: &ColumnSettings,
    ) -> Result<ColumnImage> {
        let sums = self.sums.column_density(camera, columns)?;
        let settings = Settings {
            show: Show::Count,
            cutoff: Some(REACH),
            filter: columns.filter,
            low_pass_variance_px2: columns.low_pass_variance_px2,
            clip: columns.clip.clone(),
            ..Settings::default()
        };
        let shown = match &mut self.places {
            Some(places) => Some(places.render(camera, &settings)?),
            None => None,
        };
        Ok(quotient(sums, weights, shown))
    }
}

/// Divides one column image by another, pixel by pixel. The result is NaN at pixels with a zero weight.
///
/// - `shown`: numbers of kernels; pixels without any get NaN, too.
fn quotient(sums: &ColumnImage, weights: &ColumnImage, shown: Option<&Image>) -> ColumnImage {
    let is_shown = |i: usize| shown.is_none_or(|shown| shown.pixels[i][0] > 0.0);
    let pairs = sums.values.iter().zip(&weights.values).enumerate();
    let mean = |(i, (sum, weight)): (usize, (&f32, &f32))| match *weight > 0.0 && is_shown(i) {
        true => sum / weight,
        false => f32::NAN,
    };
    ColumnImage {
        values: pairs.map(mean).collect(),
        ..sums.clone()
    }
}
