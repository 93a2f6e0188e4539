//! A camera fitted to the data's bounds.

use glam::{DMat3, DVec3};

use super::camera::Camera;

/// What the image's height spans.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Perspective: the vertical field of view in degrees.
    FovDeg(f64),
    /// Orthographic: the height of the image in world units; `None` fits it to the data.
    OrthoHeight(Option<f64>),
}

/// The side from which a fitted camera looks at the centre of the data, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Degrees around z: 0 looks along +y, 90 along -x.
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub elevation_deg: f64,
    /// 1 fits the data into the image; larger brings it nearer by a longer focal length.
    pub zoom: f64,
}

/// The share of the image that fitted data may fill.
const FILL: f64 = 0.92;

impl Viewpoint {
    /// A camera that sees the box from `lower` to `upper` (world units) as large as it can.
    pub fn camera(&self, lower: DVec3, upper: DVec3, lens: Lens, size: [usize; 2]) -> Camera {
        let (azimuth, elevation) = (self.azimuth_deg.to_radians(), self.elevation_deg.to_radians());
        let forward = DVec3::new(
            -azimuth.sin() * elevation.cos(),
            azimuth.cos() * elevation.cos(),
            -elevation.sin(),
        );
        // The up vector follows the elevation, so that it is never parallel to the view.
        let up = DVec3::new(
            -azimuth.sin() * elevation.sin(),
            azimuth.cos() * elevation.sin(),
            elevation.cos(),
        );
        let centre = (lower + upper) / 2.0;
        let half = (upper - lower) / 2.0;
        let radius = half.length().max(f64::MIN_POSITIVE.sqrt());
        let aspect = size[0] as f64 / size[1] as f64;

        let mut camera = match lens {
            Lens::FovDeg(fov) => {
                let probe = Camera::perspective(centre - forward, centre, up, fov, size);
                let tan_y = (fov.to_radians() / 2.0).tan() * FILL;
                let distance = corners(half, probe.camera_from_world)
                    .map(|c| (c.x.abs() / (tan_y * aspect)).max(c.y.abs() / tan_y) - c.z)
                    .fold(0.0, f64::max);
                let distance = distance.max(radius * 1e-3);
                Camera::perspective(centre - forward * distance, centre, up, fov, size)
            }
            Lens::OrthoHeight(height) => {
                let eye = centre - forward * radius * 4.0;
                let height = height.unwrap_or_else(|| {
                    let probe = Camera::orthographic(eye, centre, up, 1.0, size);
                    corners(half, probe.camera_from_world)
                        .map(|c| (c.x.abs() / aspect).max(c.y.abs()) * 2.0 / FILL)
                        .fold(radius * 1e-3, f64::max)
                });
                Camera::orthographic(eye, centre, up, height, size)
            }
        };
        camera.focal_px *= self.zoom;
        camera
    }
}

/// The eight corners of a box of half extents `half`, rotated into camera space.
fn corners(half: DVec3, camera_from_world: DMat3) -> impl Iterator<Item = DVec3> {
    (0..8).map(move |i| {
        let sign = |bit: i32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
        camera_from_world * (half * DVec3::new(sign(0), sign(1), sign(2)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_corner_is_seen_and_one_nearly_touches_the_border() {
        let (lower, upper) = (DVec3::new(-3.0, 1.0, 5.0), DVec3::new(4.0, 2.0, 9.0));
        for lens in [Lens::FovDeg(40.0), Lens::OrthoHeight(None)] {
            for (azimuth_deg, elevation_deg) in [(0.0, 0.0), (30.0, 20.0), (200.0, -90.0)] {
                let view = Viewpoint { azimuth_deg, elevation_deg, zoom: 1.0 };
                let camera = view.camera(lower, upper, lens, [300, 200]);
                let mut fill: f64 = 0.0;
                for i in 0..8 {
                    let pick = |b: i32, a: f64, c: f64| if i >> b & 1 == 0 { a } else { c };
                    let corner = DVec3::new(
                        pick(0, lower.x, upper.x),
                        pick(1, lower.y, upper.y),
                        pick(2, lower.z, upper.z),
                    );
                    let p = camera.project(corner).unwrap() - camera.centre_px;
                    fill = fill.max(p.x.abs() / 150.0).max(p.y.abs() / 100.0);
                }
                assert!(fill > 0.9 && fill < 0.93, "{lens:?} {azimuth_deg}: {fill}");
            }
        }
    }
}
