//! Sorts points into the cubes of a lattice, and finds the cubes around each.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::sample::positions::index_u32;

/// The cubes of a lattice that contain any point.
#[derive(Debug)]
pub(super) struct Cubes {
    side: f64,
    /// Index at which each cube's points begin, in the order that [`Cubes::new`] returns; one more entry at the
    /// end.
    starts: Vec<u32>,
    by_key: HashMap<u64, u32, BuildHasherDefault<KeyHasher>>,
    /// The cubes around each cube, itself included, one list after another.
    around: Vec<u32>,
    around_starts: Vec<u32>,
}

impl Cubes {
    /// Sorts points into cubes; returns the order of the points, too.
    pub(super) fn new(points: &[DVec3], side: f64) -> (Self, Vec<u32>) {
        let mut keys: Vec<(u64, u32)> = points
            .par_iter()
            .enumerate()
            .map(|(i, &p)| (key(cube(p, side)), index_u32(i)))
            .collect();
        keys.par_sort_unstable();
        let is_first = |i: usize| i == 0 || keys[i - 1].0 != keys[i].0;
        let mut starts: Vec<u32> = (0..keys.len())
            .into_par_iter()
            .filter(|i| is_first(*i))
            .map(index_u32)
            .collect();
        let cubes: Vec<[i64; 3]> = starts
            .par_iter()
            .map(|&start| cube(points[keys[start as usize].1 as usize], side))
            .collect();
        let mut by_key = HashMap::with_capacity_and_hasher(cubes.len(), BuildHasherDefault::new());
        for (i, &start) in starts.iter().enumerate() {
            by_key.insert(keys[start as usize].0, index_u32(i));
        }
        starts.push(index_u32(keys.len()));
        let order = keys.into_par_iter().map(|(_, i)| i).collect();
        let neighbours = |cubes: &[[i64; 3]]| {
            let (mut found, mut ends): (Vec<u32>, Vec<usize>) = Default::default();
            for cube in cubes {
                for shift in 0..27 {
                    let shifts = [shift % 3 - 1, shift / 3 % 3 - 1, shift / 9 - 1];
                    let beside: [i64; 3] =
                        std::array::from_fn(|i| cube[i].saturating_add(shifts[i]));
                    found.extend(by_key.get(&key(beside)));
                }
                ends.push(found.len());
            }
            (found, ends)
        };
        let lists: Vec<_> = cubes.par_chunks(1024).map(neighbours).collect();
        let mut around = Vec::with_capacity(lists.iter().map(|(found, _)| found.len()).sum());
        let mut around_starts = vec![0];
        for (found, ends) in lists {
            let passed = around.len();
            around_starts.extend(ends.into_iter().map(|end| index_u32(passed + end)));
            around.extend(found);
        }
        let cubes = Self {
            side,
            starts,
            by_key,
            around,
            around_starts,
        };
        (cubes, order)
    }

    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the range of a cube's points in that order.
    pub(super) fn points(&self, cube: usize) -> Range<usize> {
        self.starts[cube] as usize..self.starts[cube + 1] as usize
    }

    /// Returns the cube that contains a place, if it contains any point.
    pub(super) fn at(&self, point: DVec3) -> Option<usize> {
        self.by_key
            .get(&key(cube(point, self.side)))
            .map(|&c| c as usize)
    }

    /// Returns the cubes with points that may be less than a side away from this one, itself included.
    pub(super) fn around(&self, cube: usize) -> &[u32] {
        &self.around[self.around_starts[cube] as usize..self.around_starts[cube + 1] as usize]
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "saturates far out, where cubes may share a key"
)]
fn cube(point: DVec3, side: f64) -> [i64; 3] {
    (point / side).to_array().map(|x| x.floor() as i64)
}

/// Interleaves the lowest 21 bits of each coordinate. Cubes two million apart share a key; points found in the
/// wrong one are far away and lose to any near point.
fn key(cube: [i64; 3]) -> u64 {
    let spread = |x: i64| {
        let mut x = x.cast_unsigned() & 0x1f_ffff;
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    let [x, y, z] = cube.map(spread);
    x | y << 1 | z << 2
}

/// Fibonacci hashing: the keys come from this module, so no protection against an adversary is needed.
#[derive(Debug, Default)]
struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(u64::from(byte));
        }
    }

    fn write_u64(&mut self, key: u64) {
        let mixed = (self.0 ^ key).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 29;
    }
}
