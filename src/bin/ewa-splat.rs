//! The program: see `ewa_splat::command`.

use std::process::ExitCode;

fn main() -> ExitCode {
    ewa_splat::command::main()
}
