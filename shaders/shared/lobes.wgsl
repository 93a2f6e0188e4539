// Evaluates the lobes of a transfer function, and the Gaussian that a kernel becomes in each. The stage
// declares `transfer`. Twin: src/scene/transfer_function/lobes.rs.

// Start of the lobes among the words of the transfer function's table.
override LOBES_FIRST: u32 = 0u;

// A maximal interval of values whose extinction is above 0.
struct Lobe {
    // First and last value, and the extinctions beyond: above 0 if the lobe extends to infinity.
    interval: vec2<f32>,
    beyond: vec2<f32>,
    // Spread of values up to which kernels are classified by their value alone.
    threshold: f32,
    // Spread of the first row.
    first_spread: f32,
    // The greatest extinction.
    peak: f32,
    // First window, and number of windows.
    first_window: u32,
    window_count: u32,
}

// A part of a lobe: all of it, or the part that a smooth window cuts out beside a step or far from it.
struct Window {
    // The interval in which its table follows values, and the extinctions beyond.
    interval: vec2<f32>,
    beyond: vec2<f32>,
    // Number of deviations that its table extends beyond the interval.
    reach: vec2<f32>,
    // First row, and number of rows.
    first_row: u32,
    row_count: u32,
}

// A row of a table.
struct LobeRow {
    first: u32,
    count: u32,
    per_value: f32,
}

// The part of a kernel in a lobe; empty if the extinction is 0.
struct Piece {
    extinction: f32,
    shift: f32,
    width: f32,
}

fn lobe_count() -> u32 {
    return transfer.words[LOBES_FIRST].x;
}

fn lobe(i: u32) -> Lobe {
    let at = LOBES_FIRST + 1u + 3u * i;
    let ends = bitcast<vec4<f32>>(transfer.words[at]);
    let sizes = bitcast<vec4<f32>>(transfer.words[at + 1u]);
    let rows = transfer.words[at + 2u];
    return Lobe(ends.xy, ends.zw, sizes.x, sizes.y, sizes.z, rows.x, rows.y);
}

// Returns whether the lobe contains any of the values from `lo` to `hi`.
fn lobe_meets(lobe: Lobe, lo: f32, hi: f32) -> bool {
    return (lo < lobe.interval.y || lobe.beyond.y > 0.0)
        && (hi > lobe.interval.x || lobe.beyond.x > 0.0);
}

fn lobe_window(i: u32) -> Window {
    let at = LOBES_FIRST + 1u + 3u * MAX_LOBES + 3u * i;
    let ends = bitcast<vec4<f32>>(transfer.words[at]);
    let reach = bitcast<vec4<f32>>(transfer.words[at + 1u]);
    let rows = transfer.words[at + 2u];
    return Window(ends.xy, ends.zw, reach.xy, rows.x, rows.y);
}

fn lobe_row(i: u32) -> LobeRow {
    let words = transfer.words[LOBES_FIRST + 1u + 3u * MAX_LOBES + 3u * MAX_WINDOWS + i];
    return LobeRow(words.x, words.y, bitcast<f32>(words.z));
}

// Interpolates the cells of a row: `inside` cells from the interval's beginning, and `from_first`
// deviations from the first cell.
fn lobe_cell(row: LobeRow, inside: f32, from_first: f32) -> vec4<f32> {
    let place = inside + from_first * LOBE_CELLS_PER_DEVIATION;
    let below = min(u32(max(place, 0.0)), row.count - 2u);
    let share = place - f32(below);
    let rows = LOBES_FIRST + 1u + 3u * MAX_LOBES + 3u * MAX_WINDOWS;
    let at = rows + MAX_LOBE_ROWS + row.first + below;
    let a = bitcast<vec4<f32>>(transfer.words[at]);
    let b = bitcast<vec4<f32>>(transfer.words[at + 1u]);
    return a + (b - a) * share;
}

// Returns the piece of a kernel in a window of a lobe. The kernel's values have this mean and this
// standard deviation, which is above 0 and finite.
fn lobe_piece(lobe: Lobe, window: Window, value: f32, spread: f32) -> Piece {
    let lo = window.interval.x;
    let hi = window.interval.y;
    let nearest = clamp(value, lo, hi);
    let outside = (value - nearest) / spread;
    if !(outside >= -window.reach.x && outside <= window.reach.y) {
        // Beyond an open end the function is constant over the kernel's reach.
        return Piece(select(window.beyond.x, window.beyond.y, outside > 0.0), 0.0, 1.0);
    }
    let last = f32(window.row_count - 1u);
    let row = log2(spread / lobe.first_spread) * LOBE_ROWS_PER_OCTAVE;
    let place = clamp(row, 0.0, last);
    let below = min(u32(place), max(window.row_count, 2u) - 2u);
    let share = place - f32(below);
    let middle = lo + 0.5 * (hi - lo);
    var ends: array<vec4<f32>, 2>;
    for (var n = 0u; n < 2u; n = n + 1u) {
        let entries = lobe_row(window.first_row + below + n);
        let from_middle = (nearest - middle) * (entries.per_value / LOBE_CELLS_PER_DEVIATION);
        ends[n] = lobe_cell(entries, (nearest - lo) * entries.per_value, outside + window.reach.x);
        ends[n].y = ends[n].y - from_middle;
    }
    let cell = ends[0] + (ends[1] - ends[0]) * share;
    // It belongs to other windows.
    if !(cell.w > 0.0) {
        return Piece();
    }
    // A kernel wider than the last row sees a closed lobe as a point.
    var shrink = 1.0;
    if row > last && lobe.beyond.x == 0.0 && lobe.beyond.y == 0.0 {
        shrink = exp_negative((last - row) / LOBE_ROWS_PER_OCTAVE * LN_2);
    }
    // A kernel narrower than the first row changes less.
    let change = min(spread / lobe.first_spread, 1.0);
    let width = MAX_PIECE_WIDTH * exp_negative(min(cell.z, 0.0)) * shrink;
    let log_extinction = min(cell.x - 0.5 * outside * outside, 0.0);
    return Piece(
        lobe.peak * exp_negative(log_extinction) * shrink,
        (cell.y * shrink - outside) * change,
        1.0 + (width - 1.0) * change,
    );
}
