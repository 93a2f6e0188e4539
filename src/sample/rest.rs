//! What is asked of all data where some of them are elsewhere.

use std::ops::Range;

use crate::error::Result;
use crate::math::ExactSum;

/// Whoever has the rest of the data.
pub(crate) trait Rest {
    /// Whether anyone says so.
    fn any(&mut self, own: bool) -> Result<bool>;

    /// The sum of what all say.
    fn sum(&mut self, own: ExactSum) -> Result<ExactSum>;

    /// The greatest that anyone says, place by place.
    fn greatest(&mut self, own: [f32; 2]) -> Result<[f32; 2]>;
}

/// Nobody: all data are here.
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

/// The particles that are asked for, of those of samples that are here, and whoever has the others.
pub(super) struct Own<'a> {
    pub(super) range: Range<usize>,
    pub(super) rest: &'a mut dyn Rest,
}

impl Own<'_> {
    /// The exact sum of what all particles add.
    pub(super) fn sum(&mut self, each: impl Iterator<Item = f64>) -> Result<f64> {
        let mut sum = ExactSum::default();
        each.for_each(|x| sum.add(x));
        Ok(self.rest.sum(sum)?.value())
    }
}
