//! Instruction sets: the loops over pixels are plain Rust over arrays of lanes, compiled once for each
//! level with that level's target features; the compiler turns them into vectors.

use crate::simd::SimdLevel;

/// Work that gains from being compiled for an instruction set as a whole.
pub(super) trait TileWork {
    /// What it returns.
    type Output;

    /// The work; inlined into a function of the level's features.
    ///
    /// - `FMA`: whether these fuse a product and a sum.
    /// - `LANES`: how many pixels of a row a fused loop takes at once.
    fn run<const FMA: bool, const LANES: usize>(self) -> Self::Output;
}

/// Runs `work` at `level`, or at the best that the processor has where that is less.
#[inline(always)]
pub(super) fn run_at<W: TileWork>(level: SimdLevel, work: W) -> W::Output {
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
fn run_avx512<W: TileWork>(work: W) -> W::Output {
    work.run::<true, 16>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<W: TileWork>(work: W) -> W::Output {
    work.run::<true, 8>()
}
