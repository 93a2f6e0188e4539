// Evaluate: a footprint with an elliptic outline, tau exp(-Q/2). Twin: src/cpu/tile/evaluate/affine.rs.

fn affine(n: u32, footprint: TileFootprint, d: vec2<f32>, has_place: bool) -> Sample {
    let q = form_at(footprint, d);
    var sample = Sample(is_within(footprint, q), 0.0, 0.0, 0.0);
    if sample.is_inside {
        sample.tau = footprint.peak * falloff(q);
        if has_place {
            let gradient = batch_terms[n].gradient;
            sample.beyond = gradient[0] * d.x + gradient[1] * d.y;
            sample.per_sigma = 1.0 / max(batch_terms[n].depth_sigma, SMALLEST);
        }
    }
    return sample;
}

// Returns the reach of a kernel along z on either side of its centre: r sqrt(V_zz).
//
// - `slope`: change of its depth per pixel; `sigma`: standard deviation of its depth along a ray.
fn affine_reach(footprint: TileFootprint, slope: vec2<f32>, sigma: f32) -> f32 {
    // slopeᵀ S slope = |A⁻ᵀ slope|², A the rows p and r of the form.
    let p = footprint.form_p;
    let r = footprint.form_r;
    let determinant = p.x * r.y - p.y * r.x;
    let solved = vec2<f32>(r.y * slope.x - r.x * slope.y, p.x * slope.y - p.y * slope.x)
        / determinant;
    let squared = dot2(solved, solved) + sigma * sigma;
    let reach = sqrt(footprint.cutoff_squared * squared);
    // NaN reaches everywhere.
    return select(LARGEST, reach, is_finite(reach));
}

// Derivatives of a footprint from pixel to pixel.
struct FootprintSlope {
    // Derivatives of the logarithm of its optical depth.
    log_tau: vec2<f32>,
    // Derivatives of its mean depth.
    mean: vec2<f32>,
}

fn affine_slope(n: u32, footprint: TileFootprint, d: vec2<f32>) -> FootprintSlope {
    let p = footprint.form_p.x * d.x + footprint.form_p.y * d.y;
    let r = footprint.form_r.x * d.x + footprint.form_r.y * d.y;
    let log_tau = -(p * footprint.form_p + r * footprint.form_r);
    let gradient = batch_terms[n].gradient;
    return FootprintSlope(log_tau, vec2<f32>(gradient[0], gradient[1]));
}

// Returns the share of a kernel's optical depth up to a depth: Phi of its distance beyond the mean. The
// ends of the ray lie beyond the whole kernel.
fn share_up_to(footprint: TileFootprint, sample: Sample, depth: f32) -> f32 {
    if depth >= LARGEST {
        return 1.0;
    }
    if depth <= -LARGEST {
        return 0.0;
    }
    let ahead = ahead_of(footprint, sample, depth);
    // NaN counts as behind.
    return select(0.0, normal_cdf(clamp(ahead, -38.0, 38.0)), !is_nan(ahead));
}
