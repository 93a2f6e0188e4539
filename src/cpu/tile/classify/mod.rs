//! Axis *classify*: where the transfer function is asked. Per particle it was, before the frame's
//! projection: footprints carry colours. `slab.rs` asks it for the mean value of each layer.

pub(super) mod slab;
