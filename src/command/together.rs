//! Reads several inputs as one scene. The inputs show one field if they have one in common, by one
//! transfer function. Surfels are spread by the pixels of the whole picture.
//!
//! If ranks share a scene, each rank reads some of the inputs, and all ranks make the same choices.

use std::collections::HashMap;
use std::ops::Range;

use glam::{DQuat, DVec3};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::edits::Edit;
use super::input::DataOptions;
use super::progress::note;
use super::reads::{ReadAbout, check_memory, has_opacity, is_automatic, uniform};
use super::source::Input;
use super::usage::Kind;
use super::viewpoint::{Cameras, is_seen};
use crate::collective::Collective;
use crate::command::words::axis;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::Mesh;
use crate::data::up::Up;
use crate::edit::{Placement, place};
use crate::math::rotation_matrix;
use crate::message::{put, take, unknown};
use crate::prepared::about::Function;
use crate::sample::mesh::{Spread, pixels_per_area, share_out, surfel_count};
use crate::sample::{
    FieldChoice, SampleOptions, SampleReport, SampledScene, TransferChoice, as_surface, automatic,
    field_choices, function_of_file, shared_fields, shared_functions, surface_report,
};
use crate::scene::{Particles, PointVolume, TransferFunction, ValueSample};
use crate::view::{Bounds, Camera};
use crate::{Error, Renderer, Result, SceneOptions};

/// Most memory for data sets that are kept from the first look to the sampling, in bytes. Others
/// are read again.
const KEPT: usize = 1 << 30;

/// Largest number of empty files that a note names.
const MOST_NAMED: usize = 3;

/// Number of surfels of a mesh that no camera sees.
const UNSEEN: usize = 256;

/// Number of positions sampled to find where most particles of a volume are, if no transfer
/// function shows them.
const PLACES: usize = 4096;

/// Fraction of these positions that may lie beyond the box, on each side.
const BEYOND: f64 = 0.02;

type Corners = (DVec3, DVec3);

/// Facts about an input that all ranks need before any input is sampled.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Look {
    kind: Kind,
    up: ToldUp,
    corners: Option<[[f64; 3]; 2]>,
    selectors: Vec<String>,
    /// True if the input becomes surfels.
    is_surface: bool,
    /// Candidates for the field to show: name, ranges of components, rank.
    choices: Vec<(String, Vec<[f64; 2]>, u8)>,
    /// Axis that points up by the format or by convention, and the reason.
    axes: [f64; 3],
    reason: String,
    says: Says,
    /// Notes of the reader.
    lines: Vec<String>,
    /// True if the input has the field that is asked for.
    has_field: bool,
    /// True if the input should have that field and lacks it.
    is_lacking: bool,
}

/// Certainty of the axes of an input.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Says {
    /// The format defines the axes.
    Axes,
    /// Most files of the format have these axes.
    MostlyAxes,
    /// The axes are convention alone, or the user placed the input.
    Nothing,
}

/// [`Up`] in the form that ranks send.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct ToldUp {
    direction: [f64; 3],
    front: Option<[f64; 3]>,
    is_plane: bool,
    is_of_mesh: bool,
}

impl From<Up> for ToldUp {
    fn from(up: Up) -> Self {
        Self {
            direction: up.direction.to_array(),
            front: up.front.map(|front| front.to_array()),
            is_plane: up.is_plane,
            is_of_mesh: up.is_of_mesh,
        }
    }
}

impl From<ToldUp> for Up {
    fn from(told: ToldUp) -> Self {
        Self {
            direction: DVec3::from(told.direction),
            reason: "as the data say",
            front: told.front.map(DVec3::from),
            is_plane: told.is_plane,
            is_of_mesh: told.is_of_mesh,
        }
    }
}

/// Facts about an input after sampling.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Facts {
    field: Option<String>,
    unit: Option<String>,
    volume_count: usize,
    is_classified: bool,
    has_opacity: bool,
    /// Warnings of the sampler.
    lines: Vec<String>,
    is_nothing: bool,
}

/// Input that this process reads.
struct Own {
    number: usize,
    look: Look,
    /// Data set to sample, if it is kept in memory.
    dataset: Option<Dataset>,
    /// Rotation to the axes of the scene.
    turn: Option<DQuat>,
    volumes: Vec<PointVolume>,
    report: SampleReport,
    /// Error that reports that the input holds nothing to draw.
    nothing: Option<Error>,
    /// Error that reports that the input lacks the field that is asked for.
    absence: Option<Error>,
}

/// Inputs of data that are drawn together.
pub(super) struct Together<'a> {
    pub(super) data: &'a DataOptions,
    /// All inputs, those of other ranks among them.
    pub(super) inputs: &'a [Input],
    /// Numbers of the inputs that this process reads.
    pub(super) own: Range<usize>,
    pub(super) options: &'a SampleOptions,
    /// Cameras of the pictures.
    pub(super) cameras: Cameras<'a>,
    /// Corners and directions up of the data that are drawn beside the inputs.
    pub(super) beside: &'a [(Option<Corners>, Up)],
    pub(super) progress: &'a ProgressBar,
}

/// Inputs after reading and sampling.
pub(super) struct Gathered {
    /// Facts about all inputs, in their order.
    pub(super) abouts: Vec<ReadAbout>,
    /// Volumes of the inputs that this process read, input by input.
    pub(super) volumes: Vec<Vec<PointVolume>>,
    /// Fields and components of the first input that can be shown.
    pub(super) selectors: Vec<String>,
}

/// Choices that all steps of a series share.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    /// Transfer function of all steps.
    pub(crate) transfer: TransferChoice,
    /// Field that the steps show if none is named.
    pub(crate) field: Option<String>,
    /// Boxes around the data of all steps.
    pub(crate) boxes: Vec<Bounds>,
    /// Direction up of the first step.
    pub(crate) up: Up,
}

impl Series {
    /// Returns the options that sample a step.
    pub(crate) fn of_step(&self, options: &SampleOptions) -> SampleOptions {
        SampleOptions {
            transfer: self.transfer.clone(),
            preferred_field: self.field.clone(),
            ..options.clone()
        }
    }
}

/// Gathers the items of all ranks, in the order of the inputs. A single process returns its own.
fn all<T>(ranks: &mut Option<&mut dyn Collective>, own: Vec<T>) -> Result<Vec<T>>
where
    T: Serialize + DeserializeOwned,
{
    match ranks {
        None => Ok(own),
        Some(ranks) => Ok(ranks.gather_values(own)?.into_iter().flatten().collect()),
    }
}

/// Returns this rank's result if all ranks succeed; otherwise an error.
fn agreed<T>(ranks: &mut Option<&mut dyn Collective>, own: Result<T>) -> Result<T> {
    match ranks {
        None => own,
        Some(ranks) => ranks.agree(own),
    }
}

/// Converts the corners of a box to arrays, the form that ranks send.
fn told((low, high): Corners) -> [[f64; 3]; 2] {
    [low.to_array(), high.to_array()]
}

fn heard([low, high]: [[f64; 3]; 2]) -> Corners {
    (low.into(), high.into())
}

impl Together<'_> {
    /// Reads and samples the inputs, and prints notes on what was left out.
    ///
    /// # Errors
    /// Errors of reading and sampling on any rank; a field that no input has; nothing to draw in
    /// any input.
    pub(super) fn read(&self, ranks: &mut Option<&mut dyn Collective>) -> Result<Gathered> {
        let own = self.opened();
        let mut own = agreed(ranks, own)?;
        let mut looks = all(ranks, own.iter().map(|own| own.look.clone()).collect())?;
        self.say(looks.iter().map(|look| &look.lines));
        let turned = self.turn(&mut looks, &mut own);
        agreed(ranks, turned)?;
        self.check_field(&looks, &mut own, ranks)?;
        let options = self.chosen(&looks);
        // Samples inputs other than surfaces. From surfaces, it only reads the field values.
        let sampled = own
            .iter_mut()
            .try_for_each(|own| self.sample(own, &options[own.number]));
        agreed(ranks, sampled)?;
        let functions = self.functions(&mut own, &options, ranks)?;
        let options: Vec<SampleOptions> = options
            .into_iter()
            .enumerate()
            .map(|(i, options)| match functions.get(&i) {
                None => options,
                Some(function) => SampleOptions {
                    transfer: TransferChoice::Shared(function.clone()),
                    keeps_value_sample: false,
                    ..options
                },
            })
            .collect();
        let shared = |own: &&mut Own| functions.contains_key(&own.number);
        let again = own
            .iter_mut()
            .filter(|own| !own.look.is_surface)
            .filter(shared)
            .try_for_each(|own| self.sample(own, &options[own.number]));
        agreed(ranks, again)?;
        let spreads = self.spreads(&looks, &mut own, &options, ranks)?;
        let surfaces = own
            .iter_mut()
            .filter(|own| own.look.is_surface)
            .try_for_each(|own| {
                let spread = spreads[own.number];
                let options = options[own.number].clone();
                self.spread(own, &SampleOptions { spread, ..options })
            });
        agreed(ranks, surfaces)?;
        self.gathered(looks, own, &options, ranks)
    }

    /// Reads the inputs as time steps, and returns the choices that they share.
    ///
    /// # Errors
    /// Errors of reading and sampling; a field that a step lacks; nothing to draw in any step.
    pub(super) fn series(&self) -> Result<Series> {
        let mut own = self.opened()?;
        if let Some(absence) = own.iter_mut().find_map(|own| own.absence.take()) {
            return Err(absence);
        }
        let looks: Vec<Look> = own.iter().map(|own| own.look.clone()).collect();
        let options = self.chosen(&looks);
        let (mut boxes, mut samples, mut ups) = (Vec::new(), Vec::new(), Vec::new());
        let mut ranges = Vec::new();
        let mut unit_distance = f64::INFINITY;
        let mut first = None;
        for own in &mut own {
            let options = &options[own.number];
            if own.nothing.is_none() {
                let dataset = self.taken(own, options)?;
                match &dataset.geometry {
                    Geometry::Mesh(mesh) => {
                        own.report = surface_report(&dataset, options)?;
                        boxes.extend(boxes_of(mesh));
                    }
                    _ => {
                        own.take_in(crate::sample::scene(dataset, options))?;
                        let whole = SceneOptions {
                            level_of_detail: false,
                            ..SceneOptions::default()
                        };
                        let volumes = std::mem::take(&mut own.volumes);
                        boxes.extend(Renderer::with_options(volumes, &whole)?.boxes());
                    }
                }
            }
            if own.nothing.is_some() {
                continue;
            }
            ranges.extend(own.report.value_range);
            unit_distance = unit_distance.min(own.report.unit_distance);
            samples.extend(own.report.value_sample.take());
            // The first step's direction up holds for all steps.
            let step = self.inputs[own.number].step;
            if *first.get_or_insert(step) == step {
                ups.push(own.look.up.into());
            }
        }
        if first.is_none()
            && let Some(error) = own.iter_mut().find_map(|own| own.nothing.take())
        {
            return Err(error);
        }
        let unit_distance = self.options.opacity_scale * unit_distance;
        let range = ranges
            .into_iter()
            .reduce(|[a, b]: [f64; 2], [c, d]| [a.min(c), b.max(d)]);
        let transfer = match (ValueSample::mean(samples), range) {
            // A preset is stretched over the values of all steps.
            (None, Some(range)) if matches!(self.options.transfer, TransferChoice::File(_)) => {
                let read = function_of_file(self.options, range, unit_distance)?;
                match read.stretched {
                    Some(_) => TransferChoice::Given(read.function),
                    None => self.options.transfer.clone(),
                }
            }
            (None, _) => self.options.transfer.clone(),
            (Some(sample), _) => {
                TransferChoice::Shared(automatic(&sample, self.options, unit_distance)?)
            }
        };
        Ok(Series {
            transfer,
            field: options.into_iter().find_map(|own| own.preferred_field),
            boxes,
            up: Up::of_scene(ups),
        })
    }

    fn is_alone(&self) -> bool {
        self.inputs.len() == 1
    }

    fn say<'b>(&self, lines: impl Iterator<Item = &'b Vec<String>>) {
        for (input, lines) in self.inputs.iter().zip(lines) {
            let path = input.path.display();
            for line in lines {
                self.progress.suspend(|| note!("{path}: {line}"));
            }
        }
    }

    fn message(&self, own: &Own) {
        let path = self.inputs[own.number].path.display();
        self.progress.set_message(format!("reading {path}"));
    }

    /// Opens the inputs of this rank, and collects the facts that all ranks need.
    fn opened(&self) -> Result<Vec<Own>> {
        let mut kept = 0_usize;
        let mut opened = Vec::new();
        for number in self.own.clone() {
            let input = &self.inputs[number];
            let path = input.path.display();
            self.progress.set_message(format!("reading {path}"));
            let mut own = self.look(number, input)?;
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
                axes: DVec3::Z.to_array(),
                reason: String::new(),
                says: Says::Nothing,
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
        let dataset = match self.data.open(input) {
            Ok(dataset) => dataset,
            Err(error) if error.holds_nothing() => {
                own.nothing = Some(error);
                return Ok(own);
            }
            Err(error) => return Err(error),
        };
        check_memory(&dataset)?;
        let look = &mut own.look;
        let (axes, reason, says) = axes_of(&dataset, input);
        (look.axes, look.reason, look.says) = (axes.to_array(), reason.to_owned(), says);
        look.kind = Kind::of(&dataset);
        look.up = dataset.up().into();
        look.corners = dataset.bounds().map(told);
        look.selectors = dataset.selectors();
        let options = self.data.of_input(input, self.options);
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
        let stays = |look: &&Look| look.says == Says::Nothing && look.corners.is_some();
        let says_up = |look: &&Look| look.corners.is_some() && Up::from(look.up) == scene;
        let first = looks.iter().find(stays);
        let first = first.or_else(|| looks.iter().find(says_up));
        let Some(to) = first.map(|look| DVec3::from(look.axes)) else {
            return Ok(());
        };
        // Surfaces beside a grid mostly have the grid's coordinates.
        let has_grid = looks.iter().any(|look| look.kind.is_grid());
        for (i, look) in looks.iter_mut().enumerate() {
            let from = DVec3::from(look.axes);
            if from == to || look.says == Says::Nothing || self.data.keeps_axes {
                continue;
            }
            let is_turned = look.says == Says::Axes || !has_grid;
            let path = self.inputs[i].path.display();
            let done = match is_turned {
                true => "turned to it; --keep-axes leaves it",
                false => "left as it is beside a grid; --rotate turns it",
            };
            let (reason, up, other) = (&look.reason, axis(from), axis(to));
            let say = || note!("{path}: {up} is up ({reason}), {other} in the picture: {done}");
            self.progress.suspend(say);
            if !is_turned {
                continue;
            }
            let turn = turn_between(from, to);
            let matrix = rotation_matrix(turn);
            look.corners = look.corners.map(|corners| {
                let (a, b) = heard(corners);
                let (a, b) = (matrix * a, matrix * b);
                told((a.min(b), a.max(b)))
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
        ranks: &mut Option<&mut dyn Collective>,
    ) -> Result<()> {
        let is_shown = looks.iter().any(|look| look.has_field);
        let absent = own.iter_mut().find_map(|own| own.absence.take());
        agreed(ranks, absent.filter(|_| !is_shown).map_or(Ok(()), Err))?;
        let field = self.options.field.as_deref().unwrap_or_default();
        for (input, look) in self.inputs.iter().zip(looks) {
            if look.is_lacking {
                let path = input.path.display();
                let say = || note!("{path}: no field `{field}`: shown by its own");
                self.progress.suspend(say);
            }
        }
        Ok(())
    }

    /// Returns the options of each input. If no field is named, inputs show one that they have in
    /// common.
    fn chosen(&self, looks: &[Look]) -> Vec<SampleOptions> {
        let keeps = self.inputs.len() > 1 && !self.options.for_columns;
        let of_input = |(input, look): (&Input, &Look)| {
            let mut own = self.data.of_input(input, self.options);
            own.field.take_if(|_| look.is_lacking);
            SampleOptions {
                keeps_value_sample: keeps || own.keeps_value_sample,
                ..own
            }
        };
        let mut options: Vec<SampleOptions> = self.inputs.iter().zip(looks).map(of_input).collect();
        let choices: Vec<Vec<FieldChoice>> = looks.iter().map(Look::choices).collect();
        prefer(&mut options, choices);
        options
    }

    /// Returns the data set of an input for sampling: the one kept in memory, or else read again.
    fn taken(&self, own: &mut Own, options: &SampleOptions) -> Result<Dataset> {
        match own.dataset.take() {
            Some(dataset) => Ok(dataset),
            None => {
                self.message(own);
                let dataset = self.data.open(&self.inputs[own.number])?;
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
        self.message(own);
        let dataset = self.taken(own, options)?;
        own.take_in(crate::sample::scene(dataset, options))
    }

    /// Returns the transfer functions that inputs share, by the inputs' numbers. The first rank
    /// chooses them from the values of all ranks.
    fn functions(
        &self,
        own: &mut [Own],
        options: &[SampleOptions],
        ranks: &mut Option<&mut dyn Collective>,
    ) -> Result<HashMap<usize, TransferFunction>> {
        let told = own.iter().map(|own| {
            let report = &own.report;
            (report.field.clone(), report.unit_distance.to_bits())
        });
        let told: Vec<(Option<String>, u64)> = all(ranks, told.collect())?;
        let samples = match ranks {
            None => {
                let own = own.iter_mut();
                let samples = own.map(|own| (own.number, own.report.value_sample.take()));
                samples.collect()
            }
            Some(ranks) => samples_of_all(own, &mut **ranks)?,
        };
        let choose = || {
            let mut reports: Vec<SampleReport> = told
                .into_iter()
                .map(|(field, bits)| SampleReport {
                    field,
                    unit_distance: f64::from_bits(bits),
                    ..SampleReport::default()
                })
                .collect();
            for (number, sample) in samples {
                if let Some(report) = reports.get_mut(number) {
                    report.value_sample = sample;
                }
            }
            shared_functions(&mut reports.iter_mut().zip(options).collect::<Vec<_>>())
        };
        let shared = match ranks {
            None => choose()?,
            Some(ranks) => {
                let told = (ranks.rank() == 0).then(|| {
                    let shared = choose()?.into_iter();
                    let shared = shared.map(|(function, of)| (Function::of(&function), of));
                    Ok(shared.collect::<Vec<_>>())
                });
                let told: Vec<(Function, Vec<usize>)> = ranks.broadcast_value(told.transpose())?;
                let own = told.into_iter().map(|(function, of)| {
                    let function = function.transfer();
                    Ok((function.ok_or_else(|| unknown("no transfer function"))?, of))
                });
                own.collect::<Result<Vec<_>>>()?
            }
        };
        let each = shared
            .into_iter()
            .flat_map(|(function, of)| of.into_iter().map(move |i| (i, function.clone())));
        Ok(each.collect())
    }

    /// Returns how surfels are spread over each input. If no number is asked for, the pixels of the
    /// pictures determine it; all meshes together get no more surfels than one would.
    fn spreads(
        &self,
        looks: &[Look],
        own: &mut [Own],
        options: &[SampleOptions],
        ranks: &mut Option<&mut dyn Collective>,
    ) -> Result<Vec<Spread>> {
        let asked = self.options.spread;
        let mut spreads = vec![asked; looks.len()];
        if asked != Spread::Automatic || !looks.iter().any(|look| look.is_surface) {
            return Ok(spreads);
        }
        let seen = own.iter().map(|own| {
            let volumes = own.volumes.iter().filter_map(seen_corners);
            let volumes = volumes.reduce(joined);
            match own.look.is_surface {
                true => own.look.corners,
                false => volumes.map(told),
            }
        });
        let seen: Vec<Option<[[f64; 3]; 2]>> = all(ranks, seen.collect())?;
        let beside = self.beside.iter().filter_map(|(corners, _)| *corners);
        let corners = beside.chain(seen.into_iter().flatten().map(heard));
        let boxes: Vec<Bounds> = corners
            .map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0))
            .collect();
        let beside = self.beside.iter().map(|(_, up)| *up);
        let up = Up::of_scene(beside.chain(ups(looks)));
        let cameras = match boxes.is_empty() {
            true => Vec::new(),
            false => (self.cameras)(&boxes, up)?,
        };
        let wanted = own
            .iter_mut()
            .map(|own| self.wanted(own, &options[own.number], &cameras))
            .collect::<Result<Vec<Wanted>>>();
        let wanted = agreed(ranks, wanted)?;
        let wanted = all(ranks, wanted)?;
        let counts: Vec<usize> = wanted.iter().map(|own| own.count).collect();
        let is_alone = self.is_alone();
        for ((spread, own), count) in spreads.iter_mut().zip(&wanted).zip(share_out(&counts)) {
            *spread = own.spread(count, is_alone);
        }
        Ok(spreads)
    }

    /// Returns the number of surfels that an input would get by itself.
    fn wanted(&self, own: &mut Own, options: &SampleOptions, cameras: &[Camera]) -> Result<Wanted> {
        if !own.look.is_surface || own.nothing.is_some() {
            return Ok(Wanted::default());
        }
        let is_kept = own.dataset.is_some();
        let dataset = self.taken(own, options)?;
        let wanted = match &dataset.geometry {
            Geometry::Mesh(mesh) if self.is_alone() => Wanted::without_count(mesh, cameras),
            Geometry::Mesh(mesh) => Wanted::of(mesh, cameras),
            _ => Wanted::default(),
        };
        own.dataset = is_kept.then_some(dataset);
        Ok(wanted)
    }

    /// Collects the results of all ranks, and notes the inputs that are left out because they hold
    /// nothing.
    fn gathered(
        &self,
        looks: Vec<Look>,
        mut own: Vec<Own>,
        options: &[SampleOptions],
        ranks: &mut Option<&mut dyn Collective>,
    ) -> Result<Gathered> {
        let alone = |own: &Own| self.inputs.get(own.number).filter(|_| self.is_alone());
        let facts = own.iter().map(|own| own.facts(alone(own)));
        let facts = all(ranks, facts.collect())?;
        let is_nothing = |facts: &&Facts| facts.is_nothing;
        if !facts.is_empty() && facts.iter().all(|facts| facts.is_nothing) {
            let error = own.iter_mut().find_map(|own| own.nothing.take());
            agreed(ranks, error.map_or(Ok(()), Err))?;
        }
        self.say(facts.iter().map(|facts| &facts.lines));
        let count = facts.iter().filter(is_nothing).count();
        if count > 0 {
            let left_out = self.inputs.iter().zip(&facts);
            let left_out = left_out.filter(|(_, facts)| facts.is_nothing);
            let names = left_out.map(|(input, _)| input.path.display().to_string());
            let mut named = names.take(MOST_NAMED).collect::<Vec<_>>().join(", ");
            if count > MOST_NAMED {
                named += ", ...";
            }
            let whole = facts.len();
            let say = || {
                note!("{count} of {whole} inputs hold nothing to draw and are left out: {named}")
            };
            self.progress.suspend(say);
        }
        let looks = looks.into_iter().zip(options);
        let mut selectors = Vec::new();
        let mut abouts = Vec::new();
        for ((look, options), facts) in looks.zip(facts) {
            if selectors.is_empty() {
                selectors = look.selectors;
            }
            abouts.push(ReadAbout {
                report: SampleReport {
                    field: facts.field,
                    unit: facts.unit,
                    ..SampleReport::default()
                },
                kind: look.kind,
                up: look.up.into(),
                corners: look.corners.filter(|_| !facts.is_nothing).map(heard),
                is_automatic: is_automatic(options),
                volume_count: facts.volume_count,
                is_classified: facts.is_classified,
                has_opacity: facts.has_opacity,
                is_nothing: facts.is_nothing,
            });
        }
        Ok(Gathered {
            abouts,
            volumes: own.into_iter().map(|own| own.volumes).collect(),
            selectors,
        })
    }
}

/// Sets the preferred field of options without a named field to one that the data sets have in
/// common. An earlier preference stays if the data set has that field.
pub(super) fn prefer(options: &mut [SampleOptions], mut choices: Vec<Vec<FieldChoice>>) {
    for (own, choices) in options.iter().zip(&mut choices) {
        let has_preferred = own.preferred_field.as_ref().is_some_and(|name| {
            let mut names = choices.iter().map(|own| &own.name);
            names.any(|own| own.eq_ignore_ascii_case(name))
        });
        if own.field.is_some() || has_preferred {
            choices.clear();
        }
    }
    for (own, shared) in options.iter_mut().zip(shared_fields(&choices)) {
        own.preferred_field = shared.or(own.preferred_field.take());
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
    /// Stores the result of sampling. An error that reports nothing to draw is kept until all
    /// inputs are read.
    fn take_in(&mut self, sampled: Result<SampledScene>) -> Result<()> {
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
    ///
    /// - `input`: the input, if it is drawn alone.
    fn facts(&self, input: Option<&Input>) -> Facts {
        let report = &self.report;
        let volumes = &self.volumes;
        let uniform = input.and_then(|input| uniform(report, input));
        Facts {
            field: report.field.clone(),
            unit: report.unit.clone(),
            volume_count: volumes.len(),
            is_classified: volumes.iter().any(|v| v.transfer_function.is_some()),
            has_opacity: has_opacity(volumes),
            lines: report.warnings().into_iter().chain(uniform).collect(),
            is_nothing: self.nothing.is_some(),
        }
    }
}

/// Gathers on the first rank the value samples from which transfer functions are chosen, each with
/// the number of its input.
fn samples_of_all(
    own: &mut [Own],
    ranks: &mut dyn Collective,
) -> Result<Vec<(usize, Option<ValueSample>)>> {
    let mut samples = Vec::new();
    for own in own {
        if let Some(sample) = own.report.value_sample.take() {
            let (records, has_surroundings) = sample.to_records();
            put(
                &mut samples,
                &[own.number as u64, u64::from(has_surroundings)],
            );
            put(&mut samples, &records);
        }
    }
    let mut found = Vec::new();
    for part in ranks.gather_on_first(Ok(samples))? {
        let mut part = part.as_slice();
        while !part.is_empty() {
            let (of, records) = (take::<u64>(&mut part)?, take::<[f64; 3]>(&mut part)?);
            let number = of.first().and_then(|&i| usize::try_from(i).ok());
            let sample = ValueSample::of_records(&records, of.get(1) == Some(&1));
            found.extend(number.map(|number| (number, Some(sample))));
        }
    }
    Ok(found)
}

/// Returns the directions up of the inputs that have a position.
fn ups(looks: &[Look]) -> impl Iterator<Item = Up> {
    let placed = looks.iter().filter(|look| look.corners.is_some());
    placed.map(|look| look.up.into())
}

/// Returns the axis that points up in the coordinates of an input, the reason, and its certainty.
fn axes_of(dataset: &Dataset, input: &Input) -> (DVec3, &'static str, Says) {
    let is_placed = input.edit != Edit::default();
    let (axes, reason, says) = match (dataset.format_up, &dataset.geometry) {
        (Some((up, reason)), _) if dataset.format.contains("OBJ") => (up, reason, Says::MostlyAxes),
        (Some((up, reason)), _) => (up, reason, Says::Axes),
        (None, Geometry::Splats(_)) => {
            let reason = "training scenes of splats have y down";
            (DVec3::NEG_Y, reason, Says::Axes)
        }
        (None, _) => (DVec3::Z, "z by convention", Says::Nothing),
    };
    // An input that the user placed is not rotated.
    let says = if is_placed { Says::Nothing } else { says };
    (axes, reason, says)
}

/// Rotates a data set about the origin.
fn turned(dataset: Dataset, turn: Option<DQuat>) -> Result<Dataset> {
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

/// Number of surfels that a mesh would get by itself.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Wanted {
    /// Largest number of surfels per unit area, if pictures determine it.
    density: Option<f64>,
    count: usize,
    is_unseen: bool,
}

impl Wanted {
    /// Computes the number of surfels.
    ///
    /// - `cameras`: cameras of the pictures; empty if they are not known.
    pub fn of(mesh: &Mesh, cameras: &[Camera]) -> Self {
        let own = Self::without_count(mesh, cameras);
        let spread = own.density.map_or(Spread::Automatic, Spread::NoDenser);
        let count = match own.is_unseen {
            true => UNSEEN,
            // Sampling reports the errors of a mesh.
            false => surfel_count(mesh, spread).unwrap_or_default(),
        };
        Self { count, ..own }
    }

    /// Computes everything but the count.
    fn without_count(mesh: &Mesh, cameras: &[Camera]) -> Self {
        let densities = cameras
            .iter()
            .filter_map(|camera| pixels_per_area(mesh, camera));
        let density = densities.reduce(f64::max);
        let is_unseen =
            density.is_none() && !cameras.is_empty() && !cameras.iter().any(|c| is_seen(mesh, c));
        Self {
            density,
            count: 0,
            is_unseen,
        }
    }

    /// Returns the number of surfels that the mesh would get.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns how surfels are spread over the mesh.
    ///
    /// - `count`: the mesh's share of all surfels, if the mesh is not alone.
    pub fn spread(&self, count: usize, is_alone: bool) -> Spread {
        match (self.density, is_alone) {
            _ if self.is_unseen => Spread::Count(UNSEEN),
            (None, true) => Spread::Automatic,
            (Some(density), true) => Spread::NoDenser(density),
            (None, false) => Spread::Count(count.max(1)),
            (Some(density), false) => Spread::Within { density, count },
        }
    }
}

fn joined(a: Corners, b: Corners) -> Corners {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Returns the corners of the visible part of a volume: where its transfer function shows
/// something, or where most of its particles are.
fn seen_corners(volume: &PointVolume) -> Option<Corners> {
    let particles = &volume.particles;
    let count = particles.len();
    let position = |i: usize| match particles {
        Particles::Lattice { lattice, .. } => {
            let [x, y, _] = lattice.dims;
            lattice.position([i % x, i / x % y, i / (x * y)])
        }
        _ => particles.positions()[i],
    };
    if let (Some(function), Some(values)) = (&volume.transfer_function, &volume.values) {
        let [low, high] = function.range();
        let least = (function.max_extinction(low, high) * crate::constants::FAINT_SHARE)
            .max(f32::MIN_POSITIVE);
        let shown = (0..count).into_par_iter().filter(|&i| {
            let value = values.get(i);
            value.is_finite() && function.classify(value)[3] >= least
        });
        let places = shown.map(|i| (position(i), position(i)));
        return places.reduce_with(joined);
    }
    let stride = count.div_ceil(PLACES).max(1);
    let places: Vec<DVec3> = (0..count).step_by(stride).map(position).collect();
    let ends = |axis: usize| {
        let along = places.iter().map(|p| p[axis]).filter(|x| x.is_finite());
        let mut along: Vec<f64> = along.collect();
        along.sort_by(f64::total_cmp);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a few thousand"
        )]
        let beyond = (along.len() as f64 * BEYOND) as usize;
        Some((
            *along.get(beyond)?,
            *along.get(along.len().checked_sub(1 + beyond)?)?,
        ))
    };
    let [x, y, z] = [ends(0)?, ends(1)?, ends(2)?];
    Some((DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1)))
}

/// Returns boxes around runs of triangles, lines and points of a mesh.
fn boxes_of(mesh: &Mesh) -> Vec<Bounds> {
    /// Triangles in a run: neighbours in a file are mostly neighbours in space.
    const RUN: usize = 256;
    let mut boxes = Vec::new();
    for part in &mesh.parts {
        let place = |&i: &u32| part.positions.get(i as usize).filter(|p| p.is_finite());
        let mut add = |indices: &mut dyn Iterator<Item = &u32>| {
            let ends = indices.filter_map(place).map(|&p| (p, p)).reduce(joined);
            boxes.extend(ends.map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0)));
        };
        let triangles = part.triangles.chunks(RUN);
        triangles.for_each(|run| add(&mut run.iter().flatten()));
        let lines = part.lines.chunks(RUN);
        lines.for_each(|run| add(&mut run.iter().flatten()));
        part.points.chunks(RUN).for_each(|run| add(&mut run.iter()));
    }
    boxes
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

/// The rotation that brings one direction up to another. Between y up and y down it is half a turn about z, as `convert` turns
/// glTF to PLY: both have z forward.
fn turn_between(from: DVec3, to: DVec3) -> DQuat {
    match from == -to {
        true if to.y.abs() > 0.5 => DQuat::from_rotation_z(std::f64::consts::PI),
        true => DQuat::from_rotation_x(std::f64::consts::PI),
        false => DQuat::from_rotation_arc(from, to),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_directions_up_turn_as_convert_does() {
        let p = DVec3::new(1.0, 2.0, 3.0);
        for (from, to, expected) in [
            (DVec3::NEG_Y, DVec3::Y, [-1.0, -2.0, 3.0]),
            (DVec3::Y, DVec3::NEG_Y, [-1.0, -2.0, 3.0]),
            (DVec3::NEG_Z, DVec3::Z, [1.0, -2.0, -3.0]),
            (DVec3::Y, DVec3::Z, [1.0, -3.0, 2.0]),
        ] {
            let turned = turn_between(from, to) * p;
            assert!(
                (turned - DVec3::from(expected)).length() < 1e-12,
                "{from} {to}"
            );
        }
    }
}
