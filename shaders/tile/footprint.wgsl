// Unpacks footprints for the rasterisers. Only this file depends on the layout of a footprint's words.

// Four vectors each, as `Footprint` lays them out: `centre_px` and `form_p`; `form_r`, `tau` and
// `cutoff_squared`; `carried` and `depth`; `path`, `columns`, `rows` and `key`.
@group(0) @binding(4) var<storage, read> footprints: array<vec4<u32>>;

// Footprints of the batch, which all threads of the tile read.
var<workgroup> batch: array<vec4<u32>, 4u * TERMINATION_INTERVAL>;

struct TileFootprint {
    centre_px: vec2<f32>,
    form_p: vec2<f32>,
    form_r: vec2<f32>,
    // For a kernel its optical depth at the centre, for a surfel its weight there.
    peak: f32,
    cutoff_squared: f32,
    // A colour, a value of the field or a sign.
    carried: vec3<f32>,
    // For a kernel the centre's z, for a surfel its greatest inverse depth.
    depth: f32,
    path: u32,
}

fn unpacked(
    place: vec4<f32>,
    form: vec4<f32>,
    carried: vec4<f32>,
    path: u32,
) -> TileFootprint {
    return TileFootprint(
        place.xy,
        place.zw,
        form.xy,
        form.z,
        form.w,
        carried.xyz,
        carried.w,
        path,
    );
}

// Footprint n of the batch.
fn footprint_of_batch(n: u32) -> TileFootprint {
    return unpacked(
        bitcast<vec4<f32>>(batch[4u * n]),
        bitcast<vec4<f32>>(batch[4u * n + 1u]),
        bitcast<vec4<f32>>(batch[4u * n + 2u]),
        batch[4u * n + 3u].x,
    );
}

// Footprint i of the chunk.
fn footprint_of_chunk(i: u32) -> TileFootprint {
    return unpacked(
        bitcast<vec4<f32>>(footprints[4u * i]),
        bitcast<vec4<f32>>(footprints[4u * i + 1u]),
        bitcast<vec4<f32>>(footprints[4u * i + 2u]),
        footprints[4u * i + 3u].x,
    );
}

// The depth key of footprint i of the chunk.
fn key_of_chunk(i: u32) -> u32 {
    return footprints[4u * i + 3u].w;
}

// Returns whether a pixel lies in the box of footprint n of the batch. Most threads need no more of the
// footprint.
fn is_in_box(n: u32, at: vec2<u32>) -> bool {
    let columns = batch[4u * n + 3u].y;
    let rows = batch[4u * n + 3u].z;
    return at.y >= (rows & 0xffffu) && at.y < (rows >> 16u)
        && at.x >= (columns & 0xffffu) && at.x < (columns >> 16u);
}

// Returns Q of the triangular form, at `d` from the centre.
fn form_at(footprint: TileFootprint, d: vec2<f32>) -> f32 {
    let p = footprint.form_p.x * d.x + footprint.form_p.y * d.y;
    let r = footprint.form_r.x * d.x + footprint.form_r.y * d.y;
    return p * p + r * r;
}

// Returns exp(-Q/2) within the cut-off.
fn falloff(q: f32) -> f32 {
    // A compiler that assumes finite numbers may drop the guard of the caller; with this limit the pixel
    // stays finite.
    return exp_minus_half(min(q, 49.0));
}

fn is_within(footprint: TileFootprint, q: f32) -> bool {
    return is_finite(q) && q <= footprint.cutoff_squared;
}
