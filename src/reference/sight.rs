//! Computes rays through places of an image, and clips them by planes.

use glam::{DVec2, DVec3};

use crate::image::DepthImage;
use crate::view::{Camera, ClipPlane, Projection};

/// A camera and the clip planes.
pub(super) struct Sight<'a> {
    pub(super) camera: &'a Camera,
    /// Normals and distances of the clip planes, camera space.
    clip: Vec<(DVec3, f64)>,
    /// Depths at which rays end.
    ends: Option<&'a DepthImage>,
}

impl<'a> Sight<'a> {
    pub(super) fn new(camera: &'a Camera, planes: &[ClipPlane]) -> Self {
        let turn = |p: &ClipPlane| (camera.camera_from_world * p.normal, p.inside(camera.eye));
        let clip = planes.iter().map(turn).collect();
        Self {
            camera,
            clip,
            ends: None,
        }
    }

    pub(super) fn ended(self, ends: Option<&'a DepthImage>) -> Self {
        Self { ends, ..self }
    }

    /// Returns the arc length at which the ray through a place of the image ends.
    fn end(&self, pixel_px: DVec2, direction: DVec3) -> f64 {
        let at = |ends: &DepthImage| {
            let [x, y] = pixel_px.to_array();
            let is_inside = x >= 0.0 && x < ends.width as f64 && y >= 0.0 && y < ends.height as f64;
            let index = is_inside.then_some(y as usize * ends.width + x as usize);
            let depth = index.and_then(|index| ends.depths.get(index).copied());
            depth.map_or(f64::INFINITY, |z| f64::from(z) / direction.z)
        };
        self.ends.map_or(f64::INFINITY, at)
    }

    /// Returns origin and unit direction of the ray through a place of the image, camera space.
    pub(super) fn ray(&self, pixel_px: DVec2) -> (DVec3, DVec3) {
        let slope = (pixel_px - self.camera.centre_px) / self.camera.focal_px;
        match self.camera.projection {
            Projection::Perspective => (DVec3::ZERO, slope.extend(1.0).normalize()),
            Projection::Orthographic => (slope.extend(0.0), DVec3::Z),
        }
    }

    /// Returns the depths between which the ray through a place of the image is visible; `None` if nothing is left.
    pub(super) fn span(
        &self,
        pixel_px: DVec2,
        origin: DVec3,
        direction: DVec3,
    ) -> Option<[f64; 2]> {
        let [near, far] = between(&self.clip, origin, direction, 0.0);
        let far = far.min(self.end(pixel_px, direction));
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
