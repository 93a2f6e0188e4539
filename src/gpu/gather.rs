//! Stage: copies a chunk of the sorted footprints to consecutive memory, in depth order. The buffers of
//! one chunk bound the number of footprints, whatever the scene's size.

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shader::{DISPATCH, STRUCTS, Shader};
use super::sort::BoundSort;
use crate::error::Result;
use crate::record::{ChunkState, ExactTerms, Footprint};

/// The footprints that have [`ExactTerms`], or other terms in their place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Terms {
    None,
    /// The footprints on the exact path.
    OfExact,
    OfAll,
}

impl Terms {
    /// Returns the terms of the exact path, if footprints may be on it.
    pub(super) fn exact(may_be_exact: bool) -> Self {
        if may_be_exact {
            Self::OfExact
        } else {
            Self::None
        }
    }
}

/// Shader of the stage.
pub(super) const SHADER: Shader = Shader::new(
    "gather",
    &[STRUCTS, DISPATCH, include_str!("../../shaders/gather.wgsl")],
);

/// The pipelines of the stage.
#[derive(Debug)]
pub(super) struct Gather {
    prepare: Kernel,
    gather: Kernel,
}

/// The stage with its buffers.
#[derive(Debug)]
pub(super) struct BoundGather {
    /// A [`ChunkState`]. A reader of its `needed` must clear it beforehand.
    pub(super) state: wgpu::Buffer,
    /// The chunk's footprints in depth order.
    pub(super) footprints: wgpu::Buffer,
    /// Their exact terms, or a single placeholder.
    pub(super) exact: wgpu::Buffer,
    /// Arguments of a dispatch of one thread per footprint, at [`Self::WALK`].
    pub(super) arguments: wgpu::Buffer,
    prepare: BoundKernel,
    parts: Vec<BoundKernel>,
}

impl Gather {
    /// Makes the pipelines.
    ///
    /// - `terms`: the footprints that have exact terms.
    pub(super) fn new(gpu: &Gpu, terms: Terms) -> Self {
        use Access::{Read, Uniform, Write};
        let kernel = |entry, bindings: &[Access], constants: &[(&str, f64)]| {
            gpu.kernel(&SHADER, entry, bindings, constants)
        };
        let bindings = [Uniform, Uniform, Read, Read, Read, Read, Read, Write, Write];
        let flag = |is: bool| f64::from(u8::from(is));
        let exact = [
            ("EXACT", flag(terms != Terms::None)),
            ("IS_OF_ALL", flag(terms == Terms::OfAll)),
        ];
        Self {
            prepare: kernel("gather_prepare", &[Uniform, Read, Write, Write], &[]),
            gather: kernel("gather", &bindings, &exact),
        }
    }

    /// Makes buffers for `capacity` footprints.
    ///
    /// - `chunk`: a uniform [`crate::record::ChunkUniform`] of at most that capacity.
    /// - `parts`: footprints of each part of the sort; exact terms if there are any.
    ///
    /// # Errors
    /// No memory for the chunk.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        chunk: &wgpu::Buffer,
        sort: &BoundSort,
        parts: &[(&wgpu::Buffer, Option<&wgpu::Buffer>)],
        capacity: u64,
    ) -> Result<BoundGather> {
        let any_exact = parts.iter().any(|(_, exact)| exact.is_some());
        let exact_capacity = if any_exact { capacity.max(1) } else { 1 };
        let footprint_bytes = size_of::<Footprint>() as u64 * capacity.max(1);
        let exact_bytes = size_of::<ExactTerms>() as u64 * exact_capacity;
        let footprints = gpu.buffer("sorted footprints", footprint_bytes)?;
        let exact = gpu.buffer("sorted exact terms", exact_bytes)?;
        let none = gpu.buffer("no exact terms", size_of::<ExactTerms>() as u64)?;
        let state = gpu.upload(
            "chunk state",
            &[<ChunkState as bytemuck::Zeroable>::zeroed()],
        )?;
        let arguments = gpu.buffer("chunk arguments", 24)?;
        let parts = sort.parts.iter().zip(parts).map(|(part, of_part)| {
            let buffers = [
                part,
                chunk,
                &state,
                &sort.ranges,
                &sort.pairs.sorted_values,
                of_part.0,
                of_part.1.unwrap_or(&none),
                &footprints,
                &exact,
            ];
            self.gather.bind(gpu, &buffers)
        });
        Ok(BoundGather {
            prepare: self
                .prepare
                .bind(gpu, &[chunk, &sort.state, &state, &arguments]),
            parts: parts.collect(),
            state,
            footprints,
            exact,
            arguments,
        })
    }
}

impl BoundGather {
    /// Offset in bytes, in the arguments, of the dispatch with a thread per footprint.
    pub(super) const WALK: u64 = 12;

    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.prepare.dispatch(pass, 1);
        for gather in &self.parts {
            gather.dispatch_indirect(pass, &self.arguments, 0);
        }
    }
}
