//! Describes a range of planes of a larger grid.

use std::ops::Range;

/// Consecutive planes of constant k of a grid. Kernels are wanted for some of them; the others are ghost layers
/// that these need.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Window {
    /// Index of the first local plane among the `count` planes of the grid.
    pub(crate) first: usize,
    pub(crate) count: usize,
    /// The planes whose kernels are wanted, counted from the first local plane.
    pub(crate) own: Range<usize>,
}

impl Window {
    /// Returns the layers of cells whose kernels are wanted.
    ///
    /// - `dims`: nodes of the local part of the grid.
    pub(crate) fn cells(&self, dims: [usize; 3]) -> Range<usize> {
        let last = dims[2].saturating_sub(1);
        self.own.start.min(last)..self.own.end.min(last)
    }

    /// Returns the window that is a whole grid.
    pub(in crate::sample) fn whole(count: usize) -> Self {
        Self {
            first: 0,
            count,
            own: 0..count,
        }
    }
}
