//! Defines the camera and its mapping of points.

use glam::{DMat3, DVec2, DVec3};

use crate::error::{Error, Result};

/// Mapping from camera space to the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Projection {
    /// pixel = focal_px * (x/z, y/z) + centre_px.
    Perspective,
    /// pixel = focal_px * (x, y) + centre_px.
    Orthographic,
}

/// A camera in f64. The eye is subtracted from positions in f64 before anything is narrowed, so that data 1e7
/// from the origin render the same picture as at the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Perspective or orthographic.
    pub projection: Projection,
    /// The eye, world units. An orthographic camera sees everything in front of the plane through it.
    pub eye: DVec3,
    /// Rotation W: rows are the camera's right, down and forward in the world.
    pub camera_from_world: DMat3,
    /// (fx, fy): pixels per unit of slope (perspective) or per world unit (orthographic).
    pub focal_px: DVec2,
    /// (cx, cy): the pixel coordinate of the optical axis.
    pub centre_px: DVec2,
    /// Width of the image in pixels.
    pub width: usize,
    /// Height of the image in pixels.
    pub height: usize,
}

impl Camera {
    /// A perspective camera.
    ///
    /// - `eye`, `target`, `up`: world units. `up` need not be perpendicular to the view; an `up` parallel to it
    ///   is replaced.
    /// - `vertical_fov_deg`: the full angle from the top to the bottom of the image.
    /// - `size`: width and height in pixels.
    pub fn perspective(
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        vertical_fov_deg: f64,
        size: [usize; 2],
    ) -> Self {
        let focal = size[1] as f64 / (2.0 * (vertical_fov_deg.to_radians() / 2.0).tan());
        Self {
            projection: Projection::Perspective,
            eye,
            camera_from_world: look(target - eye, up),
            focal_px: DVec2::splat(focal),
            centre_px: DVec2::new(size[0] as f64, size[1] as f64) / 2.0,
            width: size[0],
            height: size[1],
        }
    }

    /// An orthographic camera whose image is `height_world` world units high.
    ///
    /// - `eye`, `target`, `up`: as for [`Camera::perspective`].
    /// - `size`: width and height in pixels.
    pub fn orthographic(
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        height_world: f64,
        size: [usize; 2],
    ) -> Self {
        Self {
            projection: Projection::Orthographic,
            focal_px: DVec2::splat(size[1] as f64 / height_world),
            ..Self::perspective(eye, target, up, 90.0, size)
        }
    }

    /// Returns this camera, rotated to look along `forward`. The direction is exact at any distance from the
    /// origin, where eye + direction would round.
    pub(super) fn looking_along(self, forward: DVec3, up: DVec3) -> Self {
        Self {
            camera_from_world: look(forward, up),
            ..self
        }
    }

    /// Checks that points have places in the picture: all numbers are finite, focal lengths are positive, and
    /// [`Camera::camera_from_world`] is a rotation.
    ///
    /// # Errors
    /// The first condition that does not hold.
    pub fn validate(&self) -> Result<()> {
        let fault = |place: &str, expected: &str, found: String| {
            let advice = "correct the camera";
            Err(Error::invalid("camera", place, expected, found, advice))
        };
        let is_finite = self.eye.is_finite() && self.centre_px.is_finite();
        let has_focus = self.focal_px.is_finite() && self.focal_px.min_element() > 0.0;
        if !(is_finite && has_focus) {
            let found = format!(
                "eye {}, centre {}, focal lengths {}",
                self.eye, self.centre_px, self.focal_px
            );
            let expected = "finite numbers and positive focal lengths";
            return fault("numbers", expected, found);
        }
        if !is_rotation(self.camera_from_world) {
            let found = self.camera_from_world.to_string();
            return fault("camera_from_world", "a rotation", found);
        }
        Ok(())
    }

    /// Returns a world point in camera space.
    pub fn camera_point(&self, world: DVec3) -> DVec3 {
        self.camera_from_world * (world - self.eye)
    }

    /// Returns the pixel coordinate of a world point. Returns `None` for a point in or behind the plane of a
    /// perspective camera.
    pub fn project(&self, world: DVec3) -> Option<DVec2> {
        let u = self.camera_point(world);
        match self.projection {
            Projection::Perspective if u.z <= 0.0 => None,
            Projection::Perspective => Some(self.focal_px * u.truncate() / u.z + self.centre_px),
            Projection::Orthographic => Some(self.focal_px * u.truncate() + self.centre_px),
        }
    }

    /// Projects the two ends of a line segment from world units to pixel coordinates. The part behind the plane
    /// of the eye is cut off just in front of it; a segment entirely behind gives `None`.
    pub fn project_segment(&self, ends: [DVec3; 2]) -> Option<[DVec2; 2]> {
        let [a, b] = ends.map(|end| self.camera_point(end));
        // Under perspective, points in the eye's plane have no projection. The part nearer than a millionth of
        // the segment's extent is cut off; it lies far outside any picture.
        let near = match self.projection {
            Projection::Perspective => 1e-6 * a.abs().max(b.abs()).max_element(),
            Projection::Orthographic => 0.0,
        };
        let is_before = |p: DVec3| p.z >= near;
        if !is_before(a) && !is_before(b) {
            return None;
        }
        let cut = |p: DVec3, other: DVec3| {
            if is_before(p) {
                p
            } else {
                p + (other - p) * ((near - p.z) / (other.z - p.z))
            }
        };
        let place = |p: DVec3| {
            let slope = match self.projection {
                Projection::Perspective => p.truncate() / p.z,
                Projection::Orthographic => p.truncate(),
            };
            self.focal_px * slope + self.centre_px
        };
        let ends = [place(cut(a, b)), place(cut(b, a))];
        ends.iter().all(|end| end.is_finite()).then_some(ends)
    }

    /// Returns the direction of view in the world, unit length.
    pub fn forward(&self) -> DVec3 {
        self.camera_from_world.row(2)
    }
}

/// Returns true if a matrix is a rotation to within 1e-4: matrices written with six digits are, scaled or
/// mirrored ones are not.
pub(super) fn is_rotation(m: DMat3) -> bool {
    const ROUNDING: f64 = 1e-4;
    let deviation = m * m.transpose() - DMat3::IDENTITY;
    // Phrased so that NaN gives false.
    let is_orthonormal = { deviation.to_cols_array() }
        .iter()
        .all(|d| d.abs() < ROUNDING);
    is_orthonormal && m.determinant() > 0.0
}

/// Returns the rotation whose third row is `forward` and whose second row points down as far as possible.
fn look(forward: DVec3, up: DVec3) -> DMat3 {
    let forward = forward.try_normalize().unwrap_or(DVec3::Y);
    let right = forward.cross(up.try_normalize().unwrap_or(DVec3::Z));
    let right = if right.length() > 1e-9 {
        right.normalize()
    } else {
        forward.any_orthonormal_vector()
    };
    let down = forward.cross(right);
    DMat3::from_cols(right, down, forward).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_right_down_forward() {
        let camera = Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, 90.0, [200, 100]);
        assert_eq!(
            camera.project(DVec3::new(0.0, 2.0, 0.0)),
            Some(DVec2::new(100.0, 50.0))
        );
        let right_and_up = camera.project(DVec3::new(1.0, 2.0, 0.5)).unwrap();
        assert!((right_and_up - DVec2::new(125.0, 37.5)).length() < 1e-12);
        assert!((camera.camera_from_world.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn lines_are_cut_before_the_eye() {
        let eye = DVec3::new(0.0, -2.0, 0.0);
        let perspective = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 90.0, [200, 100]);
        let flat = Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 4.0, [200, 100]);
        let (before, behind) = (DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, -4.0, 1.0));
        for camera in [&perspective, &flat] {
            let [from, to] = camera.project_segment([before, behind]).unwrap();
            assert_eq!(Some(from), camera.project(before));
            // Cut at y = -2, half of the way up.
            let at_eye = (to - camera.centre_px) / camera.focal_px;
            match camera.projection {
                Projection::Orthographic => {
                    assert!((at_eye - DVec2::new(1.0, -0.5)).length() < 1e-9)
                }
                Projection::Perspective => assert!(to.is_finite() && to.x > 1e6),
            }
            assert_eq!(camera.project_segment([behind, behind - DVec3::Y]), None);
            let beyond = before + DVec3::Y;
            let ends = camera.project_segment([before, beyond]).unwrap();
            assert_eq!(ends.map(Some), [before, beyond].map(|p| camera.project(p)));
        }
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let camera = Camera::perspective(DVec3::ONE, DVec3::Y, DVec3::Z, 60.0, [10, 10]);
        assert!(camera.validate().is_ok());
        let turned = |m: DMat3| Camera {
            camera_from_world: m,
            ..camera.clone()
        };
        let rotation = camera.camera_from_world;
        // Six digits, as in files.
        let rounded = rotation.to_cols_array().map(|x| (x * 1e6).round() / 1e6);
        assert!(turned(DMat3::from_cols_array(&rounded)).validate().is_ok());
        let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.1, 1.0, 0.0), DVec3::Z);
        for other in [
            rotation * 2.0,
            rotation * mirror,
            rotation * shear,
            DMat3::ZERO,
            rotation * f64::NAN,
            rotation * f64::INFINITY,
        ] {
            let error = turned(other).validate().unwrap_err().to_string();
            assert!(error.contains("a rotation"), "{error}");
        }
        for poison in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let focal_px = DVec2::new(9.0, poison);
            let other = Camera {
                focal_px,
                ..camera.clone()
            };
            assert!(other.validate().is_err(), "{poison}");
        }
        let eye = DVec3::new(0.0, f64::NAN, 0.0);
        assert!(Camera { eye, ..camera }.validate().is_err());
    }

    #[test]
    fn up_along_the_view_still_gives_a_rotation() {
        let camera = Camera::perspective(DVec3::ZERO, DVec3::Z, DVec3::Z, 60.0, [10, 10]);
        assert!((camera.camera_from_world.determinant() - 1.0).abs() < 1e-12);
    }
}
