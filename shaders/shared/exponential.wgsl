// Computes exponentials with a known error, the same on every device. Twin: src/math/lane.rs.

// Returns (2^n, 2^f - 1) of 2^y, with n the nearest integer, for y in [-126, 0].
fn exp2_parts(y: f32) -> vec2<f32> {
    let n = round(y);
    let f = y - n;
    let power = bitcast<f32>(u32(i32(n) + 127) << 23u);
    var series = EXP2_SERIES[3];
    series = series * f + EXP2_SERIES[2];
    series = series * f + EXP2_SERIES[1];
    series = series * f + EXP2_SERIES[0];
    series = series * f + LN_2;
    return vec2<f32>(power, series * f);
}

// Returns exp(-q/2) for q in [0, 49].
fn exp_minus_half(q: f32) -> f32 {
    let parts = exp2_parts(q * (-0.5 * LOG2_E));
    return parts.x * parts.y + parts.x;
}

// Returns exp(x) for x <= 0; 0 below -87, where normal numbers end.
fn exp_negative(x: f32) -> f32 {
    let parts = exp2_parts(max(x, -87.0) * LOG2_E);
    return select(0.0, parts.x * parts.y + parts.x, x >= -87.0);
}

// Returns 1 - exp(-tau) for tau >= 0, with a small relative error at any tau.
fn opacity_of(tau: f32) -> f32 {
    let parts = exp2_parts(min(tau, 64.0) * -LOG2_E);
    return (1.0 - parts.x) - parts.x * parts.y;
}

// Returns Phi(x). Twin: src/math/normal.rs.
fn normal_cdf(x: f32) -> f32 {
    let z = abs(x) * FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * z);
    var poly = t * ERFC_SERIES[9];
    poly = t * (ERFC_SERIES[8] + poly);
    poly = t * (ERFC_SERIES[7] + poly);
    poly = t * (ERFC_SERIES[6] + poly);
    poly = t * (ERFC_SERIES[5] + poly);
    poly = t * (ERFC_SERIES[4] + poly);
    poly = t * (ERFC_SERIES[3] + poly);
    poly = t * (ERFC_SERIES[2] + poly);
    poly = t * (ERFC_SERIES[1] + poly);
    let tail = 0.5 * t * exp_negative(-z * z + ERFC_SERIES[0] + poly);
    return select(1.0 - tail, tail, x < 0.0);
}
