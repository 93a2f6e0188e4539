// Stage: computes pixels from the layers of opaque surfaces: colour, coverage, depth and, on request,
// normals. It follows rasterise.wgsl, which draws the layers. Twin: src/cpu/tile/accumulate/opaque.rs.

// True if the surface is the whole picture. If so, a pixel has a depth if the surface covers half of it.
// Otherwise it has a depth if the surface covers any part of it.
override IS_PICTURE: bool = true;

// Layers, in the layout of accumulate/opaque.wgsl.
@group(0) @binding(2) var<storage, read> drawn_layers: array<f32>;
// The band's pixels, row by row: four floats each, then a depth each, then (with normals) three floats
// each.
@group(0) @binding(3) var<storage, read_write> surface_pixels: array<f32>;

// Returns the coverage of a pixel for a sum of weights.
fn coverage(weight: f32) -> f32 {
    if weight <= 0.5 {
        return weight;
    }
    return min(0.5 + (weight - 0.5) * (0.5 / (COVERAGE_FULL - 0.5)), 1.0);
}

// Computes pixels from their layers, one thread each.
@compute @workgroup_size(THREADS)
fn resolve_layers(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let index = group_index(group) * THREADS + thread;
    let count = band_pixels(chunk, view.size);
    if index >= count {
        return;
    }
    let stride = layer_words() * count;
    var total = 0.0;
    for (var k = 0u; k < SURFACE_LAYERS; k = k + 1u) {
        total = total + coverage(drawn_layers[k * stride + index]);
    }
    let half_covered = 0.5 * min(total, 1.0);
    var covered = 0.0;
    var colour = vec3<f32>(0.0);
    var depth = NO_DEPTH;
    var normal = vec3<f32>(0.0);
    for (var k = 0u; k < SURFACE_LAYERS; k = k + 1u) {
        let first = k * stride + index;
        let weight = drawn_layers[first];
        if weight == 0.0 {
            break;
        }
        let before = covered;
        covered = min(before + coverage(weight), 1.0);
        let of_layer = vec3<f32>(
            drawn_layers[first + 2u * count],
            drawn_layers[first + 3u * count],
            drawn_layers[first + 4u * count],
        );
        colour = colour + of_layer * ((covered - before) / weight);
        if before < half_covered && covered >= half_covered {
            let inverse_depth = drawn_layers[first + count] / weight;
            if view.orthographic != 0u {
                depth = -inverse_depth;
            } else {
                depth = 1.0 / inverse_depth;
            }
            if HAS_NORMALS {
                normal = unit_or_zero(vec3<f32>(
                    drawn_layers[first + 5u * count],
                    drawn_layers[first + 6u * count],
                    drawn_layers[first + 7u * count],
                ));
            }
        }
    }
    if IS_COUNT {
        colour = vec3<f32>(drawn_layers[SURFACE_LAYERS * stride + index]);
    }
    if IS_PICTURE && covered < 0.5 {
        depth = NO_DEPTH;
    }
    surface_pixels[4u * index] = colour.x;
    surface_pixels[4u * index + 1u] = colour.y;
    surface_pixels[4u * index + 2u] = colour.z;
    surface_pixels[4u * index + 3u] = covered;
    surface_pixels[4u * count + index] = depth;
    if HAS_NORMALS {
        let first = 5u * count + 3u * index;
        surface_pixels[first] = normal.x;
        surface_pixels[first + 1u] = normal.y;
        surface_pixels[first + 2u] = normal.z;
    }
}
