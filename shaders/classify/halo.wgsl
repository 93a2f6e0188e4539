// Provides the field around particles: for a lattice's cells from their neighbours, for points as stored.
// Twins: src/blocks/halo.rs, src/scene/local_models.rs.

// Cells of a brick and of a halo two cells wide, along each axis.
const WIDE_X: u32 = BRICK_X + 4u;
const WIDE_Y: u32 = BRICK_Y + 4u;
const WIDE_Z: u32 = BRICK_Z + 4u;
const WIDE_COUNT: u32 = WIDE_X * WIDE_Y * WIDE_Z;

// Their values, as bits; NaN for cells outside the lattice.
var<workgroup> halo: array<u32, WIDE_COUNT>;

const NO_VALUE: u32 = 0x7fc00000u;

// Local model of the field over a kernel.
struct LocalModel {
    slope: vec3<f32>,
    departure: f32,
    // Least and greatest of the values around.
    around: vec2<f32>,
}

// Returns the value of a cell, as bits. Its brick may belong to another part; its values are then stored
// in this part, too.
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

// Loads a brick's values and its halo; each thread loads some of them.
fn fill_halo(block: u32, thread: u32) {
    let corner = brick_corner(block);
    for (var n = thread; n < WIDE_COUNT; n = n + THREADS) {
        let wide = vec3<u32>(n % WIDE_X, n / WIDE_X % WIDE_Y, n / (WIDE_X * WIDE_Y));
        // Below the first cell the index wraps around and is rejected.
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

// Returns the change of the spacing at a cell along an axis; it is stored after the widths of all cells.
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

// Returns the model of a cell of the brick, from its neighbours.
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

// Returns the least and greatest value within two cells.
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

// Returns half word k of the codes of local models.
fn code_word(k: u32) -> u32 {
    return (bitcast<u32>(strengths[bricks.models_first + k / 2u]) >> (16u * (k % 2u))) & 0xffffu;
}

// Decodes a length: so many steps down from the greatest, `steps` to an octave; 0 for the step 0.
fn length_of_steps(step: u32, last: u32, steps: u32, greatest: f32) -> f32 {
    if step == 0u {
        return 0.0;
    }
    let below = last - step;
    let octaves = below / steps;
    let rest = f32(below % steps) / f32(steps);
    return greatest * bitcast<f32>((127u - octaves) << 23u) * exp_negative(-rest * LN_2);
}

// Returns the stored model of particle `index` of value `value`.
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
