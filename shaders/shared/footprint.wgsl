// Computes the resampling filter of a kernel: eq. 20 and 25 of Zwicker et al. 2001, eq. 3 to 5 of Chen et
// al. 2004, in factored form. Twin: src/splat/footprint.rs.

// A particle in camera space.
struct Kernel {
    centre: vec3<f32>,
    factor: Factor,
    mass: f32,
}

// A kernel's factor projected to the image, before any filter.
struct ScreenFactor {
    centre_px: vec2<f32>,
    slope: vec2<f32>,
    row_x: vec3<f32>,
    row_y: vec3<f32>,
    relative_depth: vec3<f32>,
    ray_length: f32,
    weight: f32,
}

// A footprint after the filter.
struct ImageKernel {
    a: f32,
    b: f32,
    c: f32,
    determinant: f32,
    tau: f32,
    // Factor by which the filter has enlarged its area.
    enlargement: f32,
}

// Projects a kernel to the image plane. The steps avoid powers of the depth.
fn project_kernel(view: ViewUniform, kernel: Kernel) -> ScreenFactor {
    let focal = view.focal_px;
    let u = kernel.centre;
    let f = kernel.factor;
    var screen: ScreenFactor;
    if view.orthographic != 0u {
        screen.centre_px = focal * u.xy + view.centre_px;
        screen.slope = vec2<f32>(0.0);
        screen.row_x = f.x * focal.x;
        screen.row_y = f.y * focal.y;
        screen.relative_depth = f.z;
        screen.ray_length = 1.0;
        screen.weight = kernel.mass * focal.x * focal.y;
        return screen;
    }
    let per_depth = 1.0 / u.z;
    let slope = u.xy * per_depth;
    let s = f.z * per_depth;
    let ray_length = sqrt(1.0 + dot2(slope, slope));
    screen.centre_px = focal * slope + view.centre_px;
    screen.slope = slope;
    screen.row_x = (f.x * per_depth - s * slope.x) * focal.x;
    screen.row_y = (f.y * per_depth - s * slope.y) * focal.y;
    screen.relative_depth = s;
    screen.ray_length = ray_length;
    // |det J| = (fx/u2)(fy/u2) l/u2.
    screen.weight = kernel.mass * (focal.x * per_depth) * (focal.y * per_depth) * ray_length;
    return screen;
}

// Applies the low-pass filter `h2` [px²] according to `filter_kind`. The determinant is computed by the
// Cauchy-Binet formula, as a sum of squares.
fn filtered(screen: ScreenFactor, filter_kind: u32, h2: f32) -> ImageKernel {
    let x = screen.row_x;
    let y = screen.row_y;
    let xx = dot3(x, x);
    let yy = dot3(y, y);
    let minor = cross3(x, y);
    let minors = dot3(minor, minor);
    // a, b, c and the determinant.
    var moments: vec4<f32>;
    switch filter_kind {
        case FILTER_ADAPTIVE, FILTER_EXACT, FILTER_EWA: {
            moments = with_low_pass(x, y, minors, h2);
        }
        case FILTER_RECONSTRUCTION: {
            moments = with_low_pass(x, y, minors, 0.0);
        }
        case FILTER_LOW_PASS: {
            moments = vec4<f32>(h2, 0.0, h2, h2 * h2);
        }
        case FILTER_ISOTROPIC: {
            let v = 0.5 * (xx + yy) + h2;
            moments = vec4<f32>(v, 0.0, v, v * v);
        }
        default: {
            let largest = 0.5 * (xx + yy) + hypot(0.5 * (xx - yy), dot3(x, y));
            // A kernel without any width is given a millionth of its length.
            let smallest = max_number(minors / largest, largest * 1e-12);
            if largest == 0.0 {
                moments = vec4<f32>(h2, 0.0, h2, h2 * h2);
            } else {
                // NaN takes this branch and stays NaN: it draws nothing.
                let s2 = max_number(h2 / smallest, 1.0);
                let determinant = max_number(minors * s2, largest * smallest * s2) * s2;
                moments = vec4<f32>(xx * s2, dot3(x, y) * s2, yy * s2, determinant);
            }
        }
    }
    let tau = screen.weight / (TAU * sqrt(moments.w));
    var enlargement = GREATEST_ENLARGEMENT;
    if is_above(minors, 0.0) {
        enlargement = min_number(max_number(sqrt(moments.w / minors), 1.0), GREATEST_ENLARGEMENT);
    }
    return ImageKernel(moments.x, moments.y, moments.z, moments.w, tau, enlargement);
}

fn with_low_pass(x: vec3<f32>, y: vec3<f32>, minors: f32, h2: f32) -> vec4<f32> {
    let xx = dot3(x, x);
    let yy = dot3(y, y);
    let determinant = minors + h2 * (xx + yy) + h2 * h2;
    return vec4<f32>(xx + h2, dot3(x, y), yy + h2, determinant);
}

// Returns the rows p and r of the triangular form: Q = (p . d)² + (r . d)². The larger variance is
// eliminated first.
fn triangular_form(kernel: ImageKernel) -> array<vec2<f32>, 2> {
    let a = kernel.a;
    let b = kernel.b;
    let c = kernel.c;
    let determinant = kernel.determinant;
    if a >= c {
        let s = sqrt(a / determinant);
        return array<vec2<f32>, 2>(vec2<f32>(1.0 / sqrt(a), 0.0), vec2<f32>(-(b / a) * s, s));
    }
    let s = sqrt(c / determinant);
    return array<vec2<f32>, 2>(vec2<f32>(0.0, 1.0 / sqrt(c)), vec2<f32>(s, -(b / c) * s));
}
