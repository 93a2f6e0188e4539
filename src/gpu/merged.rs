//! Runs the numerical functions of merged particles, for their test only: stages use
//! `shaders/shared/averages.wgsl`, `maxima.wgsl` and `ein.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::constants::THREADS;
use super::device::Gpu;
use super::kernel::Access;
use super::scene::{packed_maxima, packed_table};
use super::shader::{AVERAGES, DISPATCH, EIN, EXPONENTIAL, MAXIMA, STRUCTS, Shader, TRANSFER};
use crate::blocks::MergedTransfer;
use crate::error::Result;
use crate::scene::{TransferFunction, Weighting};

/// Shader of the functions.
pub(super) const SHADER: Shader = Shader::new(
    "merged",
    &[
        DISPATCH,
        STRUCTS,
        EXPONENTIAL,
        TRANSFER,
        AVERAGES,
        MAXIMA,
        EIN,
        include_str!("../../shaders/merged.wgsl"),
    ],
);

/// Results of the device for a pair (a, b).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MergedNumbers {
    /// [`Averages::classify_spread`](crate::scene::Averages::classify_spread) of a and b.
    pub average: [f32; 4],
    /// [`Slopes::max_slope`](crate::scene::Slopes::max_slope) from a to a + |b|.
    pub slope: f32,
    /// [`ein`](crate::math::ein) of |b|.
    pub ein: f32,
    /// [`ein_share`](crate::math::ein_share) of |b|.
    pub ein_share: f32,
}

/// Evaluates the functions that merged particles need at many pairs.
///
/// # Errors
/// No memory, or a lost device.
pub fn merged_numbers(
    gpu: &Gpu,
    transfer: &TransferFunction,
    weighting: Weighting,
    pairs: &[[f32; 2]],
) -> Result<Vec<MergedNumbers>> {
    let merged = MergedTransfer::new(transfer, weighting);
    let table = gpu.upload("transfer function", &packed_table(transfer, Some(&merged)))?;
    let maxima = gpu.upload("maxima", &packed_maxima(transfer, Some(&merged), None))?;
    let input = gpu.upload("pairs", pairs)?;
    let bytes = size_of::<MergedNumbers>() as u64 * pairs.len() as u64;
    let output = gpu.buffer("results", bytes)?;
    let is_even = f64::from(u8::from(weighting == Weighting::Even));
    let kernel = gpu.kernel(
        &SHADER,
        "merged_numbers",
        &[Access::Read, Access::Read, Access::Read, Access::Write],
        &[("IS_EVEN", is_even)],
    );
    let bound = kernel.bind(gpu, &[&table, &maxima, &input, &output]);
    gpu.run(|pass| bound.dispatch(pass, (pairs.len() as u32).div_ceil(THREADS)));
    gpu.read(&output, pairs.len())
}
