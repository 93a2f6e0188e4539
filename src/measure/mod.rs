//! How far one picture is from another.

mod band;
mod difference;
mod errors;
mod flip;
mod ssim;
#[cfg(test)]
mod test_images;

pub use difference::{difference, difference_scale};
pub use errors::{ImageErrors, compare};
pub use flip::{FLIP_PIXELS_PER_DEGREE, flip};
pub use ssim::ssim;
