// The entire exponential integral. Needs exponential.wgsl. Twin: src/math/ein.rs.

fn ein_series(x: f32) -> f32 {
    var sum = 0.0;
    for (var n = 12; n >= 0; n = n - 1) {
        sum = sum * x + EIN_SERIES[n];
    }
    return sum;
}

// Returns Ein(x) / x for x >= 0; 1 at 0.
fn ein_share(x: f32) -> f32 {
    if x < EIN_SPLIT {
        return ein_series(x);
    }
    return ein(x) / min(x, LARGEST);
}

// Returns Ein(x) = the integral of (1 - e^-t) / t from 0 to x, x >= 0.
fn ein(x: f32) -> f32 {
    if x < EIN_SPLIT {
        return x * ein_series(x);
    }
    let finite = min(x, LARGEST);
    let inverse = 1.0 / finite;
    var numerator = 0.0;
    var denominator = 0.0;
    for (var n = 4; n >= 0; n = n - 1) {
        numerator = numerator * inverse + E1_NUMERATOR[n];
        denominator = denominator * inverse + E1_DENOMINATOR[n];
    }
    return log(finite) + (EULER + exp_negative(-finite) * inverse * (numerator / denominator));
}
