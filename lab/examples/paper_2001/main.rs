//! Reproduces the experiments of Zwicker et al. 2001, *EWA Volume Splatting*.
//!
//!     cargo run --release -p ewa-splat-lab --example paper_2001 -- FIGURE [FOLDER [SIZE [FRAMES]]]
//!
//! Prints a table for each figure and writes images to FOLDER. FIGURE is `all`, or one of
//!
//! - `fig8`: a zebra of elliptical kernels, the EWA filter against Swan's uniform scaling;
//! - `fig9`: volume kernels against surface kernels, on a textured plane and of iso-surfaces;
//! - `fig10`: semi-transparent CT with flattened iso-surfaces;
//! - `classification`: classifying and lighting slabs, against particles (conclusions);
//! - `footprint`: a table in one dimension and finite differences for the footprint (section 6).
//!
//! `docs/papers.md` compares the paper's claims with the results.

#[path = "../papers/mod.rs"]
mod papers;

mod classification;
mod footprint;
mod isosurface;
mod plane;
mod semitransparent;
mod zebra;

use papers::Arguments;

fn main() -> ewa_splat::Result<()> {
    Arguments::read()?.run(&[
        ("fig8", zebra::run),
        ("fig9", |arguments| {
            plane::run(arguments)?;
            isosurface::run(arguments)
        }),
        ("fig10", semitransparent::run),
        ("classification", classification::run),
        ("footprint", footprint::run),
    ])
}
