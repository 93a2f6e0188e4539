//! Loads inputs on many ranks. Each rank reads a part of an input that can be read in parts, or some of several
//! inputs. The first rank reads all others, and scatters them.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::mem::take;

use glam::DVec3;

use super::alone::load_alone;
use super::collection::{Collection, Gathered};
use super::edit::Edit;
use super::facts::{InputFacts, Kind, is_automatic};
use super::input::Input;
use super::loaded::Loaded;
use super::note::Event;
use super::parts::{
    PartRead, assigned, distribute, read_grid, read_pieces, read_planes, read_rows, read_together,
    scatter,
};
use super::prepared::is_prepared;
use super::request::Request;
use crate::blocks::ParticleStream;
use crate::collective::Collective;
use crate::data::up::Up;
use crate::error::{Error, Result};
use crate::io::{Planes, RowFile, VtsPieces, VtuPieces};
use crate::prepared::{About, PointFile};
use crate::sample::{PartitionedRows, SampleOptions};

/// Least number of points or samples of an input that is read in parts.
const LEAST: usize = 1 << 22;

/// Loads inputs as one scene on all ranks.
///
/// # Errors
/// The errors of [`load`](super::load) on any rank; other files on other ranks.
pub(super) fn load(request: &Request<'_>, ranks: &mut dyn Collective) -> Result<Loaded> {
    let inputs = request.inputs;
    let is_whole = inputs.iter().any(|input| is_prepared(&input.path));
    let parts = match inputs {
        [input] if !is_whole && request.takes_parts => Parts::open(request, input),
        _ => Ok(None),
    };
    let parts = ranks.agree(parts)?;
    // On some ranks, the path may name another file or none.
    let found = match &parts {
        None if is_whole => 0,
        None => inputs.len() as u64,
        Some(parts) => parts.number(),
    };
    if let Some(rank) = ranks.first_other(found)? {
        let path = inputs
            .first()
            .map_or("inputs".into(), |own| own.path.clone());
        let advice = "put it where every rank sees it, under one name";
        let expected = "the same file on every rank";
        let found = format!("another, or none, on rank {rank}");
        return Err(Error::format(&path, "ranks", expected, found, advice));
    }
    match (inputs, parts) {
        _ if is_whole => load_alone(request),
        ([input], Some(parts)) => parts.load(request, input, ranks),
        ([_, _, ..], _) if request.takes_parts => load_some(request, ranks),
        _ => load_first(request, ranks),
    }
}

/// Opens an input as a stream of particles, if it is a file in which each point becomes one particle.
pub(crate) fn open_stream(request: &Request<'_>, input: &Input) -> Result<Option<PointFile>> {
    let is_plain = input.field.is_none() && input.function.is_none();
    let rows = match is_plain {
        true => open_rows(request, input)?,
        false => None,
    };
    let file = match rows {
        Some(rows) => PointFile::of(rows, request.sample)?,
        None => None,
    };
    if let Some(file) = &file {
        let is_classified = file.field().is_some();
        request
            .checks
            .input(Kind::Points, is_classified, request.sample)?;
    }
    Ok(file)
}

/// Opens an input as a file of rows, if it is large and no option edits or selects its data.
fn open_rows(request: &Request<'_>, input: &Input) -> Result<Option<RowFile>> {
    let open = request.open;
    // Folders and patterns are read whole.
    let is_of_rows = input.path.is_file()
        && input.edit == Edit::default()
        && input.time_step.is_none()
        && open.read_as.is_none()
        && open.scales.is_none();
    let rows = match is_of_rows {
        true => RowFile::open(&input.path, input.particle_type)?,
        false => None,
    };
    Ok(rows.filter(|rows| rows.count() >= LEAST))
}

/// File that all ranks read, each a part.
enum Parts {
    /// Points that are sampled row by row.
    Points(Box<PointFile>),
    /// Points that are sampled by their neighbours.
    Rows(Box<RowFile>, Box<SampleOptions>),
    /// Unstructured grid in pieces.
    Cells(Box<VtuPieces>, Box<SampleOptions>),
    /// Curvilinear grid in pieces.
    Grid(Box<VtsPieces>, Box<SampleOptions>),
    /// Planes of a lattice.
    Planes(Box<Planes>),
}

impl Parts {
    /// Opens an input; returns `None` if one rank must read it.
    fn open(request: &Request<'_>, input: &Input) -> Result<Option<Self>> {
        if let Some(file) = open_stream(request, input)? {
            return Ok(Some(Self::Points(Box::new(file))));
        }
        let options = Box::new(input.sample_options(request.sample));
        if let Some(mut file) = open_rows(request, input)? {
            let head = file.read(0..1)?;
            if PartitionedRows::of(&head, &options).is_some() {
                request.checks.input(Kind::Points, true, &options)?;
                return Ok(Some(Self::Rows(Box::new(file), options)));
            }
        }
        let open = request.open;
        let is_plain = input.path.is_file()
            && input.edit == Edit::default()
            && input.time_step.is_none()
            && input.particle_type.is_none()
            && open.scales.is_none();
        if is_plain && open.read_as.is_none() {
            if let Some(file) = VtuPieces::open(&input.path)? {
                return Ok(Some(Self::Cells(Box::new(file), options)));
            }
            if let Some(file) = VtsPieces::open(&input.path)? {
                return Ok(Some(Self::Grid(Box::new(file), options)));
            }
        }
        let is_sampled_alone = !options.makes_surface()
            && options.kernels.shepard_passes == 0
            && !options.purpose.normals;
        if !(is_plain && is_sampled_alone && input.function.is_none()) {
            return Ok(None);
        }
        let Some(file) = Planes::open(&input.path, open, options.field.as_deref())? else {
            return Ok(None);
        };
        // A lattice one layer thick becomes a surface. A small one is read by the first rank for all.
        let lattice = file.lattice();
        if lattice.dims.iter().any(|&n| n < 2) || lattice.len() < LEAST {
            return Ok(None);
        }
        let kind = kind_of(&file);
        request.checks.input(kind, true, &options)?;
        Ok(Some(Self::Planes(Box::new(file))))
    }

    /// Returns a hash of the file, by which ranks check that all have opened the same one.
    fn number(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        match self {
            Self::Points(file) => (1, file.len(), file.field()).hash(&mut hasher),
            Self::Rows(file, options) => (2, file.count(), &options.field).hash(&mut hasher),
            Self::Cells(file, options) => {
                let lengths: Vec<u64> = file.lengths().collect();
                (4, lengths, &options.field).hash(&mut hasher);
            }
            Self::Grid(file, options) => {
                let lengths: Vec<u64> = file.lengths().collect();
                (5, file.dims(), lengths, &options.field).hash(&mut hasher);
            }
            Self::Planes(file) => {
                (3, file.lattice().dims, file.field()).hash(&mut hasher);
                file.empty_values().type_name().hash(&mut hasher);
            }
        }
        hasher.finish()
    }

    /// Reads this rank's part.
    fn load(
        self,
        request: &Request<'_>,
        input: &Input,
        ranks: &mut dyn Collective,
    ) -> Result<Loaded> {
        let notes = |lines: &[String]| request.note_lines(input, lines);
        (request.observer)(Event::Reading(&input.path));
        let of_part = |own: Option<PartRead>, kind: Kind, options: &SampleOptions| {
            let Some(mut own) = own else {
                return Ok(None);
            };
            notes(&own.head.notes);
            notes(&own.report.warnings());
            request.checks.input(kind, true, options)?;
            let mut scene = Loaded::of_part(&own, kind.is_grid());
            scene.inputs = vec![InputFacts {
                is_automatic: is_automatic(options),
                ..InputFacts::of_part(kind, own.report, own.head.up(), own.corners)
            }];
            scene.volumes = take(&mut own.share.volumes);
            scene.share = Some(own.share);
            Ok(Some(scene))
        };
        let scene = match self {
            Self::Points(mut file) => {
                notes(file.notes());
                let mut share = read_together(&mut file, ranks)?;
                let report = file.report().cloned().unwrap_or_default();
                notes(&report.warnings());
                let mut scene = Loaded::of_stream(&file);
                let is_classified = file.field().is_some();
                scene.inputs = vec![InputFacts {
                    is_classified,
                    has_opacity: is_classified,
                    ..InputFacts::of_part(Kind::Points, report, file.up(), file.bounds())
                }];
                scene.volumes = take(&mut share.volumes);
                scene.share = Some(share);
                Some(scene)
            }
            Self::Rows(mut file, options) => of_part(
                read_rows(&mut file, &options, ranks)?,
                Kind::Points,
                &options,
            )?,
            Self::Cells(file, options) => {
                of_part(read_pieces(&file, &options, ranks)?, Kind::Grid, &options)?
            }
            Self::Grid(file, options) => {
                let cameras = |(a, b): (DVec3, DVec3), up| {
                    let up = Up::of_scene([up]);
                    (request.cameras)(&[((a + b) / 2.0, (b - a) / 2.0)], up)
                };
                let read = read_grid(&file, &options, &cameras, ranks)?;
                of_part(read, Kind::Grid, &options)?
            }
            Self::Planes(file) => {
                notes(file.notes());
                let options = input.sample_options(request.sample);
                let (mut share, report) = read_planes(&file, &options, ranks)?;
                notes(&report.warnings());
                let volumes = take(&mut share.volumes);
                let mut scene = Loaded::of_planes(&file, volumes, &report);
                let head = file.head();
                scene.inputs = vec![InputFacts {
                    is_automatic: is_automatic(&options),
                    ..InputFacts::of_part(kind_of(&file), report, head.up(), head.bounds())
                }];
                scene.share = Some(share);
                Some(scene)
            }
        };
        match scene {
            Some(scene) => request.checks.scene(scene),
            None => load_first(request, ranks),
        }
    }
}

fn kind_of(file: &Planes) -> Kind {
    match file.format() {
        "raw volume" => Kind::Raw,
        _ => Kind::Grid,
    }
}

/// Reads some of the inputs on each rank. Other ranks receive their metadata.
fn load_some(request: &Request<'_>, ranks: &mut dyn Collective) -> Result<Loaded> {
    let lengths = request.inputs.iter();
    let lengths = lengths.map(|input| std::fs::metadata(&input.path).map_or(0, |meta| meta.len()));
    // All ranks use the file lengths that the first rank finds, so that they make the same assignment.
    let lengths = ranks.gather_records(Ok(lengths.collect()))?.swap_remove(0);
    let collection = Collection {
        request: *request,
        own: assigned(&lengths, ranks.rank(), ranks.size()),
        beside: &[],
    };
    let Gathered {
        inputs, volumes, ..
    } = collection.read(ranks)?;
    let volumes = volumes.into_iter().flatten();
    let mut share = distribute(volumes.collect(), ranks)?;
    let volumes = take(&mut share.volumes);
    let mut scene = Loaded::of_inputs(volumes, inputs, request.sample);
    scene.share = Some(share);
    request.checks.scene(scene)
}

/// Reads the inputs on the first rank and scatters the volumes. Other ranks receive the scene's metadata.
fn load_first(request: &Request<'_>, ranks: &mut dyn Collective) -> Result<Loaded> {
    let own = match ranks.rank() {
        0 => load_alone(request).map(Some),
        _ => Ok(None),
    };
    let mut own_scene = None;
    let metadata = own.map(|own| {
        own_scene = own;
        let scene = own_scene.as_ref();
        scene.map(|scene| scene.about(request.inputs, request.sample.purpose.for_columns))
    });
    let about: About = ranks.broadcast_value(metadata)?;
    let volumes = own_scene.as_mut().map(|own| take(&mut own.volumes));
    let mut share = scatter(volumes, ranks)?;
    let mut scene = own_scene.unwrap_or_else(|| Loaded::of_about(about));
    scene.volumes = take(&mut share.volumes);
    scene.share = Some(share);
    Ok(scene)
}
