//! Collects arrays of anisotropic kernels in parallel.

pub(crate) mod even;
pub(in crate::sample) mod ghosts;
pub(crate) mod levels;
pub(crate) mod planes;
pub(crate) mod sums;

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::left_out::LeftOut;
use crate::error::Result;
use crate::math::{ExactSum, narrowed};
use crate::sample::positions::index_u32;
use crate::sample::positions::mean_spacing;
use crate::sample::report::SampleReport;
use crate::task::{Stage, Task};

/// A kernel, as the scene stores it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kernel {
    pub(super) position: DVec3,
    /// Lower-triangular factor.
    pub(super) factor: [f32; 6],
    pub(super) volume: f32,
}

impl Kernel {
    /// Narrows a factor and a volume to single precision; fails if single precision cannot hold them.
    pub(super) fn new(position: DVec3, factor: [f64; 6], volume: f64) -> Result<Self, LeftOut> {
        let kernel = Self {
            position,
            factor: factor.map(narrowed),
            volume: narrowed(volume),
        };
        let sound = kernel.factor.iter().all(|l| l.is_finite())
            && kernel.factor.iter().any(|l| l.abs() >= f32::MIN_POSITIVE)
            && kernel.volume.is_finite()
            && kernel.volume >= f32::MIN_POSITIVE;
        if sound {
            Ok(kernel)
        } else {
            Err(LeftOut::BeyondSinglePrecision)
        }
    }
}

/// The kernels of the samples that have one.
#[derive(Debug, Default)]
pub(super) struct Kernels {
    pub(super) positions: Vec<DVec3>,
    pub(super) factors: Vec<[f32; 6]>,
    pub(super) volumes: Vec<f32>,
    /// The sample of each kernel.
    pub(super) kept: Vec<u32>,
}

impl Kernels {
    /// Collects the kernels that `kernel_of` returns for samples 0 to `count`, and reports samples without one.
    ///
    /// - `own`: the samples that the report covers.
    pub(super) fn collect(
        count: usize,
        own: &Range<usize>,
        report: &mut SampleReport,
        noun: &'static str,
        task: Option<&Task>,
        kernel_of: impl Fn(usize) -> Result<Kernel, LeftOut> + Sync,
    ) -> Result<Self> {
        Self::collect_runs(count, own, report, noun, task, |samples, each| {
            for i in samples {
                each(i, kernel_of(i));
            }
        })
    }

    /// Collects the kernels that `kernels_of` passes on for a range of samples at a time.
    ///
    /// Kernels are written in place and compacted afterwards: a second copy of a large grid's kernels may
    /// exceed the memory.
    pub(super) fn collect_runs(
        count: usize,
        own: &Range<usize>,
        report: &mut SampleReport,
        noun: &'static str,
        task: Option<&Task>,
        kernels_of: impl Fn(Range<usize>, &mut dyn FnMut(usize, Result<Kernel, LeftOut>)) + Sync,
    ) -> Result<Self> {
        let stage = Stage::new(task, "shaping kernels", count);
        let mut all = Self {
            positions: vec![DVec3::ZERO; count],
            factors: vec![[0.0; 6]; count],
            volumes: vec![0.0; count],
            kept: Vec::new(),
        };
        let mut faults: Vec<Option<LeftOut>> = vec![None; count];
        (
            all.positions.par_chunks_mut(Stage::GRAIN),
            all.factors.par_chunks_mut(Stage::GRAIN),
            all.volumes.par_chunks_mut(Stage::GRAIN),
            faults.par_chunks_mut(Stage::GRAIN),
        )
            .into_par_iter()
            .enumerate()
            .for_each(|(n, (positions, factors, volumes, faults))| {
                let first = n * Stage::GRAIN;
                if !stage.counts(first) {
                    return;
                }
                kernels_of(first..first + faults.len(), &mut |i, kernel| {
                    let i = i - first;
                    match kernel {
                        Ok(kernel) => {
                            (positions[i], factors[i], volumes[i]) =
                                (kernel.position, kernel.factor, kernel.volume);
                        }
                        Err(reason) => faults[i] = Some(reason),
                    }
                });
            });
        stage.check()?;
        let of_own = faults[own.clone()].iter().copied();
        LeftOut::report(report, noun, of_own.flatten());
        let is_kept = |i: &usize| faults[*i].is_none();
        all.kept = (0..count).filter(is_kept).map(index_u32).collect();
        if all.kept.len() < count {
            close_up(&mut all.positions, &all.kept);
            close_up(&mut all.factors, &all.kept);
            close_up(&mut all.volumes, &all.kept);
        }
        Ok(all)
    }

    /// Returns the kernels of a range of samples.
    pub(super) fn within(&self, samples: &Range<usize>) -> Range<usize> {
        let place = |sample: usize| self.kept.partition_point(|&kept| (kept as usize) < sample);
        place(samples.start)..place(samples.end)
    }

    /// Returns the cube root of the kernels' mean volume.
    pub(super) fn mean_spacing(&self) -> f64 {
        let mut total = ExactSum::default();
        self.volumes.iter().for_each(|v| total.add(f64::from(*v)));
        mean_spacing(total.value(), self.volumes.len())
    }
}

/// Moves the `kept` entries, which ascend, to the front and drops the rest.
fn close_up<T: Copy>(entries: &mut Vec<T>, kept: &[u32]) {
    for (to, &from) in kept.iter().enumerate() {
        entries[to] = entries[from as usize];
    }
    entries.truncate(kept.len());
    entries.shrink_to_fit();
}
