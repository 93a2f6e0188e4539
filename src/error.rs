//! What can go wrong, said to the person who holds the file.
//!
//! An [`Error`] knows what failed, where, and what would have been right; [`Advice`] is the next
//! step. Steps that a front end takes in its own way (an option, a dialogue, an argument) are a
//! [`Hint`], and values that it names in its own way are a [`Parameter`]: what the texts here say of
//! them holds for callers of this library, and a front end puts words of its own in their place.

mod hint;

use std::fmt;
use std::path::{Path, PathBuf};

pub use hint::{Hint, Parameter};

/// The error of every fallible function of this library.
///
/// Its text has one form, but for [`Error::Cancelled`]: `FILE: where: what was expected, what was found, what to
/// do`. What failed can be asked as well:
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
        /// Where in the work: "opening", "reading the values", ...
        place: Place,
        /// What the system said.
        source: std::io::Error,
        /// The next step.
        advice: Advice,
    },
    /// A file's contents are not what is needed there.
    #[error("{}: {place}: expected {expected}, found {found}; {advice}", path.display())]
    #[non_exhaustive]
    Format {
        /// The file.
        path: PathBuf,
        /// The place in it: a line, a byte, an element, a field.
        place: Place,
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// A file is a raw volume, and [`OpenOptions::raw`](crate::io::OpenOptions::raw) does not say how
    /// it is laid out.
    #[error(
        "{}: raw volume: expected its dimensions and type, found none; {}",
        path.display(),
        Hint::GiveLayout
    )]
    #[non_exhaustive]
    NoLayout {
        /// The file.
        path: PathBuf,
        /// What its name suggests.
        suggested: Option<SuggestedLayout>,
    },
    /// A value that the caller gave, a setting or a part of the scene, cannot be used.
    #[error("{what}: {place}: expected {expected}, found {found}; {advice}")]
    #[non_exhaustive]
    Invalid {
        /// What was given: "scene", "settings", "point volume", a parameter.
        what: Place,
        /// The place in it.
        place: Place,
        /// What would be right.
        expected: String,
        /// What was given.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// There is no adapter that can draw, not the one that is asked for, or it does not open.
    #[error("GPU: {place}: expected {expected}, found {found}; {advice}")]
    #[non_exhaustive]
    NoAdapter {
        /// "adapters", or the one that does not open.
        place: String,
        /// What was looked for.
        expected: String,
        /// The adapters that there are, or what the driver said.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// The device's memory does not hold what a scene or a frame needs.
    #[error(
        "GPU: {adapter}: expected {needed} bytes for the {what}, found {found}; {}",
        Hint::SmallerSceneOrCpu
    )]
    #[non_exhaustive]
    OutOfMemory {
        /// The adapter.
        adapter: String,
        /// What the memory was for.
        what: String,
        /// Bytes that were asked for.
        needed: u64,
        /// Bytes that the device gives to one buffer at most, where these are fewer; how much of its
        /// memory is free is not known.
        available: Option<u64>,
        /// What the driver said.
        found: String,
    },
    /// The device has been lost, or no longer does what it is told.
    #[error(
        "GPU: {adapter}: expected a device that answers, found {found}; {}",
        Hint::StartAgainOrCpu
    )]
    #[non_exhaustive]
    DeviceLost {
        /// The adapter.
        adapter: String,
        /// What the driver said.
        found: String,
    },
    /// The device cannot draw this, within its limits or at all; the CPU can.
    #[error("GPU: {place}: expected {expected}, found {found}; {advice}")]
    #[non_exhaustive]
    Unsupported {
        /// The adapter, or the part of the scene or frame.
        place: String,
        /// What the device can do.
        expected: String,
        /// What was asked for.
        found: String,
        /// The next step.
        advice: Advice,
    },
    /// Another rank of a distributed renderer failed, or is gone.
    #[error("rank {rank}: {reason}")]
    #[non_exhaustive]
    OfRank {
        /// Its number.
        rank: usize,
        /// What it said.
        reason: String,
    },
    /// The work was cancelled by its [`Task`](crate::Task): nothing is wrong.
    #[error("cancelled")]
    Cancelled,
}

/// What the name of a raw volume suggests of its layout.
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

/// Where in a file or value: in words, or a parameter that front ends call by names of their own.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// In words.
    Text(Box<str>),
    /// A value that the caller gave.
    Parameter(Parameter),
}

/// The next step: in words that hold everywhere, or a step that front ends word themselves.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Advice {
    /// In words.
    Text(Box<str>),
    /// A step for which front ends have options of their own.
    Hint(Hint),
    /// In words, of a file that is sound and holds nothing to draw.
    NoData(Box<str>),
}

impl Error {
    /// An [`Error::Format`] from its five parts.
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

    /// An [`Error::Invalid`] from its five parts.
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

    /// An [`Error::OfRank`] from its two parts.
    pub(crate) fn of_rank(rank: usize, reason: String) -> Self {
        Self::OfRank { rank, reason }
    }

    /// That this build has no code for GPUs.
    #[cfg(not(feature = "gpu"))]
    pub(crate) fn without_gpu() -> Self {
        Self::Unsupported {
            place: "back end".to_owned(),
            expected: "a build with the feature gpu".to_owned(),
            found: "one without".to_owned(),
            advice: Hint::UseCpu.into(),
        }
    }

    /// An [`Error::Io`] from its four parts.
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

    /// The same of a value that came from a file: with the file's name in place of what was given.
    /// Errors that name a file keep it, and those of devices are as they are.
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

    /// Whether a device failed, or cannot do what is asked, where the CPU may draw the same.
    pub fn is_of_device(&self) -> bool {
        matches!(
            self,
            Self::NoAdapter { .. }
                | Self::OutOfMemory { .. }
                | Self::DeviceLost { .. }
                | Self::Unsupported { .. }
        )
    }

    /// The next step, where it is one that front ends word themselves.
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

    /// Whether a file is sound, but holds nothing to draw, so that others that belong to it may be drawn without it.
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

    /// The file that is at fault, if it is one.
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
    /// The next step where a sound file holds nothing to draw: [`Error::holds_nothing`].
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
