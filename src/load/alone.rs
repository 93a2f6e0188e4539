//! Reads inputs into a scene in one process.

use super::collection::{Collection, Gathered};
use super::facts::{InputFacts, may_end_sharply};
use super::loaded::Loaded;
use super::prepared::{self, is_prepared};
use super::request::Request;
use super::series::Series;
use super::surfels::joined;
use crate::collective::Alone;
use crate::data::up::Up;
use crate::error::Result;
use crate::sample::{PurposeOptions, SampleOptions, TransferChoice};

/// Loads inputs in this process.
pub(super) fn load_alone(request: &Request<'_>) -> Result<Loaded> {
    // Opens each input that is a prepared scene.
    let (mut opened, mut data) = (Vec::new(), Vec::new());
    for input in request.inputs {
        let own = is_prepared(&input.path);
        let own = own.then(|| prepared::open(input, request.sample.purpose.for_columns));
        if own.is_none() {
            data.push(input.clone());
        }
        opened.push(own.transpose()?);
    }
    let known = opened.iter().flatten();
    let beside = known.map(|(_, about)| {
        let corners = prepared::corners_of(about).reduce(joined);
        (corners, prepared::up_of(about))
    });
    let collection = Collection {
        request: Request {
            inputs: &data,
            ..*request
        },
        own: 0..data.len(),
        beside: &beside.collect::<Vec<_>>(),
    };
    let Gathered {
        inputs,
        volumes,
        selectors,
    } = collection.read(&mut Alone::default())?;
    let mut scene = Loaded {
        selectors: match opened.first() {
            Some(Some(_)) => Vec::new(),
            _ => selectors,
        },
        grids_only: opened.iter().all(Option::is_none)
            && inputs.iter().all(InputFacts::is_grid_or_splats),
        has_boundary: may_end_sharply(&inputs, request.sample),
        corners: inputs.iter().filter_map(|input| input.corners).collect(),
        ..Loaded::of_nothing()
    };
    let mut ups = Vec::new();
    let mut reads = inputs.iter().zip(volumes);
    for (input, own) in request.inputs.iter().zip(opened) {
        if let Some((own, about)) = own {
            ups.push(prepared::up_of(&about));
            // Beside other inputs, the function may be meant for them.
            let own = match &request.sample.function.transfer {
                TransferChoice::File(function) if data.is_empty() => {
                    prepared::with_function(own, &input.path, function)?
                }
                _ => own,
            };
            scene.add(own, about);
            continue;
        }
        let Some((read, volumes)) = reads.next() else {
            break;
        };
        if !read.is_nothing {
            ups.push(read.up);
        }
        scene.volumes.extend(volumes);
        scene.name(scene.volumes.len(), &read.report);
    }
    scene.up = Up::of_scene(ups);
    scene.inputs = inputs;
    request.checks.scene(scene)
}

/// Reads the inputs as time steps, and returns the choices that all steps share: one field, a
/// transfer function of the values of all steps, and the box of each step. The request's cameras
/// are not asked.
///
/// # Errors
/// The errors of [`load`](super::load); a field that a step lacks; nothing to draw in any step.
pub fn load_series(request: &Request<'_>) -> Result<Series> {
    request.checks.choices()?;
    let sample = SampleOptions {
        purpose: PurposeOptions {
            keeps_value_sample: true,
            local_models: false,
            ..request.sample.purpose
        },
        ..request.sample.clone()
    };
    let collection = Collection {
        request: Request {
            sample: &sample,
            ..*request
        },
        own: 0..request.inputs.len(),
        beside: &[],
    };
    collection.series()
}
