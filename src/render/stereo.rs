//! Draws pictures for two eyes.

use super::renderer::Renderer;
use crate::error::{Error, Result};
use crate::frame::check::check_size;
use crate::frame::settings::Settings;
use crate::image::Image;
use crate::stats::Stopwatch;
use crate::view::{Camera, Projection};

impl Renderer {
    /// Draws two pictures, the left eye's over the right eye's: twice as high as the camera's. The eyes lie on either side of the
    /// camera's and look in its direction. [`Renderer::image`] and the other getters return both; counts are sums.
    ///
    /// - `distance`: between the eyes, world units.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; a distance that is not finite; parallel rays; a backdrop; ranks.
    pub fn render_stereo(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        distance: f64,
    ) -> Result<&Image> {
        let mut whole = Stopwatch::start();
        let refuse = |place: &str, expected: &str, found: String| {
            Err(Error::invalid(
                "stereo",
                place,
                expected,
                found,
                "change it",
            ))
        };
        if !distance.is_finite() {
            return refuse(
                "distance of the eyes",
                "a finite number",
                distance.to_string(),
            );
        }
        if camera.projection == Projection::Orthographic {
            return refuse("camera", "one with perspective", "parallel rays".into());
        }
        check_size([camera.width, camera.height.saturating_mul(2)])?;
        if settings.backdrop.is_some() {
            return refuse(
                "settings",
                "nothing in the picture yet",
                "a backdrop".into(),
            );
        }
        if self.rank().is_some() {
            return refuse("processes", "one", "several".into());
        }
        let right = camera.camera_from_world.row(0) * (distance / 2.0);
        let [left, right] = [-right, right].map(|offset| Camera {
            eye: camera.eye + offset,
            ..camera.clone()
        });
        self.render(&left, settings)?;
        let mut both = std::mem::take(&mut self.images);
        let mut report = self.report;
        self.render(&right, settings)?;
        report.add_part(&self.report);
        let below = std::mem::take(&mut self.images);
        both.image.pixels.extend(below.image.pixels);
        both.image.height *= 2;
        if let (Some(both), Some(below)) = (&mut both.depth, below.depth) {
            both.depths.extend(below.depths);
            both.height *= 2;
        }
        if let (Some(both), Some(below)) = (&mut both.normals, below.normals) {
            both.normals.extend(below.normals);
            both.height *= 2;
        }
        self.images = both;
        report.times.frame = whole.lap();
        self.report = report;
        Ok(&self.images.image)
    }
}
