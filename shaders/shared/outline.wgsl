// Computes the outline of a footprint's cut-off on the image, and tests which rectangles of pixels it
// meets. Twin: src/splat/outline.rs, which explains why.

// Q(d) - r² w(d) = 0, a convex quadratic of the pixel offset.
struct KernelOutline {
    p: vec2<f32>,
    r: vec2<f32>,
    // r² times the gradient and Hessian of w; zero on affine paths.
    gradient: vec2<f32>,
    hessian: vec3<f32>,
    cutoff_squared: f32,
    // Point at which the quadratic is least.
    middle: vec2<f32>,
}

// Returns the outline of an affine footprint: w = 1.
fn kernel_affine(p: vec2<f32>, r: vec2<f32>, cutoff_squared: f32) -> KernelOutline {
    return KernelOutline(p, r, vec2<f32>(), vec3<f32>(), cutoff_squared, vec2<f32>());
}

// Returns the outline of a footprint with w(d) = 1 + gradient . d + hxx dx² + hxy dx dy + hyy dy².
fn kernel_exact(
    p: vec2<f32>,
    r: vec2<f32>,
    cutoff_squared: f32,
    gradient: vec2<f32>,
    hessian: vec3<f32>,
) -> KernelOutline {
    var outline = kernel_affine(p, r, cutoff_squared);
    outline.gradient = gradient * cutoff_squared;
    outline.hessian = hessian * cutoff_squared;
    let abc = kernel_second(outline);
    let determinant = abc.x * abc.z - abc.y * abc.y;
    if determinant > 0.0 && !is_nan(determinant) {
        let g = outline.gradient * 0.5;
        outline.middle =
            vec2<f32>(abc.z * g.x - abc.y * g.y, abc.x * g.y - abc.y * g.x) / determinant;
    }
    return outline;
}

// Returns the coefficients of dx², 2 dx dy and dy².
fn kernel_second(outline: KernelOutline) -> vec3<f32> {
    let p = outline.p;
    let r = outline.r;
    return vec3<f32>(
        p.x * p.x + r.x * r.x - outline.hessian.x,
        p.x * p.y + r.x * r.y - 0.5 * outline.hessian.y,
        p.y * p.y + r.y * r.y - outline.hessian.z,
    );
}

fn kernel_value(outline: KernelOutline, d: vec2<f32>) -> f32 {
    let h = outline.hessian;
    let pd = dot2(outline.p, d);
    let rd = dot2(outline.r, d);
    let q = pd * pd + rd * rd;
    let w = dot2(outline.gradient, d) + h.x * d.x * d.x + h.y * d.x * d.y + h.z * d.y * d.y;
    return q - w - outline.cutoff_squared;
}

// Returns whether a point is inside. NaN counts as inside, as on the CPU.
fn kernel_inside(outline: KernelOutline, d: vec2<f32>) -> bool {
    let value = kernel_value(outline, d);
    // A small slack: the value at a needle's edge is a difference of large numbers.
    return is_nan(value) || !(value > outline.cutoff_squared * 1e-4);
}

// Clamps to two numbers; NaN gives the lower one.
fn clamped(x: f32, lower: f32, upper: f32) -> f32 {
    return select(min(max(x, lower), upper), lower, is_nan(x));
}

// Returns whether the rectangle between two offsets meets the inside. In a rectangle that does not contain the
// middle, the least value lies on an edge that faces the middle.
fn kernel_touches(outline: KernelOutline, lower: vec2<f32>, upper: vec2<f32>) -> bool {
    if is_nan(lower.x) || is_nan(lower.y) {
        return true;
    }
    let middle = outline.middle;
    let nearest = vec2<f32>(
        clamped(middle.x, lower.x, upper.x),
        clamped(middle.y, lower.y, upper.y),
    );
    let beside = nearest.x != middle.x || is_nan(middle.x);
    let above = nearest.y != middle.y || is_nan(middle.y);
    if !beside && !above {
        return true;
    }
    let abc = kernel_second(outline);
    if beside {
        let y = (0.5 * outline.gradient.y - abc.y * nearest.x) / abc.z;
        if kernel_inside(outline, vec2<f32>(nearest.x, clamped(y, lower.y, upper.y))) {
            return true;
        }
    }
    if above {
        let x = (0.5 * outline.gradient.x - abc.y * nearest.y) / abc.x;
        return kernel_inside(outline, vec2<f32>(clamped(x, lower.x, upper.x), nearest.y));
    }
    return false;
}

// The side 1 + g . d > 0 of the conic Q(d) = r² (1 + g . d)²: an ellipse or the branch of a hyperbola.
struct PlaneOutline {
    p: vec2<f32>,
    r: vec2<f32>,
    gradient: vec2<f32>,
    cutoff: f32,
    // Minimum of |A d| on a column, y0 = `middle.y` dx, and likewise on a row.
    middle: vec2<f32>,
    // Shift t = `shift.y` |dx| on a column, and likewise on a row.
    shift: vec2<f32>,
}

// Bound on the error of each number in f32: sixteen roundings of the greatest term.
const OUTLINE_ROUNDING: f32 = 1e-6;

// Stands for an infinite shift: beyond any image, and within f32 when multiplied by an offset.
const ENDLESS: f32 = 1e30;

// Returns the outline of a surfel whose inverse depth at the offset d is 1 + `gradient` . d times its
// centre's.
fn plane_outline(
    p: vec2<f32>,
    r: vec2<f32>,
    cutoff_squared: f32,
    gradient: vec2<f32>,
) -> PlaneOutline {
    let cutoff = sqrt(cutoff_squared);
    let a = p.x * p.x + r.x * r.x;
    let b = p.x * p.y + r.x * r.y;
    let c = p.y * p.y + r.y * r.y;
    let determinant = abs(p.x * r.y - p.y * r.x);
    return PlaneOutline(
        p,
        r,
        gradient,
        cutoff,
        vec2<f32>(-b / a, -b / c),
        vec2<f32>(
            plane_shift(cutoff * gradient.x, a, determinant),
            plane_shift(cutoff * gradient.y, c, determinant),
        ),
    );
}

fn plane_shift(drift: f32, c: f32, determinant: f32) -> f32 {
    let left = c - drift * drift;
    if is_above(left, 0.0) {
        return drift * determinant / (c * sqrt(left));
    }
    return select(ENDLESS, -ENDLESS, is_above(0.0, drift));
}

// Returns whether an offset is inside; NaN counts as inside.
fn plane_inside(outline: PlaneOutline, d: vec2<f32>) -> bool {
    let px = outline.p.x * d.x;
    let py = outline.p.y * d.y;
    let rx = outline.r.x * d.x;
    let ry = outline.r.y * d.y;
    let gx = outline.gradient.x * d.x;
    let gy = outline.gradient.y * d.y;
    let p = px + py;
    let r = rx + ry;
    let q = p * p + r * r;
    // Never less than the rasteriser computes: each sum may be off by the roundings of its terms.
    let plane_terms = outline.cutoff * (1.0 + abs(gx) + abs(gy));
    let form_terms = abs(px) + abs(py) + abs(rx) + abs(ry);
    let reach = outline.cutoff * (1.0 + gx + gy) + OUTLINE_ROUNDING * (plane_terms + form_terms);
    return is_nan(q) || is_nan(reach) || (reach >= 0.0 && !is_above(q, reach * reach));
}

// Returns whether the rectangle between two offsets meets the inside.
fn plane_touches(outline: PlaneOutline, lower: vec2<f32>, upper: vec2<f32>) -> bool {
    if is_nan(lower.x) || is_nan(lower.y) {
        return true;
    }
    let beside = lower.x > 0.0 || upper.x < 0.0;
    let above = lower.y > 0.0 || upper.y < 0.0;
    if !beside && !above {
        return true;
    }
    if beside {
        let x = select(upper.x, lower.x, lower.x > 0.0);
        let y = outline.middle.y * x + outline.shift.y * abs(x);
        let nearest = vec2<f32>(x, clamped(y, lower.y, upper.y));
        if is_nan(y) || plane_inside(outline, nearest) {
            return true;
        }
    }
    if above {
        let y = select(upper.y, lower.y, lower.y > 0.0);
        let x = outline.middle.x * y + outline.shift.x * abs(y);
        let nearest = vec2<f32>(clamped(x, lower.x, upper.x), y);
        return is_nan(x) || plane_inside(outline, nearest);
    }
    return false;
}
