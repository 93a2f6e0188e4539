// Finds the position of a value in a transfer function's table. Twin: src/scene/transfer_function.rs.

const TABLE_LAST: u32 = CLASSIFICATION_TABLE_LEN - 1u;

struct TablePosition {
    // The entry below, at most the last but one.
    entry: u32,
    // The fraction of the way to the next, 0 to 1.
    fraction: f32,
}

// Returns the position, in entries, of a value that is not NaN, in a table that begins at `low` with
// `scale` entries per unit. It may lie beyond the table, and be infinite.
fn table_place(value: f32, low: f32, scale: f32) -> f32 {
    // Clamps infinities and values that may overflow: the table's range ends at a quarter of the greatest
    // number.
    const GREATEST: f32 = 1.7014117e38;
    return (clamp(value, -GREATEST, GREATEST) - low) * scale;
}

// Returns the segment of a position in the table.
fn table_segment(place: f32) -> TablePosition {
    let x = clamp(place, 0.0, f32(TABLE_LAST));
    let entry = min(u32(x), TABLE_LAST - 1u);
    return TablePosition(entry, x - f32(entry));
}

// Returns the segment of a value that is not NaN.
fn table_position(value: f32, low: f32, scale: f32) -> TablePosition {
    return table_segment(table_place(value, low, scale));
}
