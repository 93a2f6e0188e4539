//! Tests the program as a user runs it.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "helpers of tests fail by panicking, as tests do; numbers are narrowed on purpose"
)]
#![cfg(feature = "cli")]

#[path = "../common/mod.rs"]
mod common;

mod annotations;
mod backdrop;
mod columns;
mod commands;
mod defaults;
mod edits;
mod export;
mod films;
mod formats;
#[cfg(feature = "gpu")]
mod gpu;
mod json;
mod manners;
#[cfg(all(target_os = "linux", feature = "prepared"))]
mod memory;
mod panoramas;
mod rooms;
mod scenes;
mod splats;
mod usage;
mod values;
mod verify;
