//! Stage: evaluates colours that depend on the view, once per visible particle. Twin:
//! [`crate::cpu::shade()`].

use std::ops::Range;

use bytemuck::Zeroable;

use super::classify::{arguments, upload_views};
use super::constants::{PARTICLE_ARGUMENTS, THREADS};
use super::cull::camera_uniform;
use super::device::Gpu;
use super::kernel::{Access, BoundKernel};
use super::kinds::ColourKind;
use super::scene::{FrameBuffers, Part, PartBuffers};
use super::shader::{DISPATCH, F64_ARITHMETIC, SRGB, STRUCTS, Shader};
use crate::blocks::{BlockedVolume, Frustum};
use crate::error::Result;
use crate::record::{
    BlockView, ChoiceUniform, ClassifiedBy, ClassifiedParticle, KeyKind, PartState,
};
use crate::view::Camera;

/// Shader that evaluates the colours of radiance fields.
pub(super) const SHADER: Shader = Shader::new(
    "shade",
    &[
        DISPATCH,
        STRUCTS,
        F64_ARITHMETIC,
        SRGB,
        include_str!("../../shaders/shade.wgsl"),
    ],
);

/// Shader that encodes colours for the space of blending.
pub(super) const ENCODE_SHADER: Shader = Shader::new(
    "encode",
    &[
        DISPATCH,
        STRUCTS,
        SRGB,
        include_str!("../../shaders/encode.wgsl"),
    ],
);

/// The stage bound to a part.
#[derive(Debug)]
pub(super) struct BoundShade {
    shade: BoundKernel,
    arguments: wgpu::Buffer,
}

/// Binds the stage to a part; `None` if its colours are not harmonics.
///
/// - `is_encoded`: whether sRGB codes are blended instead of linear light.
pub(super) fn bind_shade(
    gpu: &Gpu,
    frame: &FrameBuffers,
    part: &Part,
    buffers: &PartBuffers,
    is_encoded: bool,
) -> Option<BoundShade> {
    use Access::{Read, Write};
    if part.kinds.colour != ColourKind::Harmonics {
        return None;
    }
    let is_linear = part.kinds.has_linear_harmonics;
    let flag = |is: bool| f64::from(u8::from(is));
    let kernel = gpu.kernel(
        &SHADER,
        "shade",
        &[Read, Read, Read, Write, Read, Read, Read],
        &[
            (
                "POINT_WORDS",
                part.kinds.particles.words_per_particle() as f64,
            ),
            ("HARMONICS_COUNT", f64::from(part.kinds.harmonics_count)),
            ("DECODES", flag(!is_linear && !is_encoded)),
            ("ENCODES", flag(is_linear && is_encoded)),
        ],
    );
    let PartBuffers {
        state,
        arguments,
        views,
        classified,
    } = buffers;
    let Part {
        blocks,
        shapes,
        colours,
        ..
    } = part;
    Some(BoundShade {
        shade: kernel.bind(
            gpu,
            &[
                &frame.camera,
                state,
                views,
                classified,
                blocks,
                shapes,
                colours,
            ],
        ),
        arguments: arguments.clone(),
    })
}

/// Binds the encoding of the linear colours of a part; `None` if [`bind_shade`] fills its colours.
pub(super) fn bind_encode(gpu: &Gpu, part: &Part, buffers: &PartBuffers) -> Option<BoundShade> {
    if part.kinds.colour == ColourKind::Harmonics {
        return None;
    }
    let kernel = gpu.kernel(
        &ENCODE_SHADER,
        "encode",
        &[Access::Read, Access::Write],
        &[],
    );
    Some(BoundShade {
        shade: kernel.bind(gpu, &[&buffers.state, &buffers.classified]),
        arguments: buffers.arguments.clone(),
    })
}

impl BoundShade {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        let particles = u64::from(4 * PARTICLE_ARGUMENTS);
        self.shade
            .dispatch_indirect(pass, &self.arguments, particles);
    }
}

/// Evaluates the colours of `classified` if they are harmonics; does nothing otherwise.
///
/// - `views`: in the order of their blocks, with `first` and `count`.
/// - `is_encoded`: whether sRGB codes are blended instead of linear light.
/// - `part_bytes`: greatest size of a buffer of a part, bytes.
///
/// Codes differ from the twin's by roundings of the direction and the sum, some 2e-6 of the sum of the
/// coefficients' magnitudes. Decoding, a power by logarithms, adds 1e-5 of the result.
///
/// # Errors
/// No memory, a lost device, or volumes that only the CPU draws.
pub fn shade(
    gpu: &Gpu,
    volume: &BlockedVolume,
    views: &[BlockView],
    camera: &Camera,
    is_encoded: bool,
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
    let uniform = camera_uniform(
        camera,
        &Frustum::new(camera, 0.0),
        true,
        ChoiceUniform::zeroed(),
        KeyKind::Distance,
        None,
    );
    gpu.write(&frame.camera, bytemuck::bytes_of(&uniform));
    let parts = uploaded.scene.parts.iter().zip(&uploaded.buffers);
    for ((part, buffers), range) in parts.zip(uploaded.views) {
        let Some(bound) = bind_shade(gpu, &frame, part, buffers, is_encoded) else {
            return Ok(());
        };
        recolour(gpu, buffers, views, range, classified, |pass| {
            bound.encode(pass);
        })?;
    }
    Ok(())
}

/// Runs a stage that changes colours over the particles of a part.
///
/// - `range`: range of the part's views in `views`.
pub(super) fn recolour(
    gpu: &Gpu,
    buffers: &PartBuffers,
    views: &[BlockView],
    range: Range<usize>,
    classified: &mut [ClassifiedParticle],
    encode: impl FnOnce(&mut wgpu::ComputePass<'_>),
) -> Result<()> {
    let begin = views[range.clone()].first().map_or(0, |v| v.first as usize);
    let count: u32 = views[range.clone()].iter().map(|v| v.count).sum();
    let particles = &mut classified[begin..][..count as usize];
    let of_part: Vec<_> = particles
        .iter()
        .map(|p| ClassifiedParticle {
            view: p.view - range.start as u32,
            ..*p
        })
        .collect();
    gpu.write(&buffers.classified, bytemuck::cast_slice(&of_part));
    let mut state: PartState = gpu.read(&buffers.state, 1)?[0];
    state.classified_count = count;
    gpu.write(&buffers.state, bytemuck::bytes_of(&state));
    let groups = arguments(0, count.div_ceil(THREADS));
    gpu.write(&buffers.arguments, bytemuck::cast_slice(&groups));
    gpu.run(encode);
    let coloured: Vec<ClassifiedParticle> = gpu.read(&buffers.classified, count as usize)?;
    for (particle, coloured) in particles.iter_mut().zip(coloured) {
        particle.carried = coloured.carried;
    }
    Ok(())
}
