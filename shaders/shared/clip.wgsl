// Clips at planes. Twins: `clip_span` in src/cpu/tile/interval/cut.rs, `ClipEdges` in
// src/cpu/tile/interval/edges.rs.

// Returns the depths between which the ray through a point of the image lies inside the clip planes;
// -LARGEST and LARGEST if nothing ends it, from LARGEST to LARGEST if no part does.
fn clip_span(view: ViewUniform, pixel: vec2<f32>) -> vec2<f32> {
    var from_depth = -LARGEST;
    var to_depth = LARGEST;
    let direction = ray_through(view, pixel);
    for (var i = 0u; i < view.clip_count; i = i + 1u) {
        let plane = view.clip_planes[i];
        // The ray is at z D, or (orthographic) at (X, Y, z); inside is rate z + start >= 0.
        let across = plane.x * direction.x + plane.y * direction.y;
        var rate = across + plane.z;
        var start = plane.w;
        if view.orthographic != 0u {
            rate = plane.z;
            start = across + plane.w;
        }
        if rate > 0.0 {
            from_depth = max(from_depth, -start / rate);
        } else if rate < 0.0 {
            to_depth = min(to_depth, -start / rate);
        } else if start < 0.0 {
            to_depth = -LARGEST;
        }
    }
    return span_of(from_depth, to_depth);
}

// Returns the part of a ray between two depths; from LARGEST to LARGEST if there is none.
fn span_of(from_depth: f32, to_depth: f32) -> vec2<f32> {
    if from_depth < to_depth {
        return vec2<f32>(from_depth, to_depth);
    }
    return vec2<f32>(LARGEST);
}

// Returns the share of a surfel's part in a pixel that planes keep: Phi of its distance inside them, in
// standard deviations of the low-pass filter; 0 beyond the softness.
//
// - `at`: position of this part on the image; `inverse_depth`, `gradient`: inverse depth of the surfel's
//   plane there, and its change per pixel.
// - `shown`: change of `at` per pixel, a symmetric matrix: xx, xy, yy.
fn clip_share(
    view: ViewUniform,
    at: vec2<f32>,
    inverse_depth: f32,
    gradient: vec2<f32>,
    shown: vec3<f32>,
) -> f32 {
    let direction = ray_through(view, at);
    var share = 1.0;
    for (var i = 0u; i < view.clip_count; i = i + 1u) {
        let plane = view.clip_planes[i];
        // Distance of the point D / inverse depth (orthographic: X, Y, -inverse depth), times a positive
        // number.
        let across = plane.x * direction.x + plane.y * direction.y;
        var inside = across + plane.z + plane.w * inverse_depth;
        var rate = plane.w;
        if view.orthographic != 0u {
            inside = across - plane.z * inverse_depth + plane.w;
            rate = -plane.z;
        }
        let across_px = plane.xy / view.focal_px;
        let slope = gradient * rate + vec2<f32>(
            shown.x * across_px.x + shown.y * across_px.y,
            shown.y * across_px.x + shown.z * across_px.y,
        );
        // The variance of the part that a pixel shows is h² F.
        let of_slope = vec2<f32>(
            shown.x * slope.x + shown.y * slope.y,
            shown.y * slope.x + shown.z * slope.y,
        );
        let kept = dot2(slope, of_slope) / dot2(slope, slope);
        let least_kept = select(1e-6, kept, kept > 1e-6);
        let spread = sqrt(view.low_pass_variance_px2 / least_kept);
        let softness = sqrt(dot2(slope, slope)) * spread;
        let far_inside = inside / max(softness, SMALLEST);
        if is_nan(far_inside) || !(far_inside > -CLIP_SOFTNESS) {
            return 0.0;
        }
        share = share * normal_cdf(min(far_inside, 38.0));
    }
    return share;
}
