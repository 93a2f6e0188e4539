// Computes surfels of an opaque surface: flat kernels that are averaged, not absorbed. Twin:
// src/splat/surfel.rs, which explains the numbers.

// A projected surfel; none if it is one-sided and seen from behind, or is not a surfel.
struct SurfelFootprint {
    exists: bool,
    screen: ScreenFactor,
    image: ImageKernel,
    terms: SurfelTerms,
}

// Returns the footprint of a surfel in front of the eye; the kernel's mass is the area.
fn surfel_footprint(
    view: ViewUniform,
    kernel: Kernel,
    is_one_sided: bool,
    cutoff: f32,
) -> SurfelFootprint {
    var out: SurfelFootprint;
    let is_orthographic = view.orthographic != 0u;
    let u = kernel.centre;
    let focal = view.focal_px;
    var screen = project_kernel(view, kernel);
    var c = columns(kernel.factor);
    let plane_normal = unit_normal(c[0], c[1]);
    if !plane_normal.exists {
        return out;
    }
    let normal = plane_normal.normal;
    // D0, the ray through the centre, and the cosine towards it.
    let ray = select(vec3<f32>(screen.slope, 1.0), vec3<f32>(0.0, 0.0, 1.0), is_orthographic);
    var across = dot3(normal, ray);
    if is_one_sided && is_above(across, 0.0) {
        return out;
    }
    let facing = across;
    // |det M| = |det J| cos theta; `weight` contains |det J| and the ray's length |D0|.
    screen.weight = screen.weight * (abs(across) / screen.ray_length);
    let image = filtered(screen, FILTER_EWA, view.low_pass_variance_px2);
    let is_shape = is_finite(image.a + image.c);
    if !(is_shape && is_above(image.tau, 0.0) && is_finite(image.tau)) {
        return out;
    }
    // The inverse depth D . n / (n . u), u = u2 D0. Under parallel rays: minus the depth.
    let least = GRAZING * screen.ray_length;
    if across < 0.0 {
        across = min_number(across, -least);
    } else {
        across = max_number(across, least);
    }
    var terms: SurfelTerms;
    let slope = normal.xy / (focal * across);
    let pixel = 1.0 / min(focal.x, focal.y);
    let sigma = widest(c[0], c[1]);
    var plane: vec2<f32>;
    if is_orthographic {
        plane = slope;
        terms.inverse_depth = -u.z;
        terms.slack = SLACK_SIGMAS * sigma + SLACK_PIXELS * pixel;
    } else {
        let per_depth = 1.0 / u.z;
        plane = slope * per_depth;
        terms.inverse_depth = per_depth;
        terms.slack = (SLACK_SIGMAS * (sigma * per_depth) + SLACK_PIXELS * pixel) * per_depth;
    }
    if is_above(length3(screen.relative_depth) * cutoff, PERSPECTIVE_FROM) && !is_orthographic {
        terms.homography = 1.0;
        terms.gradient = array<f32, 2>(plane.x, plane.y);
    } else {
        // The mean of the inverse depth over the part of the filtered kernel in the pixel. Mass that the
        // filter has moved keeps the inverse depth of its origin.
        let x = screen.row_x;
        let y = screen.row_y;
        let along = vec2<f32>(
            dot3(x, x) * plane.x + dot3(x, y) * plane.y,
            dot3(x, y) * plane.x + dot3(y, y) * plane.y,
        );
        terms.gradient = array<f32, 2>(
            (image.c * along.x - image.b * along.y) / image.determinant,
            (image.a * along.y - image.b * along.x) / image.determinant,
        );
    }
    terms.slack = terms.slack + SLACK_SLOPE * h_of(view) * length2(plane);
    terms.normal = pack_normal(select(-normal, normal, facing < 0.0));
    return SurfelFootprint(true, screen, image, terms);
}

// Returns the low-pass filter's standard deviation, pixels.
fn h_of(view: ViewUniform) -> f32 {
    return sqrt(view.low_pass_variance_px2);
}

// Returns the greater standard deviation of a surfel.
fn widest(first: vec3<f32>, second: vec3<f32>) -> f32 {
    // Units of its own size: its squares would underflow or overflow at the scale of some scenes.
    let unit = max_number(largest_of(first), largest_of(second));
    let a = first / unit;
    let b = second / unit;
    let aa = dot3(a, a);
    let bb = dot3(b, b);
    let ab = dot3(a, b);
    let half_difference = 0.5 * (aa - bb);
    return unit * sqrt(0.5 * (aa + bb) + sqrt(half_difference * half_difference + ab * ab));
}

// Returns the terms of a surfel that reaches the camera plane, and its weight at the centre. The first
// three of the terms' misses are A, B and N.
fn near_surfel(kernel: Kernel, is_one_sided: bool) -> NearKernel {
    var out: NearKernel;
    var c = columns(kernel.factor);
    let greatest = max_number(largest_of(c[0]), largest_of(c[1]));
    let unit = max_number(greatest, largest_of(kernel.centre));
    if !(is_above(unit, 0.0) && is_finite(unit)) {
        return out;
    }
    let a = c[0] / unit;
    let b = c[1] / unit;
    let u = kernel.centre / unit;
    let normal = cross3(a, b);
    let squared = dot3(normal, normal);
    let distance = dot3(normal, u);
    if is_one_sided && is_above(distance, 0.0) {
        return out;
    }
    let along_a = cross3(b, normal) / squared;
    let along_b = cross3(normal, a) / squared;
    let inverse_depth = normal / distance;
    // All three per world unit, not per `unit`.
    let miss_a = (along_a - inverse_depth * dot3(along_a, u)) / unit;
    let miss_b = (along_b - inverse_depth * dot3(along_b, u)) / unit;
    let miss_n = inverse_depth / unit;
    out.terms.misses[0] = triple(miss_a);
    out.terms.misses[1] = triple(miss_b);
    out.terms.misses[2] = triple(miss_n);
    out.terms.sigma = (SLACK_SIGMAS * widest(a, b)) * unit;
    out.weight = kernel.mass / unit / unit / (TAU * sqrt(squared));
    let is_usable = is_finite3(miss_a) && is_finite3(miss_b) && is_finite3(miss_n);
    out.exists = is_usable && is_above(out.weight, 0.0) && is_finite(out.weight);
    return out;
}
