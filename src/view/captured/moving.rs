//! Cameras that move: tracks of keys over time, sampled once a picture.

use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::{NamedCamera, Optics, Stated, angle, at_size, fault, not_a_rotation, rotation};
use crate::error::Result;

/// Greatest number of pictures.
const MOST_FRAMES: f64 = 100_000.0;

/// Course of a track between its keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Interpolation {
    /// The value of the last key.
    Step,
    /// Straight; rotations turn about one axis.
    Linear,
    /// Hermite's cubic. Each key has three values: the tangent into it, its own, the tangent out of it.
    Cubic,
}

/// Values of `N` numbers at keys in time.
#[derive(Debug, Clone)]
pub(crate) struct Track<const N: usize> {
    /// Seconds.
    times: Vec<f64>,
    values: Vec<[f64; N]>,
    interpolation: Interpolation,
}

impl<const N: usize> Track<N> {
    /// Makes a track; `None` without keys, if numbers are not finite, times fall, or values are too few or too many.
    pub(crate) fn new(
        times: Vec<f64>,
        values: Vec<[f64; N]>,
        interpolation: Interpolation,
    ) -> Option<Self> {
        let of_key = if interpolation == Interpolation::Cubic {
            3
        } else {
            1
        };
        let is_sound = !times.is_empty()
            && Some(values.len()) == times.len().checked_mul(of_key)
            && times.iter().all(|t| t.is_finite())
            && times.windows(2).all(|pair| pair[0] <= pair[1])
            && values.as_flattened().iter().all(|x| x.is_finite());
        is_sound.then_some(Self {
            times,
            values,
            interpolation,
        })
    }

    /// Returns the times of the first and the last key.
    fn span(&self) -> [f64; 2] {
        [self.times[0], self.times[self.times.len() - 1]]
    }

    /// Returns the value at a time; before the first key its value, after the last that one's.
    ///
    /// - `between`: the value at a share of the way between two.
    fn at(&self, time: f64, between: impl Fn([f64; N], [f64; N], f64) -> [f64; N]) -> [f64; N] {
        let is_cubic = self.interpolation == Interpolation::Cubic;
        let value = |key: usize| self.values[if is_cubic { 3 * key + 1 } else { key }];
        let after = self.times.partition_point(|key| *key <= time);
        if after == 0 || after == self.times.len() {
            return value(after.saturating_sub(1));
        }
        let (a, b) = (after - 1, after);
        // Different: the key after is later than the time.
        let span = self.times[b] - self.times[a];
        let t = (time - self.times[a]) / span;
        match self.interpolation {
            Interpolation::Step => value(a),
            Interpolation::Linear => between(value(a), value(b), t),
            Interpolation::Cubic => {
                let (out, into) = (self.values[3 * a + 2], self.values[3 * b]);
                let (from, to) = (value(a), value(b));
                let (t2, t3) = (t * t, t * t * t);
                std::array::from_fn(|i| {
                    (2.0 * t3 - 3.0 * t2 + 1.0) * from[i]
                        + span * (t3 - 2.0 * t2 + t) * out[i]
                        + (3.0 * t2 - 2.0 * t3) * to[i]
                        + span * (t3 - t2) * into[i]
                })
            }
        }
    }

    /// Returns the value at a time, with straight lines between keys.
    fn straight(&self, time: f64) -> [f64; N] {
        self.at(time, |a, b, t| {
            std::array::from_fn(|i| a[i] + t * (b[i] - a[i]))
        })
    }
}

impl Track<4> {
    /// Returns the rotation at a time.
    fn rotation(&self, time: f64) -> DQuat {
        let unit = |own: [f64; 4]| {
            let own = DQuat::from_array(own);
            match own.length() > 0.0 && own.length().is_finite() {
                true => own.normalize(),
                false => DQuat::IDENTITY,
            }
        };
        unit(self.at(time, |a, b, t| unit(a).slerp(unit(b), t).to_array()))
    }
}

/// A node of a scene, which places its children.
#[derive(Debug, Clone)]
pub(crate) struct NodeOfShot {
    /// The node's coordinates in its parent's where nothing moves.
    pub(crate) rest: DAffine3,
    pub(crate) position: Option<Track<3>>,
    pub(crate) rotation: Option<Track<4>>,
}

impl NodeOfShot {
    fn at(&self, time: f64) -> DAffine3 {
        if self.position.is_none() && self.rotation.is_none() {
            return self.rest;
        }
        let (scale, rotation, position) = self.rest.to_scale_rotation_translation();
        let moved = self.position.as_ref();
        let turned = self.rotation.as_ref();
        DAffine3::from_scale_rotation_translation(
            scale,
            turned.map_or(rotation, |track| track.rotation(time)),
            moved.map_or(position, |track| DVec3::from(track.straight(time))),
        )
    }
}

/// The lens of a moving camera.
#[derive(Debug, Clone)]
pub(crate) enum LensOfShot {
    /// Vertical angle of view in radians, the angle over time in place of it, and a factor by which pictures are larger.
    Vertical(f64, Option<Track<1>>, f64),
    /// Height of the picture in world units, without perspective.
    Height(f64),
}

/// A camera that may move, with axes right, up and backward.
#[derive(Debug, Clone)]
pub(crate) struct Shot {
    pub(crate) name: String,
    /// Nodes from the root to the camera.
    pub(crate) nodes: Vec<NodeOfShot>,
    pub(crate) lens: LensOfShot,
}

impl Shot {
    /// Returns the times of the first and the last key; `None` if nothing moves.
    fn span(&self) -> Option<[f64; 2]> {
        let of_lens = match &self.lens {
            LensOfShot::Vertical(_, Some(track), _) => Some(track.span()),
            _ => None,
        };
        let of_nodes = self.nodes.iter().flat_map(|node| {
            let position = node.position.as_ref().map(Track::span);
            [position, node.rotation.as_ref().map(Track::span)]
        });
        of_nodes
            .chain([of_lens])
            .flatten()
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// Returns the cameras of all pictures.
    ///
    /// - `rate`: pictures per second; without it one camera, that of the first key.
    fn stated(&self, path: &Path, rate: Option<f64>) -> Result<Vec<Stated>> {
        let [first, last] = self.span().unwrap_or_default();
        let rate = rate.unwrap_or(0.0);
        let frames = ((last - first) * rate).round() + 1.0;
        if !(frames <= MOST_FRAMES) {
            let expected = format!("{MOST_FRAMES} pictures at most");
            let found = format!("{} seconds at {rate} a second", last - first);
            return Err(fault(
                path,
                format!("camera {}", self.name),
                &expected,
                found,
            ));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number from 1 to 100,000"
        )]
        let count = frames as usize;
        (0..count)
            .map(|i| {
                let time = if i == 0 {
                    first
                } else {
                    first + i as f64 / rate
                };
                let name = if count == 1 {
                    self.name.clone()
                } else {
                    i.to_string()
                };
                self.at(path, name, time)
            })
            .collect()
    }

    fn at(&self, path: &Path, name: String, time: f64) -> Result<Stated> {
        let world =
            { self.nodes.iter() }.fold(DAffine3::IDENTITY, |world, node| world * node.at(time));
        let axes: DMat3 = world.matrix3;
        let turned = rotation(axes, true).filter(|_| world.translation.is_finite());
        let camera_from_world = turned.ok_or_else(|| not_a_rotation(path, &name, &world))?;
        let optics = match &self.lens {
            LensOfShot::Vertical(rest, track, zoom) => {
                let own = track
                    .as_ref()
                    .map_or(*rest, |track| track.straight(time)[0]);
                let half = angle(path, &name, own)? / 2.0;
                Optics::Vertical(angle(path, &name, 2.0 * (half.tan() / zoom).atan())?, None)
            }
            LensOfShot::Height(height) => Optics::Orthographic(*height),
        };
        Ok(Stated {
            name,
            eye: world.translation,
            camera_from_world,
            optics,
            distortion: None,
        })
    }
}

/// Returns the cameras of shots: all pictures of one, or one picture of each.
///
/// - `rate`: pictures per second of the first shot that moves, or else of the first; without it each shot gives the
///   camera of its first key.
pub(super) fn stated_of(path: &Path, shots: &[Shot], rate: Option<f64>) -> Result<Vec<Stated>> {
    let moving = { shots.iter().find(|shot| shot.span().is_some()) }.or(shots.first());
    let chosen: Vec<&Shot> = match rate {
        Some(_) => moving.into_iter().collect(),
        None => shots.iter().collect(),
    };
    let stated: Result<Vec<_>> = chosen.iter().map(|shot| shot.stated(path, rate)).collect();
    Ok(stated?.into_iter().flatten().collect())
}

/// Returns the cameras of shots, as [`stated_of`] chooses them.
///
/// - `size`: width and height of the pictures.
pub(crate) fn of_shots(
    path: &Path,
    shots: &[Shot],
    size: Option<[usize; 2]>,
    rate: Option<f64>,
) -> Result<Vec<NamedCamera>> {
    at_size(path, stated_of(path, shots, rate)?, size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_pass_their_keys() {
        let track = |times: &[f64], values: &[f64], interpolation| {
            let values = values.iter().map(|x| [*x]).collect();
            Track::new(times.to_vec(), values, interpolation)
        };
        let at = |track: &Track<1>, time| track.straight(time)[0];
        let linear = track(&[1.0, 2.0, 4.0], &[5.0, 7.0, 3.0], Interpolation::Linear).unwrap();
        for (time, value) in [(0.0, 5.0), (1.5, 6.0), (2.0, 7.0), (3.0, 5.0), (9.0, 3.0)] {
            assert_eq!(at(&linear, time), value, "{time}");
        }
        let step = track(&[1.0, 2.0], &[5.0, 7.0], Interpolation::Step).unwrap();
        assert_eq!([1.0, 1.9, 2.0].map(|t| at(&step, t)), [5.0, 5.0, 7.0]);
        // The cubic t^3 over 0 to 2: tangents 0 and 12.
        let values = [0.0, 0.0, 0.0, 12.0, 8.0, 12.0];
        let cubic = track(&[0.0, 2.0], &values, Interpolation::Cubic).unwrap();
        for time in [0.0, 0.5, 1.0, 1.75] {
            assert!(
                (at(&cubic, time) - f64::powi(time, 3)).abs() < 1e-12,
                "{time}"
            );
        }
        // Two keys at one time are a jump.
        let jump = track(&[0.0, 1.0, 1.0], &[0.0, 1.0, 5.0], Interpolation::Linear).unwrap();
        assert_eq!([0.5, 1.0].map(|t| at(&jump, t)), [0.5, 5.0]);
        for (times, values) in [
            (&[][..], &[][..]),
            (&[0.0], &[]),
            (&[1.0, 0.0], &[0.0, 0.0]),
            (&[f64::NAN], &[0.0]),
            (&[0.0], &[f64::INFINITY]),
        ] {
            assert!(track(times, values, Interpolation::Linear).is_none());
        }
        // A third of a right angle about x, on the shorter way between two quaternions of opposite sign.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turns = vec![[0.0, 0.0, 0.0, 1.0], [-half, 0.0, 0.0, -half]];
        let turn = Track::new(vec![0.0, 3.0], turns, Interpolation::Linear).unwrap();
        let angle = turn
            .rotation(1.0)
            .angle_between(DQuat::from_rotation_x(30_f64.to_radians()));
        assert!(angle < 1e-7);
    }
}
