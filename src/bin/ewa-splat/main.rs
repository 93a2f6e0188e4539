//! The command line: `render`, `info`, `convert`, `compare`, `measure`.

/// Prints a line; a reader that has gone away (`| head`) ends the program quietly.
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
mod column;
mod compare;
mod convert;
mod count;
mod cut;
mod info;
mod input;
mod legend;
mod lit;
mod measure;
mod outputs;
mod parse;
mod progress;
mod render;
mod scene;
mod sequence;
mod truth;
mod viewpoint;
mod words;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Renders volumes, particles, splats and meshes by EWA splatting, and converts them to splats.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render data to an image
    Render(Box<render::Arguments>),
    /// Say what a file holds and what rendering it requires
    Info(Box<info::Arguments>),
    /// Turn data into a file of splats for viewers of radiance fields
    Convert(Box<convert::Arguments>),
    /// Print how far one image is from another
    Compare(compare::Arguments),
    /// Measure speed against accuracy: table, plots and what each approximation costs
    Measure(Box<measure::Arguments>),
}

fn main() -> ExitCode {
    let arguments = truth::join_reference(std::env::args_os());
    let result = match Arguments::parse_from(arguments).command {
        Command::Render(arguments) => render::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Measure(arguments) => measure::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", words::line(&error));
            ExitCode::FAILURE
        }
    }
}
