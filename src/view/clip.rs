//! Defines clip planes, half-spaces to which a scene is cut.

use glam::DVec3;

use super::fit::Bounds;

/// A plane that keeps one side of the scene: the points x with normal . x + distance >= 0.
///
/// Several planes keep the intersection of their half-spaces; six make a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipPlane {
    /// Normal towards the side that is kept, world space; any length but 0.
    pub normal: DVec3,
    /// Distance in world units, times the length of the normal.
    pub distance: f64,
}

impl ClipPlane {
    /// Returns the six planes of a box with sides along the axes of the world.
    pub fn of_box(lower: DVec3, upper: DVec3) -> [Self; 6] {
        let side = |normal: DVec3, bound: f64| Self {
            normal,
            distance: -bound,
        };
        [
            side(DVec3::X, lower.x),
            side(DVec3::Y, lower.y),
            side(DVec3::Z, lower.z),
            side(DVec3::NEG_X, -upper.x),
            side(DVec3::NEG_Y, -upper.y),
            side(DVec3::NEG_Z, -upper.z),
        ]
    }

    /// Returns the same plane with a unit normal; `None` if that has no finite numbers.
    pub fn normalised(&self) -> Option<Self> {
        let scale = self.normal.abs().max_element();
        let scaled = self.normal / scale;
        let length = scaled.length();
        let plane = Self {
            normal: scaled / length,
            distance: self.distance / scale / length,
        };
        (plane.normal.is_finite() && plane.distance.is_finite() && scale > 0.0).then_some(plane)
    }

    /// Returns the distance of a point inside the plane: normal . x + distance, in world units if the normal
    /// has unit length.
    pub fn inside(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.distance
    }
}

/// Clips boxes approximately, for fitting a camera to the visible part. Boxes beyond a plane are dropped;
/// planes perpendicular to an axis of the world cut the others.
pub fn clip_boxes(boxes: &[Bounds], planes: &[ClipPlane]) -> Vec<Bounds> {
    let clip = |&(middle, half): &Bounds| {
        let (mut lower, mut upper) = (middle - half, middle + half);
        for plane in planes {
            let ClipPlane { normal, distance } = plane.normalised()?;
            let middle = (lower + upper) / 2.0;
            let reach = normal.abs().dot((upper - lower) / 2.0);
            if normal.dot(middle) + distance < -reach {
                return None;
            }
            for axis in 0..3 {
                if normal[axis] == 1.0 {
                    lower[axis] = lower[axis].max(-distance);
                } else if normal[axis] == -1.0 {
                    upper[axis] = upper[axis].min(distance);
                }
            }
        }
        Some(((lower + upper) / 2.0, (upper - lower) / 2.0))
    };
    boxes.iter().filter_map(clip).collect()
}

/// Returns the parts of boxes that clip planes leave. If nothing is left, it returns all boxes, so
/// that a camera can be fitted.
pub fn left_of(all: Vec<Bounds>, planes: &[ClipPlane]) -> Vec<Bounds> {
    let left = clip_boxes(&all, planes);
    if left.is_empty() { all } else { left }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_keeps_what_lies_between_its_corners() {
        let (lower, upper) = (DVec3::new(-1.0, 2.0, 3.0), DVec3::new(1.0, 4.0, 3.5));
        let planes = ClipPlane::of_box(lower, upper);
        let keeps = |x| planes.iter().all(|plane| plane.inside(x) >= 0.0);
        assert!(keeps(DVec3::new(0.0, 3.0, 3.25)));
        for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
            let middle = (lower + upper) / 2.0;
            for bound in [lower, upper] {
                let out = 0.01 * (bound - middle)[axis].signum();
                let at = middle + unit * (bound[axis] - middle[axis]);
                assert!(keeps(at - unit * out) && !keeps(at + unit * out));
            }
        }
    }

    #[test]
    fn boxes_are_cut_to_what_is_left_of_them() {
        let boxes = [
            (DVec3::ZERO, DVec3::ONE),
            (DVec3::X * 10.0, DVec3::ONE),
            (DVec3::Y * 3.0, DVec3::ONE),
        ];
        let planes = [
            ClipPlane {
                normal: DVec3::X * 2.0,
                distance: -1.0,
            },
            ClipPlane {
                normal: DVec3::new(-1.0, -1.0, 0.0),
                distance: 3.0,
            },
        ];
        let left = clip_boxes(&boxes, &planes);
        assert_eq!(left.len(), 2, "{left:?}");
        // Kept from x = .5 on; the oblique plane cuts nothing off, but drops the second box.
        assert_eq!(left[0], (DVec3::X * 0.75, DVec3::new(0.25, 1.0, 1.0)));
        assert_eq!(left[1].0, DVec3::new(0.75, 3.0, 0.0));
        let beyond = ClipPlane {
            normal: DVec3::Z,
            distance: -7.0,
        };
        assert_eq!(clip_boxes(&boxes, &[beyond]), []);
    }

    #[test]
    fn normals_of_any_length_mean_the_same_plane() {
        let plane = ClipPlane {
            normal: DVec3::new(0.0, 3e200, 4e200),
            distance: 1e201,
        };
        let unit = plane.normalised().expect("a plane");
        assert!((unit.normal - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-15);
        assert!((unit.distance - 2.0).abs() < 1e-15);
        for normal in [DVec3::ZERO, DVec3::NAN, DVec3::X * f64::INFINITY] {
            assert_eq!(ClipPlane { normal, ..plane }.normalised(), None);
        }
    }
}
