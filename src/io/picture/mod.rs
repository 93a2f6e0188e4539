//! Pictures, column densities and counts, written and read; samples of encoded images.

pub(super) mod column_file;
pub(super) mod count_file;
pub(super) mod deep_file;
#[cfg(feature = "cli")]
pub(super) mod fits;
pub(super) mod image_file;
pub(super) mod provenance;
pub(super) mod samples;
#[cfg(feature = "cli")]
pub(super) mod stored;
