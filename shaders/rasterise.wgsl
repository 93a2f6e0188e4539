// Stage: draws lists of footprints into pixels, front to back, with a workgroup per tile and a thread per
// pixel. Twin: src/cpu/tile/.
//
// The drawing of a footprint on a pixel varies along four axes (src/splat/axes.rs), and each answer has a
// file in shaders/tile/. The host puts the files of one pass before this one. Together they define:
//
//     Terms                     additional terms of footprints
//     begin_tile                one thread: initialises the data that the tile's threads share
//     begin_pixel               all threads: load the earlier contents of a pixel
//     is_finished               whether the rest of the tile is hidden
//     look                      all threads, between batches: find the part of the tile that is hidden
//     prepare                   a thread for each footprint of a batch
//     draw                      all threads: draw a footprint; return whether its kernel was evaluated
//     end_pixel                 all threads: store the contents of a pixel
//     layers_of_tile            one thread: returns the state of the layers for `TileProgress`
//
// A frame whose footprints are drawn in several depth chunks runs this once per chunk. Pixels and the
// tile's progress are carried from one chunk to the next.

// True if footprints have terms.
override HAS_TERMS: bool = true;
// True if pixels count the footprints that they evaluate.
override IS_COUNT: bool = false;
// Greatest number of entries of a tile's list that one dispatch draws.
override SLICE: u32 = 0xffffffffu;

// Only the fields of the band are read.
@group(0) @binding(0) var<uniform> chunk: ChunkUniform;
@group(0) @binding(1) var<uniform> view: ViewUniform;
// First and one past the last entry of each tile's list; entries that are drawn are removed from its
// beginning.
@group(0) @binding(2) var<storage, read_write> tile_ranges: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> tile_lists: array<u32>;
// Binding 4 belongs to footprint.wgsl.
@group(0) @binding(5) var<storage, read> terms: array<Terms>;
@group(0) @binding(6) var<storage, read> near: NearList;
// The band's pixels, in the layout of the file that accumulates them.
@group(0) @binding(7) var<storage, read_write> pixels: array<f32>;
@group(0) @binding(8) var<storage, read_write> progress: array<TileProgress>;
// Binding 9 belongs to interval/cut.wgsl or evaluate/surfel.wgsl, 10 and 11 to classify/slab.wgsl.

var<workgroup> batch_terms: array<Terms, TERMINATION_INTERVAL>;
var<workgroup> begun: TileBegun;
var<workgroup> inside_low: atomic<u32>;

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
    let ray = tile_ray(own);
    if thread == 0u {
        begun = TileBegun(progress[tile], tile_ranges[tile]);
        atomicStore(&inside_low, 0u);
        begin_tile(tile);
    }
    let uniform_begun = workgroupUniformLoad(&begun);
    let carried = uniform_begun.progress;
    let range = uniform_begun.range;
    begin_pixel(own, ray, carried);
    let end = range.x + min(range.y - range.x, SLICE);
    var inside = 0u;
    var drawn = carried.drawn;
    var hidden = carried.hidden;
    var next = range.x;
    while !is_finished(hidden) && next < end {
        // Batches end where the twin checks what is hidden.
        if drawn % TERMINATION_INTERVAL == 0u && drawn > 0u {
            hidden = look(thread, own.is_pixel, drawn);
            if is_finished(hidden) {
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
            if HAS_TERMS {
                batch_terms[thread] = terms[i];
            }
            prepare(thread, i);
        }
        workgroupBarrier();
        for (var n = 0u; n < count; n = n + 1u) {
            inside = inside + u32(draw(n, own, ray, hidden));
        }
        drawn = drawn + count;
        next = next + count;
    }
    let is_end = chunk.is_last != 0u && (is_finished(hidden) || end == range.y);
    end_pixel(own, inside, is_end);
    // There are too few footprints to overflow this sum (`chunk_limit` of src/gpu/pass/capacity.rs).
    atomicAdd(&inside_low, inside);
    workgroupBarrier();
    if thread == 0u {
        let added = atomicLoad(&inside_low);
        let low = carried.splat_pixels.x + added;
        let high = carried.splat_pixels.y + select(0u, 1u, low < added);
        let layers = layers_of_tile();
        tile_ranges[tile].x = end;
        progress[tile] = TileProgress(drawn, hidden, vec2<u32>(low, high), layers.x, layers.y);
    }
}
