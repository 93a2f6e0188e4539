//! Moves cameras between those of a sequence.

use glam::{DMat3, DQuat};

use super::camera::Camera;

/// Least rotation that is treated as a screw, radians. The axes of lesser ones are farther away than f64 resolves.
const LEAST_TURN: f64 = 1e-6;

impl Camera {
    /// Returns the camera at a time of a sequence. Between two cameras it moves along a screw: on a circle or a straight line where
    /// they lie on one. Before the first and after the last it moves on as it did, unless the sequence is closed.
    ///
    /// - `cameras`: at the times 0, 1, 2, ...; one at least.
    /// - `is_closed`: whether the first follows the last.
    ///
    /// # Panics
    /// No camera.
    pub fn between(cameras: &[Self], time: f64, is_closed: bool) -> Self {
        let count = cameras.len();
        if count == 1 {
            return cameras[0].clone();
        }
        let last = if is_closed { count - 1 } else { count - 2 };
        let time = match is_closed {
            true => time.rem_euclid(count as f64),
            false => time,
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the sequence"
        )]
        let before = time.floor().clamp(0.0, last as f64) as usize;
        let after = (before + 1) % count;
        cameras[before].moved(&cameras[after], time - before as f64)
    }

    /// Returns this camera, moved towards another along a screw.
    ///
    /// - `share`: 0 for this camera, 1 for the other.
    fn moved(&self, to: &Self, share: f64) -> Self {
        // The world's motion that takes this camera to the other: x -> Q x + b.
        let turn = to.camera_from_world.transpose() * self.camera_from_world;
        let (axis, angle) = DQuat::from_mat3(&turn).normalize().to_axis_angle();
        // The shorter way around.
        let (axis, angle) = match angle > std::f64::consts::PI {
            true => (-axis, std::f64::consts::TAU - angle),
            false => (axis, angle),
        };
        let way = to.eye - self.eye;
        let (eye, turn) = match angle > LEAST_TURN {
            true => {
                let along = axis * way.dot(axis);
                let across = way - along;
                // The middle of the circle on which the eye moves, from the eye.
                let middle = 0.5 * (across + axis.cross(across) / (0.5 * angle).tan());
                let turn = DMat3::from_axis_angle(axis, angle * share);
                (self.eye + middle - turn * middle + along * share, turn)
            }
            false => (self.eye + way * share, DMat3::IDENTITY),
        };
        Self {
            eye,
            camera_from_world: self.camera_from_world * turn.transpose(),
            focal_px: self.focal_px.lerp(to.focal_px, share),
            centre_px: self.centre_px.lerp(to.centre_px, share),
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn on_circle(turn: f64) -> Camera {
        let eye = DVec3::new(4.0 * turn.cos(), 4.0 * turn.sin(), 1.5);
        let middle = DVec3::new(0.0, 0.0, 0.2);
        Camera::perspective(eye, middle, DVec3::Z, 40.0, [60, 40])
    }

    fn assert_alike(found: &Camera, expected: &Camera) {
        assert!(
            (found.eye - expected.eye).length() < 1e-9,
            "{found:?} {expected:?}"
        );
        let off = found.camera_from_world - expected.camera_from_world;
        assert!(off.to_cols_array().iter().all(|x| x.abs() < 1e-9));
        assert!((found.focal_px - expected.focal_px).length() < 1e-9);
    }

    #[test]
    fn cameras_of_a_turn_stay_on_its_circle() {
        let step = std::f64::consts::TAU / 8.0;
        let cameras: Vec<Camera> = (0..8).map(|i| on_circle(step * f64::from(i))).collect();
        for time in [0.0, 0.25, 3.5, 7.9, -0.4, 8.3] {
            assert_alike(
                &Camera::between(&cameras, time, true),
                &on_circle(step * time),
            );
        }
        // Open, it moves on beyond its ends.
        let open = &cameras[..3];
        for time in [-0.4, 1.7, 2.3] {
            assert_alike(&Camera::between(open, time, false), &on_circle(step * time));
        }
    }

    #[test]
    fn cameras_without_a_turn_move_straight() {
        let at = |x: f64| {
            let eye = DVec3::new(1e6 + x, -5.0, 2.0);
            Camera::perspective(eye, eye + DVec3::Y, DVec3::Z, 30.0 + x, [60, 40])
        };
        let found = Camera::between(&[at(0.0), at(3.0)], 0.5, false);
        assert!((found.eye - at(1.5).eye).length() < 1e-9);
        let focal = 0.5 * (at(0.0).focal_px + at(3.0).focal_px);
        assert!((found.focal_px - focal).length() < 1e-9);
        assert_eq!(Camera::between(&[at(0.0)], 7.0, false), at(0.0));
    }

    #[test]
    fn a_camera_that_turns_where_it_stands_stays_there() {
        let looking = |turn: f64| {
            let forward = DVec3::new(turn.cos(), turn.sin(), 0.0);
            Camera::perspective(DVec3::ONE, DVec3::ONE + forward, DVec3::Z, 40.0, [60, 40])
        };
        let found = Camera::between(&[looking(0.0), looking(0.8)], 0.25, false);
        assert_alike(&found, &looking(0.2));
        // Half a turn has a tangent beyond bounds, and no circle's middle but half the way.
        let found = Camera::between(
            &[on_circle(0.0), on_circle(std::f64::consts::PI)],
            0.5,
            false,
        );
        assert!(
            (found.eye.truncate().length() - 4.0).abs() < 1e-6
                || found.eye.truncate().length() < 1e-6
        );
    }
}
