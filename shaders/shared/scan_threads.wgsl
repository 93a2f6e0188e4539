// Computes prefix sums over the threads of a workgroup.

// Length of a row of threads. There are as many rows: sums of rows and sums within a row are short loops,
// with few barriers.
const SCAN_ROW: u32 = 16u;

var<workgroup> scan_shared: array<u32, THREADS>;
var<workgroup> scan_rows: array<u32, THREADS / SCAN_ROW>;
// The sum over all threads, after `scan_threads`.
var<workgroup> scan_total: u32;

// Returns a + b, or the greatest word if the sum is larger: an overflow never wraps around.
fn add_saturating(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

// Returns the sum of the values of the threads before this one. Every thread of the workgroup must call
// it.
fn scan_threads(thread: u32, value: u32) -> u32 {
    // The last call's readers have finished.
    workgroupBarrier();
    scan_shared[thread] = value;
    workgroupBarrier();
    if thread < THREADS / SCAN_ROW {
        var sum = 0u;
        for (var i = 0u; i < SCAN_ROW; i = i + 1u) {
            // Each thread begins at another position of its row, to avoid bank conflicts.
            sum = add_saturating(sum, scan_shared[thread * SCAN_ROW + (i + thread) % SCAN_ROW]);
        }
        scan_rows[thread] = sum;
    }
    workgroupBarrier();
    var before_this = 0u;
    for (var row = 0u; row < thread / SCAN_ROW; row = row + 1u) {
        before_this = add_saturating(before_this, scan_rows[row]);
    }
    for (var other = thread - thread % SCAN_ROW; other < thread; other = other + 1u) {
        before_this = add_saturating(before_this, scan_shared[other]);
    }
    if thread == THREADS - 1u {
        scan_total = add_saturating(before_this, value);
    }
    workgroupBarrier();
    return before_this;
}
