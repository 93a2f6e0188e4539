//! Samples points that are partitioned over ranks.

use glam::DVec3;

use super::columns::{Columns, INTENSITIES};
use super::neighbourhoods::{Neighbourhoods, neighbours_of};
use super::neighbours::{MOST_FITTED, NEIGHBOUR_COUNT, PointIndex};
use super::{Made, Part, of_some};
use crate::data::dataset::{Dataset, FieldSource, Geometry};
use crate::data::shape_columns::{SCALES, VARIANCE};
use crate::error::Result;
use crate::math::ExactSum;
use crate::sample::field::local_models::{FIRST_NEIGHBOURS, models_among};
use crate::sample::field::picked::picked_rows;
use crate::sample::function::function_of;
use crate::sample::options::{ParticleShape, SampleOptions, check_options};
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::scene::{
    LocalModel, PickedRow, PointVolume, Surroundings, Tiling, TransferFunction, ValueSample, Values,
};

/// Sources of sizes and volumes for points that show a field. They depend on the columns' names alone, so any
/// rows determine them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PartitionedRows {
    /// True if sizes follow from neighbours.
    pub(crate) is_bare: bool,
    /// True if volumes follow from neighbours.
    pub(crate) needs_volumes: bool,
}

impl PartitionedRows {
    /// Returns `None` for points that are sampled otherwise: they show no field through a transfer function,
    /// have colours, or need more than neighbours.
    ///
    /// - `head`: some of the rows.
    pub(crate) fn of(head: &Dataset, options: &SampleOptions) -> Option<Self> {
        let Geometry::Points { positions } = &head.geometry else {
            return None;
        };
        let columns = Columns::of(head, positions.len());
        let is_there = |name: &str| matches!(columns.get(name), Ok(Some(_)));
        let is_of_table = |name: &str| matches!(columns.of_table(name), Ok(Some(_)));
        let is_plain = !options.purpose.for_columns
            && !options.makes_surface()
            && options.kernels.shepard_passes == 0
            && !options.purpose.keeps_value_sample
            && options.kernels.shape != ParticleShape::YuTurk;
        // Scales are logarithms if any of them is negative, so their meaning depends on all rows.
        let has_scales = SCALES.into_iter().any(is_there);
        if !is_plain || columns.states_strength() || columns.states_colour() || has_scales {
            return None;
        }
        let (length, mass, density) = columns.names();
        let has_volume = is_of_table("volume") || (is_there(mass) && is_there(density));
        let has_length =
            options.kernels.radius.is_some() || is_there(length) || is_of_table("radius");
        // Lengths without volumes need sums over all kernels within reach.
        if has_length && !has_volume {
            return None;
        }
        let is_bare = !has_length && !columns.states_shape();
        Some(Self {
            is_bare,
            needs_volumes: is_bare && !(is_there(mass) && is_there(density)),
        })
    }

    /// Returns the field to show: the named one, or the default one.
    ///
    /// - `varies`: returns true if the values of a column vary over all rows.
    pub(crate) fn field(
        self,
        head: &Dataset,
        options: &SampleOptions,
        varies: &dyn Fn(&str) -> bool,
    ) -> Option<String> {
        let columns = Columns::of(head, 0);
        let varies = |name: &str, _: &Values| varies(name);
        let named = options.field.clone();
        let named = named.or_else(|| columns.default_field_that(!self.is_bare, &varies));
        let of_scan = || columns.first_that(&INTENSITIES, &varies);
        named.or_else(|| self.is_bare.then(of_scan).flatten())
    }

    /// Returns true if sampling reads a column of this name besides the shown field.
    pub(crate) fn uses(self, head: &Dataset, name: &str) -> bool {
        let columns = Columns::of(head, 0);
        let (length, mass, density) = columns.names();
        let own = [length, mass, density, "volume", "sigma", "radius"];
        let mut used = own.into_iter().chain(VARIANCE);
        used.any(|own| own.eq_ignore_ascii_case(name))
    }

    /// Returns the number of neighbours that the size and the shape of a bare point depend on.
    ///
    /// - `number`: number of the point, among `count`.
    pub(crate) fn neighbours(number: u64, count: u64) -> usize {
        neighbours_of(number, count)
    }
}

/// Returns the scalar columns of some rows, with their names.
pub(crate) fn scalars(dataset: &Dataset) -> impl Iterator<Item = (&str, &Values)> {
    dataset.fields.iter().filter_map(|f| match &f.source {
        FieldSource::Scalar(values) => Some((f.name.as_str(), values)),
        _ => None,
    })
}

/// The particles of some rows.
pub(crate) struct PartitionSample {
    /// Particles with the data's values, and without a function.
    pub(crate) volume: PointVolume,
    pub(crate) report: SampleReport,
    /// Rows of the particles.
    pub(crate) kept: Vec<u32>,
    /// Volume of each particle \[length³\].
    volumes: Vec<f32>,
}

impl PartitionSample {
    /// Picks the particles from which a function may be chosen.
    ///
    /// - `numbers`: number of each row among all rows.
    /// - `count`: number of all rows.
    pub(crate) fn picked(&self, numbers: &[u64], count: usize) -> Vec<PickedRow> {
        let Some(values) = &self.volume.values else {
            return Vec::new();
        };
        let number = |i: &u32| numbers[*i as usize];
        let place = |row: usize| self.kept.binary_search_by_key(&(row as u64), number).ok();
        let positions = self.volume.particles.positions();
        picked_rows(count, place, &self.volumes, positions, values)
    }
}

/// Makes the particles of some of the rows of a data set; the field to show is one of the columns.
///
/// - `neighbourhoods`: sizes of points that state none.
/// - `volume_sum`: volume of the preceding particles; returns with these added \[length³\].
///
/// # Errors
/// Columns that contradict each other.
pub(crate) fn sample_partition(
    dataset: Dataset,
    options: &SampleOptions,
    neighbourhoods: Option<&Neighbourhoods>,
    volume_sum: &mut ExactSum,
) -> Result<PartitionSample> {
    check_options(options)?;
    let part = Part {
        volume_sum,
        neighbourhoods,
        colours: None,
    };
    let Made {
        sampled: Sampled { volume, report },
        kept,
        volumes,
        ..
    } = of_some(dataset, options, Some(part))?;
    Ok(PartitionSample {
        volume,
        report,
        kept,
        volumes,
    })
}

/// Returns the transfer function of particles.
///
/// - `picked`: the rows that [`PartitionSample::picked`] returns on all ranks, in the order of their numbers, of
///   `count` rows.
/// - `surroundings`: whether the data include the space around an object.
/// - `tiling`: whether the particles tile space.
/// - `report`: report on all particles, with the range of the values.
///
/// # Errors
/// A function that cannot be read, or does not fit the options.
pub(crate) fn function_of_all(
    picked: &[PickedRow],
    count: usize,
    (surroundings, tiling): (Surroundings, Tiling),
    mean_spacing: f64,
    report: &mut SampleReport,
    options: &SampleOptions,
) -> Result<TransferFunction> {
    let sample = || ValueSample::of_rows(picked, count, surroundings, tiling);
    function_of(sample, mean_spacing, report, options)
}

/// Numbers of neighbours that normals and local models may need: as many as usually determine them, or the
/// most.
pub(crate) const FITTED_NEIGHBOURS: [usize; 2] = [FIRST_NEIGHBOURS, MOST_FITTED];
const _: () = assert!(NEIGHBOUR_COUNT <= FIRST_NEIGHBOURS);

/// Normals and local models fitted to a field about each particle.
pub(crate) struct Fitted {
    pub(crate) normals: Option<Vec<u32>>,
    pub(crate) models: Option<Vec<LocalModel>>,
    /// Particles that needed more neighbours than the first of [`FITTED_NEIGHBOURS`].
    pub(crate) far: Vec<u32>,
}

/// Fits normals and local models, if the options ask for them.
///
/// - `places`, `values`: positions and values of the remote neighbours.
///
/// # Errors
/// Work that was cancelled.
pub(crate) fn fit_partition(
    volume: &PointVolume,
    (places, values): (&[DVec3], Values),
    options: &SampleOptions,
) -> Result<Fitted> {
    let count = volume.particles.len();
    let positions = [volume.particles.positions(), places].concat();
    let mut all = values;
    if let Some(own) = &volume.values {
        let others = std::mem::replace(&mut all, own.clone());
        all.append(others);
    }
    let mut fitted = Fitted {
        normals: None,
        models: None,
        far: Vec::new(),
    };
    let mut groups = None;
    if options.purpose.normals {
        let task = options.task.as_ref();
        let index = PointIndex::new(&positions);
        let normals = index
            .as_ref()
            .map(|index| index.normals(task, |i| all.get(i)));
        groups = index.map(PointIndex::into_groups);
        fitted.normals = match normals.transpose()? {
            Some((mut normals, far)) => {
                normals.truncate(count);
                fitted
                    .far
                    .extend(far.iter().filter(|i| (**i as usize) < count));
                Some(normals)
            }
            // A rank without particles agrees with the others.
            None => (count == 0).then(Vec::new),
        };
    }
    if let Some((models, far)) = models_among(volume, &positions, groups, &all, options)? {
        fitted.models = Some(models);
        fitted.far.extend(far);
    }
    fitted.far.sort_unstable();
    fitted.far.dedup();
    Ok(fitted)
}
