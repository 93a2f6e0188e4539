//! Makes the choices that sources drawn together share: one field, one transfer function.

use crate::Result;
use crate::sample::{
    FieldChoice, FunctionOptions, PurposeOptions, SampleOptions, SampledScene, TransferChoice,
    shared_fields, shared_functions,
};
use crate::scene::TransferFunction;

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
pub(super) fn with_shared(options: SampleOptions, function: &TransferFunction) -> SampleOptions {
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
