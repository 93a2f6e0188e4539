//! Turns a kernel into its footprint on the image, by pure functions.
//!
//! | file | subject |
//! |---|---|
//! | `filter.rs` | the filter paths a user can name |
//! | `choose.rs` | the choice among them |
//! | `footprint.rs` | eq. 20 and 25 of Zwicker et al. 2001 in factored form |
//! | `exact.rs` | the five floats of w(d), exact bounds |
//! | `near.rs` | kernels that cross the camera plane |
//! | `peak.rs` | splats of radiance fields, which state their opacity |
//! | `defocus.rs` | the disc of a point that is out of focus |
//! | `sub_pixel.rs` | the opacity of lone kernels smaller than a pixel |
//! | `pixel_mean.rs` | means over pixels, for column densities |
//! | `smoothed.rs` | projected SPH kernels and their means over pixels |
//! | `outline.rs` | outlines of cut-offs on the image, for the tiles' lists |
//! | `surfel.rs` | surfels of opaque surfaces: weights and planes |
//! | `axes.rs` | variants of a pass's rasteriser |
//! | `show.rs` | colours that show which filter drew a splat |
//! | `cutoff.rs` | cut-off radius of a kernel |
//! | `edges.rs` | cuts of kernels at the boundary of their domain |
//! | `budget.rs` | division of the tolerance among the approximations |
//! | `bounds.rs` | error bounds of the affine approximation and of exact edges |

mod axes;
mod bounds;
pub mod budget;
mod choose;
mod cutoff;
mod defocus;
mod edges;
mod exact;
mod filter;
mod footprint;
mod near;
mod outline;
mod peak;
mod pixel_mean;
mod show;
mod smoothed;
mod sub_pixel;
mod surfel;

pub use axes::{Accumulate, Axes, Classify, Interval};
pub use bounds::{affine_error, edge_growth, opacity_amplification};
pub use choose::choose_exact;
pub(crate) use choose::suffices as affine_suffices;
pub use cutoff::{cutoff_radius, cutoff_share, meeting};
pub use defocus::defocus;
pub use edges::Edges;
pub use exact::{depth_terms, exact_extent, exact_terms};
pub use filter::Filter;
pub use footprint::{ImageKernel, Kernel, ScreenFactor, project_kernel};
pub use near::{evaluate_near, half_line_terms, misses_near, near_terms};
pub(crate) use outline::{KernelOutline, Outline, PlaneOutline};
#[cfg(feature = "gpu")]
pub(crate) use peak::JACOBIAN_MARGIN;
pub use peak::{ANTI_ALIASED_LOW_PASS_PX2, SPLAT_LOW_PASS_PX2, peak_footprint, peak_reach};
pub(crate) use pixel_mean::is_of_pixels;
#[cfg(feature = "gpu")]
pub(crate) use pixel_mean::{
    BAND_NODES, BAND_REACH, CDF_WHOLE, LEAST_MEAN_SIGMA_PX, SAMPLED_FROM_PX2,
};
pub use pixel_mean::{Band, PIXEL_VARIANCE_PX2, PixelMean};
pub use show::{CHOICE_COLOURS, choice_index};
pub use smoothed::Smoothed;
#[cfg(feature = "gpu")]
pub(crate) use smoothed::{
    LEAST_DRAWN_PX, MOST_ROWS, PROFILE_CELLS, Profiles, REACHES, ROWS_PER_SHEAR, SHORT_SIDE,
    SIDE_PLACE,
};
pub(crate) use smoothed::{RANK, RoundKernel};
#[cfg(feature = "gpu")]
pub(crate) use sub_pixel::{
    SUB_PIXEL_FAINT, SUB_PIXEL_LARGE, SUB_PIXEL_LOGS, SUB_PIXEL_NODES, SUB_PIXEL_OPAQUE,
    SUB_PIXEL_REACH, SUB_PIXEL_SPLIT, SUB_PIXEL_WEIGHTS,
};
pub use sub_pixel::{filtered_opacity, sub_pixel_depth};
pub(crate) use surfel::unit_normal;
#[cfg(feature = "gpu")]
pub(crate) use surfel::{GRAZING, PERSPECTIVE_FROM, SLACK_PIXELS, SLACK_SIGMAS, SLACK_SLOPE};
pub use surfel::{SurfelFootprint, near_surfel, surfel_footprint};
