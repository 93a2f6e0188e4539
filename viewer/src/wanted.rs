//! Describes what the window wants: data, pictures and films.

use std::path::PathBuf;
use std::sync::Arc;

use ewa_splat::command::ViewRequest;
use ewa_splat::render::{Backend, Gpu, OpenBackend};
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};

use crate::instead::Instead;
use crate::overlay::Overlay;

/// Description of a picture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct View {
    /// Scene of the view: the number of its [`Load`].
    pub(crate) scene: u64,
    /// Number of the view.
    pub(crate) number: u64,
    pub(crate) camera: Camera,
    pub(crate) settings: Settings,
    /// Image shown in place of the picture.
    pub(crate) instead: Option<Instead>,
    /// Transfer function of each volume that has one.
    pub(crate) functions: Vec<Option<TransferFunction>>,
}

/// Pictures of a view from several cameras, to be written.
#[derive(Debug, Clone)]
pub(crate) struct Film {
    pub(crate) view: View,
    /// Cameras, all of one size.
    pub(crate) cameras: Vec<Camera>,
    pub(crate) over: Overlay,
    pub(crate) path: PathBuf,
}

/// Data to read.
#[derive(Debug, Clone)]
pub(crate) struct Load {
    /// Number of the load.
    pub(crate) scene: u64,
    pub(crate) request: Arc<ViewRequest>,
    pub(crate) field: Option<String>,
    pub(crate) chosen: Vec<bool>,
    /// Step of a series.
    pub(crate) step: usize,
    /// The window's device, if pictures are drawn on it.
    pub(crate) gpu: Option<Gpu>,
}

impl Load {
    /// Returns the renderer on the device that the request names, or else on the window's.
    ///
    /// # Errors
    /// No such device.
    pub(crate) fn opened(&self, renderer: Renderer) -> Result<Renderer> {
        let backend = self.request.backend();
        match &self.gpu {
            Some(gpu) if backend == Backend::Gpu => renderer.on(gpu.clone()),
            Some(gpu) => renderer.on(OpenBackend::or_cpu(gpu.clone())),
            None => renderer.on(backend.open()?),
        }
    }
}
