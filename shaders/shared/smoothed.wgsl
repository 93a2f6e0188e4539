// Computes the means over pixels of projected SPH kernels, for sums of columns. Twin: src/splat/smoothed.rs.

// True if footprints may be drawn by their SPH kernels.
override SMOOTHS: bool = false;

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
    if !SMOOTHS || low_pass_variance_px2 != PIXEL_VARIANCE_PX2 {
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
    let least = LEAST_REACH_PX * LEAST_REACH_PX;
    let is_half = reach_squared < least;
    let is_quarter = reach_squared * 4.0 < least;
    let is_eighth = reach_squared * 16.0 < least;
    own.parts = select(select(select(1u, 2u, is_half), 4u, is_quarter), 8u, is_eighth);
    let fine = reach_squared * f32(own.parts * own.parts);
    own.per_form = wide / reach_squared;
    own.amplitude = peak * TAU * own.per_form / f32(own.parts * own.parts);
    own.bend = 1.0 / fine;
    return own;
}

// Returns the share of a part of a pixel, by the footprint's quadratic form at its middle. Without a loop, because software
// adapters end all loops of a thread after a number of iterations.
fn smoothed_at(own: Smoothed, q: f32) -> f32 {
    let t = min(q * own.per_form, 1.0);
    let s = 2.0 * t - 1.0;
    let u = s * s;
    let rest = 1.0 - t;
    var values = PROJECTED;
    let v = 15u * own.kernel;
    var even = values[v + 14u];
    var odd = values[v + 13u];
    even = even * u + values[v + 12u];
    odd = odd * u + values[v + 11u];
    even = even * u + values[v + 10u];
    odd = odd * u + values[v + 9u];
    even = even * u + values[v + 8u];
    odd = odd * u + values[v + 7u];
    even = even * u + values[v + 6u];
    odd = odd * u + values[v + 5u];
    even = even * u + values[v + 4u];
    odd = odd * u + values[v + 3u];
    even = even * u + values[v + 2u];
    odd = odd * u + values[v + 1u];
    even = even * u + values[v + 0u];
    let value = (odd * s + even) * (rest * rest);
    var bends = BENT;
    let b = 11u * own.kernel;
    even = bends[b + 10u];
    odd = bends[b + 9u];
    even = even * u + bends[b + 8u];
    odd = odd * u + bends[b + 7u];
    even = even * u + bends[b + 6u];
    odd = odd * u + bends[b + 5u];
    even = even * u + bends[b + 4u];
    odd = odd * u + bends[b + 3u];
    even = even * u + bends[b + 2u];
    odd = odd * u + bends[b + 1u];
    even = even * u + bends[b + 0u];
    let bent = odd * s + even;
    // The fit falls below 0 near the rim, by less than its error.
    return own.amplitude * max((value + bent * own.bend) * rest, 0.0);
}

// Returns the mean over the pixel whose centre lies `d` from the footprint's, px.
fn smoothed_mean(own: Smoothed, p: vec2<f32>, r: vec2<f32>, d: vec2<f32>) -> f32 {
    let step = 1.0 / f32(own.parts);
    var sum = 0.0;
    for (var n = 0u; n < own.parts * own.parts; n = n + 1u) {
        let part = vec2<f32>(f32(n % own.parts), f32(n / own.parts));
        let place = d + (part + 0.5) * step - 0.5;
        let form = vec2<f32>(dot(p, place), dot(r, place));
        sum = sum + smoothed_at(own, dot(form, form));
    }
    return sum;
}
