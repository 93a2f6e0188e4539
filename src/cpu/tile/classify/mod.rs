//! Axis *classify*: applies the transfer function. Particles are classified before the frame's
//! projection, so that footprints carry colours. `slab.rs` applies it to the mean value of each layer.

pub(super) mod slab;
