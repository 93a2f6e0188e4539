//! Replaces collections and files of several time steps by the steps to show.

use std::path::PathBuf;

use super::input::Input;
use super::note::{Event, Note, Observer};
use crate::error::{Hint, Parameter};
use crate::io::{OpenOptions, Part, StepChoice, TimeStep, format_of};
use crate::{Error, Result};

/// Time steps that are shown of files with several.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Steps {
    /// The first step; a note reports this choice.
    First,
    /// One step; inputs without time steps are shown beside it.
    One(StepChoice),
    /// All steps, in their order.
    Series,
}

/// Replaces collections and files of several steps by their contents: one time step, or all steps
/// of a series.
///
/// - `options`: options that the inputs are opened with.
///
/// # Errors
/// Collections that cannot be read; an absent step or time; a chosen step or time if no input has
/// several steps. Other unreadable files stay in the list: reading them reports the error.
pub fn steps(
    inputs: Vec<Input>,
    shown: Steps,
    options: &OpenOptions,
    observer: Observer<'_>,
) -> Result<Vec<Input>> {
    let mut files: Vec<Input> = Vec::new();
    let mut step = 0;
    let mut has_steps = false;
    let names: Vec<PathBuf> = inputs.iter().map(|input| input.path.clone()).collect();
    // Files that other files replace, or that replace others.
    let mut stood_in: Vec<PathBuf> = Vec::new();
    for input in inputs {
        let Ok(format) = format_of(&input.path, options) else {
            files.push(Input { step, ..input });
            step += 1;
            continue;
        };
        let mut steps = format.time_steps(&input.path)?;
        let count = steps.len();
        // The inputs may name all pieces of one snapshot.
        if let [TimeStep { time: None, parts }] = steps.as_slice()
            && let [part] = parts.as_slice()
        {
            let is_other = part.path != input.path;
            let is_same = |other: &Input| {
                let named = Input {
                    path: part.path.clone(),
                    step: other.step,
                    ..input.clone()
                };
                *other == named
            };
            if (is_other || stood_in.contains(&part.path)) && files.iter().any(is_same) {
                continue;
            }
            if is_other {
                stood_in.push(part.path.clone());
            }
        }
        let is_of_time = count > 1 || steps[0].time.is_some();
        has_steps |= is_of_time;
        let path = &input.path;
        let chosen = match shown {
            Steps::Series => 0..count,
            // Inputs without time steps are shown beside the chosen step.
            Steps::One(choice) if is_of_time => {
                let number = choice.of(path, &steps)?;
                if let (StepChoice::Time(_), Some(time)) = (choice, steps[number].time) {
                    let path = path.clone();
                    observer(Event::Note(Note::NearestStep {
                        path,
                        number,
                        count,
                        time,
                    }));
                }
                number..number + 1
            }
            Steps::First | Steps::One(_) => {
                if let (true, Some(time)) = (count > 1, steps[0].time) {
                    let path = path.clone();
                    observer(Event::Note(Note::FirstStep { path, count, time }));
                }
                0..1
            }
        };
        for found in steps.drain(chosen) {
            let of_step = |part: Part| Input {
                path: part.path,
                time_step: part.time_step,
                step,
                time: found.time,
                ..input.clone()
            };
            files.extend(found.parts.into_iter().map(of_step));
            step += 1;
        }
    }
    if let (Steps::One(choice), false, Some(first)) = (shown, has_steps, names.first()) {
        let parameter = match choice {
            StepChoice::Time(_) => Parameter::Time,
            StepChoice::Number(_) | StepChoice::Last => Parameter::Step,
        };
        return Err(Error::format(
            first,
            parameter,
            "a file with steps of time",
            "one without",
            Hint::LeaveOut(parameter),
        ));
    }
    Ok(files)
}
