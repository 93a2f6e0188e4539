// Classifies kernels over their own extents. A particle becomes one piece for each lobe of the transfer
// function that its values reach, or for each window of a lobe with steps. The terms of the pieces follow
// the space for all particles. Twins: src/cpu/extent.rs.

// Properties of a particle that the lobes depend on.
struct Kernel {
    exists: bool,
    // Index in arrays with one entry per particle.
    index: u32,
    cell: vec3<u32>,
    value: f32,
    // Standard deviation of its values, and their mean.
    spread: f32,
    middle: f32,
    model: LocalModel,
    // The range of values that a piece may have.
    reached: vec2<f32>,
}

// Returns particle `local` of a block whose kernels are classified over their extents.
fn kernel_of(block: u32, local: u32) -> Kernel {
    var kernel: Kernel;
    let b = blocks[block];
    kernel.index = b.first + local;
    if IS_LATTICE {
        kernel.cell = brick_cell(brick_corner(block), local);
        if any(kernel.cell >= bricks.dims) {
            return kernel;
        }
        let own = brick_cell(vec3<u32>(2u), local);
        let bits = halo[own.x + WIDE_X * (own.y + WIDE_Y * own.z)];
        if is_none(bits) {
            return kernel;
        }
        kernel.value = bitcast<f32>(bits);
        kernel.model = model_of_cell(local, kernel.cell);
    } else {
        if local >= b.count {
            return kernel;
        }
        kernel.value = value_at(kernel.index);
        if !is_finite(kernel.value) {
            return kernel;
        }
        kernel.model = model_of_point(kernel.index, kernel.value);
    }
    kernel.exists = true;
    let slope = kernel.model.slope;
    kernel.spread = sqrt(dot3(slope, slope));
    kernel.middle = kernel.value + kernel.model.departure;
    return kernel;
}

// Adds the range of the values around, for kernels that come near a lobe.
fn with_range(kernel: Kernel, local: u32) -> Kernel {
    var out = kernel;
    var around = kernel.model.around;
    if IS_LATTICE {
        around = range_around(local);
    }
    let reach = LOBE_REACH * kernel.spread;
    out.reached = vec2<f32>(
        min(max(around.x, kernel.middle - reach), kernel.value),
        max(min(around.y, kernel.middle + reach), kernel.value),
    );
    return out;
}

// The piece of a kernel in a lobe. `class_of_value` carries its colour.
struct FoundPiece {
    extinction: f32,
    class_of_value: vec4<f32>,
    shift: f32,
    width: f32,
}

// - `window`: window of the lobe.
fn piece_in(kernel: Kernel, lobe: Lobe, window: u32) -> FoundPiece {
    var found: FoundPiece;
    if !(kernel.spread > lobe.threshold) {
        // The first window stands for all.
        if window == lobe.first_window && lobe_meets(lobe, kernel.value, kernel.value) {
            found.class_of_value = classify(kernel.value);
            found.extinction = found.class_of_value.w;
            found.width = 1.0;
        }
        return found;
    }
    let piece = lobe_piece(lobe, lobe_window(window), kernel.middle, kernel.spread);
    found.extinction = piece.extinction;
    found.shift = piece.shift;
    found.width = piece.width;
    found.class_of_value = classify(clamp(kernel.value, lobe.interval.x, lobe.interval.y));
    return found;
}

// Returns whether a kernel may have a piece in a lobe, for any values around.
fn comes_near(kernel: Kernel, lobe: Lobe) -> bool {
    if !(kernel.spread > lobe.threshold) {
        return lobe_meets(lobe, kernel.value, kernel.value);
    }
    let reach = LOBE_REACH * kernel.spread;
    return lobe_meets(lobe, kernel.middle - reach, kernel.middle + reach);
}

// Returns whether a kernel has a piece in a lobe, given the range of `with_range`.
fn reaches(kernel: Kernel, lobe: Lobe) -> bool {
    if !(kernel.spread > lobe.threshold) {
        return true;
    }
    return lobe_meets(lobe, kernel.reached.x, kernel.reached.y);
}

fn volume_of_particle(kernel: Kernel) -> f32 {
    if STRENGTH == STRENGTH_CELL {
        return strengths[0];
    }
    if STRENGTH == STRENGTH_WIDTHS {
        return cell_volume(kernel.cell);
    }
    return strengths[kernel.index];
}

// Returns the windows of all lobes in which a kernel has a piece, a bit each. Counting and emitting share
// this function.
fn windows_of(block: u32, local: u32) -> u32 {
    var kernel = kernel_of(block, local);
    if !kernel.exists {
        return 0u;
    }
    var near = 0u;
    let count = lobe_count();
    for (var i = 0u; i < count; i = i + 1u) {
        near = near | (u32(comes_near(kernel, lobe(i))) << i);
    }
    if near == 0u {
        return 0u;
    }
    kernel = with_range(kernel, local);
    let volume = volume_of_particle(kernel);
    var mask = 0u;
    while near != 0u {
        let own = lobe(countTrailingZeros(near));
        near = near & (near - 1u);
        if reaches(kernel, own) {
            let end = own.first_window + own.window_count;
            for (var w = own.first_window; w < end; w = w + 1u) {
                let is_piece = is_positive(piece_in(kernel, own, w).extinction * volume);
                mask = mask | (u32(is_piece) << w);
            }
        }
    }
    return mask;
}

// Returns the pieces of a thread's particle: a bit for each window, or bit 0 if its block is classified
// by values alone.
fn mask_of(block: u32, is_spread: bool, thread: u32) -> u32 {
    if is_spread {
        return windows_of(block, thread);
    }
    return u32(is_positive(visit(block, thread).mass));
}

// Loads the values around a brick whose kernels are classified over their extents.
fn prepare(view: BlockView, thread: u32) {
    if IS_LATTICE && view.classified_by == BY_EXTENT {
        fill_halo(view.block, thread);
    }
}

// Returns the number of kernels of a thread's particle.
fn kernel_count(view: BlockView, thread: u32) -> u32 {
    return countOneBits(mask_of(view.block, view.classified_by == BY_EXTENT, thread));
}

@compute @workgroup_size(THREADS)
fn classify_emit(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let v = group_index(group);
    // Emits nothing if the capacity is too small for all.
    let is_view = v < state.view_count && state.classified_count > 0u;
    let is_spread = is_view && views[v].classified_by == BY_EXTENT;
    if is_view {
        prepare(views[v], thread);
    }
    workgroupBarrier();
    var mask = 0u;
    if is_view {
        mask = mask_of(views[v].block, is_spread, thread);
    }
    var place = scan_threads(thread, countOneBits(mask));
    if !is_view {
        return;
    }
    let view = views[v];
    if mask != 0u && !is_spread {
        let particle = visit(view.block, thread);
        if place < view.count {
            emit(view.first + place, v, thread, particle, vec3<f32>(0.0), 0.0, 1.0);
        }
    } else if mask != 0u {
        let kernel = with_range(kernel_of(view.block, thread), thread);
        let volume = volume_of_particle(kernel);
        let direction = kernel.model.slope / kernel.spread;
        var i = 0u;
        var own = lobe(i);
        while mask != 0u {
            let window = countTrailingZeros(mask);
            mask = mask & (mask - 1u);
            // Windows are in the order of their lobes.
            while window >= own.first_window + own.window_count {
                i = i + 1u;
                own = lobe(i);
            }
            let piece = piece_in(kernel, own, window);
            let is_whole = !(kernel.spread > own.threshold);
            let axis = select(direction, vec3<f32>(0.0), is_whole);
            let particle = Visit(kernel.index, piece.extinction * volume, piece.class_of_value);
            if place < view.count {
                emit(view.first + place, v, thread, particle, axis, piece.shift, piece.width);
            }
            place = place + 1u;
        }
    }
    for (var n = scan_total + thread; n < view.count; n = n + THREADS) {
        classified[view.first + n] = ClassifiedParticle(v, 0u, 0.0, array<f32, 3>());
        classified[state.capacity + view.first + n] = ClassifiedParticle();
    }
}

fn emit(at: u32, v: u32, local: u32, particle: Visit, axis: vec3<f32>, shift: f32, width: f32) {
    classified[at] = ClassifiedParticle(v, local, particle.mass, carried_by(particle));
    // In the layout of `PieceTerms`.
    classified[state.capacity + at] = ClassifiedParticle(
        bitcast<u32>(axis.x),
        bitcast<u32>(axis.y),
        axis.z,
        array<f32, 3>(shift, width, 0.0),
    );
}
