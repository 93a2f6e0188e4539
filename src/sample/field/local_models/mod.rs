//! Fits local models of fields over kernels of irregular samples ([`crate::scene::LocalModel`]). A transfer
//! function is applied to the model over a kernel's extent.
//!
//! A model of a kernel with centre x, variance V and value f is linear: f + departure + g . (y - x) at a point y,
//! kept within the range of the values around. g is the gradient. The departure follows from the
//! second derivatives ([`LocalModel::departure`]); it undoes the blur of the sum of kernels.
//!
//! | data | gradient and second derivatives | range of values over | error |
//! |---|---|---|---|
//! | curvilinear grids | differences of values and positions along the indices ([`grid`]) | the 5³ samples around | second order |
//! | unstructured cells | least squares over the samples that share a cell or a node ([`mesh`]) | two rings of these | slopes 2.1 %, tr(H V) 2.2 % (blobs 5 to 8 spacings wide, nodes jittered by a fifth) |
//! | particles | the same over the 24 nearest ([`points`]) | these | slopes 1.7 %, tr(H V) 2.1 % (jittered by a third) |
//!
//! All are exact for linear fields, and for quadratic ones if the samples around determine them. Undetermined
//! terms are zero: at lone samples, lines and planes, and for second derivatives across two layers and at
//! borders of curvilinear grids.

#[cfg(test)]
mod analytic;
pub(in crate::sample) mod grid;
pub(in crate::sample) mod mesh;
pub(in crate::sample) mod points;
pub(in crate::sample) mod quadratic;

use glam::{DMat3, DVec3};

use self::quadratic::Quadratic;
use crate::error::Result;
use crate::math::{lower_matrix, narrowed};
use crate::sample::options::SampleOptions;
use crate::sample::points::neighbours::{Groups, PointIndex};
use crate::scene::{LocalModel, LocalModels, Particles, PointVolume, Strength, Values};
use crate::task::Task;

/// Number of neighbours to which models of particles are fitted, if these determine a model.
pub(in crate::sample) const FIRST_NEIGHBOURS: usize = points::NEIGHBOUR_COUNT;

/// Name of the stage in progress reports.
pub(in crate::sample) const STAGE: &str = "fitting local models";

/// Gives a volume of classified particles local models if it has none yet.
///
/// - `groups`: groups of the particles' positions, if they are known.
pub(in crate::sample) fn complete(
    volume: &mut PointVolume,
    groups: Option<Groups>,
    options: &SampleOptions,
) -> Result<()> {
    let Some(values) = &volume.values else {
        return Ok(());
    };
    let positions = volume.particles.positions();
    if let Some((models, _)) = models_among(volume, positions, groups, values, options)? {
        volume.local_models = Some(LocalModels::new(&models));
    }
    Ok(())
}

/// Returns the local models of a volume's particles, if it needs some and has none yet. Also returns the
/// particles that needed more neighbours than usual ([`points::NEIGHBOUR_COUNT`]).
///
/// - `positions`, `values`: those of the volume's particles, followed by those of remote neighbours.
/// - `groups`: groups of these positions, if they are known.
pub(in crate::sample) fn models_among(
    volume: &PointVolume,
    positions: &[DVec3],
    groups: Option<Groups>,
    values: &Values,
    options: &SampleOptions,
) -> Result<Option<(Vec<LocalModel>, Vec<u32>)>> {
    let is_of_points = matches!(
        volume.particles,
        Particles::Isotropic { .. } | Particles::Anisotropic { .. }
    );
    let is_classified = matches!(volume.strength, Strength::Classified { .. });
    let is_wanted = options.purpose.local_models && volume.local_models.is_none();
    if !is_of_points || !is_classified || !is_wanted {
        return Ok(None);
    }
    let task: Option<&Task> = options.task.as_ref();
    let factor = |i| volume.particles.shape(i).1;
    let index = PointIndex::of(positions, groups);
    points::models(index.as_ref(), volume.particles.len(), factor, values, task).map(Some)
}

/// Returns a lower-triangular factor as a matrix.
pub(in crate::sample) fn matrix_of(factor: [f32; 6]) -> DMat3 {
    lower_matrix(factor.map(f64::from))
}

/// Returns the inverse of a lower-triangular factor; `None` for a flat kernel.
fn inverse_of(factor: DMat3) -> Option<DMat3> {
    /// Kernels are flat if they are thinner than this share of their width.
    const FLAT: f64 = 1e-6;
    let diagonal = [factor.x_axis.x, factor.y_axis.y, factor.z_axis.z];
    let entries = factor.to_cols_array();
    let greatest = entries.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    let is_thick = diagonal.iter().all(|l| l.abs() > FLAT * greatest);
    is_thick.then(|| factor.inverse())
}

/// Returns the limit of a kernel's slope, as a multiple of the spread of its neighbours' values. It is 1, or
/// more for kernels that are wider than the distance to these neighbours.
fn steepest(factor: DMat3, distance: f64) -> f64 {
    let squares: f64 = factor.to_cols_array().iter().map(|l| l * l).sum();
    let width = (squares / 3.0).sqrt() / distance;
    if width > 1.0 { width } else { 1.0 }
}

/// The least and the greatest of some values.
#[derive(Debug, Clone, Copy)]
pub(in crate::sample) struct Range {
    pub(in crate::sample) least: f32,
    pub(in crate::sample) greatest: f32,
}

impl Range {
    const EMPTY: Self = Self {
        least: f32::INFINITY,
        greatest: f32::NEG_INFINITY,
    };

    /// Returns the range of one value; empty if it is not finite.
    fn of(value: f32) -> Self {
        if value.is_finite() {
            Self {
                least: value,
                greatest: value,
            }
        } else {
            Self::EMPTY
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            least: self.least.min(other.least),
            greatest: self.greatest.max(other.greatest),
        }
    }
}

/// Returns the local model of a sample.
///
/// - `quadratic`: the field about the sample, in any coordinates.
/// - `factor`: factor of the kernel's variance, in the same coordinates.
/// - `offset`: from the sample to the kernel's centre, in the same coordinates.
/// - `value`, `range`: value of the sample; range of it and its neighbours.
/// - `steepest`: greatest slope, as a multiple of the spread of these values.
///
/// A model that exceeds the spread describes noise, not the field. Departures are therefore limited to the
/// spread, and slopes to `steepest` times the spread.
pub(in crate::sample) fn local_model(
    quadratic: &Quadratic,
    factor: DMat3,
    offset: DVec3,
    value: f32,
    range: Range,
    steepest: f64,
) -> LocalModel {
    let Quadratic { gradient, hessian } = *quadratic;
    let along = |v: DVec3| 0.5 * v.dot(hessian * v);
    let [x, y, z] = [factor.x_axis, factor.y_axis, factor.z_axis];
    let prefilter = along(x) + along(y) + along(z);
    let departure = prefilter + gradient.dot(offset) + along(offset);
    let slope = DVec3::new(x.dot(gradient), y.dot(gradient), z.dot(gradient));

    let difference = |a: f32, b: f32| (f64::from(a) - f64::from(b)).max(0.0);
    let (below, above) = (
        difference(value, range.least),
        difference(range.greatest, value),
    );
    let spread = below + above;
    let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
    let slope = slope.to_array().map(finite);
    // Rounded up, because a bound may not be too tight.
    let bound = |x: f64| if x > 0.0 { narrowed(x).next_up() } else { 0.0 };
    LocalModel {
        slope: DVec3::from(slope)
            .clamp_length_max(steepest * spread)
            .as_vec3(),
        departure: narrowed(finite(departure).clamp(-spread, spread)),
        below: bound(below),
        above: bound(above),
    }
}
