//! Stage: finds the blocks that a frame sees, their filters, and the keys of their depths. Twins:
//! [`crate::blocks::cull`], [`crate::blocks::choose`].

use bytemuck::{Pod, Zeroable};

use super::constants::{THREADS, VIEW_ARGUMENTS};
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::kinds::{ColourKind, Kinds, ParticleKind};
use super::packed::words;
use super::scene::{FrameBuffers, Part, PartBuffers, Scene};
use super::shader::{
    DISPATCH, F64_ARITHMETIC, FLOATS, MAXIMA, SCAN_THREADS, STRUCTS, Shader, TRANSFER,
};
use crate::blocks::{BlockedVolume, Frustum, Layers, NO_PARENT};
use crate::error::Result;
use crate::record::{
    BlockView, CameraUniform, ChoiceUniform, ClassifiedBy, FrameState, KeyKind, MERGED_OPEN,
    MergedBlock, PartState, ViewUniform,
};
use crate::view::{Camera, Projection};

/// Shader of the stage.
pub(super) const SHADER: Shader = Shader::new(
    "cull",
    &[
        DISPATCH,
        SCAN_THREADS,
        STRUCTS,
        F64_ARITHMETIC,
        FLOATS,
        TRANSFER,
        MAXIMA,
        include_str!("../../shaders/shared/choose.wgsl"),
        include_str!("../../shaders/cull.wgsl"),
    ],
);

/// Result of a workgroup, as `cull.wgsl` declares it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct CullGroup {
    pub(super) count: u32,
    pub(super) unused: u32,
    pub(super) nearest: [u32; 2],
    pub(super) farthest: [u32; 2],
}

/// Returns the camera's uniform for the device.
///
/// - `rejects`: whether blocks outside the frustum are left out. The range of depth keys is always that
///   of the visible blocks.
/// - `choice`: rules by which blocks choose their filter.
/// - `keys`: what depth keys measure.
/// - `layers`: the layers in which kernels are summed, if keys are those of layers.
pub fn camera_uniform(
    camera: &Camera,
    frustum: &Frustum,
    rejects: bool,
    choice: ChoiceUniform,
    keys: KeyKind,
    layers: Option<&Layers>,
) -> CameraUniform {
    let planes = frustum.planes();
    let triple = |v: glam::DVec3| v.to_array().map(words);
    let mut uniform = CameraUniform {
        eye: triple(camera.eye),
        camera_from_world: [0, 1, 2].map(|row| triple(camera.camera_from_world.row(row))),
        key_axis: triple(layers.map_or(glam::DVec3::ZERO, |l| l.axis)),
        key_near: words(layers.map_or(0.0, Layers::near_of_keys)),
        keys_per_unit: words(layers.map_or(0.0, Layers::keys_per_unit)),
        rotation: camera.camera_from_world.as_mat3().to_cols_array_2d(),
        has_frustum: u32::from(rejects),
        orthographic: u32::from(camera.projection == Projection::Orthographic),
        key_kind: keys as u32,
        plane_count: planes.len() as u32,
        choice,
        ..CameraUniform::zeroed()
    };
    for (i, (normal, distance)) in planes.iter().enumerate() {
        let world_normal = camera.camera_from_world.transpose() * *normal;
        uniform.plane_normals[i] = triple(*normal);
        uniform.plane_distances[i] = words(*distance);
        uniform.plane_spreads[i] = triple(world_normal.abs());
    }
    uniform
}

/// The pipelines of the stage.
#[derive(Debug)]
pub(super) struct Cull {
    begin: Kernel,
    scan: Kernel,
    range: Kernel,
}

/// The pipelines for parts of one kind.
#[derive(Debug)]
struct CullPart {
    /// For merged particles.
    close: Option<Kernel>,
    count: Kernel,
    emit: Kernel,
}

/// Purposes for which blocks are culled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SeenFor {
    /// A picture: blocks that the transfer function leaves visible, with filters that they choose.
    Picture,
    /// A column density: all blocks in the frustum, with the filter of the settings.
    Column,
}

impl CullPart {
    fn new(gpu: &Gpu, kinds: &Kinds, seen_for: SeenFor) -> Self {
        use Access::{Read, Write};
        let flag = |is: bool| f64::from(u8::from(is));
        let is_picture = seen_for == SeenFor::Picture;
        let constants = [
            ("HAS_CHOICE", flag(is_picture)),
            (
                "IS_CLASSIFIED",
                flag(is_picture && kinds.may_be_transparent()),
            ),
            (
                "IS_COLOUR_CLASSIFIED",
                flag(kinds.colour == ColourKind::Classified),
            ),
            ("IS_MERGED", flag(kinds.is_merged)),
            (
                "ARE_ROUND",
                flag(kinds.particles == ParticleKind::Isotropic),
            ),
        ];
        let kernel = |entry, bindings: &[Access]| gpu.kernel(&SHADER, entry, bindings, &constants);
        let blocks = [Write, Write, Read, Read, Write, Read, Write, Read];
        Self {
            close: kinds.is_merged.then(|| kernel("cull_close", &blocks)),
            count: kernel("cull_count", &blocks),
            emit: kernel("cull_emit", &blocks[..7]),
        }
    }
}

/// The stage bound to certain parts.
#[derive(Debug)]
pub(super) struct BoundCull {
    begin: BoundKernel,
    range: BoundKernel,
    parts: Vec<BoundPart>,
}

#[derive(Debug)]
struct BoundPart {
    /// For merged particles.
    close: Option<BoundKernel>,
    count: BoundKernel,
    scan: BoundKernel,
    emit: BoundKernel,
    groups: u32,
}

impl Cull {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let kernel = |entry, bindings: &[Access]| gpu.kernel(&SHADER, entry, bindings, &[]);
        Self {
            begin: kernel("cull_begin", &[Access::Write]),
            scan: kernel("cull_scan", &[Access::Write; 4]),
            range: kernel("cull_range", &[Access::Write, Access::Write, Access::Read]),
        }
    }

    /// Binds parts of a scene and their buffers of a frame. If any part has merged particles, all parts
    /// must be bound.
    ///
    /// # Errors
    /// No memory for the counts.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        frame: &FrameBuffers,
        parts: &[&Part],
        buffers: &[PartBuffers],
        seen_for: SeenFor,
    ) -> Result<BoundCull> {
        let FrameBuffers {
            view,
            camera,
            state: frame,
            ..
        } = frame;
        let merged = parts.iter().filter(|part| part.kinds.is_merged);
        let merged_count: usize = merged.map(|part| part.run.len()).sum();
        // A binding needs at least one element.
        let none = MergedBlock {
            parent: NO_PARENT,
            state: MERGED_OPEN,
        };
        let merged_blocks = gpu.upload("merged blocks", &vec![none; merged_count.max(1)])?;
        let bind_part = |(part, buffers): (&&Part, &PartBuffers)| {
            let block_count = part.run.len();
            let groups = block_count.div_ceil(THREADS as usize);
            let places = gpu.buffer("places of blocks", 4 * block_count as u64)?;
            let seen = gpu.buffer("seen blocks", (size_of::<CullGroup>() * groups) as u64)?;
            let Part {
                blocks,
                maxima,
                merged,
                ..
            } = part;
            let PartBuffers {
                state,
                arguments,
                views,
                ..
            } = buffers;
            let kernels = CullPart::new(gpu, &part.kinds, seen_for);
            let shared = [frame, &seen, camera, blocks, &places, maxima];
            let of_blocks = [&shared[..], &[&merged_blocks, merged]].concat();
            let emit = [&shared[..], &[views]].concat();
            Ok(BoundPart {
                close: kernels.close.map(|close| close.bind(gpu, &of_blocks)),
                count: kernels.count.bind(gpu, &of_blocks),
                scan: self.scan.bind(gpu, &[frame, &seen, state, arguments]),
                emit: kernels.emit.bind(gpu, &emit),
                groups: groups as u32,
            })
        };
        Ok(BoundCull {
            begin: self.begin.bind(gpu, &[frame]),
            range: self.range.bind(gpu, &[frame, view, camera]),
            parts: parts
                .iter()
                .zip(buffers)
                .map(bind_part)
                .collect::<Result<_>>()?,
        })
    }
}

impl BoundCull {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.begin.dispatch(pass, 1);
        for part in &self.parts {
            if let Some(close) = &part.close {
                close.dispatch(pass, part.groups);
            }
        }
        for part in &self.parts {
            part.count.dispatch(pass, part.groups);
            part.scan.dispatch(pass, 1);
        }
        self.range.dispatch(pass, 1);
        for part in &self.parts {
            part.emit.dispatch(pass, part.groups);
        }
    }
}

/// Result of [`cull`] for a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct CullOutput {
    /// Each volume's views, with `first` and `count` 0.
    pub views: Vec<Vec<BlockView>>,
    /// For each part, the number of its views and the workgroups of a dispatch with one group per view.
    pub parts: Vec<(u32, [u32; 3])>,
    /// Depth keys per unit of distance.
    pub key_scale: f32,
    /// Number of views with each filter.
    pub filters: [u32; 7],
}

/// Finds the blocks that frames see, with their keys and filters. The volumes are each followed by their
/// levels of detail.
///
/// - `cameras`: one for each frame.
/// - `part_bytes`: greatest size of a buffer of a part, bytes.
///
/// Twin: [`crate::blocks::cull`], [`crate::blocks::cull_detail`], [`crate::blocks::choose`] and the keys
/// of [`crate::Renderer::render`].
///
/// # Errors
/// No memory, a lost device, or volumes that only the CPU draws.
pub fn cull(
    gpu: &Gpu,
    volumes: &[BlockedVolume],
    cameras: &[CameraUniform],
    part_bytes: u64,
) -> Result<Vec<CullOutput>> {
    let scene = Scene::new(gpu, volumes, |_| true, part_bytes)?;
    let frame = FrameBuffers::new(gpu)?;
    let buffers = scene
        .parts
        .iter()
        .map(|part| PartBuffers::new(gpu, part, 1, ClassifiedBy::Value))
        .collect::<Result<Vec<_>>>()?;
    let parts: Vec<_> = scene.parts.iter().collect();
    let bound = Cull::new(gpu).bind(gpu, &frame, &parts, &buffers, SeenFor::Picture)?;
    let run = |camera: &CameraUniform| {
        frame.write(gpu, &ViewUniform::zeroed(), camera, None, None);
        gpu.run(|pass| bound.encode(pass));
        let mut views = vec![Vec::new(); volumes.len()];
        let mut counts = Vec::new();
        for (part, buffers) in scene.parts.iter().zip(&buffers) {
            let state: PartState = gpu.read(&buffers.state, 1)?[0];
            let mut seen: Vec<BlockView> = gpu.read(&buffers.views, state.view_count as usize)?;
            for view in &mut seen {
                view.block += part.run.start as u32;
            }
            views[part.volume].append(&mut seen);
            const { assert!(VIEW_ARGUMENTS == 0) };
            counts.push((state.view_count, gpu.read(&buffers.arguments, 1)?[0]));
        }
        let view: ViewUniform = gpu.read(&frame.view, 1)?[0];
        let state: FrameState = gpu.read(&frame.state, 1)?[0];
        Ok(CullOutput {
            views,
            parts: counts,
            key_scale: view.key_scale,
            filters: state.filters,
        })
    };
    cameras.iter().map(run).collect()
}
