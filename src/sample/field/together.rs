//! Chooses one transfer function from the values of all data sets that are drawn together.

use crate::error::Result;
use crate::sample::function::function_of_file;
use crate::sample::options::{SampleOptions, TransferChoice};
use crate::sample::report::SampleReport;
use crate::scene::{AutomaticOptions, TransferFunction, ValueSample};

/// Chooses the functions that data sets share if they are drawn together. Data sets share a function if they
/// show the same field, each by a function chosen from values in the same colours. Data sets that use the same
/// preset of colours for one field share it, too. A shared function is chosen from the values of all its data
/// sets.
///
/// - `sampled`: report and options of each data set; the options have
///   [`PurposeOptions::keeps_value_sample`](crate::sample::PurposeOptions::keeps_value_sample).
///   Their [`SampleReport::value_sample`]s are taken.
///
/// Each function comes with the numbers of its data sets, at least two. Sample these again with the function
/// ([`TransferChoice::Shared`]); its unit distance already includes
/// [`FunctionOptions::opacity_scale`](crate::sample::FunctionOptions::opacity_scale). Data sets
/// that are not in the list keep their own functions.
///
/// # Errors
/// The errors of [`TransferFunction::automatic`].
pub fn shared_functions(
    sampled: &mut [(&mut SampleReport, &SampleOptions)],
) -> Result<Vec<(TransferFunction, Vec<usize>)>> {
    // The field and colour map of each group, and its members.
    let mut keys: Vec<(String, Option<&str>)> = Vec::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, (report, options)) in sampled.iter().enumerate() {
        let map = match &options.function.transfer {
            TransferChoice::Automatic => None,
            TransferChoice::Named(name) => Some(name.as_str()),
            _ => continue,
        };
        if let (Some(field), Some(_)) = (&report.field, &report.value_sample) {
            let key = (field.to_lowercase(), map);
            match keys.iter().position(|own| *own == key) {
                Some(group) => groups[group].push(i),
                None => {
                    keys.push(key);
                    groups.push(vec![i]);
                }
            }
        }
    }
    let mut shared = Vec::new();
    for members in groups.into_iter().filter(|members| members.len() > 1) {
        let samples = members
            .iter()
            .filter_map(|&i| sampled[i].0.value_sample.take());
        let Some(sample) = ValueSample::joined(samples.collect::<Vec<_>>()) else {
            continue;
        };
        // The unit distance of the finest data set: all opacities are stated over one length.
        let units = members.iter().map(|&i| sampled[i].0.unit_distance);
        let unit_distance = units.fold(f64::INFINITY, f64::min);
        let options = sampled[members[0]].1;
        let unit_distance = options.function.opacity_scale * unit_distance;
        shared.push((automatic(&sample, options, unit_distance)?, members));
    }
    shared.extend(shared_presets(sampled)?);
    Ok(shared)
}

/// Chooses the shared functions of presets in files, stretched over the values of all.
fn shared_presets(
    sampled: &[(&mut SampleReport, &SampleOptions)],
) -> Result<Vec<(TransferFunction, Vec<usize>)>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, (report, options)) in sampled.iter().enumerate() {
        let is_file = matches!(
            options.function.transfer,
            TransferChoice::File(_) | TransferChoice::Text(_)
        );
        let (Some(field), Some(_), true) = (&report.field, report.value_range, is_file) else {
            continue;
        };
        let is_same = |members: &&mut Vec<usize>| {
            let (other, of_other) = &sampled[members[0]];
            let has_field = |own: &String| own.eq_ignore_ascii_case(field);
            other.field.as_ref().is_some_and(has_field)
                && of_other.function.transfer == options.function.transfer
        };
        match groups.iter_mut().find(is_same) {
            Some(members) => members.push(i),
            None => groups.push(vec![i]),
        }
    }
    let mut shared = Vec::new();
    for members in groups.into_iter().filter(|members| members.len() > 1) {
        let reports = || members.iter().map(|&i| &*sampled[i].0);
        let ranges = reports().filter_map(|report| report.value_range);
        let range = ranges.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
        let units = reports().map(|report| report.unit_distance);
        let options = sampled[members[0]].1;
        let unit_distance = options.function.opacity_scale * units.fold(f64::INFINITY, f64::min);
        let read = function_of_file(options, range.unwrap_or([0.0, 1.0]), unit_distance)?;
        if read.stretched.is_some() {
            shared.push((read.function, members));
        }
    }
    Ok(shared)
}

/// Returns the function that the options leave to be chosen from values.
pub(crate) fn automatic(
    sample: &ValueSample,
    options: &SampleOptions,
    unit_distance: f64,
) -> Result<TransferFunction> {
    let automatic = AutomaticOptions {
        colour_map: match &options.function.transfer {
            TransferChoice::Named(name) => Some(name),
            _ => None,
        },
        range: options.function.range,
        scale: options.function.scale,
        unit_distance,
    };
    TransferFunction::automatic(sample, &automatic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{FunctionOptions, PurposeOptions};
    use crate::sample::{Sampled, points};
    use glam::DVec3;

    #[test]
    fn one_field_in_the_same_colours_has_one_function() {
        let named = |name: &str| TransferChoice::Named(name.into());
        let choices = [
            TransferChoice::Automatic,
            named("plasma"),
            TransferChoice::Automatic,
            named("plasma"),
            named("viridis"),
        ];
        let all = choices.map(|transfer| SampleOptions {
            function: FunctionOptions {
                transfer,
                ..FunctionOptions::default()
            },
            field: Some("value".into()),
            purpose: PurposeOptions {
                keeps_value_sample: true,
                ..PurposeOptions::default()
            },
            ..SampleOptions::default()
        });
        let sample = |(n, options): (usize, &SampleOptions)| {
            let spread = 1.0 + n as f64;
            let positions: Vec<DVec3> = (0..64)
                .map(|i| spread * DVec3::new((i % 4) as f64, (i / 4 % 4) as f64, (i / 16) as f64))
                .collect();
            let values: Vec<f32> = (0..64).map(|i| (i + 100 * n) as f32).collect();
            let Sampled { report, .. } = points(positions, values, options).unwrap();
            report
        };
        let mut reports: Vec<SampleReport> = all.iter().enumerate().map(sample).collect();
        let mut sampled: Vec<_> = reports.iter_mut().zip(&all).collect();
        let shared = shared_functions(&mut sampled).unwrap();
        let members: Vec<_> = shared.iter().map(|(_, members)| members.clone()).collect();
        assert_eq!(members, [[0, 2], [1, 3]]);
        // The range covers the values of both; the unit distance is that of the finer one.
        let [low, high] = shared[0].0.range();
        assert!(low < 10.0 && high > 250.0, "{low} {high}");
        assert_eq!(shared[0].0.unit_distance(), reports[0].unit_distance);
    }
}
