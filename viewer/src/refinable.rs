//! Reads a scene again, with kernels refined for a picture at rest.
//!
//! Pictures in motion show one kernel per sample. Refined kernels belong to one camera and to the transfer functions
//! of the moment, so they are made once the view rests, and kept until another view rests.

use ewa_splat::command::RefinedView;
use ewa_splat::load::Loaded;
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::Camera;
use ewa_splat::{Classification, Renderer, Result, SceneOptions, Task};

use crate::wanted::{Load, View};

/// Scene whose kernels may be refined.
pub(crate) struct Refinable {
    load: Load,
    /// First volume of each input, if it has any.
    first: Vec<Option<usize>>,
    /// Transfer functions of the volumes as they were read.
    functions: Vec<Option<TransferFunction>>,
    /// Last view for which the scene was read again, and its renderer; no renderer if no kernel was refined.
    latest: Option<(RefinedView, Option<Renderer>)>,
}

impl Refinable {
    /// Returns a scene's readings with refined kernels; `None` if none of its kernels may be refined.
    pub(crate) fn of(load: &Load, scene: &Loaded) -> Option<Self> {
        let may_refine = scene.inputs.iter().any(|input| input.report.may_refine);
        if !may_refine || !load.request.refines() || !scene.prepared.is_empty() {
            return None;
        }
        let mut next = 0;
        let first = scene.inputs.iter().map(|input| {
            let first = next;
            next += input.volume_count;
            (input.volume_count > 0).then_some(first)
        });
        let volumes = scene.volumes.iter();
        Some(Self {
            load: load.clone(),
            first: first.collect(),
            functions: volumes.map(|v| v.transfer_function.clone()).collect(),
            latest: None,
        })
    }

    /// Returns the request for kernels refined for pictures of a view; `None` if its kernels are classified in a way
    /// that gains nothing.
    ///
    /// - `cameras`: cameras of the pictures.
    pub(crate) fn view(&self, view: &View, cameras: &[Camera]) -> Option<RefinedView> {
        if view.settings.classify != Classification::Extent {
            return None;
        }
        let edited = |first: &Option<usize>| {
            let i = (*first)?;
            let function = view.functions.get(i)?.as_ref()?;
            let is_edited = self.functions.get(i)?.as_ref() != Some(function);
            is_edited.then(|| function.clone())
        };
        Some(RefinedView {
            cameras: cameras.to_vec(),
            tolerance: view.settings.tolerance,
            functions: self.first.iter().map(edited).collect(),
        })
    }

    /// Returns the renderer of refined kernels for pictures of a view, which is read unless it is the last one;
    /// `None` if no kernel is refined.
    ///
    /// # Errors
    /// The errors of reading; work that was cancelled.
    pub(crate) fn renderer(
        &mut self,
        view: &View,
        cameras: &[Camera],
        task: &Task,
    ) -> Result<Option<&mut Renderer>> {
        let Some(wanted) = self.view(view, cameras) else {
            return Ok(None);
        };
        let is_latest = |(latest, _): &(RefinedView, _)| *latest == wanted;
        if !self.latest.as_ref().is_some_and(is_latest) {
            // The old renderer is freed before the new one is made.
            self.latest = None;
            let renderer = self.read(view, &wanted, task)?;
            self.latest = Some((wanted, renderer));
        }
        Ok(self.latest.as_mut().and_then(|(_, own)| own.as_mut()))
    }

    fn read(&self, view: &View, wanted: &RefinedView, task: &Task) -> Result<Option<Renderer>> {
        let Load {
            request,
            field,
            chosen,
            step,
            ..
        } = &self.load;
        let mut scene = request.read(field.as_deref(), chosen, *step, Some(wanted), task)?;
        let is_refined = |input: &ewa_splat::load::InputFacts| input.report.refined_count > 0;
        if !scene.inputs.iter().any(is_refined) {
            return Ok(None);
        }
        // Volumes of an input share the function of its first one; other volumes may have been edited, too.
        for (volume, function) in scene.volumes.iter_mut().zip(&view.functions) {
            if let Some(function) = function {
                volume.transfer_function = Some(function.clone());
            }
        }
        let options = SceneOptions {
            task: Some(task.clone()),
            ..SceneOptions::default()
        };
        let renderer = scene.renderer(&options)?;
        self.load.opened(renderer).map(Some)
    }
}
