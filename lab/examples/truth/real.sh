#!/bin/sh
# Compares renderings of public data sets, made in several ways, with the integral of their own field
# (`--reference data`).
#
#     lab/examples/truth/real.sh DATA OUT [NAME...]
#
# DATA is the folder of the files named below. The script writes an image of each way to OUT, as .npy and .png. It
# prints the rows of docs/truth.md: RMSE and 99.9th percentile over premultiplied linear RGBA, in levels of 255, and
# milliseconds. Reference images that are in OUT already are used again. The variable EWA names another program than
# the one built here, SIZE another size, and WAYS some of the ways.
#
# Cameras are given explicitly: a fitted camera would follow the visible part, which is larger if kernels lie beyond
# the boundary.
set -eu
cd "$(dirname "$0")/../.."
data=$1 out=$2
shift 2
names=${*:-nucleon engine engine-near bluntfin multicomb disk_out_ref}
size=${SIZE:-256x256}
if [ -z "${EWA:-}" ]; then
    cargo build --release --quiet --bin ewa-splat
    EWA=${CARGO_TARGET_DIR:-target}/release/ewa-splat
fi
mkdir -p "$out"

# Renders and prints a row. Arguments: name, way, options.
row() {
    name=$1 way=$2
    shift 2
    case " ${WAYS:-$way} " in *" $way "*) ;; *) return ;; esac
    to=$out/$name-$way
    # shellcheck disable=SC2086
    "$EWA" render $input $camera --transfer-function "lab/examples/truth/transfer/$name.json" --size "$size" --backend cpu \
        --frames 3 --stats "$to.json" --out "$to.npy" "$@" >/dev/null
    # shellcheck disable=SC2086
    "$EWA" render $input $camera --transfer-function "lab/examples/truth/transfer/$name.json" --size "$size" \
        --backend cpu --out "$to.png" "$@" >/dev/null
    "$EWA" compare "$out/$name-truth.npy" "$to.npy" --json >"$to-errors.json"
    "$EWA" compare "$out/$name-truth.npy" "$to.npy" --difference "$to-difference.png" >/dev/null
    python3 - "$name" "$way" "$to" <<'PY'
import json, sys
name, way, to = sys.argv[1:]
errors, stats = json.load(open(to + "-errors.json")), json.load(open(to + ".json"))
print(f"| {name} | {way} | {255 * errors['rmse']:.2f} / {255 * errors['p999']:.1f} "
      f"| {stats['times_ms']['frame']:.0f} | {stats['footprints']} |", flush=True)
PY
}

echo "| data | way | from the data | ms | kernels |"
echo "|---|---|---|---|---|"
for name in $names; do
    case $name in
    nucleon)
        input="$data/volumes/nucleon_41x41x41_uint8.raw --dims 41,41,41 --type u8"
        camera="--eye 60,-50,60 --target 20,20,20"
        ;;
    engine | engine-near)
        input="$data/volumes/engine_256x256x128_uint8.raw --dims 256,256,128 --type u8"
        camera="--eye 350,-250,330 --target 127.5,127.5,63.5"
        ;;
    bluntfin)
        input="$data/curvilinear/bluntfin/bluntfinxyz.bin --field density"
        camera="--eye -10,-12,9 --target 1,2,1.5"
        ;;
    multicomb)
        input="$data/curvilinear/multicomb_0.vts --field Density"
        camera="--eye 16,-16,36 --target 3.2,0,28"
        ;;
    disk_out_ref)
        input="$data/unstructured/disk_out_ref.vtu --field Temp"
        camera="--eye 18,-30,14 --target 0,0,0"
        ;;
    *) echo "$name: none of nucleon, engine, engine-near, bluntfin, multicomb, disk_out_ref" >&2 && exit 2 ;;
    esac
    if [ ! -f "$out/$name-truth.npy" ]; then
        # shellcheck disable=SC2086
        "$EWA" render $input $camera --transfer-function "lab/examples/truth/transfer/$name.json" --size "$size" \
            --reference=data --tolerance 1e-3 --low-pass 0.15 --out "$out/$name-truth.npy"
    fi
    # One kernel per sample, one sample a pixel.
    one="--refine off --opaque-edges off"
    # shellcheck disable=SC2086
    {
        row "$name" particle-1 --classify particle --low-pass 1 --boundary soft $one
        row "$name" particle --classify particle --boundary soft $one
        row "$name" soft --boundary soft $one
        row "$name" one $one
        row "$name" post --composite slabs --post-classification --boundary soft $one
        row "$name" sharp-post --composite slabs --post-classification --boundary sharp $one
    }
    row "$name" default
    row "$name" finer --tolerance 0.002
done
