//! Planes of a larger grid.

use std::ops::Range;

/// Planes of constant k of a grid, of some of which kernels are asked for. The others are there because these look at them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Window {
    /// The first that is here, among `count` of the grid.
    pub(crate) first: usize,
    pub(crate) count: usize,
    /// Those that are asked for, counted from the first.
    pub(crate) own: Range<usize>,
}

impl Window {
    /// The planes of cells that are asked for.
    ///
    /// - `dims`: of the nodes that are here.
    #[cfg(feature = "cli")]
    pub(crate) fn cells(&self, dims: [usize; 3]) -> Range<usize> {
        let last = dims[2].saturating_sub(1);
        self.own.start.min(last)..self.own.end.min(last)
    }

    /// A whole grid.
    pub(super) fn whole(count: usize) -> Self {
        Self {
            first: 0,
            count,
            own: 0..count,
        }
    }
}
