//! Defines the rules by which splats of radiance fields are drawn.

use serde::{Deserialize, Serialize};

/// Rule of the renderer that splats were made for: the variance that their footprints gain, and the limits of their
/// opacity on the image, which is peak x exp(-Q/2).
///
/// | rule | low-pass filter | left out | at most |
/// |---|---|---|---|
/// | `Exact` | .3 px² | nothing | 1 |
/// | `Khr` | .3 px² | beyond 3 standard deviations | 1 |
/// | `Inria` | .3 px² | opacities below 1/255 | .99 |
/// | `Mip` | .1 px²; opacity times area stays | opacities below 1/255 | .99 |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatRule {
    /// No limits.
    #[default]
    Exact,
    /// The ellipse kernel of glTF's `KHR_gaussian_splatting`.
    Khr,
    /// Kerbl et al. 2023, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*.
    Inria,
    /// Yu et al. 2024, *Mip-Splatting: Alias-free 3D Gaussian Splatting*.
    Mip,
}

impl SplatRule {
    /// Returns `Mip` for files that mark their splats as anti-aliased, `Inria` for others.
    pub(crate) fn of_mark(is_anti_aliased: bool) -> Self {
        if is_anti_aliased {
            Self::Mip
        } else {
            Self::Inria
        }
    }

    /// Returns whether opacities have a floor and a ceiling
    /// ([`SPLAT_FLOOR`](crate::constants::SPLAT_FLOOR)).
    pub(crate) fn has_limits(self) -> bool {
        matches!(self, Self::Inria | Self::Mip)
    }

    /// Returns whether the opacity falls as the low-pass filter widens the footprint.
    pub fn is_anti_aliased(self) -> bool {
        self == Self::Mip
    }
}
