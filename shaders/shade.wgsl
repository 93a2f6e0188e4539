// Stage: evaluates colours of radiance fields, once per visible particle: harmonics of the direction from
// the eye to the particle (for an orthographic camera: of its axis). Twin: src/cpu/shade.rs,
// src/math/harmonics.rs.

@group(0) @binding(0) var<storage, read> camera: CameraUniform;
@group(0) @binding(1) var<storage, read> state: PartState;
@group(0) @binding(2) var<storage, read> views: array<BlockView>;
@group(0) @binding(3) var<storage, read_write> classified: array<ClassifiedParticle>;
@group(0) @binding(4) var<storage, read> blocks: array<DeviceBlock>;
// Offset from the block's origin, then the shape, of each particle.
@group(0) @binding(5) var<storage, read> points: array<f32>;
@group(0) @binding(6) var<storage, read> coefficients: array<f32>;

// Words of a particle in `points`.
override POINT_WORDS: u32 = 4u;
// Coefficients of one colour channel.
override HARMONICS_COUNT: u32 = 1u;
// Conversions to the space of blending: sums are sRGB codes and linear light is blended, or vice versa.
override DECODES: bool = true;
override ENCODES: bool = false;

// Returns the sixteen harmonics up to degree 3 in a direction of unit length.
fn harmonics(direction: vec3<f32>) -> array<f32, 16> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    return array<f32, 16>(
        HARMONIC_0,
        -HARMONIC_1 * y,
        HARMONIC_1 * z,
        -HARMONIC_1 * x,
        HARMONICS_2[0] * x * y,
        -HARMONICS_2[0] * y * z,
        HARMONICS_2[1] * (2.0 * zz - xx - yy),
        -HARMONICS_2[0] * x * z,
        0.5 * HARMONICS_2[0] * (xx - yy),
        -HARMONICS_3[0] * y * (3.0 * xx - yy),
        HARMONICS_3[1] * x * y * z,
        -HARMONICS_3[2] * y * (4.0 * zz - xx - yy),
        HARMONICS_3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -HARMONICS_3[2] * x * (4.0 * zz - xx - yy),
        0.5 * HARMONICS_3[1] * z * (xx - yy),
        -HARMONICS_3[0] * x * (xx - 3.0 * yy),
    );
}

// Returns 1/2 + the sum of coefficients times harmonics, per colour channel. Coefficients from `first`
// are R, G, B of the first harmonic, of the second, ...
fn harmonics_sum(first: u32, basis: array<f32, 16>) -> vec3<f32> {
    var harmonic = basis;
    var sum = vec3<f32>(0.5);
    for (var n = 0u; n < HARMONICS_COUNT; n = n + 1u) {
        let i = first + 3u * n;
        let rgb = vec3<f32>(coefficients[i], coefficients[i + 1u], coefficients[i + 2u]);
        sum = sum + harmonic[n] * rgb;
    }
    return sum;
}

// Converts a sum to the space of blending, clamped at 0. NaN gives 0.
fn into_space(sum: f32) -> f32 {
    if !is_positive(sum) {
        return 0.0;
    }
    if !is_finite(sum) {
        return sum;
    }
    if DECODES {
        return linear_from_srgb(sum);
    }
    if ENCODES {
        return srgb_from_linear(sum);
    }
    return sum;
}

// Returns zero if v has no direction.
fn normalize_or_zero(v: vec3<f32>) -> vec3<f32> {
    let reciprocal = 1.0 / sqrt(dot3(v, v));
    if is_finite(reciprocal) && is_positive(reciprocal) {
        return v * reciprocal;
    }
    return vec3<f32>(0.0);
}

@compute @workgroup_size(THREADS)
fn shade(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let n = group_index(group) * THREADS + thread;
    if n >= state.classified_count {
        return;
    }
    let block = views[classified[n].view].block;
    let i = blocks[block].first + classified[n].local;
    var direction = vec3<f32>(camera.rotation[0][2], camera.rotation[1][2], camera.rotation[2][2]);
    if camera.orthographic == 0u {
        let p = POINT_WORDS * i;
        let from_eye = vec3<f32>(
            f64_to_f32(f64_sub(blocks[block].origin[0], camera.eye[0])),
            f64_to_f32(f64_sub(blocks[block].origin[1], camera.eye[1])),
            f64_to_f32(f64_sub(blocks[block].origin[2], camera.eye[2])),
        );
        direction = normalize_or_zero(from_eye + vec3<f32>(points[p], points[p + 1u], points[p + 2u]));
    }
    let sums = harmonics_sum(3u * HARMONICS_COUNT * i, harmonics(direction));
    classified[n].carried = array<f32, 3>(into_space(sums.x), into_space(sums.y), into_space(sums.z));
}
