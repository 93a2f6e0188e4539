//! Half-spaces that what is drawn is cut to.

use glam::DVec3;

use super::fit::Bounds;

/// A plane that keeps one side of what is drawn: the points x with normal . x + distance >= 0.
///
/// Several keep what all keep; six make a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipPlane {
    /// Towards the side that is kept, world space; of any length but 0.
    pub normal: DVec3,
    /// World units times the length of the normal.
    pub distance: f64,
}

impl ClipPlane {
    /// The six planes of a box with sides along the axes of the world.
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

    /// The same plane with a normal of unit length; `None` where there is none of finite numbers.
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

    /// How far inside a point lies: normal . x + distance, world units where the normal has unit
    /// length.
    pub fn inside(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.distance
    }
}

/// What planes leave of boxes, about: those that lie beyond a plane are left out, and planes across an
/// axis of the world cut the others. For a camera that fits what is drawn.
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
        // Kept from x = .5 on; the slanting plane cuts nothing off, but leaves out the second.
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
