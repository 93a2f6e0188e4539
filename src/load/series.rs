//! Finds the choices that all time steps of a series share.

use super::collection::{Collection, Look};
use super::surfels::boxes_of;
use crate::data::dataset::Geometry;
use crate::data::up::Up;
use crate::sample::{
    FunctionOptions, SampleOptions, TransferChoice, automatic, function_of_file, surface_report,
};
use crate::scene::ValueSample;
use crate::view::Bounds;
use crate::{Renderer, Result, SceneOptions};

/// Choices that all steps of a series share.
#[derive(Debug, Clone)]
pub struct Series {
    /// Transfer function of all steps.
    pub transfer: TransferChoice,
    /// Field that the steps show if none is named.
    pub field: Option<String>,
    /// Boxes around the data of all steps.
    pub boxes: Vec<Bounds>,
    /// Direction up of the first step.
    pub up: Up,
}

impl Series {
    /// Returns the options that sample a step.
    pub fn of_step(&self, options: &SampleOptions) -> SampleOptions {
        SampleOptions {
            function: FunctionOptions {
                transfer: self.transfer.clone(),
                ..options.function.clone()
            },
            preferred_field: self.field.clone(),
            ..options.clone()
        }
    }
}

impl Collection<'_> {
    /// Reads the inputs as time steps, and returns the choices that they share.
    ///
    /// # Errors
    /// Errors of reading and sampling; a field that a step lacks; nothing to draw in any step.
    pub(crate) fn series(&self) -> Result<Series> {
        let mut own = self.opened()?;
        if let Some(absence) = own.iter_mut().find_map(|own| own.absence.take()) {
            return Err(absence);
        }
        let looks: Vec<Look> = own.iter().map(|own| own.look.clone()).collect();
        let options = self.chosen(&looks);
        let (mut boxes, mut samples, mut ups) = (Vec::new(), Vec::new(), Vec::new());
        let mut ranges = Vec::new();
        let mut unit_distance = f64::INFINITY;
        let mut first = None;
        for own in &mut own {
            let options = &options[own.number];
            if own.nothing.is_none() {
                let dataset = self.taken(own, options)?;
                match &dataset.geometry {
                    Geometry::Mesh(mesh) => {
                        own.report = surface_report(&dataset, options)?;
                        boxes.extend(boxes_of(mesh));
                    }
                    _ => {
                        own.take_in(crate::sample::scene(dataset, options))?;
                        let whole = SceneOptions {
                            level_of_detail: false,
                            ..SceneOptions::default()
                        };
                        let volumes = std::mem::take(&mut own.volumes);
                        boxes.extend(Renderer::with_options(volumes, &whole)?.boxes());
                    }
                }
            }
            if own.nothing.is_some() {
                continue;
            }
            ranges.extend(own.report.value_range);
            unit_distance = unit_distance.min(own.report.unit_distance);
            samples.extend(own.report.value_sample.take());
            // The first step's direction up holds for all steps.
            let step = self.request.inputs[own.number].step;
            if *first.get_or_insert(step) == step {
                ups.push(own.up());
            }
        }
        if first.is_none()
            && let Some(error) = own.iter_mut().find_map(|own| own.nothing.take())
        {
            return Err(error);
        }
        let unit_distance = self.request.sample.function.opacity_scale * unit_distance;
        let range = ranges
            .into_iter()
            .reduce(|[a, b]: [f64; 2], [c, d]| [a.min(c), b.max(d)]);
        let transfer = match (ValueSample::mean(samples), range) {
            // A preset is stretched over the values of all steps.
            (None, Some(range))
                if matches!(
                    self.request.sample.function.transfer,
                    TransferChoice::File(_)
                ) =>
            {
                let read = function_of_file(self.request.sample, range, unit_distance)?;
                match read.stretched {
                    Some(_) => TransferChoice::Given(read.function),
                    None => self.request.sample.function.transfer.clone(),
                }
            }
            (None, _) => self.request.sample.function.transfer.clone(),
            (Some(sample), _) => {
                TransferChoice::Shared(automatic(&sample, self.request.sample, unit_distance)?)
            }
        };
        Ok(Series {
            transfer,
            field: options.into_iter().find_map(|own| own.preferred_field),
            boxes,
            up: Up::of_scene(ups),
        })
    }
}
