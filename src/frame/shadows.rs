//! Keeps the shadows of a scene's lights in the world, for frames of any camera.

use glam::{DMat3, DVec3};

use crate::record::{LightShadow, ShadowUniform};
use crate::view::Camera;

/// Optical depths and surfaces toward the lights of a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ShadowGrids {
    /// In the order of the lights.
    pub(crate) lights: Vec<LightGrid>,
    /// The grids and maps of all lights: [`LightShadow`] describes their layout.
    pub(crate) words: Vec<f32>,
}

/// The grid and the map of a light, and their place in the world.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LightGrid {
    /// Corner of the grid nearest to the light, world units.
    pub(crate) corner: DVec3,
    /// Rows: the unit vectors in the world along x and y of the cells, and away from the light.
    pub(crate) axes: DMat3,
    /// Side of a cell, world units.
    pub(crate) cell: f64,
    /// Everything that does not depend on the camera.
    pub(crate) shadow: LightShadow,
}

impl ShadowGrids {
    /// Returns the shadows as a camera's frame reads them.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "stages work in f32 by design"
    )]
    pub(crate) fn uniform(&self, camera: &Camera) -> ShadowUniform {
        let mut uniform = ShadowUniform::default();
        for (out, light) in uniform.lights.iter_mut().zip(&self.lights) {
            *out = light.shadow;
            let rotation = light.axes * camera.camera_from_world.transpose() * (1.0 / light.cell);
            let eye = light.axes * (camera.eye - light.corner) / light.cell;
            for (i, row) in out.to_cells.iter_mut().enumerate() {
                *row = rotation.row(i).extend(eye[i]).as_vec4().into();
            }
        }
        uniform
    }

    /// Returns the grids and maps of all lights.
    pub(crate) fn words(&self) -> &[f32] {
        &self.words
    }
}
