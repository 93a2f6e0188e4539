// Computes the means over pixels of projected SPH kernels, for sums of columns. Twin: src/splat/smoothed.rs.

// True if footprints may be drawn by their SPH kernels.
override SMOOTHS: bool = false;

// One number for each product.
struct Factors {
    low: vec4<f32>,
    high: vec4<f32>,
}

// An entry of a table: antiderivatives, and functions with their derivatives over the factorials, in steps of the table.
struct ProfileKnot {
    sums: Factors,
    values: Factors,
    slopes: Factors,
    seconds: Factors,
    thirds: Factors,
}

struct Profiles {
    // Entries at even steps of the distance, from 0 to the support.
    knots: array<ProfileKnot, PROFILE_CELLS + 1u>,
    signs: Factors,
}

// The frame's kernel.
@group(0) @binding(10) var<uniform> profiles: Profiles;

struct Smoothed {
    // True if the footprint is drawn by its SPH kernel rather than as a Gaussian.
    is_drawn: bool,
    // Supports in a pixel along an axis; along x, at a fixed y.
    per_px: vec2<f32>,
    // Change of x by y on the line through the middles of the rows.
    tilt: f32,
    // Factor of a pixel's mean, as column.
    amplitude: f32,
    // Rows of a pixel.
    rows: f32,
}

// The entry nearest to a distance from the centre, and the place beside it, in steps of the table.
struct NearestKnot {
    index: u32,
    t: f32,
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
    var reaches = REACHES;
    let wide = 1.0 / abs(p.x * r.y - p.y * r.x);
    let reach_squared = (wide - PIXEL_VARIANCE_PX2) * reaches[smoothing - 1u];
    if !(reach_squared >= LEAST_DRAWN_PX * LEAST_DRAWN_PX && is_finite(reach_squared)) {
        return own;
    }
    own.is_drawn = true;
    let per_form = wide / reach_squared;
    let along = p.x * p.x + r.x * r.x;
    own.tilt = -(p.x * p.y + r.x * r.y) / along;
    let x = sqrt(along * per_form);
    let area = per_form / wide;
    own.per_px = vec2<f32>(x, area / x);
    own.amplitude = peak * TAU * per_form;
    own.rows = clamp(ceil(ROWS_PER_SHEAR * sqrt(abs(own.tilt) * area)), 1.0, MOST_ROWS);
    return own;
}

fn nearest_knot(x: f32) -> NearestKnot {
    let place = min(abs(x), 1.0) * f32(PROFILE_CELLS);
    let nearest = round(place);
    return NearestKnot(min(u32(nearest), PROFILE_CELLS), place - nearest);
}

// Returns the sum of a list and of three lists with weights.
fn profile_series(first: Factors, a: Factors, b: Factors, c: Factors, weights: vec3<f32>) -> Factors {
    return Factors(
        first.low + (weights.x * a.low + (weights.y * b.low + weights.z * c.low)),
        first.high + (weights.x * a.high + (weights.y * b.high + weights.z * c.high)),
    );
}

// Returns the antiderivatives at a distance from the centre, for a positive distance.
fn profile_sums(x: f32) -> Factors {
    let near = nearest_knot(x);
    let knot = profiles.knots[near.index];
    let step = near.t / f32(PROFILE_CELLS);
    let weights = vec3<f32>(step, step * (near.t / 2.0), step * (near.t * near.t * (1.0 / 3.0)));
    return profile_series(knot.sums, knot.values, knot.slopes, knot.seconds, weights);
}

// Returns the functions at a distance from the centre.
fn profile_values(x: f32) -> Factors {
    let near = nearest_knot(x);
    let knot = profiles.knots[near.index];
    let square = near.t * near.t;
    let weights = vec3<f32>(near.t, square, square * near.t);
    return profile_series(knot.values, knot.slopes, knot.seconds, knot.thirds, weights);
}

// Returns the means along a side, by its middle and its length.
fn profile_mean(middle: f32, length: f32) -> Factors {
    if length < SHORT_SIDE {
        let away = SIDE_PLACE * length;
        let a = profile_values(middle - away);
        let b = profile_values(middle + away);
        return Factors(0.5 * (a.low + b.low), 0.5 * (a.high + b.high));
    }
    let begin = middle - 0.5 * length;
    let end = middle + 0.5 * length;
    let before = profile_sums(begin);
    let after = profile_sums(end);
    let per_length = 1.0 / length;
    let of_before = select(per_length, -per_length, begin < 0.0);
    let of_after = select(per_length, -per_length, end < 0.0);
    return Factors(
        of_after * after.low - of_before * before.low,
        of_after * after.high - of_before * before.high,
    );
}

// Returns the mean over the pixel whose centre lies `d` from the footprint's, px.
fn smoothed_mean(own: Smoothed, d: vec2<f32>) -> f32 {
    let y = max(abs(d.y) - 0.5, 0.0) * own.per_px.y;
    if y >= 1.0 {
        return 0.0;
    }
    let half_chord = sqrt(1.0 - y * y) / own.per_px.x + 0.5 + 0.5 * abs(own.tilt);
    if !(abs(d.x - own.tilt * d.y) < half_chord) {
        return 0.0;
    }
    let share = 1.0 / own.rows;
    var sum = 0.0;
    for (var row = 0.0; row < own.rows; row = row + 1.0) {
        let dy = d.y + (row + 0.5) * share - 0.5;
        let of_y = profile_mean(dy * own.per_px.y, share * own.per_px.y);
        let of_x = profile_mean((d.x - own.tilt * dy) * own.per_px.x, own.per_px.x);
        let low = profiles.signs.low * of_y.low;
        let high = profiles.signs.high * of_y.high;
        sum = sum + share * (dot(low, of_x.low) + dot(high, of_x.high));
    }
    // Sums of products fall below 0 near the rim, by less than their error.
    return own.amplitude * max(sum, 0.0);
}
