// Stage: copies a chunk of the sorted footprints into its own buffers, in depth order. Later stages read
// them sequentially, and no binding needs to hold more than a part or a chunk. No twin: on the CPU the
// order's words refer to footprints in place.

@group(0) @binding(0) var<uniform> chunk: ChunkUniform;
@group(0) @binding(1) var<storage, read> sort_state: SortState;
@group(0) @binding(2) var<storage, read_write> new_state: ChunkState;
// Arguments of `gather`, and of a dispatch with a thread per footprint (bin.wgsl).
@group(0) @binding(3) var<storage, read_write> new_arguments: array<array<u32, 3>, 2>;

@compute @workgroup_size(1)
fn gather_prepare() {
    let length = min(chunk.capacity, sort_state.visible - min(chunk.start, sort_state.visible));
    new_state.length = length;
    new_state.offset_count = length + 1u;
    new_state.entries = 0u;
    let copies = folded((length + FOOTPRINTS - 1u) / FOOTPRINTS);
    new_arguments[0] = array<u32, 3>(copies.x, copies.y, copies.z);
    let walks = folded((length + THREADS - 1u) / THREADS);
    new_arguments[1] = array<u32, 3>(walks.x, walks.y, walks.z);
}

// Number of threads that copy one footprint, a vector each, so that neighbours read neighbouring words.
const QUARTERS: u32 = 4u;
// Footprints per workgroup.
const FOOTPRINTS: u32 = THREADS / QUARTERS;
const EXACT_WORDS: u32 = 7u;

@group(0) @binding(0) var<uniform> part: PartIndex;
@group(0) @binding(1) var<uniform> this_chunk: ChunkUniform;
@group(0) @binding(2) var<storage, read> state: ChunkState;
@group(0) @binding(3) var<storage, read> ranges: array<PartRange>;
// Global indices of footprints, in order.
@group(0) @binding(4) var<storage, read> order: array<u32>;
// Footprints and `ExactTerms` of the part and of the chunk, as words.
@group(0) @binding(5) var<storage, read> footprints: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> exact: array<u32>;
@group(0) @binding(7) var<storage, read_write> sorted_footprints: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read_write> sorted_exact: array<u32>;

// True if footprints have exact terms, or other terms in their place.
override EXACT: bool = true;
// True if all footprints have terms, not only those on the exact path.
override IS_OF_ALL: bool = false;

@compute @workgroup_size(THREADS)
fn gather(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let k = group_index(group) * FOOTPRINTS + thread / QUARTERS;
    if k >= state.length {
        return;
    }
    let range = ranges[part.index];
    // Wraps around for a footprint of an earlier part.
    let i = order[this_chunk.start + k] - range.first;
    if i >= range.count {
        return;
    }
    let quarter = thread % QUARTERS;
    sorted_footprints[k * QUARTERS + quarter] = footprints[i * QUARTERS + quarter];
    // Parts of splats have exact terms only if all parts do.
    if EXACT && (IS_OF_ALL || footprints[i * QUARTERS + 3u].x == PATH_EXACT) {
        for (var word = quarter; word < EXACT_WORDS; word = word + QUARTERS) {
            sorted_exact[k * EXACT_WORDS + word] = exact[i * EXACT_WORDS + word];
        }
    }
}
