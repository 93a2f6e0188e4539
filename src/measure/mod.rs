//! How far one picture is from another.

mod errors;

pub use errors::{ImageErrors, compare};
