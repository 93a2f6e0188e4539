//! Compares each stage of the GPU back end with its CPU twin, on the same input.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::gpu::gpu;
use ewa_splat::stages::gpu::exclusive_scan;

#[test]
fn prefix_sums_are_those_of_a_loop() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(1);
    // Counts near the sizes of one thread's run, one workgroup's, and of one more level.
    for count in [0, 1, 8, 9, 2047, 2048, 2049, 600_000] {
        let words: Vec<u32> = (0..count).map(|_| random.index(5000) as u32).collect();
        let expected: Vec<u32> = words
            .iter()
            .scan(0_u32, |sum, w| {
                let before = *sum;
                *sum = sum.saturating_add(*w);
                Some(before)
            })
            .collect();
        assert_eq!(exclusive_scan(gpu, &words).unwrap(), expected, "{count}");
    }
    let huge = vec![u32::MAX / 2; 5];
    let sums = exclusive_scan(gpu, &huge).unwrap();
    assert_eq!(sums[2..], [u32::MAX - 1, u32::MAX, u32::MAX]);
}
