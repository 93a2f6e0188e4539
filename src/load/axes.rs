//! Rotates inputs to the axes of the scene.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::edit::Edit;
use super::input::Input;
use crate::Result;
use crate::data::dataset::{Dataset, Geometry};
use crate::edit::{Placement, place};

/// Axes of an input.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Axes {
    /// Axis that points up, by the format or by convention.
    up: [f64; 3],
    /// Reason for this axis.
    pub(super) reason: String,
    pub(super) certainty: Certainty,
}

/// Certainty of the axes of an input.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) enum Certainty {
    /// The format defines the axes.
    Format,
    /// Most files of the format have these axes.
    MostFiles,
    /// The axes are convention alone, or the user placed the input.
    Convention,
}

impl Default for Axes {
    fn default() -> Self {
        Self {
            up: DVec3::Z.to_array(),
            reason: String::new(),
            certainty: Certainty::Convention,
        }
    }
}

impl Axes {
    /// Returns the axes of the coordinates of an input.
    pub(super) fn of(dataset: &Dataset, input: &Input) -> Self {
        let is_placed = input.edit != Edit::default();
        let (up, reason, certainty) = match (dataset.format_up, &dataset.geometry) {
            (Some((up, reason)), _) if dataset.format.contains("OBJ") => {
                (up, reason, Certainty::MostFiles)
            }
            (Some((up, reason)), _) => (up, reason, Certainty::Format),
            (None, Geometry::Splats(_)) => {
                let reason = "training scenes of splats have y down";
                (DVec3::NEG_Y, reason, Certainty::Format)
            }
            (None, _) => (DVec3::Z, "z by convention", Certainty::Convention),
        };
        Self {
            up: up.to_array(),
            reason: reason.to_owned(),
            // An input that the user placed is not rotated.
            certainty: match is_placed {
                true => Certainty::Convention,
                false => certainty,
            },
        }
    }

    /// Returns the axis that points up.
    pub(super) fn up(&self) -> DVec3 {
        self.up.into()
    }
}

/// Rotates a data set about the origin.
pub(super) fn turned(dataset: Dataset, turn: Option<DQuat>) -> Result<Dataset> {
    match turn {
        None => Ok(dataset),
        Some(rotation) => place(
            dataset,
            &Placement {
                rotation,
                ..Placement::default()
            },
        ),
    }
}
