// Stage: a background behind the pixels of a band. Twin: src/cpu/resolve.rs.

struct Background {
    // Linear RGB.
    colour: vec3<f32>,
    // How many pixels the band has.
    pixels: u32,
}

@group(0) @binding(0) var<uniform> background: Background;
@group(0) @binding(1) var<storage, read_write> pixels: array<vec4<f32>>;

@compute @workgroup_size(THREADS)
fn resolve(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    if i >= background.pixels {
        return;
    }
    let pixel = pixels[i];
    let through = 1.0 - pixel.w;
    pixels[i] = vec4<f32>(
        pixel.x + through * background.colour.x,
        pixel.y + through * background.colour.y,
        pixel.z + through * background.colour.z,
        1.0,
    );
}
