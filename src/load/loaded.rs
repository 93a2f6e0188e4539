//! Gathers the scene of all inputs.

use std::mem::take;

use glam::DVec3;

use super::facts::{Corners, InputFacts, may_end_sharply};
use super::input::Input;
use super::parts::PartRead;
use super::prepared::{self, Members};
use super::surfels::joined;
use crate::data::smoothing::SphKernel;
use crate::data::unit::title_of;
use crate::data::up::Up;
use crate::io::Planes;
use crate::prepared::{About, PointFile, PreparedScene};
use crate::ranks::Share;
use crate::sample::{SampleOptions, SampleReport, common_smoothing};
use crate::scene::PointVolume;
use crate::view::Bounds;
use crate::{Renderer, Result, SceneOptions};

/// Scene of all inputs: its volumes and their metadata.
#[derive(Debug)]
pub struct Loaded {
    /// Volumes, ready to be sorted into blocks. Those that stand in for prepared scenes' volumes
    /// have no particles.
    pub volumes: Vec<PointVolume>,
    /// Prepared scenes, each with the range of volumes that stand in for its own.
    pub prepared: Members,
    /// Facts about the inputs of data: all but prepared scenes.
    pub inputs: Vec<InputFacts>,
    /// Name of the field that each volume shows.
    pub fields: Vec<Option<String>>,
    /// Titles of these fields in legends, with their units if these are known.
    pub titles: Vec<Option<String>>,
    /// Fields and components of the first input:
    /// [`Dataset::selectors`](crate::io::Dataset::selectors).
    pub selectors: Vec<String>,
    /// True if all inputs are grids, whose kernels follow the spacing.
    pub grids_only: bool,
    /// True if any of the data can be cut sharply at its boundary: grids, unless options prevent
    /// it.
    pub has_boundary: bool,
    /// Direction up: [`Up::of_scene`].
    pub up: Up,
    /// Least and greatest coordinates of each input's data.
    pub corners: Vec<Corners>,
    /// If many ranks have loaded the scene: this rank's share, without its volumes. `None` if each rank has all particles.
    pub share: Option<Share>,
}

impl Loaded {
    /// Returns the SPH kernel that columns of the scene draw; `None` unless all particles stand for the same.
    pub fn smoothing(&self) -> Option<SphKernel> {
        let inputs = self.inputs.iter().filter(|input| !input.is_nothing);
        let common = common_smoothing(inputs.map(|input| &input.report));
        common.filter(|_| self.prepared.is_empty())
    }

    /// Creates a scene without inputs.
    pub(crate) fn of_nothing() -> Self {
        Self {
            volumes: Vec::new(),
            prepared: Vec::new(),
            inputs: Vec::new(),
            fields: Vec::new(),
            titles: Vec::new(),
            selectors: Vec::new(),
            grids_only: false,
            has_boundary: false,
            up: Up::of_scene([]),
            corners: Vec::new(),
            share: None,
        }
    }

    /// Creates a scene from the metadata of a point file that was read as a stream.
    pub(crate) fn of_stream(file: &PointFile) -> Self {
        let unit = file.report().and_then(|report| report.unit.as_deref());
        Self::of_points(file.field(), unit, file.up(), file.bounds())
    }

    /// Creates a scene from the metadata of a file of which every rank has read a part.
    ///
    /// - `is_grid`: whether the file holds a grid, not points.
    pub(crate) fn of_part(read: &PartRead, is_grid: bool) -> Self {
        let (field, unit) = (read.report.field.as_deref(), read.report.unit.as_deref());
        Self {
            grids_only: is_grid,
            has_boundary: is_grid,
            ..Self::of_points(field, unit, read.head.up(), read.corners)
        }
    }

    fn of_points(
        field: Option<&str>,
        unit: Option<&str>,
        up: Up,
        corners: Option<(DVec3, DVec3)>,
    ) -> Self {
        Self {
            fields: vec![field.map(str::to_owned)],
            titles: vec![field.map(|field| title_of(field, unit))],
            up,
            corners: corners.into_iter().collect(),
            ..Self::of_nothing()
        }
    }

    /// Creates a scene from the metadata that another rank sent.
    pub(crate) fn of_about(about: About) -> Self {
        Self {
            up: prepared::up_of(&about),
            corners: prepared::corners_of(&about).collect(),
            fields: about.fields,
            titles: about.titles,
            ..Self::of_nothing()
        }
    }

    /// Creates a scene from a lattice of which every rank has read some planes.
    pub(crate) fn of_planes(
        file: &Planes,
        volumes: Vec<PointVolume>,
        report: &SampleReport,
    ) -> Self {
        let head = file.head();
        let title = title_of(file.field(), report.unit.as_deref());
        Self {
            volumes,
            fields: vec![Some(file.field().to_owned())],
            titles: vec![Some(title)],
            grids_only: true,
            has_boundary: true,
            up: Up::of_scene([head.up()]),
            corners: head.bounds().into_iter().collect(),
            ..Self::of_nothing()
        }
    }

    /// Names the field of volumes that have no name yet, up to `count` volumes.
    pub(super) fn name(&mut self, count: usize, report: &SampleReport) {
        self.titles.resize(count, report_title(report));
        self.fields.resize(count, report.field.clone());
    }

    /// Creates a scene from inputs of which every rank has read some.
    ///
    /// - `volumes`: volumes of all inputs; those of other ranks have no particles.
    /// - `options`: options by which all inputs were sampled.
    pub(crate) fn of_inputs(
        volumes: Vec<PointVolume>,
        inputs: Vec<InputFacts>,
        options: &SampleOptions,
    ) -> Self {
        let shown = inputs.iter().filter(|input| !input.is_nothing);
        let mut scene = Self {
            volumes,
            grids_only: inputs.iter().all(InputFacts::is_grid_or_splats),
            has_boundary: may_end_sharply(&inputs, options),
            up: Up::of_scene(shown.map(|input| input.up)),
            corners: inputs.iter().filter_map(|input| input.corners).collect(),
            ..Self::of_nothing()
        };
        for input in &inputs {
            scene.name(scene.fields.len() + input.volume_count, &input.report);
        }
        scene.inputs = inputs;
        scene
    }

    /// Adds a prepared scene, and volumes that stand in for its own.
    pub(super) fn add(&mut self, own: PreparedScene, about: About) {
        let first = self.volumes.len();
        self.corners.extend(prepared::corners_of(&about));
        self.volumes.extend(own.stand_ins());
        let count = self.volumes.len();
        self.fields.extend(about.fields);
        self.titles.extend(about.titles);
        self.fields.resize(count, None);
        self.titles.resize(count, None);
        self.prepared.push((first..count, own));
    }

    /// Returns the metadata that a prepared scene stores beside its particles.
    ///
    /// - `inputs`: the inputs of this scene.
    pub(crate) fn about(&self, inputs: &[Input], for_columns: bool) -> About {
        let name = |input: &Input| input.path.display().to_string();
        let corners = self.corners.iter();
        About {
            inputs: inputs.iter().map(name).collect(),
            fields: self.fields.clone(),
            titles: self.titles.clone(),
            corners: corners.map(|(a, b)| [a.to_array(), b.to_array()]).collect(),
            up: self.up.direction.to_array(),
            front: self.up.front.map(|front| front.to_array()),
            is_plane: self.up.is_plane,
            is_of_mesh: self.up.is_of_mesh,
            for_columns,
        }
    }

    /// Returns the box of all data, or `None` if no datum has a position.
    pub fn bounds(&self) -> Option<Bounds> {
        let (lower, upper) = self.corners.iter().copied().reduce(joined)?;
        Some(((lower + upper) / 2.0, (upper - lower) / 2.0))
    }

    /// Takes this rank's share, with its volumes, out of this scene. Returns `None` if every rank has the whole scene.
    ///
    /// - `size`: number of the ranks.
    pub(crate) fn take_share(&mut self, size: usize) -> Option<Share> {
        let share = match self.share.take() {
            // A single rank has all particles.
            None if size == 1 && self.prepared.is_empty() => Share::from(Vec::new()),
            share => share?,
        };
        Some(Share {
            volumes: take(&mut self.volumes),
            ..share
        })
    }

    /// Sorts the volumes into blocks. It takes the volumes and the prepared scenes out of this
    /// scene.
    ///
    /// # Errors
    /// The errors of [`Renderer::with_options`].
    pub fn renderer(&mut self, options: &SceneOptions) -> Result<Renderer> {
        prepared::renderer(take(&mut self.volumes), take(&mut self.prepared), options)
    }
}

/// Returns the title of a field in legends, with its unit if this is known.
fn report_title(report: &SampleReport) -> Option<String> {
    let field = report.field.as_deref()?;
    Some(title_of(field, report.unit.as_deref()))
}
