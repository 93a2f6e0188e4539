//! Particles: tables, snapshots of simulations, and what such columns mean.

pub(super) mod arrow;
pub(super) mod atoms;
pub(super) mod csv;
pub(super) mod gadget;
pub(super) mod hdf5;
pub(super) mod npy;
pub(super) mod npz;
pub(super) mod periodic;
pub(super) mod phantom;
pub(super) mod table;
pub(super) mod tipsy;
mod types;
