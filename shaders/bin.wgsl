// Stage: lists the footprints of a chunk that touch each tile of a band, in depth order. It writes
// entries (tile, footprint) in the footprints' order, and radix.wgsl sorts them by tile. Twin:
// src/cpu/bin.rs.

// Number of tiles in a footprint's box from which the whole workgroup walks it: one thread would keep the
// others waiting.
const LARGE_BOX: u32 = 64u;

struct BinStep {
    // 0 counts the entries of every footprint, 1 writes them. Not an `override`: a compiler could round
    // the two kernels differently, and they must agree.
    emit: u32,
    // 1 if some tiles of the picture are drawn, and bands are as wide as the picture.
    is_masked: u32,
}

@group(0) @binding(0) var<uniform> chunk: ChunkUniform;
@group(0) @binding(1) var<uniform> bin_step: BinStep;
@group(0) @binding(2) var<storage, read> state: ChunkState;
// Footprints in depth order.
@group(0) @binding(3) var<storage, read> footprints: array<Footprint>;
@group(0) @binding(4) var<storage, read> exact: array<ExactTerms>;
// Number of entries of every footprint, and one more word; then their prefix sums, the last of which is
// the total.
@group(0) @binding(5) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(6) var<storage, read_write> entry_tiles: array<u32>;
@group(0) @binding(7) var<storage, read_write> entry_footprints: array<u32>;
// 1 for each tile of the picture that is drawn, row by row, if some are.
@group(0) @binding(8) var<storage, read> drawn_tiles: array<u32>;

// True if footprints have exact terms, or other terms in their place.
override EXACT: bool = true;

// Number of tiles found so far for each thread's footprint.
var<workgroup> found: array<atomic<u32>, THREADS>;
// Threads with large footprints.
var<workgroup> large: array<u32, THREADS>;
var<workgroup> large_count: atomic<u32>;

// Runs once to count and once to write, with the prefix sums between.
@compute @workgroup_size(THREADS)
fn bin_walk(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let first = group_index(group) * THREADS;
    let k = first + thread;
    atomicStore(&found[thread], 0u);
    if thread == 0u {
        atomicStore(&large_count, 0u);
    }
    workgroupBarrier();
    if k < state.length {
        let tiles = tile_box(footprints[k]);
        if tiles.count <= LARGE_BOX || is_known(tiles) {
            for_each_tile(k, thread, 0u, 1u);
        } else {
            large[atomicAdd(&large_count, 1u)] = thread;
        }
    }
    workgroupBarrier();
    let count = atomicLoad(&large_count);
    for (var i = 0u; i < count; i = i + 1u) {
        for_each_tile(first + large[i], large[i], thread, THREADS);
    }
    workgroupBarrier();
    if bin_step.emit == 0u && k < state.length {
        offsets[k] = atomicLoad(&found[thread]);
    }
}

// The tiles of the band that a footprint's box meets.
struct TileBox {
    first: vec2<u32>,
    columns: u32,
    count: u32,
    // True if some of the tiles may lie beyond the outline. All tiles of a box of one row or column, in
    // the band or not, are touched, almost without exception.
    test: bool,
}

fn tile_box(footprint: Footprint) -> TileBox {
    let first = vec2<u32>(footprint.columns & 0xffffu, footprint.rows & 0xffffu) / TILE_SIZE;
    let last = (vec2<u32>(footprint.columns >> 16u, footprint.rows >> 16u) - 1u) / TILE_SIZE;
    let test = last.x > first.x && last.y > first.y && (footprint.path & 3u) != PATH_NEAR;
    let first_in_band = max(first, chunk.band_first);
    let end = max(min(last + 1u, chunk.band_first + chunk.band_size), first_in_band);
    let size = end - first_in_band;
    return TileBox(first_in_band, size.x, size.x * size.y, test);
}

// Returns whether tiles are only counted, and their number is known without a test.
fn is_known(tiles: TileBox) -> bool {
    return bin_step.emit == 0u && bin_step.is_masked == 0u && !tiles.test;
}

// Visits every tile of the band that contains a pixel centre within the cut-off of footprint k, by the
// exact test of its outline against rectangles. The call visits the tiles `begin`, `begin + stride`, ...
// of the box. The order does not matter: a footprint meets a tile once, and the sort by tile keeps the
// footprints' order.
fn for_each_tile(k: u32, owner: u32, begin: u32, stride: u32) {
    let footprint = footprints[k];
    let tiles = tile_box(footprint);
    if is_known(tiles) {
        atomicStore(&found[owner], tiles.count);
        return;
    }
    var outline: Outline;
    if tiles.test {
        outline = outline_of(footprint, k);
    }
    let box_first = vec2<u32>(footprint.columns & 0xffffu, footprint.rows & 0xffffu);
    let box_end = vec2<u32>(footprint.columns >> 16u, footprint.rows >> 16u);
    var place = 0u;
    var end = 0u;
    if bin_step.emit != 0u {
        place = offsets[k];
        end = offsets[k + 1u];
    }
    for (var i = begin; i < tiles.count; i = i + stride) {
        let tile = tiles.first + vec2<u32>(i % tiles.columns, i / tiles.columns);
        var touched = true;
        if bin_step.is_masked != 0u {
            touched = drawn_tiles[tile.y * chunk.band_size.x + tile.x] != 0u;
        }
        if touched && tiles.test {
            // The pixel centres of the tile within the box.
            let lower = vec2<f32>(max(tile * TILE_SIZE, box_first));
            let upper = vec2<f32>(min((tile + 1u) * TILE_SIZE, box_end));
            let centre = footprint.centre_px;
            touched = outline_touches(outline, lower + 0.5 - centre, upper - 0.5 - centre);
        }
        if touched {
            let n = atomicAdd(&found[owner], 1u);
            // Stays within the footprint's own range, even if a compiler rounds the two steps
            // differently.
            if bin_step.emit != 0u && place + n < end {
                let in_band = tile - chunk.band_first;
                entry_tiles[place + n] = in_band.y * chunk.band_size.x + in_band.x;
                entry_footprints[place + n] = k;
            }
        }
    }
}

// The outline of a footprint's cut-off.
struct Outline {
    // True if the outline is that of a surfel that follows the homography of its plane.
    is_plane: bool,
    kernel: KernelOutline,
    plane: PlaneOutline,
}

fn outline_of(footprint: Footprint, k: u32) -> Outline {
    var outline: Outline;
    let p = footprint.form_p;
    let r = footprint.form_r;
    let r2 = footprint.cutoff_squared;
    if EXACT && footprint.path == PATH_SURFEL {
        // `SurfelTerms`, word by word: the inverse depth, and the flag of a homography.
        let terms = exact[k];
        let inverse_depth = terms.hessian[0];
        let homography = terms.hessian[2];
        if is_above(homography, 0.0) {
            outline.is_plane = true;
            let gradient = vec2<f32>(terms.gradient[0], terms.gradient[1]) / inverse_depth;
            outline.plane = plane_outline(p, r, r2, gradient);
            return outline;
        }
    }
    if EXACT && (footprint.path & 3u) == PATH_EXACT {
        let terms = exact[k];
        let gradient = vec2<f32>(terms.gradient[0], terms.gradient[1]);
        outline.kernel = kernel_exact(p, r, r2, gradient, vector(terms.hessian));
        return outline;
    }
    outline.kernel = kernel_affine(p, r, r2);
    return outline;
}

fn outline_touches(outline: Outline, lower: vec2<f32>, upper: vec2<f32>) -> bool {
    if outline.is_plane {
        return plane_touches(outline.plane, lower, upper);
    }
    return kernel_touches(outline.kernel, lower, upper);
}

struct BinCapacity {
    entries: u32,
}

@group(0) @binding(0) var<uniform> band: ChunkUniform;
@group(0) @binding(1) var<uniform> capacity: BinCapacity;
@group(0) @binding(2) var<storage, read> summed: array<u32>;
@group(0) @binding(3) var<storage, read_write> new_state: ChunkState;
// Arguments of the `bin_walk` that writes, and of `bin_ranges`.
@group(0) @binding(4) var<storage, read_write> new_arguments: array<array<u32, 3>, 2>;

// Nothing is written if the entries of a chunk exceed the capacity.
@compute @workgroup_size(1)
fn bin_prepare() {
    let length = new_state.length;
    let needed = summed[length];
    let fits = needed <= capacity.entries;
    new_state.entries = select(0u, needed, fits);
    new_state.needed = max(new_state.needed, needed);
    let walks = folded(select(0u, (length + THREADS - 1u) / THREADS, fits));
    new_arguments[0] = array<u32, 3>(walks.x, walks.y, walks.z);
    let ranges = folded((band.band_size.x * band.band_size.y + THREADS - 1u) / THREADS);
    new_arguments[1] = array<u32, 3>(ranges.x, ranges.y, ranges.z);
}

// Tiles in order, one per entry.
@group(0) @binding(1) var<storage, read> sorted_tiles: array<u32>;
@group(0) @binding(2) var<storage, read> sorted_state: ChunkState;
// First and one-past-last entry of every tile of the band; zeros for a tile without entries.
@group(0) @binding(3) var<storage, read_write> tile_ranges: array<vec2<u32>>;

@compute @workgroup_size(THREADS)
fn bin_ranges(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let tile = group_index(group) * THREADS + thread;
    if tile >= band.band_size.x * band.band_size.y {
        return;
    }
    let first = first_entry(tile);
    let end = first_entry(tile + 1u);
    tile_ranges[tile] = select(vec2<u32>(), vec2<u32>(first, end), first < end);
}

// Returns the first entry of a tile or of a later one.
fn first_entry(tile: u32) -> u32 {
    var first = 0u;
    var end = sorted_state.entries;
    while first < end {
        let middle = first + (end - first) / 2u;
        if sorted_tiles[middle] < tile {
            first = middle + 1u;
        } else {
            end = middle;
        }
    }
    return first;
}
