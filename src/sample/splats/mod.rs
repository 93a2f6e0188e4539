//! Samples splats: shapes and opacities are those that the file states.

pub(crate) mod convert;
pub(crate) mod factor;
pub(crate) mod fewer;

use self::factor::factor_of_scales;
use super::left_out::LeftOut;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::splats::SplatCloud;
use crate::error::Result;
use crate::math::{harmonics_count, narrowed};
use crate::sample::function::{keep, under_function};
use crate::sample::options::SampleOptions;
use crate::sample::positions::index_u32;
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::sample::scalar::{check_count, check_len, nothing_left, take_scalar};
use crate::scene::{Colour, Particles, PointVolume, Strength, ValueSample, Values};
use crate::task::collect;

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let Geometry::Splats(cloud) = &mut dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let cloud = std::mem::take(cloud);
    let count = cloud.positions.len();
    check_count(&dataset, count)?;
    // A named field sets the colours; other fields are ignored.
    let field = match &options.field {
        Some(name) => {
            let taken = take_scalar(&mut dataset, name)?;
            check_len(&dataset, &taken, count)?;
            Some(taken)
        }
        None => None,
    };
    let values = field.as_ref().map(|f| &f.values);
    let row = |i: usize| factor(&cloud, values, i);
    let rows: Vec<Result<[f32; 6], LeftOut>> =
        collect(options.task.as_ref(), "shaping kernels", count, row)?;

    let mut report = SampleReport {
        field: field.as_ref().map(|f| f.name.clone()),
        unit_distance: options.function.unit_distance.unwrap_or(1.0),
        sample_count: count,
        ..SampleReport::default()
    };
    let faults = rows.iter().filter_map(|row| row.as_ref().err().copied());
    LeftOut::report(&mut report, "splats", faults);
    let (kept, factors): (Vec<u32>, Vec<[f32; 6]>) = rows
        .into_iter()
        .enumerate()
        .filter_map(|(i, row)| row.ok().map(|factor| (index_u32(i), factor)))
        .unzip();
    if kept.is_empty() {
        return Err(nothing_left(&dataset.path, &report));
    }
    report.particle_count = kept.len();

    let values = field.map(|f| keep(f.values, &kept));
    // Opacities are the splats' own: only the function's colours are used.
    let of_splats = |values: &Values| ValueSample::of_body(values, &[], &[]);
    let (values, transfer_function) = match values {
        Some(values) => under_function(values, of_splats, 1.0, &mut report, options)
            .map(|(values, function)| (Some(values), Some(function)))?,
        None => (None, None),
    };
    let SplatCloud {
        positions,
        opacities,
        harmonics,
        harmonics_degree: degree,
        rule,
        by_distance,
        is_linear,
        ..
    } = cloud;
    let colour = if values.is_some() {
        Colour::Classified
    } else {
        Colour::Harmonics {
            degree,
            coefficients: picked(harmonics, &kept, 3 * harmonics_count(degree)),
            is_linear,
        }
    };
    let mut opacities = picked(opacities, &kept, 1);
    for opacity in &mut opacities {
        *opacity = opacity.min(1.0);
    }
    Ok(Sampled {
        volume: PointVolume {
            particles: Particles::Anisotropic {
                positions: picked(positions, &kept, 1),
                factors,
            },
            strength: Strength::PeakOpacity {
                opacities,
                rule: options.kernels.splat_rule.unwrap_or(rule),
                by_distance,
            },
            colour,
            values,
            transfer_function,
            boundary: None,
            normals: None,
            local_models: None,
        },
        report,
    })
}

/// Returns the factor of splat `i`, or the reason why it cannot be drawn.
pub(super) fn factor(
    cloud: &SplatCloud,
    values: Option<&Values>,
    i: usize,
) -> Result<[f32; 6], LeftOut> {
    let missing = |sound: bool, reason| if sound { Ok(()) } else { Err(reason) };
    missing(cloud.positions[i].is_finite(), LeftOut::Position)?;
    let factor = factor_of_scales(cloud.scales[i], cloud.rotations[i])?.map(narrowed);
    missing(cloud.opacities[i] >= 0.0, LeftOut::Opacity)?;
    let stride = cloud.harmonics_stride();
    let harmonics = &cloud.harmonics[i * stride..][..stride];
    missing(harmonics.iter().all(|c| c.is_finite()), LeftOut::Colour)?;
    missing(values.is_none_or(|v| v.wide(i).is_finite()), LeftOut::Value)?;
    let is_there =
        factor.iter().all(|l| l.is_finite()) && factor.iter().any(|l| l.abs() >= f32::MIN_POSITIVE);
    missing(is_there, LeftOut::Size)?;
    Ok(factor)
}

/// Returns the kept sets of `stride` entries each; moves them if all are kept.
fn picked<T: Copy>(all: Vec<T>, kept: &[u32], stride: usize) -> Vec<T> {
    if kept.len() * stride == all.len() {
        return all;
    }
    let set = |&i: &u32| &all[i as usize * stride..][..stride];
    kept.iter().flat_map(set).copied().collect()
}
