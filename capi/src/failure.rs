//! Defines the codes and the texts of errors.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::fmt;

use ewa_splat::Error;
use ewa_splat::session::Refused;

/// Code of a result, as in the header.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Status {
    Ok = 0,
    Invalid = 1,
    Io = 2,
    Format = 3,
    NoAdapter = 4,
    OutOfMemory = 5,
    DeviceLost = 6,
    Unsupported = 7,
    Cancelled = 8,
    Internal = 9,
    OtherRank = 10,
}

/// Failure of a call.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) status: Status,
    pub(crate) text: String,
}

impl Failure {
    /// Makes the failure for an argument that cannot be used: `NAME: expected A, found B`.
    pub(crate) fn invalid(text: impl Into<String>) -> Self {
        Self {
            status: Status::Invalid,
            text: text.into(),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let status = match error {
            Error::Io { .. } => Status::Io,
            Error::Format { .. } | Error::NoLayout { .. } => Status::Format,
            Error::NoAdapter { .. } => Status::NoAdapter,
            Error::OutOfMemory { .. } => Status::OutOfMemory,
            Error::DeviceLost { .. } => Status::DeviceLost,
            Error::Unsupported { .. } => Status::Unsupported,
            Error::Cancelled => Status::Cancelled,
            Error::OfRank { .. } => Status::OtherRank,
            _ => Status::Invalid,
        };
        Self {
            status,
            text: error.to_string(),
        }
    }
}

impl From<Refused> for Failure {
    fn from(Refused(text): Refused) -> Self {
        Self::invalid(text)
    }
}

/// `Result` with a call's failure.
pub(crate) type Result<T, E = Failure> = std::result::Result<T, E>;

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Stores the text of this thread's last call; empty after success. A thread that ends keeps none.
pub(crate) fn note(text: &str) {
    // Texts may quote what a caller gave; C's strings end at the first zero.
    let text: Vec<u8> = text.bytes().take_while(|byte| *byte != 0).collect();
    let text = CString::new(text).unwrap_or_default();
    let _ = LAST.try_with(|last| *last.borrow_mut() = text);
}

/// Returns a pointer to this thread's text, which lasts until the next one is stored.
pub(crate) fn last() -> *const c_char {
    let stored = LAST.try_with(|last| last.borrow().as_ptr());
    stored.unwrap_or_else(|_| c"".as_ptr())
}
