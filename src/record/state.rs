//! What the stages of a frame on a device count and pass on.

use bytemuck::{Pod, Zeroable};

/// What the stages of a frame on the device know of all parts together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FrameState {
    /// The least distance of a block in view, as a word that is the greater the nearer; 0 for
    /// none.
    pub nearest: [u32; 2],
    /// The greatest distance, as a word in the order of distances; 0 for none.
    pub farthest: [u32; 2],
    /// Where depth keys begin: world units, f64.
    pub near: [u32; 2],
    /// Depth keys per unit of distance, f64.
    pub keys_per_unit: [u32; 2],
    /// Particles classified; `u32::MAX` stands for more.
    pub classified_count: u32,
    /// Blocks in view, by their filter.
    pub filters: [u32; 7],
}

/// What the stages of a frame on the device know of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PartState {
    /// Capacity for classified particles: what the host has allocated.
    pub capacity: u32,
    /// Blocks in view.
    pub view_count: u32,
    /// One more than that: the counts whose prefix sums are taken.
    pub count_length: u32,
    /// Particles that the transfer function leaves visible; `u32::MAX` stands for more.
    pub needed: u32,
    /// How many of them were classified: all, or none where the capacity is too small.
    pub classified_count: u32,
    /// How many of the parts before were classified.
    pub first: u32,
}

/// Which part of the frame's footprints a dispatch works on.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartIndex {
    /// Its number.
    pub index: u32,
}

/// Where the footprints of a part lie among those of all parts.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartRange {
    /// The global index of its first footprint.
    pub first: u32,
    /// How many it has.
    pub count: u32,
}

/// How many footprints a frame has.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SortState {
    /// Of all parts, visible or not.
    pub count: u32,
    /// Those that reach a pixel: the first ones in depth order.
    pub visible: u32,
    /// Of these, on the exact path.
    pub exact: u32,
}

/// Which footprints in depth order, and which tiles of the image, are drawn together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkUniform {
    /// The place of the chunk's first footprint in depth order.
    pub start: u32,
    /// Footprints of the chunk at most.
    pub capacity: u32,
    /// First column and row of the band, tiles.
    pub band_first: [u32; 2],
    /// Columns and rows of the band, tiles.
    pub band_size: [u32; 2],
    /// 1 for the last chunk.
    pub is_last: u32,
    /// Padding to a pair of words.
    pub unused: u32,
}

/// How much a chunk has.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkState {
    /// Footprints.
    pub length: u32,
    /// Words of the prefix sums of their entries: one more.
    pub offset_count: u32,
    /// Pairs of a tile and a footprint; 0 where they were more than the capacity.
    pub entries: u32,
    /// The most pairs that any chunk had since the host cleared this word, whether they fitted
    /// or not; `u32::MAX` where they were that many or more.
    pub needed: u32,
}
