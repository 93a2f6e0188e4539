//! Defines the stages' view of shadows: a grid and a map for each light.

use bytemuck::{Pod, Zeroable};

use crate::constants::MAX_LIGHTS;

/// Optical depths and surfaces toward one light, among the words that all lights share.
///
/// Cells have coordinates x and y across the light and z away from it. The grid has columns of `size[2] + 1`
/// optical depths, those from the light to z = 0, 1, 2, ..., one column for the middle of each cell. The map
/// has the depth z of the nearest opaque surface at the middle of each of its texels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightShadow {
    /// Rows of the map from camera space to cells: (a, b, c, d) for a x + b y + c z + d.
    pub to_cells: [[f32; 4]; 3],
    /// Columns, rows and layers of the grid; 0 without volumes.
    pub size: [u32; 3],
    /// First word of the grid.
    pub first: u32,
    /// Columns and rows of the map; 0 without surfaces.
    pub map_size: [u32; 2],
    /// First word of the map.
    pub map_first: u32,
    /// Texels of the map per cell.
    pub map_scale: f32,
    /// Corner of the map, cells.
    pub map_corner: [f32; 2],
    /// Distance by which surfaces are moved toward the light before they are compared with the map, cells.
    pub bias: f32,
    /// Tangent of the light's standard deviation.
    pub softness: f32,
}

/// The shadows of a frame's lights.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ShadowUniform {
    /// In the order of the lights.
    pub lights: [LightShadow; MAX_LIGHTS],
}
