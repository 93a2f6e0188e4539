//! Small mathematics that the rest stands on: factors of variances and special functions.

mod factor;
mod normal;

pub use factor::Factor;
pub use normal::{normal_cdf, normal_density_and_cdf};
