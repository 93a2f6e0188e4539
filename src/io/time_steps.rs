//! Steps of time: what one file or several hold of one thing at one time.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// A step of time.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeStep {
    /// Its time, in the unit of whoever wrote it; `None` where the file states none.
    pub time: Option<f64>,
    /// What is drawn together of it, at least one.
    pub parts: Vec<Part>,
}

/// A file, or one step of a file that holds several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// A path that can be opened from where the file that names it can.
    pub path: PathBuf,
    /// What [`OpenOptions::time_step`](super::OpenOptions::time_step) is to be.
    pub time_step: Option<usize>,
}

impl Part {
    /// The whole of a file.
    pub(super) fn file(path: PathBuf) -> Self {
        Self {
            path,
            time_step: None,
        }
    }
}

/// The steps of a file that holds them itself, one for each of `times`; the file as one step where it states none.
pub(super) fn of_file(path: &Path, times: &[f64]) -> Vec<TimeStep> {
    if times.is_empty() {
        return vec![TimeStep {
            time: None,
            parts: vec![Part::file(path.to_path_buf())],
        }];
    }
    let step = |(i, &time): (usize, &f64)| TimeStep {
        time: Some(time),
        parts: vec![Part {
            path: path.to_path_buf(),
            time_step: Some(i),
        }],
    };
    times.iter().enumerate().map(step).collect()
}

/// Which of `times` is meant, and a note where nobody said.
///
/// # Errors
/// A step that is not there.
pub(super) fn chosen(
    path: &Path,
    times: &[f64],
    time_step: Option<usize>,
) -> Result<(usize, Option<String>)> {
    let step = time_step.unwrap_or(0);
    if step > 0 && step >= times.len() {
        return Err(Error::format(
            path,
            "time step",
            format!("one of {}, counted from 0", times.len()),
            step.to_string(),
            "name one that is there",
        ));
    }
    let is_said = time_step.is_some() || times.len() < 2;
    let note = (!is_said).then(|| {
        let (count, time) = (times.len(), times[0]);
        format!("The first of {count} time steps, of time {time}.")
    });
    Ok((step, note))
}
