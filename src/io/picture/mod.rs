//! Pictures, column densities and counts, written and read; samples of encoded images.

pub(super) mod column_file;
pub(super) mod count_file;
pub(super) mod deep_file;
pub(super) mod image_file;
pub(super) mod samples;
