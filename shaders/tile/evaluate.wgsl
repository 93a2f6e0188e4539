// Evaluate: a footprint's path selects its evaluation.

// True if any footprint is on the exact path.
override HAS_EXACT: bool = true;
// True if any kernel crosses the plane of the eye.
override HAS_NEAR: bool = true;

// Evaluates a kernel on the ray of a pixel; with its depth along the ray if `has_place`.
fn evaluate(n: u32, footprint: TileFootprint, ray: TileRay, has_place: bool) -> Sample {
    if HAS_NEAR && is_near_path(footprint.path) {
        return near_kernel(footprint, ray.pixel);
    }
    let d = offset_from(footprint.centre_px, ray);
    if HAS_EXACT && footprint.path == PATH_EXACT {
        return exact(n, footprint, d, has_place);
    }
    return affine(n, footprint, d, has_place);
}

// Returns the share of the kernel's optical depth up to a depth. For a kernel that crosses the plane of
// the eye it is the share of the part in front of the eye.
fn share_before(footprint: TileFootprint, sample: Sample, ray: TileRay, depth: f32) -> f32 {
    if HAS_NEAR && is_near_path(footprint.path) {
        return within_domain(near_share(footprint, ray.pixel, depth));
    }
    return within_domain(share_up_to(footprint, sample, depth));
}

// Returns the reach of footprint i of the chunk along z on either side of its centre.
fn reach_of(i: u32, footprint: TileFootprint) -> f32 {
    if is_near_path(footprint.path) {
        return near_reach(footprint);
    }
    if footprint.path == PATH_EXACT {
        return exact_reach(footprint, terms[i]);
    }
    let slope = vec2<f32>(terms[i].gradient[0], terms[i].gradient[1]);
    return affine_reach(footprint, slope, terms[i].depth_sigma);
}

// Returns the derivatives of a footprint from pixel to pixel; zero for kernels that cross the plane of
// the eye.
fn slope_of(n: u32, footprint: TileFootprint, ray: TileRay) -> FootprintSlope {
    if is_near_path(footprint.path) {
        return FootprintSlope();
    }
    let d = offset_from(footprint.centre_px, ray);
    if footprint.path == PATH_EXACT {
        return exact_slope(n, footprint, d);
    }
    return affine_slope(n, footprint, d);
}
