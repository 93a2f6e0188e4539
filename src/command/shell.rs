//! Runs `ewa-splat completions`, `ewa-splat man` and `ewa-splat --version`.

use std::sync::LazyLock;

use crate::render::SimdLevel;
use crate::{Error, Result};
use clap::error::ErrorKind;
use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;

const NAME: &str = env!("CARGO_PKG_NAME");

#[derive(Args)]
pub(crate) struct CompletionsArguments {
    /// Shell that completes
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Args)]
pub(crate) struct ManArguments {
    /// Subcommand whose page is wanted [default: the program's, which names them]
    #[arg(value_name = "COMMAND")]
    of: Option<String>,
}

/// Prints the script that completes the program's options in a shell.
pub(crate) fn completions(arguments: &CompletionsArguments, mut program: Command) {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, NAME, &mut script);
    super::say!("{}", String::from_utf8_lossy(&script).trim_end());
}

/// Prints a page for `man`.
///
/// # Errors
/// The errors of writing. An unknown subcommand ends the program, as wrong usage does.
pub(crate) fn man(arguments: &ManArguments, program: Command) -> Result<()> {
    // Building the command gives subcommands their full names.
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let of = match &arguments.of {
        None => program,
        Some(name) => match program.find_subcommand(name) {
            Some(command) => command.clone(),
            None => {
                let message = format!("there is no subcommand `{name}`\n");
                program.error(ErrorKind::InvalidSubcommand, message).exit()
            }
        },
    };
    let mut page = Vec::new();
    let rendered = Man::new(of).render(&mut page);
    rendered.map_err(|e| Error::io("standard output", "man page", e, "try again"))?;
    super::say!("{}", String::from_utf8_lossy(&page).trim_end());
    Ok(())
}

/// Returns the version, the build's features and the machine's properties, for reports of faults.
pub(crate) fn version() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let gpu = if cfg!(feature = "gpu") {
            "with the GPU path"
        } else {
            "without the GPU path"
        };
        let simd = match SimdLevel::best() {
            SimdLevel::Baseline => "the target's baseline",
            SimdLevel::Avx2 => "AVX2",
            SimdLevel::Avx512 => "AVX-512",
        };
        let version = env!("CARGO_PKG_VERSION");
        format!("{version}\nfeatures: {gpu}\nSIMD: {simd}")
    });
    &TEXT
}
