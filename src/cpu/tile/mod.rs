//! Rasterises tiles, by combinations of the answers on four axes: one file per answer, with the same
//! names as in `shaders/tile/`.
//!
//! | axis | answer | file |
//! |---|---|---|
//! | *evaluate* | affine | `evaluate/affine.rs` |
//! | | exact | `evaluate/exact.rs` |
//! | | near | `evaluate/near.rs` |
//! | | surfel | `evaluate/surfel.rs` |
//! | *interval* | all | none: rows are taken as they are |
//! | | planes, surface | `interval/cut.rs`; of surfels `interval/edges.rs` |
//! | *accumulate* | over | `accumulate/over.rs` |
//! | | sheets | `accumulate/sheets.rs` on `accumulate/layers.rs` |
//! | | slabs | `accumulate/slabs.rs` on `accumulate/layers.rs` |
//! | | column | `accumulate/column.rs` |
//! | | opaque | `accumulate/opaque.rs` |
//! | *classify* | particle | none: footprints carry colours |
//! | | slab | `classify/slab.rs` |
//!
//! The axes are connected by rows of [`TILE_SIZE`](crate::constants::TILE_SIZE) lanes. *Evaluate* fills a
//! [`Row`](evaluate::Row) with optical depths and depths along the rays; *interval* takes shares of them;
//! *accumulate* receives the rest. The layers below are `pixels.rs` (planes of a tile, and its position),
//! `crate::math::lane` (exponentials of a lane) and `crate::simd` (instruction sets). Above,
//! `rasterise.rs` draws the tiles of a picture.
//!
//! Loops over pixels are compiled for three instruction sets:
//!
//! - Fused loops from Q to the accumulated values: six of `over` (affine: exponential or series, each
//!   aligned with the image's axes or not, and linear opacity; exact), five of `column` (affine, exact,
//!   three widths of separable footprints).
//! - Loops over rows: three evaluations for pictures, three for columns, two of surfels.
//!
//! These are nineteen loops, 57 with the instruction sets.

mod accumulate;
mod classify;
mod evaluate;
mod interval;
mod pixels;
mod rasterise;
mod settings;

pub(crate) use accumulate::column::TileSums;
pub use accumulate::column::{ColumnInput, ColumnSums, bin_columns};
pub use accumulate::opaque::{NormalTile, rasterise_surface};
pub use classify::slab::PostClassification;
pub use pixels::Tile;
pub(super) use pixels::prefetch;
pub use rasterise::rasterise;
pub use settings::RasteriseSettings;
