//! Stage: composites pixels over a background, and decodes sRGB codes. Twin: [`crate::cpu::resolve`].

use bytemuck::{Pod, Zeroable};

use super::constants::THREADS;
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shader::{DISPATCH, SRGB, Shader};
use crate::image::srgb_from_linear;

/// Shader of the stage.
pub(super) const SHADER: Shader = Shader::new(
    "resolve",
    &[DISPATCH, SRGB, include_str!("../../shaders/resolve.wgsl")],
);

/// The background, the number of pixels before it, and their encoding.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Background {
    pub(super) colour: [f32; 3],
    pub(super) pixels: u32,
    pub(super) is_shown: u32,
    pub(super) is_encoded: u32,
    pub(super) unused: [u32; 2],
}

impl Background {
    /// Makes the uniform.
    ///
    /// - `colour`: linear RGB, if there is a background.
    /// - `is_encoded`: whether pixels are sRGB codes.
    pub(super) fn new(colour: Option<[f32; 3]>, is_encoded: bool, pixels: u32) -> Self {
        let shown = colour.unwrap_or_default();
        Self {
            colour: match is_encoded {
                true => shown.map(srgb_from_linear),
                false => shown,
            },
            pixels,
            is_shown: u32::from(colour.is_some()),
            is_encoded: u32::from(is_encoded),
            unused: [0; 2],
        }
    }

    /// Returns whether the stage changes pixels.
    pub(super) fn is_needed(&self) -> bool {
        self.is_shown != 0 || self.is_encoded != 0
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

    /// Returns the number of workgroups for so many pixels.
    pub(super) fn groups(pixels: u32) -> u32 {
        pixels.div_ceil(THREADS)
    }
}
