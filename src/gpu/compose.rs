//! Stage: opaque surfaces behind what lies in front of them. Twin: `compose` of `cpu/cut.rs`.

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::rasterise::RasterSpec;
use super::shaders;

/// The pipeline; a thread per pixel, as [`Resolve`](super::resolve::Resolve).
#[derive(Debug)]
pub(super) struct Compose(Kernel);

impl Compose {
    pub(super) fn new(gpu: &Gpu, spec: RasterSpec) -> Self {
        let bindings = [Access::Uniform, Access::Write, Access::Read];
        let flag = |is: bool| f64::from(u8::from(is));
        let constants = [
            ("HAS_DEPTH", flag(spec.depth)),
            ("IS_COUNT", flag(spec.count)),
        ];
        Self(gpu.kernel(&shaders::COMPOSE, "compose", &bindings, &constants))
    }

    /// - `background`: a uniform [`Background`](super::resolve::Background), of which the number of
    ///   pixels counts.
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
