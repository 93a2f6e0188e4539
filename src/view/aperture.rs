//! Defines the opening of a thin lens, through which points away from a plane are seen as discs.

use glam::DVec2;

use super::camera::{Camera, Projection};
use crate::error::{Error, Result};

/// Greatest number of pictures of one exposure.
const MOST_PICTURES: usize = 4096;

/// The opening of a thin lens: a disc around the eye, across the camera's axis. Points at the focus are sharp, others are seen as
/// discs.
///
/// A part of the opening is drawn as one picture, in which each kernel has the variance of its disc, a Gaussian. It blurs optical
/// depths, so opaque objects out of focus look too large. Several pictures, of parts of the opening, are averaged
/// as light is. The discs of n parts are smaller by the root of n.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Diameter of the opening, world units.
    pub diameter: f64,
    /// Depth of the plane that is in focus, along the camera's axis, world units.
    pub focus: f64,
    /// Number of pictures, of parts of the opening of equal area.
    pub pictures: usize,
}

impl Aperture {
    /// Number of pictures that suits translucent data.
    pub const DEFAULT_PICTURES: usize = 16;

    /// Checks the numbers, and the camera that looks through the opening.
    ///
    /// # Errors
    /// A diameter or a focus that is not a finite number above 0; no picture, or more than 4096; parallel rays.
    pub fn validate(&self, camera: &Camera) -> Result<()> {
        let refuse = |place: &str, expected: &str, found: String| {
            Err(Error::invalid(
                "aperture",
                place,
                expected,
                found,
                "change it",
            ))
        };
        let is_length = |x: f64| x > 0.0 && x.is_finite();
        if !is_length(self.diameter) {
            return refuse(
                "diameter",
                "a finite number above 0",
                self.diameter.to_string(),
            );
        }
        if !is_length(self.focus) {
            return refuse("focus", "a finite number above 0", self.focus.to_string());
        }
        if !(1..=MOST_PICTURES).contains(&self.pictures) {
            return refuse("pictures", "1 to 4096", self.pictures.to_string());
        }
        if camera.projection == Projection::Orthographic {
            return refuse("camera", "one with perspective", "parallel rays".into());
        }
        Ok(())
    }

    /// Returns the standard deviation of the opening along an axis, world units: a quarter of the diameter.
    pub fn deviation(&self) -> f64 {
        self.diameter / 4.0
    }

    /// Returns a part of the opening, and the camera that looks through its middle. The plane in focus has the same pixels in
    /// all of them.
    ///
    /// - `index`: number of the part, below [`Self::pictures`].
    pub fn part(&self, camera: &Camera, index: usize) -> (Self, Camera) {
        let own = Self {
            diameter: self.diameter / (self.pictures as f64).sqrt(),
            pictures: 1,
            ..*self
        };
        let offset = self.middle(index);
        let across = camera.camera_from_world.transpose();
        let seen = Camera {
            eye: camera.eye + across * offset.extend(0.0),
            centre_px: camera.centre_px + camera.focal_px * offset / self.focus,
            ..camera.clone()
        };
        (own, seen)
    }

    /// Returns the middle of a part, right and down from the eye, world units: a point of a spiral by the golden angle, around
    /// each of which lies an equal area (Vogel 1979). A part's mean square of the distance from the eye is (index + 1/2)/n of the
    /// opening's radius squared, and 1/2n of it belongs to the part's own extent.
    fn middle(&self, index: usize) -> DVec2 {
        /// (3 - sqrt 5) pi.
        const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
        let share = index as f64 / self.pictures as f64;
        let radius = 0.5 * self.diameter * share.sqrt();
        DVec2::from_angle(GOLDEN_ANGLE * index as f64) * radius
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn camera() -> Camera {
        let eye = DVec3::new(1.0, -5.0, 2.0);
        Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 40.0, [90, 70])
    }

    #[test]
    fn parts_have_the_variance_of_the_opening() {
        for pictures in [1, 4, 16, 64, 333] {
            let aperture = Aperture {
                diameter: 0.8,
                focus: 5.0,
                pictures,
            };
            let n = pictures as f64;
            let (mut mean, mut variance) = (DVec2::ZERO, DVec2::ZERO);
            for i in 0..pictures {
                let at = aperture.middle(i);
                mean += at / n;
                variance += at * at / n;
            }
            let (own, _) = aperture.part(&camera(), 0);
            let whole = aperture.deviation().powi(2);
            let both = variance.element_sum() / 2.0 + own.deviation().powi(2);
            assert!((both / whole - 1.0).abs() < 1e-12, "{pictures}");
            // The spiral leaves a difference between the axes.
            let uneven = (variance.x - variance.y).abs();
            assert!(uneven < 1.5 * whole / n.sqrt(), "{pictures}: {variance}");
            assert!(mean.length() < 0.5 * aperture.diameter / n.sqrt(), "{mean}");
        }
    }

    #[test]
    fn all_parts_see_the_plane_in_focus_at_the_same_pixels() {
        let camera = camera();
        let aperture = Aperture {
            diameter: 0.8,
            focus: 4.0,
            pictures: 9,
        };
        let world = |u: DVec3| camera.eye + camera.camera_from_world.transpose() * u;
        let sharp = world(DVec3::new(0.7, -0.4, 4.0));
        let far = world(DVec3::new(0.7, -0.4, 8.0));
        for i in 0..9 {
            let (_, seen) = aperture.part(&camera, i);
            let moved = |p| seen.project(p).unwrap() - camera.project(p).unwrap();
            assert!(moved(sharp).length() < 1e-9);
            // f l (1/d - 1/z).
            let expected = camera.focal_px * aperture.middle(i) * (1.0 / 4.0 - 1.0 / 8.0);
            assert!((moved(far) - expected).length() < 1e-9);
        }
    }

    #[test]
    fn what_is_no_lens_is_refused() {
        let sound = Aperture {
            diameter: 0.1,
            focus: 2.0,
            pictures: 1,
        };
        let camera = camera();
        assert!(sound.validate(&camera).is_ok());
        for poison in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let (diameter, focus) = (poison, poison);
            assert!(Aperture { diameter, ..sound }.validate(&camera).is_err());
            assert!(Aperture { focus, ..sound }.validate(&camera).is_err());
        }
        for pictures in [0, MOST_PICTURES + 1] {
            assert!(Aperture { pictures, ..sound }.validate(&camera).is_err());
        }
        let flat = Camera::orthographic(DVec3::Y, DVec3::ZERO, DVec3::Z, 1.0, [9, 9]);
        assert!(sound.validate(&flat).is_err());
    }
}
