//! Defines the settings with which tiles are drawn.

use crate::frame::backdrop::RayEnds;
use crate::simd::SimdLevel;
use crate::splat::Axes;
use crate::task::Task;

/// Settings that select a variant of the rasteriser.
#[derive(Debug, Clone, Copy)]
pub struct RasteriseSettings<'a> {
    /// The variant on each axis, and the outputs.
    pub axes: Axes,
    /// The instruction set of the inner loop.
    pub level: SimdLevel,
    /// Depths at which rays end, if the axes say so.
    pub ends: Option<&'a RayEnds>,
    /// Receives the number of tiles drawn, and may end the drawing early.
    pub task: Option<&'a Task>,
}
