//! Times the reading of files: the least of several times.
//!
//! ```sh
//! cargo run --release -p ewa-splat-lab --example time_reading -- FILE...
//! ```

use std::path::Path;
use std::time::Instant;

use ewa_splat::Result;
use ewa_splat::io::{OpenOptions, open};

/// Number of times that each file is read.
const TIMES: usize = 5;

fn main() -> Result<()> {
    println!("{:>10} {:>9}  file", "MB", "s");
    for name in std::env::args().skip(1) {
        let path = Path::new(&name);
        let mut least = f64::INFINITY;
        for _ in 0..TIMES {
            let start = Instant::now();
            let data = open(path, &OpenOptions::default())?;
            least = least.min(start.elapsed().as_secs_f64());
            drop(data);
        }
        let bytes = std::fs::metadata(path).map_or(0, |meta| meta.len());
        println!("{:>10.1} {least:>9.3}  {name}", bytes as f64 / 1e6);
    }
    Ok(())
}
