//! Keeps a scene on the device. Volumes are divided into parts: runs of whole blocks whose every buffer
//! fits a binding.

use std::borrow::Cow;
use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::device::Gpu;
use super::kinds::{Kinds, ValueKind};
use super::packed::rotation_uniform;
use super::particles::{lattice_uniform, pack_blocks, pack_shapes};
use crate::blocks::{BlockedParticles, BlockedVolume, MergedTransfer};
use crate::constants::{BLOCK_CAPACITY, CLASSIFICATION_TABLE_LEN};
use crate::error::{Error, Hint, Result};
use crate::record::{
    BlockView, BrickUniform, CameraUniform, ClassifiedBy, ClassifiedParticle, FrameState,
    LightingUniform, PartState, PieceTerms, ShadowUniform, ViewUniform,
};
use crate::scene::{
    ColourIn, LobeRow, Lobes, MAX_LOBE_CELLS, MAX_LOBE_ROWS, MAX_LOBES, MAX_WINDOW_CELLS,
    MAX_WINDOWS, StrengthIn, TransferFunction, ValuesIn,
};

/// A run of a volume's blocks on the device.
#[derive(Debug)]
pub(super) struct Part {
    /// Index of the volume in the scene, levels of detail included.
    pub(super) volume: usize,
    /// Index of the volume without levels of detail; parts of one family share a transfer function.
    family: usize,
    /// Range of its blocks.
    pub(super) run: Range<usize>,
    pub(super) kinds: Kinds,
    /// Number of entries of arrays with one entry per particle, including padding for bricks beyond a
    /// lattice's edge.
    pub(super) slots: usize,
    pub(super) blocks: wgpu::Buffer,
    /// For merged particles: the first block's index among the merged blocks of the scene, and
    /// [`MergeBounds`](crate::blocks::MergeBounds).
    pub(super) merged: wgpu::Buffer,
    /// A lattice's [`LatticeUniform`](crate::record::LatticeUniform).
    pub(super) lattice: wgpu::Buffer,
    /// Offset and shape of each particle, or the samples of a lattice's axes.
    pub(super) shapes: wgpu::Buffer,
    pub(super) bricks: wgpu::Buffer,
    pub(super) values: wgpu::Buffer,
    pub(super) strengths: wgpu::Buffer,
    /// The volume that all cells of a uniform lattice share; 0 otherwise.
    pub(super) cell_volume: f64,
    pub(super) colours: wgpu::Buffer,
    /// Codes of normals, if they are stored.
    pub(super) normals: wgpu::Buffer,
    /// The transfer function's table, its averages and its lobes; all parts of a family share it.
    pub(super) table: wgpu::Buffer,
    /// Start of the lobes in the table, if kernels may be classified over their extents.
    pub(super) lobes_first: Option<u32>,
    /// The transfer function's greatest extinctions and slopes; all parts of a family share it.
    pub(super) maxima: wgpu::Buffer,
}

impl Part {
    /// Returns whether its particles are pieces of kernels.
    ///
    /// - `by`: rule that classifies kernels which need more than their values.
    pub(super) fn has_pieces(&self, by: ClassifiedBy) -> bool {
        by == ClassifiedBy::Extent && self.lobes_first.is_some()
    }

    /// Returns the greatest possible number of classified particles.
    pub(super) fn most_classified(&self) -> u64 {
        let pieces = if self.lobes_first.is_some() {
            MAX_WINDOWS
        } else {
            1
        };
        (self.slots * pieces) as u64
    }
}

/// All volumes on the device.
#[derive(Debug)]
pub(super) struct Scene {
    /// In the order of the volumes, and of the blocks in each.
    pub(super) parts: Vec<Part>,
}

impl Scene {
    /// Uploads volumes, each followed by its levels of detail, in parts. The buffers of a part have at
    /// most `part_bytes`, and at most the limit of a binding.
    ///
    /// - `is_drawn`: whether to upload a volume; its levels of detail follow it.
    ///
    /// # Errors
    /// No memory, or volumes that only the CPU draws: harmonics on a lattice.
    pub(super) fn new(
        gpu: &Gpu,
        volumes: &[BlockedVolume],
        is_drawn: impl Fn(&BlockedVolume) -> bool,
        part_bytes: u64,
    ) -> Result<Self> {
        let part_bytes = part_bytes.min(gpu.max_binding_bytes());
        let mut parts = Vec::new();
        let mut place = Place::default();
        for family in volumes.chunk_by(|_, next| next.merged.is_some()) {
            if !is_drawn(&family[0]) {
                place.volume += family.len();
                place.family += 1;
                continue;
            }
            let tables = Tables::new(gpu, family)?;
            let is_merged = family.iter().any(|v| v.merged.is_some());
            place.parents = is_merged.then_some(place.first_merged);
            for volume in family {
                upload(gpu, place, volume, &tables, part_bytes, &mut parts)?;
                place.volume += 1;
                if volume.merged.is_some() {
                    place.first_merged += volume.blocks.len() as u32;
                }
            }
            place.family += 1;
        }
        Ok(Self { parts })
    }

    /// Returns the parts that a frame may draw, each with its item of `of_parts`.
    ///
    /// - `detail`: whether merged particles may be drawn.
    pub(super) fn drawn<T>(
        &self,
        of_parts: impl IntoIterator<Item = T>,
        detail: bool,
    ) -> impl Iterator<Item = (&Part, T)> {
        let parts = self.parts.iter().zip(of_parts);
        parts.filter(move |(part, _)| detail || !part.kinds.is_merged)
    }

    /// Replaces the transfer function of a volume; only its tables are uploaded.
    pub(super) fn set_transfer_function(&self, gpu: &Gpu, volume: usize, family: &[BlockedVolume]) {
        // The parts of a family share their tables.
        let part = self.parts.iter().find(|p| p.family == volume);
        if let (Some(part), Some((table, maxima))) = (part, packed(family)) {
            gpu.write(&part.table, bytemuck::cast_slice(&table));
            gpu.write(&part.maxima, bytemuck::cast_slice(&maxima));
        }
    }
}

/// Position of a volume in the scene.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    volume: usize,
    family: usize,
    /// Number of merged blocks of the volumes before.
    first_merged: u32,
    /// Index of its family's first merged block, if there are any.
    parents: Option<u32>,
}

/// The tables of a transfer function on the device.
#[derive(Debug)]
struct Tables {
    table: wgpu::Buffer,
    lobes_first: u32,
    maxima: wgpu::Buffer,
}

impl Tables {
    /// Makes the tables of a volume and its levels of detail, which share its classification.
    fn new(gpu: &Gpu, family: &[BlockedVolume]) -> Result<Self> {
        let (mut table, mut maxima) = packed(family).unwrap_or_default();
        // The least size that shaders declare.
        maxima.resize(maxima.len().max(MAXIMA_HEADER + 1), 0.0);
        if family[0].may_have_pieces() {
            // Space for the lobes of any function.
            let headers = 1 + 3 * MAX_LOBES + 3 * MAX_WINDOWS;
            let lobes = headers + MAX_LOBE_ROWS + MAX_LOBE_CELLS + MAX_WINDOW_CELLS;
            table.resize(lobes_first(family) as usize + lobes, [0; 4]);
        }
        Ok(Self {
            lobes_first: lobes_first(family),
            table: gpu.upload("transfer function", &table)?,
            maxima: gpu.upload("transfer function's maxima", &maxima)?,
        })
    }
}

fn upload(
    gpu: &Gpu,
    place: Place,
    volume: &BlockedVolume,
    tables: &Tables,
    part_bytes: u64,
    parts: &mut Vec<Part>,
) -> Result<()> {
    let kinds = Kinds::of(volume);
    if kinds.is_lattice() && kinds.harmonics_count > 0 {
        return Err(Error::Unsupported {
            place: "harmonics on a lattice".into(),
            expected: "harmonics on points".into(),
            found: "a lattice".into(),
            advice: Hint::UseCpu.into(),
        });
    }
    // Placeholder for bindings without data.
    let nothing = gpu.buffer("nothing", 0)?;
    let merged = volume.merged.as_ref();
    let spreads = merged.map_or(&[][..], |m| &m.spreads);
    let member_depths = merged.map_or(&[][..], |m| &m.member_depths);
    let may_have_pieces = volume.may_have_pieces();
    let capacity = part_bytes / kinds.bytes_per_particle(may_have_pieces);
    for run in runs(volume, kinds.is_lattice(), capacity) {
        let particles = particles(volume, &run);
        let slots = if kinds.is_lattice() {
            BLOCK_CAPACITY * run.len()
        } else {
            particles.len()
        };
        // The values include those of the bricks around, so that differences between neighbours have both
        // operands.
        let with_values = match &volume.particles {
            BlockedParticles::Lattice(grid) if may_have_pieces => {
                let [x, y, _] = grid.bricks();
                let around = x * y + x + 1;
                let end = (run.end + around).min(volume.blocks.len());
                run.start.saturating_sub(around)..end
            }
            _ => run.clone(),
        };
        let per_particle = |label, source: &[f32], stride| {
            gpu.upload(label, &in_block_order(volume, &run, source, stride))
        };
        let pairs = |label, firsts: &[f32], seconds: &[f32]| {
            let pairs: Vec<[f32; 2]> = firsts.iter().zip(seconds).map(|(a, b)| [*a, *b]).collect();
            gpu.upload(label, &in_block_order(volume, &run, &pairs, 1))
        };
        let values = match &volume.values {
            Some(ValuesIn::F32(v)) if kinds.values == ValueKind::Spread => {
                pairs("values and spreads", v, spreads)?
            }
            Some(values) if kinds.values != ValueKind::None => match values {
                ValuesIn::U8(v) => upload_values(gpu, volume, &with_values, v)?,
                ValuesIn::I16(v) => upload_values(gpu, volume, &with_values, v)?,
                ValuesIn::U16(v) => upload_values(gpu, volume, &with_values, v)?,
                ValuesIn::F32(v) => upload_values(gpu, volume, &with_values, v)?,
                ValuesIn::F64(_) => {
                    let narrow: Vec<f32> = (0..values.len()).map(|i| values.get(i)).collect();
                    upload_values(gpu, volume, &with_values, &narrow)?
                }
            },
            _ => nothing.clone(),
        };
        let strengths = match (&volume.strength, cells(volume)) {
            (StrengthIn::Classified { .. }, Some(cells)) => gpu.upload("cell widths", &cells)?,
            (strength, _) => {
                let given = strength.stored();
                if kinds.has_member_depths {
                    pairs("strengths and member depths", given, member_depths)?
                } else if let (true, Some(models)) = (may_have_pieces, &volume.local_models) {
                    let mut words: Vec<u32> =
                        bytemuck::cast_slice(&given[particles.clone()]).to_vec();
                    let codes = bytemuck::cast_slice::<_, u16>(&models.codes()[particles.clone()]);
                    words.extend(codes.chunks(2).map(|pair| {
                        let high = pair.get(1).copied().unwrap_or(0);
                        u32::from(pair[0]) | u32::from(high) << 16
                    }));
                    gpu.upload("strengths and local models", &words)?
                } else {
                    per_particle("strengths", given, 1)?
                }
            }
        };
        let colours = match &volume.colour {
            ColourIn::Classified => nothing.clone(),
            ColourIn::PerParticle(colours) => {
                per_particle("colours", bytemuck::cast_slice(colours), 3)?
            }
            ColourIn::Uniform(colour) => gpu.upload("colour", colour)?,
            ColourIn::Harmonics { coefficients, .. } => {
                let stride = 3 * kinds.harmonics_count as usize;
                per_particle("harmonics", coefficients, stride)?
            }
        };
        let normals = match &volume.normals {
            Some(codes) if kinds.is_lit => {
                gpu.upload("normals", &in_block_order(volume, &run, codes, 1))?
            }
            _ => nothing.clone(),
        };
        let bricks = BrickUniform {
            dims: match &volume.particles {
                BlockedParticles::Lattice(grid) => grid.dims().map(|n| n as u32),
                _ => [0; 3],
            },
            first: run.start as u32,
            values_first: with_values.start as u32,
            kernel_width: match &volume.particles {
                BlockedParticles::Lattice(grid) => grid.kernel_width() as f32,
                _ => 0.0,
            },
            models_first: particles.len() as u32,
            model_scales: volume
                .local_models
                .as_ref()
                .map_or([0.0; 2], |models| models.scales()),
            ..BrickUniform::default()
        };
        parts.push(Part {
            volume: place.volume,
            family: place.family,
            kinds,
            slots,
            blocks: gpu.upload("blocks", &pack_blocks(volume, run.clone(), place.parents))?,
            merged: match merged {
                Some(merged) => {
                    let mut words = vec![place.first_merged + run.start as u32];
                    words.extend_from_slice(bytemuck::cast_slice(&merged.bounds[run.clone()]));
                    gpu.upload("bounds of merged blocks", &words)?
                }
                None => nothing.clone(),
            },
            lattice: match &volume.particles {
                BlockedParticles::Lattice(grid) => {
                    gpu.upload("lattice", &[lattice_uniform(grid, run.start)])?
                }
                _ => nothing.clone(),
            },
            shapes: gpu.upload("shapes", &pack_shapes(volume, run.clone()))?,
            bricks: gpu.uniform("bricks", &bricks)?,
            values,
            strengths,
            cell_volume: match &volume.particles {
                BlockedParticles::Lattice(grid) if grid.axes().is_none() => {
                    grid.cell_volume_f64([0; 3])
                }
                _ => 0.0,
            },
            colours,
            normals,
            table: tables.table.clone(),
            lobes_first: may_have_pieces.then_some(tables.lobes_first),
            maxima: tables.maxima.clone(),
            run,
        });
    }
    Ok(())
}

/// Uploads the values of a run of blocks.
fn upload_values<T: Pod + Send + Sync>(
    gpu: &Gpu,
    volume: &BlockedVolume,
    run: &Range<usize>,
    values: &[T],
) -> Result<wgpu::Buffer> {
    gpu.upload("values", &in_block_order(volume, run, values, 1))
}

/// Divides a volume into runs of whole blocks, of at most `capacity` particles or of one block.
fn runs(volume: &BlockedVolume, is_lattice: bool, capacity: u64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let (mut start, mut slots) = (0, 0);
    for (i, block) in volume.blocks.iter().enumerate() {
        let own = if is_lattice {
            BLOCK_CAPACITY as u64
        } else {
            block.count.into()
        };
        if slots + own > capacity && i > start {
            runs.push(start..i);
            (start, slots) = (i, 0);
        }
        slots += own;
    }
    if start < volume.blocks.len() {
        runs.push(start..volume.blocks.len());
    }
    runs
}

/// Returns the range of the particles of a run of blocks of points.
fn particles(volume: &BlockedVolume, run: &Range<usize>) -> Range<usize> {
    let (first, last) = (&volume.blocks[run.start], &volume.blocks[run.end - 1]);
    first.first as usize..(last.first + last.count) as usize
}

/// Returns the entries of `source` for the particles of some blocks, `stride` entries each. Those of a
/// lattice are ordered brick by brick, with zeros for cells beyond its edge.
fn in_block_order<'a, T: Pod + Send + Sync>(
    volume: &BlockedVolume,
    run: &Range<usize>,
    source: &'a [T],
    stride: usize,
) -> Cow<'a, [T]> {
    if !matches!(volume.particles, BlockedParticles::Lattice(_)) {
        let particles = particles(volume, run);
        return Cow::Borrowed(&source[particles.start * stride..particles.end * stride]);
    }
    let mut out = vec![T::zeroed(); BLOCK_CAPACITY * stride * run.len()];
    out.par_chunks_exact_mut(BLOCK_CAPACITY * stride)
        .zip(run.clone())
        .for_each(|(brick, block)| {
            volume.for_each_particle(block as u32, |local, i, _| {
                brick[local as usize * stride..][..stride]
                    .copy_from_slice(&source[i * stride..][..stride]);
            });
        });
    Cow::Owned(out)
}

/// Returns the volume that all of a lattice's cells share. For a rectilinear lattice: the widths of its
/// cells along x, y and z, one after the other, and then the change of the spacing at each.
fn cells(volume: &BlockedVolume) -> Option<Vec<f32>> {
    let BlockedParticles::Lattice(grid) = &volume.particles else {
        return None;
    };
    Some(match grid.axes() {
        None => grid.uniform_volume().into_iter().collect(),
        Some(axes) => {
            let samples = || axes.iter().flatten();
            let extents = samples().map(|sample| sample.extent);
            extents.chain(samples().map(|sample| sample.bend)).collect()
        }
    })
}

/// Returns the tables of a volume and its levels of detail; `None` if nothing is classified.
fn packed(family: &[BlockedVolume]) -> Option<(Vec<[u32; 4]>, Vec<f32>)> {
    let base = family.first()?;
    let transfer = base.transfer_function.as_ref()?;
    // The levels share it.
    let level = family.iter().find_map(|volume| volume.merged.as_ref());
    let merged = level.and_then(|level| level.transfer.as_deref());
    let is_classified = Kinds::of(base).values != ValueKind::None;
    is_classified.then(|| {
        let lobes = base.lobes.as_deref();
        let mut table = packed_table(transfer, merged);
        if base.may_have_pieces() {
            pack_lobes(lobes, &mut table);
        }
        (table, packed_maxima(transfer, merged, lobes))
    })
}

/// Packs a table: its start, entries per unit and units of the integrals; the entries; the integrals, if
/// there are merged particles.
pub(super) fn packed_table(
    transfer: &TransferFunction,
    merged: Option<&MergedTransfer>,
) -> Vec<[u32; 4]> {
    let (integrals, [colour_unit, extinction_unit]) =
        merged.map_or((&[][..], [0.0; 2]), |m| m.averages.integrals());
    let header = [
        transfer.range()[0],
        transfer.scale(),
        colour_unit,
        extinction_unit,
    ];
    let mut packed = vec![header.map(f32::to_bits)];
    packed.extend(transfer.table().iter().map(|entry| entry.map(f32::to_bits)));
    packed.extend(integrals.iter().map(|sum| sum.map(i32::cast_unsigned)));
    packed
}

/// Returns the start of the lobes in the table of a family, in words of four.
fn lobes_first(family: &[BlockedVolume]) -> u32 {
    let has_averages = family.iter().any(|volume| {
        let merged = volume.merged.as_ref();
        merged.is_some_and(|merged| merged.transfer.is_some())
    });
    CLASSIFICATION_TABLE_LEN as u32 * if has_averages { 2 } else { 1 }
}

/// Appends lobes to a table in the layout of `shaders/shared/lobes.wgsl`, with the rows and cells that
/// are used.
fn pack_lobes(lobes: Option<&Lobes>, table: &mut Vec<[u32; 4]>) {
    let Some(lobes) = lobes else {
        table.push([0; 4]);
        return;
    };
    table.push([lobes.lobes.len() as u32, 0, 0, 0]);
    let windows = table.len() + 3 * MAX_LOBES;
    let rows = windows + 3 * MAX_WINDOWS;
    for lobe in &lobes.lobes {
        let ([lo, hi], [below, above]) = (lobe.interval, lobe.beyond);
        table.push([lo, hi, below, above].map(f32::to_bits));
        let sizes = [finite(lobe.threshold), lobe.first_spread, lobe.peak, 0.0];
        table.push(sizes.map(f32::to_bits));
        table.push([lobe.first_window, lobe.window_count, 0, 0]);
    }
    table.resize(windows, [0; 4]);
    for window in &lobes.windows {
        let ([lo, hi], [below, above]) = (window.interval, window.beyond);
        table.push([lo, hi, below, above].map(f32::to_bits));
        let [before, after] = window.reach;
        table.push([before, after, 0.0, 0.0].map(f32::to_bits));
        table.push([window.first_row, window.row_count, 0, 0]);
    }
    table.resize(rows, [0; 4]);
    let row = |row: &LobeRow| [row.first, row.count, row.per_value.to_bits(), 0];
    table.extend(lobes.rows.iter().map(row));
    table.resize(rows + MAX_LOBE_ROWS, [0; 4]);
    table.extend(lobes.cells.iter().map(|cell| cell.map(f32::to_bits)));
}

/// Replaces infinity in a threshold, which WGSL does not support.
fn finite(threshold: f32) -> f32 {
    threshold.min(f32::MAX)
}

/// Number of words before the rows of the maxima.
const MAXIMA_HEADER: usize = 3 + 5 * MAX_LOBES;

/// Packs the maxima: start of the table, entries per unit, the lobes, the rows of the maxima and, if
/// there are merged particles, those of the slopes.
pub(super) fn packed_maxima(
    transfer: &TransferFunction,
    merged: Option<&MergedTransfer>,
    lobes: Option<&Lobes>,
) -> Vec<f32> {
    let lobes = lobes.map_or(&[][..], |lobes| lobes.lobes());
    let mut packed = vec![transfer.range()[0], transfer.scale(), lobes.len() as f32];
    for lobe in lobes {
        packed.extend(lobe.interval);
        packed.extend(lobe.beyond.map(|beyond| f32::from(u8::from(beyond > 0.0))));
        packed.push(finite(lobe.threshold));
    }
    packed.resize(MAXIMA_HEADER, 0.0);
    packed.extend(transfer.maxima().iter().flatten());
    let slopes = merged.map_or(&[][..], |m| m.slopes.maxima());
    packed.extend(slopes.iter().flatten());
    packed
}

/// Buffers that all parts of a frame share.
#[derive(Debug)]
pub(super) struct FrameBuffers {
    /// A [`ViewUniform`], whose `key_scale` cull writes.
    pub(super) view: wgpu::Buffer,
    /// A [`CameraUniform`].
    pub(super) camera: wgpu::Buffer,
    /// A [`LightingUniform`], if anything is lit.
    pub(super) lighting: wgpu::Buffer,
    /// A [`ShadowUniform`], if lights have shadows.
    pub(super) shadows: wgpu::Buffer,
    /// The lights' grids and maps, which all passes share.
    pub(super) shadow_words: wgpu::Buffer,
    /// The camera's rotation, as a uniform.
    pub(super) rotation: wgpu::Buffer,
    /// A [`FrameState`].
    pub(super) state: wgpu::Buffer,
}

impl FrameBuffers {
    /// Makes the buffers.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            view: gpu.uniform("view", &ViewUniform::zeroed())?,
            rotation: gpu.uniform("rotation", &rotation_uniform([[0.0; 3]; 3]))?,
            camera: gpu.buffer("camera", size_of::<CameraUniform>() as u64)?,
            lighting: gpu.uniform("lighting", &LightingUniform::zeroed())?,
            shadows: gpu.uniform("shadows", &ShadowUniform::zeroed())?,
            shadow_words: gpu.buffer("grids of lights", 4)?,
            state: gpu.buffer("frame state", size_of::<FrameState>() as u64)?,
        })
    }

    /// Uploads the uniforms of a frame.
    pub(super) fn write(
        &self,
        gpu: &Gpu,
        view: &ViewUniform,
        camera: &CameraUniform,
        lighting: Option<&LightingUniform>,
        shadows: Option<&ShadowUniform>,
    ) {
        gpu.write(&self.view, bytemuck::bytes_of(view));
        gpu.write(&self.camera, bytemuck::bytes_of(camera));
        if let Some(lighting) = lighting {
            gpu.write(&self.lighting, bytemuck::bytes_of(lighting));
        }
        if let Some(shadows) = shadows {
            gpu.write(&self.shadows, bytemuck::bytes_of(shadows));
        }
        let rotation = rotation_uniform(camera.rotation);
        gpu.write(&self.rotation, bytemuck::bytes_of(&rotation));
    }
}

/// A frame's buffers of a part.
#[derive(Debug)]
pub(super) struct PartBuffers {
    /// A [`PartState`].
    pub(super) state: wgpu::Buffer,
    /// Arguments of indirect dispatches, from [`VIEW_ARGUMENTS`](super::constants::VIEW_ARGUMENTS)
    /// and [`PARTICLE_ARGUMENTS`](super::constants::PARTICLE_ARGUMENTS).
    pub(super) arguments: wgpu::Buffer,
    /// [`BlockView`]s, with space for all blocks.
    pub(super) views: wgpu::Buffer,
    /// [`ClassifiedParticle`]s.
    pub(super) classified: wgpu::Buffer,
}

impl PartBuffers {
    /// Makes the buffers.
    ///
    /// - `capacity`: capacity for classified particles; more than [`Part::most_classified`] is never
    ///   needed.
    /// - `by`: rule that classifies kernels which need more than their values. For pieces the buffer has
    ///   space for as many [`PieceTerms`] after the particles.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn new(gpu: &Gpu, part: &Part, capacity: u32, by: ClassifiedBy) -> Result<Self> {
        const {
            assert!(size_of::<PieceTerms>() == size_of::<ClassifiedParticle>());
        }
        let words = if part.has_pieces(by) { 2 } else { 1 };
        let state = PartState {
            capacity,
            ..PartState::zeroed()
        };
        let bytes = |size: usize, count: usize| size as u64 * count as u64;
        Ok(Self {
            state: gpu.upload("part state", &[state])?,
            arguments: gpu.buffer("arguments", 24)?,
            views: gpu.buffer("views", bytes(size_of::<BlockView>(), part.run.len()))?,
            classified: gpu.buffer(
                "classified particles",
                // A binding needs at least one element.
                bytes(
                    words * size_of::<ClassifiedParticle>(),
                    capacity.max(1) as usize,
                ),
            )?,
        })
    }
}
