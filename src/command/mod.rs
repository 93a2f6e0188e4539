//! Defines the command line (`render`, `info`, `convert`, `compare`, `measure`, `completions`,
//! `man`) and the parts of it that other front ends use.

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

mod animation;
mod annotations;
mod certificate;
mod compare;
mod convert;
mod cut;
mod driver;
mod edits;
mod fewer;
mod fewest;
mod files;
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
mod ranks;
mod render;
mod scene;
mod sequence;
mod shell;
mod statistics;
mod truth;
mod usage;
mod view;
mod viewpoint;
mod words;

use std::ffi::OsString;
use std::process::ExitCode;

pub use self::animation::Animation;
pub use self::driver::quiet_drivers;
pub use self::statistics::{Prepared, stats};
pub use self::view::{Automatic, Frame, Over, RefinedView, ViewArguments, ViewRequest, line};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// Renders volumes, particles, splats and meshes by EWA splatting, and converts them to splats.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Say nothing on standard error but errors: no progress, no notes
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Render data to an image
    Render(Box<render::Arguments>),
    /// Say what files hold and what rendering them requires
    Info(Box<info::Arguments>),
    /// Turn data into a file of splats for viewers of radiance fields, or into a prepared scene
    Convert(Box<convert::Arguments>),
    /// Show data in a window
    View(view::Arguments),
    /// Print how far one image is from another
    Compare(compare::Arguments),
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
    let program = Arguments::command()
        .after_help(formats::list())
        .long_version(shell::version());
    let matches = program.get_matches_from(words);
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
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
    let result = match arguments.command {
        Command::Render(mut arguments) => render::run(&mut arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
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
                eprintln!("error: {}", words::line(&error));
            }
            ExitCode::FAILURE
        }
    };
    #[cfg(feature = "mpi")]
    ranks::end();
    code
}
