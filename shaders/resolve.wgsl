// Stage: a background behind the pixels of a band, and sRGB codes decoded. Twin: src/cpu/resolve.rs.

struct Background {
    // In the space that was blended in.
    colour: vec3<f32>,
    // How many pixels the band has.
    pixels: u32,
    // 1 where there is a background.
    is_shown: u32,
    // 1 where pixels are sRGB codes times opacity.
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
