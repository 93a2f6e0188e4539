//! Makes the choices that sources drawn together share: one field, one transfer function.

use std::collections::HashMap;

use crate::Result;
use crate::collective::Collective;
use crate::message::{put, take, unknown};
use crate::prepared::about::Function;
use crate::sample::{
    FieldChoice, FunctionOptions, PurposeOptions, SampleOptions, SampleReport, SampledScene,
    TransferChoice, shared_fields, shared_functions,
};
use crate::scene::{TransferFunction, ValueSample};

/// Sets the preferred field of options without a named field to one that the data sets have in
/// common. An earlier preference stays if the data set has that field.
pub fn prefer(options: &mut [SampleOptions], mut choices: Vec<Vec<FieldChoice>>) {
    for (own, choices) in options.iter().zip(&mut choices) {
        let has_preferred = own.preferred_field.as_ref().is_some_and(|name| {
            let mut names = choices.iter().map(|own| &own.name);
            names.any(|own| own.eq_ignore_ascii_case(name))
        });
        if own.field.is_some() || has_preferred {
            choices.clear();
        }
    }
    for (own, shared) in options.iter_mut().zip(shared_fields(&choices)) {
        own.preferred_field = shared.or(own.preferred_field.take());
    }
}

/// Returns sampling options with a transfer function that several sources share.
pub(crate) fn with_shared(options: SampleOptions, function: &TransferFunction) -> SampleOptions {
    SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::Shared(function.clone()),
            ..options.function
        },
        purpose: PurposeOptions {
            keeps_value_sample: false,
            ..options.purpose
        },
        ..options
    }
}

/// Samples sources that are drawn together. Sources that show one field by an automatic transfer
/// function share one function: they are sampled again by it.
///
/// - `options`: options of each source, which keep the samples of values from which functions are
///   chosen.
/// - `sample`: samples the source of a number.
///
/// # Errors
/// The errors of sampling and of [`shared_functions`].
pub fn sample_together(
    options: &[SampleOptions],
    sample: impl Fn(usize, &SampleOptions) -> Result<SampledScene>,
) -> Result<Vec<SampledScene>> {
    let scenes = options.iter().enumerate();
    let scenes = scenes.map(|(i, options)| sample(i, options));
    let mut scenes = scenes.collect::<Result<Vec<_>>>()?;
    let reports = scenes.iter_mut().map(|scene| &mut scene.report);
    let shared = shared_functions(&mut reports.zip(options).collect::<Vec<_>>())?;
    for (function, members) in shared {
        for i in members {
            // The old volumes are freed before the new ones are made.
            scenes[i].volumes.clear();
            scenes[i] = sample(i, &with_shared(options[i].clone(), &function))?;
        }
    }
    Ok(scenes)
}

/// Returns the transfer functions that sources of all ranks share, by the sources' numbers. The first rank chooses them
/// from the values of all ranks.
///
/// - `own`: numbers and reports of the sources of this rank; their samples of values are taken.
/// - `options`: options of the sources of all ranks.
///
/// # Errors
/// The errors of [`shared_functions`], on any rank; a rank that is gone.
pub(crate) fn functions_of_all(
    own: Vec<(usize, &mut SampleReport)>,
    options: &[SampleOptions],
    ranks: &mut dyn Collective,
) -> Result<HashMap<usize, TransferFunction>> {
    type Shown = (usize, Option<String>, u64, Option<[f64; 2]>);
    let shown = own.iter().map(|(number, report)| {
        let unit_distance = report.unit_distance.to_bits();
        (
            *number,
            report.field.clone(),
            unit_distance,
            report.value_range,
        )
    });
    let shown: Vec<Vec<Shown>> = ranks.gather_values(shown.collect())?;
    let samples = match ranks.size() {
        1 => {
            let own = own.into_iter();
            let samples = own.map(|(number, report)| (number, report.value_sample.take()));
            samples.collect()
        }
        _ => samples_of_all(own, ranks)?,
    };
    let choose = || {
        let mut reports = vec![SampleReport::default(); options.len()];
        for (number, field, bits, value_range) in shown.into_iter().flatten() {
            if let Some(report) = reports.get_mut(number) {
                report.field = field;
                report.unit_distance = f64::from_bits(bits);
                report.value_range = value_range;
            }
        }
        for (number, sample) in samples {
            if let Some(report) = reports.get_mut(number) {
                report.value_sample = sample;
            }
        }
        shared_functions(&mut reports.iter_mut().zip(options).collect::<Vec<_>>())
    };
    let shared = match ranks.size() {
        1 => choose()?,
        _ => {
            let sent = (ranks.rank() == 0).then(|| {
                let shared = choose()?.into_iter();
                let shared = shared.map(|(function, of)| (Function::of(&function), of));
                Ok(shared.collect::<Vec<_>>())
            });
            let received: Vec<(Function, Vec<usize>)> = ranks.broadcast_value(sent.transpose())?;
            let own = received.into_iter().map(|(function, of)| {
                let function = function.transfer();
                Ok((function.ok_or_else(|| unknown("no transfer function"))?, of))
            });
            own.collect::<Result<Vec<_>>>()?
        }
    };
    let each = shared
        .into_iter()
        .flat_map(|(function, of)| of.into_iter().map(move |i| (i, function.clone())));
    Ok(each.collect())
}

/// Gathers on the first rank the value samples from which transfer functions are chosen, each with
/// the number of its input.
fn samples_of_all(
    own: Vec<(usize, &mut SampleReport)>,
    ranks: &mut dyn Collective,
) -> Result<Vec<(usize, Option<ValueSample>)>> {
    let mut samples = Vec::new();
    for (number, report) in own {
        if let Some(sample) = report.value_sample.take() {
            let (records, has_surroundings) = sample.to_records();
            put(&mut samples, &[number as u64, u64::from(has_surroundings)]);
            put(&mut samples, &records);
        }
    }
    let mut found = Vec::new();
    for part in ranks.gather_on_first(Ok(samples))? {
        let mut part = part.as_slice();
        while !part.is_empty() {
            let (of, records) = (take::<u64>(&mut part)?, take::<[f64; 3]>(&mut part)?);
            let number = of.first().and_then(|&i| usize::try_from(i).ok());
            let sample = ValueSample::of_records(&records, of.get(1) == Some(&1));
            found.extend(number.map(|number| (number, Some(sample))));
        }
    }
    Ok(found)
}
