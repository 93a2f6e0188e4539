// Stage: from lists of footprints to pixels, front to back, a workgroup per tile and a thread per
// pixel. Twin: src/cpu/rasterise.rs and src/cpu/lanes.rs; with HAS_SURFACE src/cpu/hybrid.rs.
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
// Of the footprints on the exact path; of all where surfaces may cut them.
@group(0) @binding(5) var<storage, read> exact: array<ExactTerms>;
@group(0) @binding(6) var<storage, read> near: NearList;
// The band's pixels, row by row: four floats each, then (with depths) one float each. With surfaces
// the same once more: what lies behind them.
@group(0) @binding(7) var<storage, read_write> pixels: array<f32>;
@group(0) @binding(8) var<storage, read_write> progress: array<TileProgress>;
// The surface's pixels as surface.wgsl leaves them: four floats each, then a depth each.
@group(0) @binding(9) var<storage, read> surface: array<f32>;

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
// Least and greatest depth of the tile's surface as ordered words, and 1 where it covers a pixel in
// part.
var<workgroup> surface_nearest: atomic<u32>;
var<workgroup> surface_farthest: atomic<u32>;
var<workgroup> surface_partial: atomic<u32>;

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

// Where a footprint lies, its numbers as the batch has them.
fn side_of(i: u32) -> u32 {
    let nearest = atomicLoad(&surface_nearest);
    if nearest == 0xffffffffu {
        return SIDE_FRONT;
    }
    let path = footprints[4u * i + 3u].x;
    if (path & 2u) != 0u {
        return SIDE_CUT;
    }
    let place = bitcast<vec4<f32>>(footprints[4u * i]);
    let form = bitcast<vec4<f32>>(footprints[4u * i + 1u]);
    let depth = bitcast<f32>(footprints[4u * i + 2u].w);
    let reach = depth_reach(path, place, form, depth, exact[i]);
    if depth + reach <= number_of_word(nearest) {
        return SIDE_FRONT;
    }
    if depth - reach >= number_of_word(atomicLoad(&surface_farthest)) {
        return select(SIDE_HIDDEN, SIDE_BEHIND, atomicLoad(&surface_partial) != 0u);
    }
    return SIDE_CUT;
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
// `near_cut` in src/cpu/hybrid.rs and `near_share` in src/splat/near.rs.
fn near_cut(path: u32, place: vec4<f32>, pixel: vec2<f32>, at_depth: f32) -> f32 {
    if at_depth == NO_DEPTH {
        return 1.0;
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
        if HAS_SURFACE {
            atomicStore(&surface_nearest, 0xffffffffu);
            atomicStore(&surface_farthest, 0u);
            atomicStore(&surface_partial, 0u);
        }
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
    var surface_depth = NO_DEPTH;
    if HAS_SURFACE {
        if is_pixel {
            let covered = surface[4u * index + 3u];
            surface_depth = surface[4u * count_of_band + index];
            if surface_depth == NO_DEPTH {
                // Nothing lies behind where there is none.
                atomicMax(&surface_farthest, ordered_word(LARGEST));
            } else {
                atomicMin(&surface_nearest, ordered_word(surface_depth));
                atomicMax(&surface_farthest, ordered_word(surface_depth));
            }
            if covered > 0.0 && covered < 1.0 {
                atomicStore(&surface_partial, 1u);
            }
        }
        workgroupBarrier();
    }

    let corner = vec2<f32>(own.origin) + 0.5;
    let pixel = corner + vec2<f32>(own.local);
    var ray_length = 1.0;
    if HAS_EXACT {
        let direction = ray_through(view, pixel);
        ray_length = sqrt(dot3(direction, direction));
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
        if (HAS_EXACT || HAS_SURFACE) && thread < count {
            let i = tile_lists[next + thread];
            batch_exact[thread] = exact[i];
            if HAS_SURFACE {
                batch_sides[thread] = side_of(i);
            }
        }
        workgroupBarrier();
        for (var n = 0u; n < count; n = n + 1u) {
            // Most threads need no more of it than its range.
            let columns = batch[4u * n + 3u].y;
            let rows = batch[4u * n + 3u].z;
            if !is_pixel || at.y < (rows & 0xffffu) || at.y >= (rows >> 16u)
                || at.x < (columns & 0xffffu) || at.x >= (columns >> 16u) {
                continue;
            }
            var side = SIDE_FRONT;
            if HAS_SURFACE {
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
            var tau = peak;
            // Of what is cut: the share in front of the surface.
            var share = 1.0;
            if HAS_NEAR && (path & 2u) != 0u {
                tau = near_depth(path, place, form, pixel);
                if !is_positive(tau) {
                    continue;
                }
                if side == SIDE_CUT {
                    share = near_cut(path, place, pixel, surface_depth);
                }
            } else {
                // As the twin walks a row: from the tile's first pixel.
                let dx = (corner.x - place.x) + f32(own.local.x);
                let dy = (corner.y - place.y) + f32(own.local.y);
                let p = place.z * dx + place.w * dy;
                let r = form.x * dx + form.y * dy;
                var q = p * p + r * r;
                // How far in front of the surface the kernel's mean lies, in its standard deviations.
                var ahead = 0.0;
                if HAS_SURFACE && side == SIDE_CUT {
                    let terms = batch_exact[n];
                    let hessian = terms.hessian;
                    let slope = terms.gradient[0] * dx + terms.gradient[1] * dy;
                    var per_sigma = 1.0 / max(terms.depth_sigma, SMALLEST);
                    var z = light.w + slope;
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
                        z = light.w * (1.0 + 0.5 * slope) / w;
                    }
                    ahead = (surface_depth - z) * per_sigma;
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
                if HAS_SURFACE && side == SIDE_CUT && surface_depth != NO_DEPTH {
                    share = select(0.0, 1.0, !is_nan(ahead) && ahead > 0.0);
                    // A splat that states its opacity is not divided: it lies where its centre does.
                    if path != PATH_PEAK && !is_nan(ahead) && abs(ahead) < ONE_SIDED {
                        share = normal_cdf(ahead);
                    }
                }
            }
            inside = inside + 1u;
            var depth = light.w;
            if side == SIDE_CUT || (path & 2u) != 0u {
                // Within a kernel that holds the eye, the centre may lie behind.
                depth = max(depth, 0.0);
            }
            if HAS_SURFACE && side == SIDE_CUT {
                accumulate(&front, opacity_by(path, tau * share), light.xyz, depth);
                if !IS_COUNT && atomicLoad(&surface_partial) != 0u {
                    let rest = opacity_by(path, tau * (1.0 - share));
                    accumulate(&behind, rest, light.xyz, depth);
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
        progress[tile] = TileProgress(drawn, u32(is_done), vec2<u32>(low, high));
    }
}
