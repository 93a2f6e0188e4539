//! Sorts pairs stably by bits of their keys, least digit first.

use bytemuck::{Pod, Zeroable};

use super::constants::{RADIX_BITS, RADIX_GROUPS, RADIX_SCANNED, RADIX_TILE};
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shader::{SCAN_THREADS, Shader};
use crate::error::Result;

/// Shader of the sort.
pub(super) const SHADER: Shader = Shader::new(
    "radix",
    &[SCAN_THREADS, include_str!("../../shaders/radix.wgsl")],
);

/// The pipelines of the sort. For each pair and pass it reads 12 bytes and writes 8. So a graphics card
/// with 3 TB/s sorts at most some 35 G pairs/s by 32 bits, less the time of the ranking.
#[derive(Debug)]
pub(super) struct RadixSort {
    prepare: Kernel,
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
}

/// A sort bound to certain buffers.
#[derive(Debug)]
pub(super) struct BoundRadixSort {
    /// Keys to be sorted, which the sort overwrites; four words are bound at a time.
    pub(super) keys: wgpu::Buffer,
    /// Their values.
    pub(super) values: wgpu::Buffer,
    /// Sorted keys.
    pub(super) sorted_keys: wgpu::Buffer,
    /// Their values.
    pub(super) sorted_values: wgpu::Buffer,
    /// `None` if no bit is sorted.
    prepare: Option<BoundKernel>,
    passes: Vec<BoundPass>,
    arguments: wgpu::Buffer,
}

#[derive(Debug)]
struct BoundPass {
    digits: u32,
    count: BoundKernel,
    scan: BoundKernel,
    scatter: BoundKernel,
}

/// Parameters of a pass, as `radix.wgsl` declares them.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RadixPass {
    pub(super) shift: u32,
    pub(super) digits: u32,
    pub(super) count_index: u32,
    pub(super) capacity: u32,
}

/// Returns the digits of a key's low `bits`, least first: the lowest bit of each digit, and the number of
/// its values. There are as few digits as possible, and as narrow, which keeps the counts few.
fn digits(bits: u32) -> impl Iterator<Item = (u32, u32)> {
    let pass_count = bits.div_ceil(RADIX_BITS);
    (0..pass_count).map(move |pass| {
        let shift = bits * pass / pass_count;
        let end = bits * (pass + 1) / pass_count;
        (shift, 1 << (end - shift))
    })
}

impl RadixSort {
    pub(super) fn new(gpu: &Gpu) -> Self {
        use Access::{Read, Uniform, Write};
        let kernel = |entry, bindings: &[Access]| gpu.kernel(&SHADER, entry, bindings, &[]);
        Self {
            prepare: kernel("radix_prepare", &[Uniform, Read, Write]),
            count: kernel("radix_count", &[Uniform, Read, Write, Read]),
            scan: kernel("radix_scan", &[Uniform, Read, Write, Write]),
            scatter: kernel(
                "radix_scatter",
                &[Uniform, Read, Read, Read, Read, Read, Write, Write],
            ),
        }
    }

    /// Makes buffers for `capacity` pairs.
    ///
    /// - `counts`, `count_index`: a buffer, and the word in it with the number of pairs.
    /// - `bits`: number of low bits of a key to sort by.
    ///
    /// # Errors
    /// No memory for the pairs, 16 bytes each, or for the table of counts, 1 MiB at most.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        counts: &wgpu::Buffer,
        count_index: u32,
        capacity: u64,
        bits: u32,
    ) -> Result<BoundRadixSort> {
        let words = |label| gpu.buffer(label, 4 * capacity.max(1).next_multiple_of(4));
        let mut source = (words("sort keys")?, words("sort values")?);
        let mut sorted = (words("sort keys")?, words("sort values")?);
        let (keys, values) = source.clone();
        let groups = capacity.div_ceil(RADIX_TILE).min(RADIX_GROUPS);
        let table = gpu.buffer("sort counts", 4 * (groups << RADIX_BITS))?;
        let totals = gpu.buffer("sort totals", 4 << RADIX_BITS)?;
        let arguments = gpu.buffer("sort arguments", 12)?;
        let mut prepare = None;
        let mut passes = Vec::new();
        for (shift, digits) in digits(bits) {
            let of_pass = RadixPass {
                shift,
                digits,
                count_index,
                capacity: capacity as u32,
            };
            let of_pass = gpu.uniform("sort pass", &of_pass)?;
            let buffers = [
                &of_pass, counts, &table, &source.0, &source.1, &totals, &sorted.0, &sorted.1,
            ];
            let [of_pass, counts, table, ..] = buffers;
            prepare.get_or_insert_with(|| self.prepare.bind(gpu, &[of_pass, counts, &arguments]));
            passes.push(BoundPass {
                digits,
                count: self.count.bind(gpu, &buffers[..4]),
                scan: self.scan.bind(gpu, &[of_pass, counts, table, &totals]),
                scatter: self.scatter.bind(gpu, &buffers),
            });
            std::mem::swap(&mut source, &mut sorted);
        }
        // The last pass' result has been swapped to be the next one's source.
        let (sorted_keys, sorted_values) = source;
        Ok(BoundRadixSort {
            keys,
            values,
            sorted_keys,
            sorted_values,
            prepare,
            passes,
            arguments,
        })
    }
}

impl BoundRadixSort {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        if let Some(prepare) = &self.prepare {
            prepare.dispatch(pass, 1);
        }
        for of_pass in &self.passes {
            of_pass.count.dispatch_indirect(pass, &self.arguments, 0);
            of_pass
                .scan
                .dispatch(pass, of_pass.digits.div_ceil(RADIX_SCANNED));
            of_pass.scatter.dispatch_indirect(pass, &self.arguments, 0);
        }
    }
}

/// Sorts keys by their low `bits`, equal ones in the given order. Returns the keys, and the former index
/// of each.
///
/// # Errors
/// No memory, or a lost device.
pub fn radix_sort(gpu: &Gpu, keys: &[u32], bits: u32) -> Result<(Vec<u32>, Vec<u32>)> {
    let count = keys.len();
    let counts = gpu.upload("count", &[count as u32])?;
    let sort = RadixSort::new(gpu).bind(gpu, &counts, 0, count as u64, bits)?;
    let places: Vec<u32> = (0..count as u32).collect();
    gpu.write(&sort.keys, bytemuck::cast_slice(keys));
    gpu.write(&sort.values, bytemuck::cast_slice(&places));
    gpu.run(|pass| sort.encode(pass));
    Ok((
        gpu.read(&sort.sorted_keys, count)?,
        gpu.read(&sort.sorted_values, count)?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of dispatches of a sort, and the bytes of storage that it reads and writes if
    /// caches hold the data that a thread reads twice.
    fn cost(pairs: u64, bits: u32) -> (usize, u64) {
        let tiles = pairs.div_ceil(RADIX_TILE);
        let groups = tiles.div_ceil(tiles.div_ceil(RADIX_GROUPS).max(1));
        let bytes = |(_, digits): (u32, u32)| {
            let (totals, table) = (4 * u64::from(digits), 4 * u64::from(digits) * groups);
            let count = 4 * pairs + table;
            let scan = 2 * table + totals;
            let scatter = 16 * pairs + table + totals * groups;
            count + scan + scatter
        };
        (1 + 3 * digits(bits).count(), digits(bits).map(bytes).sum())
    }

    /// Checks the counts of `docs/gpu.md`.
    #[test]
    fn what_a_sort_moves() {
        for (what, pairs, bits) in [
            ("depths, 1 M", 1_000_000, 32),
            ("tiles, 1 M", 3_770_000, 13),
            ("depths, 10 M", 10_000_000, 32),
            ("tiles, 10 M", 37_700_000, 13),
        ] {
            let (dispatches, bytes) = cost(pairs, bits);
            println!(
                "{what}: {pairs} pairs of {bits} bits: {dispatches} dispatches, {:.1} MB, {:.1} bytes a pair",
                bytes as f64 * 1e-6,
                bytes as f64 / pairs as f64
            );
            assert_eq!(dispatches, 1 + 3 * bits.div_ceil(8) as usize);
            // The table of counts is at most an eighth of the traffic.
            let of_pairs = 20 * pairs * u64::from(bits.div_ceil(8));
            assert!((of_pairs..of_pairs + of_pairs / 7).contains(&bytes));
        }
    }

    #[test]
    fn digits_cover_the_bits_once() {
        for bits in 0..=u32::BITS {
            let mut end = 0;
            for (shift, digits) in digits(bits) {
                assert_eq!(shift, end);
                assert!(digits.is_power_of_two() && digits <= 1 << RADIX_BITS);
                end += digits.ilog2();
            }
            assert_eq!(end, bits);
        }
    }
}
