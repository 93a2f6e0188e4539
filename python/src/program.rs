//! The command line, as the wheel carries it.

use std::ffi::OsString;
use std::process::ExitCode;

use pyo3::prelude::*;

use crate::forked::detached;

/// Runs the program `ewa-splat` and ends the process.
///
/// - `words`: the command line, the program's name first.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, words: Vec<OsString>) {
    // Signals do what they do in any program: the caller has set their handlers back.
    let code = detached(py, || ewa_splat::command::main_of(words));
    let failed = code != ExitCode::SUCCESS;
    std::process::exit(i32::from(failed));
}
