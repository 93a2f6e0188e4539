//! Fits a camera to the data's bounds.

use glam::{DQuat, DVec3};

use super::camera::Camera;

/// Extent of the image's height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Perspective: the vertical field of view in degrees.
    FovDeg(f64),
    /// Orthographic: the height of the image in world units; `None` fits it to the data.
    OrthoHeight(Option<f64>),
}

/// Direction from which a fitted camera looks at the centre of the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Degrees around the axis that points up. With z up, 0 looks along +y and 90 along -x. With y up, 0 looks
    /// along -z, at the front of a glTF scene, and 90 along -x. With -y up, 0 looks along +z, as the first
    /// camera of a training scene may, and 90 along -x.
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub elevation_deg: f64,
    /// Factor of the focal length: 1 fits the data into the image, larger values magnify.
    pub zoom: f64,
    /// Direction that points up in the picture: unit length.
    pub up: DVec3,
}

/// Default vertical field of view.
pub const DEFAULT_FOV_DEG: f64 = 35.0;

/// Share of the image that fitted data may fill.
const FILL: f64 = 0.92;

/// A box: its centre and its half extents, world units.
pub type Bounds = (DVec3, DVec3);

/// Returns the centre and the radius \[world units\] of a sphere around boxes, about the centre of their common
/// box; `None` without boxes.
pub fn sphere_around(boxes: &[Bounds]) -> Option<(DVec3, f64)> {
    let corners = boxes
        .iter()
        .map(|&(middle, half)| (middle - half, middle + half));
    let (lower, upper) = corners.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
    let centre = (lower + upper) / 2.0;
    let reach = |&(middle, half): &Bounds| ((middle - centre).abs() + half).length();
    Some((centre, boxes.iter().map(reach).fold(0.0, f64::max)))
}

/// Returns the least and the greatest n . p over all points of boxes; infinite and in reverse order without boxes.
pub(super) fn extent_of(boxes: &[Bounds], n: DVec3) -> (f64, f64) {
    boxes.iter().fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), &(middle, half)| {
            let (centre, reach) = (n.dot(middle), n.abs().dot(half));
            (least.min(centre - reach), most.max(centre + reach))
        },
    )
}

impl Viewpoint {
    /// Returns the azimuth \[degrees\], -180 to 180, of a direction of view; 0 for a direction parallel to
    /// `up`.
    ///
    /// - `up`: the up direction, like [`Viewpoint::up`].
    pub fn azimuth_of(direction: DVec3, up: DVec3) -> f64 {
        let upright = DQuat::from_rotation_arc(DVec3::Z, up);
        let level = upright.inverse() * direction;
        (-level.x).atan2(level.y).to_degrees()
    }

    /// Returns the camera of this direction that sees all of `boxes`, as large and as centred as possible;
    /// `None` without boxes.
    ///
    /// A perspective eye (ex, ey, ez) in axes of the camera sees a point between the planes x - ex = ± t (z -
    /// ez). So A + t ez <= ex <= B - t ez, with A the greatest x - t z and B the least x + t z of the data. ez
    /// is the greatest that satisfies both, ex the middle of the interval.
    pub fn camera(&self, boxes: &[Bounds], lens: Lens, size: [usize; 2]) -> Option<Camera> {
        self.fitted(lens, size, |n| extent_of(boxes, n))
    }

    /// Returns the camera of this direction that sees all of the sphere around `boxes`, as large as possible;
    /// `None` without boxes. Its distance is the same from every side, so that turning it neither cuts the data
    /// nor changes their size.
    pub fn camera_around(&self, boxes: &[Bounds], lens: Lens, size: [usize; 2]) -> Option<Camera> {
        let (middle, radius) = sphere_around(boxes)?;
        self.fitted(lens, size, |n| {
            let (centre, reach) = (n.dot(middle), n.length() * radius);
            (centre - reach, centre + reach)
        })
    }

    /// - `extent`: returns the least and the greatest n . p of the points to be seen; infinite and in reverse
    ///   order without points.
    fn fitted(
        &self,
        lens: Lens,
        size: [usize; 2],
        extent: impl Fn(DVec3) -> (f64, f64),
    ) -> Option<Camera> {
        let mut camera = facing(self.directions(), lens, size, extent)?;
        camera.focal_px *= self.zoom;
        Some(camera)
    }

    /// Returns the direction of view, unit length.
    pub(crate) fn forward(&self) -> DVec3 {
        self.directions()[0]
    }

    /// Returns the direction of view and what is up in the picture, unit length.
    fn directions(&self) -> [DVec3; 2] {
        let (azimuth, elevation) = (
            self.azimuth_deg.to_radians(),
            self.elevation_deg.to_radians(),
        );
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
        let upright = DQuat::from_rotation_arc(DVec3::Z, self.up);
        [forward, up].map(|direction| upright * direction)
    }
}

/// Returns the camera with given directions of view and up, both of unit length, that sees points as large and as
/// centred as possible; `None` without points.
///
/// - `extent`: as for [`Viewpoint::fitted`].
pub(super) fn facing(
    [forward, up]: [DVec3; 2],
    lens: Lens,
    size: [usize; 2],
    extent: impl Fn(DVec3) -> (f64, f64),
) -> Option<Camera> {
    let (right, down) = (forward.cross(up), -up);
    let (near, far) = extent(forward);
    if !(near <= far) {
        return None;
    }
    let place = |[x, y, z]: [f64; 3]| right * x + down * y + forward * z;
    let aspect = size[0] as f64 / size[1] as f64;
    let camera = match lens {
        Lens::FovDeg(fov) => {
            let tan = (fov.to_radians() / 2.0).tan() * FILL;
            let side = |axis: DVec3, tan: f64| {
                let (_, a) = extent(axis - forward * tan);
                let (b, _) = extent(axis + forward * tan);
                ((a + b) / 2.0, (b - a) / (2.0 * tan))
            };
            let (x, z_x) = side(right, tan * aspect);
            let (y, z_y) = side(down, tan);
            // A single point is viewed from some distance.
            let z = z_x
                .min(z_y)
                .min(near - (far - near) * 1e-3 - f64::MIN_POSITIVE);
            let z = if near - z > far.abs() * 1e-9 {
                z
            } else {
                near - far.abs().max(1.0)
            };
            let eye = place([x, y, z]);
            Camera::perspective(eye, eye, up, fov, size).looking_along(forward, up)
        }
        Lens::OrthoHeight(height) => {
            let ((x0, x1), (y0, y1)) = (extent(right), extent(down));
            let fitted = ((x1 - x0) / aspect).max(y1 - y0) / FILL;
            let fitted = if fitted > 0.0 { fitted } else { 1.0 };
            // Well in front of the nearest box, so that the eye's plane cuts no kernel.
            let z = near - (far - near) - fitted;
            let eye = place([(x0 + x1) / 2.0, (y0 + y1) / 2.0, z]);
            Camera::orthographic(eye, eye, up, height.unwrap_or(fitted), size)
                .looking_along(forward, up)
        }
    };
    Some(camera)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turning_camera_keeps_its_distance_and_sees_all() {
        let boxes = [
            (DVec3::new(0.5, 1.5, 7.0), DVec3::new(3.5, 0.5, 2.0)),
            (DVec3::new(9.0, -4.0, 1.0), DVec3::new(0.1, 2.0, 0.3)),
        ];
        let (middle, radius) = sphere_around(&boxes).unwrap();
        let corners = boxes.iter().flat_map(|&(middle, half)| {
            (0..8).map(move |i| {
                let sign = |a: usize| if i >> a & 1 == 0 { -1.0 } else { 1.0 };
                middle + half * DVec3::new(sign(0), sign(1), sign(2))
            })
        });
        let corners: Vec<DVec3> = corners.collect();
        // Around the common box: no corner is farther than the radius, which is at least half of the extent.
        assert!(
            corners
                .iter()
                .all(|c| c.distance(middle) <= radius * (1.0 + 1e-12))
        );
        for lens in [Lens::FovDeg(40.0), Lens::OrthoHeight(None)] {
            let mut distances = Vec::new();
            for step in 0..12 {
                let view = Viewpoint {
                    azimuth_deg: 30.0 * f64::from(step),
                    elevation_deg: 25.0,
                    zoom: 1.0,
                    up: DVec3::Y,
                };
                let camera = view.camera_around(&boxes, lens, [300, 200]).unwrap();
                distances.push(camera.eye.distance(middle));
                for corner in &corners {
                    let p = camera.camera_from_world * (*corner - camera.eye);
                    let scale = match lens {
                        Lens::FovDeg(_) => 1.0 / p.z,
                        Lens::OrthoHeight(_) => 1.0,
                    };
                    let px = camera.focal_px * p.truncate() * scale + camera.centre_px;
                    assert!(px.cmpge(glam::DVec2::ZERO).all() && px.x <= 300.0 && px.y <= 200.0);
                }
            }
            assert!(
                distances
                    .iter()
                    .all(|d| (d / distances[0] - 1.0).abs() < 1e-12)
            );
        }
        assert!(sphere_around(&[]).is_none());
    }

    #[test]
    fn every_corner_is_seen_and_the_picture_is_filled_and_centred() {
        let boxes = [
            (DVec3::new(0.5, 1.5, 7.0), DVec3::new(3.5, 0.5, 2.0)),
            (DVec3::new(9.0, -4.0, 1.0), DVec3::new(0.1, 2.0, 0.3)),
        ];
        for lens in [
            Lens::FovDeg(40.0),
            Lens::FovDeg(120.0),
            Lens::OrthoHeight(None),
        ] {
            for (azimuth_deg, elevation_deg) in [(0.0, 0.0), (30.0, 20.0), (200.0, -90.0)] {
                let view = Viewpoint {
                    azimuth_deg,
                    elevation_deg,
                    zoom: 1.0,
                    up: DVec3::Z,
                };
                let camera = view.camera(&boxes, lens, [300, 200]).unwrap();
                let (mut lower, mut upper) = (glam::DVec2::INFINITY, glam::DVec2::NEG_INFINITY);
                for (middle, half) in boxes {
                    for i in 0..8 {
                        let sign = |bit: i32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
                        let corner = middle + half * DVec3::new(sign(0), sign(1), sign(2));
                        let p = camera.project(corner).unwrap() - camera.centre_px;
                        let p = p / glam::DVec2::new(150.0, 100.0);
                        (lower, upper) = (lower.min(p), upper.max(p));
                    }
                }
                let fill = (upper - lower).max_element() / 2.0;
                assert!(
                    (fill - FILL).abs() < 1e-9,
                    "{lens:?} {azimuth_deg}: {lower} {upper}"
                );
                assert!(upper.max_element() < 0.93 && lower.min_element() > -0.93);
            }
        }
    }

    #[test]
    fn what_points_up_is_up() {
        for up in [
            DVec3::Z,
            DVec3::Y,
            DVec3::NEG_Y,
            DVec3::new(1.0, -2.0, 0.5).normalize(),
            -DVec3::Z,
        ] {
            let view = Viewpoint {
                azimuth_deg: 40.0,
                elevation_deg: 25.0,
                zoom: 1.0,
                up,
            };
            let boxes = [(DVec3::ZERO, DVec3::ONE)];
            let camera = view.camera(&boxes, Lens::FovDeg(40.0), [64; 2]).unwrap();
            let [middle, above] = [DVec3::ZERO, up].map(|p| camera.project(p).unwrap());
            // Rows run downwards: `up` points up in the picture, and vertically except for the perspective of a
            // line beside the axis.
            let (dx, dy) = (above.x - middle.x, above.y - middle.y);
            assert!(dy < -5.0 && dx.abs() < 0.05 * dy.abs(), "{up}: {dx} {dy}");
        }
        // With y up a camera without azimuth looks along -z, with y down along +z; both have +x on their right.
        for up in [DVec3::Y, DVec3::NEG_Y] {
            let view = Viewpoint {
                azimuth_deg: 0.0,
                elevation_deg: 0.0,
                zoom: 1.0,
                up,
            };
            let boxes = [(DVec3::ZERO, DVec3::ONE)];
            let camera = view.camera(&boxes, Lens::FovDeg(40.0), [64; 2]).unwrap();
            assert!(camera.eye.z * up.y > 1.0 && camera.eye.truncate().length() < 1e-9);
            let right = camera.project(DVec3::X).unwrap();
            assert!(right.x > 40.0 && (right.y - 32.0).abs() < 1e-9, "{right}");
        }
    }

    #[test]
    fn azimuths_are_those_of_directions() {
        for up in [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::Z] {
            for azimuth_deg in [-150.0, -20.0, 0.0, 75.0, 170.0] {
                let view = Viewpoint {
                    azimuth_deg,
                    elevation_deg: 20.0,
                    zoom: 1.0,
                    up,
                };
                let boxes = [(DVec3::ZERO, DVec3::ONE)];
                let camera = view.camera_around(&boxes, Lens::OrthoHeight(None), [8; 2]);
                let found = Viewpoint::azimuth_of(camera.unwrap().forward(), up);
                assert!(
                    (found - azimuth_deg).abs() < 1e-9,
                    "{up}: {azimuth_deg} {found}"
                );
            }
        }
    }

    #[test]
    fn a_point_is_seen_and_nothing_gives_no_camera() {
        let view = Viewpoint {
            azimuth_deg: 10.0,
            elevation_deg: 20.0,
            zoom: 2.0,
            up: DVec3::Z,
        };
        for lens in [Lens::FovDeg(30.0), Lens::OrthoHeight(None)] {
            let point = DVec3::new(1e7, 5.0, -3.0);
            let camera = view.camera(&[(point, DVec3::ZERO)], lens, [64, 48]);
            let p = camera.unwrap().project(point).unwrap();
            // 1e7 is accurate to 2e-9 in f64, at tens of pixels a unit.
            assert!((p - glam::DVec2::new(32.0, 24.0)).length() < 1e-5, "{p}");
            assert_eq!(view.camera(&[], lens, [64, 48]), None);
        }
    }
}
