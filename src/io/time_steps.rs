//! Steps of time: what one file or several hold of one thing at one time.

use std::path::{Path, PathBuf};

use super::file::{HEAD, Input};
use super::formats::Format;
use super::vtk_xml::clip;
use super::{Dataset, OpenOptions, of_folder, pvd, read_input, vtk_collection};
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
    /// What [`OpenOptions::time_step`] is to be.
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

impl Format {
    /// The steps of time that a file of this format stands for, in their order, at least one: those of a collection, those
    /// in the file, or the file itself. Files that it names are not looked for.
    ///
    /// # Errors
    /// A file that cannot be read, or breaks its format's rules.
    pub fn time_steps(&self, path: &Path) -> Result<Vec<TimeStep>> {
        match self.steps {
            Some(steps) => {
                let file = of_folder(path);
                let mut steps = steps(Input::of_file(&file))?;
                let parts = steps.iter_mut().flat_map(|step| &mut step.parts);
                // What was given stands for that file.
                for part in parts.filter(|part| part.path == file) {
                    part.path = path.to_path_buf();
                }
                Ok(steps)
            }
            None => Ok(of_file(path, &[])),
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

/// Reads the first part of the first step of a collection, with notes of what else there is.
///
/// # Errors
/// Those of the part; a part that is a collection.
pub(super) fn read_first(
    input: Input<'_>,
    steps: &[TimeStep],
    options: &OpenOptions,
) -> Result<Dataset> {
    let (first, count) = (&steps[0], steps.len());
    let mut notes = Vec::new();
    if let (true, Some(time)) = (count > 1, first.time) {
        notes.push(format!("The first of {count} time steps, of time {time}."));
    }
    if first.parts.len() > 1 {
        let parts = first.parts.len();
        let of = first.time.map_or("", |_| " of the time step");
        notes.push(format!("The first of {parts} parts{of}."));
    }
    let file = &first.parts[0].path;
    let mut data = input.with_beside(file, |part| {
        // What a collection names could name the collection.
        let head = part.head(HEAD)?.0;
        if pvd::looks_like(&head) || vtk_collection::looks_like(&head) {
            return Err(refuse_nested(input.path, "DataSet, `file`", file));
        }
        read_input(part, options)
    })?;
    data.notes.extend(notes);
    Ok(data)
}

/// That a collection names another where it must not.
pub(super) fn refuse_nested(path: &Path, place: &str, file: &Path) -> Error {
    Error::format(
        path,
        place,
        "a file of data",
        format!(
            "another collection, `{}`",
            clip(&file.display().to_string())
        ),
        "give that one instead",
    )
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
