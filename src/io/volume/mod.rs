//! Images on lattices: NRRD, MetaImage, NIfTI, DICOM, TIFF, numbered images, raw numbers.

#[cfg(feature = "dicom")]
pub(super) mod dicom;
pub(super) mod image_header;
pub(super) mod image_series;
pub(super) mod meta_image;
pub(super) mod nifti;
pub(super) mod nrrd;
pub(super) mod plain_numbers;
pub(super) mod raw;
pub(super) mod tiff;
pub(super) mod voxels;
