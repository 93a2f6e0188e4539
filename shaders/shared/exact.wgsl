// Computes exact perspective footprints: five floats in addition to the affine footprint. Twin:
// src/splat/exact.rs.

// Returns the coefficients of w(d). `determinant` is that of the low-passed footprint.
fn exact_terms(screen: ScreenFactor, h2: f32, determinant: f32) -> ExactTerms {
    let x = screen.row_x;
    let y = screen.row_y;
    let s = screen.relative_depth;
    let m = cross3(x, y);
    let a = cross3(y, s);
    let b = cross3(s, x);
    let inv = 1.0 / determinant;
    let low_pass = h2 * dot3(s, s);
    var terms: ExactTerms;
    terms.gradient[0] = 2.0 * inv * (dot3(m, a) - h2 * dot3(x, s));
    terms.gradient[1] = 2.0 * inv * (dot3(m, b) - h2 * dot3(y, s));
    terms.hessian[0] = inv * (dot3(a, a) + low_pass);
    terms.hessian[1] = inv * 2.0 * dot3(a, b);
    terms.hessian[2] = inv * (dot3(b, b) + low_pass);
    return terms;
}

// Change of a kernel's depth across its footprint (per pixel), and its standard deviation along a ray;
// world units. `determinant`: determinant of the low-passed footprint.
struct DepthTerms {
    slope: vec2<f32>,
    sigma: f32,
}

fn depth_terms(
    view: ViewUniform,
    screen: ScreenFactor,
    h2: f32,
    determinant: f32,
    depth: f32,
) -> DepthTerms {
    let x = screen.row_x;
    let y = screen.row_y;
    let s = screen.relative_depth;
    let m = cross3(x, y);
    let xs = cross3(x, s);
    let ys = cross3(y, s);
    let inv = 1.0 / determinant;
    // Minors, not products of squares, which would cancel for long kernels.
    let slope = vec2<f32>(h2 * dot3(x, s) - dot3(m, ys), h2 * dot3(y, s) + dot3(m, xs)) * inv;
    let volume = dot3(m, s);
    let squares = volume * volume + h2 * (dot3(xs, xs) + dot3(ys, ys)) + h2 * h2 * dot3(s, s);
    // `relative_depth` is relative under perspective only.
    let scale = select(depth, 1.0, view.orthographic != 0u);
    return DepthTerms(slope * scale, sqrt(squares * inv) * scale);
}

// The bounding box of the cut-off ellipsoid's outline: its middle relative to the kernel's centre
// and its half extents, pixels.
struct Extent {
    exists: bool,
    middle: vec2<f32>,
    half_size: vec2<f32>,
}

// Returns the bounding box of the cut-off ellipsoid's outline on the image; none if the ellipsoid reaches
// the camera plane (r |s| >= 1).
fn exact_extent(screen: ScreenFactor, h2: f32, r: f32) -> Extent {
    let s = screen.relative_depth;
    let in_front = 1.0 - r * r * dot3(s, s);
    var extent: Extent;
    extent.exists = is_above(in_front, 1e-6);
    let x = extent_along(screen.row_x, s, h2, r, in_front);
    let y = extent_along(screen.row_y, s, h2, r, in_front);
    extent.middle = vec2<f32>(x.x, y.x);
    extent.half_size = vec2<f32>(x.y, y.y);
    return extent;
}

// Returns middle and half extent along one axis.
fn extent_along(row: vec3<f32>, s: vec3<f32>, h2: f32, r: f32, in_front: f32) -> vec2<f32> {
    let spread = dot3(row, row) + h2;
    let minor = cross3(row, s);
    let miss = dot3(minor, minor) + h2 * dot3(s, s);
    let half_size = r * sqrt(max_number(spread - r * r * miss, 0.0)) / in_front;
    return vec2<f32>(-r * r * dot3(s, row) / in_front, half_size);
}
