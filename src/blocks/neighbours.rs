//! Finds the particles of a block around which slabs show anything, if slabs are classified and not particles.
//!
//! A slab shows the transfer function of its mean value, which lies among the values of the kernels in it. A kernel is
//! invisible if the function shows nothing between the least and the greatest value around it. That range covers two
//! layers of cells, extended by as much as a third layer adds in a field that continues evenly. With two layers alone,
//! pixels where a surface leaves a lattice were .014 off; with the extension all are within 1e-4
//! (`tests/frames/post_classification.rs`).

use super::halo::{Halo, Ranges};
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::scene::{Lobes, LocalModelsIn, Shared, ValuesIn};

/// Extension of the range of values to either side, as a share of it. Four steps, two layers to either side, make the
/// range; a third layer adds one more.
const BEYOND: f32 = 0.25;

/// Tells which particles of a block have anything shown around them.
pub(crate) struct Neighbours<'a> {
    /// Shown intervals, and the values around each particle; `None` if they are not known.
    known: Option<(&'a Lobes, Around<'a>)>,
}

enum Around<'a> {
    /// Ranges around a lattice's cells.
    Ranges(Box<Ranges>),
    /// Values and models of points, and the index of the block's first point.
    Models(&'a ValuesIn<Shared>, &'a LocalModelsIn<Shared>, usize),
}

impl<'a> Neighbours<'a> {
    /// Prepares a block of a volume whose particles carry their values.
    pub(crate) fn new(volume: &'a BlockedVolume, block: u32) -> Self {
        let around = match (&volume.particles, &volume.values, &volume.local_models) {
            (BlockedParticles::Lattice(grid), Some(values), _) => {
                let halo = Halo::new(grid, values, grid.cells(block));
                Some(Around::Ranges(halo.ranges()))
            }
            (_, Some(values), Some(models)) => {
                let first = volume.blocks[block as usize].first as usize;
                Some(Around::Models(values, models, first))
            }
            _ => None,
        };
        Self {
            known: volume.lobes.as_deref().zip(around),
        }
    }

    /// Whether anything is shown around particle `local`.
    #[inline]
    pub(crate) fn show(&self, local: u32) -> bool {
        let local = local as usize;
        self.known.as_ref().is_none_or(|(lobes, around)| {
            let [lo, hi] = match around {
                Around::Ranges(ranges) => [ranges.least[local], ranges.greatest[local]],
                Around::Models(values, models, first) => {
                    let (value, model) = (values.get(first + local), models.get(first + local));
                    [value - model.below, value + model.above]
                }
            };
            let beyond = BEYOND * (hi - lo);
            lobes.show(lo - beyond, hi + beyond)
        })
    }
}
