//! Reads several inputs as one scene. The inputs show one field if they have one in common, by one
//! transfer function. If ranks share a scene, each rank reads some of the inputs, and all ranks make
//! the same choices.
//!
//! [`Collection::read`] goes through these phases:
//!
//! 1. `opened`: open the inputs, and collect the facts that all ranks need ([`Look`]).
//! 2. `turn`: rotate inputs to the axes of the scene.
//! 3. `chosen`: choose the field to show.
//! 4. `sample`: make particles; read only the values of surfaces.
//! 5. `functions`: choose transfer functions from the values of all inputs that share one, and sample
//!    these inputs again.
//! 6. `spreads`, `spread`: spread surfels over surfaces. Their number follows from the pixels of the
//!    picture, and the picture from the boxes of all volumes. Surfels therefore come last.
//! 7. `gathered`: collect the results of all ranks.

use std::collections::HashMap;
use std::ops::Range;

use glam::{DQuat, DVec3};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::axes::{Axes, Certainty, turned};
use super::choices::{functions_of_all, prefer, with_shared};
use super::facts::{Corners, InputFacts, Kind, check_memory, has_opacity, is_automatic};
use super::input::Input;
use super::note::{Event, Note};
use super::request::Request;
use super::surfels::{SurfelDemand, joined, seen_corners};
use crate::collective::Collective;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::smoothing::SphKernel;
use crate::data::up::Up;
use crate::error::Advice;
use crate::math::{rotation_matrix, turn_between};
use crate::sample::mesh::Spread;
use crate::sample::{
    FieldChoice, KernelOptions, PurposeOptions, SampleOptions, SampleReport, SampledScene,
    as_surface, field_choices, is_surface, surface_report,
};
use crate::scene::{PointVolume, TransferFunction};
use crate::view::{Bounds, Camera};
use crate::{Error, Result};

/// Most memory for data sets that are kept from the first look to the sampling, in bytes. Others
/// are read again.
const KEPT: usize = 1 << 30;

/// Largest number of empty files that a note names.
const MOST_NAMED: usize = 3;

/// Facts about an input that all ranks need before any input is sampled.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Look {
    kind: Kind,
    up: SentUp,
    corners: Option<[[f64; 3]; 2]>,
    selectors: Vec<String>,
    /// True if the input becomes surfels.
    is_surface: bool,
    /// Candidates for the field to show: name, ranges of components, rank.
    choices: Vec<(String, Vec<[f64; 2]>, u8)>,
    axes: Axes,
    /// Notes of the reader.
    lines: Vec<String>,
    /// True if the input has the field that is asked for.
    has_field: bool,
    /// True if the input should have that field and lacks it.
    is_lacking: bool,
}

/// [`Up`] in the form that ranks send.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct SentUp {
    direction: [f64; 3],
    front: Option<[f64; 3]>,
    is_plane: bool,
    is_of_mesh: bool,
}

impl From<Up> for SentUp {
    fn from(up: Up) -> Self {
        Self {
            direction: up.direction.to_array(),
            front: up.front.map(|front| front.to_array()),
            is_plane: up.is_plane,
            is_of_mesh: up.is_of_mesh,
        }
    }
}

impl From<SentUp> for Up {
    fn from(sent: SentUp) -> Self {
        Self {
            direction: DVec3::from(sent.direction),
            reason: "as the data say",
            front: sent.front.map(DVec3::from),
            is_plane: sent.is_plane,
            is_of_mesh: sent.is_of_mesh,
        }
    }
}

/// Facts about an input after sampling.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Facts {
    field: Option<String>,
    unit: Option<String>,
    smoothing: Option<SphKernel>,
    refined_count: usize,
    refined_level: u8,
    may_refine: bool,
    volume_count: usize,
    is_classified: bool,
    has_opacity: bool,
    /// Warnings of the sampler.
    lines: Vec<String>,
    is_nothing: bool,
}

/// Input that this process reads.
pub(super) struct Own {
    pub(super) number: usize,
    pub(super) look: Look,
    /// Data set to sample, if it is kept in memory.
    dataset: Option<Dataset>,
    /// Rotation to the axes of the scene.
    turn: Option<DQuat>,
    pub(super) volumes: Vec<PointVolume>,
    pub(super) report: SampleReport,
    /// Error that reports that the input holds nothing to draw.
    pub(super) nothing: Option<Error>,
    /// Error that reports that the input lacks the field that is asked for.
    pub(super) absence: Option<Error>,
}

/// Inputs of data that are drawn together.
pub(crate) struct Collection<'a> {
    /// All inputs, those of other ranks among them, and how to read them.
    pub(crate) request: Request<'a>,
    /// Numbers of the inputs that this process reads.
    pub(crate) own: Range<usize>,
    /// Corners and directions up of the data that are drawn beside the inputs.
    pub(crate) beside: &'a [(Option<Corners>, Up)],
}

/// Inputs after reading and sampling.
pub(crate) struct Gathered {
    /// Facts about all inputs, in their order.
    pub(crate) inputs: Vec<InputFacts>,
    /// Volumes of the inputs that this process read, input by input.
    pub(crate) volumes: Vec<Vec<PointVolume>>,
    /// Fields and components of the first input that can be shown.
    pub(crate) selectors: Vec<String>,
}

/// Gathers the items of all ranks, in the order of the inputs.
fn all<T>(ranks: &mut dyn Collective, own: Vec<T>) -> Result<Vec<T>>
where
    T: Serialize + DeserializeOwned,
{
    Ok(ranks.gather_values(own)?.into_iter().flatten().collect())
}

/// Converts the corners of a box to arrays, the form that ranks send.
pub(crate) fn arrays_of((low, high): Corners) -> [[f64; 3]; 2] {
    [low.to_array(), high.to_array()]
}

/// Converts arrays to the corners of a box.
pub(crate) fn corners_of([low, high]: [[f64; 3]; 2]) -> Corners {
    (low.into(), high.into())
}

impl Collection<'_> {
    /// Reads and samples the inputs, and prints notes on what was left out.
    ///
    /// # Errors
    /// Errors of reading and sampling on any rank; a field that no input has; nothing to draw in
    /// any input.
    pub(crate) fn read(&self, ranks: &mut dyn Collective) -> Result<Gathered> {
        let own = self.opened();
        let mut own = ranks.agree(own)?;
        let mut looks = all(ranks, own.iter().map(|own| own.look.clone()).collect())?;
        self.note_lines(looks.iter().map(|look| &look.lines));
        let turned = self.turn(&mut looks, &mut own);
        ranks.agree(turned)?;
        self.check_field(&looks, &mut own, ranks)?;
        let mut options = self.chosen(&looks);
        self.place_cameras(&looks, &mut options)?;
        // Samples inputs other than surfaces. From surfaces, it only reads the field values.
        let sampled = own
            .iter_mut()
            .try_for_each(|own| self.sample(own, &options[own.number]));
        ranks.agree(sampled)?;
        let functions = self.functions(&mut own, &options, ranks)?;
        let options: Vec<SampleOptions> = options
            .into_iter()
            .enumerate()
            .map(|(i, options)| match functions.get(&i) {
                None => options,
                Some(function) => with_shared(options, function),
            })
            .collect();
        let shared = |own: &&mut Own| functions.contains_key(&own.number);
        let again = own
            .iter_mut()
            .filter(|own| !own.look.is_surface)
            .filter(shared)
            .try_for_each(|own| self.sample(own, &options[own.number]));
        ranks.agree(again)?;
        let spreads = self.spreads(&looks, &mut own, &options, ranks)?;
        let surfaces = own
            .iter_mut()
            .filter(|own| own.look.is_surface)
            .try_for_each(|own| {
                let spread = spreads[own.number];
                let options = options[own.number].clone();
                self.spread(
                    own,
                    &SampleOptions {
                        kernels: KernelOptions {
                            spread,
                            ..options.kernels
                        },
                        ..options
                    },
                )
            });
        ranks.agree(surfaces)?;
        self.gathered(looks, own, &options, ranks)
    }

    fn is_alone(&self) -> bool {
        self.request.inputs.len() == 1
    }

    fn note(&self, note: Note) {
        (self.request.observer)(Event::Note(note));
    }

    /// Reports lines on each input.
    fn note_lines<'b>(&self, lines: impl Iterator<Item = &'b Vec<String>>) {
        for (input, lines) in self.request.inputs.iter().zip(lines) {
            self.request.note_lines(input, lines);
        }
    }

    /// Opens an input, and reports that it is read.
    fn open(&self, number: usize) -> Result<Dataset> {
        let input = &self.request.inputs[number];
        (self.request.observer)(Event::Reading(&input.path));
        input.open(self.request.open)
    }

    /// Opens the inputs of this rank, and collects the facts that all ranks need.
    pub(super) fn opened(&self) -> Result<Vec<Own>> {
        let mut kept = 0_usize;
        let mut opened = Vec::new();
        for number in self.own.clone() {
            let mut own = self.look(number, &self.request.inputs[number])?;
            let bytes = own.dataset.as_ref().map_or(0, byte_count);
            match self.is_alone() || kept.saturating_add(bytes) <= KEPT {
                true => kept = kept.saturating_add(bytes),
                false => own.dataset = None,
            }
            opened.push(own);
        }
        Ok(opened)
    }

    fn look(&self, number: usize, input: &Input) -> Result<Own> {
        let mut own = Own {
            number,
            look: Look {
                kind: Kind::Mesh,
                up: Up::of_scene([]).into(),
                corners: None,
                selectors: Vec::new(),
                is_surface: false,
                choices: Vec::new(),
                axes: Axes::default(),
                lines: Vec::new(),
                has_field: false,
                is_lacking: false,
            },
            dataset: None,
            turn: None,
            volumes: Vec::new(),
            report: SampleReport::default(),
            nothing: None,
            absence: None,
        };
        let dataset = match self.open(number) {
            Ok(dataset) => dataset,
            Err(error) if error.holds_nothing() => {
                own.nothing = Some(error);
                return Ok(own);
            }
            Err(error) => return Err(error),
        };
        check_memory(&dataset)?;
        let look = &mut own.look;
        look.axes = Axes::of(&dataset, input);
        look.kind = Kind::of(&dataset);
        look.up = dataset.up().into();
        look.corners = dataset.bounds().map(arrays_of);
        look.selectors = dataset.selectors();
        let options = input.sample_options(self.request.sample);
        if input.surface.is_some() && is_surface(&dataset) {
            own.nothing = Some(without_volume(&dataset));
            return Ok(own);
        }
        let mut dataset = as_surface(dataset, &options)?;
        look.lines = std::mem::take(&mut dataset.notes);
        look.is_surface = matches!(dataset.geometry, Geometry::Mesh(_));
        if let (Some(field), None) = (&options.field, &input.field) {
            look.has_field = dataset.selected(field).is_some();
            let has_none = look.is_surface && dataset.fields.is_empty();
            // A field that one input lacks may be in another.
            if !self.is_alone() && !look.has_field && !has_none {
                own.absence = dataset.scalar(field).err();
                look.is_lacking = true;
            }
        }
        let is_open = options.field.is_none() || look.is_lacking;
        if !self.is_alone() && is_open {
            let choices = field_choices(&dataset).into_iter();
            let choices = choices.map(|own| (own.name, own.ranges, own.rank));
            look.choices = choices.collect();
        }
        own.dataset = Some(dataset);
        Ok(own)
    }

    /// Rotates inputs to the axes of the scene if their formats have other axes, and prints a note.
    fn turn(&self, looks: &mut [Look], own: &mut [Own]) -> Result<()> {
        let scene = Up::of_scene(ups(looks));
        // Takes the axes of the first input that is not rotated, or else of the input that decides
        // the direction up.
        let stays =
            |look: &&Look| look.axes.certainty == Certainty::Convention && look.corners.is_some();
        let says_up = |look: &&Look| look.corners.is_some() && Up::from(look.up) == scene;
        let first = looks.iter().find(stays);
        let first = first.or_else(|| looks.iter().find(says_up));
        let Some(to) = first.map(|look| look.axes.up()) else {
            return Ok(());
        };
        // Surfaces beside a grid mostly have the grid's coordinates.
        let has_grid = looks.iter().any(|look| look.kind.is_grid());
        for (i, look) in looks.iter_mut().enumerate() {
            let from = look.axes.up();
            if from == to || look.axes.certainty == Certainty::Convention || self.request.keeps_axes
            {
                continue;
            }
            let is_turned = look.axes.certainty == Certainty::Format || !has_grid;
            self.note(Note::OtherAxes {
                path: self.request.inputs[i].path.clone(),
                up: from,
                reason: look.axes.reason.clone(),
                scene_up: to,
                is_turned,
            });
            if !is_turned {
                continue;
            }
            let turn = turn_between(from, to);
            let matrix = rotation_matrix(turn);
            look.corners = look.corners.map(|corners| {
                let (a, b) = corners_of(corners);
                let (a, b) = (matrix * a, matrix * b);
                arrays_of((a.min(b), a.max(b)))
            });
            let up = Up::from(look.up);
            look.up = Up {
                direction: matrix * up.direction,
                front: up.front.map(|front| matrix * front),
                ..up
            }
            .into();
            if let Some(own) = own.iter_mut().find(|own| own.number == i) {
                own.turn = Some(turn);
                own.look = look.clone();
                let kept = own.dataset.take();
                own.dataset = kept.map(|kept| turned(kept, own.turn)).transpose()?;
            }
        }
        Ok(())
    }

    /// Refuses a field that no input has, and prints which inputs lack it.
    fn check_field(
        &self,
        looks: &[Look],
        own: &mut [Own],
        ranks: &mut dyn Collective,
    ) -> Result<()> {
        let is_shown = looks.iter().any(|look| look.has_field);
        let absent = own.iter_mut().find_map(|own| own.absence.take());
        ranks.agree(absent.filter(|_| !is_shown).map_or(Ok(()), Err))?;
        let field = self.request.sample.field.as_deref().unwrap_or_default();
        for (input, look) in self.request.inputs.iter().zip(looks) {
            if look.is_lacking {
                let (path, field) = (input.path.clone(), field.to_owned());
                self.note(Note::LacksField { path, field });
            }
        }
        Ok(())
    }

    /// Returns the options of each input. If no field is named, inputs show one that they have in
    /// common.
    pub(super) fn chosen(&self, looks: &[Look]) -> Vec<SampleOptions> {
        let keeps = self.request.inputs.len() > 1 && !self.request.sample.purpose.for_columns;
        let of_input = |(input, look): (&Input, &Look)| {
            let mut own = input.sample_options(self.request.sample);
            own.field.take_if(|_| look.is_lacking);
            SampleOptions {
                purpose: PurposeOptions {
                    keeps_value_sample: keeps || own.purpose.keeps_value_sample,
                    ..own.purpose
                },
                ..own
            }
        };
        let mut options: Vec<SampleOptions> = self
            .request
            .inputs
            .iter()
            .zip(looks)
            .map(of_input)
            .collect();
        let choices: Vec<Vec<FieldChoice>> = looks.iter().map(Look::choices).collect();
        prefer(&mut options, choices);
        options
    }

    /// Returns the cameras of the pictures; none if nothing has a place.
    ///
    /// - `own`: least and greatest coordinates of each input of the collection.
    fn cameras(
        &self,
        looks: &[Look],
        own: impl Iterator<Item = Option<[[f64; 3]; 2]>>,
    ) -> Result<Vec<Camera>> {
        let beside = self.beside.iter().filter_map(|(corners, _)| *corners);
        let corners = beside.chain(own.flatten().map(corners_of));
        let boxes: Vec<Bounds> = corners
            .map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0))
            .collect();
        let beside = self.beside.iter().map(|(_, up)| *up);
        let up = Up::of_scene(beside.chain(ups(looks)));
        match boxes.is_empty() {
            true => Ok(Vec::new()),
            false => (self.request.cameras)(&boxes, up),
        }
    }

    /// Gives inputs to refine the cameras of the pictures, placed by the boxes of all inputs.
    fn place_cameras(&self, looks: &[Look], options: &mut [SampleOptions]) -> Result<()> {
        if options.iter().all(|own| own.refinement.is_none()) {
            return Ok(());
        }
        let cameras = self.cameras(looks, looks.iter().map(|look| look.corners))?;
        for refinement in options.iter_mut().filter_map(|own| own.refinement.as_mut()) {
            refinement.cameras.clone_from(&cameras);
        }
        Ok(())
    }

    /// Returns the data set of an input for sampling: the one kept in memory, or else read again.
    pub(super) fn taken(&self, own: &mut Own, options: &SampleOptions) -> Result<Dataset> {
        match own.dataset.take() {
            Some(dataset) => Ok(dataset),
            None => {
                let dataset = self.open(own.number)?;
                turned(as_surface(dataset, options)?, own.turn)
            }
        }
    }

    /// Samples an input; of a surface, it only reads the values.
    fn sample(&self, own: &mut Own, options: &SampleOptions) -> Result<()> {
        if own.nothing.is_some() || (own.look.is_surface && self.is_alone()) {
            return Ok(());
        }
        // The old volumes are freed before the new ones are made.
        own.volumes.clear();
        let is_kept = own.dataset.is_some();
        let dataset = self.taken(own, options)?;
        if !own.look.is_surface {
            return own.take_in(crate::sample::scene(dataset, options));
        }
        own.report = surface_report(&dataset, options)?;
        own.dataset = is_kept.then_some(dataset);
        Ok(())
    }

    /// Spreads surfels over a surface.
    fn spread(&self, own: &mut Own, options: &SampleOptions) -> Result<()> {
        if own.nothing.is_some() {
            return Ok(());
        }
        let dataset = self.taken(own, options)?;
        own.take_in(crate::sample::scene(dataset, options))
    }

    /// Returns the transfer functions that inputs share, by the inputs' numbers.
    fn functions(
        &self,
        own: &mut [Own],
        options: &[SampleOptions],
        ranks: &mut dyn Collective,
    ) -> Result<HashMap<usize, TransferFunction>> {
        let own = own.iter_mut().map(|own| (own.number, &mut own.report));
        functions_of_all(own.collect(), options, ranks)
    }

    /// Returns how surfels are spread over each input. If no number is asked for, the pixels of the
    /// pictures determine it; all meshes together get no more surfels than one would.
    fn spreads(
        &self,
        looks: &[Look],
        own: &mut [Own],
        options: &[SampleOptions],
        ranks: &mut dyn Collective,
    ) -> Result<Vec<Spread>> {
        let asked = self.request.sample.kernels.spread;
        let mut spreads = vec![asked; looks.len()];
        if asked != Spread::Automatic || !looks.iter().any(|look| look.is_surface) {
            return Ok(spreads);
        }
        let seen = own.iter().map(|own| {
            let volumes = own.volumes.iter().filter_map(seen_corners);
            let volumes = volumes.reduce(joined);
            match own.look.is_surface {
                true => own.look.corners,
                false => volumes.map(arrays_of),
            }
        });
        let seen: Vec<Option<[[f64; 3]; 2]>> = all(ranks, seen.collect())?;
        let cameras = self.cameras(looks, seen.into_iter())?;
        let demands = own
            .iter_mut()
            .map(|own| self.demand(own, &options[own.number], &cameras))
            .collect::<Result<Vec<_>>>();
        let demands = ranks.agree(demands)?;
        let demands = all(ranks, demands)?;
        for (spread, own) in spreads.iter_mut().zip(SurfelDemand::share(&demands)) {
            if let Some((own, _)) = own {
                *spread = own;
            }
        }
        Ok(spreads)
    }

    /// Returns the number of surfels that an input would get by itself; `None` if it gets none.
    fn demand(
        &self,
        own: &mut Own,
        options: &SampleOptions,
        cameras: &[Camera],
    ) -> Result<Option<SurfelDemand>> {
        if !own.look.is_surface || own.nothing.is_some() {
            return Ok(None);
        }
        let is_kept = own.dataset.is_some();
        let dataset = self.taken(own, options)?;
        let demand = match &dataset.geometry {
            Geometry::Mesh(mesh) if self.is_alone() => {
                Some(SurfelDemand::without_count(mesh, cameras))
            }
            Geometry::Mesh(mesh) => Some(SurfelDemand::of(mesh, cameras)),
            _ => None,
        };
        own.dataset = is_kept.then_some(dataset);
        Ok(demand)
    }

    /// Collects the results of all ranks, and notes the inputs that are left out because they hold
    /// nothing.
    fn gathered(
        &self,
        looks: Vec<Look>,
        mut own: Vec<Own>,
        options: &[SampleOptions],
        ranks: &mut dyn Collective,
    ) -> Result<Gathered> {
        let facts = own.iter().map(Own::facts);
        let facts = all(ranks, facts.collect())?;
        if !facts.is_empty() && facts.iter().all(|facts| facts.is_nothing) {
            let error = own.iter_mut().find_map(|own| own.nothing.take());
            ranks.agree(error.map_or(Ok(()), Err))?;
        }
        self.note_lines(facts.iter().map(|facts| &facts.lines));
        if let ([input], [own]) = (self.request.inputs, own.as_slice())
            && let Some(note) = uniform(&own.report, input)
        {
            self.note(note);
        }
        // A surface has no boundary of its own: it is drawn all the same.
        let left_out = self.request.inputs.iter().zip(&facts);
        let left_out =
            left_out.filter(|(input, facts)| facts.is_nothing && input.surface.is_none());
        let count = left_out.clone().count();
        if count > 0 {
            let paths = left_out.map(|(input, _)| input.path.clone());
            self.note(Note::LeftOut {
                count,
                whole: facts.len(),
                paths: paths.take(MOST_NAMED).collect(),
            });
        }
        let looks = looks.into_iter().zip(options);
        let mut selectors = Vec::new();
        let mut inputs = Vec::new();
        for ((look, options), facts) in looks.zip(facts) {
            if selectors.is_empty() {
                selectors = look.selectors;
            }
            inputs.push(InputFacts {
                report: SampleReport {
                    field: facts.field,
                    unit: facts.unit,
                    smoothing: facts.smoothing,
                    refined_count: facts.refined_count,
                    refined_level: facts.refined_level,
                    may_refine: facts.may_refine,
                    ..SampleReport::default()
                },
                kind: look.kind,
                up: look.up.into(),
                corners: look.corners.filter(|_| !facts.is_nothing).map(corners_of),
                is_automatic: is_automatic(options),
                volume_count: facts.volume_count,
                is_classified: facts.is_classified,
                has_opacity: facts.has_opacity,
                is_nothing: facts.is_nothing,
            });
        }
        Ok(Gathered {
            inputs,
            volumes: own.into_iter().map(|own| own.volumes).collect(),
            selectors,
        })
    }
}

impl Look {
    fn choices(&self) -> Vec<FieldChoice> {
        let choices = self.choices.iter().cloned();
        choices
            .map(|(name, ranges, rank)| FieldChoice { name, ranges, rank })
            .collect()
    }
}

impl Own {
    /// Returns the direction up.
    pub(super) fn up(&self) -> Up {
        self.look.up.into()
    }

    /// Stores the result of sampling. An error that reports nothing to draw is kept until all
    /// inputs are read.
    pub(super) fn take_in(&mut self, sampled: Result<SampledScene>) -> Result<()> {
        match sampled {
            Ok(SampledScene { volumes, report }) => {
                (self.volumes, self.report) = (volumes, report);
                Ok(())
            }
            Err(error) if error.holds_nothing() => {
                self.nothing = Some(error);
                Ok(())
            }
            Err(error) => Err(error),
        }
    }

    /// Returns the facts about this input after sampling.
    fn facts(&self) -> Facts {
        let report = &self.report;
        let volumes = &self.volumes;
        Facts {
            field: report.field.clone(),
            unit: report.unit.clone(),
            smoothing: report.smoothing,
            refined_count: report.refined_count,
            refined_level: report.refined_level,
            may_refine: report.may_refine,
            volume_count: volumes.len(),
            is_classified: volumes.iter().any(|v| v.transfer_function.is_some()),
            has_opacity: has_opacity(volumes),
            lines: report.warnings(),
            is_nothing: self.nothing.is_some(),
        }
    }
}

/// Returns the directions up of the inputs that have a position.
fn ups(looks: &[Look]) -> impl Iterator<Item = Up> {
    let placed = looks.iter().filter(|look| look.corners.is_some());
    placed.map(|look| look.up.into())
}

/// Estimates the size of a data set in bytes.
fn byte_count(dataset: &Dataset) -> usize {
    let points = match &dataset.geometry {
        Geometry::Lattice(_) => 0,
        Geometry::Curvilinear { blocks } => blocks.iter().map(|block| block.nodes.len()).sum(),
        Geometry::Cells(mesh) => mesh.nodes.len() + mesh.connectivity.len() / 4,
        Geometry::Points { positions } => positions.len(),
        Geometry::Splats(cloud) => 4 * cloud.positions.len() + cloud.harmonics.len() / 6,
        Geometry::Mesh(mesh) => {
            let parts = mesh.parts.iter();
            let of_parts = parts.map(|part| 3 * part.positions.len() + part.triangles.len() / 2);
            let textures = mesh.textures.iter();
            let of_textures = textures.map(|t| t.image.pixels.len() / 6);
            of_parts.sum::<usize>() + of_textures.sum::<usize>()
        }
    };
    let arrays = dataset.fields.iter().flat_map(crate::io::Field::arrays);
    let values: usize = arrays.map(crate::scene::Values::len).sum();
    points
        .saturating_mul(size_of::<DVec3>())
        .saturating_add(values.saturating_mul(4))
}

/// Returns the error for the boundary of data that are a surface themselves.
fn without_volume(dataset: &Dataset) -> Error {
    let advice = Advice::no_data("draw it without an opacity of its boundary");
    let expected = "a grid with a volume";
    Error::format(&dataset.path, "boundary", expected, "a surface", advice)
}

/// Returns a note on a field that has one value everywhere.
fn uniform(report: &SampleReport, input: &Input) -> Option<Note> {
    let [least, greatest] = report.value_range?;
    let field = report.field.clone()?;
    let is_one = least >= greatest && report.sample_count > 1;
    is_one.then(|| Note::Uniform {
        path: input.path.clone(),
        field,
        value: least,
        is_of_step: input.time.is_some(),
    })
}
