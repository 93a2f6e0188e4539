// Accumulate: composites slabs, front to back. Twin: `flush` of src/cpu/tile/accumulate/layers.rs.

fn close_layer(layer: u32, sums: vec4<f32>, slopes: Slopes) {
    let at_half = layer_middle(layer);
    if HAS_SURFACE && layer_start(layer) >= span.middle {
        put_layer(&behind, layer, sums, slopes, at_half, span.middle, span.far);
        return;
    }
    put_layer(&front, layer, sums, slopes, at_half, span.near, span.middle);
    if HAS_SURFACE && span.middle < layer_start(layer + 1u) {
        put_layer(&behind, layer, divided, divided_slopes, at_half, span.middle, span.far);
        divided = vec4<f32>(0.0);
        divided_slopes = Slopes();
    }
}

fn end_layers() {}
