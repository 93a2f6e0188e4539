//! Defines what a session makes of its data: sampled volumes, and scenes that are ready to be drawn.

use std::ops::Range;

use super::source::Source;
use crate::clock::Instant;
use crate::error::{Error, Result};
use crate::io::SphKernel;
use crate::legend::{ColourBar, title_of};
use crate::ranks::Share;
use crate::render::Renderer;
use crate::sample::{MeanPart, TransferChoice};
use crate::scene::{PointVolume, TransferFunction};

/// Purpose that a scene is sampled for.
#[derive(Debug, Clone, PartialEq)]
pub struct Purpose {
    /// True for column densities.
    pub for_columns: bool,
    /// The part of a mean along rays that columns serve.
    pub mean: MeanPart,
    /// True if volumes are lit.
    pub normals: bool,
    /// True if particles have local models.
    pub models: bool,
    /// True for levels of detail.
    pub detail: bool,
    /// True if particles keep their numbers.
    pub indices: bool,
    /// True if shapes are kept for other values.
    pub shapes: bool,
    /// Transfer function for all data.
    pub transfer: Option<TransferChoice>,
    /// The quantity that columns sum; `None` for pictures.
    pub summed: Option<Summed>,
}

/// A quantity that columns sum.
#[derive(Debug, Clone, PartialEq)]
pub enum Summed {
    /// Mass where it is known, else the field that is shown.
    Known,
    /// Mass.
    Mass,
    /// A field, as a density.
    Field(String),
}

impl Summed {
    /// Returns the quantity of this name.
    pub fn of(text: Option<&str>) -> Self {
        match text {
            None => Self::Known,
            Some("mass") => Self::Mass,
            Some(field) => Self::Field(field.into()),
        }
    }

    /// Returns the field of a source that makes columns sum this.
    ///
    /// - `mean`: the part of a mean that the columns serve.
    ///
    /// # Errors
    /// Masses of data without.
    pub fn field(&self, source: &Source, mean: MeanPart) -> Result<Option<String>> {
        match (self, source.masses()) {
            (Self::Field(name), _) => Ok(Some(name.clone())),
            // Masses that columns sum by themselves are a field by the name of their column.
            (Self::Mass, Some(None)) if mean == MeanPart::Field => Ok(Some("mass".into())),
            (_, Some(masses)) => Ok(masses),
            (Self::Known, None) => Ok(source.options.field.clone()),
            (Self::Mass, None) => Err(Error::invalid(
                "of",
                "columns of mass",
                "particles with masses",
                "data without",
                "give masses, or name a field",
            )),
        }
    }
}

/// Scene ready to be drawn.
#[derive(Debug)]
pub struct Ready {
    /// Purpose that it was sampled for.
    pub purpose: Purpose,
    /// Process that made the scene.
    pub process: u32,
    /// The renderer.
    pub renderer: Renderer,
    /// True if a device has been chosen.
    pub is_open: bool,
    /// Colour bars, each once.
    pub bars: Vec<ColourBar>,
    /// Transfer function of each volume.
    pub functions: Vec<Option<TransferFunction>>,
    /// For each drawable, the number of its first volume, and whether each of its samples is a
    /// particle.
    pub firsts: Vec<(usize, bool)>,
    /// Largest number of surfels of each surface by the pixels of a picture, if the surface states
    /// no number.
    pub counts: Vec<Option<usize>>,
    /// SPH kernel that columns draw.
    pub smoothing: Option<SphKernel>,
    /// Name and unit of the field.
    pub title: (Option<String>, Option<String>),
    /// Start of the work.
    pub begun: Instant,
    /// Time of sampling, ms.
    pub read_ms: f64,
    /// Time of sorting into blocks, ms.
    pub prepare_ms: f64,
}

/// Sampled volumes with their titles, fields and numbers of surfels.
#[derive(Debug, Default)]
pub struct Sampled {
    /// The volumes.
    pub volumes: Vec<PointVolume>,
    /// SPH kernel that columns draw.
    pub smoothing: Option<SphKernel>,
    /// Title of each volume.
    pub titles: Vec<Option<String>>,
    /// Unit of each field.
    pub units: Vec<Option<String>>,
    /// Field of each volume.
    pub fields: Vec<Option<String>>,
    /// As [`Ready::firsts`].
    pub firsts: Vec<(usize, bool)>,
    /// As [`Ready::counts`].
    pub counts: Vec<Option<usize>>,
    /// Places of the volumes among those of all ranks, if ranks share the data.
    pub(super) placement: Option<Placement>,
}

/// Numbers of particles and planes of lattices, which complete volumes to a [`Share`].
#[derive(Debug, Default)]
pub(super) struct Placement {
    pub(super) numbers: Vec<Vec<u64>>,
    pub(super) planes: Vec<Vec<Range<usize>>>,
}

impl Placement {
    pub(super) fn share(self, volumes: Vec<PointVolume>) -> Share {
        Share {
            volumes,
            numbers: Some(self.numbers),
            planes: Some(self.planes),
        }
    }
}

impl Sampled {
    /// Notes the field and the unit that the next `count` volumes show.
    pub(super) fn note(&mut self, count: usize, field: Option<String>, unit: Option<String>) {
        let end = self.titles.len() + count;
        let title = field.as_deref().map(|f| title_of(f, unit.as_deref()));
        self.titles.resize(end, title);
        self.units.resize(end, unit);
        self.fields.resize(end, field);
    }

    /// Returns the name and the unit of the field, if all volumes show the same.
    pub fn title(&self) -> (Option<String>, Option<String>) {
        let common = |all: &[Option<String>]| {
            let first = all.first().cloned().flatten();
            first.filter(|_| all.windows(2).all(|pair| pair[0] == pair[1]))
        };
        (common(&self.fields), common(&self.units))
    }
}
