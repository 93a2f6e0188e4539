//! Defines how calibrated lenses bend pictures.

use glam::{DMat2, DVec2, DVec3};

/// Distortion of a calibrated lens, as calibration programs state it.
///
/// Places are slopes: right and down over forward, before focal lengths and the optical axis.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Distortion {
    /// Radial and tangential terms (Brown 1966, Conrady 1919), as OpenCV and COLMAP define them. A direction with slope s, r = |s|,
    /// is seen at s (1 + a1 r² + a2 r⁴ + a3 r⁶ + a4 r⁸) / (1 + b1 r² + b2 r⁴ + b3 r⁶)
    /// + (2 p1 sx sy + p2 (r² + 2 sx²), p1 (r² + 2 sy²) + 2 p2 sx sy).
    Radial {
        /// a1 to a4: k1, k2, k3 of the programs, and k4 of nerfstudio.
        above: [f64; 4],
        /// b1 to b3: k4, k5, k6 of OpenCV.
        below: [f64; 3],
        /// p1 and p2.
        p: [f64; 2],
    },
    /// A fisheye (Kannala and Brandt 2006), as OpenCV and COLMAP define it. A direction at the angle t to the axis is seen at the distance
    /// t (1 + k1 t² + k2 t⁴ + k3 t⁶ + k4 t⁸) from it.
    Fisheye([f64; 4]),
}

/// Steps of Newton's method. Each doubles the number of digits.
const STEPS: usize = 30;

/// Greatest distance, relative to 1 and the place, between a place and that of the direction found for it.
const EXACT: f64 = 1e-9;

impl Distortion {
    /// Returns the direction that is seen at a place, unit length; `None` if none is.
    ///
    /// The answer is the one that continues from the axis outwards: beyond a turning point of the polynomial, places have none.
    pub fn direction(&self, place: DVec2) -> Option<DVec3> {
        if !place.is_finite() {
            return None;
        }
        match self {
            Self::Radial { .. } => {
                let slope = self.undistorted(place)?;
                slope.extend(1.0).try_normalize()
            }
            Self::Fisheye(k) => {
                let distance = place.length();
                let angle = angle_at(k, distance)?;
                let (sin, cos) = angle.sin_cos();
                Some((place.normalize_or_zero() * sin).extend(cos))
            }
        }
    }

    /// Returns the slope that is seen at a place. The way from the axis to the place is followed, so that the answer lies before
    /// any fold of the picture.
    fn undistorted(&self, place: DVec2) -> Option<DVec2> {
        const PARTS: usize = 4;
        let Self::Radial { above, below, p } = *self else {
            return None;
        };
        let mut slope = DVec2::ZERO;
        for part in 1..=PARTS {
            let wanted = place * (part as f64 / PARTS as f64);
            let mut steps = 0..STEPS;
            loop {
                let (found, derivatives) = radial(above, below, p, slope);
                let error = found - wanted;
                if error.length() <= EXACT * (1.0 + wanted.length()) {
                    // Beyond a fold places come back, or are seen on the other side of the axis.
                    let is_before = derivatives.determinant() > 0.0 && found.dot(slope) >= 0.0;
                    is_before.then_some(())?;
                    break;
                }
                steps.next()?;
                slope -= derivatives.inverse() * error;
            }
        }
        slope.is_finite().then_some(slope)
    }

    /// Returns the place at which a slope is seen.
    #[cfg(test)]
    fn place(&self, slope: DVec2) -> DVec2 {
        match self {
            Self::Radial { above, below, p } => radial(*above, *below, *p, slope).0,
            Self::Fisheye(k) => {
                let angle = slope.length().atan();
                slope.normalize_or_zero() * fisheye(k, angle).0
            }
        }
    }
}

/// Returns the place of a slope, and its derivatives by the slope.
fn radial(above: [f64; 4], below: [f64; 3], [p1, p2]: [f64; 2], s: DVec2) -> (DVec2, DMat2) {
    let r2 = s.length_squared();
    // Values and derivatives by r².
    let sum = |[a, b, c, d]: [f64; 4]| {
        let value = 1.0 + r2 * (a + r2 * (b + r2 * (c + r2 * d)));
        (value, a + r2 * (2.0 * b + r2 * (3.0 * c + r2 * 4.0 * d)))
    };
    let (above, above_slope) = sum(above);
    let (below, below_slope) = sum([below[0], below[1], below[2], 0.0]);
    let factor = above / below;
    let factor_slope = (above_slope - factor * below_slope) / below;
    let tangential = DVec2::new(
        2.0 * p1 * s.x * s.y + p2 * (r2 + 2.0 * s.x * s.x),
        p1 * (r2 + 2.0 * s.y * s.y) + 2.0 * p2 * s.x * s.y,
    );
    let mixed = 2.0 * (p1 * s.x + p2 * s.y);
    let by_x = s * (2.0 * s.x * factor_slope)
        + DVec2::new(factor + 2.0 * p1 * s.y + 6.0 * p2 * s.x, mixed);
    let by_y = s * (2.0 * s.y * factor_slope)
        + DVec2::new(mixed, factor + 6.0 * p1 * s.y + 2.0 * p2 * s.x);
    (s * factor + tangential, DMat2::from_cols(by_x, by_y))
}

/// Returns the distance from the axis of an angle, and its derivative.
fn fisheye(k: &[f64; 4], t: f64) -> (f64, f64) {
    let t2 = t * t;
    let [a, b, c, d] = *k;
    let value = t * (1.0 + t2 * (a + t2 * (b + t2 * (c + t2 * d))));
    let slope = 1.0 + t2 * (3.0 * a + t2 * (5.0 * b + t2 * (7.0 * c + t2 * 9.0 * d)));
    (value, slope)
}

/// Returns the least angle that is seen at a distance from the axis, up to half a turn.
fn angle_at(k: &[f64; 4], distance: f64) -> Option<f64> {
    const PARTS: usize = 64;
    let mut low = 0.0;
    for part in 1..=PARTS {
        let high = std::f64::consts::PI * part as f64 / PARTS as f64;
        let (value, slope) = fisheye(k, high);
        if value >= distance {
            let (mut low, mut high) = (low, high);
            // Halves: 50 are as exact as f64.
            for _ in 0..50 {
                let middle = (low + high) / 2.0;
                match fisheye(k, middle).0 >= distance {
                    true => high = middle,
                    false => low = middle,
                }
            }
            return Some((low + high) / 2.0);
        }
        // Beyond a turning point angles come back.
        if !(slope > 0.0) {
            return None;
        }
        low = high;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_seen_at_their_places() {
        let lenses = [
            Distortion::Radial {
                above: [-0.28, 0.09, -0.01, 0.0],
                below: [0.0; 3],
                p: [1e-3, -2e-3],
            },
            Distortion::Radial {
                above: [0.4, 0.2, 0.0, 0.01],
                below: [0.1, 0.05, 0.01],
                p: [0.0; 2],
            },
            Distortion::Fisheye([0.05, -0.01, 0.002, -1e-4]),
            Distortion::Fisheye([0.0; 4]),
        ];
        for lens in lenses {
            for i in 0..100 {
                let slope = DVec2::new(f64::from(i % 10) - 4.5, f64::from(i / 10) - 4.5) * 0.15;
                let direction = lens.direction(lens.place(slope)).unwrap();
                let found = direction.truncate() / direction.z;
                assert!(found.abs_diff_eq(slope, 1e-7), "{lens:?} {slope} {found}");
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let (above, below, p) = ([-0.3, 0.2, 0.05, 0.02], [0.1, -0.02, 0.01], [0.01, -0.02]);
        let radial = |s| radial(above, below, p, s);
        for s in [DVec2::new(0.3, -0.4), DVec2::new(-0.7, 0.1)] {
            let (_, derivatives) = radial(s);
            for (axis, own) in [DVec2::X, DVec2::Y]
                .into_iter()
                .zip([derivatives.x_axis, derivatives.y_axis])
            {
                let step = 1e-6;
                let ends = [s + axis * step, s - axis * step].map(|s| radial(s).0);
                let expected = (ends[0] - ends[1]) / (2.0 * step);
                assert!(own.abs_diff_eq(expected, 1e-8), "{own} {expected}");
            }
        }
    }

    #[test]
    fn places_beyond_a_fold_see_nothing() {
        // s (1 - s²) is .385 at most, at .577.
        let lens = Distortion::Radial {
            above: [-1.0, 0.0, 0.0, 0.0],
            below: [0.0; 3],
            p: [0.0; 2],
        };
        let near = lens.direction(DVec2::new(0.38, 0.0)).unwrap();
        assert!(near.x / near.z < 0.577);
        assert_eq!(lens.direction(DVec2::new(0.39, 0.0)), None);
        let wide = Distortion::Fisheye([-0.2, 0.0, 0.0, 0.0]);
        assert_eq!(wide.direction(DVec2::new(1.0, 0.0)), None);
        assert_eq!(
            Distortion::Fisheye([0.0; 4]).direction(DVec2::new(3.2, 0.0)),
            None
        );
        let back = Distortion::Fisheye([0.0; 4])
            .direction(DVec2::new(0.0, 3.1))
            .unwrap();
        assert!(back.z < -0.99);
        for number in [f64::NAN, f64::INFINITY] {
            assert_eq!(lens.direction(DVec2::splat(number)), None);
            assert_eq!(wide.direction(DVec2::splat(number)), None);
        }
    }
}
