//! Defines the results of sampling.

use crate::sample::report::SampleReport;
use crate::scene::PointVolume;

/// A point volume and a report on its sampling.
#[derive(Debug, Clone)]
pub struct Sampled {
    /// The volume.
    pub volume: PointVolume,
    /// The choices made, and the samples left out.
    pub report: SampleReport,
}

/// The volumes of a data set and a report on their sampling.
#[derive(Debug, Clone)]
pub struct SampledScene {
    /// At least one volume; a mesh gives one for each kind of surface that it has.
    pub volumes: Vec<PointVolume>,
    /// The choices made, and the samples left out.
    pub report: SampleReport,
}
