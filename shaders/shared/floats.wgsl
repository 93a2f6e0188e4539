// Defines the behaviour of f32 beyond the guarantees of WGSL, which may treat every number as finite.
// Twins: the standard library's.

// Returns a > b; false if either is NaN.
fn is_above(a: f32, b: f32) -> bool {
    return !is_nan(a) && !is_nan(b) && a > b;
}

// Returns a <= b; false if either is NaN.
fn is_at_most(a: f32, b: f32) -> bool {
    return !is_nan(a) && !is_nan(b) && a <= b;
}

// Returns the greater of two; if one is NaN, the other.
fn max_number(a: f32, b: f32) -> f32 {
    if is_nan(a) || is_above(b, a) {
        return b;
    }
    return a;
}

// Returns the smaller of two; if one is NaN, the other.
fn min_number(a: f32, b: f32) -> f32 {
    if is_nan(a) || is_above(a, b) {
        return b;
    }
    return a;
}

// Returns sqrt(a² + b²) without squares that overflow f32; infinite if either is infinite, whatever the
// other.
fn hypot(a: f32, b: f32) -> f32 {
    let large = max_number(abs(a), abs(b));
    if large == 0.0 || !is_finite(large) {
        return large;
    }
    let small = min_number(abs(a), abs(b));
    if is_nan(a) || is_nan(b) {
        return a + b;
    }
    let ratio = small / large;
    return large * sqrt(1.0 + ratio * ratio);
}

// Returns exp(x) - 1 for x below 0, to a few roundings.
fn exp_m1(x: f32) -> f32 {
    if x < -0.5 {
        return exp(x) - 1.0;
    }
    // Taylor series: the remainder is 6e-10 of the sum.
    var sum = 1.0;
    for (var n = 9.0; n > 1.0; n = n - 1.0) {
        sum = 1.0 + x / n * sum;
    }
    return x * sum;
}

// Sums in a fixed order: WGSL leaves it open in `length`, `cross` and products of matrices.

fn length2(v: vec2<f32>) -> f32 {
    return sqrt(dot2(v, v));
}

fn length3(v: vec3<f32>) -> f32 {
    return sqrt(dot3(v, v));
}

fn cross3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return a.yzx * b.zxy - b.yzx * a.zxy;
}

fn times(m: mat3x3<f32>, v: vec3<f32>) -> vec3<f32> {
    return m[0] * v.x + m[1] * v.y + m[2] * v.z;
}

fn is_finite3(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// Returns the largest magnitude among the components.
fn largest_of(v: vec3<f32>) -> f32 {
    return max_number(abs(v.x), max_number(abs(v.y), abs(v.z)));
}
