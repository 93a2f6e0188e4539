// Computes exclusive prefix sums of u32, in place: sums per workgroup, their prefix sums, and the rest. A
// sum beyond 32 bits becomes the greatest word. No twin; tests/frames/gpu_stages.rs compares it with a
// loop.

// Number of words to sum, written by the stage that filled them.
@group(0) @binding(0) var<storage, read> scan_length: array<u32>;
@group(0) @binding(1) var<storage, read_write> scan_words: array<u32>;
// One sum per workgroup, then its prefix sum; last the total.
@group(0) @binding(2) var<storage, read_write> scan_sums: array<u32>;

// Arguments of a dispatch over the words in use.
@group(0) @binding(3) var<storage, read_write> scan_arguments: array<u32, 3>;

// Word of `scan_length` that is read.
override LENGTH_INDEX: u32 = 0u;

// Words per workgroup.
const SCAN_GROUP: u32 = THREADS * SCAN_RUN;

fn scan_groups() -> u32 {
    return (scan_length[LENGTH_INDEX] + SCAN_GROUP - 1u) / SCAN_GROUP;
}

@compute @workgroup_size(1)
fn scan_prepare() {
    let arguments = folded(scan_groups());
    scan_arguments = array<u32, 3>(arguments.x, arguments.y, arguments.z);
}

// Returns the sum of a thread's words, which begin at `first`.
fn sum_of_run(first: u32, length: u32) -> u32 {
    var sum = 0u;
    for (var i = first; i < min(first + SCAN_RUN, length); i = i + 1u) {
        sum = add_saturating(sum, scan_words[i]);
    }
    return sum;
}

@compute @workgroup_size(THREADS)
fn scan_reduce(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let length = scan_length[LENGTH_INDEX];
    let index = group_index(group);
    _ = scan_threads(thread, sum_of_run((index * THREADS + thread) * SCAN_RUN, length));
    if thread == 0u && index * SCAN_GROUP < length {
        scan_sums[index] = scan_total;
    }
}

// A single workgroup.
@compute @workgroup_size(THREADS)
fn scan_sums_of_groups(@builtin(local_invocation_index) thread: u32) {
    let count = scan_groups();
    // Each thread owns a run.
    let run = (count + THREADS - 1u) / THREADS;
    let first = min(thread * run, count);
    let end = min(first + run, count);
    var sum = 0u;
    for (var i = first; i < end; i = i + 1u) {
        sum = add_saturating(sum, scan_sums[i]);
    }
    var before = scan_threads(thread, sum);
    for (var i = first; i < end; i = i + 1u) {
        let own = scan_sums[i];
        scan_sums[i] = before;
        before = add_saturating(before, own);
    }
    if thread == 0u {
        scan_sums[count] = scan_total;
    }
}

@compute @workgroup_size(THREADS)
fn scan_apply(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let length = scan_length[LENGTH_INDEX];
    let index = group_index(group);
    let first = (index * THREADS + thread) * SCAN_RUN;
    var before = scan_threads(thread, sum_of_run(first, length));
    if index * SCAN_GROUP < length {
        before = add_saturating(before, scan_sums[index]);
    }
    for (var i = first; i < min(first + SCAN_RUN, length); i = i + 1u) {
        let own = scan_words[i];
        scan_words[i] = before;
        before = add_saturating(before, own);
    }
}
