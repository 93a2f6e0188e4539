// Stage: from lists of footprints to pixels, front to back, a workgroup per tile and a thread per
// pixel. Twin: src/cpu/rasterise.rs and src/cpu/lanes.rs; with IS_CUT src/cpu/cut.rs; with COMPOSITE
// src/cpu/layers.rs.
//
// A frame whose footprints are drawn in several depth chunks comes here once per chunk; pixels and
// the tile's progress are carried from one to the next.

// Which code a frame needs.
override HAS_EXACT: bool = true;
override HAS_NEAR: bool = true;
override HAS_DEPTH: bool = false;
override IS_COUNT: bool = false;
override IS_LINEAR: bool = false;
// Whether opaque surfaces lie among the kernels.
override HAS_SURFACE: bool = false;
// Whether surfaces or clip planes cut them.
override IS_CUT: bool = false;
// How footprints become a picture: one of the COMPOSITE_ constants.
override COMPOSITE: u32 = 0u;
// Whether layers that are open may have to be carried from one dispatch to the next.
override CARRIES: bool = false;
// Entries of a tile's list that one dispatch draws at most.
override SLICE: u32 = 0xffffffffu;

// Of it the band.
@group(0) @binding(0) var<uniform> chunk: ChunkUniform;
@group(0) @binding(1) var<uniform> view: ViewUniform;
// First and one past the last entry of each tile's list; what is drawn is taken off its beginning.
@group(0) @binding(2) var<storage, read_write> tile_ranges: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> tile_lists: array<u32>;
// Four vectors each, as `Footprint` lays them out.
@group(0) @binding(4) var<storage, read> footprints: array<vec4<u32>>;
// Of the footprints on the exact path; of all where they may be cut.
@group(0) @binding(5) var<storage, read> exact: array<ExactTerms>;
@group(0) @binding(6) var<storage, read> near: NearList;
// The band's pixels, row by row: four floats each, then (with depths) one float each. With surfaces
// the same once more: what lies behind them. Where layers are carried, then these: four floats for each
// pixel of each place of the ring, of what a surface divides, and two depths.
@group(0) @binding(7) var<storage, read_write> pixels: array<f32>;
@group(0) @binding(8) var<storage, read_write> progress: array<TileProgress>;
// The surface's pixels as surface.wgsl leaves them: four floats each, then a depth each.
@group(0) @binding(9) var<storage, read> surface: array<f32>;
// Bindings 10 and 11 are of classified.wgsl.

// Footprints on their way to all pixels of the tile, four vectors each: `centre_px` and `form_p`;
// `form_r`, `tau` and `cutoff_squared`; `colour` and `depth`; `path`, `columns`, `rows` and `key`.
var<workgroup> batch: array<vec4<u32>, 4u * TERMINATION_INTERVAL>;
var<workgroup> batch_exact: array<ExactTerms, TERMINATION_INTERVAL>;
var<workgroup> begun: TileBegun;
var<workgroup> open_pixels: atomic<u32>;
var<workgroup> inside_low: atomic<u32>;
var<workgroup> uniform_open: u32;

// Where the footprints of the batch lie: one of the constants below.
var<workgroup> batch_sides: array<u32, TERMINATION_INTERVAL>;
// What the spans of the tile's pixels have in common, as ordered words: least and greatest of where they
// begin, are divided and end.
var<workgroup> span_bounds: array<atomic<u32>, 6>;
// 1 where the surface covers a pixel in part.
var<workgroup> surface_partial: atomic<u32>;
// The first and the last layer that the footprints of the batch reach.
var<workgroup> batch_layers: array<vec2<u32>, TERMINATION_INTERVAL>;
// The most layers that any footprint wanted at once.
var<workgroup> layers_needed: atomic<u32>;

// In front of the surface, behind it where something shows through, behind it where nothing does, or
// maybe cut by it.
const SIDE_FRONT: u32 = 0u;
const SIDE_BEHIND: u32 = 1u;
const SIDE_HIDDEN: u32 = 2u;
const SIDE_CUT: u32 = 3u;

// What a thread adds up of its pixel, in front of the surface or behind it.
struct Pixel {
    colour: vec3<f32>,
    alpha: f32,
    depth: f32,
}

fn load_pixel(first: u32, index: u32, count: u32) -> Pixel {
    let at = first + 4u * index;
    var pixel = Pixel(vec3<f32>(pixels[at], pixels[at + 1u], pixels[at + 2u]), pixels[at + 3u], NO_DEPTH);
    if HAS_DEPTH {
        pixel.depth = pixels[first + 4u * count + index];
    }
    return pixel;
}

fn store_pixel(pixel: Pixel, first: u32, index: u32, count: u32) {
    let at = first + 4u * index;
    pixels[at] = pixel.colour.x;
    pixels[at + 1u] = pixel.colour.y;
    pixels[at + 2u] = pixel.colour.z;
    pixels[at + 3u] = pixel.alpha;
    if HAS_DEPTH {
        pixels[first + 4u * count + index] = pixel.depth;
    }
}

// Puts an opacity behind what a pixel has; counts it, where pixels count kernels.
fn accumulate(pixel: ptr<function, Pixel>, opacity: f32, colour: vec3<f32>, depth: f32) {
    let before = (*pixel).alpha;
    let weight = opacity * (1.0 - before);
    (*pixel).alpha = before + weight;
    if IS_COUNT {
        (*pixel).colour = (*pixel).colour + 1.0;
    } else {
        (*pixel).colour = (*pixel).colour + weight * colour;
    }
    if HAS_DEPTH && before < 0.5 && (*pixel).alpha >= 0.5 {
        (*pixel).depth = depth;
    }
}

// How far a kernel reaches along z on either side of its centre: r sqrt(V_zz).
fn depth_reach(path: u32, place: vec4<f32>, form: vec4<f32>, depth: f32, terms: ExactTerms) -> f32 {
    var slope = vec2<f32>(terms.gradient[0], terms.gradient[1]);
    if path == PATH_EXACT {
        // z* = z (1 + g . d / 2) / w.
        slope = slope * (-0.5 * depth);
    }
    // slopeᵀ S slope = |A⁻ᵀ slope|², A the rows p and r of the form.
    let determinant = place.z * form.y - place.w * form.x;
    let solved = vec2<f32>(form.y * slope.x - form.x * slope.y, place.z * slope.y - place.w * slope.x)
        / determinant;
    let squared = dot2(solved, solved) + terms.depth_sigma * terms.depth_sigma;
    let reach = sqrt(form.w * squared);
    // NaN reaches everywhere.
    return select(LARGEST, reach, is_finite(reach));
}

// The same of a footprint whose numbers the batch has.
fn reach_of(i: u32) -> f32 {
    let path = footprints[4u * i + 3u].x;
    let place = bitcast<vec4<f32>>(footprints[4u * i]);
    let form = bitcast<vec4<f32>>(footprints[4u * i + 1u]);
    let depth = bitcast<f32>(footprints[4u * i + 2u].w);
    if (path & 3u) == PATH_NEAR {
        return place.z;
    }
    if (path & 3u) == PATH_HALF_LINE {
        let half_line = near.terms[path >> 2u];
        var terms: ExactTerms;
        terms.gradient = array<f32, 2>(half_line.half_line[0], half_line.half_line[1]);
        terms.depth_sigma = half_line.sigma;
        return depth_reach(path, place, form, depth, terms);
    }
    return depth_reach(path, place, form, depth, exact[i]);
}

fn span_bound(i: u32) -> f32 {
    return number_of_word(atomicLoad(&span_bounds[i]));
}

// Where a footprint lies.
fn side_of(i: u32) -> u32 {
    if (footprints[4u * i + 3u].x & 2u) != 0u {
        return SIDE_CUT;
    }
    let depth = bitcast<f32>(footprints[4u * i + 2u].w);
    let reach = reach_of(i);
    let first = depth - reach;
    let last = depth + reach;
    if first >= span_bound(5u) || last <= span_bound(0u) {
        return SIDE_HIDDEN;
    }
    if first >= span_bound(1u) && last <= span_bound(2u) {
        return SIDE_FRONT;
    }
    if first >= span_bound(3u) {
        if atomicLoad(&surface_partial) == 0u {
            return SIDE_HIDDEN;
        }
        if last <= span_bound(4u) {
            return SIDE_BEHIND;
        }
    }
    return SIDE_CUT;
}

// Where a layer of slabs begins: depth z.
fn layer_start(layer: u32) -> f32 {
    return view.layer_near + f32(layer) * view.layer_thickness;
}

// The first and the last layer that a footprint reaches.
fn layers_of(i: u32) -> vec2<u32> {
    let first = footprints[4u * i + 3u].w >> view.layer_shift;
    if COMPOSITE != COMPOSITE_SLABS {
        return vec2<u32>(first);
    }
    let depth = bitcast<f32>(footprints[4u * i + 2u].w);
    var reach = reach_of(i);
    if (footprints[4u * i + 3u].x & 2u) == 0u {
        // No farther behind its centre than it begins before that: slopes are rounded.
        reach = min(reach, depth - layer_start(first));
    }
    let end = depth + reach;
    let last = clamp((end - view.layer_near) / view.layer_thickness, 0.0, 2147483520.0);
    return vec2<u32>(first, max(u32(last), first));
}

// What a thread has in the layers that are open: optical depth times colour, and optical depth. Layer n
// lies at n modulo their number.
var<private> ring: array<vec4<f32>, LAYER_SLOTS>;
// Of sheets, which have one place: optical depth times depth.
var<private> ring_depth: f32;
// What lies behind the surface in the layer that it divides.
var<private> divided: vec4<f32>;
var<private> divided_depth: f32;
// How what a layer carries, and its optical depth, change across it: with the pixel's column, its row and
// with z. Where light falls on layers.
struct Slopes {
    carried: vec3<f32>,
    length: vec3<f32>,
}
var<private> ring_slopes: array<Slopes, SLOPE_SLOTS>;
var<private> divided_slopes: Slopes;
var<private> pixel_centre: vec2<f32>;
// The nearest open layer; NO_LAYER where all are closed for good.
var<private> first_layer: u32;
var<private> span: Span;

// What is drawn of a pixel's ray: where it begins, a surface divides it, and it ends; depths z.
struct Span {
    near: f32,
    middle: f32,
    far: f32,
}

// Adds to a layer what lies in front of the surface or wholly behind it, and what is divided.
fn add_to_layer(layer: u32, tau: f32, rest: f32, colour: vec3<f32>, depth: f32) {
    let at = layer % LAYER_SLOTS;
    ring[at] = ring[at] + vec4<f32>(tau * colour, tau);
    if HAS_SURFACE {
        divided = divided + vec4<f32>(rest * colour, rest);
    }
    if HAS_DEPTH && COMPOSITE != COMPOSITE_SLABS {
        ring_depth = ring_depth + tau * depth;
        divided_depth = divided_depth + rest * depth;
    }
}

// How a footprint changes from pixel to pixel.
struct FootprintSlope {
    // Of the logarithm of its optical depth.
    log_tau: vec2<f32>,
    // Of its mean depth.
    mean: vec2<f32>,
}

// Of a footprint at `d` from its centre; nothing of kernels that cross the plane of the eye.
fn footprint_slope(
    path: u32,
    place: vec4<f32>,
    form: vec4<f32>,
    d: vec2<f32>,
    depth: f32,
    terms: ExactTerms,
) -> FootprintSlope {
    if (path & 2u) != 0u {
        return FootprintSlope();
    }
    let p = place.z * d.x + place.w * d.y;
    let r = form.x * d.x + form.y * d.y;
    var log_tau = -(p * place.zw + r * form.xy);
    let gradient = vec2<f32>(terms.gradient[0], terms.gradient[1]);
    var mean = gradient;
    if path == PATH_EXACT {
        let h = terms.hessian;
        let slope = gradient.x * d.x + gradient.y * d.y;
        let w = 1.0 + slope + d.x * (h[0] * d.x + h[1] * d.y) + h[2] * d.y * d.y;
        let w_slope = gradient
            + vec2<f32>(2.0 * h[0] * d.x + h[1] * d.y, h[1] * d.x + 2.0 * h[2] * d.y);
        let q = (p * p + r * r) / w;
        // The length of the ray changes alike for all kernels.
        log_tau = (log_tau + (0.5 * q - 0.5) * w_slope) / w;
        mean = (depth / w) * (0.5 * gradient - (1.0 + 0.5 * slope) / w * w_slope);
    }
    return FootprintSlope(log_tau, mean);
}

// The density of a kernel's place along the ray at a depth; none at the ends of the ray.
fn density_at(depth: f32, mean: f32, per_sigma: f32) -> f32 {
    let ahead = (depth - mean) * per_sigma;
    if abs(depth) >= LARGEST || is_nan(ahead) || !(abs(ahead) <= 7.0) {
        return 0.0;
    }
    return exp_minus_half(ahead * ahead) * (FRAC_1_SQRT_2PI * per_sigma);
}

// How a part of a footprint changes: `tau` of optical depth between two depths, of which `rise` is
// how much it grows where both lie deeper.
fn part_slope(footprint: FootprintSlope, tau: f32, rise: f32) -> vec3<f32> {
    return vec3<f32>(footprint.log_tau * tau - footprint.mean * rise, rise);
}

fn with_slope(slopes: Slopes, slope: vec3<f32>, carried: f32) -> Slopes {
    return Slopes(slopes.carried + carried * slope, slopes.length + slope);
}

// Puts a layer behind what a pixel has.
fn accumulate_layer(
    pixel: ptr<function, Pixel>,
    layer: u32,
    sums: vec4<f32>,
    slopes: Slopes,
    depth_sum: f32,
    from_depth: f32,
    to_depth: f32,
) {
    if !is_positive(sums.w) {
        return;
    }
    let before = (*pixel).alpha;
    let depth = 0.5 * (layer_start(layer) + layer_start(layer + 1u));
    let class_of = classify_layer(sums, slopes, pixel_centre, depth);
    let tau = class_of.w;
    if !is_positive(tau) {
        return;
    }
    let weight = opacity_by(PATH_AFFINE, tau) * (1.0 - before);
    (*pixel).alpha = before + weight;
    if !IS_COUNT {
        (*pixel).colour = (*pixel).colour + (weight / tau) * class_of.xyz;
    }
    if HAS_DEPTH && before < 0.5 && (*pixel).alpha >= 0.5 {
        var at_half = depth_sum / sums.w;
        if COMPOSITE == COMPOSITE_SLABS {
            at_half = depth;
        }
        (*pixel).depth = max(min(max(at_half, 0.0), to_depth), from_depth);
    }
}

// Composites the layers in front of one.
fn close_layers(until: u32, front: ptr<function, Pixel>, behind: ptr<function, Pixel>) {
    let count = min(until - min(first_layer, until), LAYER_SLOTS);
    for (var ahead = 0u; ahead < count; ahead = ahead + 1u) {
        let layer = first_layer + ahead;
        let at = layer % LAYER_SLOTS;
        let sums = ring[at];
        let slopes = ring_slopes[at % SLOPE_SLOTS];
        if COMPOSITE != COMPOSITE_SLABS {
            accumulate_layer(front, layer, sums, slopes, ring_depth, span.near, span.middle);
            if HAS_SURFACE {
                accumulate_layer(
                    behind, layer, divided, divided_slopes, divided_depth, span.middle, span.far,
                );
            }
            divided = vec4<f32>(0.0);
            ring_depth = 0.0;
            divided_depth = 0.0;
        } else if HAS_SURFACE && layer_start(layer) >= span.middle {
            accumulate_layer(behind, layer, sums, slopes, 0.0, span.middle, span.far);
        } else {
            accumulate_layer(front, layer, sums, slopes, 0.0, span.near, span.middle);
            if HAS_SURFACE && span.middle < layer_start(layer + 1u) {
                accumulate_layer(
                    behind, layer, divided, divided_slopes, 0.0, span.middle, span.far,
                );
                divided = vec4<f32>(0.0);
                divided_slopes = Slopes();
            }
        }
        ring[at] = vec4<f32>(0.0);
        ring_slopes[at % SLOPE_SLOTS] = Slopes();
    }
    first_layer = max(first_layer, until);
}

// The place of the layers that are carried of a pixel.
fn carried_at(place: u32, index: u32, count: u32) -> u32 {
    let words = select(4u, 5u, HAS_DEPTH) * select(1u, 2u, HAS_SURFACE);
    return words * count + 4u * (place * count + index);
}

// The same of slopes, which lie behind the others.
fn carried_slopes_at(place: u32, index: u32, count: u32) -> u32 {
    return carried_at(LAYER_SLOTS + 2u, 0u, count) + 6u * (place * count + index);
}

fn load_slopes(at: u32) -> Slopes {
    return Slopes(
        vec3<f32>(pixels[at], pixels[at + 1u], pixels[at + 2u]),
        vec3<f32>(pixels[at + 3u], pixels[at + 4u], pixels[at + 5u]),
    );
}

fn store_slopes(at: u32, slopes: Slopes) {
    for (var i = 0u; i < 3u; i = i + 1u) {
        pixels[at + i] = slopes.carried[i];
        pixels[at + 3u + i] = slopes.length[i];
    }
}

fn load_layers(index: u32, count: u32) {
    for (var k = 0u; k < LAYER_SLOTS + 2u; k = k + 1u) {
        let at = carried_at(k, index, count);
        let four = vec4<f32>(pixels[at], pixels[at + 1u], pixels[at + 2u], pixels[at + 3u]);
        if k < LAYER_SLOTS {
            ring[k] = four;
        } else if k == LAYER_SLOTS {
            divided = four;
        } else {
            ring_depth = four.x;
            divided_depth = four.y;
        }
    }
    if HAS_SLOPES {
        for (var k = 0u; k < SLOPE_SLOTS; k = k + 1u) {
            ring_slopes[k] = load_slopes(carried_slopes_at(k, index, count));
        }
        divided_slopes = load_slopes(carried_slopes_at(SLOPE_SLOTS, index, count));
    }
}

fn store_layers(index: u32, count: u32) {
    for (var k = 0u; k < LAYER_SLOTS + 2u; k = k + 1u) {
        let at = carried_at(k, index, count);
        var four = vec4<f32>(ring_depth, divided_depth, 0.0, 0.0);
        if k < LAYER_SLOTS {
            four = ring[k];
        } else if k == LAYER_SLOTS {
            four = divided;
        }
        pixels[at] = four.x;
        pixels[at + 1u] = four.y;
        pixels[at + 2u] = four.z;
        pixels[at + 3u] = four.w;
    }
    if HAS_SLOPES {
        for (var k = 0u; k < SLOPE_SLOTS; k = k + 1u) {
            store_slopes(carried_slopes_at(k, index, count), ring_slopes[k]);
        }
        store_slopes(carried_slopes_at(SLOPE_SLOTS, index, count), divided_slopes);
    }
}

// Phi of how far a depth lies beyond a mean; the ends of the ray lie beyond all of it.
fn share_up_to(depth: f32, mean: f32, per_sigma: f32) -> f32 {
    if depth >= LARGEST {
        return 1.0;
    }
    if depth <= -LARGEST {
        return 0.0;
    }
    let ahead = (depth - mean) * per_sigma;
    // NaN lies behind.
    return select(0.0, normal_cdf(clamp(ahead, -38.0, 38.0)), !is_nan(ahead));
}

// Optical depth of a footprint on the near or the half-line path at a point of the image, its numbers
// as the batch has them.
fn near_depth(path: u32, place: vec4<f32>, form: vec4<f32>, pixel: vec2<f32>) -> f32 {
    let at = path >> 2u;
    if (path & 3u) == PATH_NEAR {
        return evaluate_near(at, form.z, ray_through(view, pixel), form.w);
    }
    let d = pixel - place.xy;
    let p = place.z * d.x + place.w * d.y;
    let r = form.x * d.x + form.y * d.y;
    let q = p * p + r * r;
    if !is_finite(q) || q > form.w {
        return 0.0;
    }
    let half_line = near.terms[at].half_line;
    let z = half_line[2] + half_line[0] * d.x + half_line[1] * d.y;
    let in_front = normal_cdf(z / max(near.terms[at].sigma, SMALLEST));
    return form.z * exp_minus_half(q) * in_front;
}

// DᵀKD, and its product with the mean depth z*. Twin: src/splat/near.rs.
fn minors_along(at: u32, direction: vec3<f32>) -> vec2<f32> {
    var across = 0.0;
    var along = 0.0;
    for (var i = 0u; i < 10u; i = i + 1u) {
        let m = dot3(direction, vector(near.terms[at].minors[i]));
        across = across + m * m;
        along = along + m * near.terms[at].minor_depths[i];
    }
    return vec2<f32>(across, along);
}

// Optical depth of a kernel along the half line t D, t > 0. Twin: src/splat/near.rs.
fn evaluate_near(at: u32, weight: f32, direction: vec3<f32>, cutoff_squared: f32) -> f32 {
    let sums = minors_along(at, direction);
    let across = sums.x;
    let along = sums.y;
    var miss = 0.0;
    for (var i = 0u; i < 5u; i = i + 1u) {
        let m = dot3(direction, vector(near.terms[at].misses[i]));
        miss = miss + m * m;
    }
    let q = miss / across;
    if !is_finite(q) || q > cutoff_squared {
        return 0.0;
    }
    let root = sqrt(across);
    let behind = along / max(root * near.terms[at].sigma, SMALLEST);
    return weight * sqrt(dot3(direction, direction)) / root * exp_minus_half(q) * normal_cdf(behind);
}

// Of what `near_depth` finds in front of the eye: the share up to the depth `at_depth`. Twins:
// `near_cut` in src/cpu/cut.rs and `near_share` in src/splat/near.rs.
fn near_cut(path: u32, place: vec4<f32>, pixel: vec2<f32>, at_depth: f32) -> f32 {
    if at_depth >= LARGEST {
        return 1.0;
    }
    if at_depth <= -LARGEST {
        return 0.0;
    }
    let at = path >> 2u;
    var mean: f32;
    var per_sigma: f32;
    var surface_at = at_depth;
    let half_line = near.terms[at].half_line;
    if (path & 3u) == PATH_NEAR {
        let direction = ray_through(view, pixel);
        let sums = minors_along(at, direction);
        let across = sums.x;
        let along = sums.y;
        per_sigma = sqrt(across) / max(near.terms[at].sigma, SMALLEST);
        mean = along / across;
        surface_at = at_depth / half_line[0];
    } else {
        let d = pixel - place.xy;
        mean = half_line[2] + half_line[0] * d.x + half_line[1] * d.y;
        per_sigma = 1.0 / max(near.terms[at].sigma, SMALLEST);
    }
    let behind_eye = normal_cdf(-mean * per_sigma);
    let up_to = normal_cdf((surface_at - mean) * per_sigma);
    let share = (up_to - behind_eye) / (1.0 - behind_eye);
    if is_nan(share) {
        return 0.0;
    }
    return clamp(share, 0.0, 1.0);
}

// The opacity of an optical depth, and of splats the opacity itself.
fn opacity_by(path: u32, tau: f32) -> f32 {
    if IS_LINEAR || path == PATH_PEAK {
        return min(tau, 1.0);
    }
    return opacity_of(tau);
}

// Of a kernel's optical depth (of one that crosses the plane of the eye: of what lies in front of that):
// the share up to a depth.
fn place_share(
    is_near: bool,
    path: u32,
    place: vec4<f32>,
    pixel: vec2<f32>,
    depth: f32,
    mean: f32,
    per_sigma: f32,
) -> f32 {
    if is_near {
        return near_cut(path, place, pixel, depth);
    }
    return share_up_to(depth, mean, per_sigma);
}

@compute @workgroup_size(TILE_SIZE, TILE_SIZE)
fn rasterise(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let tile = group_index(group);
    if tile >= chunk.band_size.x * chunk.band_size.y {
        return;
    }
    let own = tile_pixel(tile, thread, chunk, view.size);
    let at = own.at;
    let is_pixel = own.is_pixel;
    let index = own.index;
    let count_of_band = band_pixels(chunk, view.size);
    let first_behind = select(4u, 5u, HAS_DEPTH) * count_of_band;

    if thread == 0u {
        begun = TileBegun(progress[tile], tile_ranges[tile]);
        atomicStore(&inside_low, 0u);
        if IS_CUT {
            for (var i = 0u; i < 6u; i = i + 1u) {
                atomicStore(&span_bounds[i], select(0u, 0xffffffffu, i % 2u == 0u));
            }
            atomicStore(&surface_partial, 0u);
        }
        atomicStore(&layers_needed, progress[tile].layers_needed);
    }
    let uniform_begun = workgroupUniformLoad(&begun);
    let carried = uniform_begun.progress;
    let range = uniform_begun.range;
    var front = Pixel(vec3<f32>(0.0), 0.0, NO_DEPTH);
    var behind = front;
    if is_pixel && carried.drawn > 0u {
        front = load_pixel(0u, index, count_of_band);
        if HAS_SURFACE {
            behind = load_pixel(first_behind, index, count_of_band);
        }
    }
    if COMPOSITE != COMPOSITE_OVER {
        first_layer = select(0u, carried.first_layer, carried.drawn > 0u);
        if CARRIES && is_pixel && carried.drawn > 0u {
            load_layers(index, count_of_band);
        }
    }
    let corner = vec2<f32>(own.origin) + 0.5;
    let pixel = corner + vec2<f32>(own.local);
    pixel_centre = pixel;
    var ray_length = 1.0;
    if HAS_EXACT {
        let direction = ray_through(view, pixel);
        ray_length = sqrt(dot3(direction, direction));
    }
    span = Span(-LARGEST, LARGEST, LARGEST);
    if IS_CUT {
        if is_pixel {
            let clipped = clip_span(view, pixel);
            span = Span(clipped.x, clipped.y, clipped.y);
            if HAS_SURFACE {
                let covered = surface[4u * index + 3u];
                let depth = surface[4u * count_of_band + index];
                if depth != NO_DEPTH {
                    span.middle = min(max(depth, span.near), span.far);
                }
                if covered > 0.0 && covered < 1.0 {
                    atomicStore(&surface_partial, 1u);
                }
            }
            atomicMin(&span_bounds[0], ordered_word(span.near));
            atomicMax(&span_bounds[1], ordered_word(span.near));
            atomicMin(&span_bounds[2], ordered_word(span.middle));
            atomicMax(&span_bounds[3], ordered_word(span.middle));
            atomicMin(&span_bounds[4], ordered_word(span.far));
            atomicMax(&span_bounds[5], ordered_word(span.far));
        }
        workgroupBarrier();
    }
    let opaque = 1.0 - view.tolerance * TERMINATION_SHARE;
    let end = range.x + min(range.y - range.x, SLICE);
    var inside = 0u;
    var drawn = carried.drawn;
    var is_done = carried.hidden != 0u;
    var next = range.x;
    // Batches end where the twin looks whether the tile is opaque.
    while !is_done && next < end {
        if drawn % TERMINATION_INTERVAL == 0u && drawn > 0u {
            if thread == 0u {
                atomicStore(&open_pixels, 0u);
            }
            workgroupBarrier();
            if is_pixel && !(front.alpha >= opaque) {
                atomicStore(&open_pixels, 1u);
            }
            workgroupBarrier();
            if thread == 0u {
                uniform_open = atomicLoad(&open_pixels);
            }
            is_done = workgroupUniformLoad(&uniform_open) == 0u;
            if is_done {
                break;
            }
        }
        let count = min(TERMINATION_INTERVAL - drawn % TERMINATION_INTERVAL, end - next);
        workgroupBarrier();
        // Neighbours read neighbouring vectors.
        if thread < 4u * count {
            let i = tile_lists[next + thread / 4u];
            batch[thread] = footprints[4u * i + thread % 4u];
        }
        if thread < count {
            let i = tile_lists[next + thread];
            if HAS_EXACT || IS_CUT || COMPOSITE == COMPOSITE_SLABS {
                batch_exact[thread] = exact[i];
            }
            if IS_CUT {
                batch_sides[thread] = side_of(i);
            }
            if COMPOSITE != COMPOSITE_OVER {
                let reached = layers_of(i);
                batch_layers[thread] = reached;
                if !IS_CUT || batch_sides[thread] != SIDE_HIDDEN {
                    let from_layer = max(reached.x, first_layer);
                    atomicMax(&layers_needed, max(reached.y, from_layer) - from_layer + 1u);
                }
            }
        }
        workgroupBarrier();
        for (var n = 0u; n < count; n = n + 1u) {
            if COMPOSITE != COMPOSITE_OVER && batch_layers[n].x > first_layer {
                close_layers(batch_layers[n].x, &front, &behind);
            }
            // Most threads need no more of it than its range.
            let columns = batch[4u * n + 3u].y;
            let rows = batch[4u * n + 3u].z;
            if !is_pixel || at.y < (rows & 0xffffu) || at.y >= (rows >> 16u)
                || at.x < (columns & 0xffffu) || at.x >= (columns >> 16u) {
                continue;
            }
            var side = SIDE_FRONT;
            if IS_CUT {
                side = batch_sides[n];
                if side == SIDE_HIDDEN {
                    continue;
                }
            }
            let path = batch[4u * n + 3u].x;
            let place = bitcast<vec4<f32>>(batch[4u * n]);
            let form = bitcast<vec4<f32>>(batch[4u * n + 1u]);
            let light = bitcast<vec4<f32>>(batch[4u * n + 2u]);
            let peak = form.z;
            let cutoff_squared = form.w;
            let is_near = HAS_NEAR && (path & 2u) != 0u;
            // Whether it matters where along the ray the kernel lies.
            let has_place = (IS_CUT && side == SIDE_CUT) || COMPOSITE == COMPOSITE_SLABS
                || (IS_CUT && COMPOSITE != COMPOSITE_OVER && side != SIDE_FRONT);
            var tau = peak;
            // Mean and one over the standard deviation of z.
            var mean = light.w;
            var per_sigma = 0.0;
            if is_near {
                tau = near_depth(path, place, form, pixel);
                if !is_positive(tau) {
                    continue;
                }
            } else {
                // As the twin walks a row: from the tile's first pixel.
                let dx = (corner.x - place.x) + f32(own.local.x);
                let dy = (corner.y - place.y) + f32(own.local.y);
                let p = place.z * dx + place.w * dy;
                let r = form.x * dx + form.y * dy;
                var q = p * p + r * r;
                if has_place {
                    let terms = batch_exact[n];
                    let hessian = terms.hessian;
                    let slope = terms.gradient[0] * dx + terms.gradient[1] * dy;
                    per_sigma = 1.0 / max(terms.depth_sigma, SMALLEST);
                    mean = light.w + slope;
                    if path == PATH_EXACT {
                        let w = 1.0 + slope + dx * (hessian[0] * dx + hessian[1] * dy)
                            + hessian[2] * dy * dy;
                        if is_nan(w) || !(w > 0.0) {
                            continue;
                        }
                        let root = sqrt(w);
                        q = q / w;
                        tau = tau * (ray_length / root);
                        per_sigma = per_sigma * root;
                        mean = light.w * (1.0 + 0.5 * slope) / w;
                    }
                } else if HAS_EXACT && path == PATH_EXACT {
                    let gradient = batch_exact[n].gradient;
                    let hessian = batch_exact[n].hessian;
                    let w_row = dy * (dy * hessian[2] + gradient[1]) + 1.0;
                    let w_slope = dy * hessian[1] + gradient[0];
                    let w = dx * (dx * hessian[0] + w_slope) + w_row;
                    // NaN is outside, here and below.
                    if is_nan(w) || !(w > 0.0) {
                        continue;
                    }
                    let inverse = 1.0 / w;
                    q = q * inverse;
                    tau = tau * (ray_length * sqrt(inverse));
                }
                if !is_finite(q) || q > cutoff_squared {
                    continue;
                }
                // A compiler that assumes numbers may drop the guard: then the pixel stays finite.
                tau = tau * exp_minus_half(min(q, 49.0));
            }
            inside = inside + 1u;
            if COMPOSITE != COMPOSITE_OVER {
                if IS_COUNT {
                    front.colour = front.colour + 1.0;
                }
                let reached = vec2<u32>(max(batch_layers[n].x, first_layer), batch_layers[n].y);
                if COMPOSITE == COMPOSITE_SLABS {
                    // More than there are places: this frame is drawn again.
                    let last = min(max(reached.x, reached.y), reached.x + LAYER_SLOTS - 1u);
                    let is_whole = !IS_CUT || side == SIDE_FRONT;
                    var drawn_span = span;
                    if is_whole {
                        drawn_span = Span(-LARGEST, LARGEST, LARGEST);
                    }
                    var divide_at = 1.0;
                    if !is_whole {
                        divide_at = place_share(is_near, path, place, pixel, drawn_span.middle, mean, per_sigma);
                    }
                    var below = 0.0;
                    if drawn_span.near > -LARGEST {
                        below = place_share(is_near, path, place, pixel, drawn_span.near, mean, per_sigma);
                    }
                    var begin = drawn_span.near;
                    var slope: FootprintSlope;
                    if HAS_SLOPES {
                        let d = (corner - place.xy) + vec2<f32>(own.local);
                        slope = footprint_slope(path, place, form, d, light.w, batch_exact[n]);
                    }
                    for (var layer = reached.x; layer <= last; layer = layer + 1u) {
                        var end = LARGEST;
                        if layer < last {
                            end = layer_start(layer + 1u);
                        }
                        end = min(max(end, drawn_span.near), drawn_span.far);
                        let above = max(
                            place_share(is_near, path, place, pixel, end, mean, per_sigma),
                            below,
                        );
                        // A layer behind the surface is all behind it.
                        var divide = above;
                        if layer_start(layer) < drawn_span.middle {
                            divide = max(min(divide_at, above), below);
                        }
                        add_to_layer(
                            layer,
                            tau * (divide - below),
                            tau * (above - divide),
                            light.xyz,
                            light.w,
                        );
                        if HAS_SLOPES {
                            var divide_depth = end;
                            if layer_start(layer) < drawn_span.middle {
                                divide_depth = max(min(drawn_span.middle, end), begin);
                            }
                            let at_begin = density_at(begin, mean, per_sigma);
                            let at_divide = density_at(divide_depth, mean, per_sigma);
                            let at_end = density_at(end, mean, per_sigma);
                            let own_slope =
                                part_slope(slope, tau * (divide - below), tau * (at_divide - at_begin));
                            let rest_slope =
                                part_slope(slope, tau * (above - divide), tau * (at_end - at_divide));
                            let at_slot = layer % SLOPE_SLOTS;
                            ring_slopes[at_slot] =
                                with_slope(ring_slopes[at_slot], own_slope, light.x);
                            if HAS_SURFACE {
                                divided_slopes = with_slope(divided_slopes, rest_slope, light.x);
                            }
                        }
                        begin = end;
                        below = above;
                    }
                    continue;
                }
                var own_part = 1.0;
                var rest = 0.0;
                if has_place {
                    let begin = place_share(is_near, path, place, pixel, span.near, mean, per_sigma);
                    let middle = place_share(is_near, path, place, pixel, span.middle, mean, per_sigma);
                    let end = place_share(is_near, path, place, pixel, span.far, mean, per_sigma);
                    own_part = max(middle - begin, 0.0);
                    rest = max(end - middle, 0.0);
                }
                add_to_layer(reached.x, tau * own_part, tau * rest, light.xyz, light.w);
                continue;
            }
            var depth = light.w;
            if side == SIDE_CUT || is_near {
                // Within a kernel that holds the eye, the centre may lie behind.
                depth = max(depth, 0.0);
            }
            if IS_CUT && side == SIDE_CUT {
                var begin: f32;
                var middle: f32;
                var end: f32;
                if path == PATH_PEAK {
                    // A splat that states its opacity is not divided: it lies where its centre does.
                    begin = f32(mean < span.near);
                    middle = f32(mean < span.middle);
                    end = f32(mean < span.far);
                } else {
                    begin = place_share(is_near, path, place, pixel, span.near, mean, per_sigma);
                    middle = place_share(is_near, path, place, pixel, span.middle, mean, per_sigma);
                    end = place_share(is_near, path, place, pixel, span.far, mean, per_sigma);
                }
                let in_front = tau * max(middle - begin, 0.0);
                let at_front = max(min(depth, span.middle), span.near);
                accumulate(&front, opacity_by(path, in_front), light.xyz, at_front);
                if HAS_SURFACE && !IS_COUNT && atomicLoad(&surface_partial) != 0u {
                    let rest = opacity_by(path, tau * max(end - middle, 0.0));
                    let at_behind = max(min(depth, span.far), span.middle);
                    accumulate(&behind, rest, light.xyz, at_behind);
                }
                continue;
            }
            var opacity: f32;
            if !IS_LINEAR && path == PATH_AFFINE && peak <= FAINT {
                opacity = tau * (1.0 - 0.5 * tau * (1.0 - tau * (1.0 / 3.0)));
            } else {
                opacity = opacity_by(path, tau);
            }
            if HAS_SURFACE && side == SIDE_BEHIND {
                accumulate(&behind, opacity, light.xyz, depth);
            } else {
                accumulate(&front, opacity, light.xyz, depth);
            }
        }
        drawn = drawn + count;
        next = next + count;
    }

    let is_end = chunk.is_last != 0u && (is_done || end == range.y);
    if COMPOSITE != COMPOSITE_OVER {
        if is_end {
            close_layers(NO_LAYER, &front, &behind);
        } else if CARRIES && is_pixel {
            store_layers(index, count_of_band);
        }
    }
    if is_pixel {
        store_pixel(front, 0u, index, count_of_band);
        if HAS_SURFACE {
            store_pixel(behind, first_behind, index, count_of_band);
        }
    }
    // Of fewer footprints than overflow this sum (chunk_limit of src/gpu/pass.rs).
    atomicAdd(&inside_low, inside);
    workgroupBarrier();
    if thread == 0u {
        let added = atomicLoad(&inside_low);
        let low = carried.splat_pixels.x + added;
        let high = carried.splat_pixels.y + select(0u, 1u, low < added);
        tile_ranges[tile].x = end;
        let needed = atomicLoad(&layers_needed);
        progress[tile] =
            TileProgress(drawn, u32(is_done), vec2<u32>(low, high), first_layer, needed);
    }
}
