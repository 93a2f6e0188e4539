// Stage: from lists of footprints to pixels, front to back, a workgroup per tile and a thread per
// pixel. Twin: src/cpu/rasterise.rs and src/cpu/lanes.rs.
//
// A frame whose footprints are drawn in several depth chunks comes here once per chunk; pixels and
// the tile's progress are carried from one to the next.

struct TileProgress {
    // Footprints drawn so far; none before a frame's first chunk, whatever the pixels hold.
    drawn: u32,
    // 1 where every pixel is opaque.
    is_done: u32,
    // Kernels evaluated within their cut-off, low and high word.
    splat_pixels: vec2<u32>,
}

struct NearList {
    count: u32,
    terms: array<NearTerms>,
}

// Which code a frame needs.
override HAS_EXACT: bool = true;
override HAS_NEAR: bool = true;
override HAS_DEPTH: bool = false;
override IS_COUNT: bool = false;
override IS_LINEAR: bool = false;
// Entries of a tile's list that one dispatch draws at most.
override SLICE: u32 = 0xffffffffu;

// Of it the band.
@group(0) @binding(0) var<uniform> chunk: ChunkUniform;
@group(0) @binding(1) var<storage, read> view: ViewUniform;
// First and one past the last entry of each tile's list; what is drawn is taken off its beginning.
@group(0) @binding(2) var<storage, read_write> tile_ranges: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> tile_lists: array<u32>;
// Four vectors each, as `Footprint` lays them out.
@group(0) @binding(4) var<storage, read> footprints: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> exact: array<ExactTerms>;
@group(0) @binding(6) var<storage, read> near: NearList;
// The band's pixels, row by row: four floats each, then (with depths) one float each, negative
// where there is no depth.
@group(0) @binding(7) var<storage, read_write> pixels: array<f32>;
@group(0) @binding(8) var<storage, read_write> progress: array<TileProgress>;

// Footprints on their way to all pixels of the tile, four vectors each: `centre_px` and `form_p`;
// `form_r`, `tau` and `cutoff_squared`; `colour` and `depth`; `path`, `columns`, `rows` and `key`.
var<workgroup> batch: array<vec4<u32>, 4u * TERMINATION_INTERVAL>;
var<workgroup> batch_exact: array<ExactTerms, TERMINATION_INTERVAL>;
var<workgroup> begun: TileBegun;
var<workgroup> open_pixels: atomic<u32>;
var<workgroup> inside_low: atomic<u32>;
var<workgroup> uniform_open: u32;

// What all threads of a tile begin with.
struct TileBegun {
    progress: TileProgress,
    range: vec2<u32>,
}

// The ray D = (X, Y, 1) through a point of the image.
fn ray(pixel: vec2<f32>) -> vec3<f32> {
    return vec3<f32>((pixel - view.centre_px) / view.focal_px, 1.0);
}

// Optical depth of a footprint on the near or the half-line path at a point of the image, its numbers
// as the batch has them.
fn near_depth(path: u32, place: vec4<f32>, form: vec4<f32>, pixel: vec2<f32>) -> f32 {
    let at = path >> 2u;
    if (path & 3u) == PATH_NEAR {
        return evaluate_near(at, form.z, ray(pixel), form.w);
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

// Optical depth of a kernel along the half line t D, t > 0. Twin: src/splat/near.rs.
fn evaluate_near(at: u32, weight: f32, direction: vec3<f32>, cutoff_squared: f32) -> f32 {
    var across = 0.0;
    var along = 0.0;
    for (var i = 0u; i < 10u; i = i + 1u) {
        let m = dot3(direction, vector(near.terms[at].minors[i]));
        across = across + m * m;
        along = along + m * near.terms[at].minor_depths[i];
    }
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

@compute @workgroup_size(TILE_SIZE, TILE_SIZE)
fn rasterise(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let tile = group_index(group);
    let band_size = chunk.band_size;
    if tile >= band_size.x * band_size.y {
        return;
    }
    let in_band = vec2<u32>(tile % band_size.x, tile / band_size.x);
    let origin = (chunk.band_first + in_band) * TILE_SIZE;
    // Each 32 threads, which many devices run as one, have 8 x 4 pixels: a small footprint misses
    // more of such blocks than of rows.
    let block = vec2<u32>(thread / 32u % 2u, thread / 64u) * vec2<u32>(8u, 4u);
    let local = block + vec2<u32>(thread % 8u, thread / 8u % 4u);
    let at = origin + local;
    let is_pixel = at.x < view.size.x && at.y < view.size.y;
    let width = view.size.x;
    // A band is as wide as the image.
    let band_top = chunk.band_first.y * TILE_SIZE;
    let band_height = min(band_size.y * TILE_SIZE, view.size.y - band_top);
    let index = (at.y - band_top) * width + at.x;
    let depth_index = 4u * width * band_height + index;

    if thread == 0u {
        begun = TileBegun(progress[tile], tile_ranges[tile]);
        atomicStore(&inside_low, 0u);
    }
    let uniform_begun = workgroupUniformLoad(&begun);
    let carried = uniform_begun.progress;
    let range = uniform_begun.range;
    var colour = vec3<f32>(0.0);
    var alpha = 0.0;
    // None: WGSL has no infinity to write down.
    var depth = -1.0;
    if is_pixel && carried.drawn > 0u {
        colour = vec3<f32>(pixels[4u * index], pixels[4u * index + 1u], pixels[4u * index + 2u]);
        alpha = pixels[4u * index + 3u];
        if HAS_DEPTH {
            depth = pixels[depth_index];
        }
    }

    let corner = vec2<f32>(origin) + 0.5;
    let pixel = corner + vec2<f32>(local);
    var ray_length = 1.0;
    if HAS_EXACT {
        let direction = ray(pixel);
        ray_length = sqrt(dot3(direction, direction));
    }
    let opaque = 1.0 - view.tolerance * TERMINATION_SHARE;
    let end = range.x + min(range.y - range.x, SLICE);
    var inside = 0u;
    var drawn = carried.drawn;
    var is_done = carried.is_done != 0u;
    var next = range.x;
    // Batches end where the twin looks whether the tile is opaque.
    while !is_done && next < end {
        if drawn % TERMINATION_INTERVAL == 0u && drawn > 0u {
            if thread == 0u {
                atomicStore(&open_pixels, 0u);
            }
            workgroupBarrier();
            if is_pixel && !(alpha >= opaque) {
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
        if HAS_EXACT && thread < count {
            batch_exact[thread] = exact[tile_lists[next + thread]];
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
            let path = batch[4u * n + 3u].x;
            let place = bitcast<vec4<f32>>(batch[4u * n]);
            let form = bitcast<vec4<f32>>(batch[4u * n + 1u]);
            let peak = form.z;
            let cutoff_squared = form.w;
            var tau = peak;
            if HAS_NEAR && (path & 2u) != 0u {
                tau = near_depth(path, place, form, pixel);
                if !is_positive(tau) {
                    continue;
                }
            } else {
                // As the twin walks a row: from the tile's first pixel.
                let dx = (corner.x - place.x) + f32(local.x);
                let dy = (corner.y - place.y) + f32(local.y);
                let p = place.z * dx + place.w * dy;
                let r = form.x * dx + form.y * dy;
                var q = p * p + r * r;
                if HAS_EXACT && path == PATH_EXACT {
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
            var opacity: f32;
            if IS_LINEAR || path == PATH_PEAK {
                opacity = min(tau, 1.0);
            } else if path == PATH_AFFINE && peak <= FAINT {
                opacity = tau * (1.0 - 0.5 * tau * (1.0 - tau * (1.0 / 3.0)));
            } else {
                opacity = opacity_of(tau);
            }
            let before = alpha;
            let weight = opacity * (1.0 - before);
            alpha = before + weight;
            let light = bitcast<vec4<f32>>(batch[4u * n + 2u]);
            if IS_COUNT {
                colour = colour + 1.0;
            } else {
                colour = colour + weight * light.xyz;
            }
            if HAS_DEPTH && before < 0.5 && alpha >= 0.5 {
                // Within a kernel that holds the eye, the centre may lie behind.
                depth = light.w;
                if (path & 2u) != 0u {
                    depth = max(depth, 0.0);
                }
            }
        }
        drawn = drawn + count;
        next = next + count;
    }

    if is_pixel {
        pixels[4u * index] = colour.x;
        pixels[4u * index + 1u] = colour.y;
        pixels[4u * index + 2u] = colour.z;
        pixels[4u * index + 3u] = alpha;
        if HAS_DEPTH {
            pixels[depth_index] = depth;
        }
    }
    // Of fewer footprints than overflow this sum (chunk_limit of src/gpu/frame.rs).
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
