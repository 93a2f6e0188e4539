//! Half-spaces that what is drawn is cut to.

use glam::DVec3;

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
