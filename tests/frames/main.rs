//! Tests kernels, stages and pictures, on both back ends. All tests share one device and its
//! pipelines.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "helpers of tests fail by panicking, as tests do; numbers are narrowed on purpose"
)]

#[path = "../../lab/examples/scenes/analytic.rs"]
mod analytic;
#[path = "../common/mod.rs"]
mod common;
#[path = "../support/mod.rs"]
mod support;

mod agreement;
mod analytic_cases;
mod backdrop;
mod blocks;
mod boundary;
mod bounds;
mod cancel;
mod coarser;
mod column_density;
mod column_kernels;
mod column_scenes;
mod composite;
mod covered_faces;
mod cut_faces;
mod deep;
mod detail;
mod exchange;
mod exposure;
mod extent;
mod extreme_cases;
mod extremes;
mod footprint_laws;
#[cfg(feature = "gpu")]
mod gpu_bin;
#[cfg(feature = "gpu")]
mod gpu_boundary;
#[cfg(feature = "gpu")]
mod gpu_classify;
#[cfg(feature = "gpu")]
mod gpu_columns;
#[cfg(feature = "gpu")]
mod gpu_cull;
#[cfg(feature = "gpu")]
mod gpu_device;
#[cfg(feature = "gpu")]
mod gpu_extent;
#[cfg(feature = "gpu")]
mod gpu_images;
#[cfg(feature = "gpu")]
mod gpu_light;
#[cfg(feature = "gpu")]
mod gpu_project;
#[cfg(feature = "gpu")]
mod gpu_rasterise;
#[cfg(feature = "gpu")]
mod gpu_sort;
#[cfg(feature = "gpu")]
mod gpu_stages;
#[cfg(feature = "gpu")]
mod gpu_supersample;
#[cfg(feature = "gpu")]
mod gpu_surface;
#[cfg(feature = "gpu")]
mod gpu_texture;
mod hidden_cells;
mod maximum;
mod mesh_lines;
mod mesh_pictures;
mod pairs;
mod panoramas;
mod pick;
mod post_classification;
mod promise;
mod real_data;
mod reference;
mod reference_data;
mod refined;
mod render_laws;
mod ripple_pictures;
mod sampled_error;
mod shading;
mod shadows;
mod simd_levels;
mod slices;
mod stages;
mod sub_pixel;
mod surfels;
