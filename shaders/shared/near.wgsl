// Evaluates kernels that cross the camera plane, by the direct line integral along the half line in front
// of the eye. Twin: src/splat/near.rs.

// Terms of such a kernel for the rasteriser, and its weight g/(2 pi) in the same units. They exist unless
// the kernel has almost no volume.
struct NearKernel {
    exists: bool,
    terms: NearTerms,
    weight: f32,
}

fn near_terms(view: ViewUniform, kernel: Kernel) -> NearKernel {
    var out: NearKernel;
    // Units of the kernel's own size.
    var c = columns(kernel.factor);
    var unit = 0.0;
    for (var i = 0; i < 3; i = i + 1) {
        unit = max_number(unit, largest_of(c[i]));
    }
    unit = max_number(unit, largest_of(kernel.centre));
    if !(is_above(unit, 0.0) && is_finite(unit)) {
        return out;
    }
    let scale = 1.0 / unit;
    let u = kernel.centre * scale;
    let depth = max_number(abs(u.z), length3(kernel.factor.z) * scale);
    let h = sqrt(view.low_pass_variance_px2) * depth;
    var f = array<vec3<f32>, 5>(
        c[0] * scale,
        c[1] * scale,
        c[2] * scale,
        vec3<f32>(h / view.focal_px.x, 0.0, 0.0),
        vec3<f32>(0.0, h / view.focal_px.y, 0.0),
    );

    var pair = 0;
    var determinant = 0.0;
    var any_minor = false;
    for (var i = 0; i < 5; i = i + 1) {
        out.terms.misses[i] = triple(cross3(f[i], u));
        for (var j = i + 1; j < 5; j = j + 1) {
            let minor = cross3(f[i], f[j]);
            any_minor = any_minor || any(minor != vec3<f32>(0.0));
            out.terms.minors[pair] = triple(minor);
            out.terms.minor_depths[pair] = dot3(minor, u);
            pair = pair + 1;
            for (var k = j + 1; k < 5; k = k + 1) {
                let volume = dot3(minor, f[k]);
                determinant = determinant + volume * volume;
            }
        }
    }
    out.terms.sigma = sqrt(determinant);
    out.terms.unit = unit;
    out.exists = any_minor;
    out.weight = kernel.mass * scale * scale / TAU;
    return out;
}

// Returns the terms for an orthographic camera. The kernel's depth along the ray at offset d is z* = u2 +
// g . d with a constant standard deviation; `slope`, `sigma`: results of `depth_terms`.
fn half_line_terms(kernel: Kernel, slope: vec2<f32>, sigma: f32) -> NearTerms {
    var terms: NearTerms;
    terms.half_line = array<f32, 3>(slope.x, slope.y, kernel.centre.z);
    terms.sigma = sigma;
    return terms;
}
