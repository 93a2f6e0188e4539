// Computes the cut-off radius of a kernel. Twin: src/splat/cutoff.rs.

// Returns the cut-off radius, in standard deviations.
fn cutoff_radius(tau: f32, growth: f32, tolerance: f32, by_hand: f32) -> f32 {
    if by_hand > 0.0 {
        return min(by_hand, MAX_CUTOFF);
    }
    let ratio = max_number(tau * OVERLAP, 1.0) * max_number(growth, 1.0)
        / (tolerance * CUTOFF_SHARE);
    if !is_finite(ratio) {
        return MAX_CUTOFF;
    }
    return min(sqrt(max(2.0 * log(ratio), 1.0)), MAX_CUTOFF);
}

// Returns the factor on a kernel's depth if its edge coincides with the edges of other kernels.
fn meeting(crowding: f32) -> f32 {
    return select(crowding, MEETING * crowding, crowding > 1.0);
}

// Returns the fraction of a two-dimensional Gaussian within radius `r`: 1 - exp(-r²/2).
fn cutoff_share(r: f32) -> f32 {
    return -exp_m1(-0.5 * r * r);
}
