// Computes the opacity of a lone kernel smaller than a pixel. Twin: src/splat/sub_pixel.rs.

// Returns the opacity at its centre of a lone round kernel under a Gaussian low-pass filter.
fn filtered_opacity(area: f32, tau0: f32) -> f32 {
    var nodes = SUB_PIXEL_NODES;
    var logs = SUB_PIXEL_LOGS;
    var weights = SUB_PIXEL_WEIGHTS;
    var sum = 0.0;
    if area < SUB_PIXEL_SPLIT {
        let end = min(SUB_PIXEL_REACH / tau0, 1.0);
        let depth = tau0 * end;
        let log_end = log(end);
        for (var i = 0; i < 8; i = i + 1) {
            let missed = -exp_m1(area * (log_end + logs[i]));
            sum = sum + weights[i] * exp(-depth * nodes[i]) * missed;
        }
        return depth * sum;
    }
    for (var i = 0; i < 8; i = i + 1) {
        let depth = tau0 * exp(logs[i] / area);
        sum = sum + weights[i] * -exp_m1(-depth);
    }
    return sum;
}

// Returns the optical depth at the centre whose opacity is the filtered one.
fn sub_pixel_depth(area: f32, tau0: f32) -> f32 {
    let opaque = SUB_PIXEL_OPAQUE[0];
    let saturated = SUB_PIXEL_OPAQUE[1];
    // Rounding may give an opacity above 1.
    let peak = minus_log_1_minus(min(filtered_opacity(area, tau0), 0.99999));
    let share = clamp((peak - opaque) / (saturated - opaque), 0.0, 1.0);
    let extent = exp((area * log(tau0) - EULER) / (1.0 + area));
    let depth = peak + max(extent - peak, 0.0) * share;
    return min(depth, tau0 * area / (1.0 + area));
}

// Returns -ln(1 - x) for x from 0 to below 1, with a small relative error at any x.
fn minus_log_1_minus(x: f32) -> f32 {
    if x > 0.1 {
        return -log(1.0 - x);
    }
    // Series: the remainder is 1e-8 of the sum.
    var sum = 0.0;
    for (var n = 8.0; n > 0.0; n = n - 1.0) {
        sum = 1.0 / n + sum * x;
    }
    return x * sum;
}

// Returns `image` with the opacity of a lone kernel.
fn as_lone(screen: ScreenFactor, filter_kind: u32, h2: f32, image: ImageKernel) -> ImageKernel {
    if filter_kind == FILTER_RECONSTRUCTION || filter_kind == FILTER_UNIFORM_SCALING {
        return image;
    }
    let width = length3(cross3(screen.row_x, screen.row_y));
    let area = width / h2;
    let tau0 = screen.weight / (TAU * width);
    if !is_above(SUB_PIXEL_LARGE, area) || !is_at_most(SUB_PIXEL_FAINT, tau0) {
        return image;
    }
    var out = image;
    // A kernel without area hides nothing, however deep.
    var factor = 0.0;
    if is_above(area, 0.0) && is_finite(tau0) {
        factor = sub_pixel_depth(area, tau0) / (tau0 * area / (1.0 + area));
    }
    out.tau = image.tau * min(factor, 1.0);
    return out;
}
