//! Defines the options of sequences of pictures: a turntable, a camera path, time steps.

use std::path::PathBuf;

use crate::Result;
use crate::data::up::Up;
use crate::io::{is_gltf, read_gltf_cameras};
use crate::view::{Bounds, Camera, read_sequence};
use clap::Args;

use super::progress::note;
use super::viewpoint::{CameraOptions, Canvas};

/// Options that apply to single pictures only.
const OF_ONE: [&str; 9] = [
    "reference",
    "column_density",
    "frames",
    "depth",
    "normals",
    "measure_error",
    "calibrate",
    "show",
    "camera",
];

#[derive(Args)]
#[command(next_help_heading = "Sequences")]
pub(crate) struct SequenceOptions {
    /// N pictures of one turn around the data, all from the same distance. --out is then NAME_%04d.png, an .mp4,
    /// an .apng or a .gif
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000),
          conflicts_with_all = OF_ONE, conflicts_with_all = ["eye", "along", "window", "camera_path", "series"])]
    turntable: Option<u32>,
    /// Pictures along key cameras in JSON: frames, and keys with eye, target, up and fov_deg; or by all cameras of a
    /// capture, as in --camera, or of nerfstudio's camera path; or an animated camera of glTF or three.js
    #[arg(long, value_name = "FILE", conflicts_with_all = OF_ONE, conflicts_with_all =
          ["eye", "target", "up", "fov", "ortho", "azimuth", "elevation", "zoom", "fit", "along", "window", "series"])]
    camera_path: Option<PathBuf>,
    /// The inputs are steps of time: a picture of each, from one camera, by one transfer function of the values of
    /// all
    #[arg(long, conflicts_with_all = OF_ONE)]
    series: bool,
    /// Pictures per second of an .mp4, .apng or .gif [default: 25]
    #[arg(long, value_name = "F", value_parser = clap::value_parser!(u16).range(1..=100))]
    rate: Option<u16>,
}

impl SequenceOptions {
    /// Returns true if a sequence was asked for.
    pub(crate) fn is_asked_for(&self) -> bool {
        self.series || self.turntable.is_some() || self.camera_path.is_some()
    }

    /// Returns true if cameras follow a path.
    pub(crate) fn has_path(&self) -> bool {
        self.camera_path.is_some()
    }

    /// Returns true if the pictures have cameras of their own.
    pub(crate) fn moves_camera(&self) -> bool {
        self.turntable.is_some() || self.camera_path.is_some()
    }

    /// Returns true if the first picture follows the last.
    pub(crate) fn is_closed(&self) -> bool {
        self.turntable.is_some()
    }

    pub(crate) fn is_series(&self) -> bool {
        self.series
    }

    /// Returns the number of pictures per second.
    pub(crate) fn rate(&self) -> u16 {
        self.rate.unwrap_or(25)
    }

    /// Returns true if a rate was given.
    pub(crate) fn has_rate(&self) -> bool {
        self.rate.is_some()
    }

    /// Returns the cameras of all pictures: one camera for a single picture.
    pub(crate) fn cameras(
        &self,
        options: &CameraOptions,
        boxes: &[Bounds],
        up: Up,
        canvas: &Canvas,
    ) -> Result<Vec<Camera>> {
        match (&self.camera_path, self.turntable) {
            (Some(path), _) => {
                let rate = f64::from(self.rate());
                let cameras = if is_gltf(path) {
                    let size = canvas.size.or(Some(canvas.default_size));
                    read_gltf_cameras(path, size, Some(rate))?
                } else {
                    read_sequence(path, canvas.size, canvas.default_size, rate)?
                };
                if cameras.iter().any(|camera| camera.mapping.is_some()) {
                    note!("the cameras' lens distorts, the pictures do not");
                }
                Ok(cameras.into_iter().map(|own| own.camera).collect())
            }
            (None, Some(count)) => (0..count)
                .map(|i| {
                    let turn = 360.0 * f64::from(i) / f64::from(count);
                    options.turned(turn, boxes, up, canvas)
                })
                .collect(),
            (None, None) => Ok(vec![options.camera(boxes, up, canvas)?]),
        }
    }
}
