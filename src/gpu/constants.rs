//! Numbers that the host and the shaders of this back end share, and no one else;
//! [`shader::prelude`](super::prelude) prints them.

use crate::constants::{SURFACE_LAYERS, TERMINATION_INTERVAL};

/// Threads of a workgroup, but for tiles.
pub(super) const THREADS: u32 = 256;

/// Workgroups along one dimension of a dispatch at most: what WebGPU guarantees. Shaders count on it.
pub(super) const MAX_GROUPS: u32 = 65_535;

/// Words that one thread of a prefix sum sums.
pub(super) const SCAN_RUN: u32 = 8;

/// Bits of a digit of the radix sort at most.
pub(super) const RADIX_BITS: u32 = 8;

/// Pairs that one workgroup of the radix sort ranks at a time.
pub(super) const RADIX_TILE: u64 = 8 * THREADS as u64;

/// Workgroups of the radix sort at most; beyond as many tiles, each takes more than one. They are as
/// many as a large graphics card runs at once, and bound the table of counts: 1 MiB.
pub(super) const RADIX_GROUPS: u64 = 1024;

/// Digits whose counts one workgroup of the radix sort scans.
pub(super) const RADIX_SCANNED: u32 = 8;

/// The first word of the arguments of dispatches over a part's views among a part's arguments.
pub(super) const VIEW_ARGUMENTS: u32 = 0;
/// The same over its classified particles, a thread each.
pub(super) const PARTICLE_ARGUMENTS: u32 = 3;

/// In place of a tile's nearest open layer: all are composited.
pub(super) const NO_LAYER: u32 = u32::MAX;

/// What the device writes where there is no depth: WGSL has no infinity to write down.
pub(super) const NO_DEPTH: f32 = f32::MIN;

/// [`Rule`](crate::blocks::Rule)s as the projection numbers them.
pub(super) const RULE_KERNEL: u32 = 0;
pub(super) const RULE_PEAK: u32 = 1;
pub(super) const RULE_SURFACE: u32 = 2;
pub(super) const RULE_TRANSLUCENT: u32 = 3;

// What shaders/radix.wgsl counts on: a thread per digit, and a word of workgroup memory per pair of
// a tile and for each 32 threads' digits.
const _: () =
    assert!(1 << RADIX_BITS == THREADS && RADIX_TILE == ((THREADS / 32) << RADIX_BITS) as u64);

// What shaders/tile/accumulate counts on.
const _: () = assert!(SURFACE_LAYERS == 3 && TERMINATION_INTERVAL == 32);
