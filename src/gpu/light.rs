//! Stage: lights the visible particles that have a normal, once per particle. Twin:
//! [`crate::cpu::light()`].

use glam::Mat3;

use super::classify::upload_views;
use super::constants::PARTICLE_ARGUMENTS;
use super::device::Gpu;
use super::kernel::{Access, BoundKernel};
use super::kinds::ParticleKind;
use super::packed::rotation_uniform;
use super::scene::{FrameBuffers, Part, PartBuffers};
use super::shade::recolour;
use super::shader::{LIT, NORMAL, SHADOW, Shader, TANGENTS, shaders_of_particles};
use crate::blocks::{BlockedVolume, Rule};
use crate::error::Result;
use crate::record::{BlockView, ClassifiedBy, ClassifiedParticle, LightingUniform};

/// Shaders of the stage for each kind of particles, in the order of [`ParticleKind`].
pub(super) const SHADERS: [Shader; 4] = shaders_of_particles!(
    "light",
    NORMAL,
    TANGENTS,
    SHADOW,
    LIT,
    include_str!("../../shaders/light.wgsl"),
);

/// The stage bound to a part.
#[derive(Debug)]
pub(super) struct BoundLight {
    light: BoundKernel,
    arguments: wgpu::Buffer,
}

/// Binds the stage to a part; `None` if it has no normals.
///
/// - `has_shadows`: whether lights have shadows.
/// - `by`: rule that classifies kernels.
pub(super) fn bind_light(
    gpu: &Gpu,
    frame: &FrameBuffers,
    part: &Part,
    buffers: &PartBuffers,
    has_shadows: bool,
    by: ClassifiedBy,
) -> Option<BoundLight> {
    use Access::{Read, Uniform, Write};
    if !part.kinds.is_lit {
        return None;
    }
    let kind = part.kinds.particles;
    let shader = &SHADERS[kind as usize];
    let flag = |is: bool| f64::from(u8::from(is));
    let kernel = gpu.kernel(
        shader,
        "light",
        &[
            Read, Read, Uniform, Uniform, Read, Read, Write, Read, Read, Uniform,
        ],
        &[
            ("IS_SURFEL", flag(kind == ParticleKind::Surfels)),
            (
                "IS_SHEET",
                flag(matches!(part.kinds.rule, Rule::Translucent { .. })),
            ),
            ("HAS_SHADOWS", flag(has_shadows)),
            ("HAS_PIECES", flag(part.has_pieces(by))),
            ("HAS_NORMALS", flag(part.kinds.has_normals)),
        ],
    );
    let PartBuffers {
        state,
        arguments,
        views,
        classified,
    } = buffers;
    let blocks = match kind {
        ParticleKind::Lattice => &part.lattice,
        _ => &part.blocks,
    };
    let bound = kernel.bind(
        gpu,
        &[
            blocks,
            &part.shapes,
            &frame.lighting,
            &frame.rotation,
            state,
            views,
            classified,
            &part.normals,
            &frame.shadow_words,
            &frame.shadows,
        ],
    );
    Some(BoundLight {
        light: bound,
        arguments: arguments.clone(),
    })
}

impl BoundLight {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        let particles = u64::from(4 * PARTICLE_ARGUMENTS);
        self.light
            .dispatch_indirect(pass, &self.arguments, particles);
    }
}

/// Lights the colours of `classified` if particles have normals; does nothing otherwise.
///
/// - `views`: in the order of their blocks, with `first` and `count`, and origins in camera space.
/// - `part_bytes`: greatest size of a buffer of a part, bytes.
///
/// The diffuse part of a light differs from the twin's by roundings of three unit vectors, some 2e-6. The
/// highlight differs by `shininess` times as much, plus the error of its logarithm, which WGSL bounds by
/// 2^-21.
///
/// # Errors
/// No memory, a lost device, or volumes that only the CPU draws.
pub fn light(
    gpu: &Gpu,
    volume: &BlockedVolume,
    views: &[BlockView],
    rotation: Mat3,
    lighting: &LightingUniform,
    classified: &mut [ClassifiedParticle],
    part_bytes: u64,
) -> Result<()> {
    let uploaded = upload_views(
        gpu,
        volume,
        views,
        classified.len() as u32,
        part_bytes,
        ClassifiedBy::Value,
    )?;
    let frame = FrameBuffers::new(gpu)?;
    gpu.write(&frame.lighting, bytemuck::bytes_of(lighting));
    let rotation = rotation_uniform(rotation.to_cols_array_2d());
    gpu.write(&frame.rotation, bytemuck::bytes_of(&rotation));
    let parts = uploaded.scene.parts.iter().zip(&uploaded.buffers);
    for ((part, buffers), range) in parts.zip(uploaded.views) {
        let Some(bound) = bind_light(gpu, &frame, part, buffers, false, ClassifiedBy::Value) else {
            return Ok(());
        };
        recolour(gpu, buffers, views, range, classified, |pass| {
            bound.encode(pass);
        })?;
    }
    Ok(())
}
