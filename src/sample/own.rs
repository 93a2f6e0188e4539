//! Defines sums over particles that may be partitioned among ranks.

use std::ops::Range;

use crate::collective::Collective;
use crate::error::Result;
use crate::math::ExactSum;

/// Particles of the samples that this rank owns, and the group of ranks that own the rest. Other local particles are
/// ghosts.
pub(super) struct Own<'a> {
    pub(super) range: Range<usize>,
    pub(super) ranks: &'a mut dyn Collective,
}

impl Own<'_> {
    /// Returns the exact sum over the particles of all ranks; `each` gives the local terms.
    pub(super) fn sum(&mut self, each: impl Iterator<Item = f64>) -> Result<f64> {
        let mut sum = ExactSum::default();
        each.for_each(|x| sum.add(x));
        Ok(self.ranks.exact_sum(sum)?.value())
    }
}
