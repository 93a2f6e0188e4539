// Bounds the errors of the approximations. Twin: src/splat/bounds.rs, which explains the numbers.

// Bound on max |affine - exact| / peak of one footprint.
fn affine_error(
    view: ViewUniform,
    screen: ScreenFactor,
    kernel: ImageKernel,
    terms: ExactTerms,
) -> f32 {
    let w = whitened(view, screen, kernel, terms);
    let linear = min_number(
        0.58 * length2(w.gamma) + 0.607 * length2(w.growth - w.gamma * 0.5),
        0.409 * length2(w.gamma) + 0.607 * length2(w.growth),
    );
    let l = lower_factor(kernel);
    let hxx = terms.hessian[0];
    let hxy = 0.5 * terms.hessian[1];
    let hyy = terms.hessian[2];
    let m0 = hxx * l[0] + hxy * l[1];
    let m1 = hxy * l[0] + hyy * l[1];
    let curvature = largest_eigenvalue(l[0] * m0 + l[1] * m1, l[2] * m1, hyy * l[2] * l[2]);
    return linear + 1.1 * curvature + 0.4 * w.angle;
}

// Bound on the amount by which the exact footprint exceeds exp(-r²/2) of its centre on the outline of its
// cut-off `r`.
fn edge_growth(
    view: ViewUniform,
    screen: ScreenFactor,
    kernel: ImageKernel,
    terms: ExactTerms,
    r: f32,
) -> f32 {
    let w = whitened(view, screen, kernel, terms);
    let half_slope = 0.5 * r * length2(w.gamma);
    let u = half_slope + hypot(half_slope, 1.0);
    return sqrt(1.0 + 2.0 * r * length2(w.growth - w.gamma * 0.5) * u + r * r * w.angle);
}

// The terms of perspective in units of the footprint's standard deviations: Lᵀ g, the growth of
// |D|/|D0|, and l_max(S/f²)/(1 + |x_k|²).
struct Whitened {
    gamma: vec2<f32>,
    growth: vec2<f32>,
    angle: f32,
}

fn whitened(
    view: ViewUniform,
    screen: ScreenFactor,
    kernel: ImageKernel,
    terms: ExactTerms,
) -> Whitened {
    let l = lower_factor(kernel);
    let focal = view.focal_px;
    let ray_squared = screen.ray_length * screen.ray_length;
    let angle = largest_eigenvalue(
        kernel.a / (focal.x * focal.x),
        kernel.b / (focal.x * focal.y),
        kernel.c / (focal.y * focal.y),
    );
    let g = vec2<f32>(terms.gradient[0], terms.gradient[1]);
    let a = screen.slope / focal / ray_squared;
    return Whitened(
        vec2<f32>(l[0] * g.x + l[1] * g.y, l[2] * g.y),
        vec2<f32>(l[0] * a.x + l[1] * a.y, l[2] * a.y),
        angle / ray_squared,
    );
}

// L = (l0 0; l1 l2) of the footprint's variance.
fn lower_factor(kernel: ImageKernel) -> array<f32, 3> {
    let l0 = sqrt(kernel.a);
    return array<f32, 3>(l0, kernel.b / l0, sqrt(kernel.determinant / kernel.a));
}

// Returns the factor that turns `affine_error` into the error of the opacity 1 - exp(-tau).
fn opacity_amplification(tau: f32) -> f32 {
    if tau < 1.0 {
        return tau;
    }
    let r = sqrt(2.0 * log(tau));
    return 1.0 + 0.43 * (r * r * r) * max(0.42 * r, 1.0);
}

fn largest_eigenvalue(a: f32, b: f32, c: f32) -> f32 {
    return 0.5 * (a + c) + hypot(0.5 * (a - c), b);
}
