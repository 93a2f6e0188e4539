//! Words of a command, with its files under other names: without their folders in records, where they are found when
//! a record is read.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, ValueParser};
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};

use super::parse;
use super::provenance::name_of;
use crate::Result;
use crate::load::Input;

/// Options of the whole program, which change no picture.
const OF_PROGRAM: [&str; 2] = ["quiet", "errors"];

/// Options that name files to write.
const OUTPUTS: [&str; 6] = [
    "deep",
    "out",
    "stats",
    "depth",
    "normals",
    "write_transfer_function",
];

/// Option that names a file or a colour map.
const FILE_OR_NAME: &str = "transfer_function";

/// Words of a command that was typed.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Typed {
    /// The words, with files' names without their folders.
    pub(crate) words: Vec<String>,
    /// The files that the command reads, where they lie.
    pub(crate) files: Vec<PathBuf>,
}

impl Typed {
    /// Returns the words of a subcommand, and its files.
    ///
    /// - `command`: the subcommand that the matches are of.
    pub(crate) fn of(command: &Command, matches: &ArgMatches) -> Self {
        let mut files = Vec::new();
        let mut named = |path: &Path, role| {
            if role != Role::Output && path.exists() {
                files.push(path.to_owned());
            }
            Ok(name_of(path).into())
        };
        // Nothing fails.
        let words = renamed(command, matches, &mut named).unwrap_or_default();
        let text = |word: OsString| word.to_string_lossy().into_owned();
        Self {
            words: words.into_iter().map(text).collect(),
            files,
        }
    }
}

/// Role of a file in a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// A file to read.
    Input,
    /// A file to read, or the name of a colour map.
    InputOrName,
    /// A file to write.
    Output,
}

/// Names a file: returns another name for it.
pub(crate) type Rename<'a> = &'a mut dyn FnMut(&Path, Role) -> Result<PathBuf>;

/// Returns the words of a subcommand in the order in which they were typed, with other names for its files.
///
/// Abbreviated and aliased options get their names.
///
/// - `command`: the subcommand that the matches are of.
///
/// # Errors
/// The errors of `rename`.
pub(crate) fn renamed(
    command: &Command,
    matches: &ArgMatches,
    rename: Rename<'_>,
) -> Result<Vec<OsString>> {
    // Occurrences, each with the index of its first value.
    let mut occurrences: Vec<(usize, &Arg, Vec<&OsStr>)> = Vec::new();
    for arg in command.get_arguments() {
        let id = arg.get_id().as_str();
        let is_known = matches.try_contains_id(id).unwrap_or(false);
        if OF_PROGRAM.contains(&id)
            || !is_known
            || matches.value_source(id) != Some(ValueSource::CommandLine)
        {
            continue;
        }
        let mut indices = matches.indices_of(id).into_iter().flatten();
        for occurrence in matches.get_raw_occurrences(id).into_iter().flatten() {
            let values: Vec<&OsStr> = occurrence.collect();
            let mut own = indices.by_ref().take(values.len().max(1));
            if let Some(index) = own.next() {
                own.for_each(drop);
                occurrences.push((index, arg, values));
            }
        }
    }
    occurrences.sort_by_key(|(index, ..)| *index);
    let mut words = vec![OsString::from(command.get_name())];
    for (_, arg, values) in occurrences {
        let own = values.into_iter().map(|value| other(arg, value, rename));
        add(&mut words, arg, own.collect::<Result<_>>()?);
    }
    Ok(words)
}

/// Adds the words of one occurrence of an argument.
fn add(words: &mut Vec<OsString>, arg: &Arg, values: Vec<OsString>) {
    let is_option = |word: &OsStr| word.to_string_lossy().starts_with('-');
    let Some(name) = arg.get_long() else {
        // A file's name that begins as an option does.
        words.extend(values.into_iter().map(|value| match is_option(&value) {
            true => Path::new(".").join(value).into(),
            false => value,
        }));
        return;
    };
    let name = format!("--{name}");
    if !arg.get_action().takes_values() {
        words.push(name.into());
        return;
    }
    // Values of a list were typed as one word.
    let listed = match arg.get_value_delimiter() {
        Some(delimiter) => vec![values.join(OsStr::new(&delimiter.to_string()))],
        None => values,
    };
    if arg.is_require_equals_set() || matches!(&listed[..], [one] if is_option(one)) {
        let mut word = OsString::from(name + "=");
        listed.iter().for_each(|value| word.push(value));
        words.push(word);
    } else {
        words.push(name.into());
        words.extend(listed);
    }
}

/// Returns a value with other names for its files.
fn other(arg: &Arg, value: &OsStr, rename: Rename<'_>) -> Result<OsString> {
    let parsed = arg.get_value_parser().type_id();
    let id = arg.get_id().as_str();
    if id == FILE_OR_NAME {
        return Ok(rename(Path::new(value), Role::InputOrName)?.into());
    }
    if parsed == ValueParser::new(PathBufValueParser::new()).type_id() {
        let role = match OUTPUTS.contains(&id) {
            true => Role::Output,
            false => Role::Input,
        };
        return Ok(rename(Path::new(value), role)?.into());
    }
    if parsed != ValueParser::new(parse::input()).type_id() {
        return Ok(value.into());
    }
    let input = Input::parse(PathBuf::from(value));
    let function = input.function.as_deref();
    let path = rename(&input.path, Role::Input)?;
    let function = function.map(|function| rename(Path::new(function), Role::InputOrName));
    let function = function.transpose()?;
    if input.field.is_none() && function.is_none() {
        return Ok(path.into());
    }
    let function = function.map(|function| function.to_string_lossy().into_owned());
    let renamed = Input {
        path,
        function,
        ..input
    };
    Ok(renamed.to_string().into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::Arguments;
    use clap::CommandFactory;

    fn typed(line: &[&str]) -> Typed {
        let mut program = Arguments::command();
        program.build();
        let words = std::iter::once("ewa-splat").chain(line.iter().copied());
        let matches = program.try_get_matches_from_mut(words).unwrap();
        let command = program.find_subcommand("render").unwrap();
        Typed::of(command, matches.subcommand_matches("render").unwrap())
    }

    #[test]
    fn words_keep_their_order_and_lose_their_folders() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("a b.vtu");
        std::fs::write(&data, "x").unwrap();
        let data = data.to_str().unwrap();
        let other = format!("{data}@v/w@cells@/maps/f.json");
        let typed = typed(&[
            "--quiet",
            "render",
            data,
            "--flatten=-0.5",
            "--clip",
            "0,0,1,-2",
            "--translate",
            "-1,0,0",
            &other,
            "--out",
            "/home/someone/p.png",
            "--type",
            "gas,stars",
            "--translate",
            "none",
            "--surface",
            "--transfer-function",
            "plasma",
            "--title",
            "a/b",
            "--camera-path",
            "/home/someone/c.json",
        ]);
        let expected = [
            "render",
            "a b.vtu",
            "--isosurface=-0.5",
            "--clip",
            "0,0,1,-2",
            "--translate=-1,0,0",
            "a b.vtu@v/w@cells@f.json",
            "--out",
            "p.png",
            "--type",
            "gas,stars",
            "--translate",
            "none",
            "--surface",
            "--transfer-function",
            "plasma",
            "--title",
            "a/b",
            "--camera-path",
            "c.json",
        ];
        assert_eq!(typed.words, expected);
        assert_eq!(typed.files, [Path::new(data), Path::new(data)]);
        // The value was not typed; without it, the next word could be taken for one.
        let typed = self::typed(&["render", "--reference", "--out", "a.png", "b.vtu"]);
        let expected = ["render", "--reference=kernels", "--out", "a.png", "b.vtu"];
        assert_eq!(typed.words, expected);
    }

    /// A new option that names a file is either an output here or an input.
    #[test]
    fn all_outputs_are_known() {
        let mut program = Arguments::command();
        program.build();
        let command = program.find_subcommand("render").unwrap();
        let path = ValueParser::new(PathBufValueParser::new()).type_id();
        let paths = command
            .get_arguments()
            .filter(|arg| arg.get_value_parser().type_id() == path)
            .map(|arg| arg.get_id().as_str());
        let mut inputs: Vec<&str> = paths.filter(|id| !OUTPUTS.contains(id)).collect();
        inputs.sort_unstable();
        let expected = [
            "background_image",
            "camera",
            "camera_path",
            "depth_in",
            "solution",
            "texture",
        ];
        assert_eq!(inputs, expected);
        for output in OUTPUTS {
            assert!(command.get_arguments().any(|arg| arg.get_id() == output));
        }
    }
}
