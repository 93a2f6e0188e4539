// Sorts pairs (key, value) stably by bits of the keys, one digit per pass, least first. A pass is three
// dispatches: it counts digits per workgroup, computes prefix sums of the counts, and places the pairs.
// No twin: the CPU uses a library's radix sort; tests/frames/gpu_sort.rs compares the two.

// Greatest number of digits: one per thread.
const RADIX: u32 = 1u << RADIX_BITS;

struct RadixPass {
    // Lowest bit of the digit.
    shift: u32,
    // Number of digits: a power of two.
    digits: u32,
    // Word of `counts` with the number of pairs.
    count_index: u32,
    capacity: u32,
}

@group(0) @binding(0) var<uniform> radix_pass: RadixPass;
@group(0) @binding(1) var<storage, read> counts: array<u32>;

fn digit(key: u32) -> u32 {
    return (key >> radix_pass.shift) & (radix_pass.digits - 1u);
}

fn pair_count() -> u32 {
    return min(counts[radix_pass.count_index], radix_pass.capacity);
}

// Returns the number of pairs of a workgroup: as many tiles as needed to have at most RADIX_GROUPS
// workgroups, so that their counts stay few.
fn group_length(count: u32) -> u32 {
    let tiles = max((count + RADIX_TILE - 1u) / RADIX_TILE, 1u);
    return (tiles + RADIX_GROUPS - 1u) / RADIX_GROUPS * RADIX_TILE;
}

// Returns the number of workgroups that have pairs.
fn group_count(count: u32) -> u32 {
    let length = group_length(count);
    return (count + length - 1u) / length;
}

// Arguments of a dispatch over the workgroups that have pairs.
@group(0) @binding(2) var<storage, read_write> new_arguments: array<u32, 3>;

@compute @workgroup_size(1)
fn radix_prepare() {
    new_arguments = array<u32, 3>(group_count(pair_count()), 1u, 1u);
}

// A count per workgroup for each digit; later the sum of the counts of the workgroups before.
@group(0) @binding(2) var<storage, read_write> new_table: array<u32>;
// Four keys at a time.
@group(0) @binding(3) var<storage, read> four_keys: array<vec4<u32>>;

// Number of copies of a counter, so that equal digits of neighbours do not wait for each other.
const COPIES: u32 = 8u;
var<workgroup> histogram: array<atomic<u32>, RADIX * COPIES>;

@compute @workgroup_size(THREADS)
fn radix_count(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let count = pair_count();
    let groups = group_count(count);
    for (var i = thread; i < RADIX * COPIES; i = i + THREADS) {
        atomicStore(&histogram[i], 0u);
    }
    workgroupBarrier();
    let first = group.x * group_length(count);
    let end = first + min(group_length(count), count - first);
    for (var word = first / 4u + thread; 4u * word < end; word = word + THREADS) {
        let keys = four_keys[word];
        for (var i = 0u; i < 4u; i = i + 1u) {
            if 4u * word + i < end {
                atomicAdd(&histogram[digit(keys[i]) * COPIES + thread % COPIES], 1u);
            }
        }
    }
    workgroupBarrier();
    if thread < radix_pass.digits {
        var sum = 0u;
        for (var copy = 0u; copy < COPIES; copy = copy + 1u) {
            sum = sum + atomicLoad(&histogram[thread * COPIES + copy]);
        }
        new_table[thread * groups + group.x] = sum;
    }
}

// Number of pairs of each digit.
@group(0) @binding(3) var<storage, read_write> new_totals: array<u32>;

// Number of threads that scan a digit's counts.
const SCANNERS: u32 = THREADS / RADIX_SCANNED;
var<workgroup> run_sums: array<u32, THREADS>;

@compute @workgroup_size(THREADS)
fn radix_scan(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let groups = group_count(pair_count());
    let own_digit = group.x * RADIX_SCANNED + thread / SCANNERS;
    // Each thread has a run of the digit's counts.
    let scanner = thread % SCANNERS;
    let run = (groups + SCANNERS - 1u) / SCANNERS;
    let first = own_digit * groups + min(scanner * run, groups);
    var end = own_digit * groups + min((scanner + 1u) * run, groups);
    if own_digit >= radix_pass.digits {
        end = first;
    }
    var sum = 0u;
    for (var i = first; i < end; i = i + 1u) {
        sum = sum + new_table[i];
    }
    run_sums[thread] = sum;
    workgroupBarrier();
    var before = 0u;
    for (var other = thread - scanner; other < thread; other = other + 1u) {
        before = before + run_sums[other];
    }
    for (var i = first; i < end; i = i + 1u) {
        let count = new_table[i];
        new_table[i] = before;
        before = before + count;
    }
    if scanner == SCANNERS - 1u && own_digit < radix_pass.digits {
        new_totals[own_digit] = before;
    }
}

@group(0) @binding(2) var<storage, read> table: array<u32>;
@group(0) @binding(3) var<storage, read> source_keys: array<u32>;
@group(0) @binding(4) var<storage, read> source_values: array<u32>;
@group(0) @binding(5) var<storage, read> totals: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> sorted_values: array<u32>;

// Number of pairs of a tile per thread.
const RUN: u32 = RADIX_TILE / THREADS;
// Number of threads that mark a digit in one word, a bit each: a row. A row has consecutive pairs of the
// tile, ROW at a time.
const ROW: u32 = 32u;
const ROWS: u32 = THREADS / ROW;

// For each row, a word per digit: a bit for each of the row's threads with a pair of that digit. Later
// the tile's keys, then its values, in order; the sizes are equal.
var<workgroup> shared_words: array<atomic<u32>, ROWS * RADIX>;
// Number of pairs of a row per digit, with two rows in one word. None overflows: a tile has RADIX_TILE
// pairs. Later the position in the tile of a row's first pair of that digit.
var<workgroup> row_counts: array<atomic<u32>, ROWS / 2u * RADIX>;
// For each digit: offset from a pair's position in the tile to its global position.
var<workgroup> offsets: array<u32, RADIX>;

// Returns the word of a row's count, and its lowest bit in the word.
fn row_word(row: u32, digit: u32) -> u32 {
    return row / 2u * RADIX + digit;
}

fn row_shift(row: u32) -> u32 {
    return row % 2u * 16u;
}

fn row_count(row: u32, digit: u32) -> u32 {
    return (atomicLoad(&row_counts[row_word(row, digit)]) >> row_shift(row)) & 0xffffu;
}

@compute @workgroup_size(THREADS)
fn radix_scatter(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let count = pair_count();
    let groups = group_count(count);
    let row = thread / ROW;
    let bit = 1u << (thread % ROW);
    // The thread's first pair in a tile.
    let first_own = row * ROW * RUN + thread % ROW;

    // Position of the next pair of the digit `thread`: after all smaller digits and after those of the
    // workgroups before.
    var total = 0u;
    if thread < radix_pass.digits {
        total = totals[thread];
    }
    var next = scan_threads(thread, total);
    if thread < radix_pass.digits {
        next = next + table[thread * groups + group.x];
    }

    let first = group.x * group_length(count);
    let end = first + min(group_length(count), count - first);
    for (var tile = first; tile < end; tile = tile + RADIX_TILE) {
        let length = min(end - tile, RADIX_TILE);
        var keys: array<u32, RUN>;
        var values: array<u32, RUN>;
        for (var i = 0u; i < RUN; i = i + 1u) {
            let own = first_own + i * ROW;
            if own < length {
                keys[i] = source_keys[tile + own];
                values[i] = source_values[tile + own];
            }
        }
        // The previous tile's readers have finished.
        workgroupBarrier();
        for (var i = thread; i < ROWS * RADIX; i = i + THREADS) {
            atomicStore(&shared_words[i], 0u);
        }
        for (var i = thread; i < ROWS / 2u * RADIX; i = i + THREADS) {
            atomicStore(&row_counts[i], 0u);
        }
        workgroupBarrier();

        // Number of earlier pairs in the row with the same digit: those of earlier iterations, plus the
        // lower bits.
        var places: array<u32, RUN>;
        for (var i = 0u; i < RUN; i = i + 1u) {
            let has_pair = first_own + i * ROW < length;
            let d = digit(keys[i]);
            let at = row * RADIX + d;
            if has_pair {
                atomicOr(&shared_words[at], bit);
            }
            workgroupBarrier();
            var marked = 0u;
            if has_pair {
                marked = atomicLoad(&shared_words[at]);
                places[i] = row_count(row, d) + countOneBits(marked & (bit - 1u));
            }
            workgroupBarrier();
            // The first pair of its digit counts for all.
            if has_pair && (marked & (bit - 1u)) == 0u {
                atomicAdd(&row_counts[row_word(row, d)], countOneBits(marked) << row_shift(row));
                atomicStore(&shared_words[at], 0u);
            }
            workgroupBarrier();
        }

        // For the digit `thread`: turns the rows' counts into sums of the rows before them.
        var sum = 0u;
        for (var i = thread; i < ROWS / 2u * RADIX; i = i + RADIX) {
            let two = atomicLoad(&row_counts[i]);
            sum = sum + (two & 0xffffu) + (two >> 16u);
        }
        let start = scan_threads(thread, sum);
        var before = start;
        for (var i = thread; i < ROWS / 2u * RADIX; i = i + RADIX) {
            let two = atomicLoad(&row_counts[i]);
            let second = before + (two & 0xffffu);
            atomicStore(&row_counts[i], before | (second << 16u));
            before = second + (two >> 16u);
        }
        offsets[thread] = next - start;
        next = next + sum;
        workgroupBarrier();

        // Through workgroup memory, so that neighbours write to neighbouring words.
        for (var i = 0u; i < RUN; i = i + 1u) {
            if first_own + i * ROW < length {
                places[i] = places[i] + row_count(row, digit(keys[i]));
                atomicStore(&shared_words[places[i]], keys[i]);
            }
        }
        workgroupBarrier();
        var destinations: array<u32, RUN>;
        for (var i = 0u; i < RUN; i = i + 1u) {
            let place = i * THREADS + thread;
            if place < length {
                let key = atomicLoad(&shared_words[place]);
                destinations[i] = offsets[digit(key)] + place;
                sorted_keys[destinations[i]] = key;
            }
        }
        workgroupBarrier();
        for (var i = 0u; i < RUN; i = i + 1u) {
            if first_own + i * ROW < length {
                atomicStore(&shared_words[places[i]], values[i]);
            }
        }
        workgroupBarrier();
        for (var i = 0u; i < RUN; i = i + 1u) {
            let place = i * THREADS + thread;
            if place < length {
                sorted_values[destinations[i]] = atomicLoad(&shared_words[place]);
            }
        }
    }
}
