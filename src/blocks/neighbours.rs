//! Beside which particles slabs show anything, where these are classified and not the particles.
//!
//! What a slab shows is what the transfer function makes of its mean value, which lies among the values of the
//! kernels in it. Of a kernel around which nothing between the least and the greatest value is shown nothing is seen:
//! the values of two rings of cells, and as much beyond as a third ring has in a field that runs on. With two alone
//! pixels where a surface leaves a lattice were .014 off, with these all are within 1e-4
//! (`tests/frames/post_classification.rs`).

use super::halo::{Halo, Ranges};
use super::{BlockedParticles, BlockedVolume};
use crate::scene::{Lobes, LocalModelsIn, Shared, ValuesIn};

/// How far the values around are continued to either side, of their range: four steps of two rings to a side make
/// it, and a third ring one more.
const BEYOND: f32 = 0.25;

/// Which particles of a block have anything shown around.
pub(crate) struct Neighbours<'a> {
    /// What is shown, and the values around each; `None` where that is not known.
    known: Option<(&'a Lobes, Around<'a>)>,
}

enum Around<'a> {
    /// Of a lattice's cells.
    Ranges(Box<Ranges>),
    /// Of points, from the first of the block on.
    Models(&'a ValuesIn<Shared>, &'a LocalModelsIn<Shared>, usize),
}

impl<'a> Neighbours<'a> {
    /// Of a block of a volume that carries its values.
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
