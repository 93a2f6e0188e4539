// Stage: from lists of surfels of opaque surfaces to pixels: colour, coverage, depth and, where asked
// for, normals; a workgroup per tile and a thread per pixel. Twin: src/cpu/surface.rs.
//
// A frame whose surfels are drawn in several depth chunks comes here once per chunk; layers and the
// tile's progress are carried from one to the next.

// Which code a frame needs.
override HAS_NEAR: bool = true;
override HAS_NORMALS: bool = false;
// Whether planes clip.
override IS_CUT: bool = false;
override IS_COUNT: bool = false;
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
@group(0) @binding(5) var<storage, read> terms: array<SurfelTerms>;
@group(0) @binding(6) var<storage, read> near: NearList;
// The layers of the band's pixels, one float of all pixels after the other: those of the first layer,
// of the second ...; then (where pixels count surfels) the counts.
@group(0) @binding(7) var<storage, read_write> layers: array<f32>;
@group(0) @binding(8) var<storage, read_write> progress: array<TileProgress>;

// Footprints on their way to all pixels of the tile, as in rasterise.wgsl.
var<workgroup> batch: array<vec4<u32>, 4u * TERMINATION_INTERVAL>;
var<workgroup> batch_terms: array<SurfelTerms, TERMINATION_INTERVAL>;
var<workgroup> batch_normals: array<vec3<f32>, TERMINATION_INTERVAL>;
var<workgroup> begun: TileBegun;
var<workgroup> inside_low: atomic<u32>;
// The least nearness of the front layers as an ordered word; 0 where they leave a pixel open.
var<workgroup> farthest: atomic<u32>;

// Sums over the surfels of one layer of a pixel.
struct Layer {
    // Weights: what the surfels cover.
    weight: f32,
    // Weight times nearness.
    nearness: f32,
    // Weight times linear colour.
    colour: vec3<f32>,
    // Weight times the unit normal, camera space; zero unless asked for.
    normal: vec3<f32>,
}

// What a surfel shows at a pixel.
struct Fragment {
    weight: f32,
    nearness: f32,
    slack: f32,
    colour: vec3<f32>,
    normal: vec3<f32>,
}

fn added(layer: Layer, fragment: Fragment) -> Layer {
    let w = fragment.weight;
    return Layer(
        layer.weight + w,
        layer.nearness + w * fragment.nearness,
        layer.colour + w * fragment.colour,
        layer.normal + w * fragment.normal,
    );
}

// Floats of a layer.
fn layer_words() -> u32 {
    return select(5u, 8u, HAS_NORMALS);
}

fn load_layer(k: u32, index: u32, count: u32) -> Layer {
    let first = k * layer_words() * count + index;
    var layer = Layer(
        layers[first],
        layers[first + count],
        vec3<f32>(layers[first + 2u * count], layers[first + 3u * count], layers[first + 4u * count]),
        vec3<f32>(0.0),
    );
    if HAS_NORMALS {
        layer.normal = vec3<f32>(
            layers[first + 5u * count],
            layers[first + 6u * count],
            layers[first + 7u * count],
        );
    }
    return layer;
}

fn store_layer(layer: Layer, k: u32, index: u32, count: u32) {
    let first = k * layer_words() * count + index;
    layers[first] = layer.weight;
    layers[first + count] = layer.nearness;
    layers[first + 2u * count] = layer.colour.x;
    layers[first + 3u * count] = layer.colour.y;
    layers[first + 4u * count] = layer.colour.z;
    if HAS_NORMALS {
        layers[first + 5u * count] = layer.normal.x;
        layers[first + 6u * count] = layer.normal.y;
        layers[first + 7u * count] = layer.normal.z;
    }
}

// The layers of a pixel, front to back. The code below counts on their number: an index that is no
// constant would move them out of registers.
const_assert SURFACE_LAYERS == 3u;
alias Window = array<Layer, SURFACE_LAYERS>;

const JOINS: u32 = 0u;
const AHEAD: u32 = 1u;
const BEHIND: u32 = 2u;

// Where a fragment lies beside a layer.
fn place_of(fragment: Fragment, layer: Layer) -> u32 {
    let ahead = fragment.nearness * layer.weight - layer.nearness;
    if is_nan(ahead) {
        return BEHIND;
    }
    if abs(ahead) <= fragment.slack * layer.weight {
        return JOINS;
    }
    return select(BEHIND, AHEAD, ahead > 0.0);
}

// Two layers as one.
fn merged(a: Layer, b: Layer) -> Layer {
    var out = a;
    out.weight = a.weight + b.weight;
    out.nearness = a.nearness + b.nearness;
    out.colour = a.colour + b.colour;
    out.normal = a.normal + b.normal;
    return out;
}

// Adds a fragment to the layers of a pixel. In front of a layer: those behind move on, the last two
// become one. Whatever is behind the others joins the last: what covers is never lost.
fn insert(window: ptr<function, Window>, fragment: Fragment) {
    if is_nan(fragment.nearness) {
        return;
    }
    var alone: Layer;
    alone = added(alone, fragment);
    var place = place_of(fragment, (*window)[0]);
    if place == JOINS {
        (*window)[0] = added((*window)[0], fragment);
        return;
    }
    if place == AHEAD {
        (*window)[2] = merged((*window)[1], (*window)[2]);
        (*window)[1] = (*window)[0];
        (*window)[0] = alone;
        return;
    }
    var covered = (*window)[0].weight;
    if covered >= COVERAGE_FULL {
        return;
    }
    place = place_of(fragment, (*window)[1]);
    if place == JOINS {
        (*window)[1] = added((*window)[1], fragment);
        return;
    }
    if place == AHEAD {
        (*window)[2] = merged((*window)[1], (*window)[2]);
        (*window)[1] = alone;
        return;
    }
    covered = covered + (*window)[1].weight;
    if covered >= COVERAGE_FULL {
        return;
    }
    (*window)[2] = added((*window)[2], fragment);
}

@compute @workgroup_size(TILE_SIZE, TILE_SIZE)
fn rasterise_surface(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let tile = group_index(group);
    if tile >= chunk.band_size.x * chunk.band_size.y {
        return;
    }
    let own = tile_pixel(tile, thread, chunk, view.size);
    let at = own.at;
    let count_of_band = band_pixels(chunk, view.size);
    let count_index = SURFACE_LAYERS * layer_words() * count_of_band + own.index;

    if thread == 0u {
        begun = TileBegun(progress[tile], tile_ranges[tile]);
        atomicStore(&inside_low, 0u);
    }
    let uniform_begun = workgroupUniformLoad(&begun);
    let carried = uniform_begun.progress;
    let range = uniform_begun.range;
    var window: Window;
    var counted = 0.0;
    if own.is_pixel && carried.drawn > 0u {
        window[0] = load_layer(0u, own.index, count_of_band);
        window[1] = load_layer(1u, own.index, count_of_band);
        window[2] = load_layer(2u, own.index, count_of_band);
        if IS_COUNT {
            counted = layers[count_index];
        }
    }

    let corner = vec2<f32>(own.origin) + 0.5;
    let pixel = corner + vec2<f32>(own.local);
    let direction = ray_through(view, pixel);
    let end = range.x + min(range.y - range.x, SLICE);
    var inside = 0u;
    var drawn = carried.drawn;
    // Behind the tile's front layers, once all of it is covered: an ordered word.
    var behind = carried.hidden;
    var next = range.x;
    // Batches end where the twin looks what is hidden.
    while next < end {
        if drawn % TERMINATION_INTERVAL == 0u && drawn > 0u {
            if thread == 0u {
                atomicStore(&farthest, 0xffffffffu);
            }
            workgroupBarrier();
            if own.is_pixel {
                let front = window[0];
                let nearness = front.nearness / front.weight;
                if front.weight < COVERAGE_FULL {
                    atomicStore(&farthest, 0u);
                } else if !is_nan(nearness) {
                    atomicMin(&farthest, ordered_word(nearness));
                }
            }
            workgroupBarrier();
            behind = atomicLoad(&farthest);
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
            batch_terms[thread] = terms[i];
            if HAS_NORMALS {
                batch_normals[thread] = unpack_normal(terms[i].normal);
            }
        }
        workgroupBarrier();
        for (var n = 0u; n < count; n = n + 1u) {
            // Most threads need no more of it than its range.
            let columns = batch[4u * n + 3u].y;
            let rows = batch[4u * n + 3u].z;
            if !own.is_pixel || at.y < (rows & 0xffffu) || at.y >= (rows >> 16u)
                || at.x < (columns & 0xffffu) || at.x >= (columns >> 16u) {
                continue;
            }
            let light = bitcast<vec4<f32>>(batch[4u * n + 2u]);
            if behind > 0u && light.w < number_of_word(behind) {
                continue;
            }
            let path = batch[4u * n + 3u].x;
            let place = bitcast<vec4<f32>>(batch[4u * n]);
            let form = bitcast<vec4<f32>>(batch[4u * n + 1u]);
            let cutoff_squared = form.w;
            var fragment: Fragment;
            var q: f32;
            // Change of the nearness per pixel; what of the surfel the pixel shows, as ClipEdges of the
            // twin says.
            var gradient: vec2<f32>;
            var shown = vec3<f32>(1.0, 0.0, 1.0);
            var shown_at = pixel;
            if (path & 15u) == PATH_NEAR_SURFEL {
                if !HAS_NEAR {
                    continue;
                }
                let of_near = path >> 4u;
                let a = vector(near.terms[of_near].misses[0]);
                let b = vector(near.terms[of_near].misses[1]);
                let plane = vector(near.terms[of_near].misses[2]);
                let nearness = dot3(direction, plane);
                let along_a = dot3(direction, a) / nearness;
                let along_b = dot3(direction, b) / nearness;
                q = along_a * along_a + along_b * along_b;
                if is_nan(nearness) || !(nearness > 0.0) {
                    continue;
                }
                fragment.nearness = nearness;
                gradient = plane.xy / view.focal_px;
                fragment.slack = near.terms[of_near].sigma * nearness * nearness;
                if HAS_NORMALS {
                    let normal = unit_or_zero(plane);
                    fragment.normal = select(normal, -normal, dot3(normal, direction) > 0.0);
                }
            } else {
                let of_surfel = batch_terms[n];
                // As the twin walks a row: from the tile's first pixel.
                let dx = (corner.x - place.x) + f32(own.local.x);
                let dy = (corner.y - place.y) + f32(own.local.y);
                let p = place.z * dx + place.w * dy;
                let r = form.x * dx + form.y * dy;
                q = p * p + r * r;
                let z = of_surfel.gradient[0] * dx
                    + (of_surfel.gradient[1] * dy + of_surfel.nearness);
                if of_surfel.homography > 0.0 {
                    let root = z * (1.0 / of_surfel.nearness);
                    q = q / (root * root);
                    if is_nan(root) || !(root > 0.0) {
                        continue;
                    }
                }
                fragment.nearness = z;
                gradient = vec2<f32>(of_surfel.gradient[0], of_surfel.gradient[1]);
                if IS_CUT {
                    let inverse = vec3<f32>(
                        place.z * place.z + form.x * form.x,
                        place.z * place.w + form.x * form.y,
                        place.w * place.w + form.y * form.y,
                    );
                    shown = shown - view.low_pass_variance_px2 * inverse;
                    shown_at = place.xy + vec2<f32>(
                        shown.x * dx + shown.y * dy,
                        shown.y * dx + shown.z * dy,
                    );
                }
                fragment.slack = of_surfel.slack;
                if HAS_NORMALS {
                    fragment.normal = batch_normals[n];
                }
            }
            if !is_finite(q) || q > cutoff_squared {
                continue;
            }
            var share = 1.0;
            if IS_CUT {
                share = clip_share(view, shown_at, fragment.nearness, gradient, shown);
                if share == 0.0 {
                    continue;
                }
            }
            inside = inside + 1u;
            // A compiler that assumes numbers may drop the guard: then the pixel stays finite.
            fragment.weight = form.z * exp_minus_half(min(q, 49.0)) * share;
            fragment.colour = light.xyz;
            insert(&window, fragment);
        }
        drawn = drawn + count;
        next = next + count;
    }

    if own.is_pixel {
        store_layer(window[0], 0u, own.index, count_of_band);
        store_layer(window[1], 1u, own.index, count_of_band);
        store_layer(window[2], 2u, own.index, count_of_band);
        if IS_COUNT {
            layers[count_index] = counted + f32(inside);
        }
    }
    // Of fewer surfels than overflow this sum (chunk_limit of src/gpu/pass.rs).
    atomicAdd(&inside_low, inside);
    workgroupBarrier();
    if thread == 0u {
        let added = atomicLoad(&inside_low);
        let low = carried.splat_pixels.x + added;
        let high = carried.splat_pixels.y + select(0u, 1u, low < added);
        tile_ranges[tile].x = end;
        progress[tile] = TileProgress(drawn, behind, vec2<u32>(low, high), 0u, 0u);
    }
}

// Whether the surface is the whole picture: then it has a depth where it covers half of a pixel.
// Otherwise wherever it covers any of it.
override IS_PICTURE: bool = true;

// The layers, as above.
@group(0) @binding(2) var<storage, read> drawn_layers: array<f32>;
// The band's pixels, row by row: four floats each, then a depth each, then (with normals) three floats
// each.
@group(0) @binding(3) var<storage, read_write> pixels: array<f32>;

// The share of a pixel that weights of this sum cover.
fn coverage(weight: f32) -> f32 {
    if weight <= 0.5 {
        return weight;
    }
    return min(0.5 + (weight - 0.5) * (0.5 / (COVERAGE_FULL - 0.5)), 1.0);
}

// Pixels from their layers, one thread each.
@compute @workgroup_size(THREADS)
fn resolve_layers(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let index = group_index(group) * THREADS + thread;
    let count = band_pixels(chunk, view.size);
    if index >= count {
        return;
    }
    let stride = layer_words() * count;
    var total = 0.0;
    for (var k = 0u; k < SURFACE_LAYERS; k = k + 1u) {
        total = total + coverage(drawn_layers[k * stride + index]);
    }
    let half_covered = 0.5 * min(total, 1.0);
    var covered = 0.0;
    var colour = vec3<f32>(0.0);
    var depth = NO_DEPTH;
    var normal = vec3<f32>(0.0);
    for (var k = 0u; k < SURFACE_LAYERS; k = k + 1u) {
        let first = k * stride + index;
        let weight = drawn_layers[first];
        if weight == 0.0 {
            break;
        }
        let before = covered;
        covered = min(before + coverage(weight), 1.0);
        let of_layer = vec3<f32>(
            drawn_layers[first + 2u * count],
            drawn_layers[first + 3u * count],
            drawn_layers[first + 4u * count],
        );
        colour = colour + of_layer * ((covered - before) / weight);
        if before < half_covered && covered >= half_covered {
            let nearness = drawn_layers[first + count] / weight;
            if view.orthographic != 0u {
                depth = -nearness;
            } else {
                depth = 1.0 / nearness;
            }
            if HAS_NORMALS {
                normal = unit_or_zero(vec3<f32>(
                    drawn_layers[first + 5u * count],
                    drawn_layers[first + 6u * count],
                    drawn_layers[first + 7u * count],
                ));
            }
        }
    }
    if IS_COUNT {
        colour = vec3<f32>(drawn_layers[SURFACE_LAYERS * stride + index]);
    }
    if IS_PICTURE && covered < 0.5 {
        depth = NO_DEPTH;
    }
    pixels[4u * index] = colour.x;
    pixels[4u * index + 1u] = colour.y;
    pixels[4u * index + 2u] = colour.z;
    pixels[4u * index + 3u] = covered;
    pixels[4u * count + index] = depth;
    if HAS_NORMALS {
        let first = 5u * count + 3u * index;
        pixels[first] = normal.x;
        pixels[first + 1u] = normal.y;
        pixels[first + 2u] = normal.z;
    }
}
