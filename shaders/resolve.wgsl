// Stage: composites the pixels of a band over a background, and decodes sRGB codes. Twin:
// src/cpu/resolve.rs.

struct Background {
    // Colour in the space of blending.
    colour: vec3<f32>,
    // Number of pixels of the band.
    pixels: u32,
    // 1 if there is a background, 0 otherwise.
    is_shown: u32,
    // 1 if pixels are sRGB codes times opacity, 0 otherwise.
    is_encoded: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> background: Background;
@group(0) @binding(1) var<storage, read_write> pixels: array<vec4<f32>>;

fn decoded(code: f32) -> f32 {
    let linear = linear_from_srgb(abs(code));
    return select(linear, -linear, code < 0.0);
}

@compute @workgroup_size(THREADS)
fn resolve(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    if i >= background.pixels {
        return;
    }
    var pixel = pixels[i];
    if background.is_shown != 0u {
        let through = 1.0 - pixel.w;
        pixel = vec4<f32>(
            pixel.x + through * background.colour.x,
            pixel.y + through * background.colour.y,
            pixel.z + through * background.colour.z,
            1.0,
        );
    }
    if background.is_encoded != 0u {
        // A pixel without opacity adds nothing.
        let share = select(1.0, pixel.w, pixel.w > 0.0);
        pixel = vec4<f32>(
            share * decoded(pixel.x / share),
            share * decoded(pixel.y / share),
            share * decoded(pixel.z / share),
            pixel.w,
        );
    }
    pixels[i] = pixel;
}
