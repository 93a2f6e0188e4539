// Looks up the greatest extinctions and slopes of a transfer function over runs of entries. The stage
// declares `maxima`. Twins: src/scene/transfer_function/maxima.rs,
// src/scene/transfer_function/averages.rs.

// A lobe of the function: see lobes.wgsl.
struct LobeRange {
    interval: array<f32, 2>,
    // 1 for each side on which the lobe extends to infinity.
    is_open: array<f32, 2>,
    threshold: f32,
}

struct TransferMaxima {
    low: f32,
    scale: f32,
    // Number of lobes; 0 if kernels are classified by their values alone.
    lobe_count: f32,
    lobes: array<LobeRange, MAX_LOBES>,
    // Row p: the greatest extinction of entries i .. i + 2^p. After the last row follow the same rows for
    // slopes; entry i is the slope from entry i to the next.
    rows: array<f32>,
}

// Returns the start of row p: row q has CLASSIFICATION_TABLE_LEN + 1 - 2^q entries.
fn maxima_row(p: u32) -> u32 {
    return p * (CLASSIFICATION_TABLE_LEN + 1u) + 1u - (1u << p);
}

// Returns the first and the last entry from which values from `lo` to `hi` are interpolated; all entries
// if an end is NaN. Twin: `entries`.
fn maxima_entries(lo: f32, hi: f32) -> vec2<u32> {
    if is_nan(lo) || is_nan(hi) {
        return vec2<u32>(0u, TABLE_LAST);
    }
    let is_swapped = lo > hi;
    let first = table_position(select(lo, hi, is_swapped), maxima.low, maxima.scale).entry;
    let last = table_position(select(hi, lo, is_swapped), maxima.low, maxima.scale).entry + 1u;
    return vec2<u32>(first, last);
}

// Returns the greatest of entries `first` to `last`, none of them negative, in the rows from `start` on.
fn greatest_entry(start: u32, first: u32, last: u32) -> f32 {
    let level = firstLeadingBit(last - first + 1u);
    let row = start + maxima_row(level);
    let a = bitcast<u32>(maxima.rows[row + first]);
    let b = bitcast<u32>(maxima.rows[row + last + 1u - (1u << level)]);
    return bitcast<f32>(max(a, b));
}

// Returns a bound on the extinction between the values lo and hi.
fn max_extinction(lo: f32, hi: f32) -> f32 {
    let entries = maxima_entries(lo, hi);
    return greatest_entry(0u, entries.x, entries.y) * MAXIMUM_ROUNDING;
}

// Returns a bound on the rate, per unit of value, at which the averaged quantity changes between the
// values lo and hi.
fn max_slope(lo: f32, hi: f32) -> f32 {
    let entries = maxima_entries(lo, hi);
    return greatest_entry(maxima_row(TABLE_LEVELS), entries.x, entries.y - 1u);
}

// Returns the greatest spread of values at which every lobe that meets the values lo to hi classifies
// kernels by their values alone. Twin: `Lobes::threshold`.
fn lobe_threshold(lo: f32, hi: f32) -> f32 {
    var least = LARGEST;
    for (var i = 0u; i < u32(maxima.lobe_count); i = i + 1u) {
        let lobe = maxima.lobes[i];
        let meets = (lo < lobe.interval[1] || lobe.is_open[1] > 0.0)
            && (hi > lobe.interval[0] || lobe.is_open[0] > 0.0);
        if meets {
            least = min(least, lobe.threshold);
        }
    }
    return least;
}
