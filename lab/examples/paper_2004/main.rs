//! Reproduces the experiments of Chen et al. 2004, *Hardware-Accelerated Adaptive EWA Volume Splatting*.
//!
//!     cargo run --release -p ewa-splat-lab --example paper_2004 -- FIGURE [FOLDER [SIZE [FRAMES]]]
//!
//! Prints a table for each figure and writes images to FOLDER. Times are medians of FRAMES; compare them with one
//! another only. FIGURE is `all`, or one of
//!
//! - `fig8`: a checkerboard by single filters, by EWA and by adaptive filters (with Table 2);
//! - `table3`: adaptive filters against EWA on volumes;
//! - `table4`: a scene that is sent again for every frame, against one that stays;
//! - `table5`: edits of the transfer function, against sorting out the visible voxels;
//! - `fig9`: composition of every sample by itself, against slices and slabs.
//!
//! `docs/papers.md` compares the paper's claims with the results.

#[path = "../papers/mod.rs"]
mod papers;
#[path = "../scenes/mod.rs"]
mod scenes;

mod checkerboard;
mod edits;
mod retained;
mod sheets;
mod volumes;

use papers::Arguments;

fn main() -> ewa_splat::Result<()> {
    Arguments::read()?.run(&[
        ("fig8", checkerboard::run),
        ("table3", volumes::run),
        ("table4", retained::run),
        ("table5", edits::run),
        ("fig9", sheets::run),
    ])
}
