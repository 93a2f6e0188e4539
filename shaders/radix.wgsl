// Stable sort of pairs (key, value) by the keys' low bits, RADIX_BITS of them a pass: digits counted per workgroup,
// prefix sums of the counts (scan.wgsl), places.
// No twin: the stage's is a library's radix sort; tests/frames/gpu_sort.rs holds it to that.

const RADIX: u32 = 1u << RADIX_BITS;
// Consecutive pairs per thread.
const RUN: u32 = RADIX_GROUP / THREADS;
// Rows of words that hold two counters each.
const ROWS: u32 = RADIX / 2u;

struct RadixPlan {
    // Which word of `counts` says how many pairs there are.
    count_index: u32,
    capacity: u32,
}

struct RadixState {
    // Pairs.
    count: u32,
    // Workgroups that have any.
    groups: u32,
    // Counts in `table`.
    table_length: u32,
}

@group(0) @binding(0) var<uniform> plan: RadixPlan;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> new_state: RadixState;
@group(0) @binding(3) var<storage, read_write> new_arguments: array<u32, 3>;

@compute @workgroup_size(1)
fn radix_prepare() {
    let count = min(counts[plan.count_index], plan.capacity);
    let groups = (count + RADIX_GROUP - 1u) / RADIX_GROUP;
    new_state = RadixState(count, groups, RADIX * groups);
    let arguments = folded(groups);
    new_arguments = array<u32, 3>(arguments.x, arguments.y, arguments.z);
}

struct RadixPass {
    // The lowest bit of the digit.
    shift: u32,
}

@group(0) @binding(0) var<uniform> radix_pass: RadixPass;
@group(0) @binding(1) var<storage, read> state: RadixState;
// Four keys or values at a time.
@group(0) @binding(2) var<storage, read> source_keys: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> source_values: array<vec4<u32>>;
// Digit by digit, a count per workgroup; then what lies before them.
@group(0) @binding(4) var<storage, read_write> table: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_values: array<u32>;

fn digit(key: u32) -> u32 {
    return (key >> radix_pass.shift) & (RADIX - 1u);
}

// So many copies of a counter, lest equal digits of neighbours wait for each other.
const COPIES: u32 = 16u;
var<workgroup> histogram: array<atomic<u32>, RADIX * COPIES>;

@compute @workgroup_size(THREADS)
fn radix_count(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let index = group_index(group);
    atomicStore(&histogram[thread], 0u);
    workgroupBarrier();
    for (var part = 0u; part < RUN / 4u; part = part + 1u) {
        let word = index * (RADIX_GROUP / 4u) + part * THREADS + thread;
        if 4u * word < state.count {
            let keys = source_keys[word];
            for (var i = 0u; i < 4u; i = i + 1u) {
                if 4u * word + i < state.count {
                    atomicAdd(&histogram[digit(keys[i]) * COPIES + thread % COPIES], 1u);
                }
            }
        }
    }
    workgroupBarrier();
    if thread < RADIX && index < state.groups {
        var count = 0u;
        for (var copy = 0u; copy < COPIES; copy = copy + 1u) {
            count = count + atomicLoad(&histogram[thread * COPIES + copy]);
        }
        table[thread * state.groups + index] = count;
    }
}

// A counter per thread and digit, those of the digits d and d + ROWS in one word: row d, column `thread`. Later the
// sorted keys, then values: as many.
var<workgroup> shared_words: array<u32, ROWS * THREADS / 32u * 33u>;
// What added to a pair's place in the workgroup makes its place among all, by digit.
var<workgroup> offsets: array<u32, RADIX>;

// Where in `shared_words`: a word of padding after 32 keeps the threads' runs of ROWS words off each other's banks.
fn padded(i: u32) -> u32 {
    return i + i / 32u;
}

// The word of a thread's counter.
fn counter(digit: u32, thread: u32) -> u32 {
    return padded(digit % ROWS * THREADS + thread);
}

// The lowest bit of the counter in its word.
fn half_shift(digit: u32) -> u32 {
    return digit / ROWS * 16u;
}

@compute @workgroup_size(THREADS)
fn radix_scatter(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let index = group_index(group);
    // Pairs of the workgroup, and of the thread: all are its first ones.
    let length = min(state.count - min(index * RADIX_GROUP, state.count), RADIX_GROUP);
    let own = min(length - min(thread * RUN, length), RUN);
    let first_word = (index * RADIX_GROUP + thread * RUN) / 4u;
    var keys: array<u32, RUN>;
    var values: array<u32, RUN>;
    for (var part = 0u; part < RUN / 4u; part = part + 1u) {
        if 4u * part < own {
            let four_keys = source_keys[first_word + part];
            let four_values = source_values[first_word + part];
            for (var i = 0u; i < 4u; i = i + 1u) {
                keys[4u * part + i] = four_keys[i];
                values[4u * part + i] = four_values[i];
            }
        }
    }

    // How many of the thread's pairs before each have its digit.
    var places: array<u32, RUN>;
    for (var row = 0u; row < ROWS; row = row + 1u) {
        shared_words[counter(row, thread)] = 0u;
    }
    for (var i = 0u; i < RUN; i = i + 1u) {
        if i < own {
            let d = digit(keys[i]);
            let at = counter(d, thread);
            let word = shared_words[at];
            places[i] = (word >> half_shift(d)) & 0xffffu;
            shared_words[at] = word + (1u << half_shift(d));
        }
    }
    workgroupBarrier();

    // The counters become sums of those before them, digit by digit: both halves of the words at once, then the upper
    // ones go after all of the lower. No half overflows: the workgroup has RADIX_GROUP pairs.
    var sum = 0u;
    for (var i = 0u; i < ROWS; i = i + 1u) {
        sum = sum + shared_words[padded(thread * ROWS + i)];
    }
    var before = scan_threads(thread, sum);
    before = before + (scan_total << 16u);
    for (var i = 0u; i < ROWS; i = i + 1u) {
        let at = padded(thread * ROWS + i);
        let count = shared_words[at];
        shared_words[at] = before;
        before = before + count;
    }
    workgroupBarrier();

    for (var i = 0u; i < RUN; i = i + 1u) {
        let d = digit(keys[i]);
        places[i] = places[i] + ((shared_words[counter(d, thread)] >> half_shift(d)) & 0xffffu);
    }
    if thread < RADIX && index < state.groups {
        let start = (shared_words[counter(thread, 0u)] >> half_shift(thread)) & 0xffffu;
        offsets[thread] = table[thread * state.groups + index] - start;
    }
    workgroupBarrier();

    // Through workgroup memory, so that neighbours write to neighbouring words.
    for (var i = 0u; i < RUN; i = i + 1u) {
        if i < own {
            shared_words[places[i]] = keys[i];
        }
    }
    workgroupBarrier();
    var destinations: array<u32, RUN>;
    for (var i = 0u; i < RUN; i = i + 1u) {
        let place = i * THREADS + thread;
        if place < length {
            let key = shared_words[place];
            destinations[i] = offsets[digit(key)] + place;
            sorted_keys[destinations[i]] = key;
        }
    }
    workgroupBarrier();
    for (var i = 0u; i < RUN; i = i + 1u) {
        if i < own {
            shared_words[places[i]] = values[i];
        }
    }
    workgroupBarrier();
    for (var i = 0u; i < RUN; i = i + 1u) {
        let place = i * THREADS + thread;
        if place < length {
            sorted_values[destinations[i]] = shared_words[place];
        }
    }
}
