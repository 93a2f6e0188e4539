//! Options that make many pictures of one: a turn around the data, a camera's way, steps of time.

use std::path::PathBuf;

use crate::Result;
use crate::io::Up;
use crate::view::{Bounds, Camera, CameraPath};
use clap::Args;

use super::viewpoint::{CameraOptions, Canvas};

/// What has one picture.
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
    /// N pictures of one turn around the data, all from the same distance. --out is then NAME_%04d.png, an .apng
    /// or a .gif
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000),
          conflicts_with_all = OF_ONE, conflicts_with_all = ["eye", "camera_path", "series"])]
    turntable: Option<u32>,
    /// Pictures along key cameras in JSON: frames, and keys with eye, target, up and fov_deg
    #[arg(long, value_name = "FILE", conflicts_with_all = OF_ONE, conflicts_with_all =
          ["eye", "target", "up", "fov", "ortho", "azimuth", "elevation", "zoom", "fit", "series"])]
    camera_path: Option<PathBuf>,
    /// The inputs are steps of time: a picture of each, from one camera, by one transfer function of the values of
    /// all
    #[arg(long, conflicts_with_all = OF_ONE)]
    series: bool,
    /// Pictures per second of an .apng or .gif [default: 25]
    #[arg(long, value_name = "F", value_parser = clap::value_parser!(u16).range(1..=100))]
    rate: Option<u16>,
}

impl SequenceOptions {
    /// Whether there are many pictures.
    pub(crate) fn is_asked_for(&self) -> bool {
        self.series || self.turntable.is_some() || self.camera_path.is_some()
    }

    pub(crate) fn is_series(&self) -> bool {
        self.series
    }

    /// Pictures per second.
    pub(crate) fn rate(&self) -> u16 {
        self.rate.unwrap_or(25)
    }

    /// Whether a rate is given.
    pub(crate) fn has_rate(&self) -> bool {
        self.rate.is_some()
    }

    /// The cameras of all pictures; one where one picture is asked for.
    pub(crate) fn cameras(
        &self,
        options: &CameraOptions,
        boxes: &[Bounds],
        up: Up,
        canvas: &Canvas,
    ) -> Result<Vec<Camera>> {
        match (&self.camera_path, self.turntable) {
            (Some(path), _) => Ok(CameraPath::read(path)?.cameras(canvas.size())),
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
