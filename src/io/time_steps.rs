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

/// One of the steps of time of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepChoice {
    /// By its number, counted from 0.
    Number(usize),
    /// The last.
    Last,
    /// The one whose time is nearest to this, between the first and the last time.
    Time(f64),
}

impl StepChoice {
    /// The number of the step that is chosen of a file's ([`Format::time_steps`](super::Format::time_steps)).
    ///
    /// - `path`: the file, for messages.
    ///
    /// # Errors
    /// A number that is not there; a time beyond the first or the last, or of a file that states none.
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

/// That a file has no step of this number.
fn absent(path: &Path, count: usize, number: usize) -> Error {
    let expected = match count {
        1 => "0, the one step there is".to_owned(),
        _ => format!("one of {count} steps, 0 to {}", count - 1),
    };
    let advice = "choose one of these";
    Error::format(path, "time step", expected, number.to_string(), advice)
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
        return Err(absent(path, times.len().max(1), step));
    }
    let is_said = time_step.is_some() || times.len() < 2;
    let note = (!is_said).then(|| {
        let (count, time) = (times.len(), times[0]);
        format!("The first of {count} time steps, of time {time}.")
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
