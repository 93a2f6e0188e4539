// Composites kernels, or layers of kernels, on a pixel, front to back.

// True if depths are written.
override HAS_DEPTH: bool = false;
// Opacity min(tau, 1) instead of 1 - exp(-tau).
override IS_LINEAR: bool = false;

// A thread's sums for its pixel, in front of the surface or behind it.
struct Pixel {
    colour: vec3<f32>,
    alpha: f32,
    depth: f32,
}

var<private> front: Pixel;
var<private> behind: Pixel;

// Layout in `pixels`: row by row four floats each, then (with depths) one float each. With surfaces, the
// picture behind them follows in the same layout.
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

// Returns the number of floats of a pixel of the picture.
fn picture_words() -> u32 {
    return select(4u, 5u, HAS_DEPTH);
}

fn begin_opacity(own: TilePixel, is_continued: bool) {
    front = Pixel(vec3<f32>(0.0), 0.0, NO_DEPTH);
    behind = front;
    if own.is_pixel && is_continued {
        let count = band_pixels(chunk, view.size);
        front = load_pixel(0u, own.index, count);
        if HAS_SURFACE {
            behind = load_pixel(picture_words() * count, own.index, count);
        }
    }
}

fn end_opacity(own: TilePixel) {
    if own.is_pixel {
        let count = band_pixels(chunk, view.size);
        store_pixel(front, 0u, own.index, count);
        if HAS_SURFACE {
            store_pixel(behind, picture_words() * count, own.index, count);
        }
    }
}

var<workgroup> open_pixels: atomic<u32>;
var<workgroup> uniform_open: u32;

fn is_finished(hidden: u32) -> bool {
    return hidden != 0u;
}

// Returns 1 if every pixel of the tile is opaque.
fn look(thread: u32, is_pixel: bool, drawn: u32) -> u32 {
    let opaque = 1.0 - view.tolerance * TERMINATION_SHARE;
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
    return u32(workgroupUniformLoad(&uniform_open) == 0u);
}

// Returns the opacity of an optical depth; for splats, which state it, the opacity itself.
fn opacity_by(path: u32, tau: f32) -> f32 {
    if path == PATH_CAPPED {
        return min(tau, SPLAT_CEILING);
    }
    if IS_LINEAR || path == PATH_PEAK {
        return min(tau, 1.0);
    }
    return opacity_of(tau);
}
