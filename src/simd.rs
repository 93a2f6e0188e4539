//! Selects instruction sets. Inner loops are plain Rust over arrays of lanes, compiled once for each level with
//! that level's target features; the compiler vectorises them.

use std::sync::OnceLock;

/// Instruction sets for which inner loops are compiled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// The features that every processor of the target has.
    Baseline,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512 F, DQ and VL.
    Avx512,
}

impl SimdLevel {
    /// All levels, the best last.
    const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Returns the levels that this processor supports, the best last.
    pub fn available() -> Vec<Self> {
        let best = Self::best();
        Self::ALL
            .into_iter()
            .filter(|level| *level <= best)
            .collect()
    }

    /// Returns the best level of this processor, which is detected once.
    #[inline]
    pub fn best() -> Self {
        static BEST: OnceLock<SimdLevel> = OnceLock::new();
        *BEST.get_or_init(Self::detect)
    }

    fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                let has_avx512 = is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl");
                return if has_avx512 { Self::Avx512 } else { Self::Avx2 };
            }
        }
        Self::Baseline
    }
}

/// Work that is compiled for an instruction set as a whole.
pub(crate) trait SimdWork {
    /// Result of the work.
    type Output;

    /// Does the work; inlined into a function with the level's features.
    ///
    /// - `FMA`: true if the level fuses a product and a sum.
    /// - `LANES`: number of pixels of a row that a fused loop processes at once.
    fn run<const FMA: bool, const LANES: usize>(self) -> Self::Output;
}

/// Runs `work` at `level`, or at the processor's best level if that is lower.
#[inline(always)]
pub(crate) fn run_at<W: SimdWork>(level: SimdLevel, work: W) -> W::Output {
    match level.min(SimdLevel::best()) {
        // SAFETY: the level was just clamped to `SimdLevel::best`, which asked the processor for
        // these very features.
        #[cfg(target_arch = "x86_64")]
        #[allow(
            unsafe_code,
            reason = "calls into functions compiled for detected features"
        )]
        SimdLevel::Avx512 => unsafe { run_avx512(work) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        #[allow(
            unsafe_code,
            reason = "calls into functions compiled for detected features"
        )]
        SimdLevel::Avx2 => unsafe { run_avx2(work) },
        _ => work.run::<false, 8>(),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn run_avx512<W: SimdWork>(work: W) -> W::Output {
    work.run::<true, 16>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<W: SimdWork>(work: W) -> W::Output {
    work.run::<true, 8>()
}
