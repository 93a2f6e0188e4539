//! Converts the library's errors to Python's exceptions.

use ewa_splat::Error;
use pyo3::PyErr;
use pyo3::exceptions::{
    PyKeyboardInterrupt, PyMemoryError, PyOSError, PyRuntimeError, PyValueError,
};

/// Returns the exception that fits an error, with the error's text.
pub(crate) fn exception(error: &Error) -> PyErr {
    let text = error.to_string();
    match error {
        // Python chooses the class of a system error by its number: FileNotFoundError, ...
        Error::Io { source, path, .. } => match source.raw_os_error() {
            Some(number) => PyOSError::new_err((number, text, path.clone())),
            None => PyOSError::new_err(text),
        },
        Error::OutOfMemory { .. } => PyMemoryError::new_err(text),
        Error::NoAdapter { .. } | Error::DeviceLost { .. } | Error::Unsupported { .. } => {
            PyRuntimeError::new_err(text)
        }
        Error::Cancelled => PyKeyboardInterrupt::new_err(()),
        _ => PyValueError::new_err(text),
    }
}
