//! Instruction sets that inner loops are compiled for.

use std::sync::OnceLock;

/// Instruction sets that the rasteriser's inner loops are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// What every processor of the target has.
    Baseline,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512 F, DQ and VL.
    Avx512,
}

impl SimdLevel {
    /// All of them, the best last.
    const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// The levels that this processor has, the best last.
    pub fn available() -> Vec<Self> {
        let best = Self::best();
        Self::ALL
            .into_iter()
            .filter(|level| *level <= best)
            .collect()
    }

    /// The best level of this processor, which is asked once.
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
