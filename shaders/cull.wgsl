// Stage: finds the blocks that a frame sees, in their own order, and the keys of their depths. Positions
// are subtracted in f64, and the results equal the twin's bit for bit. Twin: src/blocks/cull.rs, and
// Renderer::render for the keys.
//
// Passes: cull_begin; for each part of merged particles cull_close; for each part cull_count and
// cull_scan; cull_range; for each part cull_emit.

// True if blocks choose their filters. For column densities all have the filter of the settings.
override HAS_CHOICE: bool = true;

const NOT_KEPT: u32 = 0xffffffffu;

// Result of a workgroup of `cull_count`.
struct CullGroup {
    // Number of blocks kept; after `cull_scan`, that of the groups before.
    count: u32,
    unused: u32,
    nearest: vec2<u32>,
    farthest: vec2<u32>,
}

@group(0) @binding(0) var<storage, read_write> frame: FrameState;
@group(0) @binding(1) var<storage, read_write> groups_seen: array<CullGroup>;
@group(0) @binding(1) var<storage, read_write> view: ViewUniform;
@group(0) @binding(2) var<storage, read> camera: CameraUniform;
@group(0) @binding(2) var<storage, read_write> state: PartState;
@group(0) @binding(3) var<storage, read> blocks: array<DeviceBlock>;
@group(0) @binding(3) var<storage, read_write> arguments: array<u32>;
// Each block's index among the blocks that its workgroup keeps.
@group(0) @binding(4) var<storage, read_write> places: array<u32>;
@group(0) @binding(5) var<storage, read> maxima: TransferMaxima;
// Merged blocks of all parts.
@group(0) @binding(6) var<storage, read_write> merged_blocks: array<MergedBlock>;
@group(0) @binding(6) var<storage, read_write> views: array<BlockView>;
@group(0) @binding(7) var<storage, read> merged_part: MergedPart;

// A part of merged particles.
struct MergedPart {
    // Index of its first block in `merged_blocks`.
    first: u32,
    bounds: array<MergeBounds>,
}

// A single thread.
@compute @workgroup_size(1)
fn cull_begin() {
    for (var i = 0u; i < FILTER_COUNT; i = i + 1u) {
        atomicStore(&frame.filters[i], 0u);
    }
    frame.nearest = vec2<u32>(0u);
    frame.farthest = vec2<u32>(0u);
    frame.classified_count = 0u;
}

// Transforms a point from world to camera space.
fn camera_point(world: array<vec2<u32>, 3>) -> array<vec2<u32>, 3> {
    var point = world;
    var offset = world;
    for (var i = 0u; i < 3u; i = i + 1u) {
        offset[i] = f64_sub(point[i], camera.eye[i]);
    }
    for (var i = 0u; i < 3u; i = i + 1u) {
        point[i] = f64_dot(camera.camera_from_world[i], offset);
    }
    return point;
}

fn widened(v: array<f32, 3>) -> array<vec2<u32>, 3> {
    return array<vec2<u32>, 3>(f64_from_f32(v[0]), f64_from_f32(v[1]), f64_from_f32(v[2]));
}

// Returns whether a kernel of the block may reach into the frustum. Conservative.
fn frustum_sees(
    centre: array<vec2<u32>, 3>,
    half_extent: array<f32, 3>,
    max_sigma: f32,
    is_spread: bool,
) -> bool {
    let deviations = select(MAX_CUTOFF, PIECE_REACH, is_spread);
    let reach = f64_mul(f64_from_f32(max_sigma), f64_from_f32(deviations));
    let half = widened(half_extent);
    var sees = true;
    for (var i = 0u; i < camera.plane_count; i = i + 1u) {
        var distance = f64_dot(camera.plane_normals[i], centre);
        distance = f64_add(distance, camera.plane_distances[i]);
        distance = f64_add(distance, f64_dot(camera.plane_spreads[i], half));
        distance = f64_add(distance, reach);
        sees = sees && f64_is_at_least_zero(distance);
    }
    return sees;
}

// Returns the rule that classifies a block's kernels.
fn classified_by(block: DeviceBlock) -> u32 {
    let asked = camera.choice.classified_by;
    if !IS_CLASSIFIED || asked == BY_VALUE {
        return BY_VALUE;
    }
    let lo = block.values_around[0];
    let hi = block.values_around[1];
    if asked == BY_EXTENT {
        return select(BY_VALUE, BY_EXTENT, block.greatest_spread > lobe_threshold(lo, hi));
    }
    let is_known = is_finite(lo) && is_finite(hi) && lo <= hi;
    let is_thin = camera.choice.slab_thickness <= THICKEST_SLAB * block.min_sigma;
    return select(BY_VALUE, BY_NEIGHBOURS, is_known && is_thin);
}

// Returns the range of values that classification may look up.
fn values_of(block: DeviceBlock, is_spread: bool) -> array<f32, 2> {
    if is_spread {
        return block.values_around;
    }
    return block.value_range;
}

// Returns whether the transfer function is transparent over a block's value range.
fn is_transparent(range: array<f32, 2>) -> bool {
    let lo = range[0];
    let hi = range[1];
    // No value at all (lo > hi): no particle is classified, and none is visible.
    if !is_finite(lo) || !is_finite(hi) || lo > hi {
        return true;
    }
    return !is_positive(max_extinction(lo, hi));
}

// Returns the distance of a block's origin, as depth keys measure it.
fn camera_distance(centre: array<vec2<u32>, 3>) -> vec2<u32> {
    if camera.key_kind == KEYS_OF_LAYERS {
        return f64_dot(camera.key_axis, centre);
    }
    if camera.key_kind == KEYS_OF_DEPTH {
        return centre[2];
    }
    return f64_sqrt(f64_dot(centre, centre));
}

fn narrowed(v: array<vec2<u32>, 3>) -> vec3<f32> {
    return vec3<f32>(f64_to_f32(v[0]), f64_to_f32(v[1]), f64_to_f32(v[2]));
}

// A thread per block of merged particles: decides whether its members need a test of their own.
@compute @workgroup_size(THREADS)
fn cull_close(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    if i >= arrayLength(&blocks) {
        return;
    }
    let block = blocks[i];
    let is_spread = classified_by(block) == BY_EXTENT;
    var state = MERGED_OPEN;
    if IS_CLASSIFIED {
        let values = values_of(block, is_spread);
        state = select(MERGED_OPEN, MERGED_UNSEEN, is_transparent(values));
    }
    if state == MERGED_OPEN {
        let centre = camera_point(block.origin);
        let sees = frustum_sees(centre, block.half_extent, block.max_sigma, is_spread);
        // Merged particles are classified by their means.
        if camera.has_frustum != 0u && !sees {
            state = MERGED_UNSEEN;
        } else if !is_spread && merge_fits(camera.choice, block, merged_part.bounds[i], narrowed(centre)) {
            state = MERGED_FITS;
        }
    }
    merged_blocks[merged_part.first + i] = MergedBlock(block.parent, state);
}

// Returns whether a block of this parent is invisible or replaced by merged particles.
fn is_covered(parent: u32) -> bool {
    var i = parent;
    while i < arrayLength(&merged_blocks) {
        let block = merged_blocks[i];
        if block.state != MERGED_OPEN {
            return true;
        }
        i = block.parent;
    }
    return false;
}

// Returns whether the block's particles are drawn, rather than merged ones or their members.
fn is_drawn(i: u32, parent: u32) -> bool {
    if camera.choice.merge_tolerance == 0.0 {
        return !IS_MERGED;
    }
    if IS_MERGED && merged_blocks[merged_part.first + i].state != MERGED_FITS {
        return false;
    }
    return !is_covered(parent);
}

var<workgroup> cull_greatest: array<vec2<u32>, THREADS>;

// Returns, to all threads of the workgroup, their greatest word.
fn greatest_of_threads(thread: u32, word: vec2<u32>) -> vec2<u32> {
    workgroupBarrier();
    cull_greatest[thread] = word;
    workgroupBarrier();
    for (var half = THREADS / 2u; half > 0u; half = half / 2u) {
        if thread < half {
            cull_greatest[thread] = u64_max(cull_greatest[thread], cull_greatest[thread + half]);
        }
        workgroupBarrier();
    }
    return cull_greatest[0];
}

// Encodes a distance as a word that grows with it: 0 for none, which includes NaN.
fn farthest_word(distance: vec2<u32>) -> vec2<u32> {
    return select(f64_ordered(distance), vec2<u32>(0u), f64_is_nan(distance));
}

// Encodes a distance as a word that grows as it falls.
fn nearest_word(distance: vec2<u32>) -> vec2<u32> {
    return farthest_word(f64_negate(distance));
}

@compute @workgroup_size(THREADS)
fn cull_count(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let index = group_index(group);
    let i = index * THREADS + thread;
    var is_kept = false;
    var nearest = vec2<u32>(0u);
    var farthest = vec2<u32>(0u);
    if i < arrayLength(&blocks) {
        let block = blocks[i];
        let is_spread = classified_by(block) == BY_EXTENT && !IS_MERGED;
        var is_visible = is_drawn(i, block.parent);
        if IS_CLASSIFIED && is_visible {
            is_visible = !is_transparent(values_of(block, is_spread));
        }
        if is_visible {
            let centre = camera_point(block.origin);
            let sees = frustum_sees(centre, block.half_extent, block.max_sigma, is_spread);
            is_kept = camera.has_frustum == 0u || sees;
            if sees {
                let half = widened(block.half_extent);
                // Pieces may be shifted.
                let shift = select(0.0, LOBE_REACH * block.max_sigma, is_spread);
                let radius = f64_add(f64_sqrt(f64_dot(half, half)), f64_from_f32(shift));
                let distance = camera_distance(centre);
                nearest = nearest_word(f64_sub(distance, radius));
                farthest = farthest_word(f64_add(distance, radius));
            }
        }
    }
    let place = scan_threads(thread, u32(is_kept));
    nearest = greatest_of_threads(thread, nearest);
    farthest = greatest_of_threads(thread, farthest);
    if i < arrayLength(&blocks) {
        places[i] = select(NOT_KEPT, place, is_kept);
        if thread == 0u {
            groups_seen[index] = CullGroup(scan_total, 0u, nearest, farthest);
        }
    }
}

// A single workgroup: computes the groups' positions, and adds the part to the range of distances of all
// parts.
@compute @workgroup_size(THREADS)
fn cull_scan(@builtin(local_invocation_index) thread: u32) {
    let count = arrayLength(&groups_seen);
    // Each thread owns a run.
    let run = (count + THREADS - 1u) / THREADS;
    let first = min(thread * run, count);
    let end = min(first + run, count);
    var sum = 0u;
    var nearest = vec2<u32>(0u);
    var farthest = vec2<u32>(0u);
    for (var i = first; i < end; i = i + 1u) {
        sum = sum + groups_seen[i].count;
        nearest = u64_max(nearest, groups_seen[i].nearest);
        farthest = u64_max(farthest, groups_seen[i].farthest);
    }
    var before = scan_threads(thread, sum);
    for (var i = first; i < end; i = i + 1u) {
        let own = groups_seen[i].count;
        groups_seen[i].count = before;
        before = before + own;
    }
    nearest = greatest_of_threads(thread, nearest);
    farthest = greatest_of_threads(thread, farthest);
    if thread == 0u {
        state.view_count = scan_total;
        state.count_length = scan_total + 1u;
        let folds = folded(scan_total);
        arguments[VIEW_ARGUMENTS] = folds.x;
        arguments[VIEW_ARGUMENTS + 1u] = folds.y;
        arguments[VIEW_ARGUMENTS + 2u] = folds.z;
        frame.nearest = u64_max(frame.nearest, nearest);
        frame.farthest = u64_max(frame.farthest, farthest);
    }
}

// A single thread: sets the range of keys from the nearest to the farthest block of all parts, or the
// given range.
@compute @workgroup_size(1)
fn cull_range() {
    if camera.key_kind == KEYS_OF_LAYERS {
        frame.near = camera.key_near;
        frame.keys_per_unit = camera.keys_per_unit;
        view.key_scale = f64_to_f32(camera.keys_per_unit);
        return;
    }
    let is_none = (frame.nearest.x | frame.nearest.y) == 0u;
    let is_none_far = (frame.farthest.x | frame.farthest.y) == 0u;
    let near = select(f64_negate(f64_of_ordered(frame.nearest)), F64_INFINITY, is_none);
    let far = select(f64_of_ordered(frame.farthest), f64_negate(F64_INFINITY), is_none_far);
    let span = f64_max(f64_sub(far, near), F64_LEAST_NORMAL);
    let keys_per_unit = f64_min(f64_div(DEPTH_KEY_SPAN, span), GREATEST_F32);
    frame.near = near;
    frame.keys_per_unit = keys_per_unit;
    view.key_scale = f64_to_f32(keys_per_unit);
}

// Returns the key of a distance: smaller is nearer.
fn depth_key(distance: vec2<u32>) -> u32 {
    let key = f64_to_u32(f64_mul(f64_sub(distance, frame.near), frame.keys_per_unit));
    return min(add_saturating(key, 4u), (1u << DEPTH_KEY_BITS) - 4u);
}

// Number of views of the workgroup with each filter.
var<workgroup> filters_seen: array<atomic<u32>, FILTER_COUNT>;

@compute @workgroup_size(THREADS)
fn cull_emit(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let index = group_index(group);
    let i = index * THREADS + thread;
    if thread < FILTER_COUNT {
        atomicStore(&filters_seen[thread], 0u);
    }
    workgroupBarrier();
    var place = NOT_KEPT;
    if i < arrayLength(&blocks) {
        place = places[i];
    }
    if place != NOT_KEPT {
        let block = blocks[i];
        let centre = camera_point(block.origin);
        let origin = narrowed(centre);
        let by = select(classified_by(block), BY_VALUE, IS_MERGED);
        var filter_kind = camera.choice.filter_kind;
        if HAS_CHOICE {
            filter_kind = filter_of(camera.choice, block, by == BY_EXTENT, origin);
        }
        views[groups_seen[index].count + place] = BlockView(
            triple(origin),
            i,
            0u,
            0u,
            depth_key(camera_distance(centre)),
            filter_kind,
            block.level,
            by,
        );
        if HAS_CHOICE {
            atomicAdd(&filters_seen[filter_kind], 1u);
        }
    }
    workgroupBarrier();
    if thread < FILTER_COUNT {
        atomicAdd(&frame.filters[thread], atomicLoad(&filters_seen[thread]));
    }
}
