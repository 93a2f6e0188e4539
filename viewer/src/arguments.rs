//! Parses the arguments of the window's program.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Arg, Command, value_parser};
use ewa_splat::command::{Asked, line};

/// Name of the program.
const NAME: &str = "ewa-splat-view";

/// Arguments of the program.
#[derive(Debug)]
pub(crate) struct Arguments {
    pub(crate) asked: Asked,
    /// File for a picture of the window, written instead of opening one.
    pub(crate) screenshot: Option<PathBuf>,
    /// Number of pictures to time instead of opening a window.
    pub(crate) replay: Option<u32>,
}

fn command() -> Command {
    let command = Command::new(NAME)
        .version(env!("CARGO_PKG_VERSION"))
        .about("Shows volumes, particles, splats and meshes in a window")
        .max_term_width(100)
        .arg(
            Arg::new("screenshot")
                .long("screenshot")
                .value_name("FILE.png")
                .value_parser(value_parser!(PathBuf))
                .help("Write a picture of the whole window once nothing is left to be refined, and exit; needs no display"),
        )
        .arg(
            Arg::new("replay")
                .long("replay")
                .value_name("N")
                .value_parser(value_parser!(u32).range(2..=10_000))
                .conflicts_with("screenshot")
                .help("Turn once around the data in N pictures and edit the transfer function in N more, say how long they take, and exit; needs no display"),
        );
    Asked::options(command)
}

/// Parses the arguments. Wrong usage ends the program.
pub(crate) fn parse(words: impl Iterator<Item = OsString>) -> Result<Arguments, String> {
    let matches = command().get_matches_from(words);
    Ok(Arguments {
        asked: Asked::of(&matches).map_err(|error| line(&error))?,
        screenshot: matches.get_one("screenshot").cloned(),
        replay: matches.get_one("replay").copied(),
    })
}

/// Returns the request to show some files with default options.
pub(crate) fn of_files(paths: Vec<PathBuf>) -> Result<Asked, String> {
    let words = std::iter::once(OsString::from(NAME)).chain(paths.into_iter().map(Into::into));
    let matches = command()
        .try_get_matches_from(words)
        .map_err(|error| error.to_string())?;
    Asked::of(&matches).map_err(|error| line(&error))
}
