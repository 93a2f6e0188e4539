//! Stage: lists the footprints of a chunk that touch each tile of a band, in depth order.

use std::mem::offset_of;

use bytemuck::{Zeroable, bytes_of, cast_slice};

use super::constants::THREADS;
use super::device::Gpu;
use super::gather::{BoundGather, Gather, Terms};
use super::kernel::{Access, BoundKernel, Kernel};
use super::radix::{BoundRadixSort, RadixSort};
use super::scan::{BoundScan, Scan};
use super::shader::{DISPATCH, FLOATS, STRUCTS, Shader};
use super::sort::Sort;
use crate::error::Result;
use crate::record::{ChunkState, ChunkUniform, Footprint, FootprintTerms, PartRange, SortState};

/// Shader of the stage.
pub(super) const SHADER: Shader = Shader::new(
    "bin",
    &[
        STRUCTS,
        DISPATCH,
        FLOATS,
        include_str!("../../shaders/shared/outline.wgsl"),
        include_str!("../../shaders/bin.wgsl"),
    ],
);

/// The pipelines of the stage.
#[derive(Debug)]
pub(super) struct Bin {
    walk: Kernel,
    scan: Scan,
    prepare: Kernel,
    radix: RadixSort,
    ranges: Kernel,
}

/// The stage with its buffers.
#[derive(Debug)]
pub(super) struct BoundBin {
    /// Pairs to be sorted. The sorted values are the footprints of the tiles' lists, as indices in the
    /// chunk.
    pub(super) entries: BoundRadixSort,
    /// First and one-past-last entry of every tile of the band, row by row.
    pub(super) ranges: wgpu::Buffer,
    count: BoundKernel,
    scan: BoundScan,
    prepare: BoundKernel,
    emit: BoundKernel,
    find_ranges: BoundKernel,
    /// Dispatch arguments of the chunk, and of the kernels that depend on its entries.
    chunk_arguments: wgpu::Buffer,
    arguments: wgpu::Buffer,
}

/// Greatest number of tiles of a band. If all 256 footprints of a workgroup are large, each of its
/// threads runs one loop iteration per footprint and 256 tiles, plus one per footprint. llvmpipe silently
/// ends all loops of a thread after 65,535 iterations.
pub const MAX_BAND_TILES: u32 = 254 * THREADS;

/// Words of the members of a [`ChunkState`].
const OFFSET_COUNT: u32 = (offset_of!(ChunkState, offset_count) / 4) as u32;
const ENTRIES: u32 = (offset_of!(ChunkState, entries) / 4) as u32;

impl Bin {
    /// Makes the pipelines.
    ///
    /// - `exact`: whether footprints have exact terms, or other terms in their place.
    pub(super) fn new(gpu: &Gpu, exact: bool) -> Self {
        use Access::{Read, Uniform, Write};
        let kernel = |entry, bindings: &[Access], constants: &[(&str, f64)]| {
            gpu.kernel(&SHADER, entry, bindings, constants)
        };
        let walk = [
            Uniform, Uniform, Read, Read, Read, Write, Write, Write, Read,
        ];
        let exact = [("EXACT", f64::from(u8::from(exact)))];
        Self {
            walk: kernel("bin_walk", &walk, &exact),
            scan: Scan::new(gpu, OFFSET_COUNT),
            prepare: kernel("bin_prepare", &[Uniform, Uniform, Read, Write, Write], &[]),
            radix: RadixSort::new(gpu),
            ranges: kernel("bin_ranges", &[Uniform, Read, Read, Write], &[]),
        }
    }

    /// Makes buffers for lists with `capacity` entries.
    ///
    /// - `chunk`: the uniform [`ChunkUniform`] of `gather`.
    /// - `chunk_capacity`: greatest number of footprints in `gather`.
    /// - `tiles`: greatest number of tiles of a band, [`MAX_BAND_TILES`] or fewer.
    /// - `drawn`: a word for each tile of the picture, 1 if it is drawn; `None` if all are.
    ///
    /// # Errors
    /// No memory for the entries, 16 bytes each.
    #[allow(
        clippy::too_many_arguments,
        reason = "a stage takes the buffers it reads and their sizes"
    )]
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        chunk: &wgpu::Buffer,
        gather: &BoundGather,
        chunk_capacity: u64,
        tiles: u32,
        capacity: u64,
        drawn: Option<&wgpu::Buffer>,
    ) -> Result<BoundBin> {
        let all = gpu.buffer("all tiles", 0)?;
        let offset_count = chunk_capacity + 1;
        let offsets = gpu.buffer("entry offsets", 4 * offset_count)?;
        let ranges = gpu.buffer("tile ranges", 8 * u64::from(tiles.max(1)))?;
        let arguments = gpu.buffer("bin arguments", 24)?;
        // As many bits as the number of the last tile has.
        let bits = u32::BITS - tiles.saturating_sub(1).leading_zeros();
        let state = &gather.state;
        let entries = self.radix.bind(gpu, state, ENTRIES, capacity, bits)?;
        let walk = |emit: u32| -> Result<BoundKernel> {
            let step = gpu.uniform("bin step", &[emit, u32::from(drawn.is_some())])?;
            let buffers = [
                chunk,
                &step,
                state,
                &gather.footprints,
                &gather.exact,
                &offsets,
                &entries.keys,
                &entries.values,
                drawn.unwrap_or(&all),
            ];
            Ok(self.walk.bind(gpu, &buffers))
        };
        let entry_capacity = gpu.uniform("entry capacity", &(capacity as u32))?;
        Ok(BoundBin {
            count: walk(0)?,
            scan: self.scan.bind(gpu, state, &offsets, offset_count)?,
            prepare: self
                .prepare
                .bind(gpu, &[chunk, &entry_capacity, &offsets, state, &arguments]),
            emit: walk(1)?,
            find_ranges: self
                .ranges
                .bind(gpu, &[chunk, &entries.sorted_keys, state, &ranges]),
            entries,
            ranges,
            chunk_arguments: gather.arguments.clone(),
            arguments,
        })
    }
}

impl BoundBin {
    /// Offset in bytes, in the arguments, of the dispatch with a thread per tile.
    const TILES: u64 = 12;

    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.count
            .dispatch_indirect(pass, &self.chunk_arguments, BoundGather::WALK);
        self.scan.encode(pass);
        self.prepare.dispatch(pass, 1);
        self.emit.dispatch_indirect(pass, &self.arguments, 0);
        self.entries.encode(pass);
        self.find_ranges
            .dispatch_indirect(pass, &self.arguments, Self::TILES);
    }
}

/// The lists of a chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct ChunkBins {
    /// Number of entries that the lists need. If it exceeds the capacity, all lists are empty.
    pub needed: u32,
    /// Footprints of every tile of the band, row by row: indices among the footprints of all parts, front
    /// to back.
    pub tiles: Vec<Vec<u32>>,
}

/// Makes the lists of the tiles of bands for chunks of the sorted footprints: those of
/// [`crate::cpu::bin`], restricted to both. The chunks use the same buffers one after the other, as in a
/// frame.
///
/// - `parts`: footprints, one part after the other; terms of kernels for all parts or none.
/// - `order`: as `sort` writes it.
/// - `chunks`: bands of [`MAX_BAND_TILES`] at most.
/// - `capacity`: greatest number of entries of one chunk.
///
/// # Errors
/// No memory, or a lost device.
pub fn bin(
    gpu: &Gpu,
    parts: &[(&[Footprint], FootprintTerms<'_>)],
    order: &[u64],
    chunks: &[ChunkUniform],
    capacity: u64,
) -> Result<Vec<ChunkBins>> {
    let has_exact = parts.iter().any(|(_, terms)| !terms.exact().is_empty());
    let has_surfels = parts.iter().any(|(_, terms)| !terms.surfel().is_empty());
    let terms = if has_surfels {
        Terms::OfAll
    } else {
        Terms::exact(has_exact)
    };
    let has_terms = has_exact || has_surfels;
    let upload = |(footprints, terms): &(&[Footprint], FootprintTerms<'_>)| {
        let footprints = gpu.upload("footprints", footprints)?;
        let words: &[u8] = match terms {
            FootprintTerms::None => &[],
            FootprintTerms::Exact(terms) => cast_slice(terms),
            FootprintTerms::Surfel(terms) => cast_slice(terms),
        };
        Ok((footprints, gpu.upload("terms", words)?))
    };
    let uploaded = parts.iter().map(upload).collect::<Result<Vec<_>>>()?;
    let footprints: Vec<_> = uploaded.iter().map(|(f, _)| f).collect();
    let gathered: Vec<_> = uploaded
        .iter()
        .map(|(f, e)| (f, has_terms.then_some(e)))
        .collect();
    // The state that the sort leaves behind.
    let counts: Vec<u32> = parts.iter().map(|(f, _)| f.len() as u32).collect();
    let mut count = 0;
    let ranges = counts.iter().map(|&of_part| {
        let first = count;
        count += of_part;
        PartRange {
            first,
            count: of_part,
        }
    });
    let ranges: Vec<_> = ranges.collect();
    let visible = order.len() as u32;
    let order: Vec<u32> = order.iter().map(|&word| word as u32).collect();
    let counts = gpu.upload("part counts", &counts)?;
    let sort = Sort::new(gpu).bind(gpu, &counts, &footprints, u64::from(count))?;
    gpu.write(&sort.ranges, cast_slice(&ranges));
    gpu.write(
        &sort.state,
        bytes_of(&SortState {
            count,
            visible,
            exact: 0,
        }),
    );
    gpu.write(&sort.pairs.sorted_values, cast_slice(&order));

    let tile_count = |chunk: &ChunkUniform| chunk.band_size[0] * chunk.band_size[1];
    let tiles = chunks.iter().map(tile_count).max().unwrap_or(0);
    let chunk_capacity = chunks.iter().map(|c| c.capacity).max().unwrap_or(0).into();
    let uniform = gpu.uniform("chunk", &<ChunkUniform as Zeroable>::zeroed())?;
    let gather = Gather::new(gpu, terms).bind(gpu, &uniform, &sort, &gathered, chunk_capacity)?;
    let bin = Bin::new(gpu, has_terms);
    let bin = bin.bind(
        gpu,
        &uniform,
        &gather,
        chunk_capacity,
        tiles,
        capacity,
        None,
    )?;

    let binned = chunks.iter().map(|chunk| {
        gpu.write(&uniform, bytes_of(chunk));
        gpu.write(&gather.state, bytes_of(&<ChunkState as Zeroable>::zeroed()));
        gpu.run(|pass| {
            gather.encode(pass);
            bin.encode(pass);
        });
        let state: Vec<ChunkState> = gpu.read(&gather.state, 1)?;
        let ranges: Vec<[u32; 2]> = gpu.read(&bin.ranges, tile_count(chunk) as usize)?;
        let places: Vec<u32> = gpu.read(&bin.entries.sorted_values, state[0].entries as usize)?;
        let list = |&[first, end]: &[u32; 2]| {
            let places = &places[first as usize..end as usize];
            let index = |&k: &u32| order[(chunk.start + k) as usize];
            places.iter().map(index).collect()
        };
        Ok(ChunkBins {
            needed: state[0].needed,
            tiles: ranges.iter().map(list).collect(),
        })
    });
    binned.collect()
}
