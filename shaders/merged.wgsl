// Runs the numerical functions of merged particles. For the test only.

// Twin: src/gpu/merged.rs.
struct MergedNumbers {
    average: array<f32, 4>,
    slope: f32,
    ein: f32,
    ein_share: f32,
}

override IS_EVEN: bool = false;

@group(0) @binding(0) var<storage, read> transfer: TransferTable;
@group(0) @binding(1) var<storage, read> maxima: TransferMaxima;
@group(0) @binding(2) var<storage, read> pairs: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> results: array<MergedNumbers>;

@compute @workgroup_size(THREADS)
fn merged_numbers(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let i = group_index(group) * THREADS + thread;
    if i >= arrayLength(&pairs) {
        return;
    }
    let pair = pairs[i];
    let size = abs(pair.y);
    let average = classify_spread(pair.x, pair.y, IS_EVEN);
    results[i] = MergedNumbers(
        array<f32, 4>(average.x, average.y, average.z, average.w),
        max_slope(pair.x, pair.x + size),
        ein(size),
        ein_share(size),
    );
}
