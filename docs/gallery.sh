#!/usr/bin/env bash
# Draws the pictures of gallery.md, each without an option but its file's: docs/gallery.sh PROGRAM DATA
#
# PROGRAM is a built ewa-splat, DATA the folder with the public data that the manifest beside them names. Raw volumes say
# nothing of themselves; the size is that of the page.
set -euo pipefail
program=$(realpath "$1")
data=$(realpath "$2")
cd "$(dirname "$0")/gallery"

file() { printf '%s/%s' "$data" "$1"; }

draw() {
    local name=$1
    shift
    "$program" render "$@" --size 320x320 --backend cpu --out "$name.png"
}

draw engine "$(file volumes/engine_256x256x128_uint8.raw)" --dims 256,256,128
draw rectilinear "$(file rectilinear/RectGrid2.vtk)"
draw bluntfin "$(file curvilinear/bluntfin/bluntfinxyz.bin)"
draw combustor "$(file curvilinear/multicomb_0.vts)"
draw disk "$(file unstructured/disk_out_ref.vtu)"
draw can "$(file unstructured/can.vtu)"
draw chombo "$data"/formats/collections/chombo3d/*.vti
draw halo "$(file particles/halo_low_res.npy)"
draw fluid "$(file particles/bunny_frame_14_7705_particles.vtk)"
draw fruit "$(file splats/fruit_drops_minimal.ply)"
draw helmet "$(file meshes/gltf/FlightHelmet/FlightHelmet.gltf)"
draw shark "$(file formats/meshes/shark.ply)"
