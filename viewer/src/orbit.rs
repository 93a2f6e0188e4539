//! Moves the camera by hand: around a point, across the view, towards the point.

use ewa_splat::view::{Camera, Projection};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Lens of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) enum Lens {
    /// Vertical field of view in degrees.
    Perspective(f64),
    /// Height of the picture in world units, at every depth.
    Orthographic(f64),
}

/// Camera that turns around a point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Orbit {
    pub(crate) eye: DVec3,
    pub(crate) target: DVec3,
    /// Up in the picture: perpendicular to the view.
    pub(crate) up: DVec3,
    /// Direction up in the world.
    pub(crate) world_up: DVec3,
    pub(crate) lens: Lens,
}

/// JSON file that `--camera` reads.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none", default)]
    fov_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    ortho_height: Option<f64>,
}

impl Orbit {
    /// Creates an orbit from a camera, around the point at `distance` in front of it.
    pub(crate) fn of(camera: &Camera, world_up: DVec3, distance: f64) -> Self {
        let forward = camera.forward();
        let height = camera.height as f64;
        let lens = match camera.projection {
            Projection::Perspective => {
                let half = (height / (2.0 * camera.focal_px.y)).atan();
                Lens::Perspective(2.0 * half.to_degrees())
            }
            Projection::Orthographic => Lens::Orthographic(height / camera.focal_px.y),
        };
        Self {
            eye: camera.eye,
            target: camera.eye + forward * distance,
            up: -camera.camera_from_world.row(1),
            world_up,
            lens,
        }
    }

    /// Returns the camera for a picture of this size.
    pub(crate) fn camera(&self, size: [usize; 2]) -> Camera {
        match self.lens {
            Lens::Perspective(fov) => {
                Camera::perspective(self.eye, self.target, self.up, fov, size)
            }
            Lens::Orthographic(height) => {
                Camera::orthographic(self.eye, self.target, self.up, height, size)
            }
        }
    }

    pub(crate) fn distance(&self) -> f64 {
        (self.target - self.eye).length()
    }

    fn forward(&self) -> DVec3 {
        (self.target - self.eye).normalize_or(DVec3::Y)
    }

    fn right(&self) -> DVec3 {
        self.forward().cross(self.up).normalize_or(DVec3::X)
    }

    /// Returns the size of a pixel at the target, world units, in a picture of this height.
    fn unit(&self, height: f64) -> f64 {
        match self.lens {
            Lens::Perspective(fov) => {
                2.0 * self.distance() * (fov.to_radians() / 2.0).tan() / height
            }
            Lens::Orthographic(world) => world / height,
        }
    }

    /// Turns the camera around the target: around the world's up direction, and over it.
    pub(crate) fn turn(&mut self, around: f64, over: f64) {
        let right = self.right();
        let turn = DQuat::from_axis_angle(self.world_up.normalize_or(DVec3::Z), around)
            * DQuat::from_axis_angle(right, over);
        let arm = turn * (self.eye - self.target);
        self.up = (turn * self.up).normalize_or(DVec3::Z);
        self.eye = self.target + arm;
    }

    /// Rolls the picture around its centre.
    pub(crate) fn roll(&mut self, angle: f64) {
        self.up = DQuat::from_axis_angle(self.forward(), angle) * self.up;
    }

    /// Turns the view direction without moving the eye.
    pub(crate) fn look(&mut self, aside: f64, up: f64) {
        let turn = DQuat::from_axis_angle(self.world_up.normalize_or(DVec3::Z), aside)
            * DQuat::from_axis_angle(self.right(), up);
        self.target = self.eye + turn * (self.target - self.eye);
        self.up = turn * self.up;
    }

    /// Moves the camera across the view, so that points at the target's depth follow the pointer.
    pub(crate) fn pan(&mut self, pixels: DVec2, height: f64) {
        let unit = self.unit(height);
        let step = self.up * (pixels.y * unit) - self.right() * (pixels.x * unit);
        self.eye += step;
        self.target += step;
    }

    /// Multiplies the distance to the target by `factor`.
    pub(crate) fn dolly(&mut self, factor: f64) {
        match &mut self.lens {
            Lens::Perspective(_) => {
                self.eye = self.target + (self.eye - self.target) * factor;
            }
            Lens::Orthographic(height) => *height *= factor,
        }
    }

    /// Flies right, up and forward, by multiples of the distance to the target.
    pub(crate) fn fly(&mut self, step: DVec3) {
        let step =
            (self.right() * step.x + self.up * step.y + self.forward() * step.z) * self.distance();
        self.eye += step;
        self.target += step;
    }

    /// Moves the target to another point, with the same direction and distance.
    pub(crate) fn recentre(&mut self, target: DVec3) {
        self.eye += target - self.target;
        self.target = target;
    }

    /// Looks along a direction, with the world's up direction up in the picture if possible.
    pub(crate) fn look_along(&mut self, forward: DVec3) {
        let distance = self.distance();
        self.eye = self.target - forward * distance;
        let aside = forward.cross(self.world_up);
        self.up = match aside.try_normalize() {
            Some(aside) => aside.cross(forward),
            None => forward.any_orthonormal_vector(),
        };
    }

    /// Switches between perspective and orthographic, and keeps the size of objects at the target.
    pub(crate) fn change_lens(&mut self) {
        let height = self.unit(1.0);
        self.lens = match self.lens {
            Lens::Perspective(_) => Lens::Orthographic(height),
            Lens::Orthographic(_) => {
                let fov = 35.0_f64;
                let distance = height / (2.0 * (fov.to_radians() / 2.0).tan());
                self.eye = self.target - self.forward() * distance;
                Lens::Perspective(fov)
            }
        };
    }

    /// Returns the JSON that `--camera` reads.
    pub(crate) fn to_json(&self) -> String {
        let (fov_deg, ortho_height) = match self.lens {
            Lens::Perspective(fov) => (Some(fov), None),
            Lens::Orthographic(height) => (None, Some(height)),
        };
        let file = File {
            eye: self.eye.to_array(),
            target: self.target.to_array(),
            up: self.up.to_array(),
            fov_deg,
            ortho_height,
        };
        serde_json::to_string(&file).unwrap_or_default()
    }

    /// Returns this camera, moved to the position in the JSON of [`Self::to_json`].
    ///
    /// # Errors
    /// The reason why the text is no camera, in one line.
    pub(crate) fn as_in_json(&self, text: &str) -> Result<Self, String> {
        let file: File = serde_json::from_str(text).map_err(|e| format!("no camera: {e}"))?;
        let [eye, target, up] = [file.eye, file.target, file.up].map(DVec3::from_array);
        let lens = match (file.fov_deg, file.ortho_height) {
            (Some(fov), None) if fov > 0.0 && fov < 180.0 => Lens::Perspective(fov),
            (None, Some(height)) if height > 0.0 && height.is_finite() => {
                Lens::Orthographic(height)
            }
            _ => return Err("no camera: fov_deg or ortho_height, above 0".into()),
        };
        let orbit = Self {
            eye,
            target,
            up,
            lens,
            ..self.clone()
        };
        match orbit.is_a_view() {
            true => Ok(orbit),
            false => Err("no camera: finite numbers, and an eye away from the target".into()),
        }
    }

    /// Returns true if pictures can be drawn with this camera.
    pub(crate) fn is_a_view(&self) -> bool {
        let is_sized = match self.lens {
            Lens::Perspective(fov) => fov > 0.0 && fov < 180.0,
            Lens::Orthographic(height) => height > 0.0 && height.is_finite(),
        };
        is_sized && self.eye != self.target && self.camera([2, 2]).validate().is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn orbit() -> Orbit {
        let camera = Camera::perspective(
            DVec3::new(3.0, -4.0, 2.0),
            DVec3::new(0.5, 0.25, 0.0),
            DVec3::Z,
            35.0,
            [640, 480],
        );
        let distance = (DVec3::new(0.5, 0.25, 0.0) - camera.eye).length();
        Orbit::of(&camera, DVec3::Z, distance)
    }

    fn is_near(a: &Camera, b: &Camera) -> bool {
        let turned = a.camera_from_world - b.camera_from_world;
        (a.eye - b.eye).length() < 1e-12
            && turned.to_cols_array().iter().all(|x| x.abs() < 1e-12)
            && (a.focal_px - b.focal_px).length() < 1e-9
    }

    #[test]
    fn a_whole_turn_leads_back() {
        let size = [640, 480];
        let before = orbit();
        let mut after = before.clone();
        for _ in 0..360 {
            after.turn(1_f64.to_radians(), 0.0);
        }
        assert!(is_near(&before.camera(size), &after.camera(size)));
        after.turn(0.3, 0.2);
        assert!(!is_near(&before.camera(size), &after.camera(size)));
        assert!((after.distance() - before.distance()).abs() < 1e-12);
    }

    #[test]
    fn what_is_at_the_target_follows_the_pointer() {
        let size = [640, 480];
        let mut moved = orbit();
        let target = moved.target;
        moved.pan(DVec2::new(40.0, -25.0), 480.0);
        let pixel = moved.camera(size).project(target).unwrap();
        assert!((pixel - DVec2::new(360.0, 215.0)).length() < 1e-9);
    }

    #[test]
    fn lenses_change_and_the_target_keeps_its_size() {
        let size = [640, 480];
        let mut orbit = orbit();
        let beside = orbit.target + orbit.right() * 0.1;
        let before = orbit.camera(size).project(beside).unwrap();
        orbit.change_lens();
        assert!((orbit.camera(size).project(beside).unwrap() - before).length() < 1e-9);
        orbit.change_lens();
        assert!((orbit.camera(size).project(beside).unwrap() - before).length() < 1e-9);
    }

    #[test]
    fn json_is_that_of_the_command_line() {
        let orbit = orbit();
        let folder = std::env::temp_dir();
        let path = folder.join(format!("ewa-splat-view-{}.json", std::process::id()));
        std::fs::write(&path, orbit.to_json()).unwrap();
        let read = ewa_splat::view::read_camera(&path, Some([640, 480]));
        std::fs::remove_file(&path).unwrap();
        assert!(is_near(&read.unwrap(), &orbit.camera([640, 480])));
        assert_eq!(orbit.as_in_json(&orbit.to_json()).unwrap().eye, orbit.eye);
        for text in [
            "",
            "{}",
            r#"{"eye":[0,0,0],"target":[0,0,0],"up":[0,0,1],"fov_deg":3}"#,
        ] {
            assert!(orbit.as_in_json(text).is_err(), "{text}");
        }
    }
}
