//! Writes a file of many particles, a piece at a time: a hundred clusters in a cube. Each has a density that falls with
//! the square of the distance from its middle, as in a simulation of gravity. The file is NPY with columns x, y, z,
//! sigma and mass, 20 bytes a particle.
//!
//!     cargo run --release -p ewa-splat-lab --example write_crowds PARTICLES FILE.npy

use std::f32::consts::{PI, TAU};
use std::fs::File;
use std::io::{self, BufWriter, Write};

const CROWDS: u64 = 100;

/// Pseudo-random numbers from 0 to 1, the same in every run (splitmix64).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn next(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1_u64 << 24) as f32
    }
}

fn main() -> io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, count, path] = arguments.as_slice() else {
        return Err(io::Error::other("write_crowds PARTICLES FILE.npy"));
    };
    let count: usize = count.parse().map_err(io::Error::other)?;
    let mut file = BufWriter::new(File::create(path)?);
    let columns = ["x", "y", "z", "sigma", "mass"].map(|name| format!("('{name}', '<f4')"));
    let described = columns.join(", ");
    let header =
        format!("{{'descr': [{described}], 'fortran_order': False, 'shape': ({count},), }}");
    // A multiple of 64, with the ten bytes before it.
    let len = (10 + header.len() + 1).next_multiple_of(64) - 10;
    file.write_all(b"\x93NUMPY\x01\x00")?;
    file.write_all(&u16::try_from(len).map_err(io::Error::other)?.to_le_bytes())?;
    writeln!(file, "{header:<width$}", width = len - 1)?;

    let mut random = Random(24);
    let crowds: Vec<[f32; 4]> = (0..CROWDS)
        .map(|_| {
            [
                random.next(),
                random.next(),
                random.next(),
                0.02 + 0.13 * random.next(),
            ]
        })
        .collect();
    // About as many particles in each cluster, in random order.
    let share = count as f32 / CROWDS as f32;
    for _ in 0..count {
        let [x, y, z, reach] =
            crowds[usize::try_from(random.bits() % CROWDS).map_err(io::Error::other)?];
        let r = reach * random.next().max(1e-4);
        let (cos, turn) = (2.0 * random.next() - 1.0, TAU * random.next());
        let sin = (1.0 - cos * cos).sqrt();
        // Cube root of the volume that each particle has there.
        let sigma = (4.0 * PI * r * r * reach / share).cbrt();
        let mass = 0.4 * reach * reach / share;
        let place = [
            x + r * sin * turn.cos(),
            y + r * sin * turn.sin(),
            z + r * cos,
        ];
        for number in place.into_iter().chain([sigma, mass]) {
            file.write_all(&number.to_le_bytes())?;
        }
    }
    file.into_inner()?.sync_all()
}
