//! What is drawn: point volumes and the transfer functions that colour them.

mod lattice;
mod point_volume;
mod requirements;
mod transfer_function;
mod values;

pub(crate) use lattice::{LONE_CELL_WIDTH, cell_width};
pub use lattice::{Lattice, LatticeSpacing};
pub use point_volume::{Colour, Particles, PointVolume, Strength};
pub use requirements::Requirements;
pub use transfer_function::{
    Averages, CLASSIFICATION_TABLE_LEN, COLOUR_MAP_NAMES, ColourSpace, ControlPoint, MAX_OPACITY,
    Slopes, TransferDefaults, TransferFunction, Weighting,
};
#[cfg(feature = "gpu")]
pub(crate) use transfer_function::{FAR_ENTRIES, MAXIMUM_ROUNDING};
pub use values::Values;
