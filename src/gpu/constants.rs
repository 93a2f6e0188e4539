//! Defines the numbers that only the host and the shaders of this back end share;
//! [`shader::prelude`](super::prelude) prints them.

use crate::constants::{SURFACE_LAYERS, TERMINATION_INTERVAL};

/// Threads of a workgroup, except for tiles.
pub(super) const THREADS: u32 = 256;

/// Greatest number of workgroups along one dimension of a dispatch, as WebGPU guarantees it. Shaders rely
/// on it.
pub(super) const MAX_GROUPS: u32 = 65_535;

/// Words that one thread of a prefix sum sums.
pub(super) const SCAN_RUN: u32 = 8;

/// Greatest number of bits of a digit of the radix sort.
pub(super) const RADIX_BITS: u32 = 8;

/// Pairs that one workgroup of the radix sort ranks at a time.
pub(super) const RADIX_TILE: u64 = 8 * THREADS as u64;

/// Greatest number of workgroups of the radix sort. If there are more tiles than groups, each group takes
/// more than one. This is as many as a large graphics card runs at once, and bounds the table of counts:
/// 1 MiB.
pub(super) const RADIX_GROUPS: u64 = 1024;

/// Digits whose counts one workgroup of the radix sort scans.
pub(super) const RADIX_SCANNED: u32 = 8;

/// First word, among a part's arguments, of those of dispatches over its views.
pub(super) const VIEW_ARGUMENTS: u32 = 0;
/// First word of the arguments of dispatches over its classified particles, with a thread each.
pub(super) const PARTICLE_ARGUMENTS: u32 = 3;

/// Stands for a tile's nearest open layer if all layers are composited.
pub(super) const NO_LAYER: u32 = u32::MAX;

/// Stands for no depth on the device: WGSL cannot write infinity.
pub(super) const NO_DEPTH: f32 = f32::MIN;

/// Numbers of the [`Rule`](crate::blocks::Rule)s in the projection.
pub(super) const RULE_KERNEL: u32 = 0;
pub(super) const RULE_PEAK: u32 = 1;
pub(super) const RULE_SURFACE: u32 = 2;
pub(super) const RULE_TRANSLUCENT: u32 = 3;

// Assumptions of shaders/radix.wgsl: a thread per digit, and a word of workgroup memory per pair of a
// tile and for each 32 threads' digits.
const _: () =
    assert!(1 << RADIX_BITS == THREADS && RADIX_TILE == ((THREADS / 32) << RADIX_BITS) as u64);

// Assumptions of shaders/tile/accumulate.
const _: () = assert!(SURFACE_LAYERS == 3 && TERMINATION_INTERVAL == 32);
