//! Stores key frames: cameras on a path, shown as an animation and written as a film.

use ewa_splat::view::{Camera, CameraPath, KeyCamera};

use crate::orbit::{Lens, Orbit};

/// Pictures per second, as in `ewa-splat render`.
pub(crate) const RATE: u16 = 25;

/// Key frames, with their files and animation.
#[derive(Debug, Clone)]
pub(crate) struct KeyFrames {
    pub(crate) keys: Vec<KeyCamera>,
    /// Number of pictures of the whole path.
    pub(crate) frames: usize,
    /// Name of the key frames' file.
    pub(crate) file: String,
    /// Name of the film's file.
    pub(crate) film: String,
    pub(crate) playing: Option<Playing>,
}

/// Animation of a path.
#[derive(Debug, Clone)]
pub(crate) struct Playing {
    cameras: Vec<Camera>,
    /// Start time in seconds.
    since: f64,
}

impl Default for KeyFrames {
    fn default() -> Self {
        Self {
            keys: Vec::new(),
            frames: 100,
            file: "path.json".into(),
            film: "film.apng".into(),
            playing: None,
        }
    }
}

impl KeyFrames {
    /// Returns the path for `--camera-path`; `None` with fewer than two keys.
    pub(crate) fn path(&self) -> Option<CameraPath> {
        (self.keys.len() > 1).then(|| CameraPath {
            frames: self.frames,
            keys: self.keys.clone(),
        })
    }

    /// Starts the animation.
    pub(crate) fn play(&mut self, now: f64) {
        // The window determines the size of the picture, so any size will do here.
        let cameras = self.path().map(|path| path.cameras([2, 2]));
        let since = now;
        self.playing = cameras.map(|cameras| Playing { cameras, since });
    }

    /// Returns the camera of this moment; after the end, the last one.
    pub(crate) fn camera(&mut self, now: f64) -> Option<Camera> {
        let playing = self.playing.as_ref()?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not negative, and beyond the last is the last"
        )]
        let frame = ((now - playing.since) * f64::from(RATE)).max(0.0) as usize;
        let last = playing.cameras.len() - 1;
        let camera = playing.cameras[frame.min(last)].clone();
        if frame >= last {
            self.playing = None;
        }
        Some(camera)
    }
}

/// Returns the key of a view, or `None` for an orthographic view, since paths are perspective.
pub(crate) fn key_of(orbit: &Orbit) -> Option<KeyCamera> {
    let Lens::Perspective(fov_deg) = orbit.lens else {
        return None;
    };
    Some(KeyCamera {
        eye: orbit.eye.to_array(),
        target: orbit.target.to_array(),
        up: orbit.up.to_array(),
        fov_deg,
    })
}

/// Returns the view of a key.
pub(crate) fn orbit_of(key: &KeyCamera, world_up: glam::DVec3) -> Orbit {
    Orbit {
        eye: key.eye.into(),
        target: key.target.into(),
        up: key.up.into(),
        world_up,
        lens: Lens::Perspective(key.fov_deg),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_shown_from_the_first_key_to_the_last() {
        let key = |x: f64| KeyCamera {
            eye: [x, -4.0, 1.0],
            target: [0.0; 3],
            up: [0.0, 0.0, 1.0],
            fov_deg: 35.0,
        };
        let mut frames = KeyFrames {
            keys: vec![key(-2.0)],
            frames: 26,
            ..KeyFrames::default()
        };
        assert!(frames.path().is_none());
        frames.keys.push(key(2.0));
        frames.play(10.0);
        assert!((frames.camera(10.0).unwrap().eye.x + 2.0).abs() < 1e-12);
        let middle = frames.camera(10.5).unwrap().eye.x;
        assert!(middle.abs() < 0.2, "{middle}");
        assert!(frames.playing.is_some());
        assert!((frames.camera(11.01).unwrap().eye.x - 2.0).abs() < 1e-12);
        assert!(frames.playing.is_none());
    }
}
