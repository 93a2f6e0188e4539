//! Computes the cut-off radius of a kernel.
//!
//! Twin: `shaders/shared/cutoff.wgsl`.

use super::budget::{CUTOFF_SHARE, MEETING, OVERLAP};
use crate::constants::MAX_CUTOFF;
use crate::math::lane::{ln, opacity};

/// Returns the cut-off radius r = sqrt(2 ln(max(6 tau, 1) growth / epsilon)), in standard deviations.
/// Here epsilon is [`CUTOFF_SHARE`] of the tolerance and 6 is [`OVERLAP`].
///
/// - `tau`: optical depth at the centre.
/// - `growth`: factor by which the kernel exceeds the value that follows from its depth.
/// - `by_hand`: replaces the rule if positive.
///
/// The part cut off, both at the edge and as mass, is exp(-r²/2) of the kernel. It is at most epsilon
/// relative to the kernel's own depth if that is small, because many faint kernels add up. For deep
/// kernels it is at most a sixth of epsilon, absolute.
///
/// [`cutoff_share`] restores the mass. The opacity then errs by no more than epsilon / (1 - epsilon)
/// anywhere (`tests/frames/bounds.rs`), unless [`MAX_CUTOFF`] limits the radius: from tau / epsilon =
/// 4e10 on.
///
/// This holds for one kernel. If the edges of many coincide in a pixel, their errors add up: five
/// epsilons were seen among hundreds of kernels, two in one pixel of a thousand. For n kernels at one
/// point the sum is n/6 epsilons at most. Callers multiply `tau` by n/6 for more than six, which reduces
/// the sum to one epsilon, and by a factor for neighbouring kernels ([`meeting`]).
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

/// Returns the factor on a kernel's depth if its edge coincides with the edges of other kernels. At one
/// point, `crowding` times [`OVERLAP`] kernels overlap
/// ([`Block::crowding`](crate::blocks::Block::crowding)).
#[inline(always)]
pub fn meeting(crowding: f32) -> f32 {
    if crowding > 1.0 {
        MEETING * crowding
    } else {
        crowding
    }
}

/// Returns the fraction of a two-dimensional Gaussian within radius `r`: 1 - exp(-r²/2).
#[inline(always)]
pub fn cutoff_share(r: f32) -> f32 {
    opacity::<false>(0.5 * r * r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_table() {
        // Fraction lost, exp(-r²/2), at r = 1, 2, 3.33: .61, .135, .0039.
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
