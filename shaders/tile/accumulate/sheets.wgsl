// Accumulate: sums whole kernels in the layers of their centres, which are composited. Twin:
// src/cpu/tile/accumulate/sheets.rs.

fn layers_of(i: u32) -> vec2<u32> {
    return vec2<u32>(layer_of_key(i));
}

fn needs_place(side: u32) -> bool {
    return side != SIDE_FRONT;
}

fn close_layer(layer: u32, sums: vec4<f32>, slopes: Slopes) {
    put_layer(&front, layer, sums, slopes, ring_depth / sums.w, span.near, span.middle);
    if HAS_SURFACE {
        let at_half = divided_depth / divided.w;
        put_layer(&behind, layer, divided, divided_slopes, at_half, span.middle, span.far);
    }
    divided = vec4<f32>(0.0);
    ring_depth = 0.0;
    divided_depth = 0.0;
}

fn add(n: u32, footprint: TileFootprint, sample: Sample, ray: TileRay, side: u32) {
    if IS_COUNT {
        front.colour = front.colour + 1.0;
    }
    var own_part = domain_share();
    var rest_part = 0.0;
    if needs_place(side) {
        let begin = share_before(footprint, sample, ray, span.near);
        let middle = share_before(footprint, sample, ray, span.middle);
        let end = share_before(footprint, sample, ray, span.far);
        own_part = max(middle - begin, 0.0);
        rest_part = max(end - middle, 0.0);
    }
    let tau = sample.tau * own_part;
    let rest = sample.tau * rest_part;
    add_to_layer(max(batch_layers[n].x, first_layer), tau, rest, footprint.carried);
    if HAS_DEPTH {
        ring_depth = ring_depth + tau * footprint.depth;
        divided_depth = divided_depth + rest * footprint.depth;
    }
}

fn end_layers() {}
