//! Describes what is reported while inputs are read.

use std::fmt;
use std::path::{Path, PathBuf};

use glam::DVec3;

/// Event of reading inputs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A file is about to be read.
    Reading(&'a Path),
    /// Something that a user should know.
    Note(Note),
}

/// Function that receives the events of reading.
pub type Observer<'a> = &'a dyn Fn(Event<'_>);

/// Note on inputs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// Note of a reader, or warning of a sampler.
    Line {
        /// File of the input.
        path: PathBuf,
        /// Text.
        line: String,
    },
    /// The first of several time steps is shown.
    FirstStep {
        /// File of the input.
        path: PathBuf,
        /// Number of time steps.
        count: usize,
        /// Time of the first step.
        time: f64,
    },
    /// The time step nearest to a time is shown.
    NearestStep {
        /// File of the input.
        path: PathBuf,
        /// Number of the step, counted from 0.
        number: usize,
        /// Number of time steps.
        count: usize,
        /// Time of the step.
        time: f64,
    },
    /// The format of an input has other axes than the scene.
    OtherAxes {
        /// File of the input.
        path: PathBuf,
        /// Axis that points up in the file.
        up: DVec3,
        /// Reason for this axis.
        reason: String,
        /// Axis that points up in the scene.
        scene_up: DVec3,
        /// True if the input is rotated to the scene's axes.
        is_turned: bool,
    },
    /// An input lacks the field that was named, and shows one of its own.
    LacksField {
        /// File of the input.
        path: PathBuf,
        /// Field that was named.
        field: String,
    },
    /// A field has one value everywhere: its picture is uniform.
    Uniform {
        /// File of the input.
        path: PathBuf,
        /// Field that is shown.
        field: String,
        /// Its value.
        value: f64,
        /// True if the file has a time, so that other time steps may differ.
        is_of_step: bool,
    },
    /// Some inputs hold nothing to draw and are left out.
    LeftOut {
        /// Number of inputs that are left out.
        count: usize,
        /// Number of all inputs.
        whole: usize,
        /// Files of the first of them.
        paths: Vec<PathBuf>,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { path, line } => write!(f, "{}: {line}", path.display()),
            Self::FirstStep { path, count, time } => {
                let path = path.display();
                write!(f, "{path}: the first of {count} time steps, of time {time}")
            }
            Self::NearestStep {
                path,
                number,
                count,
                time,
            } => {
                let path = path.display();
                write!(f, "{path}: step {number} of {count}, of time {time}")
            }
            Self::OtherAxes {
                path,
                up,
                reason,
                scene_up,
                is_turned,
            } => {
                let (path, up, scene_up) = (path.display(), axis(*up), axis(*scene_up));
                let done = match is_turned {
                    true => "turned to it",
                    false => "left as it is beside a grid",
                };
                write!(
                    f,
                    "{path}: {up} is up ({reason}), {scene_up} in the picture: {done}"
                )
            }
            Self::LacksField { path, field } => {
                write!(
                    f,
                    "{}: no field `{field}`: shown by its own",
                    path.display()
                )
            }
            Self::Uniform {
                path,
                field,
                value,
                is_of_step,
            } => {
                let others = match is_of_step {
                    true => "; other time steps may differ",
                    false => "",
                };
                let path = path.display();
                write!(f, "{path}: `{field}` is {value} everywhere{others}")
            }
            Self::LeftOut {
                count,
                whole,
                paths,
            } => {
                let names = paths.iter().map(|path| path.display().to_string());
                let names = names.collect::<Vec<_>>().join(", ");
                let more = if *count > paths.len() { ", ..." } else { "" };
                write!(
                    f,
                    "{count} of {whole} inputs hold nothing to draw and are left out: {names}{more}"
                )
            }
        }
    }
}

/// Formats an axis: `+y`.
pub(crate) fn axis(direction: DVec3) -> String {
    let of = ["x", "y", "z"].into_iter().zip(direction.to_array());
    let known = of.clone().find(|(_, c)| c.abs() == direction.length());
    known.map_or_else(
        || format!("{:.3} {:.3} {:.3}", direction.x, direction.y, direction.z),
        |(name, c)| format!("{}{name}", if c < 0.0 { "-" } else { "+" }),
    )
}
