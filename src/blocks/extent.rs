//! Finds the blocks whose kernels are classified over their own extents. Over these kernels the field changes too much
//! for a lobe of the transfer function that it comes near.

use crate::blocks::block::{Block, EMPTY_RANGE};
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::record::{ChoiceUniform, ClassifiedBy};
use crate::scene::{Lobes, LocalModelsIn, Shared, StrengthIn, TransferFunction, ValuesIn};

/// Greatest thickness of slabs, in standard deviations of the thinnest kernels, however faint they are.
pub(crate) const THICKEST_SLAB: f32 = 2.0;

/// Returns the range of all values that classification over some particles' extents may need, and the greatest standard
/// deviation of values over a kernel. Without models, returns an empty range and 0.
pub(super) fn spread_of(
    members: &[u32],
    values: Option<&ValuesIn<Shared>>,
    models: Option<&LocalModelsIn<Shared>>,
) -> ([f32; 2], f32) {
    let (mut around, mut greatest) = (EMPTY_RANGE, 0.0_f32);
    let (Some(values), Some(models)) = (values, models) else {
        return (around, greatest);
    };
    for &i in members {
        let (value, model) = (values.get(i as usize), models.get(i as usize));
        if value.is_finite() {
            let [lo, hi] = model.reached(value, [value - model.below, value + model.above]);
            around = [around[0].min(lo), around[1].max(hi)];
            greatest = greatest.max(model.slope.length());
        }
    }
    (around, greatest)
}

/// Returns the intervals of values that a function shows, if slabs are classified by them: particles are left out by
/// the values around them.
pub(super) fn shown_lobes(volume: &BlockedVolume, shown: &TransferFunction) -> Option<Lobes> {
    volume.may_have_pieces().then(|| shown.shown())
}

/// The lobes of a function, if any block of a volume needs them.
pub(super) fn required_lobes(volume: &BlockedVolume, transfer: &TransferFunction) -> Option<Lobes> {
    if !volume.may_have_pieces() {
        return None;
    }
    let spread = volume.blocks.iter().filter(|b| b.greatest_spread > 0.0);
    let sigma = spread.fold(0.0, |widest, block| block.max_sigma.max(widest));
    let lobes = transfer.lobes(sigma);
    let needs = |block: &Block| is_spread(&lobes, block);
    volume.blocks.iter().any(needs).then_some(lobes)
}

fn is_spread(lobes: &Lobes, block: &Block) -> bool {
    let [lo, hi] = block.values_around;
    block.greatest_spread > lobes.threshold(lo, hi)
}

impl Block {
    /// Returns the range of values at which the transfer function may be evaluated.
    ///
    /// - `is_spread`: whether the kernels are classified over their extents.
    #[inline]
    pub(super) fn classified_range(&self, is_spread: bool) -> [f32; 2] {
        if is_spread {
            self.values_around
        } else {
            self.value_range
        }
    }
}

impl BlockedVolume {
    /// Whether the variation of the field over the kernels is known, and masses follow from the field.
    pub(crate) fn may_have_pieces(&self) -> bool {
        let is_lattice = matches!(self.particles, BlockedParticles::Lattice(_));
        matches!(self.strength, StrengthIn::Classified { .. })
            && self.values.is_some()
            && self.merged.is_none()
            && (is_lattice || self.local_models.is_some())
    }

    /// Returns how to classify a block's kernels, if a frame asks for more than their values.
    #[inline]
    pub(super) fn classified_by(&self, choice: &ChoiceUniform, block: &Block) -> ClassifiedBy {
        let asked = ClassifiedBy::of(choice.classified_by);
        let is_known = match asked {
            ClassifiedBy::Value => true,
            ClassifiedBy::Extent => self.is_spread(block),
            ClassifiedBy::Neighbours => self.knows_neighbours(block, choice.slab_thickness),
        };
        if is_known { asked } else { ClassifiedBy::Value }
    }

    /// Whether the values around the block's particles tell which of them slabs of a thickness leave invisible.
    fn knows_neighbours(&self, block: &Block, slab_thickness: f32) -> bool {
        let [lo, hi] = block.values_around;
        self.lobes.is_some() && lo <= hi && slab_thickness <= THICKEST_SLAB * block.min_sigma
    }

    /// Whether kernels of a block are classified over their extents, in frames that do that. For merged particles: the
    /// kernels of their members.
    #[inline]
    pub(crate) fn is_spread(&self, block: &Block) -> bool {
        self.lobes
            .as_ref()
            .is_some_and(|lobes| is_spread(lobes, block))
    }
}
