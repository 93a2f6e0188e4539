//! Defines the rule by which a volume's particles are drawn.

use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::scene::{SplatRule, StrengthIn};

/// Rule by which a volume's particles are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Rule {
    /// Kernels that absorb light.
    Kernel,
    /// Splats that state their opacity.
    Peak(SplatRule),
    /// Surfels of an opaque surface.
    Surface { is_one_sided: bool },
    /// Surfels of a translucent surface.
    Translucent { is_one_sided: bool },
}

impl Rule {
    pub(crate) fn of(volume: &BlockedVolume) -> Self {
        let is_one_sided = matches!(
            volume.particles,
            BlockedParticles::Surfels {
                is_one_sided: true,
                ..
            }
        );
        match volume.strength {
            StrengthIn::PeakOpacity { rule, .. } => Self::Peak(rule),
            StrengthIn::Surface(_) => Self::Surface { is_one_sided },
            StrengthIn::Translucent(_) => Self::Translucent { is_one_sided },
            StrengthIn::Classified { .. } | StrengthIn::Mass(_) => Self::Kernel,
        }
    }
}
