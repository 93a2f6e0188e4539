// Stage: draws a band's pixels into a caller's texture.

struct Band {
    // The band's first row in the texture.
    first_row: u32,
    // Number of pixels of a row.
    width: u32,
}

@group(0) @binding(0) var<uniform> band: Band;
@group(0) @binding(1) var<storage, read> pixels: array<vec4<f32>>;

// True if the texture holds code values that it does not encode itself.
override ENCODES: bool = false;

// One triangle that covers the whole texture.
@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(vertex & 1u), f32(vertex >> 1u));
    return vec4<f32>(4.0 * corner - 1.0, 0.0, 1.0);
}

// Twin: `srgb_from_linear` of src/image.rs, for non-negative numbers.
fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= SRGB_LINEAR_END {
        return SRGB_SLOPE * linear;
    }
    return SRGB_SCALE * pow(linear, 1.0 / SRGB_GAMMA) - SRGB_OFFSET;
}

@fragment
fn present(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = vec2<u32>(position.xy);
    let pixel = pixels[(at.y - band.first_row) * band.width + at.x];
    if !ENCODES {
        return pixel;
    }
    // Straight code values, as in a PNG, times alpha.
    let alpha = clamp(pixel.w, 0.0, 1.0);
    let straight = clamp(pixel.xyz / select(1.0, pixel.w, pixel.w > 0.0), vec3<f32>(0.0), vec3<f32>(1.0));
    let code = vec3<f32>(
        srgb_from_linear(straight.x),
        srgb_from_linear(straight.y),
        srgb_from_linear(straight.z),
    );
    return vec4<f32>(code * alpha, alpha);
}
