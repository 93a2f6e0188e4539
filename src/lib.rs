//! Renders unstructured point volumes and surfels by EWA splatting. Curvilinear grids, lattices and particles
//! of arbitrary shape are drawn as they are, without resampling; meshes become surfels.
//!
//! A particle is a Gaussian kernel with a variance matrix of its own; it emits and absorbs light. Projected to
//! the image and convolved with the pixel's low-pass filter, it becomes an ellipse, its footprint (Zwicker et
//! al. 2001, *EWA Volume Splatting*; Chen et al. 2004, *Hardware-Accelerated Adaptive EWA Volume Splatting*).
//! Footprints are sorted by depth and composited front to back.
//!
//! ```
//! use ewa_splat::scene::PointVolume;
//! use ewa_splat::view::Camera;
//! use ewa_splat::{Renderer, Settings};
//! use glam::DVec3;
//!
//! # fn main() -> ewa_splat::Result<()> {
//! // Its variance: xx, xy, xz, yy, yz, zz.
//! let needle = PointVolume::ellipsoids([DVec3::ZERO], &[[0.25, 0.15, 0.0, 0.0925, 0.0, 0.01]])?
//!     .with_masses([0.5])
//!     .with_colour([1.0, 0.6, 0.2]);
//! let eye = DVec3::new(0.0, -5.0, 1.0);
//! let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 40.0, [320, 240]);
//! let mut renderer = Renderer::new(vec![needle])?;
//! let image = renderer.render(&camera, &Settings::default())?;
//! assert!(image.pixel(160, 120)[3] > 0.5);
//! # Ok(())
//! # }
//! ```
//!
//! # From memory
//!
//! [`scene::PointVolume::spheres`], [`ellipsoids`](scene::PointVolume::ellipsoids),
//! [`turned`](scene::PointVolume::turned) and [`lattice`](scene::PointVolume::lattice) make volumes of arrays.
//! [`sample::grid`] and [`sample::points`] choose kernels for samples without shapes.
//! [`io::Mesh::of_triangles`] and [`sample::mesh::surfels`] make surfels of triangles. [`io::read`] takes the
//! bytes of a file.
//!
//! # From files
//!
//! [`io::open`] reads a file into a [`io::Dataset`], [`sample::scene`] turns the data set into
//! [`scene::PointVolume`]s, [`Renderer`] draws them, and [`io::write_image`] writes the picture. For meshes,
//! [`sample::scene`] makes surfels: [`sample::mesh`]. `load::load` (feature `prepared`) reads several files as one
//! scene, in one process or in parts on many ranks. [`sample::splat_cloud`] and [`io::write_splats`] convert
//! volumes to a file of splats.
//!
//! # Column densities
//!
//! [`Renderer::column_density`] sums instead of compositing: it returns the line integral of the field along
//! each pixel's ray, as used for smoothed-particle hydrodynamics. The numbers are f32, and the mass is
//! conserved.
//!
//! # Long work
//!
//! Sampling, sorting into blocks, levels of detail, frames and reference images take a [`Task`] in their
//! options. The task receives their progress, and can cancel them. Frames of a device can be awaited instead
//! ([`Renderer::render_async`]). A [`Renderer`] may move between threads; scenes, settings and images may be
//! shared among them.
//!
//! # Rooms
//!
//! Imports run down this list, never up. Modules without a link implement the stages of frames and are not
//! public.
//!
//! | module | contents |
//! |---|---|
//! | [`error`], [`Task`], [`constants`], [`image`] | errors, progress of long work, numbers with one home, pictures |
//! | [`math`] | factors of variances, special functions |
//! | [`scene`] | point volumes, lattices, transfer functions, requirements of a scene |
//! | [`io`] | readers and writers, one file per format |
//! | [`edit`] | moves and cuts data sets |
//! | [`view`] | cameras, clip planes |
//! | [`sample`] | turns data sets into particles with variances and masses |
//! | `splat` | kernel to footprint: filters, exact terms, error bounds |
//! | `record` | the structs that stages exchange |
//! | `blocks` | particles in blocks, culling, level of detail, filters block by block |
//! | `prepared` | scenes in files that are mapped into memory (feature `prepared`) |
//! | [`stats`] | counts and times of frames |
//! | `cpu` | the stages of a frame on the CPU |
//! | `gpu` | the same stages on a GPU (feature `gpu`) |
//! | [`render`] | scene + camera + settings to frame |
//! | [`distributed`] | the same on several ranks, each with a share of the scene |
//! | [`mod@reference`] | the reference image, in f64, by quadrature |
//! | `overlay` | draws over pictures: text, plates, lines (feature `legend`) |
//! | `legend`, `annotate` | colour bars in pictures; axes, boxes, scales and titles (feature `legend`) |
//! | [`measure`] | differences between pictures, and the cost of accuracy |
//! | `load` | several inputs to one scene, in one process or on ranks that read parts of files (feature `prepared`) |
//!
//! Further pages: [`accuracy`] on the cost and the error of each approximation, [`irregular`] on how each kind
//! of data becomes kernels and what its lengths mean, [`compositing`] on sheets, slabs and clip planes,
//! [`shading`] on light, [`surfels`] on meshes, surfaces and surfels among volumes, [`papers`] on the papers'
//! claims and what was found.
//!
//! # Conventions
//!
//! - The world is right-handed. Camera space: x right, y down, z forward; pixel =
//!   (fx x/z + cx, fy y/z + cy); the centre of pixel (i, j) is (i + 0.5, j + 0.5).
//! - Kernels have unit integral; a particle has a mass g = extinction x volume \[length²\];
//!   tau = g x (line integral of the kernel), dimensionless; opacity = 1 - exp(-tau).
//! - A shape is stored as a factor L of the variance V = L Lᵀ, never as V.
//! - Colours are linear and premultiplied inside; PNG is sRGB, EXR, PFM and NPY are linear.
//! - Transfer-function opacity is per unit distance: extinction = -ln(1 - opacity) / unit_distance.
//!
//! # Glossary
//!
//! | the papers' | here |
//! |---|---|
//! | V''_k, V'_k, V_k | factors of the variance in object, camera and ray space: [`scene::Particles`], [`math::Factor`], `splat::ScreenFactor` |
//! | W | `camera_from_world` |
//! | J | folded into `splat::project_kernel` |
//! | u_k, x_k | `centre` (camera space), `centre_px` |
//! | h, V_h | `low_pass_variance_px2` |
//! | T^2D | M, the mapping of a surfel's plane to the image: `splat::surfel_footprint` |
//! | surfel | a flat kernel: [`scene::Particles::Surfels`] |
//! | q_k, rho_k | `record::Footprint`: the resampling filter, times the mass |
//! | g_k, c_k | extinction, colour: [`scene::TransferFunction`] |
//! | classify | apply the transfer function |
//! | amplitude | value x volume, or mass: the summand of column densities |
//! | choose | pick a filter path: `blocks::choose`, `splat::choose_exact` |
//! | merged | a cluster of particles drawn as one: `blocks::Merged` |

#![cfg_attr(
    not(feature = "prepared"),
    allow(
        dead_code,
        unused_imports,
        reason = "`load` alone reads files in parts"
    )
)]

#[doc = include_str!("../docs/accuracy.md")]
pub mod accuracy {}
#[cfg(feature = "legend")]
pub mod annotate;
mod blocks;
#[cfg(test)]
mod breadth;
mod collective;
#[cfg(feature = "cli")]
pub mod command;
#[doc = include_str!("../docs/compositing.md")]
pub mod compositing {}
pub mod constants;
mod cpu;
mod data;
pub mod edit;
pub mod error;
mod frame;
#[cfg(feature = "gpu")]
mod gpu;
pub mod image;
pub mod io;
#[doc = include_str!("../docs/irregular.md")]
pub mod irregular {}
#[cfg(feature = "legend")]
pub mod legend;
#[cfg(feature = "prepared")]
pub mod load;
pub mod math;
pub mod measure;
#[doc(hidden)]
pub mod memory;
mod message;
#[cfg(feature = "legend")]
mod overlay;
mod parallel;
#[cfg(feature = "prepared")]
pub mod prepared;
mod record;
#[doc = include_str!("../docs/papers.md")]
pub mod papers {}
#[doc(hidden)]
pub mod ranks;
pub mod reference;
pub mod render;
pub mod sample;
pub mod scene;
mod simd;
mod splat;
pub mod stats;
#[doc = include_str!("../docs/shading.md")]
pub mod shading {}
#[doc = include_str!("../docs/surfels.md")]
pub mod surfels {}
mod task;
pub mod view;

/// Gives the tests, benchmarks and examples of this crate access to the stages of a frame and the structs that
/// they exchange. These change without notice.
#[doc(hidden)]
#[allow(missing_docs, reason = "the modules have their own")]
pub mod stages {
    pub mod blocks {
        pub use crate::blocks::*;
    }
    pub mod cpu {
        pub use crate::cpu::*;
    }
    #[cfg(feature = "gpu")]
    pub mod gpu {
        pub use crate::gpu::*;
    }
    pub mod record {
        pub use crate::record::*;
    }
    pub mod splat {
        pub use crate::splat::*;
    }
}

#[doc(inline)]
pub use ranks as distributed;
#[cfg(feature = "gpu")]
pub use wgpu;

pub use error::{Error, Result};
pub use image::{ColumnImage, DepthImage, Image, NormalImage};
pub use render::{
    Backend, Blend, ClassifyAt, ColumnSettings, Composite, Filter, Renderer, SceneOptions,
    Settings, Show,
};
pub use task::{Progress, Task};
