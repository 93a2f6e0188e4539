// Stage: composites opaque surfaces, and the picture that shows through them, behind the picture in
// front. Twin: `compose` in src/cpu/tile/interval/cut.rs.

struct Background {
    colour: vec3<f32>,
    // Number of pixels of the band.
    pixels: u32,
    is_shown: u32,
    is_encoded: u32,
    unused: vec2<u32>,
}

// Only the number of pixels is read.
@group(0) @binding(0) var<uniform> background: Background;
// Output of rasterise.wgsl: the picture in front of the surface, then the one behind it.
@group(0) @binding(1) var<storage, read_write> pixels: array<f32>;
// Output of surface.wgsl.
@group(0) @binding(2) var<storage, read> surface: array<f32>;

override HAS_DEPTH: bool = false;
override IS_COUNT: bool = false;

@compute @workgroup_size(THREADS)
fn compose(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    let count = background.pixels;
    if i >= count {
        return;
    }
    let behind = select(4u, 5u, HAS_DEPTH) * count;
    let covered = surface[4u * i + 3u];
    let before = pixels[4u * i + 3u];
    let through = 1.0 - before;
    for (var c = 0u; c < 3u; c = c + 1u) {
        let of_surface = surface[4u * i + c];
        let of_behind = pixels[behind + 4u * i + c];
        if IS_COUNT {
            pixels[4u * i + c] = pixels[4u * i + c] + (of_surface + of_behind);
        } else {
            pixels[4u * i + c] =
                pixels[4u * i + c] + through * (of_surface + (1.0 - covered) * of_behind);
        }
    }
    let at_surface = before + through * covered;
    let after = at_surface + through * (1.0 - covered) * pixels[behind + 4u * i + 3u];
    pixels[4u * i + 3u] = after;
    if HAS_DEPTH {
        if before < 0.5 && at_surface >= 0.5 {
            pixels[4u * count + i] = surface[4u * count + i];
        } else if at_surface < 0.5 && after >= 0.5 {
            let depth = pixels[behind + 4u * count + i];
            pixels[4u * count + i] = select(depth, LARGEST, depth == NO_DEPTH);
        }
    }
}
