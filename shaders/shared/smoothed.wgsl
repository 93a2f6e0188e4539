// Computes the means over pixels of projected SPH kernels, for sums of columns. Twin: src/splat/smoothed.rs.

struct Smoothed {
    // True if the footprint is drawn by its SPH kernel rather than as a Gaussian.
    is_drawn: bool,
    kernel: u32,
    per_form: f32,
    amplitude: f32,
    bend: f32,
    parts: u32,
}

fn smoothed_of(
    smoothing: u32,
    low_pass_variance_px2: f32,
    p: vec2<f32>,
    r: vec2<f32>,
    peak: f32,
) -> Smoothed {
    var own = Smoothed();
    if smoothing == 0u || low_pass_variance_px2 != PIXEL_VARIANCE_PX2 {
        return own;
    }
    own.kernel = smoothing - 1u;
    var reaches = REACHES;
    let wide = 1.0 / abs(p.x * r.y - p.y * r.x);
    let reach_squared = (wide - PIXEL_VARIANCE_PX2) * reaches[own.kernel];
    if !(reach_squared >= LEAST_DRAWN_PX * LEAST_DRAWN_PX && is_finite(reach_squared)) {
        return own;
    }
    own.is_drawn = true;
    own.parts = 1u;
    var fine = reach_squared;
    while fine < LEAST_REACH_PX * LEAST_REACH_PX {
        fine = fine * 4.0;
        own.parts = own.parts * 2u;
    }
    own.per_form = wide / reach_squared;
    own.amplitude = peak * TAU * own.per_form / f32(own.parts * own.parts);
    own.bend = 1.0 / fine;
    return own;
}

// Returns the share of a part of a pixel, by the footprint's quadratic form at its middle.
fn smoothed_at(own: Smoothed, q: f32) -> f32 {
    let t = min(q * own.per_form, 1.0);
    let s = 2.0 * t - 1.0;
    let u = s * s;
    let rest = 1.0 - t;
    var values = PROJECTED;
    var even = values[15u * own.kernel + 14u];
    var odd = 0.0;
    for (var n = 14u; n > 0u; n = n - 2u) {
        odd = odd * u + values[15u * own.kernel + n - 1u];
        even = even * u + values[15u * own.kernel + n - 2u];
    }
    let value = (odd * s + even) * (rest * rest);
    var bends = BENT;
    even = bends[11u * own.kernel + 10u];
    odd = 0.0;
    for (var n = 10u; n > 0u; n = n - 2u) {
        odd = odd * u + bends[11u * own.kernel + n - 1u];
        even = even * u + bends[11u * own.kernel + n - 2u];
    }
    let bent = odd * s + even;
    // The fit falls below 0 near the rim, by less than its error.
    return own.amplitude * max((value + bent * own.bend) * rest, 0.0);
}

// Returns the mean over the pixel whose centre lies `d` from the footprint's, px.
fn smoothed_mean(own: Smoothed, p: vec2<f32>, r: vec2<f32>, d: vec2<f32>) -> f32 {
    let step = 1.0 / f32(own.parts);
    var sum = 0.0;
    for (var j = 0u; j < own.parts; j = j + 1u) {
        for (var i = 0u; i < own.parts; i = i + 1u) {
            let place = d + (vec2<f32>(f32(i), f32(j)) + 0.5) * step - 0.5;
            let form = vec2<f32>(dot(p, place), dot(r, place));
            sum = sum + smoothed_at(own, dot(form, form));
        }
    }
    return sum;
}
