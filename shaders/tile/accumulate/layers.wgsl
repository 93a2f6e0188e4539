// Sums kernels in layers along the ray, for sheets and slabs. A layer is composited when no kernel
// reaches it any more. LAYER_SLOTS and SLOPE_SLOTS, the numbers of layers that a pixel keeps open, come
// before this file.

// True if open layers may have to be carried from one dispatch to the next. They then follow the picture
// in `pixels`: for each pixel, four floats for each slot of the ring and for the part behind the surface
// of the divided layer, and two depths.
override CARRIES: bool = false;

// First and last layer that the kernels of the batch reach.
var<workgroup> batch_layers: array<vec2<u32>, TERMINATION_INTERVAL>;
// Greatest number of layers that any kernel needed at once.
var<workgroup> layers_needed: atomic<u32>;

// A thread's sums of the open layers: optical depth times the carried quantity, and optical depth. Layer
// n is stored at n modulo the number of slots.
var<private> ring: array<vec4<f32>, LAYER_SLOTS>;
// For sheets, which have one slot: optical depth times depth.
var<private> ring_depth: f32;
// The part behind the surface, in the layer that the surface divides.
var<private> divided: vec4<f32>;
var<private> divided_depth: f32;
// Derivatives of a layer's carried sum and of its optical depth: along the pixel's column, its row and z.
// Used if layers are lit.
struct Slopes {
    carried: vec3<f32>,
    length: vec3<f32>,
}
var<private> ring_slopes: array<Slopes, SLOPE_SLOTS>;
var<private> divided_slopes: Slopes;
var<private> pixel_centre: vec2<f32>;
// Nearest open layer; NO_LAYER if all are composited.
var<private> first_layer: u32;

// Returns the depth z at which a layer of slabs begins.
fn layer_start(layer: u32) -> f32 {
    // Whole multiples of the thickness, which are exact in f32 wherever depths are: a sum of lengths
    // would accumulate roundings.
    return f32(view.layer_first + i32(layer)) * view.layer_thickness;
}

// Returns the layer of a footprint's depth key.
fn layer_of_key(i: u32) -> u32 {
    return key_of_chunk(i) >> view.layer_shift;
}

fn begin_sums_of_tile(tile: u32) {
    atomicStore(&layers_needed, progress[tile].layers_needed);
}

fn begin_sums(own: TilePixel, ray: TileRay, carried: TileProgress) {
    let is_continued = carried.drawn > 0u;
    begin_opacity(own, is_continued);
    pixel_centre = ray.pixel;
    first_layer = select(0u, carried.first_layer, is_continued);
    if CARRIES && own.is_pixel && is_continued {
        load_layers(own.index, band_pixels(chunk, view.size));
    }
}

fn prepare_sums(n: u32, i: u32) {
    let reached = layers_of(i);
    batch_layers[n] = reached;
    if side_of(n) != SIDE_HIDDEN {
        let from_layer = max(reached.x, first_layer);
        atomicMax(&layers_needed, max(reached.y, from_layer) - from_layer + 1u);
    }
}

fn before_kernel(n: u32) {
    if batch_layers[n].x > first_layer {
        close_layers(batch_layers[n].x);
    }
}

// Adds to a layer the part in front of the surface or wholly behind it, and the part that the surface
// divides.
fn add_to_layer(layer: u32, tau: f32, rest: f32, carried: vec3<f32>) {
    let at = layer % LAYER_SLOTS;
    ring[at] = ring[at] + vec4<f32>(tau * carried, tau);
    if HAS_SURFACE {
        divided = divided + vec4<f32>(rest * carried, rest);
    }
}

// Composites a layer behind a pixel's contents.
//
// - `at_half`: the depth that it gives the pixel, clamped to the two depths that follow.
fn put_layer(
    pixel: ptr<private, Pixel>,
    layer: u32,
    sums: vec4<f32>,
    slopes: Slopes,
    at_half: f32,
    from_depth: f32,
    to_depth: f32,
) {
    if !is_positive(sums.w) {
        return;
    }
    let before = (*pixel).alpha;
    let class_of = classify_layer(sums, slopes, pixel_centre, layer_middle(layer));
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
        (*pixel).depth = max(min(max(at_half, 0.0), to_depth), from_depth);
    }
}

fn layer_middle(layer: u32) -> f32 {
    return 0.5 * (layer_start(layer) + layer_start(layer + 1u));
}

// Composites the layers in front of one.
fn close_layers(until: u32) {
    let count = min(until - min(first_layer, until), LAYER_SLOTS);
    for (var ahead = 0u; ahead < count; ahead = ahead + 1u) {
        let layer = first_layer + ahead;
        let at = layer % LAYER_SLOTS;
        close_layer(layer, ring[at], ring_slopes[at % SLOPE_SLOTS]);
        ring[at] = vec4<f32>(0.0);
        ring_slopes[at % SLOPE_SLOTS] = Slopes();
    }
    first_layer = max(first_layer, until);
}

// Returns the index of a slot of the layers that are carried for a pixel.
fn carried_at(place: u32, index: u32, count: u32) -> u32 {
    let words = picture_words() * select(1u, 2u, HAS_SURFACE);
    return words * count + 4u * (place * count + index);
}

// Returns the same index for derivatives, which follow the sums.
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

fn end_pixel(own: TilePixel, inside: u32, is_end: bool) {
    if is_end {
        close_layers(NO_LAYER);
        end_layers();
    } else if CARRIES && own.is_pixel {
        store_layers(own.index, band_pixels(chunk, view.size));
    }
    end_opacity(own);
}

fn layers_of_tile() -> vec2<u32> {
    return vec2<u32>(first_layer, atomicLoad(&layers_needed));
}
