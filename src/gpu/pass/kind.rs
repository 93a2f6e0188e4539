//! Defines the kind of a pass, for which its buffers and pipelines are made.

use crate::frame::plan::{FramePlan, PassPlan};
use crate::record::ClassifiedBy;
use crate::splat::{Accumulate, Axes};

/// Properties by which a pass' buffers and pipelines differ from another's of the same scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::gpu) struct PassKind {
    pub(super) size: [u32; 2],
    filter: u32,
    orthographic: u32,
    /// True if merged particles may be drawn.
    pub(super) detail: bool,
    /// Rule that classifies kernels.
    pub(super) classified_by: ClassifiedBy,
    pub(super) lights_particles: bool,
    /// True if the lights have shadows.
    pub(super) has_shadows: bool,
    /// True if colours are composited as sRGB codes.
    pub(super) is_encoded: bool,
    /// True if some tiles of the picture are drawn.
    pub(super) is_masked: bool,
    pub(super) axes: Axes,
}

impl PassKind {
    pub(in crate::gpu) fn of(plan: &FramePlan, pass: &PassPlan) -> Self {
        Self {
            size: pass.view.size,
            filter: pass.view.filter_kind,
            orthographic: pass.view.orthographic,
            detail: plan.has_detail(),
            classified_by: plan.classified_by(),
            lights_particles: pass.lights_particles,
            has_shadows: plan.shadows.is_some(),
            is_encoded: plan.is_encoded,
            is_masked: plan.tiles.is_some(),
            axes: pass.axes,
        }
    }

    /// Returns whether kernels are summed into column densities.
    pub(super) fn is_column(&self) -> bool {
        self.axes.accumulate == Accumulate::Column
    }
}
