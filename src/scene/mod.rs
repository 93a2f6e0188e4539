//! Defines the contents of a scene: point volumes, the transfer functions that colour them, and lights.

mod boundary;
mod build;
mod classification;
pub(crate) mod columns;
#[cfg(test)]
pub(crate) mod fixtures;
mod ghosts;
pub(crate) mod headers;
mod lattice;
mod lighting;
mod local_models;
#[cfg(feature = "prepared")]
pub(crate) mod map;
mod point_volume;
mod requirements;
pub(crate) mod rows;
mod splat_rule;
pub(crate) mod storage;
pub(crate) mod transfer_function;
mod values;

pub use crate::constants::CLASSIFICATION_TABLE_LEN;
pub(crate) use boundary::NO_EDGE;
pub(crate) use boundary::cut_kernel;
pub use boundary::{Boundary, BoundaryPlanes, BoundaryPlanesIn, MOST_EDGES};
pub use classification::Classification;
pub(crate) use lattice::{LONE_CELL_WIDTH, cell_width};
pub use lattice::{Lattice, LatticeSpacing};
pub use lighting::{Light, LightFrame, Lighting, MAX_SOFTNESS_DEG, Shadows};
#[cfg(feature = "gpu")]
pub(crate) use local_models::{
    DEPARTURE_BITS, DEPARTURE_STEPS_PER_OCTAVE, DIRECTION_BITS, DIRECTION_STEPS, RANGE_BITS,
    RANGE_STEPS, SLOPE_BITS, SLOPE_STEPS_PER_OCTAVE,
};
pub use local_models::{LocalModel, LocalModels, LocalModelsIn, NO_BOUND};
#[cfg(feature = "gpu")]
pub(crate) use point_volume::is_classified;
pub use point_volume::{Colour, ColourIn, Particles, PointVolume, Strength, StrengthIn};
pub use requirements::Requirements;
pub use splat_rule::SplatRule;
#[cfg(feature = "prepared")]
pub(crate) use storage::SharedBytes;
pub use storage::{Column, Owned, Shared, Storage};
pub use transfer_function::{
    AutomaticOptions, COLOUR_MAP_NAMES, ColourSpace, ControlPoint, MAX_OPACITY, ScaleName,
    TransferDefaults, TransferFunction, ValueSample, ValueScale,
};
pub(crate) use transfer_function::{
    Averages, FileFunction, LEAST_WINDOW_SHARE, LOBE_REACH, Lobe, Lobes, MAX_PIECE_WIDTH,
    PickedRow, Slopes, Surroundings, Tiling, Weighting, is_diverging,
};
#[cfg(feature = "gpu")]
pub(crate) use transfer_function::{
    FAR_ENTRIES, LOBE_CELLS_PER_DEVIATION, LOBE_ROWS_PER_OCTAVE, LobeRow, MAX_LOBE_CELLS,
    MAX_LOBE_ROWS, MAX_LOBES, MAX_WINDOW_CELLS, MAX_WINDOWS, MAXIMUM_ROUNDING,
};
pub use values::{Values, ValuesIn};
pub(crate) use values::{of_any_type, of_same_type};
