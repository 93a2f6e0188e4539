//! Computes means of a field along rays, or on a plane: quotients of column sums.

use super::renderer::Renderer;
use crate::blocks::SceneOptions;
use crate::error::{Error, Result};
use crate::frame::backend::Backend;
use crate::frame::settings::{ColumnSettings, Settings, Show};
use crate::image::{ColumnImage, Image};
use crate::scene::{Colour, PointVolume, Strength, Values};
use crate::view::Camera;

/// Name of the mean in errors.
const MEAN: &str = "mean of columns";

/// Distance from a kernel's centre up to which a mean is given, standard deviations. Beyond it, the
/// kernel is below a ninetieth of its peak.
pub(crate) const REACH: f32 = 3.0;

/// The pictures from which means of a field are computed, beside that of the weights.
///
/// The weight is what the columns of a scene are of: mass, if it is known.
#[derive(Debug)]
pub struct ColumnMeans {
    /// Numerators: weight times field.
    sums: Renderer,
    /// Counts the kernels within [`REACH`] of each pixel's ray: a pixel gets a mean if there are any. `None` for slices, which
    /// have weights only where kernels count.
    places: Option<Renderer>,
}

impl ColumnMeans {
    /// Makes the scenes of a mean, on the CPU.
    ///
    /// - `weights`: the volumes of the scene whose columns are the weights.
    /// - `fields`: the same volumes with the values of the field.
    /// - `is_slice`: whether the mean is drawn on a plane.
    ///
    /// # Errors
    /// Volumes of different particles, or without a value for each; weights below 0; errors of scenes.
    pub fn new(weights: &[PointVolume], fields: &[PointVolume], is_slice: bool) -> Result<Self> {
        if weights.len() != fields.len() {
            let (expected, found) = (weights.len().to_string(), fields.len().to_string());
            let advice = "give the same volumes";
            return Err(Error::invalid(MEAN, "volumes", expected, found, advice));
        }
        let options = SceneOptions {
            level_of_detail: false,
            ..SceneOptions::default()
        };
        let made = |volumes: Vec<PointVolume>| Renderer::with_options(volumes, &options);
        let weighed = weights.iter().zip(fields);
        let weighed = weighed.map(|(volume, of_field)| times(volume, of_field));
        let counted = (!is_slice).then(|| weights.iter().map(places).collect());
        Ok(Self {
            sums: made(weighed.collect::<Result<_>>()?)?,
            places: counted.map(made).transpose()?,
        })
    }

    /// Draws on other back ends.
    ///
    /// - `choose`: chooses the back end of a scene.
    ///
    /// # Errors
    /// The errors of back ends.
    pub fn on(self, choose: impl Fn(&Renderer) -> Backend) -> Result<Self> {
        let opened = |renderer: Renderer| {
            let backend = choose(&renderer);
            renderer.on(backend.open()?)
        };
        Ok(Self {
            sums: opened(self.sums)?,
            places: self.places.map(opened).transpose()?,
        })
    }

    /// Returns the settings with which the weights of a mean are drawn.
    pub fn settings(columns: &ColumnSettings) -> ColumnSettings {
        let mut settings = columns.clone();
        if settings.slice.is_some() {
            // A mean is given where kernels count.
            settings.cutoff = settings.cutoff.min(REACH);
        }
        settings
    }

    /// Draws the mean. It is NaN at pixels without kernels within three standard deviations, and where the weights are 0.
    ///
    /// - `weights`: the column density of the weights, drawn with `columns`.
    /// - `columns`: from [`ColumnMeans::settings`].
    ///
    /// # Errors
    /// The errors of [`Renderer::column_density`].
    pub fn draw(
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

fn times(volume: &PointVolume, of_field: &PointVolume) -> Result<PointVolume> {
    let fault = |expected: &str, found: String| {
        let advice = "name a field that all particles have";
        Error::invalid(MEAN, "field", expected, found, advice)
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
                    MEAN,
                    "weights",
                    "values from 0 up",
                    "values below 0",
                    "weigh by another field",
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
