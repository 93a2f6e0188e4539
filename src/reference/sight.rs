//! Computes rays through places of an image, and clips them by planes.

use glam::{DVec2, DVec3};

use crate::view::{Camera, ClipPlane, Projection};

/// A camera and the clip planes.
pub(super) struct Sight<'a> {
    pub(super) camera: &'a Camera,
    /// Normals and distances of the clip planes, camera space.
    clip: Vec<(DVec3, f64)>,
}

impl<'a> Sight<'a> {
    pub(super) fn new(camera: &'a Camera, planes: &[ClipPlane]) -> Self {
        let turn = |p: &ClipPlane| (camera.camera_from_world * p.normal, p.inside(camera.eye));
        let clip = planes.iter().map(turn).collect();
        Self { camera, clip }
    }

    /// Returns origin and unit direction of the ray through a place of the image, camera space.
    pub(super) fn ray(&self, pixel_px: DVec2) -> (DVec3, DVec3) {
        let slope = (pixel_px - self.camera.centre_px) / self.camera.focal_px;
        match self.camera.projection {
            Projection::Perspective => (DVec3::ZERO, slope.extend(1.0).normalize()),
            Projection::Orthographic => (slope.extend(0.0), DVec3::Z),
        }
    }

    /// Returns the depths between which a ray is visible; `None` if the planes leave nothing.
    pub(super) fn span(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let [near, far] = between(&self.clip, origin, direction, 0.0);
        (near < far).then_some([near, far])
    }
}

/// Returns the interval in which a line lies inside planes, n . x + d >= 0 each, from `begin` on. The ends are
/// in reverse order if it lies nowhere inside.
pub(super) fn between(
    planes: &[(DVec3, f64)],
    origin: DVec3,
    direction: DVec3,
    begin: f64,
) -> [f64; 2] {
    let [mut near, mut far] = [begin, f64::INFINITY];
    for &(normal, distance) in planes {
        let (rate, start) = (normal.dot(direction), normal.dot(origin) + distance);
        if rate > 0.0 {
            near = near.max(-start / rate);
        } else if rate < 0.0 {
            far = far.min(-start / rate);
        } else if start < 0.0 {
            far = f64::NEG_INFINITY;
        }
    }
    [near, far]
}
