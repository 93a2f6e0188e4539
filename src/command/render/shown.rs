//! Gives other commands the scene of a picture.

use indicatif::ProgressBar;

use super::options::{Arguments, Detail};
use super::scene::ReadyScene;
use crate::command::progress::task_of;
use crate::data::up::Up;
use crate::scene::TransferFunction;
use crate::view::{Bounds, Camera};
use crate::{Renderer, Result, Settings};

/// Scene of a picture with its camera, drawn on the CPU.
pub(in crate::command) struct Shown {
    pub(in crate::command) renderer: Renderer,
    pub(in crate::command) camera: Camera,
    pub(in crate::command) settings: Settings,
    /// Boxes around what a fitted camera shows.
    pub(in crate::command) boxes: Vec<Bounds>,
    pub(in crate::command) up: Up,
    /// Transfer function of the first volume that has one.
    pub(in crate::command) function: Option<TransferFunction>,
}

impl Arguments {
    /// Reads and samples the data of a picture, with one set of kernels for all views, and places the camera. Checks no
    /// output.
    ///
    /// # Errors
    /// Impossible requests; the errors of reading and sampling.
    pub(in crate::command) fn shown(&mut self, bar: &ProgressBar) -> Result<Shown> {
        self.method.refine = Detail::Off;
        self.check(false)?;
        let options = self.sample_options(task_of(bar));
        let ReadyScene {
            renderer,
            mut cameras,
            boxes,
            up,
            ..
        } = self.made(&options, bar, &mut None)?;
        let low_pass = self.method.low_pass;
        let low_pass = low_pass.unwrap_or_else(|| renderer.suitable_low_pass_px2());
        let mut volumes = renderer.volumes().iter();
        let function = volumes.find_map(|volume| volume.transfer_function.clone());
        Ok(Shown {
            settings: self.settings(low_pass),
            function,
            camera: cameras.swap_remove(0),
            boxes,
            up,
            renderer,
        })
    }
}
