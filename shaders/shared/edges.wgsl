// Cuts kernels at the boundary of their data's domain. Twin: src/splat/edges.rs.

// The planes that cut one kernel, camera space: inward unit normal, and distance of the kernel's centre
// inside.
struct Edges {
    planes: array<vec4<f32>, MOST_EDGES>,
    count: u32,
    is_outside: bool,
}

// Returns Lᵀn: the kernel's reach along a normal, by the axes of its factor.
fn reach_along(kernel: Kernel, normal: vec3<f32>) -> vec3<f32> {
    let f = kernel.factor;
    return f.x * normal.x + f.y * normal.y + f.z * normal.z;
}

// Adds a plane of a kernel's particle: unit normal in the world, and distance of the particle's centre
// inside; not finite for no plane.
//
// - `moved`: offset of the kernel's centre from the particle's, camera space;
// - `deviations`: number of standard deviations within which a plane cuts.
fn with_edge(
    edges: Edges,
    kernel: Kernel,
    rotation: mat3x3<f32>,
    moved: vec3<f32>,
    deviations: f32,
    plane: vec4<f32>,
) -> Edges {
    var out = edges;
    if !is_finite(plane.w) {
        return out;
    }
    let normal = times(rotation, plane.xyz);
    let inside = plane.w + dot3(normal, moved);
    let reach = deviations * length3(reach_along(kernel, normal));
    if inside <= -reach {
        out.is_outside = true;
    }
    if inside < reach && out.count < MOST_EDGES {
        out.planes[out.count] = vec4<f32>(normal, inside);
        out.count = out.count + 1u;
    }
    return out;
}

// Returns the number of standard deviations within which a plane cuts a kernel.
fn reach_within(tolerance: f32) -> f32 {
    return select(EDGE_REACH, 3.5, tolerance >= 1.5e-2);
}

// Returns whether an exact footprint is cut where rays meet its planes: the low-pass filter's share of its
// narrower side does not exceed the angle that its kernel fills.
fn meets_rays(view: ViewUniform, kernel: Kernel, path: u32) -> bool {
    if path != PATH_EXACT {
        return false;
    }
    let screen = project_kernel(view, kernel);
    let both = dot3(screen.row_x, screen.row_x) + dot3(screen.row_y, screen.row_y);
    let m = cross3(screen.row_x, screen.row_y);
    let narrower = dot3(m, m) / max(both, SMALLEST);
    let f = kernel.factor;
    let size = sqrt(dot3(f.x, f.x) + dot3(f.y, f.y) + dot3(f.z, f.z));
    let h2 = view.low_pass_variance_px2;
    return !(h2 * length3(kernel.centre) > size * (h2 + narrower));
}

// Returns a plane in the form that a footprint's path reads.
//
// - `at_rays`: whether rays meet it.
fn written_edge(
    view: ViewUniform,
    kernel: Kernel,
    path: u32,
    at_rays: bool,
    plane: vec4<f32>,
) -> vec4<f32> {
    let normal = plane.xyz;
    let inside = plane.w;
    if (path & 3u) == PATH_NEAR {
        // Distance of the eye, at the origin.
        let of_eye = inside - dot3(normal, kernel.centre);
        let side = select(-1.0, 1.0, of_eye > 0.0);
        let distance = max(abs(of_eye), SMALLEST);
        return vec4<f32>(normal * (-side / distance), side);
    }
    if at_rays {
        let slope = normal.xy / view.focal_px;
        let across = dot3(normal, kernel.centre) / kernel.centre.z;
        return vec4<f32>(slope, across, inside);
    }
    let screen = project_kernel(view, kernel);
    let h2 = view.low_pass_variance_px2;
    let reach = reach_along(kernel, normal);
    let length = max(length3(reach), SMALLEST);
    let x = screen.row_x;
    let y = screen.row_y;
    let t = reach / length;
    let m = cross3(x, y);
    let xt = cross3(x, t);
    let yt = cross3(y, t);
    let determinant = dot3(m, m) + h2 * (dot3(x, x) + dot3(y, y)) + h2 * h2;
    // Minors, not products of squares, which would cancel for long kernels.
    let inverse = 1.0 / max(determinant, SMALLEST);
    let slope = vec2<f32>(h2 * dot3(x, t) - dot3(m, yt), h2 * dot3(y, t) + dot3(m, xt));
    let triple_product = dot3(m, t);
    let squares = triple_product * triple_product + h2 * (dot3(xt, xt) + dot3(yt, yt))
        + h2 * h2 * dot3(t, t);
    let spread = max(sqrt(squares * inverse), LEAST_SPREAD);
    var direction = kernel.centre;
    if view.orthographic != 0u {
        direction = vec3<f32>(0.0, 0.0, 1.0);
    }
    var enters = select(-1.0, 1.0, dot3(normal, direction) > 0.0);
    if 2.0 * h2 > dot3(x, x) + dot3(y, y) {
        enters = 0.0;
    }
    return vec4<f32>(slope * (inverse / spread), inside / length / spread, enters);
}
