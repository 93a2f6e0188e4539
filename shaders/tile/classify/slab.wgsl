// Classify: classifies the mean value of a layer, and lights it by its gradient. Twin:
// src/cpu/tile/classify/slab.rs.

// True if layers are lit.
override HAS_SLOPES: bool = false;

// Linear colour, and extinction relative to that of the particles, at even steps of the range of values.
@group(0) @binding(10) var<uniform> classes: array<vec4<f32>, CLASSIFICATION_TABLE_LEN>;
@group(0) @binding(11) var<uniform> lighting: LightingUniform;

// Returns the camera-space direction in which the mean value of a layer grows; zero if there is none.
//
// - `ray`, `depth`: ray of the pixel, and middle of the layer.
fn direction_of(mean: f32, length: f32, slopes: Slopes, ray: vec3<f32>, depth: f32) -> vec3<f32> {
    // Gradient of the mean value, per pixel and per unit of z; then per thickness of a layer.
    var slope = (slopes.carried - mean * slopes.length) * (view.layer_thickness / length);
    // Pixels grow with z under perspective.
    let per_px = select(depth, 1.0, view.orthographic != 0u);
    slope = vec3<f32>(slope.xy * view.focal_px / per_px, slope.z);
    if view.orthographic == 0u {
        slope.z = slope.z - (ray.x * slope.x + ray.y * slope.y);
    }
    let square = dot3(slope, slope);
    if is_nan(square) || !(square > LEAST_SLOPE * LEAST_SLOPE) {
        return vec3<f32>(0.0);
    }
    return unit_or_zero(slope);
}

// Returns colour and extinction at a fraction of the range of values.
fn class_at(share: f32) -> vec4<f32> {
    let position = table_segment(share * f32(TABLE_LAST));
    let below = classes[position.entry];
    let above = classes[position.entry + 1u];
    return below + (above - below) * position.fraction;
}

// Returns optical depth times colour, and optical depth, of a layer of carried values.
fn classify_layer(sums: vec4<f32>, slopes: Slopes, at: vec2<f32>, depth: f32) -> vec4<f32> {
    let mean = sums.x / sums.w;
    let class_of = class_at(mean);
    let tau = sums.w * class_of.w;
    var colour = class_of.xyz;
    if HAS_SLOPES {
        let ray = ray_through(view, at);
        let normal = direction_of(mean, sums.w, slopes, ray, depth);
        if any(normal != vec3<f32>(0.0)) {
            var to_eye = vec3<f32>(0.0, 0.0, -1.0);
            if view.orthographic == 0u {
                to_eye = -unit_or_zero(ray);
            }
            colour = lit(no_shadows(), colour, normal, false, to_eye);
        }
    }
    return vec4<f32>(tau * colour, tau);
}
