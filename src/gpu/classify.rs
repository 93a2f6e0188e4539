//! Stage: computes the mass and the colour of each particle from its value, once. Twin:
//! [`crate::cpu::classify()`].

use std::collections::HashMap;
use std::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use super::constants::{MAX_GROUPS, PARTICLE_ARGUMENTS, THREADS, VIEW_ARGUMENTS};
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::kinds::Kinds;
use super::packed::words;
use super::scan::{BoundScan, Scan};
use super::scene::{FrameBuffers, Part, PartBuffers, Scene};
use super::shader::{
    AVERAGES, DISPATCH, EIN, EXPONENTIAL, F64_ARITHMETIC, LOBES, NORMAL, SCAN_THREADS, STRUCTS,
    Shader, TRANSFER,
};
use crate::blocks::BlockedVolume;
use crate::error::Result;
use crate::record::{BlockView, ClassifiedBy, ClassifiedParticle, PartState, PieceTerms};

/// A variant of the stage's shader, from its name, its additional sources and the files of its rule.
macro_rules! classifying {
    ($name:literal, [$($source:ident),*], $($file:literal),+) => {
        Shader::new(
            $name,
            &[
                DISPATCH,
                SCAN_THREADS,
                STRUCTS,
                EXPONENTIAL,
                TRANSFER,
                AVERAGES,
                $($source,)*
                EIN,
                include_str!("../../shaders/classify/class.wgsl"),
                include_str!("../../shaders/classify.wgsl"),
                $(include_str!($file)),+
            ],
        )
    };
}

/// Shader that computes masses and colours from values.
pub(super) const SHADER: Shader = classifying!(
    "classify",
    [],
    "../../shaders/classify/alone.wgsl",
    "../../shaders/classify/one.wgsl"
);

/// Shader that computes masses and the values for slabs. A particle is kept if any value around it is
/// visible.
pub(super) const NEIGHBOURS: Shader = classifying!(
    "classify neighbours",
    [LOBES, NORMAL],
    "../../shaders/classify/halo.wgsl",
    "../../shaders/classify/neighbours.wgsl",
    "../../shaders/classify/one.wgsl"
);

/// Shader that computes masses, colours and pieces over kernels' extents.
pub(super) const PIECES: Shader = classifying!(
    "classify extents",
    [LOBES, NORMAL],
    "../../shaders/classify/halo.wgsl",
    "../../shaders/classify/pieces.wgsl"
);

/// Shader that computes signed amplitudes from values.
pub(super) const AMPLITUDES: Shader = Shader::new(
    "classify amplitudes",
    &[
        DISPATCH,
        SCAN_THREADS,
        STRUCTS,
        F64_ARITHMETIC,
        include_str!("../../shaders/classify/amplitude.wgsl"),
        include_str!("../../shaders/classify.wgsl"),
        include_str!("../../shaders/classify/alone.wgsl"),
        include_str!("../../shaders/classify/one.wgsl"),
    ],
);

/// Unit of amplitudes, as `classify/amplitude.wgsl` declares it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct AmplitudeUniform {
    pub(super) scale: [u32; 2],
    pub(super) cell_volume: [u32; 2],
}

impl AmplitudeUniform {
    /// Makes the uniform.
    ///
    /// - `scale`: mass per unit of amplitude.
    /// - `cell_volume`: volume of a cell, if the part is a uniform lattice's.
    pub(super) fn new(scale: f64, cell_volume: f64) -> Self {
        Self {
            scale: words(scale),
            cell_volume: words(cell_volume),
        }
    }
}

/// The pipelines of the stage for parts of one kind.
#[derive(Debug)]
struct Classify {
    count: Kernel,
    place: Kernel,
    emit: Kernel,
}

/// The stage bound to a part.
#[derive(Debug)]
pub(super) struct BoundClassify {
    count: BoundKernel,
    scan: BoundScan,
    place: BoundKernel,
    emit: BoundKernel,
    arguments: wgpu::Buffer,
    /// Workgroups of `place` if all blocks are in view.
    groups: u32,
}

impl Classify {
    /// Makes the pipelines.
    ///
    /// - `lobes`: start of the lobes in the table and the rule that uses them, unless values alone
    ///   classify.
    fn new(gpu: &Gpu, kinds: &Kinds, is_column: bool, lobes: Option<(u32, ClassifiedBy)>) -> Self {
        use Access::{Read, Uniform, Write};
        let flag = |is: bool| f64::from(u8::from(is));
        let mut constants = vec![
            ("VALUES", f64::from(kinds.values as u32)),
            ("STRENGTH", f64::from(kinds.strength as u32)),
            ("IS_LATTICE", flag(kinds.is_lattice())),
        ];
        let (shader, of_mass): (&Shader, Access) = if is_column {
            (&AMPLITUDES, Uniform)
        } else {
            constants.push(("COLOUR", f64::from(kinds.colour as u32)));
            constants.push(("HAS_MEMBER_DEPTHS", flag(kinds.has_member_depths)));
            if let Some((first, _)) = lobes {
                constants.push(("LOBES_FIRST", f64::from(first)));
            }
            match lobes.map(|(_, by)| by) {
                None | Some(ClassifiedBy::Value) => (&SHADER, Read),
                Some(ClassifiedBy::Extent) => (&PIECES, Read),
                Some(ClassifiedBy::Neighbours) => (&NEIGHBOURS, Read),
            }
        };
        let kernel = |entry, bindings: &[Access]| gpu.kernel(shader, entry, bindings, &constants);
        let count = [Uniform, Write, Write, Write, Read, Read, Read, of_mass];
        let place = [Uniform, Write, Write, Write, Write, Write];
        let emit = [
            Uniform, Write, Write, Write, Read, Read, Read, of_mass, Read,
        ];
        Self {
            count: kernel("classify_count", &count),
            place: kernel("classify_place", &place),
            emit: kernel("classify_emit", &emit),
        }
    }
}

/// Binds the stage to some parts of a scene and their buffers of a frame.
///
/// - `amplitudes`: an [`AmplitudeUniform`] of each part, if amplitudes are wanted; otherwise the stage
///   computes masses and colours.
/// - `by`: rule that classifies the kernels of parts that have lobes.
///
/// # Errors
/// No memory for the counts.
pub(super) fn bind_classify(
    gpu: &Gpu,
    frame: &FrameBuffers,
    parts: &[&Part],
    buffers: &[PartBuffers],
    amplitudes: Option<&[wgpu::Buffer]>,
    by: ClassifiedBy,
) -> Result<Vec<BoundClassify>> {
    let mut kernels: HashMap<(Kinds, Option<(u32, ClassifiedBy)>), Classify> = HashMap::new();
    let scan = Scan::new(gpu, (offset_of!(PartState, count_length) / 4) as u32);
    let bind_part = |(i, (part, buffers)): (usize, (&&Part, &PartBuffers))| {
        let lobes = part.lobes_first.filter(|_| by != ClassifiedBy::Value);
        let lobes = lobes.map(|first| (first, by));
        let kernels = kernels
            .entry((part.kinds, lobes))
            .or_insert_with(|| Classify::new(gpu, &part.kinds, amplitudes.is_some(), lobes));
        let Part {
            blocks,
            bricks,
            values,
            strengths,
            colours,
            table,
            ..
        } = part;
        let PartBuffers {
            state,
            arguments,
            views,
            classified,
        } = buffers;
        let count_length = part.run.len() as u64 + 1;
        let counts = gpu.buffer("counts", 4 * count_length)?;
        let words = [bricks, state, views, &counts];
        let place = [&words[..], &[&frame.state, arguments]].concat();
        let of_mass = amplitudes.map_or(table, |amplitudes| &amplitudes[i]);
        let count = [&words[..], &[blocks, values, strengths, of_mass]].concat();
        let mut emit = [&count[..], &[colours]].concat();
        emit[3] = classified;
        Ok(BoundClassify {
            count: kernels.count.bind(gpu, &count),
            scan: scan.bind(gpu, state, &counts, count_length)?,
            place: kernels.place.bind(gpu, &place),
            emit: kernels.emit.bind(gpu, &emit),
            arguments: arguments.clone(),
            groups: (part.run.len() as u32).div_ceil(THREADS),
        })
    };
    parts
        .iter()
        .zip(buffers)
        .enumerate()
        .map(bind_part)
        .collect()
}

impl BoundClassify {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        let views = u64::from(4 * VIEW_ARGUMENTS);
        self.count.dispatch_indirect(pass, &self.arguments, views);
        self.scan.encode(pass);
        self.place.dispatch(pass, self.groups);
        self.emit.dispatch_indirect(pass, &self.arguments, views);
    }
}

/// Parts of a volume with views from the CPU, as input of [`classify`] and [`shade`](super::shade()).
#[derive(Debug)]
pub(super) struct Uploaded {
    pub(super) scene: Scene,
    pub(super) buffers: Vec<PartBuffers>,
    /// Range of each part's views among the volume's.
    pub(super) views: Vec<std::ops::Range<usize>>,
}

/// Uploads a volume and views of it.
///
/// # Errors
/// No memory, or volumes that only the CPU draws.
pub(super) fn upload_views(
    gpu: &Gpu,
    volume: &BlockedVolume,
    views: &[BlockView],
    capacity: u32,
    part_bytes: u64,
    by: ClassifiedBy,
) -> Result<Uploaded> {
    let scene = Scene::new(gpu, std::slice::from_ref(volume), |_| true, part_bytes)?;
    let mut uploaded = Uploaded {
        scene,
        buffers: Vec::new(),
        views: Vec::new(),
    };
    for part in &uploaded.scene.parts {
        let [start, end] = [part.run.start, part.run.end]
            .map(|block| views.partition_point(|v| (v.block as usize) < block));
        let of_part: Vec<_> = views[start..end]
            .iter()
            .map(|v| BlockView {
                block: v.block - part.run.start as u32,
                ..*v
            })
            .collect();
        let buffers = PartBuffers::new(gpu, part, capacity, by)?;
        let count = of_part.len() as u32;
        gpu.write(&buffers.views, bytemuck::cast_slice(&of_part));
        let state = PartState {
            capacity,
            view_count: count,
            count_length: count + 1,
            ..PartState::zeroed()
        };
        gpu.write(&buffers.state, bytemuck::bytes_of(&state));
        gpu.write(
            &buffers.arguments,
            bytemuck::cast_slice(&arguments(count, 0)),
        );
        uploaded.buffers.push(buffers);
        uploaded.views.push(start..end);
    }
    Ok(uploaded)
}

/// Returns the arguments of dispatches over so many workgroups: of views, and of particles.
pub(super) fn arguments(views: u32, particles: u32) -> [[u32; 3]; 2] {
    const { assert!(VIEW_ARGUMENTS == 0 && PARTICLE_ARGUMENTS == 3) };
    [views, particles].map(|n| [n.min(MAX_GROUPS), n.div_ceil(MAX_GROUPS), 1])
}

/// Result of [`classify`].
#[derive(Debug, Clone, PartialEq)]
pub struct Classified {
    /// The visible particles of all views.
    pub particles: Vec<ClassifiedParticle>,
    /// Their terms, if kernels are classified over their extents.
    pub terms: Vec<PieceTerms>,
    /// State of each part of the volume.
    pub states: Vec<PartState>,
    /// Workgroups of a dispatch over each part's particles, 256 in each group.
    pub groups: Vec<[u32; 3]>,
}

/// Finds the visible particles of each view, and sets `count` and `first` of the views.
///
/// - `views`: in the order of their blocks.
/// - `capacity`: greatest number of particles in each part; a part that needs more returns none.
/// - `part_bytes`: greatest size of a buffer of a part, bytes.
/// - `by`: rule for kernels whose views ask for more than their values.
///
/// Twin: [`crate::cpu::count_classified`] and [`crate::cpu::classify()`]; [`crate::cpu::Pieces`].
///
/// # Errors
/// No memory, a lost device, or volumes that only the CPU draws.
pub fn classify(
    gpu: &Gpu,
    volume: &BlockedVolume,
    views: &mut [BlockView],
    capacity: u32,
    part_bytes: u64,
    by: ClassifiedBy,
) -> Result<Classified> {
    let uploaded = upload_views(gpu, volume, views, capacity, part_bytes, by)?;
    let frame = FrameBuffers::new(gpu)?;
    let parts: Vec<_> = uploaded.scene.parts.iter().collect();
    let bound = bind_classify(gpu, &frame, &parts, &uploaded.buffers, None, by)?;
    gpu.run(|pass| bound.iter().for_each(|part| part.encode(pass)));
    let mut out = Classified {
        particles: Vec::new(),
        terms: Vec::new(),
        states: Vec::new(),
        groups: Vec::new(),
    };
    let drawn = uploaded.scene.parts.iter().zip(&uploaded.buffers);
    for ((part, buffers), range) in drawn.zip(uploaded.views) {
        let state: PartState = gpu.read(&buffers.state, 1)?[0];
        let placed: Vec<BlockView> = gpu.read(&buffers.views, range.len())?;
        for (view, placed) in views[range.clone()].iter_mut().zip(placed) {
            view.first = state.first + placed.first;
            view.count = placed.count;
        }
        let count = state.classified_count as usize;
        let of_part: Vec<ClassifiedParticle> = gpu.read(&buffers.classified, count)?;
        if part.has_pieces(by) {
            let room = state.capacity as usize;
            let all: Vec<PieceTerms> = gpu.read(&buffers.classified, room + count)?;
            out.terms.extend_from_slice(&all[room..]);
        }
        out.particles
            .extend(of_part.iter().map(|p| ClassifiedParticle {
                view: p.view + range.start as u32,
                ..*p
            }));
        out.states.push(state);
        let arguments: Vec<[u32; 3]> = gpu.read(&buffers.arguments, 2)?;
        out.groups.push(arguments[1]);
    }
    Ok(out)
}
