//! Where a kernel ends.
//!
//! Twin: `shaders/shared/cutoff.wgsl`.

use super::budget::{CUTOFF_SHARE, MEETING, OVERLAP};
use crate::constants::MAX_CUTOFF;
use crate::math::lane::{ln, opacity};

/// The cut-off radius r = sqrt(2 ln(max(6 tau, 1) growth / epsilon)), in standard deviations; epsilon
/// is [`CUTOFF_SHARE`] of the tolerance, 6 [`OVERLAP`], `growth` how much the kernel stands out
/// beyond what its depth says.
///
/// What lies beyond, at the edge and as mass, is exp(-r²/2) of the kernel: at most epsilon,
/// relative to the kernel's own depth where that is small (many faint kernels add up), absolute
/// where it is not, and then a sixth of it. `tau` is the optical depth at the centre; `by_hand` replaces the rule where it is
/// positive. The mass is given back by [`cutoff_share`], so that the opacity errs by no more than
/// epsilon / (1 - epsilon) anywhere (`tests/frames/bounds.rs`), unless [`MAX_CUTOFF`] is met: from
/// tau / epsilon = 4e10 on. That is one kernel; where the edges of many meet in a pixel, what
/// they leave out adds up: five epsilons were seen among hundreds of kernels, two in one pixel of
/// a thousand. Of n kernels in one place, n/6 epsilons at most: beyond six of them `tau` comes
/// multiplied by n/6, which leaves one, and by what may meet them from beside ([`meeting`]).
#[inline(always)]
pub fn cutoff_radius(tau: f32, growth: f32, tolerance: f32, by_hand: f32) -> f32 {
    if by_hand > 0.0 {
        return by_hand.min(MAX_CUTOFF);
    }
    // `min` takes the other argument when one is NaN.
    (2.0 * ln((tau * OVERLAP).max(1.0) * growth.max(1.0) / (tolerance * CUTOFF_SHARE)))
        .max(1.0)
        .sqrt()
        .min(MAX_CUTOFF)
}

/// The factor of a kernel's depth if its edge meets the edges of other kernels. In one place, `crowding` times [`OVERLAP`] of
/// them overlap ([`Block::crowding`](crate::blocks::Block::crowding)).
#[inline(always)]
pub fn meeting(crowding: f32) -> f32 {
    if crowding > 1.0 {
        MEETING * crowding
    } else {
        crowding
    }
}

/// The share of a two-dimensional Gaussian within radius `r`: 1 - exp(-r²/2).
#[inline(always)]
pub fn cutoff_share(r: f32) -> f32 {
    opacity::<false>(0.5 * r * r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_table() {
        // 1 - exp(-r²/2) lost at r = 1, 2, 3.33: .61, .135, .0039.
        for (r, lost) in [(1.0_f32, 0.6065), (2.0, 0.1353), (3.33, 0.00391)] {
            assert!((1.0 - cutoff_share(r) - lost).abs() < 1e-4);
        }
        let whole = 1.0 / 255.0 / CUTOFF_SHARE;
        assert!((cutoff_radius(0.1, 1.0, whole, 0.0) - 3.329).abs() < 1e-3);
        assert!(cutoff_radius(10.0 / OVERLAP, 1.0, whole, 0.0) > 3.9);
        assert_eq!(cutoff_radius(f32::MAX, 1.0, 1e-9, 0.0), MAX_CUTOFF);
        assert_eq!(cutoff_radius(1.0, 1.0, 0.01, 2.0), 2.0);
    }
}
