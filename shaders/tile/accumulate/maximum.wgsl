// Accumulate: finds the slab with the greatest mean value. Until the last slab is finished, the pixel's
// red is that value and its green a flag that tells if there was any. Its opacity stays zero, so that no
// ray ends early. Twin: src/cpu/tile/accumulate/maximum.rs.

fn close_layer(layer: u32, sums: vec4<f32>, slopes: Slopes) {
    if IS_COUNT || !(sums.w >= view.least_length) {
        return;
    }
    let mean = sums.x / sums.w;
    if front.colour.y == 0.0 || mean > front.colour.x {
        front.colour = vec3<f32>(mean, 1.0, 0.0);
        front.depth = max(layer_middle(layer), 0.0);
    }
}

fn end_layers() {
    if IS_COUNT || front.colour.y == 0.0 {
        return;
    }
    front.colour = class_at(front.colour.x).xyz;
    front.alpha = 1.0;
}
