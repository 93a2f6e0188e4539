//! Stage: composites opaque surfaces behind the volumes in front of them. Twin: `compose` of
//! `cpu/tile/interval/cut.rs`.

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shader::{DISPATCH, Shader};
use crate::splat::Axes;

/// Shader of the stage.
pub(super) const SHADER: Shader = Shader::new(
    "compose",
    &[DISPATCH, include_str!("../../shaders/compose.wgsl")],
);

/// The pipeline, with a thread per pixel as [`Resolve`](super::resolve::Resolve).
#[derive(Debug)]
pub(super) struct Compose(Kernel);

impl Compose {
    pub(super) fn new(gpu: &Gpu, axes: &Axes) -> Self {
        let bindings = [Access::Uniform, Access::Write, Access::Read];
        let flag = |is: bool| f64::from(u8::from(is));
        let constants = [
            ("HAS_DEPTH", flag(axes.depth)),
            ("IS_COUNT", flag(axes.count)),
        ];
        Self(gpu.kernel(&SHADER, "compose", &bindings, &constants))
    }

    /// Binds the stage.
    ///
    /// - `background`: a uniform [`Background`](super::resolve::Background), of which only the number of
    ///   pixels is read.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        background: &wgpu::Buffer,
        pixels: &wgpu::Buffer,
        surface: &wgpu::Buffer,
    ) -> BoundKernel {
        self.0.bind(gpu, &[background, pixels, surface])
    }
}
