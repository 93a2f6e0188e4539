//! Draws a session's data together with the sessions of other ranks, each of which holds a part of the data.
//!
//! All ranks give as many drawables, with the same options. Those of one number, the parts of one rank after another, are
//! one data set if they are points or cells, and data sets of their own otherwise. All ranks draw the same pictures in the
//! same order; the first one gets them.

use std::fmt::Display;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::drawable::Drawable;
use super::sampled::{Purpose, Sampled};
use super::source::{Data, Source};
use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::frame::backdrop::GivenBackdrop;
use crate::image::{DepthImage, Image};
use crate::io::{CellMesh, Dataset, Geometry, SphKernel, Up};
use crate::legend::title_of;
use crate::load::choices::{functions_of_all, with_shared};
use crate::load::collection::{SentUp, arrays_of, corners_of};
use crate::load::parts::{distribute, held_together, outline_of_all};
use crate::load::{SurfelDemand, prefer};
use crate::message::{put, take};
use crate::ranks::Share;
use crate::sample::mesh::Spread;
use crate::sample::{
    FieldChoice, MeanPart, SampleOptions, SampleReport, common_smoothing, field_choices,
};
use crate::scene::{Particles, PointVolume, TransferFunction};
use crate::view::Bounds;

/// A rank's end of the group, which a session and its renderers use in turn.
#[derive(Debug, Clone)]
pub(super) struct Ranks {
    rank: usize,
    size: usize,
    shared: Arc<Mutex<Box<dyn Collective>>>,
}

impl Ranks {
    pub(super) fn new(own: Box<dyn Collective>) -> Self {
        Self {
            rank: own.rank(),
            size: own.size(),
            shared: Arc::new(Mutex::new(own)),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Box<dyn Collective>> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns this rank's result if all ranks are in the same call and have one.
    pub(super) fn agreed<T, E: From<Error> + Display>(
        &mut self,
        call: &'static str,
        own: Result<T, E>,
    ) -> Result<T, E> {
        let rank = self.rank;
        let part = match &own {
            Ok(_) => Ok(call.as_bytes().to_vec()),
            Err(error) => Err(Error::of_rank(rank, error.to_string())),
        };
        let ranks: &mut dyn Collective = self;
        let all = ranks.gather_parts(part);
        let own = own?;
        let all = all?;
        match all.iter().position(|other| *other != all[0]) {
            None => Ok(own),
            Some(rank) => {
                let name = |part: &[u8]| String::from_utf8_lossy(part).into_owned();
                Err(E::from(Error::invalid(
                    "ranks",
                    "call",
                    format!("{} on every rank, as on rank 0", name(&all[0])),
                    format!("{} on rank {rank}", name(&all[rank])),
                    "call the same functions in the same order on every rank",
                )))
            }
        }
    }

    /// Returns the first rank's answers.
    pub(super) fn of_first<const N: usize>(&mut self, own: [bool; N]) -> Result<[bool; N]> {
        let own = (self.rank == 0).then(|| own.map(u8::from).to_vec());
        let ranks: &mut dyn Collective = self;
        let first = ranks.broadcast(0, Ok(own))?;
        Ok(std::array::from_fn(|n| first.get(n) == Some(&1)))
    }

    /// Checks that all ranks have the same text.
    pub(super) fn check_same(&mut self, what: &'static str, own: &str) -> Result<()> {
        let ranks: &mut dyn Collective = self;
        let all = ranks.gather_parts(Ok(hash_of(own).to_le_bytes().to_vec()))?;
        match all.iter().position(|other| *other != all[0]) {
            None => Ok(()),
            Some(rank) => Err(Error::invalid(
                "ranks",
                what,
                "the same on every rank",
                format!("others on rank {rank} than on rank 0"),
                "call the same functions with the same settings on every rank",
            )),
        }
    }

    /// Returns the first rank's backdrop.
    pub(super) fn first_backdrop(&mut self, own: &GivenBackdrop) -> Result<GivenBackdrop> {
        let mut part = Vec::new();
        let sizes = [
            own.depth.as_ref().map(|own| [own.width, own.height]),
            own.colours.as_ref().map(|own| [own.width, own.height]),
        ];
        for size in sizes {
            let size = size.map(|size| size.map(|n| n as u64));
            put(&mut part, size.as_ref().map_or(&[][..], |size| &size[..]));
        }
        if self.rank == 0 {
            put(&mut part, own.depth.as_ref().map_or(&[], |own| &own.depths));
            put(
                &mut part,
                own.colours.as_ref().map_or(&[], |own| &own.pixels),
            );
        }
        let own_part = (self.rank == 0).then_some(part);
        let ranks: &mut dyn Collective = self;
        let part = ranks.broadcast(0, Ok(own_part))?;
        if ranks.rank() == 0 {
            return Ok(own.clone());
        }
        let mut part = part.as_slice();
        let size = |sides: Vec<u64>| match sides[..] {
            [x, y] => Some([x, y].map(|n| usize::try_from(n).unwrap_or(0))),
            _ => None,
        };
        let sizes = [size(take(&mut part)?), size(take(&mut part)?)];
        let (depths, pixels) = (take(&mut part)?, take(&mut part)?);
        Ok(GivenBackdrop {
            depth: sizes[0].map(|[width, height]| DepthImage {
                width,
                height,
                depths,
            }),
            colours: sizes[1].map(|[width, height]| Image {
                width,
                height,
                pixels,
            }),
            ..own.clone()
        })
    }
}

impl Collective for Ranks {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn begin(&mut self, parts: Vec<Vec<u8>>) -> Result<()> {
        self.lock().begin(parts)
    }

    fn complete(&mut self) -> Result<Vec<Vec<u8>>> {
        self.lock().complete()
    }

    fn gather(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>> {
        self.lock().gather(part)
    }
}

fn hash_of(text: &str) -> u64 {
    use std::hash::{DefaultHasher, Hash, Hasher};
    let mut hasher = DefaultHasher::new();
    text.hash(&mut hasher);
    hasher.finish()
}

/// The data of all ranks: what must be known of the parts of others.
#[derive(Debug)]
pub(super) struct Parts {
    pub(super) ranks: Ranks,
    /// The parts of each source.
    sources: Vec<SourceParts>,
}

/// The parts of one source.
#[derive(Debug)]
struct SourceParts {
    /// True if all are points, or all are cells.
    are_one: bool,
    /// Ranks whose part is not empty.
    holders: Vec<usize>,
    /// Directions up: one if the parts are one data set, otherwise one of each part that is not empty.
    ups: Vec<Up>,
    /// Corners of the parts that are not empty, in the same order.
    corners: Vec<Option<[[f64; 3]; 2]>>,
}

/// A source once it was sampled.
struct Made {
    /// The share of the particles, if the parts are one data set.
    share: Option<Share>,
    /// The volumes of this rank's part, otherwise.
    volumes: Vec<PointVolume>,
    report: SampleReport,
    /// Error that reports that the part holds nothing to draw.
    nothing: Option<Error>,
}

/// Facts on a data set once it was sampled, as ranks send them.
type Facts = (Option<String>, Option<String>, Option<SphKernel>, usize);

/// Numbers of particles and planes of lattices, which complete volumes to a [`Share`].
#[derive(Debug, Default)]
pub(super) struct Placement {
    numbers: Vec<Vec<u64>>,
    planes: Vec<Vec<Range<usize>>>,
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

/// Returns a number for the kind of a part.
fn kind_of(source: &Source) -> u8 {
    match &source.data {
        Data::Set(dataset) => match &dataset.geometry {
            Geometry::Points { .. } => 0,
            Geometry::Cells(_) => 1,
            _ => 2,
        },
        Data::Surfels(_) => 2,
    }
}

fn is_empty(source: &Source) -> bool {
    match &source.data {
        Data::Set(dataset) => match &dataset.geometry {
            Geometry::Points { positions } => positions.is_empty(),
            Geometry::Cells(mesh) => mesh.cell_count() == 0,
            Geometry::Lattice(lattice) => lattice.len() == 0,
            Geometry::Curvilinear { blocks } => blocks.iter().all(|block| block.nodes.is_empty()),
            Geometry::Splats(cloud) => cloud.positions.is_empty(),
            Geometry::Mesh(mesh) => mesh.parts.iter().all(|part| part.triangles.is_empty()),
        },
        Data::Surfels(ready) => ready.volume.particles.len() == 0,
    }
}

impl Parts {
    /// Collects what all ranks must know of each other's drawables.
    ///
    /// # Errors
    /// Other numbers of drawables, or other options, on other ranks; a rank that is gone.
    pub(super) fn of(things: &[Arc<Drawable>], mut ranks: Ranks) -> Result<Self> {
        let sources = || things.iter().flat_map(|thing| &thing.sources);
        let options: Vec<_> = things
            .iter()
            .map(|thing| {
                let of_sources = thing.sources.iter().map(|source| &source.options);
                (thing.up, of_sources.collect::<Vec<_>>())
            })
            .collect();
        let what = "number and options of scenes";
        ranks.check_same(what, &format!("{options:?}"))?;
        let mut all = Vec::new();
        for source in sources() {
            let own = (
                kind_of(source),
                is_empty(source),
                SentUp::from(source.up()),
                source.corners().map(arrays_of),
            );
            let group: &mut dyn Collective = &mut ranks;
            let parts = group.gather_values(own)?;
            let (first, ..) = parts[0];
            let are_one = first < 2 && parts.iter().all(|(kind, ..)| *kind == first);
            let mut of_source = SourceParts {
                are_one,
                holders: Vec::new(),
                ups: Vec::new(),
                corners: Vec::new(),
            };
            for (rank, (_, is_empty, up, corners)) in parts.into_iter().enumerate() {
                if !is_empty {
                    of_source.holders.push(rank);
                    of_source.ups.push(up.into());
                    of_source.corners.push(corners);
                }
            }
            if let (true, Data::Set(dataset)) = (are_one, &source.data) {
                of_source.ups = vec![up_of_all(dataset, group)?];
            }
            all.push(of_source);
        }
        Ok(Self {
            ranks,
            sources: all,
        })
    }

    /// Returns the directions up of all data.
    pub(super) fn ups(&self, things: &[Arc<Drawable>]) -> Vec<Up> {
        let mut sources = self.sources.iter();
        let mut all = Vec::new();
        for thing in things {
            for parts in sources.by_ref().take(thing.sources.len()) {
                let given = thing.given_up();
                all.extend(parts.ups.iter().map(|up| given.unwrap_or(*up)));
            }
        }
        all
    }

    /// Returns the boxes of all data.
    pub(super) fn boxes(&self) -> Vec<Bounds> {
        let corners = self.sources.iter().flat_map(|parts| &parts.corners);
        let corners = corners.flatten().map(|corners| corners_of(*corners));
        corners
            .map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0))
            .collect()
    }

    /// Shares surfels among the surfaces of all ranks.
    ///
    /// - `own`: demands of this rank's sources.
    pub(super) fn surfels(
        &self,
        own: Vec<Option<SurfelDemand>>,
    ) -> Result<Vec<Option<(Spread, usize)>>> {
        let mut ranks = self.ranks.clone();
        let ranks: &mut dyn Collective = &mut ranks;
        let count = own.len();
        let all = ranks.gather_values(own)?;
        let by_source = (0..count).flat_map(|s| all.iter().map(move |of_rank| of_rank[s]));
        let parts = SurfelDemand::share(&by_source.collect::<Vec<_>>());
        let own = parts.into_iter().skip(ranks.rank());
        Ok(own.step_by(ranks.size()).collect())
    }

    /// Returns true if something is so on any rank.
    pub(super) fn any(&self, own: bool) -> Result<bool> {
        let mut ranks = self.ranks.clone();
        (&mut ranks as &mut dyn Collective).any(own)
    }

    /// Returns this rank's result if all ranks have one.
    pub(super) fn agree<T>(&self, own: Result<T>) -> Result<T> {
        let mut ranks = self.ranks.clone();
        (&mut ranks as &mut dyn Collective).agree(own)
    }

    /// Samples the sources of all ranks. Data sets that show one field by an automatic transfer function share one.
    ///
    /// - `things`: number of the drawable of each source, with the source.
    /// - `options`: options of each source.
    pub(super) fn sample(
        &self,
        things: &[(usize, &Source)],
        options: Vec<SampleOptions>,
        purpose: &Purpose,
        counts: Vec<Option<usize>>,
    ) -> Result<Sampled> {
        let mut ranks = self.ranks.clone();
        let ranks: &mut dyn Collective = &mut ranks;
        let options = self.preferring(things, options, ranks)?;
        let sources = || things.iter().map(|(_, source)| *source).zip(&self.sources);
        let mut made = Vec::new();
        for ((source, parts), options) in sources().zip(&options) {
            made.push(parts.sample(source, options, ranks)?);
        }
        if !purpose.for_columns && purpose.mean == MeanPart::None {
            let (entries, of_all) = self.entries(&mut made, &options, ranks.rank());
            let functions = functions_of_all(entries, &of_all, ranks)?;
            let mut first = 0;
            for (s, (source, parts)) in sources().enumerate() {
                let count = parts.data_sets(&made[s]);
                let mut members = (first..first + count).filter_map(|n| functions.get(&n));
                if let Some(function) = members.next().map(TransferFunction::clone) {
                    // The old volumes are freed before the new ones are made.
                    (made[s].share, made[s].volumes) = (None, Vec::new());
                    let options = with_shared(options[s].clone(), &function);
                    made[s] = parts.sample(source, &options, ranks)?;
                }
                first += count;
            }
        }
        joined(things, made, counts, ranks)
    }

    /// Returns options with the fields that data sets have in common, if none is named.
    fn preferring(
        &self,
        things: &[(usize, &Source)],
        mut options: Vec<SampleOptions>,
        ranks: &mut dyn Collective,
    ) -> Result<Vec<SampleOptions>> {
        let choices = things.iter().map(|(_, source)| match &source.data {
            Data::Set(dataset) if !is_empty(source) => field_choices(dataset)
                .into_iter()
                .map(|own| (own.name, own.ranges, own.rank))
                .collect(),
            _ => Vec::new(),
        });
        type Sent = Vec<(String, Vec<[f64; 2]>, u8)>;
        let all: Vec<Vec<Sent>> = ranks.gather_values(choices.collect())?;
        let mut of_entries = Vec::new();
        let mut entries = Vec::new();
        for (s, parts) in self.sources.iter().enumerate() {
            let mut of_source: Vec<Vec<FieldChoice>> = Vec::new();
            for &rank in &parts.holders {
                let choices = all[rank][s].iter().cloned();
                let choices =
                    choices.map(|(name, ranges, rank)| FieldChoice { name, ranges, rank });
                match of_source.first_mut() {
                    Some(known) if parts.are_one => choices.for_each(|own| add(known, own)),
                    _ => of_source.push(choices.collect()),
                }
            }
            entries.extend(std::iter::repeat_n(s, of_source.len()));
            of_entries.extend(of_source);
        }
        if entries.len() > 1 {
            let mut each: Vec<SampleOptions> =
                entries.iter().map(|&s| options[s].clone()).collect();
            prefer(&mut each, of_entries);
            // Parts of one source have the same fields: the first one decides.
            for (s, own) in entries.into_iter().zip(each).rev() {
                options[s] = own;
            }
        }
        Ok(options)
    }

    /// Numbers the data sets of all ranks: returns those whose report this rank gives, and the options of all.
    fn entries<'a>(
        &self,
        made: &'a mut [Made],
        options: &[SampleOptions],
        rank: usize,
    ) -> (Vec<(usize, &'a mut SampleReport)>, Vec<SampleOptions>) {
        let (mut own, mut all) = (Vec::new(), Vec::new());
        for ((made, options), parts) in made.iter_mut().zip(options).zip(&self.sources) {
            let first = all.len();
            let count = parts.data_sets(made);
            all.extend(std::iter::repeat_n(options.clone(), count));
            let place = match made.share {
                Some(_) => (rank == 0).then_some(0),
                None => parts.holders.iter().position(|holder| *holder == rank),
            };
            own.extend(place.map(|place| (first + place, &mut made.report)));
        }
        (own, all)
    }
}

/// Adds a choice of another part of the same data set.
fn add(known: &mut Vec<FieldChoice>, own: FieldChoice) {
    match known.iter_mut().find(|known| known.name == own.name) {
        None => known.push(own),
        Some(known) => {
            for (known, [low, high]) in known.ranges.iter_mut().zip(own.ranges) {
                *known = [known[0].min(low), known[1].max(high)];
            }
        }
    }
}

/// Returns the direction up of points or cells of which each rank holds a part.
fn up_of_all(own: &Dataset, ranks: &mut dyn Collective) -> Result<Up> {
    let nodes = match &own.geometry {
        Geometry::Points { positions } => positions.as_slice(),
        Geometry::Cells(mesh) => &mesh.nodes,
        _ => &[],
    };
    let nodes = outline_of_all(nodes, ranks)?;
    let geometry = match &own.geometry {
        Geometry::Cells(_) => Geometry::Cells(CellMesh {
            nodes,
            ..CellMesh::default()
        }),
        _ => Geometry::Points { positions: nodes },
    };
    let mut outline = Dataset::new(&own.path, own.format, geometry, Vec::new());
    outline.format_up = own.format_up;
    Ok(outline.up())
}

impl SourceParts {
    /// Returns the number of data sets that the parts are.
    fn data_sets(&self, made: &Made) -> usize {
        match made.share {
            Some(_) => 1,
            None => self.holders.len(),
        }
    }

    /// Samples the parts of a source.
    fn sample(
        &self,
        source: &Source,
        options: &SampleOptions,
        ranks: &mut dyn Collective,
    ) -> Result<Made> {
        if let (true, Data::Set(dataset)) = (self.are_one, &source.data)
            && let Some((share, report)) = held_together(dataset, options, ranks)?
        {
            return Ok(Made {
                share: Some(share),
                volumes: Vec::new(),
                report,
                nothing: None,
            });
        }
        let mut made = Made {
            share: None,
            volumes: Vec::new(),
            report: SampleReport::default(),
            nothing: None,
        };
        if !self.holders.contains(&ranks.rank()) {
            ranks.agree(Ok(()))?;
            return Ok(made);
        }
        let sampled = match source.scene(options) {
            Ok(sampled) => {
                (made.volumes, made.report) = (sampled.volumes, sampled.report);
                Ok(())
            }
            // Other parts may hold something.
            Err(error) if error.holds_nothing() => {
                made.nothing = Some(error);
                Ok(())
            }
            Err(error) => Err(error),
        };
        ranks.agree(sampled)?;
        Ok(made)
    }
}

/// Joins the volumes of all sources.
fn joined(
    things: &[(usize, &Source)],
    made: Vec<Made>,
    counts: Vec<Option<usize>>,
    ranks: &mut dyn Collective,
) -> Result<Sampled> {
    let mut sampled = Sampled {
        volumes: Vec::new(),
        smoothing: None,
        titles: Vec::new(),
        units: Vec::new(),
        fields: Vec::new(),
        firsts: Vec::new(),
        counts,
        placement: None,
    };
    let mut placement = Placement::default();
    let (mut reports, mut nothing) = (Vec::new(), None);
    for ((thing, _), made) in things.iter().zip(made) {
        if *thing == sampled.firsts.len() {
            sampled.firsts.push((sampled.volumes.len(), false));
        }
        let report = made.report;
        let facts = |count| -> Facts {
            let (field, unit) = (report.field.clone(), report.unit.clone());
            (field, unit, report.smoothing, count)
        };
        let (share, facts) = match made.share {
            Some(share) => {
                let count = share.volumes.len();
                (share, vec![facts(count)])
            }
            None => {
                let facts = facts(made.volumes.len());
                let share = distribute(made.volumes, ranks)?;
                (share, ranks.gather_values(facts)?)
            }
        };
        nothing = nothing.or(made.nothing);
        let of_lattice =
            |volume: &PointVolume| matches!(volume.particles, Particles::Lattice { .. });
        let numbers = share.numbers.unwrap_or_else(|| {
            let volumes = share.volumes.iter();
            let numbers = volumes.map(|volume| match of_lattice(volume) {
                true => Vec::new(),
                false => (0..volume.particles.len() as u64).collect(),
            });
            numbers.collect()
        });
        let planes = share.planes.unwrap_or_default().into_iter();
        let planes = planes.chain(std::iter::repeat(Vec::new()));
        placement.planes.extend(planes.take(share.volumes.len()));
        placement.numbers.extend(numbers);
        sampled.volumes.extend(share.volumes);
        for (field, unit, smoothing, count) in facts {
            if count == 0 {
                continue;
            }
            let end = sampled.titles.len() + count;
            let title = field.as_deref().map(|f| title_of(f, unit.as_deref()));
            sampled.titles.resize(end, title);
            sampled.units.resize(end, unit);
            sampled.fields.resize(end, field);
            reports.push(SampleReport {
                smoothing,
                ..SampleReport::default()
            });
        }
    }
    if sampled.volumes.is_empty() {
        let error = nothing.unwrap_or_else(|| {
            let advice = "give some rank data";
            Error::invalid("scenes", "ranks", "data on some rank", "none", advice)
        });
        return Err(error);
    }
    sampled.smoothing = common_smoothing(reports.iter());
    sampled.placement = Some(placement);
    Ok(sampled)
}
