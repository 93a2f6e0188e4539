//! Defines a request to load inputs.

use super::facts::Kind;
use super::input::Input;
use super::loaded::Loaded;
use super::note::{Event, Note, Observer};
use crate::Result;
use crate::data::up::Up;
use crate::io::OpenOptions;
use crate::sample::SampleOptions;
use crate::view::{Bounds, Camera};

/// Function from boxes and the direction up to the cameras of pictures. It returns an empty list if the
/// cameras are not known.
pub type Cameras<'a> = &'a dyn Fn(&[Bounds], Up) -> Result<Vec<Camera>>;

/// Inputs to load as one scene, and the choices that determine their particles.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// Inputs, each with its own choices.
    pub inputs: &'a [Input],
    /// Options for opening files, common to all inputs.
    pub open: &'a OpenOptions,
    /// Options for sampling, common to all inputs. They state the purpose of the particles, too:
    /// pictures or column densities.
    pub sample: &'a SampleOptions,
    /// Cameras of the pictures, which determine the number of surfels of meshes.
    pub cameras: Cameras<'a>,
    /// True if inputs with other axes than the first are left unrotated.
    pub keeps_axes: bool,
    /// True if each rank may read a part of the data; otherwise one rank reads all.
    pub takes_parts: bool,
    /// Checks of the caller.
    pub checks: &'a dyn Checks,
    /// Receiver of notes and progress.
    pub observer: Observer<'a>,
}

/// Checks of a caller on what it loads. The defaults refuse nothing.
pub trait Checks {
    /// Checks the choices before anything is read.
    ///
    /// # Errors
    /// Choices that cannot be met.
    fn choices(&self) -> Result<()> {
        Ok(())
    }

    /// Checks an input of which each rank reads a part, before it is read.
    ///
    /// - `is_classified`: whether a transfer function shows it.
    /// - `sample`: options by which it is sampled.
    ///
    /// # Errors
    /// Choices that do not apply to the input.
    fn input(&self, _kind: Kind, _is_classified: bool, _sample: &SampleOptions) -> Result<()> {
        Ok(())
    }

    /// Checks the scene, and may complete it. If one rank reads the scene for all, that rank alone checks it.
    ///
    /// # Errors
    /// Choices that do not apply to the scene.
    fn scene(&self, scene: Loaded) -> Result<Loaded> {
        Ok(scene)
    }
}

/// No checks.
impl Checks for () {}

impl<'a> Request<'a> {
    /// Requests inputs without known cameras, without checks, and without an observer. Ranks may read parts.
    pub fn new(inputs: &'a [Input], open: &'a OpenOptions, sample: &'a SampleOptions) -> Self {
        Self {
            inputs,
            open,
            sample,
            cameras: &|_, _| Ok(Vec::new()),
            keeps_axes: false,
            takes_parts: true,
            checks: &(),
            observer: &|_| {},
        }
    }

    /// Reports lines on an input.
    pub(super) fn note_lines(&self, input: &Input, lines: &[String]) {
        for line in lines {
            let (path, line) = (input.path.clone(), line.clone());
            (self.observer)(Event::Note(Note::Line { path, line }));
        }
    }
}

impl std::fmt::Debug for Request<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Request")
            .field("inputs", &self.inputs)
            .finish_non_exhaustive()
    }
}
