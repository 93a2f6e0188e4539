//! Small mathematics that the rest stands on: factors of variances,
//! spherical harmonics and special functions.

mod factor;
mod harmonics;
mod normal;

pub use factor::Factor;
pub use harmonics::{HARMONIC_0, MAX_HARMONICS_DEGREE, harmonics, harmonics_count, harmonics_sum};
pub use normal::{normal_cdf, normal_density_and_cdf};
