//! Stage: a background behind pixels. Twin: [`crate::cpu::resolve`].

use bytemuck::{Pod, Zeroable};

use super::constants::THREADS;
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shader::{DISPATCH, Shader};

/// The background.
pub(super) const SHADER: Shader = Shader::new(
    "resolve",
    &[DISPATCH, include_str!("../../shaders/resolve.wgsl")],
);

/// The background and the number of pixels before it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Background {
    pub(super) colour: [f32; 3],
    pub(super) pixels: u32,
}

impl Background {
    /// Linear RGB.
    pub(super) fn new(colour: [f32; 3], pixels: u32) -> Self {
        Self { colour, pixels }
    }
}

/// The pipeline.
#[derive(Debug)]
pub(super) struct Resolve(Kernel);

impl Resolve {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let bindings = [Access::Uniform, Access::Write];
        Self(gpu.kernel(&SHADER, "resolve", &bindings, &[]))
    }

    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        background: &wgpu::Buffer,
        pixels: &wgpu::Buffer,
    ) -> BoundKernel {
        self.0.bind(gpu, &[background, pixels])
    }

    /// Workgroups for so many pixels.
    pub(super) fn groups(pixels: u32) -> u32 {
        pixels.div_ceil(THREADS)
    }
}
