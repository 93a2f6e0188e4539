//! Chooses transfer functions, and makes volumes that they show.

use std::borrow::Cow;
use std::path::Path;

use crate::error::{Error, Result};
use crate::math::narrowed;
use crate::sample::kernels::Kernels;
use crate::sample::options::{SampleOptions, TransferChoice};
use crate::sample::report::{Finding, SampleReport};
use crate::sample::sampled::Sampled;
use crate::scene::{
    AutomaticOptions, Colour, FileFunction, Particles, PointVolume, ScaleName, Strength,
    Surroundings, TransferDefaults, TransferFunction, ValueSample, ValueScale, Values,
};

/// Returns a placeholder function for volumes whose values are summed to column densities, not classified.
///
/// - `range`: the range of the values.
///
/// # Errors
/// A range or a unit distance that is invalid.
pub(crate) fn summed_function(
    range: Option<[f64; 2]>,
    unit_distance: f64,
) -> Result<TransferFunction> {
    let range = range.unwrap_or([0.0, 1.0]).map(narrowed);
    TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, range, unit_distance)
}

/// Maps values for taking differences of them: 64-bit values on a scale that keeps small differences.
pub(super) fn differences(values: &Values) -> Cow<'_, Values> {
    let is_wide = matches!(values, Values::F64(_));
    let range = values.finite_range().filter(|_| is_wide);
    ValueScale::of_differences(range, is_wide).seen(values)
}

/// Returns the values' positions on the scale of the transfer function, and the function, chosen by the
/// options.
///
/// - `sample`: returns the values from which an automatic function is chosen. The report keeps them if the
///   options say so.
/// - `mean_spacing`: the unit distance if the options state none.
pub(super) fn under_function(
    values: Values,
    sample: impl FnOnce(&Values) -> ValueSample,
    mean_spacing: f64,
    report: &mut SampleReport,
    options: &SampleOptions,
) -> Result<(Values, TransferFunction)> {
    report.value_range = values.finite_range();
    let function = function_of(|| sample(&values), mean_spacing, report, options)?;
    Ok((function.value_scale().positions(values), function))
}

/// Returns the transfer function that the options choose, for values whose range is in the report.
pub(super) fn function_of(
    sample: impl FnOnce() -> ValueSample,
    mean_spacing: f64,
    report: &mut SampleReport,
    options: &SampleOptions,
) -> Result<TransferFunction> {
    let unit_distance = options.function.unit_distance.unwrap_or(mean_spacing);
    if options.purpose.for_columns {
        let function = summed_function(report.value_range, unit_distance)?;
        report.unit_distance = unit_distance;
        return Ok(function);
    }
    let of_own = |colour_map: Option<&str>, report: &mut SampleReport| {
        let automatic = AutomaticOptions {
            colour_map,
            range: options.function.range,
            scale: options.function.scale,
            unit_distance,
        };
        let sample = sample();
        let function = TransferFunction::automatic(&sample, &automatic);
        report.value_sample = options.purpose.keeps_value_sample.then_some(sample);
        function
    };
    let restated = |function: TransferFunction| match options.function.unit_distance {
        Some(length) => function.with_unit_distance(length),
        None => Ok(function),
    };
    let function = match &options.function.transfer {
        TransferChoice::Automatic => of_own(None, report),
        TransferChoice::Named(name) => of_own(Some(name), report),
        TransferChoice::Given(function) | TransferChoice::Shared(function) => {
            restated(function.clone())
        }
        TransferChoice::File(_) | TransferChoice::Text(_) => {
            let range = report.value_range.unwrap_or([0.0, 1.0]);
            let read = function_of_file(options, range, unit_distance)?;
            // A preset that spans 0 to 1 is meant to be stretched.
            if let (Some([from, to]), None) = (read.stretched, options.function.range)
                && [from, to] != [0.0, 1.0]
            {
                let [lo, hi] = range;
                let reason = format!(
                    "of values from {from} to {to}, stretched over the data's, {lo} to {hi} (a range or opacities say otherwise)"
                );
                report.findings.push(Finding {
                    count: 1,
                    noun: "colour map".into(),
                    reason: reason.into(),
                    left_out: false,
                });
            }
            restated(read.function)
        }
    }?;
    let unit_distance = function.unit_distance() / options.function.opacity_scale;
    let function = function.with_unit_distance(unit_distance)?;
    report.unit_distance = unit_distance;
    Ok(function)
}

/// Reads the transfer function of a file or text.
///
/// - `range`: the range over which a preset is stretched unless the options state one.
///
/// # Errors
/// A file that cannot be read; a scale in the options; a range in the options for a function that has its own.
pub(crate) fn function_of_file(
    options: &SampleOptions,
    range: [f64; 2],
    unit_distance: f64,
) -> Result<FileFunction> {
    let fault = |place: &str, own: &str| {
        Error::invalid(
            "transfer function",
            place,
            "an automatic transfer function, or a named colour map",
            format!("a file, which has {own} of its own"),
            format!("change the file, or leave the {place} out"),
        )
    };
    let is_scaled = |scale: ScaleName| scale != ScaleName::Linear;
    if options.function.scale.is_some_and(is_scaled) {
        return Err(fault("scale", "a scale"));
    }
    let text;
    let (path, text) = match &options.function.transfer {
        TransferChoice::File(path) => {
            text = std::fs::read_to_string(path).map_err(|e| {
                Error::io(path, "opening", e, "name a transfer function that exists")
            })?;
            crate::opened::note(path);
            (path.as_path(), text.as_str())
        }
        TransferChoice::Text(text) => (Path::new("transfer function"), text.as_str()),
        _ => unreachable!("the caller looks"),
    };
    let defaults = TransferDefaults {
        range: options.function.range.unwrap_or(range).map(narrowed),
        unit_distance,
    };
    let read = TransferFunction::from_file(path, text, &defaults)?;
    match options.function.range.is_some() && read.stretched.is_none() {
        true => Err(fault("range", "a range")),
        false => Ok(read),
    }
}

/// Returns a volume whose strength and colour are to be classified from `values`, without a function yet.
pub(super) fn unclassified(particles: Particles, volumes: Vec<f32>, values: Values) -> PointVolume {
    PointVolume {
        colour: Colour::Classified,
        values: Some(values),
        ..PointVolume::new(particles, Strength::Classified { volumes })
    }
}

/// Returns a volume whose strength and colour are classified from `values`.
pub(super) fn classified(
    particles: Particles,
    volumes: Vec<f32>,
    values: Values,
    mut report: SampleReport,
    (mean_spacing, surroundings): (f64, Surroundings),
    options: &SampleOptions,
) -> Result<Sampled> {
    let sample = |values: &Values| match &particles {
        Particles::Lattice { lattice, .. } => {
            let spacing = options.function.unit_distance.unwrap_or(mean_spacing);
            ValueSample::of_lattice(values, lattice, spacing)
        }
        _ => ValueSample::of_cells(values, &volumes, particles.positions(), surroundings),
    };
    let (values, transfer_function) =
        under_function(values, sample, mean_spacing, &mut report, options)?;
    report.particle_count = particles.len();
    Ok(Sampled {
        volume: PointVolume {
            transfer_function: Some(transfer_function),
            ..unclassified(particles, volumes, values)
        },
        report,
    })
}

/// Returns a volume of `kernels` whose strength and colour are classified from the kept ones of `values`.
pub(super) fn classified_kernels(
    kernels: Kernels,
    values: Values,
    report: SampleReport,
    surroundings: Surroundings,
    options: &SampleOptions,
) -> Result<Sampled> {
    let mean_spacing = kernels.mean_spacing();
    let values = keep(values, &kernels.kept);
    let particles = Particles::Anisotropic {
        positions: kernels.positions,
        factors: kernels.factors,
    };
    classified(
        particles,
        kernels.volumes,
        values,
        report,
        (mean_spacing, surroundings),
        options,
    )
}

/// Returns the values of the kept samples; moves them if all are kept.
pub(super) fn keep(values: Values, kept: &[u32]) -> Values {
    if kept.len() == values.len() {
        values
    } else {
        values.gather(kept)
    }
}
