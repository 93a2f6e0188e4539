//! Stage: sorts the footprints, front to back.

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::radix::{BoundRadixSort, RadixSort};
use super::shader::{DISPATCH, STRUCTS, Shader};
use crate::constants::DEPTH_KEY_BITS;
use crate::error::Result;
use crate::record::{Footprint, PartIndex, PartRange, SortState};

/// Shader of the stage.
pub(super) const SHADER: Shader = Shader::new(
    "sort",
    &[STRUCTS, DISPATCH, include_str!("../../shaders/sort.wgsl")],
);

/// The pipelines of the stage.
#[derive(Debug)]
pub(super) struct Sort {
    prepare: Kernel,
    keys: Kernel,
    radix: RadixSort,
}

/// The stage with its buffers.
#[derive(Debug)]
pub(super) struct BoundSort {
    /// A [`SortState`].
    pub(super) state: wgpu::Buffer,
    /// A [`PartRange`] per part.
    pub(super) ranges: wgpu::Buffer,
    /// A uniform [`PartIndex`] per part.
    pub(super) parts: Vec<wgpu::Buffer>,
    /// Pairs to be sorted. The sorted values are the footprints' global indices (part after part),
    /// visible ones first, in order of their keys; ties by index.
    pub(super) pairs: BoundRadixSort,
    prepare: BoundKernel,
    keys: Vec<BoundKernel>,
    arguments: wgpu::Buffer,
}

impl Sort {
    pub(super) fn new(gpu: &Gpu) -> Self {
        use Access::{Read, Uniform, Write};
        let kernel = |entry, bindings: &[Access]| gpu.kernel(&SHADER, entry, bindings, &[]);
        Self {
            prepare: kernel("sort_prepare", &[Read, Write, Write, Write]),
            keys: kernel("sort_keys", &[Uniform, Read, Read, Write, Write, Write]),
            radix: RadixSort::new(gpu),
        }
    }

    /// Binds the parts' footprints, and the buffer with the number of each part's footprints, a word per
    /// part. All parts together have at most `capacity`.
    ///
    /// # Errors
    /// No memory for keys and indices.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        counts: &wgpu::Buffer,
        footprints: &[&wgpu::Buffer],
        capacity: u64,
    ) -> Result<BoundSort> {
        let part_count = footprints.len().max(1) as u64;
        let state = gpu.buffer("sort state", size_of::<SortState>() as u64)?;
        let ranges = gpu.buffer("part ranges", size_of::<PartRange>() as u64 * part_count)?;
        let arguments = gpu.buffer("sort arguments", 12 * part_count)?;
        // The state's first word is the count. One bit more than depths have, for the key of invisible
        // footprints.
        let bits = DEPTH_KEY_BITS + 1;
        let pairs = self.radix.bind(gpu, &state, 0, capacity, bits)?;
        let parts = (0..footprints.len() as u32)
            .map(|index| gpu.uniform("part", &PartIndex { index }))
            .collect::<Result<Vec<_>>>()?;
        let keys = parts.iter().zip(footprints).map(|(part, footprints)| {
            let buffers = [
                part,
                &ranges,
                footprints,
                &pairs.keys,
                &pairs.values,
                &state,
            ];
            self.keys.bind(gpu, &buffers)
        });
        Ok(BoundSort {
            prepare: self
                .prepare
                .bind(gpu, &[counts, &state, &ranges, &arguments]),
            keys: keys.collect(),
            state,
            ranges,
            parts,
            pairs,
            arguments,
        })
    }
}

impl BoundSort {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.prepare.dispatch(pass, 1);
        for (offset, keys) in (0..).step_by(12).zip(&self.keys) {
            keys.dispatch_indirect(pass, &self.arguments, offset);
        }
        self.pairs.encode(pass);
    }
}

/// Sorts the visible footprints, with the result of [`crate::cpu::sort`]: keys in the high halves of the
/// words, indices in the low ones. The footprints are given in parts, one after the other.
///
/// # Errors
/// No memory, or a lost device.
pub fn sort(gpu: &Gpu, parts: &[&[Footprint]]) -> Result<Vec<u64>> {
    let counts: Vec<u32> = parts.iter().map(|p| p.len() as u32).collect();
    let counts = gpu.upload("part counts", &counts)?;
    let footprints = parts.iter().map(|p| gpu.upload("footprints", p));
    let footprints = footprints.collect::<Result<Vec<_>>>()?;
    let footprints: Vec<_> = footprints.iter().collect();
    let capacity = parts.iter().map(|p| p.len() as u64).sum();
    let sort = Sort::new(gpu).bind(gpu, &counts, &footprints, capacity)?;
    gpu.run(|pass| sort.encode(pass));
    let state: Vec<SortState> = gpu.read(&sort.state, 1)?;
    let visible = state[0].visible as usize;
    let keys: Vec<u32> = gpu.read(&sort.pairs.sorted_keys, visible)?;
    let values: Vec<u32> = gpu.read(&sort.pairs.sorted_values, visible)?;
    let words = keys.into_iter().zip(values);
    Ok(words
        .map(|(key, value)| u64::from(key) << 32 | u64::from(value))
        .collect())
}
