//! Binds `ewa_splat` to C: arrays to scenes, scenes to pictures in the caller's buffers.
//!
//! `include/ewa_splat.h` is the interface and its documentation. `border.rs` alone has unsafe code: it checks pointers,
//! catches panics and calls the other files.

mod arrays;
mod border;
mod cameras;
mod failure;
mod pictures;
mod scenes;
