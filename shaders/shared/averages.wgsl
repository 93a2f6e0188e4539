// Evaluates a transfer function, and its averages over intervals of values. The stage declares
// `transfer`. Twins: src/scene/transfer_function.rs, src/scene/transfer_function/averages.rs.

struct TransferTable {
    low: f32,
    scale: f32,
    // Units of the integrals: of the first three, of the last.
    colour_unit: f32,
    extinction_unit: f32,
    // The entries, f32: red, green, blue, extinction. Then as many integrals of the averaged quantities
    // from the first entry to each, i32.
    words: array<vec4<u32>>,
}

fn table_entry(i: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(transfer.words[i]);
}

// Returns linear red, green, blue and the extinction [1/length] of a value.
//
// Values outside the range, infinities included, get the colour of its ends; NaN is transparent.
fn classify(value: f32) -> vec4<f32> {
    if is_nan(value) {
        return vec4<f32>(0.0);
    }
    let p = table_position(value, transfer.low, transfer.scale);
    let a = table_entry(p.entry);
    let b = table_entry(p.entry + 1u);
    return a + (b - a) * p.fraction;
}

// Returns the average colour and extinction of values evenly distributed over value - spread to value +
// spread. If `is_even`, colours are not weighted with their extinctions.
fn classify_spread(value: f32, spread: f32, is_even: bool) -> vec4<f32> {
    if is_nan(value) || is_nan(spread) {
        return vec4<f32>(0.0);
    }
    let place = table_place(value, transfer.low, transfer.scale);
    let x = clamp(place, -FAR_ENTRIES, FAR_ENTRIES);
    let half = min(min(abs(spread), LARGEST) * transfer.scale, FAR_ENTRIES);
    let range_from = x - half;
    let range_to = x + half;
    let first = table_segment(range_from);
    let last = table_segment(range_to);
    let i = first.entry;
    let j = last.entry;
    let s = first.fraction;
    let t = last.fraction;
    var width = range_to - range_from;
    if i == j {
        // The same number. Fused with the product above, the difference would not be that of the fractions.
        width = (t - s) + max(-range_from, 0.0) + max(range_to - f32(TABLE_LAST), 0.0);
    }
    if i == j && (s == t || width <= 0.0) {
        return weighted_average(average_part(i, s, t, is_even), is_even);
    }
    var sum = vec4<f32>(0.0);
    if i == j {
        sum = average_part(i, s, t, is_even) * ((t - s) / width);
    } else {
        sum = average_part(i, s, 1.0, is_even) * ((1.0 - s) / width);
        let between = bitcast<vec4<i32>>(transfer.words[CLASSIFICATION_TABLE_LEN + j])
            - bitcast<vec4<i32>>(transfer.words[CLASSIFICATION_TABLE_LEN + i + 1u]);
        let units = vec4<f32>(vec3<f32>(transfer.colour_unit), transfer.extinction_unit);
        sum = sum + vec4<f32>(between) * units * (1.0 / width);
        sum = sum + average_part(j, 0.0, t, is_even) * (t / width);
    }
    if range_from < 0.0 {
        let length = min(range_to, 0.0) - range_from;
        sum = sum + average_part(0u, 0.0, 0.0, is_even) * (length / width);
    }
    if range_to > f32(TABLE_LAST) {
        let length = range_to - max(range_from, f32(TABLE_LAST));
        sum = sum + average_part(TABLE_LAST - 1u, 1.0, 1.0, is_even) * (length / width);
    }
    return weighted_average(sum, is_even);
}

// Returns the average from fraction `s` to fraction `t` of the way from entry `i` to the next.
fn average_part(i: u32, s: f32, t: f32, is_even: bool) -> vec4<f32> {
    let a = table_entry(i);
    let b = table_entry(i + 1u);
    let middle = 0.5 * (s + t);
    let length = t - s;
    let difference = b - a;
    let mean = a + difference * middle;
    if is_even {
        return mean;
    }
    // Average of the product of two linear functions.
    let curvature = difference.w * (length * length * (1.0 / 12.0));
    return vec4<f32>(mean.xyz * mean.w + difference.xyz * curvature, mean.w);
}

// Returns the colour and the extinction of averages.
fn weighted_average(sum: vec4<f32>, is_even: bool) -> vec4<f32> {
    if is_even {
        return sum;
    }
    if is_positive(sum.w) {
        return vec4<f32>(sum.xyz / sum.w, sum.w);
    }
    return vec4<f32>(0.0);
}
