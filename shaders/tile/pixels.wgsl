// Defines a tile: its pixels, with a thread each, and its state from one chunk of footprints to the next.

struct TileProgress {
    // Number of entries drawn so far; 0 before a frame's first chunk, whatever the pixels contain.
    drawn: u32,
    // The hidden part of the tile. For kernels: 1 if every pixel is opaque, so that all else is hidden.
    // For surfels: everything behind the inverse depth of this `ordered_word` is hidden; 0 for nothing.
    hidden: u32,
    // Number of kernels evaluated within their cut-off, low and high word.
    splat_pixels: vec2<u32>,
    // For layers: the nearest open layer; NO_LAYER if all are composited.
    first_layer: u32,
    // Greatest number of layers that a footprint needed open at once.
    layers_needed: u32,
}

// Initial state that all threads of a tile read.
struct TileBegun {
    progress: TileProgress,
    range: vec2<u32>,
}

struct NearList {
    count: u32,
    crossing: u32,
    terms: array<NearTerms>,
}

// A thread's pixel.
struct TilePixel {
    // The tile's first pixel.
    origin: vec2<u32>,
    // Offset from there.
    local: vec2<u32>,
    at: vec2<u32>,
    // True if it lies in the image.
    is_pixel: bool,
    // Its index in the band.
    index: u32,
}

fn tile_pixel(tile: u32, thread: u32, chunk: ChunkUniform, size: vec2<u32>) -> TilePixel {
    let in_band = vec2<u32>(tile % chunk.band_size.x, tile / chunk.band_size.x);
    let origin = (chunk.band_first + in_band) * TILE_SIZE;
    // Each 32 threads, which many devices run together, have 8 x 4 pixels: a small footprint misses more
    // of such blocks than of rows.
    let block = vec2<u32>(thread / 32u % 2u, thread / 64u) * vec2<u32>(8u, 4u);
    let local = block + vec2<u32>(thread % 8u, thread / 8u % 4u);
    let at = origin + local;
    let is_pixel = at.x < size.x && at.y < size.y;
    let index = (at.y - chunk.band_first.y * TILE_SIZE) * size.x + at.x;
    return TilePixel(origin, local, at, is_pixel, index);
}

// The ray through a thread's pixel, and the pixel's position.
struct TileRay {
    // Centre of the tile's first pixel, from which the twin walks a row.
    corner: vec2<f32>,
    // Offset from there.
    local: vec2<f32>,
    pixel: vec2<f32>,
}

fn tile_ray(own: TilePixel) -> TileRay {
    let corner = vec2<f32>(own.origin) + 0.5;
    let local = vec2<f32>(own.local);
    return TileRay(corner, local, corner + local);
}

// Returns the offset from a point of the image to the pixel.
fn offset_from(centre_px: vec2<f32>, ray: TileRay) -> vec2<f32> {
    return (ray.corner - centre_px) + ray.local;
}

// Returns the number of pixels of a band, which is as wide as the image.
fn band_pixels(chunk: ChunkUniform, size: vec2<u32>) -> u32 {
    let top = chunk.band_first.y * TILE_SIZE;
    return size.x * min(chunk.band_size.y * TILE_SIZE, size.y - top);
}

// Returns the ray D = (X, Y, 1) through a point of the image.
fn ray_through(view: ViewUniform, pixel: vec2<f32>) -> vec3<f32> {
    return vec3<f32>((pixel - view.centre_px) / view.focal_px, 1.0);
}

// Encodes a number as a word that grows with it; above 0 for all but NaN.
fn ordered_word(x: f32) -> u32 {
    let bits = bitcast<u32>(x);
    return bits ^ select(0x80000000u, 0xffffffffu, bits >= 0x80000000u);
}

// Returns the number of an ordered word.
fn number_of_word(word: u32) -> f32 {
    return bitcast<f32>(word ^ select(0xffffffffu, 0x80000000u, word >= 0x80000000u));
}
