// Stage: projects particles to footprints, one thread per classified particle. Twin: src/cpu/project/.

// Bindings 0 and 1 belong to the particles.
@group(0) @binding(2) var<uniform> view_uniform: ViewUniform;
// The camera's rotation.
@group(0) @binding(3) var<uniform> rotation: mat3x3<f32>;
// Number of classified particles.
@group(0) @binding(4) var<storage, read> counts: array<u32>;
@group(0) @binding(5) var<storage, read> views: array<BlockView>;
@group(0) @binding(6) var<storage, read> classified: array<ClassifiedParticle>;
@group(0) @binding(7) var<storage, read_write> footprints: array<Footprint>;
// Written for footprints on the exact path, for kernels that opaque surfaces may cut, and (as
// `SurfelTerms`) for surfels of an opaque surface. If any of these may occur, it is as long as
// `footprints`.
@group(0) @binding(8) var<storage, read_write> exact: array<ExactTerms>;
@group(0) @binding(9) var<storage, read_write> near: NearList;

// Terms of the kernels that cross the camera plane.
struct NearList {
    // Number of terms. If it exceeds the length of `terms`, the kernels without a place draw nothing.
    count: atomic<u32>,
    // Number of kernels that cross the camera plane; the other terms contain only edges.
    crossing: atomic<u32>,
    terms: array<NearTerms>,
}

// Word of `counts` that is read.
override COUNT_INDEX: u32 = 0u;
// Variant of the pipeline: code for other variants is not compiled. With FILTER_ADAPTIVE the block sets
// the filter of its particles.
override FILTER: u32 = 0u;
override IS_ORTHOGRAPHIC: bool = false;
// Rule by which particles are drawn: one of the RULE_ constants.
override RULE: u32 = 0u;
// Rule of splats that state their opacity: one of the SPLAT_ constants.
override SPLAT_RULE: u32 = SPLAT_EXACT;
// True if surfels seen from behind are left out.
override IS_ONE_SIDED: bool = false;
// True if kernels may be cut by surfaces, clip planes or slabs. If so, all have terms that describe their
// depth.
override IS_CUT: bool = false;
// True if the boundary of their domain may cut any kernel of the pass. If so, all have terms.
override HAS_EDGES: bool = false;

// True if particles are pieces of kernels, whose terms follow after all particles.
override HAS_PIECES: bool = false;
// Word of `counts` with the offset of these terms.
override CAPACITY_INDEX: u32 = 0u;

@compute @workgroup_size(THREADS)
fn project(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    if i >= counts[COUNT_INDEX] {
        return;
    }
    var view = view_uniform;
    view.orthographic = u32(IS_ORTHOGRAPHIC);

    let particle = classified[i];
    let block = views[particle.view];
    var offset = times(rotation, world_offset(block.block, particle.local));
    var factor = camera_factor(rotation, block.block, particle.local);
    var is_piece = false;
    var shift = vec3<f32>(0.0);
    if HAS_PIECES {
        let terms = piece_terms(classified[counts[CAPACITY_INDEX] + i]);
        let piece = piece_of(terms, rotation, factor);
        is_piece = piece.exists;
        factor = piece.factor;
        shift = piece.shift;
        offset = offset + shift;
    }
    let crowding = crowding_of(block.block);
    let origin = vector(block.origin_camera);
    var kernel = Kernel(origin + offset, factor, particle.mass);
    let key = depth_key(view, block.key, origin, offset);
    let filter_kind = select(FILTER, block.filter_kind, FILTER == FILTER_ADAPTIVE);
    // Merged particles already account for their members' opacity; pieces form sheets, so they are not
    // lone.
    let is_lone = view.sub_pixel_opacity != 0u && block.level == 0u && !is_piece;
    var out: Footprint;
    var edges: Edges;
    if HAS_EDGES {
        let deviations = reach_within(view.tolerance);
        for (var k = 0u; k < MOST_EDGES; k = k + 1u) {
            let plane = edge_of(block.block, particle.local, k);
            edges = with_edge(edges, kernel, rotation, shift, deviations, plane);
        }
    }
    let is_cut = IS_CUT || edges.count > 0u;
    if HAS_EDGES && edges.is_outside {
        out = invisible(kernel, particle.carried, key);
    } else if RULE == RULE_PEAK {
        if IS_CUT {
            // Splats have no depth of their own: that of the centre is used.
            exact[i] = ExactTerms();
        }
        out = splat_footprint(view, kernel, crowding, particle.carried, key);
    } else if RULE == RULE_SURFACE {
        out = surfel(view, kernel, particle.carried, key, i);
    } else {
        if RULE == RULE_TRANSLUCENT {
            kernel.mass = kernel.mass * facing(view, kernel);
        }
        view.low_pass_variance_px2 = view.low_pass_variance_px2 + defocus(view, kernel);
        out = footprint(
            view,
            filter_kind,
            is_lone,
            kernel,
            crowding,
            particle.carried,
            key,
            is_cut,
            i,
        );
    }
    if HAS_EDGES && RULE != RULE_SURFACE {
        exact[i].edges = cut_by_edges(view, kernel, edges, out);
    }
    if RULE != RULE_SURFACE && view.keys_begin != 0u {
        out.key = slab_key(view, block.key, origin, kernel, out);
    }
    if view.show_choice != 0u {
        out.carried = CHOICE_COLOURS[choice_index(block.level, out.path, filter_kind)];
    }
    footprints[i] = out;
}

// Returns the index in CHOICE_COLOURS of a footprint's colour. It depends on its block's level of detail,
// its own path and its block's filter. Twin: src/splat/show.rs.
fn choice_index(level: u32, path: u32, filter_kind: u32) -> u32 {
    if level > 0u {
        return 5u + min(level, 4u);
    }
    if path == PATH_EXACT {
        return 0u;
    }
    if path != PATH_AFFINE {
        return 5u;
    }
    switch filter_kind {
        case FILTER_RECONSTRUCTION: {
            return 2u;
        }
        case FILTER_LOW_PASS: {
            return 3u;
        }
        case FILTER_ISOTROPIC: {
            return 4u;
        }
        default: {
            return 1u;
        }
    }
}

// Returns the key of the depth, or of the distance |B + o| = |B| + o.(2B + o)/(|B + o| + |B|): the block's own key, which
// is exact, plus a difference in f32.
fn depth_key(view: ViewUniform, block_key: u32, origin: vec3<f32>, offset: vec3<f32>) -> u32 {
    var delta = offset.z;
    if view.key_kind == KEYS_OF_LAYERS {
        delta = dot3(offset, view.key_axis);
    } else if view.key_kind == KEYS_OF_DISTANCE {
        let sum = length3(origin + offset) + length3(origin);
        delta = 0.0;
        if is_above(sum, 0.0) {
            delta = dot3(offset, origin * 2.0 + offset) / sum;
        }
    }
    return moved_key(view, block_key, delta);
}

// Returns a key moved by a distance.
fn moved_key(view: ViewUniform, block_key: u32, delta: f32) -> u32 {
    // Ties to even.
    let keys = round(delta * view.key_scale);
    if is_nan(keys) {
        return block_key;
    }
    if keys < 0.0 {
        return block_key - min(block_key, u32(min(-keys, 2147483648.0)));
    }
    let sum = block_key + min(u32(min(keys, 2147483648.0)), 0x7fffffffu);
    return select(sum, 0xffffffffu, sum < block_key);
}

// Returns the key of the depth at which a kernel begins; kernels that begin behind the eye get the depth
// of the eye.
fn slab_key(
    view: ViewUniform,
    block_key: u32,
    origin: vec3<f32>,
    kernel: Kernel,
    out: Footprint,
) -> u32 {
    let reach = sqrt(out.cutoff_squared) * length3(kernel.factor.z);
    let begin = max_number(kernel.centre.z - reach, 0.0);
    return moved_key(view, block_key, begin - origin.z);
}

// Returns a footprint that reaches no pixel yet.
fn invisible(kernel: Kernel, carried: array<f32, 3>, key: u32) -> Footprint {
    var out: Footprint;
    out.carried = carried;
    out.depth = kernel.centre.z;
    out.path = PATH_AFFINE;
    out.key = key;
    return out;
}

// Returns the footprint of a splat whose opacity is stated.
fn splat_footprint(
    view: ViewUniform,
    kernel: Kernel,
    crowding: f32,
    carried: array<f32, 3>,
    key: u32,
) -> Footprint {
    var out = invisible(kernel, carried, key);
    let peak = peak_footprint(view, kernel, SPLAT_RULE);
    if !peak.exists {
        return out;
    }
    let depth = peak.image.tau * peak.image.enlargement * meeting(crowding);
    let radius = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
    // The limits of a rule are those of sharp splats.
    let rule = select(SPLAT_RULE, SPLAT_EXACT, defocus(view, kernel) > SPLAT_LOW_PASS_PX2);
    let r = peak_reach(rule, peak.image.tau, radius);
    if r < 0.0 {
        return out;
    }
    affine_part(&out, peak.screen, peak.image, r);
    out.tau = peak.image.tau;
    out.path = select(PATH_PEAK, PATH_CAPPED, rule == SPLAT_INRIA || rule == SPLAT_MIP);
    let half_size = vec2<f32>(sqrt(peak.image.a), sqrt(peak.image.c)) * r;
    set_bounds(view, &out, peak.screen.centre_px, half_size);
    return out;
}

// Returns whether surfels seen from behind are left out. A cut exposes the inside of a closed surface, so they
// are then drawn.
fn is_one_sided(view: ViewUniform) -> bool {
    return IS_ONE_SIDED && view.clip_count == 0u;
}

// Returns the footprint of a surfel of an opaque surface. Its terms, if any, are written at `index`.
fn surfel(
    view: ViewUniform,
    kernel: Kernel,
    carried: array<f32, 3>,
    key: u32,
    index: u32,
) -> Footprint {
    var out = invisible(kernel, carried, key);
    // Weights are averaged, so the error at a kernel's end is relative.
    let r = cutoff_radius(0.0, 1.0, view.tolerance / CUTOFF_SHARE, view.cutoff);
    let reach = r * length3(kernel.factor.z);
    if is_above(-reach, kernel.centre.z) {
        return out;
    }
    if is_at_most(kernel.centre.z, NEAR_MARGIN * reach) && view.orthographic == 0u {
        let found = near_surfel(kernel, is_one_sided(view));
        if !found.exists {
            return out;
        }
        let x_axis = vec3<f32>(1.0, 0.0, 0.0);
        let y_axis = vec3<f32>(0.0, 1.0, 0.0);
        let columns = near_range(kernel, x_axis, kernel.factor.x, view, 0u, r, 0.0);
        let rows = near_range(kernel, y_axis, kernel.factor.y, view, 1u, r, 0.0);
        if columns != 0u && rows != 0u {
            let place = push_at(found.terms);
            if place == NO_PLACE {
                return out;
            }
            out.columns = columns;
            out.rows = rows;
            out.tau = found.weight / cutoff_share(r);
            out.cutoff_squared = r * r;
            out.path = (place << 4u) | PATH_NEAR_SURFEL;
            // No fragment of it is nearer.
            out.depth = LARGEST;
        }
        return out;
    }
    let surfel = surfel_footprint(view, kernel, is_one_sided(view), r);
    if !surfel.exists {
        return out;
    }
    let screen = surfel.screen;
    let image = surfel.image;
    let plane = surfel.terms;
    affine_part(&out, screen, image, r);
    out.path = PATH_SURFEL;
    var middle = vec2<f32>(0.0);
    var half_size = vec2<f32>(sqrt(image.a), sqrt(image.c)) * r;
    if plane.homography > 0.0 {
        let extent = exact_extent(screen, view.low_pass_variance_px2, r);
        if !extent.exists {
            return out;
        }
        middle = extent.middle;
        half_size = extent.half_size;
    }
    set_bounds(view, &out, screen.centre_px + middle, half_size);
    // Greatest inverse depth within the box: no fragment of the surfel is nearer.
    let gradient = vec2<f32>(plane.gradient[0], plane.gradient[1]);
    let nearest = plane.inverse_depth + dot2(gradient, middle) + dot2(abs(gradient), half_size);
    out.depth = nearest + plane.slack;
    exact[index] = ExactTerms(
        plane.gradient,
        array<f32, 3>(plane.inverse_depth, plane.slack, plane.homography),
        plane.normal,
        0u,
    );
    return out;
}

// Returns the cosine between a surfel's normal and the ray through its centre. It makes the optical depth
// of a sheet the same from every side. 0 for a one-sided surfel seen from behind.
fn facing(view: ViewUniform, kernel: Kernel) -> f32 {
    var c = columns(kernel.factor);
    let normal = cross3(c[0] / largest_of(c[0]), c[1] / largest_of(c[1]));
    let u = kernel.centre;
    let ray = select(u / largest_of(u), vec3<f32>(0.0, 0.0, 1.0), view.orthographic != 0u);
    let across = dot3(normal, ray);
    let lengths = length3(normal) * length3(ray);
    if !is_above(lengths, 0.0) || (is_one_sided(view) && is_above(across, 0.0)) {
        return 0.0;
    }
    return abs(across) / lengths;
}

// Returns the footprint of one kernel; invisible if it reaches no pixel. Its exact terms, if any, are
// written at `index`.
fn footprint(
    view: ViewUniform,
    filter_kind: u32,
    is_lone: bool,
    kernel: Kernel,
    crowding: f32,
    carried: array<f32, 3>,
    key: u32,
    is_cut: bool,
    index: u32,
) -> Footprint {
    var out = invisible(kernel, carried, key);
    let h2 = view.low_pass_variance_px2;
    let z = kernel.factor.z;
    var reach = length3(z);
    if !is_finite(reach) {
        // Lengths beyond 1e19, whose squares overflow f32.
        reach = hypot(hypot(z.x, z.y), z.z);
    }
    if is_above(-MAX_CUTOFF * reach, kernel.centre.z) {
        return out;
    }
    let orthographic = view.orthographic != 0u;
    if kernel.centre.z <= 0.0 && !orthographic {
        near_footprint(view, kernel, crowding, &out);
        return out;
    }
    let screen = project_kernel(view, kernel);
    var image = filtered(screen, filter_kind, h2);
    if is_lone {
        image = as_lone(screen, filter_kind, h2, image);
    }
    let is_shape = is_finite3(screen.row_x) && is_finite3(screen.row_y);
    if !(is_shape && is_above(image.tau, 0.0) && is_finite(image.tau)) {
        // A singular footprint (no low-pass filter), or numbers beyond f32.
        return out;
    }
    // Total depth of the kernels whose edges coincide.
    let depth = image.tau * image.enlargement * meeting(crowding);
    var r = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
    let choice = choose_exact(view, filter_kind, screen, image, crowding);
    if choice.exists {
        // Away from the camera's axis one side of the edge exceeds exp(-r²/2). The kernel ends where that
        // side falls below the tolerance. The radius is a tenth larger, because the wider edge exceeds it
        // more.
        let growth = edge_growth(view, screen, image, choice.terms, 1.1 * r);
        let wider = cutoff_radius(depth, growth, view.tolerance, view.cutoff);
        r = max(r, wider);
    }
    if kernel.centre.z <= NEAR_MARGIN * r * reach {
        if orthographic {
            half_line_footprint(view, kernel, &out, screen, image, r);
        } else {
            near_footprint(view, kernel, crowding, &out);
        }
        return out;
    }
    if choice.exists {
        let extent = exact_extent(screen, h2, r);
        if !extent.exists {
            return out;
        }
        var terms = choice.terms;
        if is_cut {
            let depths = depth_terms(view, screen, h2, image.determinant, kernel.centre.z);
            terms.depth_sigma = depths.sigma;
        }
        exact[index] = terms;
        affine_part(&out, screen, image, r);
        out.path = PATH_EXACT;
        // |D| is evaluated per pixel; |D0| goes here.
        out.tau = out.tau / screen.ray_length;
        set_bounds(view, &out, screen.centre_px + extent.middle, extent.half_size);
    } else {
        if is_cut {
            let determinant = filtered(screen, FILTER_EWA, h2).determinant;
            let depths = depth_terms(view, screen, h2, determinant, kernel.centre.z);
            var terms: ExactTerms;
            terms.gradient = array<f32, 2>(depths.slope.x, depths.slope.y);
            terms.depth_sigma = depths.sigma;
            exact[index] = terms;
        }
        affine_part(&out, screen, image, r);
        let half_size = vec2<f32>(sqrt(image.a), sqrt(image.c)) * r;
        set_bounds(view, &out, screen.centre_px, half_size);
    }
    return out;
}

fn affine_part(out: ptr<function, Footprint>, screen: ScreenFactor, image: ImageKernel, r: f32) {
    let form = triangular_form(image);
    (*out).centre_px = screen.centre_px;
    (*out).form_p = form[0];
    (*out).form_r = form[1];
    (*out).tau = image.tau / cutoff_share(r);
    (*out).cutoff_squared = r * r;
}

// Sets the ranges of pixels whose centres lie within `half_size` of `centre`.
fn set_bounds(
    view: ViewUniform,
    out: ptr<function, Footprint>,
    centre: vec2<f32>,
    half_size: vec2<f32>,
) {
    let columns = pixel_range(centre.x, half_size.x, view.size.x);
    let rows = pixel_range(centre.y, half_size.y, view.size.y);
    if columns != 0u && rows != 0u {
        (*out).columns = columns;
        (*out).rows = rows;
    }
}

// Returns a packed range; 0 if it is empty.
fn pixel_range(centre: f32, half_size: f32, size: u32) -> u32 {
    let first = pixel_of(ceil(centre - half_size - 0.5), size);
    let end = pixel_of(floor(centre + half_size - 0.5) + 1.0, size);
    return select(0u, first | (end << 16u), first < end);
}

// Clamps a whole number to 0 ... size; NaN gives 0.
fn pixel_of(x: f32, size: u32) -> u32 {
    if is_nan(x) {
        return 0u;
    }
    return u32(clamp(x, 0.0, f32(size)));
}

const NO_PLACE: u32 = 0xffffffffu;

// Returns the path of a footprint with these terms.
fn push(terms: NearTerms, path: u32) -> u32 {
    let place = push_at(terms);
    if place == NO_PLACE {
        return NO_PLACE;
    }
    return (place << 2u) | path;
}

// Appends terms to those of near kernels, and returns their index.
fn push_at(terms: NearTerms) -> u32 {
    atomicAdd(&near.crossing, 1u);
    return listed(terms);
}

fn listed(terms: NearTerms) -> u32 {
    let place = atomicAdd(&near.count, 1u);
    if place >= arrayLength(&near.terms) {
        return NO_PLACE;
    }
    near.terms[place] = terms;
    return place;
}

// Adds the planes at which the boundary of its domain cuts a kernel to its footprint. Returns one more
// than their index; 0 if its path contains the index or nothing cuts it.
fn cut_by_edges(view: ViewUniform, kernel: Kernel, edges: Edges, out: Footprint) -> u32 {
    if edges.count == 0u || out.rows == 0u {
        return 0u;
    }
    let at_rays = meets_rays(view, kernel, out.path);
    let count = edges.count | select(0u, RAY_EDGES, at_rays);
    var own: array<array<f32, 4>, MOST_EDGES>;
    for (var k = 0u; k < edges.count; k = k + 1u) {
        let edge = written_edge(view, kernel, out.path, at_rays, edges.planes[k]);
        own[k] = array<f32, 4>(edge.x, edge.y, edge.z, edge.w);
    }
    if (out.path & 2u) != 0u {
        let place = out.path >> 2u;
        near.terms[place].edges = own;
        near.terms[place].edge_count = count;
        return 0u;
    }
    var terms: NearTerms;
    terms.edges = own;
    terms.edge_count = count;
    let place = listed(terms);
    return select(place + 1u, 0u, place == NO_PLACE);
}

// Computes the footprint of an orthographic kernel that reaches behind the eye's plane.
fn half_line_footprint(
    view: ViewUniform,
    kernel: Kernel,
    out: ptr<function, Footprint>,
    screen: ScreenFactor,
    image: ImageKernel,
    r: f32,
) {
    affine_part(out, screen, image, r);
    let half_size = vec2<f32>(sqrt(image.a), sqrt(image.c)) * r;
    set_bounds(view, out, screen.centre_px, half_size);
    if (*out).rows != 0u {
        let h2 = view.low_pass_variance_px2;
        let determinant = filtered(screen, FILTER_EWA, h2).determinant;
        let depths = depth_terms(view, screen, h2, determinant, kernel.centre.z);
        let path = push(half_line_terms(kernel, depths.slope, depths.sigma), PATH_HALF_LINE);
        if path == NO_PLACE {
            (*out).columns = 0u;
            (*out).rows = 0u;
            return;
        }
        (*out).path = path;
    }
}

// Computes the footprint of a perspective kernel that reaches the camera plane.
fn near_footprint(
    view: ViewUniform,
    kernel: Kernel,
    crowding: f32,
    out: ptr<function, Footprint>,
) {
    let found = near_terms(view, kernel);
    if !found.exists {
        return;
    }
    let weight = found.weight;
    // A bound of the optical depth in any direction: |D|/sqrt(DᵀKD) <= sqrt(trace V / det V), V with the
    // low-pass filter of `near_terms`.
    let h = sqrt(view.low_pass_variance_px2);
    let low_pass = h * max_number(abs(kernel.centre.z), length3(kernel.factor.z));
    var c = columns(kernel.factor);
    var trace = 0.0;
    for (var i = 0; i < 3; i = i + 1) {
        trace = trace + dot3(c[i], c[i]);
    }
    let added = low_pass / view.focal_px;
    trace = trace + added.x * added.x + added.y * added.y;
    let unit2 = kernel.mass / (TAU * weight);
    var highest = weight * sqrt(trace / unit2) / found.terms.sigma;
    if !is_finite(highest) || found.terms.sigma == 0.0 {
        // A flat kernel's bound is infinite, and NaN must not reduce the radius.
        highest = LARGEST;
    }
    let r = cutoff_radius(highest * meeting(crowding), 1.0, view.tolerance, view.cutoff);
    let x_axis = vec3<f32>(1.0, 0.0, 0.0);
    let y_axis = vec3<f32>(0.0, 1.0, 0.0);
    let columns = near_range(kernel, x_axis, kernel.factor.x, view, 0u, r, h);
    let rows = near_range(kernel, y_axis, kernel.factor.y, view, 1u, r, h);
    if columns != 0u && rows != 0u {
        var terms = found.terms;
        terms.reach = r * length3(kernel.factor.z);
        let path = push(terms, PATH_NEAR);
        if path == NO_PLACE {
            return;
        }
        (*out).columns = columns;
        (*out).rows = rows;
        (*out).tau = weight / cutoff_share(r);
        (*out).cutoff_squared = r * r;
        (*out).path = path;
    }
}

// Returns the pixels along one axis that the cut-off ellipsoid may reach, in whole tiles: from the first
// to the last slab that neither bounding plane separates from it. 0 if there are none.
fn near_range(
    kernel: Kernel,
    axis: vec3<f32>,
    row: vec3<f32>,
    view: ViewUniform,
    i: u32,
    r: f32,
    h: f32,
) -> u32 {
    let size = view.size[i];
    // The low-pass filter of `near_terms`, as a width in the plane of the image.
    let reach_z = length3(kernel.factor.z);
    let low_pass = h * max_number(abs(kernel.centre.z), reach_z) / view.focal_px[i];
    let tiles = (size + TILE_SIZE - 1u) / TILE_SIZE;
    var first = 0u;
    while first < tiles && !near_reaches(kernel, axis, row, view, i, r, low_pass, first) {
        first = first + 1u;
    }
    var end = tiles;
    while end > first && !near_reaches(kernel, axis, row, view, i, r, low_pass, end - 1u) {
        end = end - 1u;
    }
    if first == end {
        return 0u;
    }
    return (first * TILE_SIZE) | (min(end * TILE_SIZE, size) << 16u);
}

// Returns whether the ellipsoid may reach into the tiles of number `t` along an axis.
fn near_reaches(
    kernel: Kernel,
    axis: vec3<f32>,
    row: vec3<f32>,
    view: ViewUniform,
    i: u32,
    r: f32,
    low_pass: f32,
    t: u32,
) -> bool {
    let highest = near_side(kernel, axis, row, view, i, r, low_pass, t * TILE_SIZE).y;
    let lowest = near_side(kernel, axis, row, view, i, r, low_pass, (t + 1u) * TILE_SIZE).x;
    return !is_nan(highest) && !is_nan(lowest) && highest >= 0.0 && lowest <= 0.0;
}

// Returns the extent of the ellipsoid beyond the plane x = X z through a pixel's edge, on either side of
// it.
fn near_side(
    kernel: Kernel,
    axis: vec3<f32>,
    row: vec3<f32>,
    view: ViewUniform,
    i: u32,
    r: f32,
    low_pass: f32,
    px: u32,
) -> vec2<f32> {
    let slope = (f32(px) - view.centre_px[i]) / view.focal_px[i];
    let centre = dot3(kernel.centre, axis) - slope * kernel.centre.z;
    let reach = r * hypot(length3(row - kernel.factor.z * slope), low_pass);
    return vec2<f32>(centre - reach, centre + reach);
}
