//! Runs the command line that the wheel contains.

use std::ffi::OsString;
use std::process::ExitCode;

use pyo3::prelude::*;

use crate::task::detached;

/// Runs the program `ewa-splat` and ends the process.
///
/// - `words`: the command line, the program's name first.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, words: Vec<OsString>) {
    // Signals act as in any program, because the caller has restored their default handlers.
    let code = detached(py, || ewa_splat::command::main_of(words));
    let failed = code != ExitCode::SUCCESS;
    std::process::exit(i32::from(failed));
}
