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
    let f0 = c[0] * scale;
    let f1 = c[1] * scale;
    let f2 = c[2] * scale;
    let f3 = vec3<f32>(h / view.focal_px.x, 0.0, 0.0);
    let f4 = vec3<f32>(0.0, h / view.focal_px.y, 0.0);

    // Written out instead of in loops: NVIDIA's driver (580, on an H200) loses components of triples that are
    // stored at an index that is computed.
    out.terms.misses = array<array<f32, 3>, 5>(
        triple(cross3(f0, u)),
        triple(cross3(f1, u)),
        triple(cross3(f2, u)),
        triple(cross3(f3, u)),
        triple(cross3(f4, u)),
    );
    let m01 = cross3(f0, f1);
    let m02 = cross3(f0, f2);
    let m03 = cross3(f0, f3);
    let m04 = cross3(f0, f4);
    let m12 = cross3(f1, f2);
    let m13 = cross3(f1, f3);
    let m14 = cross3(f1, f4);
    let m23 = cross3(f2, f3);
    let m24 = cross3(f2, f4);
    let m34 = cross3(f3, f4);
    out.terms.minors = array<array<f32, 3>, 10>(
        triple(m01),
        triple(m02),
        triple(m03),
        triple(m04),
        triple(m12),
        triple(m13),
        triple(m14),
        triple(m23),
        triple(m24),
        triple(m34),
    );
    out.terms.minor_depths = array<f32, 10>(
        dot3(m01, u),
        dot3(m02, u),
        dot3(m03, u),
        dot3(m04, u),
        dot3(m12, u),
        dot3(m13, u),
        dot3(m14, u),
        dot3(m23, u),
        dot3(m24, u),
        dot3(m34, u),
    );
    let zero = vec3<f32>(0.0);
    let any_minor = any(m01 != zero)
        || any(m02 != zero)
        || any(m03 != zero)
        || any(m04 != zero)
        || any(m12 != zero)
        || any(m13 != zero)
        || any(m14 != zero)
        || any(m23 != zero)
        || any(m24 != zero)
        || any(m34 != zero);
    // The summands of the determinant are squares of the columns' volumes, three by three.
    var volumes = array<f32, 10>(
        dot3(m01, f2),
        dot3(m01, f3),
        dot3(m01, f4),
        dot3(m02, f3),
        dot3(m02, f4),
        dot3(m03, f4),
        dot3(m12, f3),
        dot3(m12, f4),
        dot3(m13, f4),
        dot3(m23, f4),
    );
    var determinant = 0.0;
    for (var i = 0; i < 10; i = i + 1) {
        determinant = determinant + volumes[i] * volumes[i];
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
