//! Defines global reductions over data that may be partitioned among ranks.

use std::ops::Range;

use crate::error::Result;
use crate::math::ExactSum;

/// Collective operations among all ranks that have a part of the data.
pub(crate) trait Rest {
    /// Returns true if `own` is true on any rank.
    fn any(&mut self, own: bool) -> Result<bool>;

    /// Returns the sum of `own` over all ranks.
    fn sum(&mut self, own: ExactSum) -> Result<ExactSum>;

    /// Returns the maximum of `own` over all ranks, component by component.
    fn greatest(&mut self, own: [f32; 2]) -> Result<[f32; 2]>;
}

/// The reductions of a single process that has all data.
pub(super) struct Nobody;

impl Rest for Nobody {
    fn any(&mut self, own: bool) -> Result<bool> {
        Ok(own)
    }

    fn sum(&mut self, own: ExactSum) -> Result<ExactSum> {
        Ok(own)
    }

    fn greatest(&mut self, own: [f32; 2]) -> Result<[f32; 2]> {
        Ok(own)
    }
}

/// The particles of the local samples that are asked for (the others are ghosts), and the reductions over all
/// ranks.
pub(super) struct Own<'a> {
    pub(super) range: Range<usize>,
    pub(super) rest: &'a mut dyn Rest,
}

impl Own<'_> {
    /// Returns the exact sum over the particles of all ranks; `each` gives the local terms.
    pub(super) fn sum(&mut self, each: impl Iterator<Item = f64>) -> Result<f64> {
        let mut sum = ExactSum::default();
        each.for_each(|x| sum.add(x));
        Ok(self.rest.sum(sum)?.value())
    }
}
