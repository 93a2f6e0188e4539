//! Parses inputs: a file with the field and the transfer function that it shows.

use crate::data::association::Association;
use std::path::PathBuf;

use crate::data::particle_type::ParticleType;
use crate::io::{OpenOptions, Part, StepChoice, TimeStep, format_of};
use crate::{Error, Result};
use clap::builder::{PathBufValueParser, TypedValueParser};

use super::edits::Edit;
use super::progress::note;

/// File, and what it shows if that differs from the options for all inputs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Input {
    pub(crate) path: PathBuf,
    pub(crate) field: Option<String>,
    pub(crate) function: Option<String>,
    /// Type of the particles to show, for a snapshot that holds several types.
    pub(crate) particle_type: Option<ParticleType>,
    /// Number of the series' step that the file belongs to.
    pub(crate) step: usize,
    /// Number of the time step within a file that holds several.
    pub(crate) time_step: Option<usize>,
    /// Time that the file or its collection states.
    pub(crate) time: Option<f64>,
    /// Placement and crop box.
    pub(crate) edit: Edit,
}

impl Input {
    /// Parses `FILE`, `FILE@FIELD` or `FILE@FIELD@FUNCTION`. `FIELD@nodes` and `FIELD@cells` name a
    /// field of nodes or of cells. If a file with the whole name exists, the name means that file.
    pub(crate) fn parse(path: PathBuf) -> Self {
        let text = path
            .to_str()
            .filter(|text| text.contains('@') && !path.exists());
        let parts: Vec<&str> = text.map_or_else(Vec::new, |text| text.split('@').collect());
        let stated = |part: &str| (!part.is_empty()).then(|| part.to_owned());
        let of = |word: &str| Association::of_name(word).is_some();
        match parts.as_slice() {
            [file, field, word, function @ ..] if of(word) && function.len() < 2 => Self {
                field: Some(format!("{field}@{word}")),
                function: function.first().copied().and_then(stated),
                ..Self::file(file.into())
            },
            [file, field] => Self {
                field: stated(field),
                ..Self::file(file.into())
            },
            [file, field, function] => Self {
                field: stated(field),
                function: stated(function),
                ..Self::file(file.into())
            },
            _ => Self::file(path),
        }
    }

    /// Returns an input that shows a file by the common options. A folder with a SOG scene stands
    /// for its index file.
    pub(crate) fn file(path: PathBuf) -> Self {
        Self {
            path,
            field: None,
            function: None,
            particle_type: None,
            step: 0,
            time_step: None,
            time: None,
            edit: Edit::default(),
        }
    }

    /// Returns this input with the particles of one type.
    pub(crate) fn of_type(&self, particles: ParticleType) -> Self {
        Self {
            particle_type: Some(particles),
            ..self.clone()
        }
    }

    /// Returns the parser for clap.
    pub(crate) fn parser() -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().map(Self::parse)
    }
}

/// Time steps that are shown of files with several.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Shown {
    /// The first step; a note reports this choice.
    First,
    One(StepChoice),
    /// All steps, in their order.
    Series,
}

/// Replaces collections and files of several steps by their contents: one time step, or all steps
/// of a series.
///
/// # Errors
/// Collections that cannot be read; an absent step or time; a chosen step or time if no input has
/// several steps. Other unreadable files stay in the list: reading them reports the error.
pub(crate) fn steps(inputs: Vec<Input>, shown: Shown, options: &OpenOptions) -> Result<Vec<Input>> {
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
            Shown::Series => 0..count,
            // Inputs without time steps are shown beside the chosen step.
            Shown::One(choice) if is_of_time => {
                let number = choice.of(path, &steps)?;
                if let (StepChoice::Time(_), Some(time)) = (choice, steps[number].time) {
                    note!(
                        "{}: step {number} of {count}, of time {time}",
                        path.display()
                    );
                }
                number..number + 1
            }
            Shown::First | Shown::One(_) => {
                if let (true, Some(time)) = (count > 1, steps[0].time) {
                    let path = path.display();
                    note!(
                        "{path}: the first of {count} time steps, of time {time}; --step N, --step last and --time T \
                         choose another, --series draws all"
                    );
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
    if let (Shown::One(choice), false, Some(first)) = (shown, has_steps, names.first()) {
        let option = match choice {
            StepChoice::Time(_) => "--time",
            StepChoice::Number(_) | StepChoice::Last => "--step",
        };
        return Err(Error::format(
            first,
            option,
            "a file with steps of time",
            "one without",
            format!("leave {option} out"),
        ));
    }
    Ok(files)
}

/// Returns the paths of the inputs.
pub(crate) fn paths(inputs: &[Input]) -> impl Iterator<Item = &PathBuf> {
    inputs.iter().map(|input| &input.path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_name_a_file_a_field_and_a_function() {
        let parse = |text: &str| Input::parse(text.into());
        let of = |path: &str, field: Option<&str>, function: Option<&str>| Input {
            field: field.map(str::to_owned),
            function: function.map(str::to_owned),
            ..Input::file(path.into())
        };
        assert_eq!(parse("a.vtu"), of("a.vtu", None, None));
        assert_eq!(parse("a.vtu@p"), of("a.vtu", Some("p"), None));
        assert_eq!(
            parse("a.vtu@v:x@f.json"),
            of("a.vtu", Some("v:x"), Some("f.json"))
        );
        assert_eq!(parse("a.vtu@@plasma"), of("a.vtu", None, Some("plasma")));
        assert_eq!(parse("a.vtu@p@cells"), of("a.vtu", Some("p@cells"), None));
        assert_eq!(
            parse("a.vtu@p@nodes@plasma"),
            of("a.vtu", Some("p@nodes"), Some("plasma"))
        );
        assert_eq!(parse("a@b@c@d"), of("a@b@c@d", None, None));
    }
}
