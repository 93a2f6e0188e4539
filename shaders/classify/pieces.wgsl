// Pieces, where kernels are classified over their own extents: of each particle a piece
// for each lobe of the transfer function that its values reach, or for each window of a lobe with steps. The terms of a piece follow all particles
// that there is room for. Twins: src/cpu/extent.rs, src/blocks/halo.rs, src/scene/local_models.rs.

// Cells of a brick and of two rings around along each axis.
const WIDE_X: u32 = BRICK_X + 4u;
const WIDE_Y: u32 = BRICK_Y + 4u;
const WIDE_Z: u32 = BRICK_Z + 4u;
const WIDE_COUNT: u32 = WIDE_X * WIDE_Y * WIDE_Z;

// Their values, as bits; NaN where there is none.
var<workgroup> halo: array<u32, WIDE_COUNT>;

const NO_VALUE: u32 = 0x7fc00000u;

// How the field runs over a kernel.
struct LocalModel {
    slope: vec3<f32>,
    departure: f32,
    // Least and greatest of the values around.
    around: vec2<f32>,
}

// What is asked of lobes for a particle.
struct Kernel {
    exists: bool,
    // In arrays of one entry per particle.
    index: u32,
    cell: vec3<u32>,
    value: f32,
    // Standard deviation of its values, and their mean.
    spread: f32,
    middle: f32,
    model: LocalModel,
    // The values that a piece may have.
    reached: vec2<f32>,
}

// The value of a cell, as bits; the brick that it is in may be another part's, whose values are kept
// here, too.
fn value_of_cell(cell: vec3<u32>) -> u32 {
    let b = cell / vec3<u32>(BRICK_X, BRICK_Y, BRICK_Z);
    let own = cell - b * vec3<u32>(BRICK_X, BRICK_Y, BRICK_Z);
    let x = (bricks.dims.x + BRICK_X - 1u) / BRICK_X;
    let y = (bricks.dims.y + BRICK_Y - 1u) / BRICK_Y;
    let brick = b.x + x * (b.y + y * b.z) - bricks.values_first;
    let local = own.x + BRICK_X * (own.y + BRICK_Y * own.z);
    let bits = bitcast<u32>(value_at(brick * THREADS + local));
    return select(bits, NO_VALUE, (bits & 0x7f800000u) == 0x7f800000u);
}

// Each thread fetches some of a brick's values and of those around.
fn fill_halo(block: u32, thread: u32) {
    let corner = brick_corner(block);
    for (var n = thread; n < WIDE_COUNT; n = n + THREADS) {
        let wide = vec3<u32>(n % WIDE_X, n / WIDE_X % WIDE_Y, n / (WIDE_X * WIDE_Y));
        // Below the first cell it wraps around and is none.
        let cell = corner + wide - 2u;
        var bits = NO_VALUE;
        if all(cell < bricks.dims) {
            bits = value_of_cell(cell);
        }
        halo[n] = bits;
    }
}

fn is_none(bits: u32) -> bool {
    return bits == NO_VALUE;
}

// How the spacing changes at a cell along an axis: after the widths of all cells.
fn bend_of(cell: vec3<u32>, axis: u32) -> f32 {
    if STRENGTH != STRENGTH_WIDTHS {
        return 0.0;
    }
    let widths = bricks.dims.x + bricks.dims.y + bricks.dims.z;
    var first = widths;
    if axis > 0u {
        first = first + bricks.dims.x;
    }
    if axis > 1u {
        first = first + bricks.dims.y;
    }
    return strengths[first + cell[axis]];
}

// The model of a cell of the brick, from its neighbours.
fn model_of_cell(local: u32, cell: vec3<u32>) -> LocalModel {
    let own_cell = brick_cell(vec3<u32>(2u), local);
    let place = own_cell.x + WIDE_X * (own_cell.y + WIDE_Y * own_cell.z);
    let own = bitcast<f32>(halo[place]);
    var strides = array<u32, 3>(1u, WIDE_X, WIDE_X * WIDE_Y);
    var slope = vec3<f32>(0.0);
    var second = 0.0;
    for (var a = 0u; a < 3u; a = a + 1u) {
        let below_bits = halo[place - strides[a]];
        let above_bits = halo[place + strides[a]];
        let below = own - bitcast<f32>(below_bits);
        let above = bitcast<f32>(above_bits) - own;
        if !is_none(below_bits) && !is_none(above_bits) {
            let change = below + above;
            slope[a] = 0.5 * change;
            second = second + ((above - below) - change * bend_of(cell, a));
        } else if !is_none(below_bits) {
            slope[a] = below;
        } else if !is_none(above_bits) {
            slope[a] = above;
        }
    }
    let width = bricks.kernel_width;
    return LocalModel(slope * width, 0.5 * width * width * second, vec2<f32>(own));
}

// Least and greatest of the values two cells around.
fn range_around(local: u32) -> vec2<f32> {
    let own = brick_cell(vec3<u32>(2u), local);
    var lo = LARGEST;
    var hi = -LARGEST;
    for (var k = own.z - 2u; k <= own.z + 2u; k = k + 1u) {
        for (var j = own.y - 2u; j <= own.y + 2u; j = j + 1u) {
            for (var i = own.x - 2u; i <= own.x + 2u; i = i + 1u) {
                let bits = halo[i + WIDE_X * (j + WIDE_Y * k)];
                if !is_none(bits) {
                    lo = min(lo, bitcast<f32>(bits));
                    hi = max(hi, bitcast<f32>(bits));
                }
            }
        }
    }
    return vec2<f32>(lo, hi);
}

// Half word k of the codes of local models.
fn code_word(k: u32) -> u32 {
    return (bitcast<u32>(strengths[bricks.models_first + k / 2u]) >> (16u * (k % 2u))) & 0xffffu;
}

// A length in so many steps down from the greatest, `steps` to an octave; 0 for the step 0.
fn length_of_steps(step: u32, last: u32, steps: u32, greatest: f32) -> f32 {
    if step == 0u {
        return 0.0;
    }
    let below = last - step;
    let octaves = below / steps;
    let rest = f32(below % steps) / f32(steps);
    return greatest * bitcast<f32>((127u - octaves) << 23u) * exp_negative(-rest * LN_2);
}

// The stored model of particle `index` of value `value`.
fn model_of_point(index: u32, value: f32) -> LocalModel {
    let low = code_word(3u * index) | (code_word(3u * index + 1u) << 16u);
    let high = code_word(3u * index + 2u);
    let mask = (1u << DIRECTION_BITS) - 1u;
    let steps = vec2<u32>(low & mask, (low >> DIRECTION_BITS) & mask);
    let direction = from_octahedral(vec2<f32>(steps) * (2.0 / f32(DIRECTION_STEPS)) - 1.0);
    let slope_last = (1u << SLOPE_BITS) - 1u;
    let slope_step = (low >> (2u * DIRECTION_BITS)) & slope_last;
    let slope = length_of_steps(slope_step, slope_last, SLOPE_STEPS_PER_OCTAVE, bricks.model_scales.x);
    let departure_last = (1u << DEPARTURE_BITS) - 1u;
    let departure_step = ((low >> 28u) | (high << 4u)) & departure_last;
    let departure = length_of_steps(
        departure_step,
        departure_last,
        DEPARTURE_STEPS_PER_OCTAVE,
        bricks.model_scales.y,
    );
    let is_below = ((high >> 5u) & 1u) == 1u;
    let range_last = (1u << RANGE_BITS) - 1u;
    let ranges = vec2<u32>((high >> 6u) & range_last, (high >> 11u) & range_last);
    let unit = slope / RANGE_STEPS;
    let lo = select(value - f32(ranges.x) * unit, -LARGEST, ranges.x == range_last);
    let hi = select(value + f32(ranges.y) * unit, LARGEST, ranges.y == range_last);
    return LocalModel(
        direction * slope,
        select(departure, -departure, is_below),
        vec2<f32>(lo, hi),
    );
}

// Particle `local` of a block whose kernels are classified over their extents.
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

// Finds the range of the values around: for kernels that come near a lobe.
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

// The piece of a kernel in a lobe. `class_of_value` is what carries its colour.
struct FoundPiece {
    extinction: f32,
    class_of_value: vec4<f32>,
    shift: f32,
    width: f32,
}

// - `window`: of the lobe.
fn piece_in(kernel: Kernel, lobe: Lobe, window: u32) -> FoundPiece {
    var found: FoundPiece;
    if !(kernel.spread > lobe.threshold) {
        // One for all windows.
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

// Whether a kernel may have a piece in a lobe, whatever the values around.
fn comes_near(kernel: Kernel, lobe: Lobe) -> bool {
    if !(kernel.spread > lobe.threshold) {
        return lobe_meets(lobe, kernel.value, kernel.value);
    }
    let reach = LOBE_REACH * kernel.spread;
    return lobe_meets(lobe, kernel.middle - reach, kernel.middle + reach);
}

// Whether it has, and with `with_range`.
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

// The windows of all lobes that a kernel has a piece in, a bit each. Counting and emitting share it.
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

// What a thread's particle becomes: a bit for each window, or bit 0 where its block keeps to values alone.
fn mask_of(block: u32, is_spread: bool, thread: u32) -> u32 {
    if is_spread {
        return windows_of(block, thread);
    }
    return u32(is_positive(visit(block, thread).mass));
}

// The values around a brick whose kernels are classified over their extents.
fn prepare(view: BlockView, thread: u32) {
    if IS_LATTICE && view.is_spread != 0u {
        fill_halo(view.block, thread);
    }
}

// How many kernels a thread's particle becomes.
fn kernel_count(view: BlockView, thread: u32) -> u32 {
    return countOneBits(mask_of(view.block, view.is_spread != 0u, thread));
}

@compute @workgroup_size(THREADS)
fn classify_emit(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let v = group_index(group);
    // None where there is no room for all.
    let is_view = v < state.view_count && state.classified_count > 0u;
    let is_spread = is_view && views[v].is_spread != 0u;
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
            // Windows lie in the order of their lobes.
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
    // As `PieceTerms` lies.
    classified[state.capacity + at] = ClassifiedParticle(
        bitcast<u32>(axis.x),
        bitcast<u32>(axis.y),
        axis.z,
        array<f32, 3>(shift, width, 0.0),
    );
}
