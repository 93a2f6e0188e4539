//! Tests readers, writers and sampling.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "helpers of tests fail by panicking, as tests do; numbers are narrowed on purpose"
)]

#[path = "../common/mod.rs"]
mod common;
#[path = "../../examples/fixtures/mod.rs"]
mod examples;
#[path = "../support/mod.rs"]
mod support;

mod amr;
mod atoms;
mod automatic;
mod bad_input;
mod boundaries;
mod cells;
mod cgns;
mod clouds;
mod collections;
mod colour_maps;
mod colours;
mod convert;
#[cfg(feature = "dicom")]
mod dicom;
mod faces;
mod fixtures;
mod from_bytes;
mod gadget;
mod gas;
mod gltf_variations;
mod gmsh;
mod hdf5;
mod image_series;
mod mesh_sampling;
mod meshes;
mod meta_image;
mod nek;
mod nifti;
mod nrrd;
mod openfoam;
mod packed_meshes;
mod particles;
mod phantom_native;
mod plot3d;
#[cfg(feature = "prepared")]
mod prepared;
mod public_data;
mod readers;
mod refused;
mod ripple;
mod sampling;
#[cfg(feature = "netcdf")]
mod simulations;
mod sog;
mod sog_write;
mod splat_axes;
mod splat_tables;
mod splats;
mod spz_records;
mod stacks;
mod stl;
#[cfg(feature = "prepared")]
mod streams;
mod surface_fields;
mod tecplot;
mod textures;
mod threemf;
mod tipsy;
mod usd;
mod vtk_legacy;
mod vtk_xml;
mod vtkhdf;
mod wide_values;
mod xdmf;
