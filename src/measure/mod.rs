//! Measures the difference between pictures, and the cost of accuracy.
//!
//! [`compare`] computes figures of two images, [`difference`] draws a picture of their difference. [`sweep`]
//! draws a scene in every way that [`variants`] lists, times each and compares it with the reference image. Its
//! [`Report`] is plain data with writers for JSON, CSV and (feature `report`) an HTML page with plots.
//! [`ErrorSample`] measures a picture's error in a sample of its tiles, and finds the largest tolerance that
//! keeps the error bound.

mod band;
mod difference;
mod errors;
mod flip;
mod front;
#[cfg(feature = "report")]
mod html;
mod report;
mod sampled;
mod ssim;
mod sweep;
#[cfg(test)]
mod test_images;
mod variants;

pub use difference::{difference, difference_scale};
pub use errors::{ImageErrors, compare};
pub use flip::{FLIP_PIXELS_PER_DEGREE, flip};
pub use front::{median_times, pareto_front};
pub use report::{
    About, Budget, BudgetRow, CameraSummary, Cost, Machine, Picture, ReferenceSummary, Report, Row,
    Saving, SettingsSummary,
};
pub use sampled::{ErrorSample, SampledError};
pub use ssim::ssim;
pub use sweep::{Resampling, Subject, SweepOptions, SweepProgress, sweep};
pub use variants::{
    ACCURATE, DEFAULT, FAST, PAPER_THRESHOLDS, Variant, accurate, budget_variants, variants,
};
