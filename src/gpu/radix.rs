//! A stable sort of pairs by the low bits of their keys, least digit first.

use std::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use super::constants::{RADIX_BITS, RADIX_GROUP};
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::scan::{BoundScan, Scan};
use super::shader::{DISPATCH, SCAN_THREADS, Shader};
use crate::error::Result;

/// The sort.
pub(super) const SHADER: Shader = Shader::new(
    "radix",
    &[
        DISPATCH,
        SCAN_THREADS,
        include_str!("../../shaders/radix.wgsl"),
    ],
);

/// The pipelines of the sort. Per pair and pass it reads 12 bytes and writes 8: a graphics card of
/// 3 TB/s can sort 31-bit keys at some 10 G pairs/s, and the ranking takes its share of that.
#[derive(Debug)]
pub(super) struct RadixSort {
    prepare: Kernel,
    count: Kernel,
    scan: Scan,
    scatter: Kernel,
}

/// A sort of certain buffers.
#[derive(Debug)]
pub(super) struct BoundRadixSort {
    /// Keys before and after; four words are bound at a time.
    pub(super) keys: wgpu::Buffer,
    /// Their values.
    pub(super) values: wgpu::Buffer,
    prepare: BoundKernel,
    /// Two of (count, scatter) at a time: there and back.
    passes: Vec<[BoundKernel; 2]>,
    scan: BoundScan,
    arguments: wgpu::Buffer,
}

/// As in `radix.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RadixPlan {
    pub(super) count_index: u32,
    pub(super) capacity: u32,
}

/// What the device knows of a sort, as `radix.wgsl` has it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RadixState {
    /// Pairs.
    pub(super) count: u32,
    /// Workgroups that have any.
    pub(super) groups: u32,
    /// Counts of digits.
    pub(super) table_length: u32,
}

/// Which of its words counts what is summed.
const TABLE_LENGTH: u32 = (offset_of!(RadixState, table_length) / 4) as u32;

impl RadixSort {
    pub(super) fn new(gpu: &Gpu) -> Self {
        use Access::{Read, Uniform, Write};
        let kernel = |entry, bindings: &[Access]| gpu.kernel(&SHADER, entry, bindings, &[]);
        let count = [Uniform, Read, Read, Read, Write];
        let scatter = [Uniform, Read, Read, Read, Write, Write, Write];
        Self {
            prepare: kernel("radix_prepare", &[Uniform, Read, Write, Write]),
            count: kernel("radix_count", &count),
            scan: Scan::new(gpu, TABLE_LENGTH),
            scatter: kernel("radix_scatter", &scatter),
        }
    }

    /// Makes buffers for `capacity` pairs.
    ///
    /// - `counts`, `count_index`: the buffer and which of its words says how many pairs there are.
    /// - `bits`: keys are sorted by as many low bits, and some above where the digits of an even
    ///   number of passes have them.
    ///
    /// # Errors
    /// No memory for the pairs, 16 bytes each.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        counts: &wgpu::Buffer,
        count_index: u32,
        capacity: u64,
        bits: u32,
    ) -> Result<BoundRadixSort> {
        let words = |label| gpu.buffer(label, 4 * capacity.max(1).next_multiple_of(4));
        let (keys, values) = (words("sort keys")?, words("sort values")?);
        let (other_keys, other_values) = (words("sort keys")?, words("sort values")?);
        let table_capacity = capacity.div_ceil(RADIX_GROUP) << RADIX_BITS;
        let table = gpu.buffer("sort counts", 4 * table_capacity)?;
        let state = gpu.buffer("sort state", size_of::<RadixState>() as u64)?;
        let arguments = gpu.buffer("sort arguments", 12)?;
        let plan = RadixPlan {
            count_index,
            capacity: capacity as u32,
        };
        let plan = gpu.uniform("sort plan", &plan)?;
        // The result lands where the input was.
        let pass_count = bits.div_ceil(2 * RADIX_BITS) * 2;
        let passes = (0..pass_count)
            .map(|pass| {
                let shift = gpu.uniform("sort pass", &(RADIX_BITS * pass))?;
                let mut pairs = [(&keys, &values), (&other_keys, &other_values)];
                if pass % 2 == 1 {
                    pairs.reverse();
                }
                let [source, sorted] = pairs;
                let mut buffers = vec![&shift, &state, source.0, source.1, &table];
                let count = self.count.bind(gpu, &buffers);
                buffers.extend([sorted.0, sorted.1]);
                Ok([count, self.scatter.bind(gpu, &buffers)])
            })
            .collect::<Result<_>>()?;
        Ok(BoundRadixSort {
            prepare: self.prepare.bind(gpu, &[&plan, counts, &state, &arguments]),
            passes,
            scan: self.scan.bind(gpu, &state, &table, table_capacity)?,
            arguments,
            keys,
            values,
        })
    }
}

impl BoundRadixSort {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.prepare.dispatch(pass, 1);
        self.scan.encode_length(pass);
        for [count, scatter] in &self.passes {
            count.dispatch_indirect(pass, &self.arguments, 0);
            self.scan.encode_sums(pass);
            scatter.dispatch_indirect(pass, &self.arguments, 0);
        }
    }
}
