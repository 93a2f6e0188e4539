//! Reads inputs.

pub(crate) mod parts;
