//! Tests ranks in threads: their picture equals that of one process, bit for bit.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "tests fail by panicking; numbers are narrowed on purpose"
)]

#[path = "../common/mod.rs"]
mod common;

mod faults;
#[cfg(feature = "prepared")]
mod loaded;
mod pictures;
mod planes;
#[cfg(feature = "prepared")]
mod prepared;
mod ranks;
#[cfg(feature = "prepared")]
mod scattered;
mod scenes;
mod shares;
#[cfg(feature = "prepared")]
mod together;
