//! Looks along an axis of the world, as figures of papers do.

use glam::DVec3;

use super::camera::{Camera, Projection};
use super::fit::{Bounds, Lens, extent_of, facing};

/// An axis of the world along which an orthographic camera looks.
///
/// | along | right in the picture | up in the picture | the camera looks towards |
/// |---|---|---|---|
/// | x, -x | y, -y | z | -x, x |
/// | y, -y | x, -x | z | y, -y |
/// | z, -z | x, -x | y | -z, z |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Along {
    /// 0 for x, 1 for y, 2 for z.
    axis: usize,
    /// True for an axis with a minus sign: seen from the other side.
    is_from_behind: bool,
}

/// The part of the world that a picture along an axis shows \[world units\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Coordinates at the picture's edges across, the lesser one first.
    pub across: [f64; 2],
    /// Coordinates at the lower and at the upper edge.
    pub upwards: [f64; 2],
}

impl Along {
    /// Along z: x to the right, y up.
    pub const Z: Self = Self {
        axis: 2,
        is_from_behind: false,
    };

    /// Returns the axis of a name: `x`, `y`, `z`, `-x`, `-y` or `-z`.
    pub fn of_name(name: &str) -> Option<Self> {
        let (axis, is_from_behind) = match name.strip_prefix('-') {
            Some(axis) => (axis, true),
            None => (name, false),
        };
        let axis = ["x", "y", "z"].iter().position(|known| *known == axis)?;
        Some(Self {
            axis,
            is_from_behind,
        })
    }

    /// Returns the unit vector of the axis, without its sign.
    pub fn axis(self) -> DVec3 {
        DVec3::AXES[self.axis]
    }

    /// Returns the directions to the right and up in the picture.
    pub fn picture_axes(self) -> [DVec3; 2] {
        let [right, up] = match self.axis {
            0 => [DVec3::Y, DVec3::Z],
            1 => [DVec3::X, DVec3::Z],
            _ => [DVec3::X, DVec3::Y],
        };
        [if self.is_from_behind { -right } else { right }, up]
    }

    /// Returns the window that shows just a box.
    pub fn window(self, [lower, upper]: [DVec3; 2]) -> Window {
        let [right, up] = self.picture_axes();
        let along = |axis: DVec3| [lower.dot(axis.abs()), upper.dot(axis.abs())];
        Window {
            across: along(right),
            upwards: along(up),
        }
    }

    /// Returns the camera that sees all of `boxes`, as large and as centred as possible; `None` without boxes.
    ///
    /// - `height`: height of the picture \[world units\]; `None` fits it to the boxes.
    pub fn fitted(self, boxes: &[Bounds], height: Option<f64>, size: [usize; 2]) -> Option<Camera> {
        let [right, up] = self.picture_axes();
        let extent = |n| extent_of(boxes, n);
        facing(
            [up.cross(right), up],
            Lens::OrthoHeight(height),
            size,
            extent,
        )
    }

    /// Returns the camera whose picture ends at the edges of a window.
    ///
    /// - `boxes`: what is to lie in front of the camera.
    pub fn camera(self, window: &Window, boxes: &[Bounds], size: [usize; 2]) -> Camera {
        let [width, height] = window.lengths();
        let middle = |[a, b]: [f64; 2]| a + (b - a) / 2.0;
        let [right, up] = self.picture_axes();
        let forward = up.cross(right);
        let centre = right.abs() * middle(window.across) + up * middle(window.upwards);
        let (near, far) = extent_of(boxes, forward);
        // Well in front of the nearest box, so that the eye's plane cuts no kernel.
        let depth = match near <= far {
            true => near - (far - near) - height,
            false => -height,
        };
        let eye = centre + forward * depth;
        let camera = Camera::orthographic(eye, eye, up, height, size);
        let mut camera = camera.looking_along(forward, up);
        camera.focal_px.x = size[0] as f64 / width;
        camera
    }

    /// Returns the axis along which an orthographic camera looks, if it looks along one.
    pub fn of_camera(camera: &Camera) -> Option<Self> {
        let all = [false, true].into_iter().flat_map(|is_from_behind| {
            (0..3).map(move |axis| Self {
                axis,
                is_from_behind,
            })
        });
        let rows = [0, 1].map(|row| camera.camera_from_world.row(row));
        let is_it = |along: &Self| {
            let [right, up] = along.picture_axes();
            rows == [right, -up]
        };
        let is_flat = camera.projection == Projection::Orthographic;
        all.into_iter().find(is_it).filter(|_| is_flat)
    }

    /// Returns the coordinates at the left, right, lower and upper edge of a camera's picture, if it looks along an axis:
    /// what `imshow` takes as `extent`, with the first row above.
    pub fn extent(camera: &Camera) -> Option<[f64; 4]> {
        let [right, up] = Self::of_camera(camera)?.picture_axes();
        let at = |direction: DVec3, px: f64| {
            let sign = direction.element_sum();
            camera.eye.dot(direction.abs()) + sign * px
        };
        let [fx, fy] = camera.focal_px.to_array();
        let [cx, cy] = camera.centre_px.to_array();
        let (width, height) = (camera.width as f64, camera.height as f64);
        Some([
            at(right, -cx / fx),
            at(right, (width - cx) / fx),
            at(up, (cy - height) / fy),
            at(up, cy / fy),
        ])
    }
}

impl Window {
    /// Returns the width and the height \[world units\].
    pub fn lengths(&self) -> [f64; 2] {
        [self.across, self.upwards].map(|[a, b]| b - a)
    }

    /// Returns whether a picture of a size shows it with square pixels, to within the rounding of the sides to whole pixels.
    pub fn has_shape(&self, size: [usize; 2]) -> bool {
        let [width, height] = self.lengths();
        let pixels = [width / size[0] as f64, height / size[1] as f64];
        (pixels[0] / pixels[1] - 1.0).abs() <= 1.0 / size[0].min(size[1]) as f64
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    const NAMES: [&str; 6] = ["x", "y", "z", "-x", "-y", "-z"];

    #[test]
    fn pictures_along_axes_are_not_mirrored_and_end_at_their_windows() {
        let window = Window {
            across: [1.0, 5.0],
            upwards: [-2.0, 0.0],
        };
        let boxes = [(DVec3::splat(2.0), DVec3::splat(7.0))];
        for name in NAMES {
            let along = Along::of_name(name).unwrap();
            let [right, up] = along.picture_axes();
            let camera = along.camera(&window, &boxes, [400, 200]);
            camera.validate().unwrap();
            // Right, up and towards the eye make a right-handed system.
            assert_eq!(right.cross(up), -camera.forward(), "{name}");
            let corner = right.abs() * 1.0 - up * 2.0 + along.axis() * 3.0;
            let x = if name.starts_with('-') { 400.0 } else { 0.0 };
            assert_eq!(camera.project(corner), Some(DVec2::new(x, 200.0)), "{name}");
            let [left, to, low, high] = Along::extent(&camera).unwrap();
            let across = if name.starts_with('-') {
                [5.0, 1.0]
            } else {
                [1.0, 5.0]
            };
            assert_eq!([left, to, low, high], [across[0], across[1], -2.0, 0.0]);
            assert!(boxes[0].0.dot(camera.forward()) - 21.0 >= camera.eye.dot(camera.forward()));
        }
    }

    #[test]
    fn fitted_pictures_along_axes_show_all() {
        let boxes = [(DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 1.0, 2.0))];
        for name in NAMES {
            let along = Along::of_name(name).unwrap();
            let camera = along.fitted(&boxes, None, [300, 200]).unwrap();
            let [left, right, low, high] = Along::extent(&camera).unwrap();
            let (middle, half) = boxes[0];
            let window = along.window([middle - half, middle + half]);
            let (across, up) = (window.across, window.upwards);
            assert!(
                left.min(right) < across[0] && left.max(right) > across[1],
                "{name}"
            );
            assert!(low < up[0] && high > up[1], "{name}");
        }
        assert!(Along::Z.fitted(&[], None, [3, 2]).is_none());
    }

    #[test]
    fn other_cameras_and_names_have_no_axis() {
        for name in ["", "-", "w", "xy", "+x", "X"] {
            assert_eq!(Along::of_name(name), None);
        }
        let slanted = DVec3::new(1.0, 2.0, 3.0);
        let oblique = Camera::orthographic(slanted, DVec3::ZERO, DVec3::Z, 1.0, [9, 9]);
        assert_eq!(Along::extent(&oblique), None);
        let near = Camera::perspective(DVec3::Z, DVec3::ZERO, DVec3::Y, 30.0, [9, 9]);
        assert_eq!(Along::extent(&near), None);
    }
}
