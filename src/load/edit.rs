//! Places and crops the data of one input.

use glam::DVec3;

use crate::data::dataset::Dataset;
use crate::edit::{Displacement, Placement, crop, displace, note_displacement, place};
use crate::error::{Hint, Parameter};
use crate::{Error, Result};

/// Edits of one input: first its displacement, then its placement, then the box that it is cropped to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Edit {
    /// Field by which points are moved.
    pub displacement: Option<Displacement>,
    /// Placement of the data.
    pub placement: Option<Placement>,
    /// Factor of heights, in addition to the placement.
    pub exaggeration: Option<f64>,
    /// Lower and upper corner of the box that is kept.
    pub crop: Option<[DVec3; 2]>,
}

/// Largest distance of the direction up from an axis, relative to its length.
const ALONG: f64 = 1e-6;

impl Edit {
    /// Returns the crop box if the input is cropped and not otherwise edited.
    pub(crate) fn crop_alone(&self) -> Option<[DVec3; 2]> {
        let is_moved =
            self.displacement.is_some() || self.placement.is_some() || self.exaggeration.is_some();
        self.crop.filter(|_| !is_moved)
    }

    /// Displaces and places the data, and crops them to the box. Adds a note on a likely displacement that is not
    /// applied.
    ///
    /// # Errors
    /// The errors of [`displace`], [`place`] and [`crop`]; an exaggeration of data whose direction up is along no axis.
    pub fn applied(&self, mut dataset: Dataset) -> Result<Dataset> {
        match &self.displacement {
            Some(by) => dataset = displace(dataset, by)?,
            None => dataset.notes.extend(note_displacement(&dataset)),
        }
        let mut placement = self.placement;
        if let Some(factor) = self.exaggeration {
            let size = &mut placement.get_or_insert_default().size;
            *size *= heights(&dataset, factor)?;
        }
        if let Some(placement) = &placement {
            dataset = place(dataset, placement)?;
        }
        match self.crop {
            Some([lower, upper]) => crop(dataset, lower, upper),
            None => Ok(dataset),
        }
    }
}

/// Returns the scale factors that multiply heights by `factor`.
fn heights(dataset: &Dataset, factor: f64) -> Result<DVec3> {
    let up = dataset.up().direction;
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let along = axes
        .into_iter()
        .find(|axis| up.dot(*axis).abs() >= 1.0 - ALONG);
    let axis = along.ok_or_else(|| {
        let expected = "data that have x, y or z up";
        let found = format!("{} {} {}", up.x, up.y, up.z);
        let (place, advice) = (Parameter::Exaggeration, Hint::ResizeAlongAxes);
        Error::format(&dataset.path, place, expected, found, advice)
    })?;
    Ok(DVec3::ONE + (factor - 1.0) * axis)
}
