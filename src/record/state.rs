//! Defines the counters and tables that the stages of a frame on a device pass on.

use bytemuck::{Pod, Zeroable};

/// Counters of a frame on the device, over all parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FrameState {
    /// Least distance of a block in view, encoded as a word that grows as the distance falls; 0 for none.
    pub nearest: [u32; 2],
    /// Greatest distance of a block in view, encoded as a word that grows with it; 0 for none.
    pub farthest: [u32; 2],
    /// Distance at which depth keys begin: world units, f64.
    pub near: [u32; 2],
    /// Depth keys per unit of distance, f64.
    pub keys_per_unit: [u32; 2],
    /// Number of particles classified; `u32::MAX` stands for more.
    pub classified_count: u32,
    /// Number of blocks in view, by their filter.
    pub filters: [u32; 7],
}

/// Counters of a part on the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PartState {
    /// Capacity for classified particles, which the host has allocated.
    pub capacity: u32,
    /// Number of blocks in view.
    pub view_count: u32,
    /// `view_count` + 1: the number of counts whose prefix sums are taken.
    pub count_length: u32,
    /// Number of particles that the transfer function leaves visible; `u32::MAX` stands for more.
    pub needed: u32,
    /// Number of visible particles that were classified: all, or none if the capacity is too small.
    pub classified_count: u32,
    /// Number of particles classified in the parts before this one.
    pub first: u32,
}

/// The part whose footprints a dispatch works on.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartIndex {
    /// Number of the part.
    pub index: u32,
}

/// Range of a part's footprints among the footprints of all parts.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartRange {
    /// The global index of its first footprint.
    pub first: u32,
    /// Number of footprints.
    pub count: u32,
}

/// Numbers of footprints of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SortState {
    /// Number of footprints of all parts, visible or not.
    pub count: u32,
    /// Number of footprints that reach a pixel: they come first in depth order.
    pub visible: u32,
    /// Number of visible footprints on the exact path.
    pub exact: u32,
}

/// The range of footprints in depth order, and the band of tiles, that are drawn together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkUniform {
    /// Index of the chunk's first footprint in depth order.
    pub start: u32,
    /// Greatest number of footprints in the chunk.
    pub capacity: u32,
    /// First column and row of the band, in tiles.
    pub band_first: [u32; 2],
    /// Numbers of columns and rows of the band, in tiles.
    pub band_size: [u32; 2],
    /// 1 for the last chunk, 0 for others.
    pub is_last: u32,
    /// Padding to a pair of words.
    pub unused: u32,
}

/// Counts of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkState {
    /// Number of footprints.
    pub length: u32,
    /// Number of prefix sums of their entries: one more than the footprints.
    pub offset_count: u32,
    /// Number of pairs of a tile and a footprint; 0 if they exceeded the capacity.
    pub entries: u32,
    /// Greatest number of pairs of any chunk since the host cleared this word, whether they fitted or
    /// not; `u32::MAX` stands for that many or more.
    pub needed: u32,
}
