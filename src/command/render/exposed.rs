//! Draws pictures through a lens, and while a shutter is open.

use super::options::Arguments;
use crate::view::{Aperture, Bounds, Camera, sphere_around};
use crate::{Error, Image, Renderer, Result, Settings};

/// Cameras of a sequence, and what they show.
pub(super) struct Sequence<'a> {
    /// One for each picture.
    pub(super) cameras: &'a [Camera],
    /// Whether the first follows the last.
    pub(super) is_closed: bool,
    /// Boxes around what is shown.
    pub(super) boxes: &'a [Bounds],
}

impl Arguments {
    /// Draws a picture of a sequence, or the only one, through the lens and while the shutter is open.
    ///
    /// - `n`: its number.
    pub(super) fn exposed<'a>(
        &self,
        renderer: &'a mut Renderer,
        sequence: &Sequence<'_>,
        n: usize,
        settings: &Settings,
    ) -> Result<&'a Image> {
        let own = &self.exposure;
        let camera = &sequence.cameras[n];
        let shutter = own.of_camera();
        let pictures = own.pictures(renderer, shutter.is_some());
        let settings = Settings {
            aperture: self.aperture(camera, sequence.boxes, pictures)?,
            ..settings.clone()
        };
        let Some(shutter) = shutter else {
            return self.drawn(renderer, camera, &settings);
        };
        let cameras: Vec<Camera> = (0..pictures)
            .map(|i| {
                let time = ((i as f64 + 0.5) / pictures as f64 - 0.5) * shutter;
                Camera::between(sequence.cameras, n as f64 + time, sequence.is_closed)
            })
            .collect();
        renderer.render_exposure(&cameras, &settings)
    }

    /// Returns the opening of the lens, if there is one.
    pub(super) fn aperture(
        &self,
        camera: &Camera,
        boxes: &[Bounds],
        pictures: usize,
    ) -> Result<Option<Aperture>> {
        let (Some(diameter), focus) = self.exposure.lens() else {
            return Ok(None);
        };
        let point = self
            .camera
            .target()
            .or(sphere_around(boxes).map(|(middle, _)| middle));
        let depth = point.map(|point| camera.camera_point(point).z);
        let focus = focus.or(depth.filter(|depth| *depth > 0.0));
        let Some(focus) = focus else {
            return Err(Error::invalid(
                "--aperture",
                "focus",
                "a target, or data, in front of the eye",
                "none, or one behind the eye",
                "state the depth in focus by --focus",
            ));
        };
        Ok(Some(Aperture {
            diameter,
            focus,
            pictures,
        }))
    }
}
