//! The experiments of Chen et al. 2004, *Hardware-Accelerated Adaptive EWA Volume Splatting*, redone.
//!
//!     cargo run --release -p ewa-splat-lab --example paper_2004 -- FIGURE [FOLDER [SIZE [FRAMES]]]
//!
//! Prints a table for each figure and writes pictures to FOLDER; times are medians of FRAMES, and mean
//! something against one another only. FIGURE is `all`, or one of
//!
//! - `fig8`: a checkerboard by single filters, by EWA and by adaptive filters (with Table 2);
//! - `table3`: adaptive filters against EWA on volumes;
//! - `table4`: a scene that is sent anew for every frame against one that stays;
//! - `table5`: edits of the transfer function, against sorting out what is visible;
//! - `fig9`: every sample by itself, against slices and slabs.
//!
//! `docs/papers.md` says what the paper claims and what was found.

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
