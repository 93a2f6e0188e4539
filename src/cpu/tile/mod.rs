//! The rasterisers of tiles, put together of the answers on four axes: one file each, the same names as in
//! `shaders/tile/`.
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
//! Axes meet at rows of [`TILE_SIZE`](crate::constants::TILE_SIZE) lanes: *evaluate* fills a
//! [`Row`](evaluate::Row) with optical depths (and where along the rays they lie), *interval* takes shares
//! of it, *accumulate* takes what is left. Below them lie `pixels.rs` (planes of a tile, and where it
//! lies), `crate::math::lane` (exponentials of a lane) and `crate::simd` (instruction sets); above them
//! `rasterise.rs` draws the tiles of a picture.
//!
//! Loops over pixels are compiled for each of three instruction sets. Fused ones, from Q to what is
//! accumulated: six of `over` (affine: exponential or series, each aligned with the image's axes or not,
//! and linear opacity; exact), five of `column` (affine, exact, three widths of separable ones). Rows: three
//! evaluations for what takes rows in a picture, three for columns, two of surfels. Nineteen loops, 57 with
//! the instruction sets.

mod accumulate;
mod classify;
mod evaluate;
mod interval;
mod pixels;
mod rasterise;
mod settings;

pub(crate) use accumulate::column::TileSums;
pub use accumulate::column::{ColumnInput, ColumnSums, bin_columns, list_visible};
pub use accumulate::opaque::{NormalTile, rasterise_surface};
pub use classify::slab::PostClassification;
pub use pixels::Tile;
pub(super) use pixels::prefetch;
pub use rasterise::rasterise;
pub use settings::RasteriseSettings;
