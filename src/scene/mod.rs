//! What is drawn: point volumes, the transfer functions that colour them and the light on them.

mod build;
mod lattice;
mod lighting;
mod point_volume;
mod requirements;
mod transfer_function;
mod values;

pub(crate) use lattice::{LONE_CELL_WIDTH, cell_width};
pub use lattice::{Lattice, LatticeSpacing};
pub use lighting::{Light, LightFrame, Lighting};
#[cfg(feature = "gpu")]
pub(crate) use point_volume::is_classified;
pub use point_volume::{Colour, Particles, PointVolume, Strength};
pub use requirements::Requirements;
pub use transfer_function::{
    Averages, CLASSIFICATION_TABLE_LEN, COLOUR_MAP_NAMES, ColourSpace, ControlPoint, MAX_OPACITY,
    Slopes, TransferDefaults, TransferFunction, Weighting,
};
#[cfg(feature = "gpu")]
pub(crate) use transfer_function::{FAR_ENTRIES, MAXIMUM_ROUNDING};
pub use values::Values;
