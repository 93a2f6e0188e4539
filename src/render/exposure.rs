//! Draws exposures: means of pictures from several cameras, and of parts of the opening of a lens.

use rayon::prelude::*;

use super::renderer::Renderer;
use crate::error::{Error, Result};
use crate::frame::backend::FrameReport;
use crate::frame::check::check;
use crate::frame::settings::{Settings, Show};
use crate::image::Image;
use crate::stats::Stopwatch;
use crate::view::Camera;

impl Renderer {
    /// Draws the mean of the pictures of several cameras, which a camera takes that moves while its shutter is open. With
    /// [`Settings::aperture`] each camera looks through another part of the opening. [`Renderer::image`] and the other
    /// getters return the mean until the next frame; counts and times are sums.
    ///
    /// - `cameras`: at equal intervals of time, with one size of picture. Their number replaces that of the aperture's pictures.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; no camera; cameras of several sizes. Of several cameras, or with an aperture: depths, normals,
    /// counts, a backdrop, ranks. An aperture with a single picture of opaque surfaces.
    pub fn render_exposure(&mut self, cameras: &[Camera], settings: &Settings) -> Result<&Image> {
        self.expose(cameras, settings, None)?;
        Ok(&self.images.image)
    }

    /// Draws all tiles of an exposure, or some.
    pub(super) fn expose(
        &mut self,
        cameras: &[Camera],
        settings: &Settings,
        tiles: Option<&[bool]>,
    ) -> Result<()> {
        let mut whole = Stopwatch::start();
        self.check_exposure(cameras, settings)?;
        let mut settings = settings.clone();
        let aperture = settings.aperture.map(|mut own| {
            own.pictures = cameras.len();
            own
        });
        let share = 1.0 / cameras.len() as f32;
        let mut sums = Vec::new();
        let mut report = FrameReport::default();
        for (i, camera) in scattered(cameras.len()).zip(cameras) {
            let part = aperture.map(|own| own.part(camera, i));
            let (part, camera) =
                part.map_or((None, camera.clone()), |(own, seen)| (Some(own), seen));
            settings.aperture = part;
            self.render_sharp(&camera, &settings, tiles)?;
            if cameras.len() == 1 {
                return Ok(());
            }
            report.add_part(&self.report);
            let pixels = &self.images.image.pixels;
            sums.resize(pixels.len(), [0.0_f32; 4]);
            sums.par_iter_mut().zip(pixels).for_each(|(sum, pixel)| {
                for (sum, channel) in sum.iter_mut().zip(pixel) {
                    *sum += channel * share;
                }
            });
        }
        self.images.image.pixels = sums;
        report.times.frame = whole.lap();
        self.report = report;
        Ok(())
    }

    fn check_exposure(&self, cameras: &[Camera], settings: &Settings) -> Result<()> {
        let refuse = |place: &str, expected: &str, found: &str, advice: &str| {
            Err(Error::invalid("exposure", place, expected, found, advice))
        };
        let Some(first) = cameras.first() else {
            return refuse("cameras", "one at least", "none", "give some");
        };
        let size = |camera: &Camera| [camera.width, camera.height];
        if cameras.iter().any(|camera| size(camera) != size(first)) {
            let found = "several sizes";
            return refuse("cameras", "one size of picture", found, "give all one size");
        }
        check(first, settings)?;
        let has_one = cameras.len() == 1;
        if has_one && settings.aperture.is_none() {
            return Ok(());
        }
        let leave_out = "leave it out";
        if settings.show == Show::Count {
            return refuse("settings", "the scene", "counts", leave_out);
        }
        if settings.depth || settings.normals {
            let found = "depths or normals, of which a blurred pixel has several";
            return refuse("settings", "colours alone", found, leave_out);
        }
        if settings.backdrop.is_some() {
            let expected = "nothing in the picture yet";
            return refuse(
                "settings",
                expected,
                "a backdrop, which is sharp",
                leave_out,
            );
        }
        if self.rank().is_some() {
            let advice = "draw it without ranks";
            return refuse("processes", "one", "several", advice);
        }
        if has_one && self.scene.data().any(|volume| volume.is_surface()) {
            let found = "one, and opaque surfaces, which several pictures blur";
            let expected = "more than one";
            return refuse("pictures of the aperture", expected, found, "ask for 64");
        }
        Ok(())
    }
}

/// Returns the numbers below `count` in a low-discrepancy order, by the golden ratio, so that each span of an exposure's time sees all
/// of the aperture.
fn scattered(count: usize) -> impl Iterator<Item = usize> {
    const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;
    let place = |i: &usize| (*i as f64 * GOLDEN_RATIO).fract();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| place(a).total_cmp(&place(b)));
    order.into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_met_once_each_and_in_no_order() {
        let order: Vec<usize> = scattered(64).collect();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..64).collect::<Vec<_>>());
        // The mean of each quarter of the time is that of all, within an eighth.
        for quarter in order.chunks(16) {
            let mean = quarter.iter().sum::<usize>() as f64 / 16.0;
            assert!((mean - 31.5).abs() < 8.0, "{quarter:?}");
        }
        assert_eq!(scattered(1).collect::<Vec<_>>(), [0]);
    }
}
