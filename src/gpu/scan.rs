//! Prefix sums, which several stages need between counting and placing.

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shaders;
use crate::error::Result;

/// Words that one workgroup sums: 256 threads of 8.
const GROUP: u64 = 2048;

/// The pipelines of a prefix sum.
#[derive(Debug)]
pub(super) struct Scan {
    kernels: [Kernel; 3],
}

/// A prefix sum of certain buffers.
#[derive(Debug)]
pub(super) struct BoundScan {
    reduce: BoundKernel,
    sums: BoundKernel,
    apply: BoundKernel,
    groups: u32,
}

impl Scan {
    /// `length_index`: which word of the buffer of lengths says how many words are summed.
    pub(super) fn new(gpu: &Gpu, length_index: u32) -> Self {
        let kernel = |entry| {
            gpu.kernel(
                &shaders::SCAN,
                entry,
                &[Access::Read, Access::Write, Access::Write],
                &[("LENGTH_INDEX", f64::from(length_index))],
            )
        };
        Self {
            kernels: ["scan_reduce", "scan_sums_of_groups", "scan_apply"].map(kernel),
        }
    }

    /// Binds the buffer of lengths and the buffer of words, which holds `capacity` of them.
    ///
    /// # Errors
    /// No memory for the sums.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        lengths: &wgpu::Buffer,
        words: &wgpu::Buffer,
        capacity: u64,
    ) -> Result<BoundScan> {
        let groups = capacity.div_ceil(GROUP);
        let sums = gpu.buffer("prefix sums", 4 * (groups + 1))?;
        let [reduce, sums, apply] =
            [0, 1, 2].map(|i| self.kernels[i].bind(gpu, &[lengths, words, &sums]));
        Ok(BoundScan {
            reduce,
            sums,
            apply,
            groups: groups as u32,
        })
    }
}

impl BoundScan {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.reduce.dispatch(pass, self.groups);
        self.sums.dispatch(pass, 1);
        self.apply.dispatch(pass, self.groups);
    }
}

/// The sums of the words before each word; `u32::MAX` where they are more.
///
/// # Errors
/// No memory, or a lost device.
pub fn exclusive_scan(gpu: &Gpu, words: &[u32]) -> Result<Vec<u32>> {
    let lengths = gpu.upload("length", &[words.len() as u32])?;
    let buffer = gpu.upload("words", words)?;
    let scan = Scan::new(gpu, 0).bind(gpu, &lengths, &buffer, words.len() as u64)?;
    gpu.run(|pass| scan.encode(pass));
    gpu.read(&buffer, words.len())
}
