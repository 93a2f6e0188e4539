//! Renders unstructured point volumes and surfels by EWA splatting. Curvilinear grids, lattices and particles
//! of arbitrary shape are drawn as they are, without resampling; meshes become surfels.
//!
//! A particle is a Gaussian kernel with a variance matrix of its own; it emits and absorbs light. Projected to
//! the image and convolved with the pixel's low-pass filter, it becomes an ellipse, its footprint (Zwicker et
//! al. 2001, *EWA Volume Splatting*; Chen et al. 2004, *Hardware-Accelerated Adaptive EWA Volume Splatting*).
//! Footprints are sorted by depth and composited front to back.
//!
//! # From a file to a picture
//!
//! Read, sample, draw, save:
//!
//! ```
//! use ewa_splat::view::{Lens, Viewpoint};
//! use ewa_splat::{Renderer, Settings, io, sample};
//! use glam::DVec3;
//!
//! # fn main() -> ewa_splat::Result<()> {
//! # let folder = std::env::temp_dir().join("ewa_splat_front_page");
//! # std::fs::create_dir_all(&folder).unwrap();
//! # let (path, picture) = (folder.join("stars.csv"), folder.join("stars.png"));
//! # std::fs::write(&path, "x,y,z,sigma,mass\n0,0,0,0.5,1\n2,0,1,0.3,1\n").unwrap();
//! let dataset = io::open(&path, &io::OpenOptions::default())?;
//! let scene = sample::scene(dataset, &sample::SampleOptions::default())?;
//! let mut renderer = Renderer::new(scene.volumes)?;
//! let view = Viewpoint { azimuth_deg: 30.0, elevation_deg: 25.0, zoom: 1.0, up: DVec3::Z };
//! let camera = view.camera(&renderer.visible_boxes(), Lens::FovDeg(35.0), [320, 240]);
//! let image = renderer.render(&camera.expect("something is visible"), &Settings::default())?;
//! io::write_image(&picture, image)?;
//! # assert!(image.pixels.iter().any(|pixel| pixel[3] > 0.1));
//! # std::fs::remove_dir_all(&folder).unwrap();
//! # Ok(())
//! # }
//! ```
//!
//! [`sample::scene`] makes surfels of meshes, and volumes of all other data. [`load::load`] reads several
//! inputs as one scene. [`sample::splat_cloud`] and [`io::write_splats`] save volumes as splats.
//! [`RendererOptions`] choose a GPU and the data to keep for later changes.
//!
//! # From memory
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
//! [`scene::PointVolume::spheres`], [`ellipsoids`](scene::PointVolume::ellipsoids),
//! [`turned`](scene::PointVolume::turned) and [`lattice`](scene::PointVolume::lattice) make volumes of arrays.
//! [`sample::grid`] and [`sample::points`] choose kernels for samples without shapes.
//! [`io::Mesh::of_triangles`] and [`sample::mesh::surfels`] make surfels of triangles. [`io::read`] takes the
//! bytes of a file.
//!
//! # Column densities
//!
//! [`Renderer::column_density`] sums instead of compositing: it returns the line integral of the field along
//! each pixel's ray, as used for smoothed-particle hydrodynamics. The numbers are f32, and the mass is
//! conserved.
//!
//! # Many ranks
//!
//! [`distributed::Renderer`] draws a scene whose particles are partitioned among threads or MPI processes. The
//! image is that of one process, bit for bit. [`load::load`] reads parts of a file on each rank.
//!
//! # Long work
//!
//! Sampling, sorting into blocks, levels of detail, frames and reference images take a [`Task`] in their
//! options. The task receives their progress, and can cancel them. Frames of a device can be awaited instead
//! ([`Renderer::render_async`]). A [`Renderer`] may move between threads; scenes, settings and images may be
//! shared among them.
//!
//! # Modules
//!
//! | module | contents |
//! |---|---|
//! | [`io`] | data sets, their readers and writers, image files |
//! | [`edit`] | moves and crops data sets |
//! | [`sample`] | turns data sets into particles with variances and masses |
//! | [`load`] | several inputs to one scene, on one rank or many (feature `prepared`) |
//! | [`scene`] | point volumes, lattices, transfer functions, lights |
//! | [`view`] | cameras, clip planes |
//! | [`render`] | scene + camera + settings to image |
//! | [`distributed`] | the same on several ranks, each with a share of the scene |
//! | [`prepared`] | scenes in files that are mapped into memory (feature `prepared`) |
//! | [`mod@image`], [`stats`] | images; counts and times of frames |
//! | [`legend`], [`annotate`] | colour bars in images; axes, boxes, scales and titles (feature `legend`) |
//! | [`mod@reference`] | the reference image, in f64, by quadrature |
//! | [`measure`] | differences between images, and the cost of accuracy |
//! | [`math`] | factors of variances, special functions |
//! | [`error`] | errors: file, place, expected, found, advice |
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
mod clock;
mod collective;
// The program and the window use the command line; it changes without notice.
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod command;
#[doc = include_str!("../docs/compositing.md")]
pub mod compositing {}
mod constants;
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
mod opened;
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
// The Python package, the C interface and the page use it; it changes without notice.
#[cfg(all(feature = "legend", feature = "prepared"))]
#[doc(hidden)]
pub mod session;
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
    pub mod constants {
        pub use crate::constants::*;
    }
    #[cfg(feature = "gpu")]
    pub mod gpu {
        pub use crate::gpu::*;
    }
    pub mod record {
        pub use crate::record::*;
    }

    pub mod scene {
        pub use crate::scene::transfer_function::{
            ALONE_DEPTH, Averages, LEAST_WINDOW_SHARE, LOBE_REACH, Lobe, Lobes, MAX_LOBES,
            MAX_PIECE_WIDTH, MAX_WINDOWS, Piece, Slopes, Weighting, Window,
        };
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
pub use image::{ColumnImage, DeepImage, DepthImage, Image, NormalImage};
pub use render::{
    Backend, Blend, Classification, ColumnSettings, Composite, Filter, Order, Renderer,
    RendererOptions, SceneOptions, Settings, Show,
};
pub use task::{Progress, Task};
