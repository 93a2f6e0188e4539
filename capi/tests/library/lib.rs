//! The library as `cargo test` builds it, with all features that the workspace turns on.

#[path = "../../src/lib.rs"]
mod library;
