// Runs every operation of shared/f64.wgsl on pairs of numbers. For the test only.

struct F64Results {
    sum: vec2<u32>,
    difference: vec2<u32>,
    product: vec2<u32>,
    quotient: vec2<u32>,
    root: vec2<u32>,
    greater: vec2<u32>,
    lesser: vec2<u32>,
    // The first number's high word, read as an f32 and widened.
    widened: vec2<u32>,
    // The first number narrowed to f32, as bits.
    narrowed: u32,
    truncated: u32,
    is_at_least_zero: u32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> f64_pairs: array<array<vec2<u32>, 2>>;
@group(0) @binding(1) var<storage, read_write> f64_results: array<F64Results>;

@compute @workgroup_size(THREADS)
fn f64_operations(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    if i >= arrayLength(&f64_pairs) {
        return;
    }
    let a = f64_pairs[i][0];
    let b = f64_pairs[i][1];
    f64_results[i] = F64Results(
        f64_add(a, b),
        f64_sub(a, b),
        f64_mul(a, b),
        f64_div(a, b),
        f64_sqrt(a),
        f64_max(a, b),
        f64_min(a, b),
        f64_from_f32(bitcast<f32>(a.y)),
        bitcast<u32>(f64_to_f32(a)),
        f64_to_u32(a),
        u32(f64_is_at_least_zero(a)),
        0u,
    );
}
