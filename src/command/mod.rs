//! Defines the command line (`render`, `info`, `convert`, `export`, `formats`, `compare`, `verify`, `measure`,
//! `completions`, `man`) and the parts of it that other front ends use.

/// Prints a line. If the reader of the pipe has gone (`| head`), it ends the program quietly.
macro_rules! say {
    ($($part:tt)*) => {
        if std::io::Write::write_fmt(&mut std::io::stdout(), format_args!("{}\n", format_args!($($part)*)))
            .is_err()
        {
            std::process::exit(0);
        }
    };
}
pub(crate) use say;

/// Prints a report: JSON for programs, or words that are made of it.
fn report(report: &Value, is_json: bool, words: impl FnOnce(&Value)) {
    match is_json {
        true => say!("{report:#}"),
        false => words(report),
    }
}

mod animation;
mod annotations;
mod certificate;
mod compare;
mod convert;
mod cut;
mod driver;
mod edits;
mod export;
mod fewer;
mod fewest;
mod files;
mod film;
mod formats;
mod info;
mod info_table;
mod input;
mod legend;
mod lit;
mod measure;
mod outputs;
mod parse;
mod prepare;
mod progress;
mod provenance;
mod ranks;
mod render;
mod scene;
mod sequence;
mod shell;
mod statistics;
mod truth;
mod typed;
mod usage;
mod verify;
mod view;
mod viewpoint;
mod words;

use std::ffi::OsString;
use std::process::ExitCode;

pub use self::animation::Animation;
pub use self::driver::quiet_drivers;
pub use self::statistics::{Prepared, stats};
use self::typed::Typed;
pub use self::view::{Automatic, Frame, Over, RefinedView, ViewArguments, ViewRequest, line};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use serde_json::{Value, json};

use crate::Error;

/// Renders volumes, particles, splats and meshes by EWA splatting, and converts them to splats.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Say nothing on standard error but errors: no progress, no notes
    #[arg(long, global = true)]
    quiet: bool,
    /// Form of errors: a line, or a JSON object on one line
    #[arg(long, global = true, value_name = "FORM", default_value = "text")]
    errors: ErrorForm,
}

/// Form of errors on standard error.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ErrorForm {
    Text,
    Json,
}

impl ErrorForm {
    /// Returns the form that arguments ask for, which may be unsound otherwise.
    fn of(words: &[OsString]) -> Self {
        let next = words.iter().skip(1).map(Some).chain([None]);
        let is_asked = |(word, next): (&OsString, Option<&OsString>)| {
            word == "--errors=json"
                || (word == "--errors" && next.is_some_and(|next| next == "json"))
        };
        match words.iter().zip(next).any(is_asked) {
            true => Self::Json,
            false => Self::Text,
        }
    }

    /// Reports an error of the data or of the machine.
    fn report(self, error: &Error) {
        match self {
            Self::Text => eprintln!("error: {}", words::line(error)),
            Self::Json => eprintln!("{}", json!({ "error": words::object(error) })),
        }
    }

    /// Ends the program for arguments that it does not take, or for the help that was asked for.
    fn exit(self, error: &clap::Error) -> ! {
        if self == Self::Text || !error.use_stderr() {
            error.exit();
        }
        let text = error.render().to_string();
        let text = text.trim_start_matches("error: ").trim();
        eprintln!("{}", json!({ "error": { "kind": "usage", "text": text } }));
        std::process::exit(error.exit_code());
    }
}

#[derive(Subcommand)]
enum Command {
    /// Render data to an image
    Render(Box<render::Arguments>),
    /// Say what files hold and what rendering them requires
    Info(Box<info::Arguments>),
    /// Turn data into a file of splats for viewers of radiance fields, or into a prepared scene
    Convert(Box<convert::Arguments>),
    /// Write a page for browsers that shows data, in one file with its program
    Export(Box<export::Arguments>),
    /// Show data in a window
    View(view::Arguments),
    /// List the formats that are read
    Formats(formats::Arguments),
    /// Print how far one image is from another
    Compare(compare::Arguments),
    /// Check a picture against the record of how it was made: draw it again and compare
    Verify(verify::Arguments),
    /// Measure speed against accuracy: table, plots and what each approximation costs
    Measure(Box<measure::Arguments>),
    /// Print a script for a shell that completes the program's options
    Completions(shell::CompletionsArguments),
    /// Print a page for man: `ewa-splat man render | man -l -`
    Man(shell::ManArguments),
}

/// Runs the program `ewa-splat` with the arguments of the process.
pub fn main() -> ExitCode {
    main_of(std::env::args_os())
}

/// Runs the program `ewa-splat` with the given arguments, of which the first is the program's name.
/// Another program, such as an interpreter, can call it. It may end the process.
pub fn main_of(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    quiet_drivers();
    let words = truth::join_reference(words.into_iter());
    measure::note_command_line(&words);
    let mut program = Arguments::command()
        .after_help(formats::list())
        .long_version(shell::version());
    let form = ErrorForm::of(&words);
    let parsed = program.try_get_matches_from_mut(words).and_then(|matches| {
        let arguments = Arguments::from_arg_matches(&matches)?;
        Ok((arguments, matches))
    });
    let (mut arguments, matches) = parsed.unwrap_or_else(|error| form.exit(&error));
    if arguments.quiet {
        progress::be_quiet();
    }
    #[cfg(not(feature = "mpi"))]
    if let Command::Render(render) = &arguments.command
        && render.mpi
    {
        eprintln!(
            "error: --mpi: this program was built without it; {}",
            ranks::WITHOUT
        );
        return ExitCode::from(2);
    }
    if let Command::Render(render) = &mut arguments.command
        && let (Some(command), Some(matches)) = (
            program.find_subcommand("render"),
            matches.subcommand_matches("render"),
        )
    {
        render.record_as(Typed::of(command, matches));
    }
    let form = arguments.errors;
    let result = match arguments.command {
        Command::Render(mut arguments) => render::run(&mut arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Export(mut arguments) => export::run(&mut arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::Formats(arguments) => {
            formats::run(&arguments);
            Ok(())
        }
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Measure(mut arguments) => measure::run(&mut arguments),
        Command::Completions(arguments) => {
            shell::completions(&arguments, Arguments::command());
            Ok(())
        }
        Command::Man(arguments) => shell::man(&arguments, Arguments::command()),
    };
    let code = match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if !progress::is_silent() {
                form.report(&error);
            }
            ExitCode::FAILURE
        }
    };
    #[cfg(feature = "mpi")]
    ranks::end();
    code
}
