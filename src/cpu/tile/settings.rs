//! How tiles are drawn.

use crate::simd::SimdLevel;
use crate::splat::Axes;
use crate::task::Task;

/// What specialises the rasteriser.
#[derive(Debug, Clone, Copy)]
pub struct RasteriseSettings<'a> {
    /// What happens to a kernel on a pixel, and what is asked for.
    pub axes: Axes,
    /// The instruction set of the inner loop.
    pub level: SimdLevel,
    /// Is told how many tiles are drawn, and may leave out the rest.
    pub task: Option<&'a Task>,
}
