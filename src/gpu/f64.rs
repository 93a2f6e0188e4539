//! Runs double-precision arithmetic in integers, for its test only: stages use `shaders/shared/f64.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::constants::THREADS;
use super::device::Gpu;
use super::kernel::Access;
use super::shader::{DISPATCH, F64_ARITHMETIC, Shader};
use crate::error::Result;

/// Shader of the operations.
pub(super) const SHADER: Shader = Shader::new(
    "f64",
    &[
        DISPATCH,
        F64_ARITHMETIC,
        include_str!("../../shaders/f64.wgsl"),
    ],
);

/// Results of the device for a pair (a, b), f64 as their bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct F64Results {
    /// a + b.
    pub sum: u64,
    /// a - b.
    pub difference: u64,
    /// a b.
    pub product: u64,
    /// a / b.
    pub quotient: u64,
    /// The square root of a.
    pub root: u64,
    /// The greater of both; b if a is NaN.
    pub greater: u64,
    /// The lesser of both; b if a is NaN.
    pub lesser: u64,
    /// The high word of a, read as an f32 and widened.
    pub widened: u64,
    /// a narrowed to f32, as bits.
    pub narrowed: u32,
    /// a converted to u32.
    pub truncated: u32,
    /// 1 if a >= 0, 0 otherwise.
    pub is_at_least_zero: u32,
    unused: u32,
}

/// Runs every operation of `shaders/shared/f64.wgsl` on pairs of numbers.
///
/// # Errors
/// No memory, or a lost device.
pub fn f64_operations(gpu: &Gpu, pairs: &[[f64; 2]]) -> Result<Vec<F64Results>> {
    let input = gpu.upload("pairs", pairs)?;
    let output = gpu.buffer(
        "results",
        size_of::<F64Results>() as u64 * pairs.len() as u64,
    )?;
    let kernel = gpu.kernel(
        &SHADER,
        "f64_operations",
        &[Access::Read, Access::Write],
        &[],
    );
    let bound = kernel.bind(gpu, &[&input, &output]);
    gpu.run(|pass| bound.dispatch(pass, (pairs.len() as u32).div_ceil(THREADS)));
    gpu.read(&output, pairs.len())
}
