//! Bytes of files: opened, unpacked, decoded to numbers, and written whole.

pub(crate) mod atomic;
pub(crate) mod file;
pub(crate) mod half;
pub(crate) mod packed;
pub(crate) mod probe;
pub(crate) mod records;
pub(crate) mod scalars;
pub(crate) mod zip;
pub(crate) mod zip_write;
