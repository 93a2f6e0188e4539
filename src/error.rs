//! Defines the errors of the library. Their texts tell the holder of a file what is wrong and what to do.
//!
//! An [`Error`] states what failed, where, and what was expected. [`Advice`] is the next step. A [`Hint`] is a
//! step that each front end takes in its own way (an option, a dialogue, an argument). A [`Parameter`] is a
//! value that each front end names in its own way. The texts here address callers of this library; a front end
//! replaces them with its own.

mod hint;

use std::fmt;
use std::path::{Path, PathBuf};

pub use hint::{Hint, Parameter};

/// The error of every fallible function of this library.
///
/// Apart from [`Error::Cancelled`], the text has one form: `FILE: where: what was expected, what was found,
/// what to do`. The cause can also be matched:
///
/// ```
/// use ewa_splat::Error;
/// use ewa_splat::io::{OpenOptions, RawLayout, RawType, read};
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// let bytes = [0; 4 * 3 * 2];
/// let mut options = OpenOptions::default();
/// if let Err(Error::NoLayout { suggested: Some(layout), .. }) = read("fuel_4x3x2_uint8.raw", &bytes, &options) {
///     let (dims, scalar) = (layout.dims, RawType::U8);
///     let (spacing, origin) = (DVec3::ONE, DVec3::ZERO);
///     options.raw = Some(RawLayout { dims, spacing, origin, scalar, big_endian: false });
/// }
/// assert_eq!(read("fuel_4x3x2_uint8.raw", &bytes, &options)?.field_names().len(), 1);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be opened, read or written.
    #[error("{}: {place}: {source}; {advice}", path.display())]
    #[non_exhaustive]
    Io {
        /// The file.
        path: PathBuf,
        /// Step of the work: "opening", "reading the values", ...
        place: Place,
        /// Error of the operating system.
        source: std::io::Error,
        /// The next step.
        advice: Advice,
    },
    /// The contents of a file differ from those expected.
    #[error("{}: {place}: expected {expected}, found {found}; {advice}", path.display())]
    #[non_exhaustive]
    Format {
        /// The file.
        path: PathBuf,
        /// Place in the file: a line, a byte, an element, a field.
        place: Place,
        /// Expected contents.
        expected: String,
        /// Contents found.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// A file is a raw volume, and [`OpenOptions::raw`](crate::io::OpenOptions::raw) does not give its layout.
    #[error(
        "{}: raw volume: expected its dimensions and type, found none; {}",
        path.display(),
        Hint::GiveLayout
    )]
    #[non_exhaustive]
    NoLayout {
        /// The file.
        path: PathBuf,
        /// Layout that the file's name suggests.
        suggested: Option<SuggestedLayout>,
    },
    /// A value from the caller, a setting or a part of the scene, cannot be used.
    #[error("{what}: {place}: expected {expected}, found {found}; {advice}")]
    #[non_exhaustive]
    Invalid {
        /// Kind of value: "scene", "settings", "point volume", a parameter.
        what: Place,
        /// Place in the value.
        place: Place,
        /// Expected value.
        expected: String,
        /// Value found.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// No adapter can draw, or the requested one is missing or does not open.
    #[error("GPU: {place}: expected {expected}, found {found}; {advice}")]
    #[non_exhaustive]
    NoAdapter {
        /// "adapters", or the one that does not open.
        place: String,
        /// Adapter sought.
        expected: String,
        /// Adapters available, or the driver's message.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// The device's memory does not suffice for a scene or a frame.
    #[error(
        "GPU: {adapter}: expected {needed} bytes for the {what}, found {found}; {}",
        Hint::SmallerSceneOrCpu
    )]
    #[non_exhaustive]
    OutOfMemory {
        /// The adapter.
        adapter: String,
        /// Purpose of the memory.
        what: String,
        /// Bytes requested.
        needed: u64,
        /// Greatest size of a buffer on the device, in bytes, if it is smaller. The amount of free memory is
        /// not known.
        available: Option<u64>,
        /// The driver's message.
        found: String,
    },
    /// The device has been lost, or no longer responds to commands.
    #[error(
        "GPU: {adapter}: expected a device that answers, found {found}; {}",
        Hint::StartAgainOrCpu
    )]
    #[non_exhaustive]
    DeviceLost {
        /// The adapter.
        adapter: String,
        /// The driver's message.
        found: String,
    },
    /// The device cannot draw this, within its limits or at all; the CPU can.
    #[error("GPU: {place}: expected {expected}, found {found}; {advice}")]
    #[non_exhaustive]
    Unsupported {
        /// The adapter, or the part of the scene or frame.
        place: String,
        /// Capability of the device.
        expected: String,
        /// Capability requested.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// Another rank of a distributed renderer failed, or has terminated.
    #[error("rank {rank}: {reason}")]
    #[non_exhaustive]
    OfRank {
        /// Number of the rank.
        rank: usize,
        /// The rank's message.
        reason: String,
    },
    /// The work was cancelled by its [`Task`](crate::Task); this is no fault.
    #[error("cancelled")]
    Cancelled,
}

/// Layout of a raw volume as its name suggests it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct SuggestedLayout {
    /// Samples along x, y and z.
    pub dims: [usize; 3],
    /// The type of a sample, as [`Values::type_name`](crate::scene::Values::type_name) spells it.
    pub scalar: &'static str,
}

/// `Result` with this library's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Place in a file or value: in words, or a parameter that each front end names in its own way.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// In words.
    Text(Box<str>),
    /// A value that the caller gave.
    Parameter(Parameter),
}

/// The next step: in words that fit every front end, or a step that each words itself.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Advice {
    /// In words.
    Text(Box<str>),
    /// A step for which front ends have options of their own.
    Hint(Hint),
    /// In words, for a file that is valid but holds nothing to draw.
    NoData(Box<str>),
}

impl Error {
    /// Makes an [`Error::Format`] of its five parts.
    pub fn format(
        path: impl AsRef<Path>,
        place: impl Into<Place>,
        expected: impl Into<String>,
        found: impl Into<String>,
        advice: impl Into<Advice>,
    ) -> Self {
        Self::Format {
            path: path.as_ref().to_path_buf(),
            place: place.into(),
            expected: expected.into(),
            found: found.into(),
            advice: advice.into(),
        }
    }

    /// Makes an [`Error::Invalid`] of its five parts.
    pub fn invalid(
        what: impl Into<Place>,
        place: impl Into<Place>,
        expected: impl Into<String>,
        found: impl Into<String>,
        advice: impl Into<Advice>,
    ) -> Self {
        Self::Invalid {
            what: what.into(),
            place: place.into(),
            expected: expected.into(),
            found: found.into(),
            advice: advice.into(),
        }
    }

    /// Makes an [`Error::OfRank`] of its two parts.
    pub(crate) fn of_rank(rank: usize, reason: String) -> Self {
        Self::OfRank { rank, reason }
    }

    /// Returns the error for a build without code for GPUs.
    #[cfg(not(feature = "gpu"))]
    pub(crate) fn without_gpu() -> Self {
        Self::Unsupported {
            place: "back end".to_owned(),
            expected: "a build with the feature gpu".to_owned(),
            found: "one without".to_owned(),
            advice: Hint::UseCpu.into(),
        }
    }

    /// Makes an [`Error::Io`] of its four parts.
    pub fn io(
        path: impl AsRef<Path>,
        place: impl Into<Place>,
        source: std::io::Error,
        advice: impl Into<Advice>,
    ) -> Self {
        Self::Io {
            path: path.as_ref().to_path_buf(),
            place: place.into(),
            source,
            advice: advice.into(),
        }
    }

    /// Converts the error of a value that came from a file: replaces the kind of value by the file's name.
    /// Errors that name a file already, and errors of devices, are returned unchanged.
    #[must_use]
    pub fn in_file(self, file: &Path) -> Self {
        match self {
            Self::Invalid {
                place,
                expected,
                found,
                advice,
                ..
            } => Self::format(file, place, expected, found, advice),
            other => other,
        }
    }

    /// Returns true if a device failed or cannot do the work, so that the CPU may draw the scene instead.
    pub fn is_of_device(&self) -> bool {
        matches!(
            self,
            Self::NoAdapter { .. }
                | Self::OutOfMemory { .. }
                | Self::DeviceLost { .. }
                | Self::Unsupported { .. }
        )
    }

    /// Returns the next step if it is one that front ends word themselves.
    pub fn hint(&self) -> Option<Hint> {
        let advice = match self {
            Self::Io { advice, .. }
            | Self::Format { advice, .. }
            | Self::Invalid { advice, .. }
            | Self::NoAdapter { advice, .. }
            | Self::Unsupported { advice, .. } => advice,
            Self::NoLayout { .. } => return Some(Hint::GiveLayout),
            Self::OutOfMemory { .. } => return Some(Hint::SmallerSceneOrCpu),
            Self::DeviceLost { .. } => return Some(Hint::StartAgainOrCpu),
            Self::OfRank { .. } | Self::Cancelled => return None,
        };
        match advice {
            Advice::Hint(hint) => Some(*hint),
            Advice::Text(_) | Advice::NoData(_) => None,
        }
    }

    /// Returns true if a file is valid but holds nothing to draw. Other files of the same set can then be drawn
    /// without it.
    pub fn holds_nothing(&self) -> bool {
        let is_empty = matches!(
            self,
            Self::Format {
                advice: Advice::NoData(_),
                ..
            }
        );
        is_empty || self.hint() == Some(Hint::LookAtFile)
    }

    /// Returns the file at fault, if there is one.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Io { path, .. } | Self::Format { path, .. } | Self::NoLayout { path, .. } => {
                Some(path)
            }
            _ => None,
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Parameter(parameter) => parameter.fmt(f),
        }
    }
}

impl From<&str> for Place {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Place {
    fn from(text: String) -> Self {
        Self::Text(text.into())
    }
}

impl From<Parameter> for Place {
    fn from(parameter: Parameter) -> Self {
        Self::Parameter(parameter)
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) | Self::NoData(text) => f.write_str(text),
            Self::Hint(hint) => hint.fmt(f),
        }
    }
}

impl Advice {
    /// Makes the advice for a valid file that holds nothing to draw: [`Error::holds_nothing`].
    pub(crate) fn no_data(text: &str) -> Self {
        Self::NoData(text.into())
    }
}

impl From<&str> for Advice {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Advice {
    fn from(text: String) -> Self {
        Self::Text(text.into())
    }
}

impl From<Hint> for Advice {
    fn from(hint: Hint) -> Self {
        Self::Hint(hint)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_may_cross_threads_and_outlive_their_callers() {
        fn check<T: std::error::Error + Send + Sync + 'static>() {}
        check::<Error>();
        // Results are returned by value.
        assert!(size_of::<Error>() <= 112, "{}", size_of::<Error>());
    }

    #[test]
    fn a_value_from_a_file_is_named_by_the_file() {
        let error = Error::invalid("the mesh", "triangles", "some", "none", "give some");
        assert_eq!(error.file(), None);
        let error = error.in_file(Path::new("a.obj"));
        assert_eq!(error.file(), Some(Path::new("a.obj")));
        let text = "a.obj: triangles: expected some, found none; give some";
        assert_eq!(error.to_string(), text);
        let kept = error.in_file(Path::new("b.obj"));
        assert_eq!(kept.to_string(), text);
    }
}
