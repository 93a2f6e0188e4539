//! Defines a rank's share of a scene, and builds the blocks of all shares together.

use std::ops::Range;

use crate::blocks::{
    Held, LEAST, PlaneRuns, SceneOptions, SharedVolume, build_lattice_together, build_together,
    check_count,
};
use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::message::{put, take};
use crate::scene::rows::{kind_of, model_scales, rows_of, volume_of};
use crate::scene::{Lattice, Particles, PointVolume, Values};

/// A rank's share of a scene: some particles of each volume, or none.
///
/// All ranks list the same volumes in the same order. A volume differs between ranks in its particles only: its kind
/// and its transfer function are the same. The codes of its local models have the same scale on all ranks: take shares
/// of models that were made of the whole ([`LocalModels::gather`](crate::scene::LocalModels::gather)).
#[derive(Debug, Clone, PartialEq)]
pub struct Share {
    /// The volumes.
    pub volumes: Vec<PointVolume>,
    /// Number of each particle among the particles of all ranks, for each volume. The numbers give the order of
    /// particles on a single machine, which decides ties of depth. Numbers of lattices are ignored. `None` numbers
    /// the particles one rank after another.
    pub numbers: Option<Vec<Vec<u64>>>,
    /// Runs of planes (of constant k, the slowest index) that this rank holds, for each volume that is a lattice.
    ///
    /// The values of the volume are those of these planes, one run after another. All ranks together must hold every
    /// plane; a plane that several ranks hold must be the same on each. Only lattices that store nothing but values
    /// can be partitioned; every rank must hold all planes of other lattices. Entries for volumes that are no lattices
    /// are ignored. `None` means that every rank holds all planes of every lattice.
    pub planes: Option<Vec<Vec<Range<usize>>>>,
}

impl From<Vec<PointVolume>> for Share {
    fn from(volumes: Vec<PointVolume>) -> Self {
        Self {
            volumes,
            numbers: None,
            planes: None,
        }
    }
}

impl Share {
    /// Builds the blocks of all ranks' volumes, and gives each rank some of their particles. The blocks are those of
    /// all particles in one place.
    ///
    /// - `small`: every rank builds the whole of a volume with at most so many particles for each rank.
    ///
    /// # Errors
    /// Shares of different volumes; numbers that are not one for each particle; a rank that is gone.
    pub(super) fn built(
        self,
        options: &SceneOptions,
        small: u64,
        ranks: &mut dyn Collective,
    ) -> Result<Vec<SharedVolume>> {
        let checked = self.check();
        let own = checked.map(|()| {
            let mut part = Vec::new();
            let mut kinds: Vec<u64> = self.volumes.iter().map(kind_of).collect();
            kinds.push(u64::from(options.level_of_detail));
            put(&mut part, &kinds);
            put(&mut part, &[u8::from(self.numbers.is_some())]);
            put(&mut part, &[u8::from(self.planes.is_some())]);
            for (v, volume) in self.volumes.iter().enumerate() {
                let scales: Vec<[f32; 2]> = model_scales(volume).into_iter().collect();
                put(&mut part, &scales);
                put(&mut part, &[volume.particles.len() as u64]);
                let runs = self.planes_of(v).into_iter();
                let runs: Vec<[u64; 2]> =
                    runs.map(|run| [run.start as u64, run.end as u64]).collect();
                put(&mut part, &runs);
                put(&mut part, &[u8::from(volume.is_plain_lattice())]);
            }
            part
        });
        let parts = ranks.gather_parts(own)?;
        let known = known_volumes(&parts, self.volumes.len());
        let known = ranks.agree(known)?;
        let planes: Vec<_> = (0..self.volumes.len()).map(|v| self.planes_of(v)).collect();
        let mut numbers = self.numbers.map(Vec::into_iter);
        let mut built = Vec::with_capacity(self.volumes.len());
        let (mut first, mut total) = (0, 0);
        for (v, volume) in self.volumes.into_iter().enumerate() {
            let numbers = numbers.as_mut().and_then(Iterator::next);
            let count = volume.particles.len();
            let numbers = numbers.or_else(|| known.numbers(v, ranks.rank(), count));
            let is_lattice = matches!(volume.particles, Particles::Lattice { .. });
            let count = if is_lattice {
                count as u64
            } else {
                let placed = volume.particles.positions().iter();
                let placed = placed.filter(|p| p.is_finite()).count();
                ranks.sum(Ok(placed as u64))?
            };
            // The count is the same on all ranks.
            total += count;
            check_count(usize::try_from(total).unwrap_or(usize::MAX))?;
            let own = if let (Particles::Lattice { lattice, .. }, true) =
                (&volume.particles, known.is_partitioned)
            {
                let is_small = is_small(lattice, small, ranks.size());
                let held = known.planes.iter().map(|own| own[v].clone());
                let shared = SharedLattice {
                    runs: planes[v].clone(),
                    held: held.collect(),
                    is_plain: known.plain[v],
                    is_small,
                };
                shared.built(volume, options, first, ranks)
            } else if is_lattice {
                SharedVolume::of_whole(volume, options, first, ranks)
            } else if count > LEAST.max(small * ranks.size() as u64) {
                let volume = known.with_scales(v, volume);
                Ok(build_together(volume, numbers, options, ranks)?)
            } else {
                let whole = known.gathered(v, volume, numbers, ranks)?;
                SharedVolume::of_whole(whole, options, first, ranks)
            };
            let own = ranks.agree(own)?;
            first += own.len();
            built.push(own);
        }
        Ok(built)
    }

    /// Returns the planes of a volume whose values this rank holds.
    fn planes_of(&self, v: usize) -> Vec<Range<usize>> {
        let Particles::Lattice { lattice, .. } = &self.volumes[v].particles else {
            return Vec::new();
        };
        match &self.planes {
            Some(planes) => planes.get(v).cloned().unwrap_or_default(),
            None => std::iter::once(0..lattice.dims[2]).collect(),
        }
    }

    fn check(&self) -> Result<()> {
        if let Some(planes) = &self.planes
            && planes.len() != self.volumes.len()
        {
            return Err(refused("planes of each volume", "those of more or fewer"));
        }
        for (v, volume) in self.volumes.iter().enumerate() {
            let Particles::Lattice { lattice, .. } = &volume.particles else {
                volume.validate()?;
                continue;
            };
            let planes = self.planes_of(v);
            if planes.iter().any(|run| run.end > lattice.dims[2]) {
                let found = format!("one beyond {}", lattice.dims[2]);
                return Err(refused("planes of the lattice", &found));
            }
            lattice.validate()?;
            let count: usize = planes.iter().map(Range::len).sum();
            volume.validate_of(count * lattice.dims[0] * lattice.dims[1])?;
        }
        let Some(numbers) = &self.numbers else {
            return Ok(());
        };
        let fits = |(volume, numbers): (&PointVolume, &Vec<u64>)| {
            let is_lattice = matches!(volume.particles, Particles::Lattice { .. });
            is_lattice || volume.particles.len() == numbers.len()
        };
        let is_one_each = numbers.len() == self.volumes.len();
        if !(is_one_each && self.volumes.iter().zip(numbers).all(fits)) {
            return Err(refused("a number for each particle", "more or fewer"));
        }
        Ok(())
    }
}

/// Returns true if a lattice is so small that every rank may hold it entirely. With few planes for each rank, some
/// ranks would get none, or twice as many as others. A lattice with few planes therefore has a higher limit.
///
/// - `small`: greatest number of cells for each rank of a small lattice with enough planes.
pub(crate) fn is_small(lattice: &Lattice, small: u64, size: usize) -> bool {
    let few = lattice.dims[2] < FEW_PLANES * size;
    let small = if few {
        FEW_PLANES as u64 * small
    } else {
        small
    };
    lattice.len() as u64 <= small * size as u64
}

/// Greatest number of particles for each rank at which every rank builds the whole volume. Ranks then share a frame
/// by blocks, which balances their work better than chunks of some 65,536 particles.
pub(crate) const SMALL: u64 = 1 << 18;

/// Planes for each rank below which runs of planes balance badly.
const FEW_PLANES: usize = 64;

/// A lattice whose planes are partitioned among ranks.
struct SharedLattice {
    /// Planes of this rank.
    runs: Vec<Range<usize>>,
    /// Planes of each rank.
    held: Vec<Vec<Range<usize>>>,
    /// True if the lattice stores nothing but values on every rank. A rank without planes must learn this from others.
    is_plain: bool,
    /// Whether every rank builds the whole lattice.
    is_small: bool,
}

impl SharedLattice {
    fn built(
        self,
        mut volume: PointVolume,
        options: &SceneOptions,
        first: usize,
        ranks: &mut dyn Collective,
    ) -> Result<SharedVolume> {
        let Particles::Lattice { lattice, .. } = &volume.particles else {
            return Err(refused("a lattice", "points"));
        };
        let [x, y, planes] = lattice.dims;
        let is_whole = |runs: &Vec<Range<usize>>| matches!(&**runs, [run] if *run == (0..planes));
        if !self.is_plain {
            return match self.held.iter().all(is_whole) {
                true => SharedVolume::of_whole(volume, options, first, ranks),
                false => {
                    let expected = "all planes of a lattice that has more than values";
                    Err(refused(expected, "some of them"))
                }
            };
        }
        let assigned = PlaneRuns::new(planes, ranks.size());
        let wanted = |rank| match self.is_small {
            true => std::iter::once(0..planes).collect(),
            false => assigned.wanted(rank),
        };
        let wanted: Vec<Vec<Range<usize>>> = (0..ranks.size()).map(wanted).collect();
        let held = Held {
            runs: self.runs,
            values: volume.values.take().unwrap_or(Values::U8(Vec::new())),
        };
        let held = held.collected(x * y, &self.held, &wanted, ranks)?;
        if self.is_small {
            volume.values = Some(held.values);
            return SharedVolume::of_whole(volume, options, first, ranks);
        }
        build_lattice_together(volume, held, &assigned, options, first, ranks)
    }
}

fn refused(expected: &str, found: &str) -> Error {
    let advice = "give every rank a share of the same volumes";
    Error::invalid("scene", "shares of ranks", expected, found, advice)
}

/// Description of all ranks' volumes, gathered from all ranks.
struct Known {
    /// Number of particles of each volume, by rank.
    counts: Vec<Vec<u64>>,
    /// Scales of each volume's local models, if any rank has some.
    scales: Vec<Option<[f32; 2]>>,
    /// Whether any rank numbers its particles.
    is_numbered: bool,
    /// Whether any rank lists the planes that it holds.
    is_partitioned: bool,
    /// Planes of each volume, by rank.
    planes: Vec<Vec<Vec<Range<usize>>>>,
    /// Whether each volume is a lattice of values only, on all ranks.
    plain: Vec<bool>,
}

impl Known {
    /// Returns default numbers for a rank that gives none, if other ranks number theirs.
    fn numbers(&self, v: usize, rank: usize, count: usize) -> Option<Vec<u64>> {
        self.is_numbered.then(|| self.by_rank(v, rank, count))
    }

    /// Returns the numbers of a rank's particles, one rank after another.
    fn by_rank(&self, v: usize, rank: usize, count: usize) -> Vec<u64> {
        let first: u64 = self.counts[..rank].iter().map(|own| own[v]).sum();
        (first..first + count as u64).collect()
    }

    /// Gives a volume's local models the scales of all ranks.
    fn with_scales(&self, v: usize, mut volume: PointVolume) -> PointVolume {
        if let Some(scales) = self.scales[v] {
            volume.local_models = volume.local_models.map(|m| m.with_scales(scales));
        }
        volume
    }

    /// Gathers the particles of a volume on every rank, in the order of their numbers.
    fn gathered(
        &self,
        v: usize,
        volume: PointVolume,
        numbers: Option<Vec<u64>>,
        ranks: &mut dyn Collective,
    ) -> Result<PointVolume> {
        let by_rank = || self.by_rank(v, ranks.rank(), volume.particles.len());
        let numbers = numbers.unwrap_or_else(by_rank);
        let parts = ranks.gather_parts(Ok(rows_of(&volume, &numbers)))?;
        let rows: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
        let made = volume_of(&rows, &self.with_scales(v, volume));
        ranks.agree(made)
    }
}

fn known_volumes(parts: &[Vec<u8>], volumes: usize) -> Result<Known> {
    let mut known = Known {
        counts: Vec::with_capacity(parts.len()),
        scales: vec![None; volumes],
        is_numbered: false,
        is_partitioned: false,
        planes: Vec::with_capacity(parts.len()),
        plain: vec![true; volumes],
    };
    let mut parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let kinds = parts.iter_mut().map(take::<u64>);
    let kinds: Vec<Vec<u64>> = kinds.collect::<Result<_>>()?;
    if let Some(rank) = kinds.iter().position(|own| *own != kinds[0]) {
        let found = format!("others on rank {rank} than on rank 0");
        return Err(refused("the same volumes on every rank", &found));
    }
    for mut part in parts {
        known.is_numbered |= take::<u8>(&mut part)? == [1];
        known.is_partitioned |= take::<u8>(&mut part)? == [1];
        let mut counts = Vec::with_capacity(volumes);
        let mut planes = Vec::with_capacity(volumes);
        for (of_all, is_plain) in known.scales.iter_mut().zip(&mut known.plain) {
            if let Some(scales) = take::<[f32; 2]>(&mut part)?.first().copied()
                && *of_all.get_or_insert(scales) != scales
            {
                return Err(refused("local models of one scale", "several scales"));
            }
            counts.extend(take::<u64>(&mut part)?);
            let runs = take::<[u64; 2]>(&mut part)?.into_iter();
            planes.push(runs.map(|[a, b]| a as usize..b as usize).collect());
            *is_plain &= take::<u8>(&mut part)? == [1];
        }
        known.counts.push(counts);
        known.planes.push(planes);
    }
    Ok(known)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use glam::DVec3;

    use super::*;
    use crate::blocks::{Block, BlockedParticles, BlockedScene, BlockedVolume, SceneOptions};
    use crate::breadth;
    use crate::ranks::ThreadRank;
    use crate::scene::{
        Boundary, BoundaryPlanes, Colour, ColourIn, Lattice, Strength, TransferFunction, Values,
        ValuesIn,
    };

    /// Most points in a chunk of the tree.
    const CHUNK: usize = 1 << 16;

    /// Returns a pseudo-random number from 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    fn some(count: usize, k: usize) -> Vec<f32> {
        (0..count).map(|n| number(5 * n + k) as f32).collect()
    }

    fn scattered(count: usize) -> Vec<DVec3> {
        let at = |n: usize| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2));
        (0..count).map(at).collect()
    }

    fn spheres(positions: Vec<DVec3>) -> PointVolume {
        let count = positions.len();
        let sigmas: Vec<f32> = some(count, 1).iter().map(|s| 0.001 + 0.01 * s).collect();
        PointVolume::spheres(positions, sigmas).with_masses(some(count, 2))
    }

    fn ellipsoids(positions: Vec<DVec3>) -> PointVolume {
        let count = positions.len();
        let factor = |n: usize| {
            let [a, b] = [number(7 * n), number(7 * n + 1)].map(|s| 0.002 + 0.01 * s as f32);
            [a, 0.3 * b, b, -0.2 * a, 0.1 * b, a]
        };
        let cut = |n: usize| u32::from(n.is_multiple_of(9));
        let of_particle: Vec<u32> = (0..count).map(|n| cut(n) * (n / 9 + 1) as u32).collect();
        let edges = (0..count).filter(|n| cut(*n) > 0).map(|n| {
            let mut edges = [[0.0; 4]; crate::scene::MOST_EDGES];
            edges[0] = [1.0, 0.0, 0.0, number(n) as f32];
            edges
        });
        PointVolume {
            particles: Particles::Anisotropic {
                positions,
                factors: (0..count).map(factor).collect(),
            },
            strength: Strength::Classified {
                volumes: some(count, 3),
            },
            colour: Colour::Classified,
            values: Some(Values::F32(some(count, 4))),
            transfer_function: TransferFunction::from_curves(
                |v| [v, 1.0 - v, 0.5],
                |v| v * v,
                [0.2, 0.9],
                3.0,
            )
            .ok(),
            boundary: Some(Boundary::Planes(BoundaryPlanes {
                of_particle,
                edges: edges.collect(),
            })),
            normals: None,
            local_models: None,
        }
    }

    /// Returns four volumes: more than a chunk of points in one place with more points close by; a dense cluster far
    /// narrower than a cell of the space-filling curve through all points; several chunks of points that lie apart; and
    /// a few points beside a chunk in one place.
    fn volumes() -> Vec<PointVolume> {
        let mut crowd = scattered(CHUNK);
        crowd.splice(1_000..1_000, vec![DVec3::new(0.3, 0.4, 0.5); CHUNK + 9_000]);
        crowd.push(DVec3::NAN);
        let near = |p: &DVec3| DVec3::splat(0.7) + *p * 1e-4;
        crowd.extend(scattered(CHUNK + 30_000).iter().map(near));
        let mut cluster: Vec<DVec3> = scattered(2 * CHUNK).iter().map(|p| *p * 1e-6).collect();
        cluster.extend(scattered(9_000).iter().map(|p| *p * 1e3 - 7.0));
        cluster[7] = DVec3::splat(f64::INFINITY);
        let coloured = spheres(cluster).with_colours(
            (0..2 * CHUNK + 9_000)
                .map(|n| [number(n) as f32, 0.5, 0.25])
                .collect::<Vec<_>>(),
        );
        let even = ellipsoids(scattered(3 * CHUNK));
        // A chunk of its own: with two ranks, one holds nothing but these.
        let mut lonely = vec![DVec3::splat(0.1); CHUNK + 50];
        lonely.extend(scattered(3).iter().map(|p| *p + 5.0));
        vec![spheres(crowd), coloured, even, spheres(lonely)]
    }

    /// Partitions volumes: particles go to ranks in turn, or in runs.
    fn share(volumes: &[PointVolume], rank: usize, size: usize, in_turn: bool) -> Share {
        let part = |volume: &PointVolume| {
            let count = volume.particles.len();
            let is_own = |n: &usize| match in_turn {
                true => n * n % 11 % size == rank,
                false => (rank * count / size..(rank + 1) * count / size).contains(n),
            };
            let own: Vec<usize> = (0..count).filter(is_own).collect();
            let mut rows = Vec::new();
            let of_all = crate::scene::rows::Rows::of(volume);
            of_all.append(&mut rows, own.iter().map(|&n| (n, 3 * n as u64 + 1)));
            let numbers: Vec<u64> = own.iter().map(|&n| 3 * n as u64 + 1).collect();
            (volume_of(&[&rows], volume).unwrap(), numbers)
        };
        let (volumes, numbers) = volumes.iter().map(part).unzip();
        Share {
            volumes,
            numbers: in_turn.then_some(numbers),
            planes: None,
        }
    }

    fn built(volumes: &[PointVolume], size: usize, in_turn: bool) -> Vec<Vec<SharedVolume>> {
        thread::scope(|scope| {
            let ranks = ThreadRank::group(size).into_iter().enumerate();
            let threads = ranks.map(|(rank, own)| {
                scope.spawn(move || {
                    let mut ranks = own;
                    let share = share(volumes, rank, size, in_turn);
                    share
                        .built(&SceneOptions::default(), 0, &mut ranks)
                        .unwrap()
                })
            });
            let threads: Vec<_> = threads.collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        })
    }

    /// Returns the stored columns of the particles in a block.
    fn particles(volume: &BlockedVolume, block: &Block) -> (Vec<[f32; 3]>, Vec<Vec<f32>>) {
        let run = block.first as usize..(block.first + block.count) as usize;
        let (offsets, shapes) = match &volume.particles {
            BlockedParticles::Isotropic { offsets, sigmas } => {
                (offsets, sigmas[run.clone()].to_vec())
            }
            BlockedParticles::Anisotropic { offsets, factors } => {
                (offsets, factors[run.clone()].concat())
            }
            _ => panic!("of points"),
        };
        let mut columns = vec![shapes, volume.strength.stored()[run.clone()].to_vec()];
        if let ColourIn::PerParticle(colours) = &volume.colour {
            columns.push(colours[run.clone()].concat());
        }
        if let Some(ValuesIn::F32(values)) = &volume.values {
            columns.push(values[run.clone()].to_vec());
        }
        if let Some(merged) = &volume.merged {
            columns.push(merged.member_depths[run.clone()].to_vec());
            if !merged.spreads.is_empty() {
                columns.push(merged.spreads[run.clone()].to_vec());
            }
        }
        if let Some(boundary) = &volume.boundary {
            let edges = run.clone().filter_map(|i| boundary.of(i));
            columns.extend(edges.map(|edges| edges.concat()));
        }
        (offsets[run].to_vec(), columns)
    }

    fn assert_same(shared: &SharedVolume, whole: &[BlockedVolume]) -> usize {
        assert_eq!(shared.family.len(), whole.len());
        let mut owned = 0;
        for ((own, runs), all) in shared.family.iter().zip(&shared.own).zip(whole) {
            let without_first = |block: &Block| Block { first: 0, ..*block };
            let blocks = |v: &BlockedVolume| v.blocks.iter().map(without_first).collect::<Vec<_>>();
            assert!(blocks(own) == blocks(all));
            let bounds = |v: &BlockedVolume| v.merged.as_ref().map(|m| m.bounds.clone());
            assert!(bounds(own) == bounds(all));
            for i in runs.iter().cloned().flatten() {
                let (a, b) = (&own.blocks[i as usize], &all.blocks[i as usize]);
                assert!(particles(own, a) == particles(all, b), "block {i}");
                owned += 1;
            }
            let kept: u32 = runs
                .iter()
                .flat_map(|run: &Range<u32>| run.clone())
                .map(|i| own.blocks[i as usize].count)
                .sum();
            assert_eq!(own.particle_count(), kept as usize);
        }
        owned
    }

    #[test]
    fn blocks_made_together_are_those_of_one() {
        let volumes = volumes();
        let whole: Vec<Vec<BlockedVolume>> = volumes
            .iter()
            .map(|volume| BlockedVolume::with_detail(volume.clone()))
            .collect();
        let scene = BlockedScene::new(volumes.clone(), &SceneOptions::default()).unwrap();
        for (size, in_turn) in breadth::some(vec![(7, true), (3, false), (2, true), (1, false)], 2)
        {
            let ranks = built(&volumes, size, in_turn);
            let mut owned = vec![0; volumes.len()];
            let mut most = vec![0; volumes.len()];
            for shares in &ranks {
                let mut first = 0;
                for (v, (own, whole)) in shares.iter().zip(&whole).enumerate() {
                    owned[v] += assert_same(own, whole);
                    most[v] = most[v].max(own.family[0].particle_count());
                    let densities = &scene.densities()[first..first + whole.len()];
                    assert!(own.densities == densities);
                    assert!(own.visible == whole[0].visible_boxes());
                    first += whole.len();
                }
            }
            for (v, whole) in whole.iter().enumerate() {
                let blocks: usize = whole.iter().map(|own| own.blocks.len()).sum();
                assert_eq!(owned[v], blocks);
            }
            // Points at one position stay together; the rest is distributed.
            let even = 3 * CHUNK / size;
            assert!(most[2] <= even + CHUNK, "{} of {even}", most[2]);
        }
    }

    fn lattice(dims: [usize; 3], is_sharp: bool, values: Values, is_even: bool) -> PointVolume {
        let origin = DVec3::new(-1.0, 2.0, 0.5);
        let mut lattice = Lattice::uniform(dims, origin, DVec3::new(0.1, 0.2, 0.15));
        if !is_even {
            let line = |n: usize| (0..n).map(|i| (i as f64).powf(1.1)).collect::<Vec<f64>>();
            lattice.spacing = crate::scene::LatticeSpacing::Rectilinear {
                coordinates: dims.map(line),
            };
        }
        let range = values
            .finite_range()
            .unwrap_or([0.0, 1.0])
            .map(|x| x as f32);
        let shells = |v: f32| if (v - 0.6).abs() < 0.05 { 0.8 } else { 0.01 };
        PointVolume {
            particles: Particles::Lattice {
                lattice,
                kernel_width: 0.6,
            },
            strength: Strength::Classified {
                volumes: Vec::new(),
            },
            colour: Colour::Classified,
            values: Some(values),
            transfer_function: TransferFunction::from_curves(
                |v| [v, 1.0 - v, 0.5],
                shells,
                range,
                3.0,
            )
            .ok(),
            boundary: is_sharp.then_some(Boundary::Lattice),
            normals: None,
            local_models: None,
        }
    }

    /// Returns a rank's planes of a lattice: one run for each rank, runs in turn, all on the last rank, or overlapping
    /// runs.
    fn planes_of(planes: usize, rank: usize, size: usize, way: usize) -> Vec<Range<usize>> {
        match way {
            0 => std::iter::once(rank * planes / size..(rank + 1) * planes / size).collect(),
            1 => {
                let firsts = (rank * 5..planes).step_by(5 * size);
                firsts.map(|n| n..(n + 5).min(planes)).collect()
            }
            2 if rank + 1 == size => std::iter::once(0..planes).collect(),
            2 => Vec::new(),
            _ => {
                let own = rank * planes / size..((rank + 1) * planes / size + 9).min(planes);
                std::iter::once(own).collect()
            }
        }
    }

    fn share_of_planes(volume: &PointVolume, runs: Vec<Range<usize>>) -> Share {
        let Particles::Lattice { lattice, .. } = &volume.particles else {
            panic!("a lattice");
        };
        let samples = lattice.dims[0] * lattice.dims[1];
        let own: Vec<u32> = runs
            .iter()
            .flat_map(|run| (run.start * samples) as u32..(run.end * samples) as u32)
            .collect();
        let part = PointVolume {
            values: volume.values.as_ref().map(|values| values.gather(&own)),
            ..volume.clone()
        };
        Share {
            planes: Some(vec![runs]),
            ..vec![part].into()
        }
    }

    #[test]
    fn a_lattice_made_of_planes_together_is_that_of_one() {
        let field = |dims: [usize; 3]| {
            let count: usize = dims.iter().product();
            let at = move |n: usize| {
                let [i, j, k] = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
                (0.11 * i as f64).sin() * (0.07 * j as f64 + 0.05 * k as f64).cos()
                    + 0.01 * number(n)
            };
            (0..count).map(at)
        };
        let bytes = |dims| Values::U8(field(dims).map(|v| (127.0 * (v + 1.0)) as u8).collect());
        let floats = |dims| Values::F32(field(dims).map(|v| v as f32).collect());
        let shorts = |dims| Values::I16(field(dims).map(|v| (9e3 * v) as i16).collect());
        // Cubes of 64 cells that several ranks hold slices of; a lattice of fewer planes than a run; a lattice with a
        // hole.
        let mut holed = floats([20, 19, 70]);
        if let Values::F32(values) = &mut holed {
            values[12_345] = f32::NAN;
        }
        let volumes = [
            lattice([70, 66, 150], true, bytes([70, 66, 150]), true),
            lattice([66, 40, 130], false, floats([66, 40, 130]), true),
            lattice([34, 50, 99], true, shorts([34, 50, 99]), false),
            lattice([40, 30, 7], true, bytes([40, 30, 7]), true),
            lattice([20, 19, 70], true, holed, true),
            lattice([9, 1, 66], true, floats([9, 1, 66]), true),
        ];
        for (v, volume) in volumes.iter().enumerate() {
            let Particles::Lattice { lattice, .. } = &volume.particles else {
                panic!("a lattice");
            };
            let planes = lattice.dims[2];
            let whole = BlockedVolume::with_detail(volume.clone());
            for (size, way) in breadth::some(vec![(7, 3), (3, 2), (2, 1), (4, 0), (1, 0)], 3) {
                let shares: Vec<SharedVolume> = thread::scope(|scope| {
                    let ranks = ThreadRank::group(size).into_iter().enumerate();
                    let threads = ranks.map(|(rank, own)| {
                        scope.spawn(move || {
                            let mut ranks = own;
                            let runs = planes_of(planes, rank, size, way);
                            let share = share_of_planes(volume, runs);
                            let mut built = share
                                .built(&SceneOptions::default(), 0, &mut ranks)
                                .unwrap();
                            built.swap_remove(0)
                        })
                    });
                    let threads: Vec<_> = threads.collect();
                    threads.into_iter().map(|t| t.join().unwrap()).collect()
                });
                let mut owned = vec![0; whole.len()];
                for own in &shares {
                    assert_eq!(own.family.len(), whole.len(), "{v}, {size} ranks");
                    assert!(own.visible == whole[0].visible_boxes());
                    for (level, (a, b)) in own.family.iter().zip(&whole).enumerate() {
                        assert!(a.blocks == b.blocks, "{v}, level {level}, {size} ranks");
                        let bounds =
                            |v: &BlockedVolume| v.merged.as_ref().map(|m| m.bounds.clone());
                        assert!(bounds(a) == bounds(b));
                        assert_eq!(a.lobes.is_some(), b.lobes.is_some());
                        owned[level] += own.own[level].iter().map(|run| run.len()).sum::<usize>();
                        if level > 0 {
                            assert!(a.values == b.values);
                            continue;
                        }
                        let (Some(found), Some(expected)) = (&a.values, &b.values) else {
                            panic!("values");
                        };
                        assert_eq!(found.len(), expected.len());
                        for brick in own.own[0].iter().cloned().flatten() {
                            assert_neighbours(b, brick, found, expected);
                        }
                    }
                }
                let blocks: Vec<usize> = whole.iter().map(|v| v.blocks.len()).collect();
                assert_eq!(owned, blocks, "{v}, {size} ranks");
            }
        }
    }

    /// Asserts that a rank holds the values of a brick, and of the two layers of cells around it.
    fn assert_neighbours(
        volume: &BlockedVolume,
        brick: u32,
        found: &ValuesIn<crate::scene::Shared>,
        expected: &ValuesIn<crate::scene::Shared>,
    ) {
        let BlockedParticles::Lattice(grid) = &volume.particles else {
            panic!("a lattice");
        };
        let dims = grid.dims();
        let cells = grid.cells(brick);
        let [x, y, z] =
            [0, 1, 2].map(|a| cells[a][0].saturating_sub(2)..(cells[a][1] + 2).min(dims[a]));
        for k in z {
            for j in y.clone() {
                for i in x.clone() {
                    let at = grid.index([i, j, k]);
                    let (a, b) = (found.get(at), expected.get(at));
                    assert_eq!(a.to_bits(), b.to_bits(), "{i} {j} {k}");
                }
            }
        }
    }

    #[test]
    fn planes_that_nobody_has_or_that_are_beyond_the_lattice_are_refused() {
        let dims = [5, 4, 70];
        let volume = lattice(dims, true, Values::U8(vec![3; 1400]), true);
        for (own, word) in [
            ([0..30, 31..70], "no rank that has plane 30"),
            ([0..40, 40..71], "one beyond 70"),
        ] {
            let said: Vec<String> = thread::scope(|scope| {
                let ranks = ThreadRank::group(2).into_iter().zip(own);
                let threads = ranks.map(|(own, run)| {
                    let volume = &volume;
                    scope.spawn(move || {
                        let mut ranks = own;
                        let count = (run.len() * 20).min(1400);
                        let part = PointVolume {
                            values: Some(Values::U8(vec![3; count])),
                            ..volume.clone()
                        };
                        let share = Share {
                            planes: Some(vec![std::iter::once(run).collect()]),
                            ..vec![part].into()
                        };
                        let built = share.built(&SceneOptions::default(), 0, &mut ranks);
                        built.map(|_| ()).unwrap_err().to_string()
                    })
                });
                let threads: Vec<_> = threads.collect();
                threads.into_iter().map(|t| t.join().unwrap()).collect()
            });
            for said in said {
                assert!(said.contains(word), "{said}");
            }
        }
    }

    #[test]
    fn a_number_that_two_have_is_refused_by_all() {
        let volumes = [spheres(scattered(CHUNK + 100))];
        let ranks = thread::scope(|scope| {
            let ranks = ThreadRank::group(2).into_iter().enumerate();
            let threads = ranks.map(|(rank, own)| {
                let volumes = &volumes;
                scope.spawn(move || {
                    let mut ranks = own;
                    let mut share = share(volumes, rank, 2, true);
                    if let Some(numbers) = &mut share.numbers {
                        numbers[0][5] = 3 * 77 + 1;
                        numbers[0][6 + rank] = u64::MAX - rank as u64;
                    }
                    share
                        .built(&SceneOptions::default(), 0, &mut ranks)
                        .map(|_| ())
                })
            });
            let threads: Vec<_> = threads.collect();
            threads
                .into_iter()
                .map(|t| t.join().unwrap())
                .collect::<Vec<_>>()
        });
        for result in ranks {
            let said = result.unwrap_err().to_string();
            assert!(said.contains("two of number 232"), "{said}");
        }
    }
}
