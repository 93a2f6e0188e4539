// Prefix sums over the threads of a workgroup.

var<workgroup> scan_shared: array<u32, THREADS>;
// The sum over all threads, after `scan_threads`.
var<workgroup> scan_total: u32;

// a + b, or the greatest word where that is more: an overflow is seen, never wrapped.
fn add_saturating(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

// The sum of the values of the threads before this one. Every thread of the workgroup must call it.
fn scan_threads(thread: u32, value: u32) -> u32 {
    // The last call's readers are done.
    workgroupBarrier();
    scan_shared[thread] = value;
    workgroupBarrier();
    var sum = value;
    for (var step = 1u; step < THREADS; step = step * 2u) {
        var before = 0u;
        if thread >= step {
            before = scan_shared[thread - step];
        }
        workgroupBarrier();
        sum = add_saturating(sum, before);
        scan_shared[thread] = sum;
        workgroupBarrier();
    }
    if thread == THREADS - 1u {
        scan_total = sum;
    }
    var before_this = 0u;
    if thread > 0u {
        before_this = scan_shared[thread - 1u];
    }
    workgroupBarrier();
    return before_this;
}
