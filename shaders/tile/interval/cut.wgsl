// Interval: the part of a pixel's ray inside the clip planes and up to a depth of the caller's, divided by an
// opaque surface if there is one. Twin: src/cpu/tile/interval/cut.rs.

// True if opaque surfaces lie among the kernels.
override HAS_SURFACE: bool = false;

// True if rays end at depths of the caller's.
override HAS_ENDS: bool = false;
// Words of the surface's pixels before the depths at which rays end.
override WORDS_BEFORE_ENDS: u32 = 0u;

// The surface's pixels as surface.wgsl writes them: four floats each, then a depth each. The depths at which
// rays end follow its last words.
@group(0) @binding(9) var<storage, read> surface: array<f32>;

var<private> span: Span;

// Positions of the batch's kernels relative to the spans.
var<workgroup> batch_sides: array<u32, TERMINATION_INTERVAL>;
// Bounds of the spans of the tile's pixels, as ordered words: least and greatest of their beginning,
// their division and their end.
var<workgroup> span_bounds: array<atomic<u32>, 6>;
// 1 if the surface covers a pixel in part.
var<workgroup> surface_partial: atomic<u32>;

fn begin_interval_of_tile() {
    for (var i = 0u; i < 6u; i = i + 1u) {
        atomicStore(&span_bounds[i], select(0u, 0xffffffffu, i % 2u == 0u));
    }
    atomicStore(&surface_partial, 0u);
}

fn begin_interval(own: TilePixel, ray: TileRay) {
    span = WHOLE_SPAN;
    if own.is_pixel {
        var clipped = clip_span(view, ray.pixel);
        if HAS_ENDS {
            let end = surface[WORDS_BEFORE_ENDS * band_pixels(chunk, view.size) + own.index];
            if end != NO_DEPTH {
                clipped = span_of(clipped.x, min(clipped.y, end));
            }
        }
        span = Span(clipped.x, clipped.y, clipped.y);
        if HAS_SURFACE {
            let covered = surface[4u * own.index + 3u];
            let depth = surface[4u * band_pixels(chunk, view.size) + own.index];
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

fn span_bound(i: u32) -> f32 {
    return number_of_word(atomicLoad(&span_bounds[i]));
}

fn prepare_interval(n: u32, i: u32) {
    batch_sides[n] = side_in_tile(i);
}

// Returns the position of footprint i of the chunk, for all pixels of the tile.
fn side_in_tile(i: u32) -> u32 {
    let footprint = footprint_of_chunk(i);
    if is_near_path(footprint.path) {
        return SIDE_CUT;
    }
    let reach = reach_of(i, footprint);
    let first = footprint.depth - reach;
    let last = footprint.depth + reach;
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

fn side_of(n: u32) -> u32 {
    return batch_sides[n];
}

// Returns whether anything behind the surface is visible.
fn shows_behind() -> bool {
    return HAS_SURFACE && atomicLoad(&surface_partial) != 0u;
}
