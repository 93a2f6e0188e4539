// Stage: computes masses and colours, or signed amplitudes, of particles from their values, once. A
// workgroup handles a view, a thread a particle of its block. The rest is in classify/one.wgsl or in
// classify/pieces.wgsl. shade.wgsl computes colours that depend on the view. Twins: src/cpu/classify.rs,
// src/cpu/amplitude.rs.
//
// Passes: classify_count, a prefix sum of `counts`, classify_place, classify_emit.

// Kinds of data of a part; `Kinds` of src/gpu/kinds.rs.
override VALUES: u32 = VALUES_NONE;
override STRENGTH: u32 = STRENGTH_GIVEN;
override IS_LATTICE: bool = false;

@group(0) @binding(0) var<uniform> bricks: BrickUniform;
@group(0) @binding(1) var<storage, read_write> state: PartState;
@group(0) @binding(2) var<storage, read_write> views: array<BlockView>;
// One for each view, and one more for the total that the prefix sum leaves.
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> classified: array<ClassifiedParticle>;
@group(0) @binding(4) var<storage, read> blocks: array<DeviceBlock>;
@group(0) @binding(4) var<storage, read_write> frame: FrameState;
@group(0) @binding(5) var<storage, read> values: array<u32>;
@group(0) @binding(5) var<storage, read_write> arguments: array<u32>;
// One per particle. For a lattice: the volume that all cells share, or the widths along x, y and z.
@group(0) @binding(6) var<storage, read> strengths: array<f32>;
// Bindings 7 and 8 belong to classify/class.wgsl, or 7 belongs to classify/amplitude.wgsl.

// Result of classify/class.wgsl or classify/amplitude.wgsl for a particle.
struct Visit {
    // Its index in arrays with one entry per particle.
    index: u32,
    // 0 for an invisible particle.
    mass: f32,
    class_of_value: vec4<f32>,
}

// Returns value i, widened to f32.
fn value_at(i: u32) -> f32 {
    if VALUES == VALUES_U8 {
        return f32((values[i / 4u] >> (8u * (i % 4u))) & 0xffu);
    }
    if VALUES == VALUES_U16 {
        return f32((values[i / 2u] >> (16u * (i % 2u))) & 0xffffu);
    }
    if VALUES == VALUES_I16 {
        return f32(bitcast<i32>(values[i / 2u] << (16u - 16u * (i % 2u))) >> 16u);
    }
    return bitcast<f32>(values[i]);
}

// Returns cell `local` of a brick whose first cell is `corner`.
fn brick_cell(corner: vec3<u32>, local: u32) -> vec3<u32> {
    return corner + vec3<u32>(local % BRICK_X, local / BRICK_X % BRICK_Y, local / (BRICK_X * BRICK_Y));
}

// Returns the first cell of block `block` of the part.
fn brick_corner(block: u32) -> vec3<u32> {
    let brick = bricks.first + block;
    let x = (bricks.dims.x + BRICK_X - 1u) / BRICK_X;
    let y = (bricks.dims.y + BRICK_Y - 1u) / BRICK_Y;
    return vec3<u32>(brick % x, brick / x % y, brick / (x * y)) * vec3<u32>(BRICK_X, BRICK_Y, BRICK_Z);
}

// Returns particle `local` of a block; without mass if the block has no such particle.
fn visit(block: u32, local: u32) -> Visit {
    let b = blocks[block];
    var particle = Visit(b.first + local, 0.0, vec4<f32>(0.0));
    var cell = vec3<u32>(0u);
    if IS_LATTICE {
        cell = brick_cell(brick_corner(block), local);
        if any(cell >= bricks.dims) {
            return particle;
        }
        // The values of the bricks around come first, if they are stored.
        particle.index = b.first + (bricks.first - bricks.values_first) * THREADS + local;
    } else if local >= b.count {
        return particle;
    }
    return weighed(particle.index, cell);
}

var<workgroup> visible_count: atomic<u32>;

@compute @workgroup_size(THREADS)
fn classify_count(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let v = group_index(group);
    let is_view = v < state.view_count;
    if is_view {
        prepare(views[v], thread);
    }
    if thread == 0u {
        atomicStore(&visible_count, 0u);
    }
    workgroupBarrier();
    var count = 0u;
    if is_view {
        count = kernel_count(views[v], thread);
    }
    atomicAdd(&visible_count, count);
    workgroupBarrier();
    if is_view && thread == 0u {
        counts[v] = atomicLoad(&visible_count);
    }
}

// A thread per view: computes the start and the number of its particles. The first thread sets the part's
// counts.
@compute @workgroup_size(THREADS)
fn classify_place(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let v = group_index(group) * THREADS + thread;
    let view_count = state.view_count;
    if v < view_count {
        views[v].first = counts[v];
        views[v].count = counts[v + 1u] - counts[v];
    }
    if v == 0u {
        let needed = counts[view_count];
        let fits = needed <= state.capacity;
        let classified_count = select(0u, needed, fits);
        state.needed = needed;
        state.classified_count = classified_count;
        state.first = frame.classified_count;
        frame.classified_count = add_saturating(frame.classified_count, classified_count);
        let folds = folded((classified_count + THREADS - 1u) / THREADS);
        arguments[PARTICLE_ARGUMENTS] = folds.x;
        arguments[PARTICLE_ARGUMENTS + 1u] = folds.y;
        arguments[PARTICLE_ARGUMENTS + 2u] = folds.z;
    }
}
