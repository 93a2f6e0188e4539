// Evaluate: kernels that cross the plane of the eye; only the part in front of it counts. They take the
// near path under perspective and the half-line path under parallel rays. Twins: src/splat/near.rs,
// src/cpu/tile/evaluate/near.rs.

fn is_near_path(path: u32) -> bool {
    return (path & 2u) != 0u;
}

fn near_kernel(footprint: TileFootprint, pixel: vec2<f32>) -> Sample {
    let tau = near_depth(footprint, pixel);
    return Sample(is_positive(tau), tau, 0.0, 0.0);
}

// Returns the optical depth in front of the eye along the ray through a point of the image.
fn near_depth(footprint: TileFootprint, pixel: vec2<f32>) -> f32 {
    let at = footprint.path >> 2u;
    if (footprint.path & 3u) == PATH_NEAR {
        let direction = ray_through(view, pixel);
        return evaluate_near(at, footprint.peak, direction, footprint.cutoff_squared);
    }
    let d = pixel - footprint.centre_px;
    let q = form_at(footprint, d);
    if !is_within(footprint, q) {
        return 0.0;
    }
    let half_line = near.terms[at].half_line;
    let z = half_line[2] + half_line[0] * d.x + half_line[1] * d.y;
    let behind = z / max(near.terms[at].sigma, SMALLEST);
    if behind < -MAX_CUTOFF {
        return 0.0;
    }
    return footprint.peak * exp_minus_half(q) * normal_cdf(behind);
}

// Returns DᵀKD, and its product with the mean depth z*.
fn minors_along(at: u32, direction: vec3<f32>) -> vec2<f32> {
    var across = 0.0;
    var along = 0.0;
    for (var i = 0u; i < 10u; i = i + 1u) {
        let m = dot3(direction, vector(near.terms[at].minors[i]));
        across = across + m * m;
        along = along + m * near.terms[at].minor_depths[i];
    }
    return vec2<f32>(across, along);
}

// Returns the optical depth of a kernel along the half line t D, t > 0.
fn evaluate_near(at: u32, weight: f32, direction: vec3<f32>, cutoff_squared: f32) -> f32 {
    let sums = minors_along(at, direction);
    let across = sums.x;
    let along = sums.y;
    var miss = 0.0;
    for (var i = 0u; i < 5u; i = i + 1u) {
        let m = dot3(direction, vector(near.terms[at].misses[i]));
        miss = miss + m * m;
    }
    let q = miss / across;
    if !is_finite(q) || q > cutoff_squared {
        return 0.0;
    }
    let root = sqrt(across);
    let behind = along / max(root * near.terms[at].sigma, SMALLEST);
    if behind < -MAX_CUTOFF {
        return 0.0;
    }
    return weight * sqrt(dot3(direction, direction)) / root * exp_minus_half(q) * normal_cdf(behind);
}

// Returns the share, of the optical depth of `near_depth`, up to a depth.
fn near_share(footprint: TileFootprint, pixel: vec2<f32>, depth: f32) -> f32 {
    if depth >= LARGEST {
        return 1.0;
    }
    if depth <= -LARGEST {
        return 0.0;
    }
    let at = footprint.path >> 2u;
    var mean: f32;
    var per_sigma: f32;
    var at_depth = depth;
    if (footprint.path & 3u) == PATH_NEAR {
        let sums = minors_along(at, ray_through(view, pixel));
        let across = sums.x;
        let along = sums.y;
        per_sigma = sqrt(across) / max(near.terms[at].sigma, SMALLEST);
        mean = along / across;
        at_depth = depth / near.terms[at].unit;
    } else {
        let d = pixel - footprint.centre_px;
        let half_line = near.terms[at].half_line;
        mean = half_line[2] + half_line[0] * d.x + half_line[1] * d.y;
        per_sigma = 1.0 / max(near.terms[at].sigma, SMALLEST);
    }
    // Only tails are used, because they have a small relative error.
    let share = 1.0 - normal_cdf((mean - at_depth) * per_sigma) / normal_cdf(mean * per_sigma);
    if is_nan(share) {
        return 0.0;
    }
    return clamp(share, 0.0, 1.0);
}

// As `affine_reach`, for a kernel on either path.
fn near_reach(footprint: TileFootprint) -> f32 {
    let at = footprint.path >> 2u;
    if (footprint.path & 3u) == PATH_NEAR {
        return near.terms[at].reach;
    }
    let half_line = near.terms[at].half_line;
    return affine_reach(footprint, vec2<f32>(half_line[0], half_line[1]), near.terms[at].sigma);
}
