// Where a kernel ends. Twin: src/splat/cutoff.rs.

// The cut-off radius r = sqrt(2 ln(max(tau, 1) / tolerance)), in standard deviations, of the share
// of the tolerance that is the cut-off's.
fn cutoff_radius(tau: f32, tolerance: f32, by_hand: f32) -> f32 {
    if by_hand > 0.0 {
        return min(by_hand, MAX_CUTOFF);
    }
    let ratio = max_number(tau, 1.0) / (tolerance * CUTOFF_SHARE);
    if !is_finite(ratio) {
        return MAX_CUTOFF;
    }
    return min(sqrt(max(2.0 * log(ratio), 1.0)), MAX_CUTOFF);
}

// The share of a two-dimensional Gaussian within radius `r`: 1 - exp(-r²/2).
fn cutoff_share(r: f32) -> f32 {
    return -exp_m1(-0.5 * r * r);
}
