// Evaluate: a footprint that is exact under perspective, Q/w and tau |D|/sqrt(w). Twin:
// src/cpu/tile/evaluate/exact.rs.

// |D| of the pixel's ray; 1 if no footprint is exact.
var<private> ray_length: f32;

fn begin_ray(ray: TileRay) {
    ray_length = 1.0;
    if HAS_EXACT {
        let direction = ray_through(view, ray.pixel);
        ray_length = sqrt(dot3(direction, direction));
    }
}

fn exact(n: u32, footprint: TileFootprint, d: vec2<f32>, has_place: bool) -> Sample {
    let gradient = batch_terms[n].gradient;
    let hessian = batch_terms[n].hessian;
    let w = d.x * (d.x * hessian[0] + (d.y * hessian[1] + gradient[0]))
        + (d.y * (d.y * hessian[2] + gradient[1]) + 1.0);
    let q = form_at(footprint, d) / w;
    // NaN is outside.
    let is_ahead = !is_nan(w) && w > 0.0;
    var sample = Sample(is_ahead && is_within(footprint, q), 0.0, 0.0, 0.0);
    if sample.is_inside {
        let root = sqrt(w);
        sample.tau = footprint.peak * (ray_length / root) * falloff(q);
        if has_place {
            // z* - z = -z (g . d / 2 + dᵀHd) / w, sigma as 1 / sqrt(w).
            let slope = gradient[0] * d.x + gradient[1] * d.y;
            let bend = d.x * (hessian[0] * d.x + hessian[1] * d.y) + hessian[2] * d.y * d.y;
            sample.beyond = -footprint.depth * (0.5 * slope + bend) / w;
            sample.per_sigma = 1.0 / max(batch_terms[n].depth_sigma, SMALLEST) * root;
        }
    }
    return sample;
}

// As `affine_reach`, for exact terms.
fn exact_reach(footprint: TileFootprint, terms: ExactTerms) -> f32 {
    let slope = vec2<f32>(terms.gradient[0], terms.gradient[1]) * (-0.5 * footprint.depth);
    return affine_reach(footprint, slope, terms.depth_sigma);
}

fn exact_slope(n: u32, footprint: TileFootprint, d: vec2<f32>) -> FootprintSlope {
    let of_form = affine_slope(n, footprint, d);
    let gradient = of_form.mean;
    let h = batch_terms[n].hessian;
    let slope = gradient.x * d.x + gradient.y * d.y;
    let w = 1.0 + slope + d.x * (h[0] * d.x + h[1] * d.y) + h[2] * d.y * d.y;
    let w_slope = gradient
        + vec2<f32>(2.0 * h[0] * d.x + h[1] * d.y, h[1] * d.x + 2.0 * h[2] * d.y);
    let q = form_at(footprint, d) / w;
    // The change of the ray's length is omitted: all kernels share it.
    let log_tau = (of_form.log_tau + (0.5 * q - 0.5) * w_slope) / w;
    let mean = (footprint.depth / w) * (0.5 * gradient - (1.0 + 0.5 * slope) / w * w_slope);
    return FootprintSlope(log_tau, mean);
}
