// Stage: prepares the footprints' keys and indices, which radix.wgsl sorts front to back. Twin:
// src/cpu/sort.rs.

@group(0) @binding(0) var<storage, read> part_counts: array<u32>;
@group(0) @binding(1) var<storage, read_write> new_state: SortState;
@group(0) @binding(2) var<storage, read_write> new_ranges: array<PartRange>;
// Arguments of `sort_keys`, part by part.
@group(0) @binding(3) var<storage, read_write> new_arguments: array<array<u32, 3>>;

@compute @workgroup_size(1)
fn sort_prepare() {
    var first = 0u;
    for (var part = 0u; part < arrayLength(&part_counts); part = part + 1u) {
        let count = part_counts[part];
        new_ranges[part] = PartRange(first, count);
        let arguments = folded((count + THREADS - 1u) / THREADS);
        new_arguments[part] = array<u32, 3>(arguments.x, arguments.y, arguments.z);
        first = first + count;
    }
    new_state = SortState(first, 0u, 0u);
}

// Key of footprints that reach no pixel. It comes after all others, whose keys have DEPTH_KEY_BITS bits.
const INVISIBLE: u32 = 0xffffffffu;

// `SortState`, to which all workgroups add their counts.
struct Counted {
    count: u32,
    visible: atomic<u32>,
    exact: atomic<u32>,
}

@group(0) @binding(0) var<uniform> part: PartIndex;
@group(0) @binding(1) var<storage, read> ranges: array<PartRange>;
@group(0) @binding(2) var<storage, read> footprints: array<Footprint>;
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> values: array<u32>;
@group(0) @binding(5) var<storage, read_write> state: Counted;

var<workgroup> visible: atomic<u32>;
var<workgroup> exact: atomic<u32>;

@compute @workgroup_size(THREADS)
fn sort_keys(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    if thread == 0u {
        atomicStore(&visible, 0u);
        atomicStore(&exact, 0u);
    }
    workgroupBarrier();
    let range = ranges[part.index];
    let i = group_index(group) * THREADS + thread;
    if i < range.count {
        let is_visible = footprints[i].rows != 0u;
        keys[range.first + i] = select(INVISIBLE, footprints[i].key, is_visible);
        values[range.first + i] = range.first + i;
        if is_visible {
            atomicAdd(&visible, 1u);
            atomicAdd(&exact, u32(footprints[i].path == PATH_EXACT));
        }
    }
    workgroupBarrier();
    if thread == 0u {
        // Sums do not depend on the order of the workgroups.
        atomicAdd(&state.visible, atomicLoad(&visible));
        atomicAdd(&state.exact, atomicLoad(&exact));
    }
}
