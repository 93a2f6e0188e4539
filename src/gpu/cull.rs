//! Stage: which blocks a frame sees, and the keys of their depths. Twin: [`crate::blocks::cull`].

use bytemuck::{Pod, Zeroable};

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel, THREADS};
use super::scene::{FrameBuffers, Part, PartBuffers, Scene, VIEW_ARGUMENTS};
use super::shaders::{self, words};
use crate::blocks::{BlockedVolume, Frustum};
use crate::error::Result;
use crate::layout::{BlockView, CameraUniform, PartState, ViewUniform};
use crate::view::{Camera, Projection};

/// What a workgroup has seen, as `cull.wgsl` has it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct CullGroup {
    pub(super) count: u32,
    pub(super) unused: u32,
    pub(super) nearest: [u32; 2],
    pub(super) farthest: [u32; 2],
}

/// What the device needs of a camera; `rejects`: whether blocks that the frustum does not see are
/// left out (the range of depth keys is theirs who are seen in any case).
pub fn camera_uniform(camera: &Camera, frustum: &Frustum, rejects: bool) -> CameraUniform {
    let planes = frustum.planes();
    let world_normal = |i: usize| camera.camera_from_world.transpose() * planes[i].0;
    let triple = |v: glam::DVec3| v.to_array().map(words);
    CameraUniform {
        eye: triple(camera.eye),
        camera_from_world: [0, 1, 2].map(|row| triple(camera.camera_from_world.row(row))),
        plane_normals: planes.map(|(normal, _)| triple(normal)),
        plane_distances: planes.map(|(_, distance)| words(distance)),
        plane_spreads: [0, 1, 2, 3, 4].map(|i| triple(world_normal(i).abs())),
        rotation: camera.camera_from_world.as_mat3().to_cols_array_2d(),
        has_frustum: u32::from(rejects),
        orthographic: u32::from(camera.projection == Projection::Orthographic),
        unused: 0,
    }
}

/// The pipelines of the stage.
#[derive(Debug)]
pub(super) struct Cull {
    begin: Kernel,
    /// Without and with a transfer function.
    count: [Kernel; 2],
    scan: Kernel,
    range: Kernel,
    emit: Kernel,
}

/// The stage over certain parts.
#[derive(Debug)]
pub(super) struct BoundCull {
    begin: BoundKernel,
    range: BoundKernel,
    parts: Vec<BoundPart>,
}

#[derive(Debug)]
struct BoundPart {
    count: BoundKernel,
    scan: BoundKernel,
    emit: BoundKernel,
    groups: u32,
}

impl Cull {
    pub(super) fn new(gpu: &Gpu) -> Self {
        use Access::{Read, Write};
        let kernel = |entry, bindings: &[Access], is_classified: bool| {
            gpu.kernel(
                &shaders::CULL,
                entry,
                bindings,
                &[("IS_CLASSIFIED", f64::from(u8::from(is_classified)))],
            )
        };
        Self {
            begin: kernel("cull_begin", &[Write], false),
            count: [false, true].map(|is_classified| {
                let bindings = [Write, Write, Read, Read, Write, Read];
                kernel("cull_count", &bindings, is_classified)
            }),
            scan: kernel("cull_scan", &[Write; 4], false),
            range: kernel("cull_range", &[Write; 2], false),
            emit: kernel(
                "cull_emit",
                &[Write, Write, Read, Read, Write, Write],
                false,
            ),
        }
    }

    /// Binds all parts of a scene and what a frame makes of each.
    ///
    /// # Errors
    /// No memory for the counts.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        frame: &FrameBuffers,
        parts: &[Part],
        buffers: &[PartBuffers],
    ) -> Result<BoundCull> {
        let FrameBuffers {
            view,
            camera,
            state: frame,
            ..
        } = frame;
        let bind_part = |(part, buffers): (&Part, &PartBuffers)| {
            let block_count = part.run.len();
            let groups = block_count.div_ceil(THREADS as usize);
            let places = gpu.buffer("places of blocks", 4 * block_count as u64)?;
            let seen = gpu.buffer("seen blocks", (size_of::<CullGroup>() * groups) as u64)?;
            let blocks = &part.blocks;
            let PartBuffers {
                state,
                arguments,
                views,
                ..
            } = buffers;
            let count = &self.count[usize::from(part.kinds.may_be_transparent())];
            Ok(BoundPart {
                count: count.bind(gpu, &[frame, &seen, camera, blocks, &places, &part.maxima]),
                scan: self.scan.bind(gpu, &[frame, &seen, state, arguments]),
                emit: self
                    .emit
                    .bind(gpu, &[frame, &seen, camera, blocks, &places, views]),
                groups: groups as u32,
            })
        };
        Ok(BoundCull {
            begin: self.begin.bind(gpu, &[frame]),
            range: self.range.bind(gpu, &[frame, view]),
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
            part.count.dispatch(pass, part.groups);
            part.scan.dispatch(pass, 1);
        }
        self.range.dispatch(pass, 1);
        for part in &self.parts {
            part.emit.dispatch(pass, part.groups);
        }
    }
}

/// What [`cull`] finds in a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct CullOutput {
    /// Each volume's views, their `first` and `count` 0.
    pub views: Vec<Vec<BlockView>>,
    /// How many of them each part has, and the workgroups of a dispatch with one for each.
    pub parts: Vec<(u32, [u32; 3])>,
    /// Depth keys per unit of distance.
    pub key_scale: f32,
}

/// The blocks of some volumes that frames see, with their keys.
///
/// - `cameras`: one for each frame.
/// - `part_bytes`: parts of volumes have buffers of at most so many bytes.
///
/// Twin: [`crate::blocks::cull`] and the keys of [`crate::Renderer::render`].
///
/// # Errors
/// No memory, a lost device, or volumes that only the CPU draws.
pub fn cull(
    gpu: &Gpu,
    volumes: &[BlockedVolume],
    cameras: &[CameraUniform],
    part_bytes: u64,
) -> Result<Vec<CullOutput>> {
    let scene = Scene::new(gpu, volumes, part_bytes)?;
    let frame = FrameBuffers::new(gpu)?;
    let buffers = scene
        .parts
        .iter()
        .map(|part| PartBuffers::new(gpu, part, 1))
        .collect::<Result<Vec<_>>>()?;
    let bound = Cull::new(gpu).bind(gpu, &frame, &scene.parts, &buffers)?;
    let run = |camera: &CameraUniform| {
        frame.write(gpu, &ViewUniform::zeroed(), camera);
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
        Ok(CullOutput {
            views,
            parts: counts,
            key_scale: view.key_scale,
        })
    };
    cameras.iter().map(run).collect()
}
