//! Makes the shadows of a scene, and keeps them while nothing changes them.

use std::sync::Arc;

use glam::DVec3;

use crate::blocks::{BlockedScene, BlockedVolume};
use crate::cpu::{ShadowRequest, make_shadows};
use crate::error::Result;
use crate::frame::plan::FramePlan;
use crate::frame::shadows::ShadowGrids;
use crate::record::ShadowUniform;
use crate::scene::{LightFrame, Lighting, Shadows};
use crate::stats::Stopwatch;
use crate::view::{Camera, ClipPlane};

/// The shadows of a scene's last frame.
#[derive(Debug, Default)]
pub(super) struct ShadowsKept {
    pub(super) kept: Option<Kept>,
    /// Milliseconds of work that no frame has reported.
    pub(super) time: f64,
}

/// Shadows, and what they depend on besides the scene.
#[derive(Debug)]
pub(super) struct Kept {
    directions: Vec<DVec3>,
    shadows: Shadows,
    clip: Vec<ClipPlane>,
    /// Rule of classification and thickness of slabs.
    classified: (u32, f32),
    grids: Arc<ShadowGrids>,
}

impl ShadowsKept {
    /// Returns the shadows of a frame, if it has any. They are made if the scene, the lights' directions in the
    /// world or the clip planes have changed.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn of(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        lighting: &Lighting,
        clip: &[ClipPlane],
    ) -> Result<Option<(Arc<ShadowGrids>, ShadowUniform)>> {
        let Some(shadows) = lighting.shadows else {
            return Ok(None);
        };
        if !scene.data().any(BlockedVolume::is_lit) {
            return Ok(None);
        }
        let directions = directions(lighting, &plan.camera);
        let classified = (plan.choice.classified_by, plan.choice.slab_thickness);
        let is_current = |kept: &Kept| {
            kept.directions == directions
                && kept.shadows == shadows
                && kept.clip == clip
                && kept.classified == classified
        };
        if !self.kept.as_ref().is_some_and(is_current) {
            let mut stopwatch = Stopwatch::start();
            // Frees the memory of those before.
            self.kept = None;
            let request = ShadowRequest {
                directions: directions.clone(),
                shadows,
                choice: &plan.choice,
                clip,
                task: plan.task.as_ref(),
            };
            let grids = Arc::new(make_shadows(scene, &request)?);
            self.kept = Some(Kept {
                directions,
                shadows,
                clip: clip.to_vec(),
                classified,
                grids,
            });
            self.time += stopwatch.lap();
        }
        Ok(self.kept.as_ref().map(|kept| {
            let uniform = kept.grids.uniform(&plan.camera);
            (Arc::clone(&kept.grids), uniform)
        }))
    }
}

/// Returns the unit vectors toward the lights in the world. `Lighting::validate` has checked them.
fn directions(lighting: &Lighting, camera: &Camera) -> Vec<DVec3> {
    let world = |direction: DVec3, frame| match frame {
        LightFrame::World => direction,
        LightFrame::Camera => camera.camera_from_world.transpose() * direction,
    };
    let lights = lighting.lights.iter();
    lights
        .map(|light| world(light.direction, light.frame).normalize_or(DVec3::Z))
        .collect()
}
