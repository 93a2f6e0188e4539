//! Samples particles: takes shapes, strengths and colours from the columns of a table.

pub(crate) mod accuracy_warnings;
pub(crate) mod neighbours;
pub(crate) mod partitioned;
pub(super) mod periodic;
pub(crate) mod reach;
pub(crate) mod shepard;
pub(crate) mod sph;
pub(crate) mod yu_turk;

mod columns;
mod mass;
mod neighbourhoods;
mod shape;
pub(super) mod streaks;
mod tree;

use crate::math::narrowed;
use std::borrow::Cow;

use glam::DVec3;
use rayon::prelude::*;

use self::columns::{Columns, INTENSITIES};
use self::mass::Mass;
pub(crate) use self::neighbourhoods::Neighbourhoods;
pub(crate) use self::neighbourhoods::{Surrounded, without_spacing};
use self::neighbours::Groups;
pub(crate) use self::partitioned::{
    FITTED_NEIGHBOURS, Fitted, PartitionedRows, fit_partition, function_of_all, sample_partition,
    scalars,
};
use self::shape::Shape;
use super::field::picked::picked_rows;
use super::left_out::LeftOut;
use crate::constants::DEFAULT_KERNEL_WIDTH;
use crate::data::colour_columns::ColourNumbers;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::vectors::vectors_or_scalars;
use crate::error::Result;
use crate::math::ExactSum;
use crate::sample::field::field_choice::FieldChoice;
use crate::sample::function::{keep, under_function};
#[cfg(feature = "prepared")]
use crate::sample::options::ParticleShape;
use crate::sample::options::{MeanPart, SampleOptions, TransferChoice};
use crate::sample::positions::{index_u32, mean_spacing};
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::sample::scalar::{check_count, nothing_left, take_scalar};
use crate::scene::{
    Colour, Particles, PointVolume, Strength, Surroundings, Tiling, ValueSample, Values,
};
use crate::task::Stage;

/// Name, in the report, of the field computed for bare positions. It is a logarithm, because clustered points
/// span many decades of density.
const LOG_NUMBER_DENSITY: &str = "log10 number density";

/// Name of that field for column densities, which then count particles.
const NUMBER_DENSITY: &str = "number density";

/// Name, in the report, of mass over volume if no density is stated.
const MASS_DENSITY: &str = "density (mass over volume)";

/// Opacity of points that have colours and nothing more: a few overlap everywhere.
const SCAN_OPACITY: f64 = 0.95;

/// Number of rows that are shaped at a time.
const BATCH: usize = 1 << 16;

/// The particle of one row.
struct Particle {
    /// Lower-triangular factor; isotropic shapes use the first element.
    factor: [f32; 6],
    /// Mass \[length²\] or, if classified, volume \[length³\].
    strength: f32,
    /// Volume that the particle represents \[length³\], for the mean spacing.
    volume: f64,
    colour: [f32; 3],
}

/// Returns the columns among which one is chosen if none is named.
pub(super) fn choices_of_points(dataset: &Dataset) -> Vec<FieldChoice> {
    Columns::of(dataset, 0).choices()
}

/// Also returns groups of the volume's positions, if they were found for the shapes, and the ways of the particles while the
/// shutter is open.
pub(super) fn volume(
    mut dataset: Dataset,
    options: &SampleOptions,
) -> Result<(Sampled, Option<Groups>, Vec<DVec3>)> {
    if let (Some(periodic), Geometry::Points { positions }) =
        (&options.periodic, &mut dataset.geometry)
    {
        periodic::wrap(positions, periodic);
    }
    let ways = options.motion.as_ref().map(|motion| {
        let ways = vectors_or_scalars(&dataset, "velocity", &motion.field)?;
        Ok(ways.into_iter().map(|way| way * motion.time).collect())
    });
    let ways: Vec<DVec3> = ways.transpose()?.unwrap_or_default();
    let made = of_some(dataset, options, None)?;
    let kept = made.kept.iter().filter_map(|&row| ways.get(row as usize));
    Ok((made.sampled, made.groups, kept.copied().collect()))
}

/// Kinds of points whose particles each depend on one row alone, so that a part of the rows gives a part of the
/// volume's particles.
#[cfg(feature = "prepared")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum OfRows {
    /// Points that state shapes and strengths, and show no field.
    Stated,
    /// Smoothed particles whose column densities sum this field.
    Summed(String),
}

/// Returns the kind of particles that some rows give, if each depends on its own row alone.
#[cfg(feature = "prepared")]
pub(super) fn kind_of_rows(dataset: &Dataset, options: &SampleOptions) -> Option<OfRows> {
    let Geometry::Points { positions } = &dataset.geometry else {
        return None;
    };
    let columns = Columns::of(dataset, positions.len());
    if options.kernels.shape == ParticleShape::YuTurk
        || options.periodic.is_some()
        || options.motion.is_some()
    {
        return None;
    }
    let has_shape = options.kernels.radius.is_some() || columns.states_shape();
    if columns.states_strength() {
        let is_stated = has_shape && options.field.is_none() && !columns.may_have_colour_vector();
        return is_stated.then_some(OfRows::Stated);
    }
    let (length, mass, density) = columns.names();
    let is_there = |name: &str| matches!(columns.get(name), Ok(Some(_)));
    let has_volume = is_there(mass) && is_there(density);
    let is_summed = options.purpose.for_columns
        && !options.purpose.local_models
        && dataset.smoothing.is_some()
        && (options.kernels.radius.is_some() || is_there(length))
        && has_volume
        && !columns.states_colour();
    let field = match &options.field {
        Some(name) => Some(name.clone()),
        None => columns.first_density(),
    };
    let is_column = |name: &String| is_there(name) && !name.eq_ignore_ascii_case(mass);
    let field = field.filter(|name| is_summed && is_column(name));
    field.map(OfRows::Summed)
}

/// Returns the numbers of the colours of some rows, if they have any; `None` if the type alone determines the
/// storage.
///
/// # Errors
/// Columns of different lengths.
#[cfg(feature = "prepared")]
pub(super) fn colour_numbers(dataset: &Dataset) -> Result<Option<ColourNumbers>> {
    let Geometry::Points { positions } = &dataset.geometry else {
        return Ok(None);
    };
    let colours = Columns::of(dataset, positions.len()).colours()?;
    let open = colours.filter(|c| !c.channels.iter().all(|c| matches!(c, Values::U8(_))));
    Ok(open.map(|colours| colours.numbers()))
}

/// Returns a volume of some of the rows of a data set, without a function; there may be no rows.
///
/// - `colours`: the numbers of the colours of all rows ([`colour_numbers`]).
#[cfg(feature = "prepared")]
pub(super) fn of_rows(
    dataset: Dataset,
    options: &SampleOptions,
    colours: Option<ColourNumbers>,
    volume_sum: &mut ExactSum,
) -> Result<Sampled> {
    let part = Part {
        volume_sum,
        neighbourhoods: None,
        colours,
    };
    of_some(dataset, options, Some(part)).map(|made| made.sampled)
}

/// Context for sampling a part of all rows.
struct Part<'a> {
    /// Volume of the preceding rows, to which that of these is added.
    volume_sum: &'a mut ExactSum,
    /// Sizes of bare points from their neighbours.
    neighbourhoods: Option<&'a Neighbourhoods>,
    /// The numbers of the colours of all rows, if colours depend on them.
    colours: Option<ColourNumbers>,
}

/// Result of sampling rows.
struct Made {
    sampled: Sampled,
    /// The rows that give particles.
    kept: Vec<u32>,
    /// Volumes that classified particles represent \[length³\].
    volumes: Vec<f32>,
    /// Groups of the particles' positions, if they were found for the shapes.
    groups: Option<Groups>,
}

/// - `part`: set if these are a part of all rows. Then there is no function, and there may be no rows.
fn of_some(mut dataset: Dataset, options: &SampleOptions, part: Option<Part<'_>>) -> Result<Made> {
    let Geometry::Points { positions } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let count = positions.len();
    if part.is_none() {
        check_count(&dataset, count)?;
    }
    let columns = Columns {
        neighbourhoods: part.as_ref().and_then(|part| part.neighbourhoods),
        ..Columns::of(&dataset, count)
    };
    let mut shapes = columns.shapes(positions, options)?;
    let groups = shapes.groups.take();
    let mass = columns.mass(&shapes, options)?;
    let shape = &shapes.shape;
    let rgb = columns.colours()?;
    // Points of a scanner, with nothing but positions and colours: they lie on surfaces, which hide what is
    // behind.
    let is_scan = rgb.is_some()
        && shapes.bare
        && options.field.is_none()
        && !options.purpose.for_columns
        && matches!(options.function.transfer, TransferChoice::Automatic)
        && columns.default_field(false, None).is_none()
        && columns.get(columns.names().1)?.is_none();
    let mass = match mass {
        Mass::Classified(_) if is_scan => Mass::Uniform(SCAN_OPACITY),
        mass => mass,
    };
    let is_classified = matches!(mass, Mass::Classified(_));

    let preferred = options.preferred_field.as_deref();
    // The field: the named one, or a default one if masses are classified.
    let wanted = match &options.field {
        Some(name) => Some(name.clone()),
        None if is_classified && options.purpose.mean == MeanPart::Weights => {
            match columns.get(columns.names().1)? {
                Some(_) => None,
                None => columns.default_field(false, preferred),
            }
        }
        None if is_classified => columns.default_field(!shapes.bare, preferred).or_else(|| {
            let of_scan = columns.varying(&INTENSITIES);
            of_scan.filter(|_| shapes.bare && !options.purpose.for_columns)
        }),
        None => None,
    };
    // If the masses themselves are to be summed, use density, so that columns are of mass.
    let mass_name = columns.names().1;
    let of_masses = options.purpose.for_columns
        && options.purpose.mean != MeanPart::Field
        && wanted
            .as_deref()
            .is_some_and(|name| name.eq_ignore_ascii_case(mass_name));
    let wanted = wanted.filter(|_| !of_masses);
    let computed = is_classified && wanted.is_none();
    // Mass over volume, if masses are known and no other field is shown.
    let masses = match computed {
        true => columns.get(mass_name)?,
        false => None,
    };
    // A named field sets the colour, even beside masses; otherwise r, g, b do.
    let named = options.field.is_some();
    let rgb = rgb.filter(|_| !named).map(|colours| {
        let scale = colours.scale(part.as_ref().and_then(|part| part.colours));
        (colours, scale)
    });
    let field: Option<Cow<'_, Values>> = match &wanted {
        Some(name) => match columns.get(name)? {
            Some(stored) => Some(Cow::Borrowed(stored)),
            None => Some(Cow::Owned(columns.derived(name)?)),
        },
        None => None,
    };

    let isotropic = matches!(shape, Shape::Spheres(_));
    // Stated shapes are those of the default width.
    let scale = options.kernels.width / DEFAULT_KERNEL_WIDTH;
    let width_cubed = options.kernels.width.powi(3);
    let row = |i: usize| -> Result<Particle, LeftOut> {
        if !positions[i].is_finite() {
            return Err(LeftOut::Position);
        }
        let is_known = |v: &Values| v.wide(i).is_finite();
        if !field.as_deref().is_none_or(is_known) || !masses.is_none_or(is_known) {
            return Err(LeftOut::Value);
        }
        let (factor, sigmas) = shape.at(i, scale)?;
        let kernel_volume = sigmas.iter().product::<f64>() / width_cubed;
        let (strength, volume) = mass.at(i, sigmas, kernel_volume)?;
        let colour = rgb.map_or([1.0; 3], |(colours, scale)| {
            colours.channels.map(|c| scale.linear(c.get(i)))
        });
        if !colour.iter().all(|c| c.is_finite()) {
            return Err(LeftOut::Colour);
        }
        let particle = Particle {
            factor: factor.map(narrowed),
            strength: narrowed(strength),
            volume,
            colour: colour.map(|c| c.max(0.0)),
        };
        let sound = particle.factor.iter().all(|l| l.is_finite())
            && particle.factor.iter().any(|l| l.abs() >= f32::MIN_POSITIVE)
            && particle.strength.is_finite()
            && (particle.strength >= f32::MIN_POSITIVE || strength <= 0.0);
        if sound {
            Ok(particle)
        } else {
            Err(LeftOut::BeyondSinglePrecision)
        }
    };
    let mut report = SampleReport {
        field: match (computed, masses) {
            (true, Some(_)) => Some(MASS_DENSITY.into()),
            (true, None) if options.purpose.for_columns => Some(NUMBER_DENSITY.into()),
            (true, None) => Some(LOG_NUMBER_DENSITY.into()),
            (false, _) => wanted.clone(),
        },
        lengths: shapes.lengths.clone(),
        smoothing: shapes.smoothing.filter(|_| isotropic),
        sample_count: count,
        ..SampleReport::default()
    };
    let has_values = field.is_some() || computed;
    let mut kept = Vec::with_capacity(count);
    let mut faults = Vec::new();
    let (mut sigmas, mut factors) = (Vec::new(), Vec::new());
    if isotropic {
        sigmas.reserve_exact(count);
    } else {
        factors.reserve_exact(count);
    }
    let mut strengths = Vec::with_capacity(count);
    let (mut volumes, mut colours) = (Vec::new(), Vec::new());
    let is_part = part.is_some();
    let mut total = ExactSum::default();
    let total = match part {
        Some(part) => part.volume_sum,
        None => &mut total,
    };
    // In batches: an intermediate row takes more memory than the result.
    let stage = Stage::new(options.task.as_ref(), "shaping kernels", count);
    let mut rows = Vec::with_capacity(BATCH.min(count));
    for first in (0..count).step_by(BATCH) {
        stage.check()?;
        let batch = first..count.min(first + BATCH);
        batch
            .clone()
            .into_par_iter()
            .map(row)
            .collect_into_vec(&mut rows);
        for (i, row) in batch.clone().zip(&rows) {
            match row {
                Ok(particle) => {
                    kept.push(index_u32(i));
                    match isotropic {
                        true => sigmas.push(particle.factor[0]),
                        false => factors.push(particle.factor),
                    }
                    strengths.push(particle.strength);
                    total.add(particle.volume);
                    if has_values {
                        volumes.push(particle.volume);
                    }
                    if rgb.is_some() {
                        colours.push(particle.colour);
                    }
                }
                Err(fault) => faults.push(*fault),
            }
        }
        stage.advance(batch.len());
    }
    stage.check()?;
    LeftOut::report(&mut report, "particles", faults.into_iter());
    if !named && columns.has_part_of_colours() {
        let reason = "have one or two of the three columns of a colour, which are not used";
        report.note(count, "particles", reason);
    }
    if let Some((colours, scale)) = rgb {
        if let Some(assumed) = scale.assumed() {
            report.note(count, "colours", assumed);
        }
        if colours.has_others {
            let reason = "have other columns of colours, too, which are not used";
            report.note(count, "particles", reason);
        }
        if let Some(alpha) = colours.set.map(|set| set.alpha).filter(|a| a.len() > 1)
            && let Some(opacities) = columns.get(alpha)?
        {
            let full = match opacities {
                Values::U8(_) => 255.0,
                Values::U16(_) => 65535.0,
                _ => 1.0,
            };
            let translucent = (0..count).filter(|&i| opacities.get(i) < full).count();
            let reason = "have an `alpha` below 1 that is not used: call a peak opacity `opacity`";
            report.note(translucent, "particles", reason);
        }
    }
    let is_picture = !named && !options.purpose.for_columns;
    if is_picture && matches!(mass, Mass::Stated(_)) && columns.default_field(false, None).is_some()
    {
        report.note(
            count,
            "particles",
            "`mass` is taken for extinction x volume; call physical masses `m` to see the density",
        );
    }
    if !is_part && kept.is_empty() {
        return Err(nothing_left(&dataset.path, &report));
    }
    report.particle_count = kept.len();

    let has_rgb = rgb.is_some();
    // Moved out of the data set, not copied, if it is stored there.
    let field = field.map(|f| match f {
        Cow::Owned(derived) => Some(derived),
        Cow::Borrowed(_) => None,
    });
    let values = match (field, &wanted) {
        (Some(Some(derived)), _) => Some(keep(derived, &kept)),
        (Some(None), Some(name)) => Some(keep(take_scalar(&mut dataset, name)?.values, &kept)),
        _ if computed => {
            let density = |(volume, &i): (&f64, &u32)| match masses {
                Some(m) => m.wide(i as usize) / volume,
                None if options.purpose.for_columns => 1.0 / volume,
                None => -volume.log10(),
            };
            let density = || volumes.iter().zip(&kept).map(density);
            // Numbers beyond single precision stay in double precision.
            Some(match density().all(|d| narrowed(d).is_finite()) {
                true => Values::F32(density().map(narrowed).collect()),
                false => Values::F64(density().collect()),
            })
        }
        _ => None,
    };
    let mean_spacing = mean_spacing(total.value(), kept.len());
    let volumes: Vec<f32> = volumes.into_iter().map(narrowed).collect();
    let Geometry::Points { positions } = &mut dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let mut positions = std::mem::take(positions);
    if kept.len() < positions.len() {
        positions = kept.iter().map(|&i| positions[i as usize]).collect();
    }
    report.unit_distance = options.function.unit_distance.unwrap_or(mean_spacing);
    let place = |row: usize| kept.binary_search(&index_u32(row)).ok();
    let picked = |values: &Values| picked_rows(count, place, &volumes, &positions, values);
    let of_body = |values: &Values| {
        ValueSample::of_rows(&picked(values), count, Surroundings::Absent, Tiling::Loose)
    };
    let (values, transfer_function) = match values {
        Some(values) if is_part => {
            report.value_range = values.finite_range();
            (Some(values), None)
        }
        Some(values) => under_function(values, of_body, mean_spacing, &mut report, options)
            .map(|(values, function)| (Some(values), Some(function)))?,
        None => (None, None),
    };
    let sampled = Sampled {
        volume: PointVolume {
            strength: if is_classified {
                Strength::Classified { volumes: strengths }
            } else {
                Strength::Mass(strengths)
            },
            colour: if has_rgb {
                Colour::PerParticle(colours)
            } else if values.is_some() {
                Colour::Classified
            } else {
                Colour::Uniform([1.0; 3])
            },
            particles: if isotropic {
                Particles::Isotropic { positions, sigmas }
            } else {
                Particles::Anisotropic { positions, factors }
            },
            values,
            transfer_function,
            boundary: None,
            normals: None,
            local_models: None,
        },
        report,
    };
    Ok(Made {
        sampled,
        // Groups of all rows are of no use if some are left out.
        groups: groups.filter(|_| kept.len() == count),
        kept,
        volumes,
    })
}
