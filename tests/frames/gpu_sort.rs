//! Compares the order of footprints on the device with the CPU's.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::gpu::gpu;
use bytemuck::Zeroable;
use ewa_splat::stages::constants::DEPTH_KEY_BITS;
use ewa_splat::stages::gpu::{Gpu, radix_sort, sort};
use ewa_splat::stages::record::{Footprint, pack_range};

/// Greatest key.
const LAST: u32 = (1 << DEPTH_KEY_BITS) - 1;

/// Returns footprints with these keys; those without one reach no pixel.
fn footprints(keys: impl IntoIterator<Item = Option<u32>>) -> Vec<Footprint> {
    keys.into_iter()
        .map(|key| Footprint {
            // The key of an invisible footprint is not used.
            key: key.unwrap_or(3),
            rows: key.map_or(0, |_| pack_range(3, 9)),
            columns: pack_range(0, 5),
            ..Footprint::zeroed()
        })
        .collect()
}

/// Sorts on the device, in parts that end at `ends`, and compares all words.
fn check(gpu: &Gpu, footprints: &[Footprint], ends: &[usize], what: &str) {
    let mut expected = vec![7; 3];
    ewa_splat::stages::cpu::sort(footprints, &mut expected);
    let mut parts = Vec::new();
    let mut first = 0;
    for &end in ends {
        parts.push(&footprints[first..end]);
        first = end;
    }
    parts.push(&footprints[first..]);
    let got = sort(gpu, &parts).unwrap();
    assert_eq!(got.len(), expected.len(), "{what}");
    let first = got.iter().zip(&expected).position(|(a, b)| a != b);
    assert_eq!(first, None, "{what}");
}

#[test]
fn the_order_is_the_cpus() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(1);
    // Counts near the sizes of a row of threads, a workgroup, its tile and many of them.
    for count in [
        0, 1, 31, 32, 33, 255, 257, 2047, 2048, 2049, 65_537, 200_000,
    ] {
        for keys in [3, 1 << 16, 1 << DEPTH_KEY_BITS] {
            let drawn = (0..count)
                .map(|_| (random.index(5) > 0).then(|| (random.bits() % keys) as u32))
                .collect::<Vec<_>>();
            check(
                gpu,
                &footprints(drawn),
                &[],
                &format!("{count} of {keys} keys"),
            );
        }
    }
}

#[test]
fn keys_in_any_pattern_are_sorted() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(2);
    let count = 10_000_u32;
    let pattern = |what: &str, key: &mut dyn FnMut(u32) -> Option<u32>| {
        check(gpu, &footprints((0..count).map(key)), &[], what);
    };
    pattern("all equal", &mut |_| Some(77));
    pattern("all first", &mut |_| Some(0));
    pattern("all last", &mut |_| Some(LAST));
    pattern("none visible", &mut |_| None);
    pattern("sorted", &mut |i| Some(i * 200_000));
    pattern("reversed", &mut |i| Some(LAST - i * 200_000));
    pattern("first and last", &mut |i| match i % 3 {
        0 => None,
        1 => Some(0),
        _ => Some(LAST),
    });
    pattern("one visible", &mut |i| (i == count - 1).then_some(LAST));
    pattern("single bits", &mut |_| {
        Some(1 << random.index(DEPTH_KEY_BITS as usize))
    });
    // Each digit alone distinguishes the keys.
    for shift in (0..DEPTH_KEY_BITS).step_by(4) {
        pattern(&format!("digit at {shift}"), &mut |i| {
            Some(((i * 7 % 16) << shift) & LAST)
        });
    }
}

/// Sorts keys on the device, and by a stable sort on the CPU.
fn check_keys(gpu: &Gpu, keys: &[u32], bits: u32, what: &str) {
    let mask = u32::MAX >> (u32::BITS - bits);
    let mut expected: Vec<u32> = (0..keys.len() as u32).collect();
    expected.sort_by_key(|&place| keys[place as usize] & mask);
    let (sorted, places) = radix_sort(gpu, keys, bits).unwrap();
    let what = format!("{} keys of {bits} bits, {what}", keys.len());
    let first = places.iter().zip(&expected).position(|(a, b)| a != b);
    assert_eq!(first, None, "{what}");
    assert_eq!(places.len(), expected.len(), "{what}");
    let moved = |(&key, &place): (&u32, &u32)| key == keys[place as usize];
    assert!(sorted.iter().zip(&places).all(moved), "{what}");
}

#[test]
fn equal_keys_keep_their_order_whatever_bits_are_sorted() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(5);
    for bits in 1..=u32::BITS {
        // Counts near the sizes of a row of threads, a workgroup and its tile; several of them.
        for count in [0, 1, 31, 33, 255, 256, 257, 2047, 2048, 2049, 9_999] {
            // Bits above the sorted ones have no effect.
            let keys: Vec<u32> = (0..count).map(|_| random.bits() as u32).collect();
            check_keys(gpu, &keys, bits, "random");
            let few: Vec<u32> = keys
                .iter()
                .map(|key| keys[*key as usize % 3 % count])
                .collect();
            check_keys(gpu, &few, bits, "three at most");
        }
    }
}

#[test]
fn many_keys_are_sorted_by_any_bits() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(6);
    for bits in 1..=u32::BITS {
        let keys: Vec<u32> = (0..300_001).map(|_| random.bits() as u32).collect();
        check_keys(gpu, &keys, bits, "random");
        let few: Vec<u32> = keys.iter().map(|key| keys[*key as usize % 40]).collect();
        check_keys(gpu, &few, bits, "forty");
    }
}

#[test]
fn workgroups_of_several_tiles_sort() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(7);
    // At most one tile per workgroup, and then more for some.
    let most = 1024 * 2048;
    for count in [most, most + 1, 2 * most + 70_001] {
        let keys: Vec<u32> = (0..count).map(|_| random.bits() as u32).collect();
        check_keys(gpu, &keys, 13, "random");
        let few: Vec<u32> = keys.iter().map(|key| keys[*key as usize % 40]).collect();
        check_keys(gpu, &few, 32, "forty");
    }
}

#[test]
fn parts_follow_one_another() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(3);
    let drawn = footprints(
        (0..20_000).map(|_| (random.index(7) > 0).then(|| (random.bits() % 4000) as u32)),
    );
    for ends in [
        &[0][..],
        &[20_000],
        &[0, 0, 1, 256, 257, 5_000, 5_000, 19_999],
    ] {
        check(gpu, &drawn, ends, &format!("{ends:?}"));
    }
    assert!(sort(gpu, &[]).unwrap().is_empty());
}

#[test]
fn many_footprints_are_sorted() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(4);
    let count = 1_500_000;
    let drawn = footprints((0..count).map(|_| {
        let key = (random.bits() >> 33) as u32;
        (random.index(4) > 0).then_some(key)
    }));
    let start = std::time::Instant::now();
    check(gpu, &drawn, &[1_000_000], "many");
    println!("{count} footprints: {:.2} s", start.elapsed().as_secs_f64());
}
