//! Defines panoramas: pictures that are too wide for a flat projection.

use std::f64::consts::{FRAC_PI_4, PI};

use glam::{DMat3, DVec2, DVec3};

use super::camera::{Camera, is_rotation};
use super::distortion::Distortion;
use crate::error::{Error, Result};

/// Greatest field of view of a fisheye, degrees.
pub const MOST_FISHEYE_DEG: f64 = 360.0;

/// Greatest number of pixels along a base pixel of a map of the sphere, whose 12 n² pixels are at most those of an image.
const MOST_SIDE: usize = 2048;

/// A picture of the directions around an eye.
///
/// Camera space is that of [`Camera`]: x right, y down, z forward.
#[derive(Debug, Clone, PartialEq)]
pub struct Panorama {
    /// Directions of the pixels.
    pub mapping: Mapping,
    /// The eye, world units.
    pub eye: DVec3,
    /// Rotation W: rows are the camera's right, down and forward in the world.
    pub camera_from_world: DMat3,
    /// Width of the picture in pixels.
    pub width: usize,
    /// Height of the picture in pixels.
    pub height: usize,
}

/// Directions of the pixels of a panorama.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Mapping {
    /// Longitudes across the picture, 360 degrees, and latitudes down, 180. The middle looks forward. Twice as wide as high, pixels in
    /// the middle are square.
    Equirectangular,
    /// A circle that touches the nearer two sides of the picture. The middle looks forward, and pixels beyond the circle
    /// show the background.
    Fisheye {
        /// Distance from the middle as a function of the angle to the axis.
        rule: FisheyeRule,
        /// Full angle across the circle, degrees, above 0 and at most [`MOST_FISHEYE_DEG`].
        fov_deg: f64,
    },
    /// Six square pictures of 90 degrees in a row: right, left, up, down, front, back. The lower edge of the one that looks up, and the
    /// upper edge of the one that looks down, adjoin the front.
    Cube,
    /// The picture of a calibrated lens.
    Lens {
        /// How the lens bends the picture.
        distortion: Distortion,
        /// (fx, fy): pixels per unit of slope, or per radian of a fisheye.
        focal_px: DVec2,
        /// (cx, cy): the pixel coordinate of the optical axis.
        centre_px: DVec2,
    },
    /// A row of pixels of equal areas on the sphere in the ring order of HEALPix (Górski et al. 2005): 12 n² pixels in one row, n a
    /// power of two.
    /// Directions are the camera's: +z has colatitude 0, and longitudes go from +x to +y.
    Healpix,
}

/// Distance from the middle of a fisheye as a function of the angle to its axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FisheyeRule {
    /// Proportional to the angle: of dome masters.
    Equidistant,
    /// Proportional to the sine of half the angle: pixels see equal solid angles.
    Equisolid,
}

impl Panorama {
    /// Returns a panorama from a camera's eye, turned and sized as its picture.
    pub fn of_camera(camera: &Camera, mapping: Mapping) -> Self {
        Self {
            mapping,
            eye: camera.eye,
            camera_from_world: camera.camera_from_world,
            width: camera.width,
            height: camera.height,
        }
    }

    /// Returns the master picture of a dome over a camera's eye: an equidistant fisheye whose middle is what is up for
    /// the camera, and whose lower edge is in front of it.
    pub fn dome(camera: &Camera, fov_deg: f64) -> Self {
        let (right, down, forward) = {
            let rows = camera.camera_from_world;
            (rows.row(0), rows.row(1), rows.row(2))
        };
        let rule = FisheyeRule::Equidistant;
        Self {
            camera_from_world: DMat3::from_cols(right, forward, -down).transpose(),
            ..Self::of_camera(camera, Mapping::Fisheye { rule, fov_deg })
        }
    }

    /// Returns an all-sky map of 12 n² pixels around an eye, in the axes of the world.
    pub fn sky(eye: DVec3, n: usize) -> Self {
        Self {
            mapping: Mapping::Healpix,
            eye,
            camera_from_world: DMat3::IDENTITY,
            width: n.saturating_mul(n).saturating_mul(12),
            height: 1,
        }
    }

    /// Checks the numbers, and that the picture's shape is the mapping's.
    ///
    /// # Errors
    /// The first condition that does not hold.
    pub fn validate(&self) -> Result<()> {
        let fault = |place: &str, expected: &str, found: String| {
            Err(Error::invalid(
                "panorama",
                place,
                expected,
                found,
                "change it",
            ))
        };
        if !self.eye.is_finite() {
            return fault("eye", "finite numbers", self.eye.to_string());
        }
        if !is_rotation(self.camera_from_world) {
            let found = self.camera_from_world.to_string();
            return fault("camera_from_world", "a rotation", found);
        }
        let size = format!("{} x {} pixels", self.width, self.height);
        if self.width == 0 || self.height == 0 {
            return fault("size", "at least a pixel", size);
        }
        match self.mapping {
            Mapping::Cube if self.width != self.height.saturating_mul(6) => {
                fault("size", "six squares in a row", size)
            }
            Mapping::Lens {
                focal_px,
                centre_px,
                ..
            } if !(focal_px.min_element() > 0.0
                && focal_px.is_finite()
                && centre_px.is_finite()) =>
            {
                let found = format!("focal lengths {focal_px}, axis {centre_px}");
                fault("lens", "finite numbers and positive focal lengths", found)
            }
            Mapping::Healpix if self.side().is_none() => {
                let expected = "one row of 12 n² pixels, n a power of two up to 2048";
                fault("size", expected, size)
            }
            Mapping::Fisheye { fov_deg, .. } if !(fov_deg > 0.0 && fov_deg <= MOST_FISHEYE_DEG) => {
                fault(
                    "field of view",
                    "above 0 and at most 360 degrees",
                    fov_deg.to_string(),
                )
            }
            _ => Ok(()),
        }
    }

    /// Returns the number n of pixels along a base pixel of a map of the sphere.
    fn side(&self) -> Option<usize> {
        let n = (self.width / 12).isqrt();
        let is_map = self.height == 1 && 12 * n * n == self.width;
        (is_map && n.is_power_of_two() && n <= MOST_SIDE).then_some(n)
    }

    /// Returns the least angle between neighbouring pixels across the middle of the picture, radians.
    pub(crate) fn spacing(&self) -> f64 {
        let (width, height) = (self.width as f64, self.height as f64);
        match self.mapping {
            Mapping::Equirectangular => (2.0 * PI / width).min(PI / height),
            Mapping::Fisheye { rule, fov_deg } => {
                let half = fov_deg.to_radians() / 2.0;
                let radius = width.min(height) / 2.0;
                match rule {
                    FisheyeRule::Equidistant => half / radius,
                    FisheyeRule::Equisolid => 2.0 * (half / 2.0).sin() / radius,
                }
            }
            Mapping::Lens { focal_px, .. } => 1.0 / focal_px.max_element(),
            Mapping::Cube => 2.0 / height,
            Mapping::Healpix => (4.0 * PI / width).sqrt(),
        }
    }

    /// Returns the direction of a place in a pixel, camera space, unit length; `None` where the mapping has none.
    ///
    /// - `pixel`: column and row.
    /// - `within`: place in the pixel, from 0 to 1 along both of its sides; the middle is (.5, .5).
    pub fn direction(&self, pixel: [usize; 2], within: DVec2) -> Option<DVec3> {
        let place = DVec2::new(pixel[0] as f64, pixel[1] as f64) + within;
        let size = DVec2::new(self.width as f64, self.height as f64);
        match self.mapping {
            Mapping::Equirectangular => {
                let longitude = (place.x / size.x - 0.5) * 2.0 * PI;
                let latitude = (0.5 - place.y / size.y) * PI;
                let (sin, cos) = longitude.sin_cos();
                let (up, out) = latitude.sin_cos();
                Some(DVec3::new(out * sin, -up, out * cos))
            }
            Mapping::Fisheye { rule, fov_deg } => {
                let from_middle = (place - size / 2.0) / (size.min_element() / 2.0);
                let share = from_middle.length();
                let half = fov_deg.to_radians() / 2.0;
                let angle = match rule {
                    FisheyeRule::Equidistant => share * half,
                    FisheyeRule::Equisolid => 2.0 * (share * (half / 2.0).sin()).min(1.0).asin(),
                };
                let (sin, cos) = angle.sin_cos();
                let across = from_middle.normalize_or_zero() * sin;
                (share <= 1.0).then(|| across.extend(cos))
            }
            Mapping::Lens {
                distortion,
                focal_px,
                centre_px,
            } => distortion.direction((place - centre_px) / focal_px),
            Mapping::Cube => {
                let face = pixel[0] / self.height;
                let on_face = (place - DVec2::new((face * self.height) as f64, 0.0)) / size.y;
                let [right, down, forward] = Face::ALL[face.min(5)].axes();
                let slope = 2.0 * on_face - DVec2::ONE;
                Some((forward + slope.x * right + slope.y * down).normalize())
            }
            Mapping::Healpix => {
                let n = self.side()?;
                let (base, [x, y]) = place_in_base(n, pixel[0]);
                let on_base = (DVec2::new(x as f64, y as f64) + within) / n as f64;
                Some(direction_of_base(base, on_base))
            }
        }
    }
}

/// A face of the cube around an eye.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Face {
    Right,
    Left,
    Up,
    Down,
    Front,
    Back,
}

impl Face {
    pub(crate) const ALL: [Self; 6] = [
        Self::Right,
        Self::Left,
        Self::Up,
        Self::Down,
        Self::Front,
        Self::Back,
    ];

    /// Returns the directions that are right, down and forward for the face, camera space.
    pub(crate) fn axes(self) -> [DVec3; 3] {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        match self {
            Self::Right => [-z, y, x],
            Self::Left => [z, y, -x],
            Self::Up => [x, z, -y],
            Self::Down => [x, -z, y],
            Self::Front => [x, y, z],
            Self::Back => [-x, y, -z],
        }
    }

    /// Returns the face that a direction meets.
    pub(crate) fn of(direction: DVec3) -> Self {
        let size = direction.abs();
        if size.z >= size.x && size.z >= size.y {
            if direction.z >= 0.0 {
                Self::Front
            } else {
                Self::Back
            }
        } else if size.x >= size.y {
            if direction.x >= 0.0 {
                Self::Right
            } else {
                Self::Left
            }
        } else if direction.y >= 0.0 {
            Self::Down
        } else {
            Self::Up
        }
    }

    /// Returns the place at which a direction meets the face's plane at distance 1: right and down.
    pub(crate) fn slope(self, direction: DVec3) -> DVec2 {
        let [right, down, forward] = self.axes();
        DVec2::new(right.dot(direction), down.dot(direction)) / forward.dot(direction)
    }
}

/// For each base pixel of HEALPix, the ring of its lowest corner in units of n, and the longitude of its middle in eighths of a
/// circle.
const BASES: [(usize, usize); 12] = [
    (2, 1),
    (2, 3),
    (2, 5),
    (2, 7),
    (3, 0),
    (3, 2),
    (3, 4),
    (3, 6),
    (4, 1),
    (4, 3),
    (4, 5),
    (4, 7),
];

/// Returns the base pixel of a pixel in ring order, and its place in it, north-east and north-west from the base's southern corner
/// (Górski et al. 2005, section 4.1).
///
/// - `index`: below 12 n².
fn place_in_base(n: usize, index: usize) -> (usize, [usize; 2]) {
    let cap = 2 * n * (n - 1);
    let (base, ring, length, number, shift);
    // Numbers along a ring start at 1.
    if index < cap {
        ring = (1 + 2 * index).isqrt().div_ceil(2);
        number = index + 1 - 2 * ring * (ring - 1);
        (length, shift) = (ring, 0);
        base = (number - 1) / ring;
    } else if index < 12 * n * n - cap {
        let within = index - cap;
        ring = within / (4 * n) + n;
        number = within % (4 * n) + 1;
        (length, shift) = (n, (ring + n) % 2);
        let from_north = ring - n + 1;
        let from_south = 2 * n + 2 - from_north;
        let rising = (number + n - 1 - from_north / 2) / n;
        let falling = (number + n - 1 - from_south / 2) / n;
        base = match falling.cmp(&rising) {
            std::cmp::Ordering::Equal => falling % 4 + 4,
            std::cmp::Ordering::Less => falling,
            std::cmp::Ordering::Greater => rising + 8,
        };
    } else {
        let from_end = 12 * n * n - index;
        let from_south = (2 * from_end - 1).isqrt().div_ceil(2);
        number = 4 * from_south + 1 - (from_end - 2 * from_south * (from_south - 1));
        (length, shift) = (from_south, 0);
        ring = 4 * n - from_south;
        base = 8 + (number - 1) / from_south;
    }
    let (south, middle) = BASES[base];
    // Places along the two diagonals of the base, in half pixels.
    let down = signed(ring) + 1 - signed(south * n);
    let across = 2 * signed(number) - signed(middle * length) - signed(shift) - 1;
    let across = match across >= 2 * signed(n) {
        true => across - 8 * signed(n),
        false => across,
    };
    let place = [(across - down) / 2, (-across - down) / 2];
    (
        base,
        place.map(|side| usize::try_from(side).unwrap_or(0).min(n - 1)),
    )
}

fn signed(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// Returns the direction of a place in a base pixel, from 0 to 1 along its sides.
fn direction_of_base(base: usize, on_base: DVec2) -> DVec3 {
    let (south, middle) = BASES[base];
    let ring = south as f64 - on_base.x - on_base.y;
    // Length of a quarter of the ring, as a share of the equator's; the height above the equator's plane.
    let (length, z) = if ring < 1.0 {
        (ring, 1.0 - ring * ring / 3.0)
    } else if ring > 3.0 {
        let length = 4.0 - ring;
        (length, length * length / 3.0 - 1.0)
    } else {
        (1.0, (2.0 - ring) * 2.0 / 3.0)
    };
    let along = middle as f64 * length + on_base.x - on_base.y;
    let longitude = match length > 1e-15 {
        true => FRAC_PI_4 * along / length,
        false => 0.0,
    };
    let out = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
    DVec3::new(out * longitude.cos(), out * longitude.sin(), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIDDLE: DVec2 = DVec2::splat(0.5);

    fn of(mapping: Mapping, width: usize, height: usize) -> Panorama {
        Panorama {
            mapping,
            eye: DVec3::ZERO,
            camera_from_world: DMat3::IDENTITY,
            width,
            height,
        }
    }

    #[test]
    fn the_middle_looks_forward_and_sides_to_the_sides() {
        let picture = of(Mapping::Equirectangular, 8, 4);
        let at = |x, y, u, v| picture.direction([x, y], DVec2::new(u, v)).unwrap();
        assert!(at(4, 2, 0.0, 0.0).abs_diff_eq(DVec3::Z, 1e-12));
        assert!(at(6, 2, 0.0, 0.0).abs_diff_eq(DVec3::X, 1e-12));
        assert!(at(0, 0, 0.3, 0.0).abs_diff_eq(-DVec3::Y, 1e-12));
        let rule = FisheyeRule::Equidistant;
        let picture = of(
            Mapping::Fisheye {
                rule,
                fov_deg: 180.0,
            },
            8,
            8,
        );
        let at = |x, y, u, v| picture.direction([x, y], DVec2::new(u, v)).unwrap();
        assert!(at(4, 4, 0.0, 0.0).abs_diff_eq(DVec3::Z, 1e-12));
        assert!(at(7, 4, 1.0, 0.0).abs_diff_eq(DVec3::X, 1e-12));
        assert!(at(4, 7, 0.0, 1.0).abs_diff_eq(DVec3::Y, 1e-12));
        assert_eq!(picture.direction([0, 0], MIDDLE), None);
        let camera = Camera::perspective(DVec3::ZERO, DVec3::X, DVec3::Z, 60.0, [8, 8]);
        let dome = Panorama::dome(&camera, 180.0);
        let world =
            |at| dome.camera_from_world.transpose() * dome.direction([4, at], DVec2::ZERO).unwrap();
        assert!(world(4).abs_diff_eq(DVec3::Z, 1e-12));
        assert!(world(8).abs_diff_eq(DVec3::X, 1e-12));
    }

    #[test]
    fn equisolid_pixels_see_equal_solid_angles() {
        let rule = FisheyeRule::Equisolid;
        let picture = of(
            Mapping::Fisheye {
                rule,
                fov_deg: 360.0,
            },
            100,
            100,
        );
        for x in [50, 70, 90] {
            let at = |u, v| picture.direction([x, 50], DVec2::new(u, v)).unwrap();
            let (across, down) = (at(1.0, 0.5) - at(0.0, 0.5), at(0.5, 1.0) - at(0.5, 0.0));
            // The circle has the area of the sphere divided by four.
            let expected = 4.0 / 50.0 / 50.0;
            assert!(
                (across.cross(down).length() / expected - 1.0).abs() < 1e-3,
                "{x}"
            );
        }
    }

    #[test]
    fn faces_are_right_handed_and_hold_their_directions() {
        for face in Face::ALL {
            let [right, down, forward] = face.axes();
            assert_eq!(right.cross(down), forward);
            let inside = forward + 0.3 * right - 0.9 * down;
            assert_eq!(Face::of(inside), face);
            assert!(face.slope(inside).abs_diff_eq(DVec2::new(0.3, -0.9), 1e-12));
        }
        let cube = of(Mapping::Cube, 24, 4);
        for (number, face) in Face::ALL.into_iter().enumerate() {
            let at = cube.direction([4 * number + 2, 2], DVec2::ZERO).unwrap();
            assert!(at.abs_diff_eq(face.axes()[2], 1e-12));
        }
    }

    #[test]
    fn pixels_of_maps_have_equal_areas_and_are_in_rings() {
        for n in [1, 2, 4, 8, 32] {
            let count = 12 * n * n;
            let map = of(Mapping::Healpix, count, 1);
            map.validate().unwrap();
            let mut seen = vec![false; count];
            let mut last = (2.0, 0.0);
            let mut sum = DVec3::ZERO;
            for index in 0..count {
                let (base, [x, y]) = place_in_base(n, index);
                let own = base * n * n + y * n + x;
                assert!(!std::mem::replace(&mut seen[own], true), "{n} {index}");
                let at = map.direction([index, 0], MIDDLE).unwrap();
                assert!((at.length() - 1.0).abs() < 1e-12);
                sum += at;
                // Down the rings, and along each ring by the longitude.
                let longitude = at.y.atan2(at.x).rem_euclid(2.0 * PI);
                let is_next = at.z < last.0 - 1e-9 || at.z < last.0 + 1e-9 && longitude > last.1;
                assert!(is_next, "{n} {index}: {at}");
                last = (at.z, longitude);
                let corner = |u, v| map.direction([index, 0], DVec2::new(u, v)).unwrap();
                let side = 1e-3;
                let [from, to_x, to_y] = [(0.0, 0.0), (side, 0.0), (0.0, side)]
                    .map(|(du, dv)| corner(0.45 + du, 0.45 + dv));
                let area = (to_x - from).cross(to_y - from).length() / side / side;
                let expected = 4.0 * PI / count as f64;
                assert!((area / expected - 1.0).abs() < 5e-3, "{n} {index}: {area}");
            }
            assert!(sum.length() < 1e-9);
        }
    }

    #[test]
    fn shapes_that_no_mapping_has_are_refused() {
        of(Mapping::Cube, 12, 2).validate().unwrap();
        let rule = FisheyeRule::Equidistant;
        let fisheye = |fov_deg| of(Mapping::Fisheye { rule, fov_deg }, 4, 4);
        fisheye(360.0).validate().unwrap();
        for wrong in [
            of(Mapping::Cube, 12, 3),
            of(Mapping::Healpix, 12 * 9, 1),
            of(Mapping::Healpix, 0, 1),
            of(Mapping::Healpix, 12, 12),
            of(Mapping::Equirectangular, 0, 2),
            fisheye(0.0),
            fisheye(361.0),
            fisheye(f64::NAN),
            Panorama {
                eye: DVec3::NAN,
                ..fisheye(180.0)
            },
            Panorama {
                camera_from_world: DMat3::ZERO,
                ..fisheye(180.0)
            },
        ] {
            assert!(wrong.validate().is_err(), "{wrong:?}");
        }
    }
}
