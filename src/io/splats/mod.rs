//! Splats of radiance fields: .splat, KSPLAT, SPZ, SOG, glTF and USD, read and written.

pub(crate) mod csv_write;
pub(crate) mod encoded_splats;
pub(crate) mod gltf_splats;
pub(crate) mod ksplat;
pub(crate) mod ksplat_write;
pub(crate) mod log_scales;
pub(crate) mod morton;
pub(crate) mod placed;
pub(crate) mod sog;
pub(crate) mod splat;
pub(crate) mod splat_axes;
pub(crate) mod splat_table;
pub(crate) mod spz;
pub(crate) mod spz_write;
pub(crate) mod usd;
pub(crate) mod write_splats;
