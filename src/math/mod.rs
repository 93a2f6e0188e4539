//! Collects the mathematics that the other modules use: factors of variances, spherical harmonics and special
//! functions.

mod core_of;
mod direction;
mod ein;
mod exact_sum;
mod factor;
mod flatten;
mod harmonics;
pub(crate) mod lane;
mod normal;
mod rotation;
mod truncated;
mod variance;

pub(crate) use core_of::Core;
#[cfg(feature = "gpu")]
pub(crate) use direction::NORMAL_STEPS;
pub use direction::{NO_NORMAL, normal_code, normal_of_code, pack_normal, unpack_normal};
pub(crate) use direction::{from_octahedral, to_octahedral};
pub(crate) use ein::EULER;
#[cfg(feature = "gpu")]
pub(crate) use ein::{E1_DENOMINATOR, E1_NUMERATOR, EIN_SERIES, EIN_SPLIT};
pub use ein::{ein, ein_share};
pub(crate) use exact_sum::ExactSum;
pub use factor::Factor;
pub use flatten::{flatten, tangents_of};
pub(crate) use harmonics::HarmonicsTransform;
pub use harmonics::{HARMONIC_0, MAX_HARMONICS_DEGREE, harmonics, harmonics_count, harmonics_sum};
#[cfg(feature = "gpu")]
pub(crate) use harmonics::{HARMONIC_1, HARMONICS_2, HARMONICS_3};
#[cfg(feature = "gpu")]
pub(crate) use normal::ERFC_SERIES;
pub(crate) use normal::FRAC_1_SQRT_TAU;
pub(crate) use normal::small_exp;
pub use normal::{normal_cdf, normal_density_and_cdf};
pub(crate) use rotation::{rotation_matrix, turn_between};
pub(crate) use truncated::Truncated;
pub(crate) use variance::{
    TOGETHER, eigen, factor_of_variance, from_eigen, lower_matrix, principal_sigmas,
    principal_sigmas_together, scales_and_rotation, symmetric,
};
pub use variance::{Variance, lower_factor};

/// Rounds to single precision; a number beyond its range becomes infinite.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
pub(crate) fn narrowed(x: f64) -> f32 {
    x as f32
}
