//! Defines time steps: the files, or the steps of a file, that hold data at one time.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// A time step.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeStep {
    /// Time, in the unit of the program that wrote it; `None` if the file does not state it.
    pub time: Option<f64>,
    /// The parts drawn together; at least one.
    pub parts: Vec<Part>,
}

/// The choice of one of a file's time steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepChoice {
    /// By index, counted from 0.
    Number(usize),
    /// The last.
    Last,
    /// The step whose time is nearest to this, which must lie between the first and the last time.
    Time(f64),
}

impl StepChoice {
    /// The index of the chosen step among a file's ([`Format::time_steps`](super::Format::time_steps)).
    ///
    /// - `path`: the file, for messages.
    ///
    /// # Errors
    /// An index that does not exist; a time before the first or after the last, or of a file without times.
    pub fn of(self, path: &Path, steps: &[TimeStep]) -> Result<usize> {
        match self {
            Self::Number(number) if number < steps.len() => Ok(number),
            Self::Number(number) => Err(absent(path, steps.len(), number)),
            Self::Last => Ok(steps.len().saturating_sub(1)),
            Self::Time(time) => nearest(path, steps, time),
        }
    }
}

/// The step whose time is nearest to `time`; of two as near the earlier.
fn nearest(path: &Path, steps: &[TimeStep], time: f64) -> Result<usize> {
    let stated = || {
        steps
            .iter()
            .enumerate()
            .filter_map(|(i, s)| Some((i, s.time?)))
    };
    let least = stated().map(|(_, t)| t).min_by(f64::total_cmp);
    let greatest = stated().map(|(_, t)| t).max_by(f64::total_cmp);
    let (Some(least), Some(greatest)) = (least, greatest) else {
        let expected = "a file that states times";
        let advice = "choose the step by its number, or leave the time out";
        return Err(Error::format(path, "time", expected, "none", advice));
    };
    if !(least..=greatest).contains(&time) {
        let expected = match steps.len() {
            1 => format!("{least}, the time of the one step"),
            count => format!("a time from {least} to {greatest}, of {count} steps"),
        };
        let advice = "choose one of these";
        return Err(Error::format(
            path,
            "time",
            expected,
            time.to_string(),
            advice,
        ));
    }
    let distance = |(_, t): &(usize, f64)| (t - time).abs();
    let nearest = stated().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    Ok(nearest.map_or(0, |(i, _)| i))
}

/// The error for a missing step.
fn absent(path: &Path, count: usize, number: usize) -> Error {
    let expected = match count {
        1 => "0, the one step there is".to_owned(),
        _ => format!("one of {count} steps, 0 to {}", count - 1),
    };
    let advice = "choose one of these";
    Error::format(path, "time step", expected, number.to_string(), advice)
}

/// A file, or one time step of a file that has several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// A path that can be opened from wherever the file that names it can.
    pub path: PathBuf,
    /// The value for [`OpenOptions::time_step`](super::OpenOptions::time_step).
    pub time_step: Option<usize>,
}

impl Part {
    /// A whole file.
    pub(super) fn file(path: PathBuf) -> Self {
        Self {
            path,
            time_step: None,
        }
    }
}

/// The steps in one file, one for each of `times`; if there are none, the file as one step.
pub(super) fn of_file(path: &Path, times: &[f64]) -> Vec<TimeStep> {
    if times.is_empty() {
        return vec![TimeStep {
            time: None,
            parts: vec![Part::file(path.to_path_buf())],
        }];
    }
    of_frames(path, &times.iter().copied().map(Some).collect::<Vec<_>>())
}

/// The steps in one file, whose times may be unknown.
pub(super) fn of_frames(path: &Path, times: &[Option<f64>]) -> Vec<TimeStep> {
    let step = |(i, &time): (usize, &Option<f64>)| TimeStep {
        time,
        parts: vec![Part {
            path: path.to_path_buf(),
            time_step: Some(i),
        }],
    };
    times.iter().enumerate().map(step).collect()
}

/// The index of the chosen time, and a note if none was chosen.
///
/// # Errors
/// A step that does not exist.
pub(super) fn chosen(
    path: &Path,
    times: &[f64],
    time_step: Option<usize>,
) -> Result<(usize, Option<String>)> {
    chosen_of(path, times.len(), times.first().copied(), time_step)
}

/// The index of the chosen step, and a note if none was chosen.
///
/// - `first`: time of the first step, if it is known.
///
/// # Errors
/// A step that does not exist.
pub(super) fn chosen_of(
    path: &Path,
    count: usize,
    first: Option<f64>,
    time_step: Option<usize>,
) -> Result<(usize, Option<String>)> {
    let step = time_step.unwrap_or(0);
    if step > 0 && step >= count {
        return Err(absent(path, count.max(1), step));
    }
    let is_said = time_step.is_some() || count < 2;
    let note = (!is_said).then(|| {
        let of_time = first.map_or_else(String::new, |time| format!(", of time {time}"));
        format!("The first of {count} time steps{of_time}.")
    });
    Ok((step, note))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(times: &[Option<f64>]) -> Vec<TimeStep> {
        let step = |time: &Option<f64>| TimeStep {
            time: *time,
            parts: vec![Part::file("a".into())],
        };
        times.iter().map(step).collect()
    }

    #[test]
    fn steps_are_chosen_by_number_and_by_time() {
        let path = Path::new("a.pvd");
        let three = steps(&[Some(0.0), Some(0.5), Some(2.0)]);
        for (choice, number) in [
            (StepChoice::Number(1), 1),
            (StepChoice::Last, 2),
            (StepChoice::Time(0.0), 0),
            (StepChoice::Time(0.25), 0),
            (StepChoice::Time(0.26), 1),
            (StepChoice::Time(1.9), 2),
        ] {
            assert_eq!(choice.of(path, &three).unwrap(), number, "{choice:?}");
        }
        for (choice, steps, says) in [
            (StepChoice::Number(3), &three, "one of 3 steps, 0 to 2"),
            (StepChoice::Time(2.1), &three, "from 0 to 2, of 3 steps"),
            (StepChoice::Time(f64::NAN), &three, "from 0 to 2"),
            (StepChoice::Time(0.0), &steps(&[None]), "states times"),
            (StepChoice::Number(1), &steps(&[None]), "the one step"),
        ] {
            let error = choice.of(path, steps).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
