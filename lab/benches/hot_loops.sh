#!/usr/bin/env bash
# Checks the loops that are compiled once for each instruction set. Prints the number of their instructions, and of
# those on vectors. Fails if a loop calls a function of the mathematical library: a closure, or a function that was not
# inlined, has then lost the set's features.
#
# After `cargo build --release` on x86-64 Linux: lab/benches/hot_loops.sh [PROGRAM]
set -euo pipefail
program="${1:-target/release/ewa-splat}"
{
    objdump -R "$program"
    objdump -d --no-show-raw-insn -C "$program"
} | awk '
    # Slots of the addresses of library functions.
    $2 ~ /GLOB_DAT|JUMP_SLOT/ { split($3, name, "@"); sub(/^0+/, "", $1); slot[$1] = name[1]; next }
    /^[0-9a-f]+ <.*>:$/ {
        inside = /simd::run_avx/
        if (inside) { where = $1 " " (/avx512/ ? "AVX-512" : "AVX2"); order[++count] = where }
        next
    }
    !inside { next }
    { all[where]++ }
    /[xyz]mm/ && /ps |pd / { vectors[where]++ }
    /call/ && match($0, /# [0-9a-f]+/) {
        called = slot[substr($0, RSTART + 2, RLENGTH - 2)]
        if (called ~ /^(fma|exp|log|pow|floor|ceil|round|rint|trunc|hypot|sin|cos)[0-9a-z]*$/) {
            calls[where] = calls[where] " " called
            failed = 1
        }
    }
    END {
        if (!count) { print "no loops of an instruction set found"; exit 2 }
        for (i = 1; i <= count; i++) {
            where = order[i]
            print where ": " all[where] " instructions, " vectors[where] " of vectors" \
                (calls[where] ? "; CALLS" calls[where] : "")
        }
        exit failed
    }'
