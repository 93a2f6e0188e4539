//! Writes the data sets of `fixtures/` that this project generates: a curvilinear grid with a flow,
//! a transfer function for its field `density`, a table of particles, and a textured vase as OBJ
//! and glTF.
//!
//!     cargo run --example make_fixtures [FOLDER]
//!
//! The files are the same bytes on every machine; `tests/data/fixtures.rs` compares them.

mod fixtures;

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures"),
        PathBuf::from,
    );
    for (name, bytes) in fixtures::all() {
        let path = folder.join(name);
        std::fs::write(&path, &bytes)?;
        println!("{}: {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
