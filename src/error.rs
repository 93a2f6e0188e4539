//! What can go wrong, said to the person who holds the file.

use std::path::{Path, PathBuf};

/// The error of every fallible function of this library.
///
/// Its text has one form, which the command line prints after `error: `:
/// `FILE: where: what was expected, what was found, what to do`.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be opened, read or written.
    #[error("{}: {place}: {source}; {advice}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Where in the work: "opening", "reading the values", ...
        place: String,
        /// What the system said.
        source: std::io::Error,
        /// The next step for the user.
        advice: String,
    },
    /// A file's bytes, or a value that the user gave, are not what is needed there.
    #[error("{}: {place}: expected {expected}, found {found}; {advice}", path.display())]
    Format {
        /// The file (or the command-line option, for values given there).
        path: PathBuf,
        /// The place in it: a line, a byte, an element, a field.
        place: String,
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
        /// The next step for the user.
        advice: String,
    },
}

/// `Result` with this library's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Format`] from its five parts.
    pub fn format(
        path: impl AsRef<Path>,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self::Format {
            path: path.as_ref().to_path_buf(),
            place: place.into(),
            expected: expected.into(),
            found: found.into(),
            advice: advice.into(),
        }
    }

    /// An [`Error::Io`] from its four parts.
    pub fn io(
        path: impl AsRef<Path>,
        place: impl Into<String>,
        source: std::io::Error,
        advice: impl Into<String>,
    ) -> Self {
        Self::Io {
            path: path.as_ref().to_path_buf(),
            place: place.into(),
            source,
            advice: advice.into(),
        }
    }
}
