//! Describes the clip planes for editing, as a box and one plane of any direction, and moves them
//! with the pointer.

use ewa_splat::view::{Bounds, Camera, ClipPlane, Projection};
use glam::{DVec2, DVec3};

/// Smallest component of a unit direction across the view. A line below it points at the eye, so a
/// pointer cannot follow it in the picture.
const LEAST_ACROSS: f64 = 0.03;

/// Planes of the settings, grouped for editing.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Clip {
    /// Lower and upper corner of a box whose faces clip.
    pub(crate) corners: Option<[DVec3; 2]>,
    pub(crate) plane: Option<ClipPlane>,
    /// Other planes that were asked for; they cannot be edited.
    others: Vec<ClipPlane>,
}

impl Clip {
    /// Finds the first box among planes, and the first other plane.
    pub(crate) fn of(planes: &[ClipPlane]) -> Self {
        let found = (0..planes.len()).find_map(|i| Some((i, corners(planes.get(i..i + 6)?)?)));
        let (mut others, corners) = match found {
            Some((i, corners)) => ([&planes[..i], &planes[i + 6..]].concat(), Some(corners)),
            None => (planes.to_vec(), None),
        };
        let plane = (!others.is_empty()).then(|| others.remove(0));
        Self {
            corners,
            plane,
            others,
        }
    }

    /// Returns all planes: the box's, then the single plane, then the others.
    pub(crate) fn planes(&self) -> Vec<ClipPlane> {
        let faces = self.corners.map(|[low, high]| ClipPlane::of_box(low, high));
        let faces = faces.iter().flatten().copied();
        faces
            .chain(self.plane)
            .chain(self.others.iter().copied())
            .collect()
    }
}

/// Returns the corners of the box that six planes form, or `None` if they form none.
fn corners(planes: &[ClipPlane]) -> Option<[DVec3; 2]> {
    let mut corners = [DVec3::NAN; 2];
    for plane in planes {
        let axis = (0..3).find(|&axis| plane.normal[axis].abs() == 1.0)?;
        if plane.normal.abs().element_sum() != 1.0 {
            return None;
        }
        // The plane keeps n x + d >= 0: coordinates from -d up, or up to d.
        let (corner, place) = match plane.normal[axis] > 0.0 {
            true => (0, -plane.distance),
            false => (1, plane.distance),
        };
        corners[corner][axis] = place;
    }
    let is_whole = corners.iter().all(|corner| corner.is_finite());
    is_whole.then_some(corners)
}

/// Returns the centre and the half sides of the box between two corners.
pub(crate) fn bounds_of([low, high]: [DVec3; 2]) -> Bounds {
    ((low + high) / 2.0, (high - low) / 2.0)
}

/// Returns the centre of a face of a box.
pub(crate) fn face_centre(corners: [DVec3; 2], axis: usize, is_upper: bool) -> DVec3 {
    let mut centre = bounds_of(corners).0;
    centre[axis] = corners[usize::from(is_upper)][axis];
    centre
}

/// Moves a face of a box along its axis, but not beyond the opposite face or outside the data.
pub(crate) fn move_face(
    corners: &mut [DVec3; 2],
    (axis, is_upper): (usize, bool),
    place: f64,
    (centre, half): Bounds,
) {
    let [low, high] = [centre[axis] - half[axis], centre[axis] + half[axis]];
    let place = place.max(low).min(high);
    let across = corners[usize::from(!is_upper)][axis];
    corners[usize::from(is_upper)][axis] = match is_upper {
        true => place.max(across),
        false => place.min(across),
    };
}

/// Returns the point of a plane nearest to another point.
pub(crate) fn foot(plane: ClipPlane, point: DVec3) -> DVec3 {
    plane
        .normalised()
        .map_or(point, |unit| point - unit.normal * unit.inside(point))
}

/// Moves a plane along its normal until it contains a point, but keeps it in contact with a box.
pub(crate) fn through(plane: ClipPlane, point: DVec3, (centre, half): Bounds) -> ClipPlane {
    let middle = plane.normal.dot(centre);
    let reach = plane.normal.abs().dot(half);
    let at = plane.normal.dot(point);
    let distance = -at.max(middle - reach).min(middle + reach);
    ClipPlane { distance, ..plane }
}

/// Returns the polygon in which a plane cuts a box, or no corners if they do not meet.
pub(crate) fn section(plane: ClipPlane, (centre, half): Bounds) -> Vec<DVec3> {
    let mut points = Vec::new();
    for along in 0..3 {
        let (u, v) = ((along + 1) % 3, (along + 2) % 3);
        for (at_u, at_v) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let mut low = centre - half;
            low[u] = centre[u] + at_u * half[u];
            low[v] = centre[v] + at_v * half[v];
            let mut high = low;
            high[along] += 2.0 * half[along];
            let [a, b] = [low, high].map(|end| plane.inside(end));
            if (a < 0.0) != (b < 0.0) {
                points.push(low + (high - low) * (a / (a - b)));
            }
        }
    }
    let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let Some(unit) = plane.normalised() else {
        return Vec::new();
    };
    let (right, up) = unit.normal.any_orthonormal_pair();
    let angle = |point: &DVec3| {
        let arm = *point - middle;
        arm.dot(up).atan2(arm.dot(right))
    };
    points.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    points
}

/// Returns the distance along a line, world units, to the point whose image is nearest to a pixel.
///
/// - `direction`: unit vector of the line.
///
/// Returns `None` if the line points at the eye, or if the point lies behind the eye.
pub(crate) fn along(camera: &Camera, from: DVec3, direction: DVec3, pixel: DVec2) -> Option<f64> {
    let (a, n) = (
        camera.camera_point(from),
        camera.camera_from_world * direction,
    );
    let f = camera.focal_px;
    // Direction of the line's image, per unit of the line's length at this depth.
    let across = match camera.projection {
        Projection::Perspective if a.z <= 0.0 => return None,
        Projection::Perspective => n.truncate() - a.truncate() * (n.z / a.z),
        Projection::Orthographic => n.truncate(),
    };
    if across.length() < LEAST_ACROSS {
        return None;
    }
    let u = (across * f).try_normalize()?;
    let q = u.dot(pixel - camera.centre_px);
    let (start, step) = (u.dot(f * a.truncate()), u.dot(f * n.truncate()));
    // Solves (start + t step) / (a.z + t n.z) = q for t; the orthographic case has no denominator.
    let t = match camera.projection {
        Projection::Perspective => (q * a.z - start) / (step - q * n.z),
        Projection::Orthographic => (q - start) / step,
    };
    let is_seen = camera.projection == Projection::Orthographic || a.z + t * n.z > 0.0;
    (t.is_finite() && is_seen).then_some(t)
}

/// Returns the direction from a point to where a pixel's ray meets a sphere around it. If the ray
/// misses the sphere, it returns the direction to the nearest point of the ray.
///
/// - `towards`: unit vector of the previous direction; of two intersections, the one nearer to it
///   is taken.
/// - `radius`: radius of the sphere, world units.
pub(crate) fn turned(
    camera: &Camera,
    centre: DVec3,
    (towards, radius): (DVec3, f64),
    pixel: DVec2,
) -> Option<DVec3> {
    let at = (pixel - camera.centre_px) / camera.focal_px;
    let world_from_camera = camera.camera_from_world.transpose();
    let (origin, ray) = match camera.projection {
        Projection::Perspective => (camera.eye, world_from_camera * at.extend(1.0)),
        Projection::Orthographic => (
            camera.eye + world_from_camera * at.extend(0.0),
            camera.forward(),
        ),
    };
    let ray = ray.try_normalize()?;
    let nearest = origin + ray * (centre - origin).dot(ray);
    let beside = (nearest - centre).length_squared();
    let tip = centre + towards * radius;
    let reach = (radius * radius - beside).max(0.0).sqrt();
    let ends = [nearest - ray * reach, nearest + ray * reach];
    let [near, far] = ends.map(|end| end.distance_squared(tip));
    let hit = if near <= far { ends[0] } else { ends[1] };
    (hit - centre).try_normalize()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    const CORNERS: [DVec3; 2] = [DVec3::new(-1.0, 2.0, -3.0), DVec3::new(4.0, 5.0, 6.0)];

    fn cameras() -> [Camera; 3] {
        let (eye, target) = (DVec3::new(9.0, -14.0, 8.0), DVec3::new(1.5, 3.0, 1.0));
        [
            Camera::perspective(eye, target, DVec3::Z, 40.0, [640, 480]),
            Camera::perspective(eye, target, DVec3::new(0.4, 0.3, 1.0), 95.0, [300, 500]),
            Camera::orthographic(eye, target, DVec3::Z, 12.0, [640, 480]),
        ]
    }

    #[test]
    fn a_box_and_a_plane_are_found_again() {
        let faces = ClipPlane::of_box(CORNERS[0], CORNERS[1]).to_vec();
        let plane = |x: f64| ClipPlane {
            normal: DVec3::new(x, 1.0, 0.0),
            distance: 2.0,
        };
        let all = [faces.clone(), vec![plane(0.5)], vec![plane(2.0)]].concat();
        let clip = Clip::of(&all);
        assert_eq!(
            (clip.corners, clip.plane),
            (Some(CORNERS), Some(plane(0.5)))
        );
        assert_eq!(clip.planes(), all);
        // The same planes in another order give the same result.
        let shifted = [vec![plane(0.5)], faces.clone(), vec![plane(2.0)]].concat();
        assert_eq!(Clip::of(&shifted), clip);
        let five = Clip::of(&faces[..5]);
        assert_eq!((five.corners, five.plane), (None, Some(faces[0])));
        assert_eq!(five.planes(), faces[..5]);
        // A plane at an angle to the axes is no face.
        let slanting = [vec![plane(1.0)], faces[..5].to_vec()].concat();
        assert_eq!(Clip::of(&slanting).corners, None);
        assert_eq!(Clip::of(&[]), Clip::default());
    }

    /// The pixels of a point moved along an axis give back the distance.
    #[test]
    fn faces_move_by_what_their_pixels_moved() {
        for camera in cameras() {
            for axis in 0..3 {
                for is_upper in [false, true] {
                    let centre = face_centre(CORNERS, axis, is_upper);
                    for moved in [-0.7, 0.0, 0.4] {
                        let to = centre + DVec3::AXES[axis] * moved;
                        let pixel = camera.project(to).unwrap();
                        let found = along(&camera, centre, DVec3::AXES[axis], pixel).unwrap();
                        assert!((found - moved).abs() < 1e-9, "{found} {moved}");
                        // A displacement perpendicular to the line moves nothing.
                        let ends = [centre, to + DVec3::AXES[axis]];
                        let [a, b] = ends.map(|p| camera.project(p).unwrap());
                        let aside = (b - a).perp().normalize() * 23.0;
                        let found = along(&camera, centre, DVec3::AXES[axis], pixel + aside);
                        assert!((found.unwrap() - moved).abs() < 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn lines_towards_the_eye_follow_no_hand() {
        for camera in cameras() {
            let from = camera.eye + camera.forward() * 7.0;
            let pixel = camera.centre_px + DVec2::new(30.0, 0.0);
            assert_eq!(along(&camera, from, camera.forward(), pixel), None);
            let behind = camera.eye - camera.forward();
            if camera.projection == Projection::Perspective {
                assert_eq!(along(&camera, behind, DVec3::X, pixel), None);
            }
        }
    }

    #[test]
    fn faces_stay_between_each_other_and_the_data() {
        let mut corners = CORNERS;
        let data = bounds_of(CORNERS);
        move_face(&mut corners, (0, true), 2.5, data);
        assert_eq!(corners[1], DVec3::new(2.5, 5.0, 6.0));
        move_face(&mut corners, (0, false), 3.0, data);
        assert_eq!(corners[0].x, 2.5);
        move_face(&mut corners, (0, true), 90.0, data);
        assert_eq!(corners[1], CORNERS[1]);
        move_face(&mut corners, (0, false), -90.0, data);
        assert_eq!(corners, CORNERS);
        assert_eq!(face_centre(corners, 1, true), DVec3::new(1.5, 5.0, 1.5));
    }

    #[test]
    fn planes_move_along_their_normals() {
        let plane = ClipPlane {
            normal: DVec3::new(0.0, 3.0, 4.0),
            distance: -10.0,
        };
        let on = foot(plane, DVec3::ZERO);
        assert!(plane.inside(on).abs() < 1e-12);
        assert!((on - DVec3::new(0.0, 1.2, 1.6)).length() < 1e-12);
        let data = (DVec3::ZERO, DVec3::ONE * 3.0);
        let moved = through(plane, on + plane.normal / 5.0 * 0.5, data);
        assert_eq!(moved.normal, plane.normal);
        assert!((foot(moved, on) - on).length() - 0.5 < 1e-12);
        // The plane stops at the corner.
        let last = through(plane, plane.normal * 100.0, data);
        assert!(last.inside(DVec3::ONE * 3.0).abs() < 1e-12);
    }

    /// The tip of a rotated normal is found under its pixel.
    #[test]
    fn normals_turn_to_where_their_tips_are_dragged() {
        for camera in cameras() {
            let centre = DVec3::new(1.0, 2.5, 0.5);
            // The normal is not along the view, so that after a small turn it is still on the same
            // side of the sphere.
            let normal = (camera.eye - centre).normalize() + DVec3::new(0.3, 0.2, 0.1);
            for sign in [1.0, -1.0] {
                let normal = normal.normalize() * sign;
                let turn = DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 1.0).normalize(), 0.25);
                let pixel = camera.project(centre + turn * normal * 1.5).unwrap();
                let found = turned(&camera, centre, (normal, 1.5), pixel).unwrap();
                assert!((found - turn * normal).length() < 1e-9, "{found}");
            }
            // A pixel beside the sphere gives a direction across the view, towards the pointer.
            let far = camera.project(centre).unwrap() + DVec2::new(120.0, 0.0);
            let found = turned(&camera, centre, (normal.normalize(), 1.5), far).unwrap();
            let seen = camera.camera_from_world * found;
            assert!(seen.x > 0.5, "{seen}");
        }
    }

    #[test]
    fn sections_are_polygons_of_the_plane_and_the_box() {
        let data = (DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 2.0, 3.0));
        let across = ClipPlane {
            normal: DVec3::X * 2.0,
            distance: -1.0,
        };
        let corners = section(across, data);
        assert_eq!(corners.len(), 4);
        let round: f64 = (0..4)
            .map(|i| corners[i].distance(corners[(i + 1) % 4]))
            .sum();
        assert!((round - 20.0).abs() < 1e-12 && corners.iter().all(|c| c.x == 0.5));
        // The plane through the centre of a cube, perpendicular to its diagonal, cuts a hexagon.
        let diagonal = ClipPlane {
            normal: DVec3::ONE,
            distance: 0.0,
        };
        let corners = section(diagonal, (DVec3::ZERO, DVec3::ONE));
        assert_eq!(corners.len(), 6);
        for i in 0..6 {
            let side = corners[i].distance(corners[(i + 1) % 6]);
            assert!((side - std::f64::consts::SQRT_2).abs() < 1e-12);
        }
        assert_eq!(section(across, (DVec3::X * 9.0, DVec3::ONE)), []);
    }
}
