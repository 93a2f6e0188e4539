//! Reads and writes paths of a camera in JSON.
//!
//! ```json
//! { "frames": 120, "keys": [
//!     { "eye": [0, -10, 3], "target": [0, 0, 0], "fov_deg": 40 },
//!     { "eye": [8, -4, 3], "target": [0, 0, 1], "up": [0, 0, 1] } ] }
//! ```
//!
//! The default of `up` is z, that of `fov_deg` 35. The first frame is at the first key, the last frame at the
//! last key.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::camera::Camera;
use crate::error::{Error, Result};

/// Greatest number of frames.
const MOST_FRAMES: usize = 100_000;

/// A camera's path along key cameras, with a slow start and end. It is a Catmull-Rom spline through eyes,
/// targets, up directions and fields of view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Number of pictures, at least 2.
    pub frames: usize,
    /// Key cameras, evenly spaced in time; at least 2.
    pub keys: Vec<KeyCamera>,
}

/// A perspective camera on a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyCamera {
    /// The eye, world units.
    pub eye: [f64; 3],
    /// The point looked at, world units.
    pub target: [f64; 3],
    /// Direction that points up in the picture.
    #[serde(default = "z")]
    pub up: [f64; 3],
    /// The vertical field of view in degrees, 1 to 179.
    #[serde(default = "default_fov")]
    pub fov_deg: f64,
}

fn z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn default_fov() -> f64 {
    35.0
}

impl CameraPath {
    /// Reads a path.
    ///
    /// # Errors
    /// A file that cannot be read or is not such JSON; fewer than two keys or frames; numbers that are not
    /// finite or out of range; an eye at its own target.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .map_err(|e| Error::io(path, "opening the camera path", e, "check the path"))?;
        crate::opened::note(path);
        Self::parse(path, &text)
    }

    /// Reads a path from its text, as [`Self::read`].
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self> {
        let fault = |place: String, expected: &str, found: String| {
            Error::format(path, place, expected, found, "see docs/command-line.md")
        };
        let own: Self = serde_json::from_str(text).map_err(|e| {
            let place = format!("line {}, column {}", e.line(), e.column());
            fault(place, "frames and keys with eye and target", e.to_string())
        })?;
        if !(2..=MOST_FRAMES).contains(&own.frames) {
            let expected = format!("2 to {MOST_FRAMES}");
            return Err(fault("frames".into(), &expected, own.frames.to_string()));
        }
        if own.keys.len() < 2 {
            let found = own.keys.len().to_string();
            return Err(fault("keys".into(), "two cameras or more", found));
        }
        for (i, key) in own.keys.iter().enumerate() {
            let numbers = [key.eye, key.target, key.up];
            let is_camera = numbers.as_flattened().iter().all(|x| x.is_finite())
                && (1.0..=179.0).contains(&key.fov_deg)
                && key.eye != key.target
                && DVec3::from(key.up).try_normalize().is_some();
            if !is_camera {
                let expected = "finite numbers, an eye away from its target, a field of view of 1 to 179 degrees";
                return Err(fault(format!("keys[{i}]"), expected, format!("{key:?}")));
            }
        }
        Ok(own)
    }

    /// Returns the text that [`Self::read`] reads.
    ///
    /// # Errors
    /// Numbers that are not finite.
    pub fn to_json(&self) -> Result<String> {
        let text = serde_json::to_string_pretty(self).map_err(|e| {
            let (expected, advice) = ("finite numbers", "check the keys");
            Error::invalid("camera path", "keys", expected, e.to_string(), advice)
        })?;
        Ok(text + "\n")
    }

    /// Returns the cameras of all frames, for pictures of this width and height in pixels.
    pub fn cameras(&self, size: [usize; 2]) -> Vec<Camera> {
        let last = self.frames.saturating_sub(1).max(1) as f64;
        (0..self.frames)
            .map(|i| self.at(i as f64 / last, size))
            .collect()
    }

    /// Returns the camera after a share of the time.
    fn at(&self, share: f64, size: [usize; 2]) -> Camera {
        // Slow at both ends: the integral of 6 t (1 - t).
        let eased = share * share * (3.0 - 2.0 * share);
        let spans = (self.keys.len() - 1) as f64;
        let along = (eased * spans).clamp(0.0, spans);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "an index below the number of keys"
        )]
        let first = (along as usize).min(self.keys.len() - 2);
        let t = along - first as f64;
        let key = |offset: isize| {
            let last = self.keys.len() - 1;
            &self.keys[first.saturating_add_signed(offset).min(last)]
        };
        let vector = |of: fn(&KeyCamera) -> [f64; 3]| {
            spline([-1, 0, 1, 2].map(|offset| DVec3::from(of(key(offset)))), t)
        };
        let (eye, target) = (vector(|k| k.eye), vector(|k| k.target));
        let up = spline(
            [-1, 0, 1, 2].map(|i| DVec3::from(key(i).up).normalize_or_zero()),
            t,
        );
        let fov = spline([-1, 0, 1, 2].map(|i| DVec3::splat(key(i).fov_deg)), t).x;
        Camera::perspective(eye, target, up, fov.clamp(1.0, 179.0), size)
    }
}

/// Returns the uniform spline of Catmull and Rom (1974) between the second and the third of four points.
fn spline([a, b, c, d]: [DVec3; 4], t: f64) -> DVec3 {
    let (out, into) = ((c - a) / 2.0, (d - b) / 2.0);
    let (t2, t3) = (t * t, t * t * t);
    b * (2.0 * t3 - 3.0 * t2 + 1.0)
        + out * (t3 - 2.0 * t2 + t)
        + c * (3.0 * t2 - 2.0 * t3)
        + into * (t3 - t2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(eye: [f64; 3], fov_deg: f64) -> KeyCamera {
        KeyCamera {
            eye,
            target: [0.0, 5.0, 0.0],
            up: z(),
            fov_deg,
        }
    }

    #[test]
    fn a_path_passes_its_keys_and_never_jumps() {
        let keys = vec![
            key([0.0, 0.0, 0.0], 30.0),
            key([1.0, 2.0, 0.0], 60.0),
            key([4.0, 2.0, 3.0], 60.0),
        ];
        let path = CameraPath {
            frames: 201,
            keys: keys.clone(),
        };
        let cameras = path.cameras([40, 30]);
        for (frame, key) in [(0, &keys[0]), (100, &keys[1]), (200, &keys[2])] {
            assert!(cameras[frame].eye.distance(DVec3::from(key.eye)) < 1e-12);
            let of_key = Camera::perspective(
                DVec3::from(key.eye),
                DVec3::from(key.target),
                DVec3::Z,
                key.fov_deg,
                [40, 30],
            );
            let turned = cameras[frame].camera_from_world - of_key.camera_from_world;
            assert!(turned.to_cols_array().iter().all(|x| x.abs() < 1e-12));
            assert!((cameras[frame].focal_px - of_key.focal_px).length() < 1e-9);
        }
        let steps: Vec<DVec3> = cameras.windows(2).map(|w| w[1].eye - w[0].eye).collect();
        // Some 9 units of path at up to 1.5 times the mean speed, including the spline's swings.
        assert!(steps.iter().all(|s| s.length() < 0.12));
        // Slow at both ends, without jerks.
        assert!(steps[0].length() < 0.01 && steps[199].length() < 0.01);
        let changes = steps.windows(2).map(|w| (w[1] - w[0]).length());
        assert!(changes.fold(0.0, f64::max) < 0.01);
    }

    #[test]
    fn what_is_no_path_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        let read = |text: &str| {
            std::fs::write(&file, text).unwrap();
            CameraPath::read(&file)
        };
        let key = r#"{"eye": [0, 0, 1], "target": [0, 0, 0]}"#;
        let good = format!(r#"{{"frames": 5, "keys": [{key}, {key}]}}"#);
        assert_eq!(read(&good).unwrap().cameras([4, 4]).len(), 5);
        for bad in [
            good.replace("\"frames\": 5", "\"frames\": 1"),
            good.replace("0, 0, 1", "0, 0, 0"),
            good.replace("0, 0, 1", "0, 0, 1e999"),
            good.replace("target", "to"),
            format!(r#"{{"frames": 5, "keys": [{key}]}}"#),
        ] {
            assert!(read(&bad).is_err(), "{bad}");
        }
    }
}
