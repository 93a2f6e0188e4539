// Draws splats of radiance fields, whose opacity is stated. Twin: src/splat/peak.rs.

// A splat's projection and footprint, if the rule draws it.
struct PeakFootprint {
    exists: bool,
    screen: ScreenFactor,
    image: ImageKernel,
}

// Returns the footprint of a splat, with `tau` the opacity at the centre. `kernel.mass` is the peak
// opacity.
fn peak_footprint(view: ViewUniform, kernel: Kernel, rule: u32) -> PeakFootprint {
    var out: PeakFootprint;
    let z = kernel.centre.z;
    let nearest = select(length3(kernel.factor.z), 0.0, view.orthographic != 0u);
    if !is_above(z, nearest) {
        return out;
    }
    var screen = project_kernel(view, kernel);
    if view.orthographic == 0u {
        let focal = view.focal_px;
        let size = vec2<f32>(view.size);
        let margin = JACOBIAN_MARGIN * 0.5 * size / focal;
        let lower = -view.centre_px / focal - margin;
        let upper = (size - view.centre_px) / focal + margin;
        let slope = min(max(screen.slope, lower), upper);
        if any(slope != screen.slope) {
            let per_depth = 1.0 / z;
            let s = screen.relative_depth;
            screen.row_x = (kernel.factor.x * per_depth - s * slope.x) * focal.x;
            screen.row_y = (kernel.factor.y * per_depth - s * slope.y) * focal.y;
        }
    }
    let h2 = select(SPLAT_LOW_PASS_PX2, ANTI_ALIASED_LOW_PASS_PX2, rule == SPLAT_MIP);
    var image = filtered(screen, FILTER_EWA, h2);
    image.tau = kernel.mass;
    if rule == SPLAT_MIP {
        // Minors, not the difference of products, so that a flat splat seen from its edge keeps its
        // digits.
        let minor = cross3(screen.row_x, screen.row_y);
        let determinant = dot3(minor, minor);
        image.tau = image.tau * sqrt(determinant / image.determinant);
    }
    let blur = defocus(view, kernel);
    if blur > 0.0 {
        // Opacity times area stays.
        let sharp = image;
        image = filtered(screen, FILTER_EWA, h2 + blur);
        image.tau = sharp.tau * sqrt(sharp.determinant / image.determinant);
    }
    // A footprint whose squared lengths overflow f32 has no form.
    let is_shape = is_finite(image.a + image.c);
    out.exists = is_shape && is_above(image.tau, 0.0) && is_finite(image.tau);
    out.screen = screen;
    out.image = image;
    return out;
}

// Returns the radius within which the rule draws a splat, standard deviations; -1 if nowhere.
fn peak_reach(rule: u32, peak: f32, radius: f32) -> f32 {
    if rule == SPLAT_EXACT {
        return radius;
    }
    if rule == SPLAT_KHR {
        return min(radius, SPLAT_CUTOFF);
    }
    if !(peak >= SPLAT_FLOOR) {
        return -1.0;
    }
    // The logarithm of a number near 1 may be below 0.
    return min(radius, sqrt(max(2.0 * log(peak / SPLAT_FLOOR), 0.0)));
}
