// Accumulate: averages surfels in a few layers of a pixel, each an opaque surface: colour, coverage,
// depth and, on request, normals; front to back. Twin: src/cpu/tile/accumulate/opaque.rs. surface.wgsl
// computes pixels from the layers.

// Layout in `pixels`: the layers of the band's pixels, one float of all pixels after the other: those of
// the first layer, of the second ...; then the counts, if pixels count surfels.

// Sums over the surfels of one layer of a pixel.
struct Layer {
    // Sum of weights: the coverage of the surfels.
    weight: f32,
    // Weight times inverse depth.
    inverse_depth: f32,
    // Weight times linear colour.
    colour: vec3<f32>,
    // Weight times the unit normal, camera space; zero unless normals are written.
    normal: vec3<f32>,
}

fn added(layer: Layer, fragment: Fragment) -> Layer {
    let w = fragment.weight;
    return Layer(
        layer.weight + w,
        layer.inverse_depth + w * fragment.inverse_depth,
        layer.colour + w * fragment.colour,
        layer.normal + w * fragment.normal,
    );
}

// Returns the number of floats of a layer.
fn layer_words() -> u32 {
    return select(5u, 8u, HAS_NORMALS);
}

fn load_layer(k: u32, index: u32, count: u32) -> Layer {
    let first = k * layer_words() * count + index;
    var layer = Layer(
        pixels[first],
        pixels[first + count],
        vec3<f32>(pixels[first + 2u * count], pixels[first + 3u * count], pixels[first + 4u * count]),
        vec3<f32>(0.0),
    );
    if HAS_NORMALS {
        layer.normal = vec3<f32>(
            pixels[first + 5u * count],
            pixels[first + 6u * count],
            pixels[first + 7u * count],
        );
    }
    return layer;
}

fn store_layer(layer: Layer, k: u32, index: u32, count: u32) {
    let first = k * layer_words() * count + index;
    pixels[first] = layer.weight;
    pixels[first + count] = layer.inverse_depth;
    pixels[first + 2u * count] = layer.colour.x;
    pixels[first + 3u * count] = layer.colour.y;
    pixels[first + 4u * count] = layer.colour.z;
    if HAS_NORMALS {
        pixels[first + 5u * count] = layer.normal.x;
        pixels[first + 6u * count] = layer.normal.y;
        pixels[first + 7u * count] = layer.normal.z;
    }
}

// The layers of a pixel, front to back. The code below relies on their number: an index that is not
// constant would move them out of registers.
const_assert SURFACE_LAYERS == 3u;
alias Window = array<Layer, SURFACE_LAYERS>;

const JOINS: u32 = 0u;
const AHEAD: u32 = 1u;
const BEHIND: u32 = 2u;

// Returns the position of a fragment relative to a layer.
fn place_of(fragment: Fragment, layer: Layer) -> u32 {
    let ahead = fragment.inverse_depth * layer.weight - layer.inverse_depth;
    if is_nan(ahead) {
        return BEHIND;
    }
    if abs(ahead) <= fragment.slack * layer.weight {
        return JOINS;
    }
    return select(BEHIND, AHEAD, ahead > 0.0);
}

// Merges two layers.
fn merged(a: Layer, b: Layer) -> Layer {
    var out = a;
    out.weight = a.weight + b.weight;
    out.inverse_depth = a.inverse_depth + b.inverse_depth;
    out.colour = a.colour + b.colour;
    out.normal = a.normal + b.normal;
    return out;
}

// Adds a fragment to the layers of a pixel. If it lies in front of a layer, that layer and those behind
// move back, and the last two are merged. A fragment behind all others joins the last layer, so that no
// coverage is lost.
fn insert(fragment: Fragment) {
    if is_nan(fragment.inverse_depth) {
        return;
    }
    var alone: Layer;
    alone = added(alone, fragment);
    var place = place_of(fragment, window[0]);
    if place == JOINS {
        window[0] = added(window[0], fragment);
        return;
    }
    if place == AHEAD {
        window[2] = merged(window[1], window[2]);
        window[1] = window[0];
        window[0] = alone;
        return;
    }
    var covered = window[0].weight;
    if covered >= COVERAGE_FULL {
        return;
    }
    place = place_of(fragment, window[1]);
    if place == JOINS {
        window[1] = added(window[1], fragment);
        return;
    }
    if place == AHEAD {
        window[2] = merged(window[1], window[2]);
        window[1] = alone;
        return;
    }
    covered = covered + window[1].weight;
    if covered >= COVERAGE_FULL {
        return;
    }
    window[2] = added(window[2], fragment);
}

// The layers of the pixel.
var<private> window: Window;
var<private> counted: f32;
// Least inverse depth of the front layers, as an ordered word; 0 if they leave a pixel open.
var<workgroup> farthest: atomic<u32>;

fn count_index(own: TilePixel, count: u32) -> u32 {
    return SURFACE_LAYERS * layer_words() * count + own.index;
}

fn begin_tile(tile: u32) {}

fn begin_pixel(own: TilePixel, ray: TileRay, carried: TileProgress) {
    window = Window();
    counted = 0.0;
    if own.is_pixel && carried.drawn > 0u {
        let count = band_pixels(chunk, view.size);
        window[0] = load_layer(0u, own.index, count);
        window[1] = load_layer(1u, own.index, count);
        window[2] = load_layer(2u, own.index, count);
        if IS_COUNT {
            counted = pixels[count_index(own, count)];
        }
    }
}

fn is_finished(hidden: u32) -> bool {
    return false;
}

// Returns the depth behind which the tile's front layers hide everything, once they cover it: an ordered
// word.
fn look(thread: u32, is_pixel: bool, drawn: u32) -> u32 {
    if thread == 0u {
        atomicStore(&farthest, 0xffffffffu);
    }
    workgroupBarrier();
    if is_pixel {
        let front = window[0];
        let inverse_depth = front.inverse_depth / front.weight;
        if front.weight < COVERAGE_FULL {
            atomicStore(&farthest, 0u);
        } else if !is_nan(inverse_depth) {
            atomicMin(&farthest, ordered_word(inverse_depth));
        }
    }
    workgroupBarrier();
    return atomicLoad(&farthest);
}

fn draw(n: u32, own: TilePixel, ray: TileRay, hidden: u32) -> bool {
    if !own.is_pixel || !is_in_box(n, own.at) {
        return false;
    }
    let footprint = footprint_of_batch(n);
    if hidden > 0u && footprint.depth < number_of_word(hidden) {
        return false;
    }
    let fragment = surfel(n, footprint, ray, own.index);
    if fragment.exists {
        insert(fragment);
    }
    return fragment.exists;
}

fn end_pixel(own: TilePixel, inside: u32, is_end: bool) {
    if own.is_pixel {
        let count = band_pixels(chunk, view.size);
        store_layer(window[0], 0u, own.index, count);
        store_layer(window[1], 1u, own.index, count);
        store_layer(window[2], 2u, own.index, count);
        if IS_COUNT {
            pixels[count_index(own, count)] = counted + f32(inside);
        }
    }
}

fn layers_of_tile() -> vec2<u32> {
    return vec2<u32>(0u);
}
