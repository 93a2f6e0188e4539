//! Computes prefix sums, which several stages need between counting and placing.

use super::constants::{SCAN_RUN, THREADS};
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::shader::{DISPATCH, SCAN_THREADS, Shader};
use crate::error::Result;

/// Shader of the prefix sums.
pub(super) const SHADER: Shader = Shader::new(
    "scan",
    &[
        DISPATCH,
        SCAN_THREADS,
        include_str!("../../shaders/scan.wgsl"),
    ],
);

/// Words that one workgroup sums.
const GROUP: u64 = (THREADS * SCAN_RUN) as u64;

/// The pipelines of a prefix sum.
#[derive(Debug)]
pub(super) struct Scan {
    prepare: Kernel,
    kernels: [Kernel; 3],
}

/// A prefix sum bound to certain buffers.
#[derive(Debug)]
pub(super) struct BoundScan {
    prepare: BoundKernel,
    reduce: BoundKernel,
    sums: BoundKernel,
    apply: BoundKernel,
    arguments: wgpu::Buffer,
}

impl Scan {
    /// Makes the pipelines.
    ///
    /// - `length_index`: word of the buffer of lengths with the number of words to sum.
    pub(super) fn new(gpu: &Gpu, length_index: u32) -> Self {
        use Access::{Read, Write};
        let kernel = |entry, bindings: &[Access]| {
            let constants = [("LENGTH_INDEX", f64::from(length_index))];
            gpu.kernel(&SHADER, entry, bindings, &constants)
        };
        Self {
            // None of the dispatches binds the buffer of its own arguments.
            prepare: kernel("scan_prepare", &[Read, Write, Write, Write]),
            kernels: ["scan_reduce", "scan_sums_of_groups", "scan_apply"]
                .map(|entry| kernel(entry, &[Read, Write, Write])),
        }
    }

    /// Binds the buffer of lengths and the buffer of words, of which there are at most `capacity`.
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
        let arguments = gpu.buffer("prefix sum arguments", 12)?;
        let prepare = self.prepare.bind(gpu, &[lengths, words, &sums, &arguments]);
        let [reduce, sums, apply] =
            [0, 1, 2].map(|i| self.kernels[i].bind(gpu, &[lengths, words, &sums]));
        Ok(BoundScan {
            prepare,
            reduce,
            sums,
            apply,
            arguments,
        })
    }
}

impl BoundScan {
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.prepare.dispatch(pass, 1);
        self.reduce.dispatch_indirect(pass, &self.arguments, 0);
        self.sums.dispatch(pass, 1);
        self.apply.dispatch_indirect(pass, &self.arguments, 0);
    }
}

/// Returns the sum of the words before each word; `u32::MAX` stands for larger sums.
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
