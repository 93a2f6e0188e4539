//! Draws a session's data together with the sessions of other ranks, each of which holds a part of the data.
//!
//! All ranks give as many drawables, with the same options. Those of one number, the parts of one rank after another, are
//! one data set if they are points or cells, and data sets of their own otherwise. All ranks draw the same pictures in the
//! same order; the first one gets them.

use std::fmt::Display;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::drawable::Drawable;
use super::sampled::{Placement, Purpose, Sampled};
use super::source::{Data, Source};
use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::frame::backdrop::GivenBackdrop;
use crate::image::{DepthImage, Image};
use crate::io::{CellMesh, Dataset, Geometry, SphKernel, Up};
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
use crate::scene::{Particles, PointVolume};
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
                source.is_empty(),
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
                if let Some(function) = members.next().cloned() {
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
            Data::Set(dataset) if !source.is_empty() => field_choices(dataset)
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
            let count = known.ranges.len();
            for (known, [low, high]) in known.ranges.iter_mut().zip(&own.ranges) {
                *known = [known[0].min(*low), known[1].max(*high)];
            }
            // A part without finite values has no ranges.
            known.ranges.extend(own.ranges.into_iter().skip(count));
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
        counts,
        ..Sampled::default()
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
            sampled.note(count, field, unit);
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

#[cfg(test)]
#[allow(
    clippy::cast_possible_truncation,
    reason = "numbers are narrowed on purpose"
)]
mod tests {
    use std::ops::Range;
    use std::thread;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::frame::backend::Backend;
    use crate::io::{Association, CellKind, Mesh};
    use crate::ranks::ThreadRank;
    use crate::sample::{BoundaryChoice, TransferChoice};
    use crate::scene::{Lattice, LatticeSpacing, Values};
    use crate::session::arguments::Nothing;
    use crate::session::{
        ColumnRequest, Drawing, PictureRequest, Sampling, Session, drawing, field, sampling,
    };
    use crate::task::Task;

    const SIZE: [usize; 2] = [40, 30];

    fn options() -> Sampling {
        let Ok(own) = sampling(&mut Nothing);
        own
    }

    fn settings() -> Drawing {
        let Ok(own) = drawing(&mut Nothing);
        own
    }

    /// Returns a number from 0 to 1 that depends on `n` alone.
    fn number(n: usize) -> f64 {
        let hashed = (n as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let hashed = (hashed ^ (hashed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((hashed ^ (hashed >> 29)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Makes points of these columns, numbered as among the points of all ranks.
    fn points(run: Range<usize>, columns: &[&str], own: Sampling) -> Drawable {
        let place = |n: usize| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2));
        let positions: Vec<DVec3> = run.clone().map(place).collect();
        let fields = columns.iter().map(|&name| {
            let value = |n: usize| match name {
                "radius" | "h" => 0.05 + 0.05 * number(7 * n),
                "mass" | "m" => 0.001 * (1.0 + number(5 * n)),
                "value" => positions_value(place(n)),
                _ => number(11 * n + name.len()),
            };
            let values: Vec<f32> = run.clone().map(|n| value(n) as f32).collect();
            field(name, values.into(), Association::Nodes)
        });
        let fields = fields.collect();
        Drawable::of("points", Geometry::Points { positions }, fields, own).unwrap()
    }

    fn positions_value(p: DVec3) -> f64 {
        (4.0 * p.x).sin() + p.y * p.z
    }

    /// Makes hexahedra between planes along x of a lattice of nodes. Each run of planes has nodes of its own, as on a rank.
    fn cells(runs: &[Range<usize>], association: Association, own: Sampling) -> Drawable {
        let (mut nodes, mut lists, mut middles) = (Vec::new(), Vec::new(), Vec::new());
        for run in runs.iter().filter(|run| !run.is_empty()) {
            let first = nodes.len();
            for (i, j, k) in (0..25 * (run.len() + 1)).map(|n| (n / 25, n / 5 % 5, n % 5)) {
                let i = run.start + i;
                let bend = 0.1 * number(i * 25 + j * 5 + k);
                nodes.push(DVec3::new(i as f64 + bend, j as f64, k as f64));
            }
            for (i, j, k) in (0..run.len() * 16).map(|c| (c / 16, c / 4 % 4, c % 4)) {
                let node = |i: usize, j: usize, k: usize| (first + i * 25 + j * 5 + k) as i64;
                let face = |i| {
                    [
                        node(i, j, k),
                        node(i, j + 1, k),
                        node(i, j + 1, k + 1),
                        node(i, j, k + 1),
                    ]
                };
                lists.push(8);
                lists.extend([face(i), face(i + 1)].concat());
                middles.push(DVec3::new((run.start + i) as f64, j as f64, k as f64));
            }
        }
        let kinds = vec![CellKind::HEXAHEDRON.0; middles.len()];
        let mesh = CellMesh::of_lists(nodes.clone(), &kinds, &lists).unwrap();
        let places = match association {
            Association::Nodes => nodes,
            _ => middles,
        };
        let values = places.iter().map(|p| positions_value(*p / 4.0) as f32);
        let values: Vec<f32> = values.collect();
        let fields = vec![field("value", values.into(), association)];
        Drawable::of("cells", Geometry::Cells(mesh), fields, own).unwrap()
    }

    /// Makes a lattice of the planes `run` along z, each of which two ranks may hold.
    fn lattice(run: Range<usize>) -> Drawable {
        let lattice = Lattice {
            dims: [6, 5, run.len()],
            spacing: LatticeSpacing::Uniform {
                origin: DVec3::Z * run.start as f64,
                step: DMat3::IDENTITY,
            },
        };
        let values = (0..lattice.len()).map(|n| number(n + 30 * run.start) as f32);
        let values: Vec<f32> = values.collect();
        let fields = vec![field("value", values.into(), Association::Nodes)];
        Drawable::of("grid", Geometry::Lattice(lattice), fields, options()).unwrap()
    }

    fn triangles(run: Range<usize>) -> Drawable {
        let vertices: Vec<DVec3> = (run.start * 3..run.end * 3)
            .map(|n| DVec3::new(number(n), number(n + 1000), 0.2 * number(n + 2000)))
            .collect();
        let faces = (0..run.len() as u32).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]);
        let mesh = Mesh::of_triangles(vertices, faces.collect::<Vec<_>>());
        Drawable::of("mesh", Geometry::Mesh(mesh), Vec::new(), options()).unwrap()
    }

    /// Returns the bits of a picture and of its depths.
    fn picture(session: &Session, drawing: &Drawing) -> Result<Vec<u32>> {
        let mut drawing = drawing.clone();
        drawing.settings.depth = true;
        let request = PictureRequest {
            view: None,
            size: SIZE,
            drawing: &drawing,
        };
        let (drawn, ()) = session.render(request, &Task::new(), |_, _, _, _| Ok(()))?;
        let mut numbers = drawn.image.pixels.concat();
        numbers.extend(drawn.depth.unwrap_or_default());
        Ok(numbers.into_iter().map(f32::to_bits).collect())
    }

    fn columns(session: &Session, of: Option<&str>) -> Result<Vec<u32>> {
        let request = ColumnRequest {
            view: None,
            size: SIZE,
            drawing: &settings(),
            of,
            mean: None,
            slice: None,
        };
        let drawn = session.columns(request, &Task::new())?;
        Ok(drawn.column.values.into_iter().map(f32::to_bits).collect())
    }

    type Draw<'a> = &'a (dyn Fn(&Session) -> Result<Vec<u32>> + Sync);

    fn alone(things: Vec<Drawable>, draw: Draw<'_>) -> Result<Vec<u32>> {
        let things = things.into_iter().map(Arc::new).collect();
        draw(&Session::new(things, Backend::Cpu, false))
    }

    /// Draws on ranks; returns the result of each.
    fn on_ranks(
        size: usize,
        parts: &(dyn Fn(usize) -> Vec<Drawable> + Sync),
        draw: Draw<'_>,
    ) -> Vec<Result<Vec<u32>>> {
        thread::scope(|scope| {
            let draw = |own: ThreadRank| {
                let things = parts(own.rank()).into_iter().map(Arc::new);
                let session = Session::over_ranks(Ok::<_, Error>(things.collect()), own)?;
                draw(&session)
            };
            let ranks = ThreadRank::group(size).into_iter();
            let threads: Vec<_> = ranks.map(|own| scope.spawn(move || draw(own))).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        })
    }

    fn check(
        name: &str,
        whole: Vec<Drawable>,
        parts: &(dyn Fn(usize) -> Vec<Drawable> + Sync),
        draw: Draw<'_>,
    ) {
        let expected = alone(whole, draw).unwrap();
        assert!(expected.iter().any(|bits| *bits != expected[0]), "{name}");
        let found = on_ranks(3, parts, draw);
        let first = found[0]
            .as_ref()
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(found.iter().all(Result::is_ok), "{name}: {found:?}");
        let other = first.iter().zip(&expected).filter(|(a, b)| a != b).count();
        assert!(
            *first == expected,
            "{name}: {other} of {} differ",
            expected.len()
        );
    }

    /// Parts of three ranks, of which the first holds nothing.
    const RUNS: [Range<usize>; 3] = [0..0, 0..500, 500..900];

    #[test]
    fn parts_of_points_are_one_data_set() {
        let all_columns: [&[&str]; 6] = [
            &["value"],
            &["radius", "value"],
            &["radius", "mass", "r", "g", "b"],
            &["h", "m", "rho"],
            &["h", "m", "value"],
            &["radius", "volume", "value"],
        ];
        let mut lit = settings();
        lit.is_lit = true;
        for columns in all_columns {
            let part = |rank: usize| vec![points(RUNS[rank].clone(), columns, options())];
            for drawing in [settings(), lit.clone()] {
                let draw = |session: &Session| picture(session, &drawing);
                let whole = vec![points(0..900, columns, options())];
                check(&format!("{columns:?}"), whole, &part, &draw);
            }
        }
    }

    #[test]
    fn columns_of_parts_are_those_of_all() {
        let all: [(&[&str], Option<&str>); 3] = [
            (&["radius", "mass"], Some("mass")),
            (&["h", "m"], None),
            (&["radius", "volume", "value"], Some("value")),
        ];
        for (names, of) in all {
            let part = |rank: usize| vec![points(RUNS[rank].clone(), names, options())];
            let draw = |session: &Session| columns(session, of);
            let whole = vec![points(0..900, names, options())];
            check(&format!("{names:?}"), whole, &part, &draw);
        }
    }

    #[test]
    fn parts_of_cells_are_one_mesh() {
        // Two layers of cells, none, and three.
        let runs = [0..2, 2..2, 2..5];
        let soft = || {
            let mut own = options();
            own.options.kernels.boundary = BoundaryChoice::Soft;
            own
        };
        let draw = |session: &Session| picture(session, &settings());
        for association in [Association::Nodes, Association::Cells] {
            let part = |rank: usize| vec![cells(&runs[rank..=rank], association, soft())];
            let whole = vec![cells(&runs, association, soft())];
            check(&format!("{association:?}"), whole, &part, &draw);
        }
        // Parts that are cut at their boundaries are meshes of their own.
        let sharp = || {
            let mut own = options();
            own.options.kernels.boundary = BoundaryChoice::Sharp;
            own
        };
        let part = |rank: usize| vec![cells(&runs[rank..=rank], Association::Nodes, sharp())];
        let whole = [0, 2].map(|rank| part(rank).swap_remove(0));
        check("sharp", whole.into(), &part, &draw);
    }

    #[test]
    fn parts_of_grids_and_meshes_are_data_sets_of_their_own() {
        let draw = |session: &Session| picture(session, &settings());
        let runs = [0..3, 0..0, 2..7];
        let part = |rank: usize| vec![lattice(runs[rank].clone())];
        check("grids", vec![lattice(0..3), lattice(2..7)], &part, &draw);
        let part = |rank: usize| vec![triangles(10 * rank..10 * rank + 10)];
        let whole = (0..3).map(|rank| part(rank).swap_remove(0)).collect();
        check("meshes", whole, &part, &draw);
    }

    #[test]
    fn scenes_of_all_ranks_share_one_function_and_one_field() {
        let draw = |session: &Session| picture(session, &settings());
        let runs = [0..2, 2..2, 2..4];
        let named = || {
            let mut own = options();
            own.options.function.transfer = TransferChoice::Named("plasma".into());
            own.options.kernels.boundary = BoundaryChoice::Soft;
            own
        };
        let part = |rank: usize| {
            vec![
                points(RUNS[rank].clone(), &["value", "other"], named()),
                cells(&runs[rank..=rank], Association::Nodes, named()),
                lattice(runs[rank].clone()),
            ]
        };
        let whole = vec![
            points(0..900, &["value", "other"], named()),
            cells(&runs, Association::Nodes, named()),
            lattice(0..2),
            lattice(2..4),
        ];
        check("mixed", whole, &part, &draw);
    }

    #[test]
    fn the_first_rank_has_the_background_and_values_change_on_all() {
        let shown = || {
            let mut own = options();
            own.options.field = Some("value".into());
            own
        };
        let part = |rank: usize| vec![points(RUNS[rank].clone(), &["value"], shown())];
        let draw = |session: &Session| {
            let mut all = picture(session, &settings())?;
            let mut over = settings();
            let [width, height] = SIZE;
            if session.is_first() {
                over.backdrop.depth = Some(DepthImage {
                    width,
                    height,
                    depths: (0..width * height)
                        .map(|n| 1.0 + (n % width) as f32 / 8.0)
                        .collect(),
                });
                over.backdrop.colours = Some(Image {
                    width,
                    height,
                    pixels: vec![[0.2, 0.0, 0.0, 1.0]; width * height],
                });
            }
            all.extend(picture(session, &over)?);
            let count =
                session
                    .lock(&Task::new())?
                    .sources()
                    .next()
                    .map(|(_, source)| match &source.data {
                        Data::Set(dataset) => dataset.fields[0].arrays()[0].len(),
                        Data::Surfels(_) => 0,
                    });
            // Values that tell nothing of a part's place: each number is the same.
            let values: Values = vec![0.25_f32; count.unwrap_or(0)].into();
            session.set_values(0, values, &Task::new())?;
            let mut ranged = settings();
            ranged.transfer = Some(TransferChoice::Named("viridis".into()));
            all.extend(picture(session, &ranged)?);
            Ok(all)
        };
        check(
            "steps",
            vec![points(0..900, &["value"], shown())],
            &part,
            &draw,
        );
    }

    #[test]
    fn what_fails_on_one_rank_fails_on_all() {
        let part = |rank: usize| vec![points(RUNS[rank].clone(), &["value"], options())];
        let texts = |found: Vec<Result<Vec<u32>>>| -> Vec<String> {
            found
                .into_iter()
                .map(|own| own.unwrap_err().to_string())
                .collect()
        };
        // Other options, other settings, other calls, other numbers of values, a cancelled task.
        let wider = |rank: usize| {
            let mut own = options();
            own.options.kernels.width += rank as f64;
            vec![points(RUNS[rank].clone(), &["value"], own)]
        };
        let draw = |session: &Session| picture(session, &settings());
        let found = texts(on_ranks(3, &wider, &draw));
        assert!(
            found.iter().all(|text| text.contains("options of scenes")),
            "{found:?}"
        );
        let named = |rank: usize| {
            let name = if rank == 1 { "other" } else { "value" };
            vec![points(RUNS[rank].clone(), &[name], options())]
        };
        let found = texts(on_ranks(3, &named, &draw));
        assert!(
            found.iter().all(|text| text.contains("fields of ranks")),
            "{found:?}"
        );
        let draw = |session: &Session| {
            let mut own = settings();
            own.settings.tolerance = if session.is_first() { 0.1 } else { 0.2 };
            picture(session, &own)
        };
        let found = texts(on_ranks(3, &part, &draw));
        assert!(
            found.iter().all(|text| text.contains("rank 1")),
            "{found:?}"
        );
        let draw = |session: &Session| match session.is_first() {
            true => picture(session, &settings()),
            false => columns(session, None),
        };
        let found = texts(on_ranks(2, &part, &draw));
        assert!(
            found.iter().all(|text| text.contains("rank 1")),
            "{found:?}"
        );
        let draw = |session: &Session| {
            let count = if session.is_first() { 7 } else { 500 };
            session.set_values(0, vec![0.0_f32; count].into(), &Task::new())?;
            Ok(Vec::new())
        };
        let found = texts(on_ranks(2, &part, &draw));
        assert!(
            found.iter().all(|text| text.contains("values")),
            "{found:?}"
        );
        let draw = |session: &Session| {
            let task = Task::new();
            if session.is_first() {
                task.cancel();
            }
            let request = PictureRequest {
                view: None,
                size: SIZE,
                drawing: &settings(),
            };
            session.render(request, &task, |_, _, _, _| Ok(()))?;
            Ok(Vec::new())
        };
        let found = texts(on_ranks(2, &part, &draw));
        assert!(
            found.iter().all(|text| text.contains("cancelled")),
            "{found:?}"
        );
        // No data on any rank.
        let none = |_: usize| vec![lattice(0..0)];
        let draw = |session: &Session| picture(session, &settings());
        let found = texts(on_ranks(2, &none, &draw));
        assert!(
            found.iter().all(|text| text.contains("data on some rank")),
            "{found:?}"
        );
    }
}
