//! What a rank brings of a scene.

use super::message::{put, take};
use super::ranks::Ranks;
use crate::blocks::{LEAST, SceneOptions, SharedVolume, build_together, check_count};
use crate::error::{Error, Result};
use crate::scene::rows::{kind_of, model_scales, rows_of, volume_of};
use crate::scene::{Particles, PointVolume};

/// A rank's share of a scene: some particles of each volume, or none.
///
/// All ranks have the same volumes in the same order, alike but for their particles: of one kind, with one transfer
/// function. Of a lattice every rank has all. Codes of local models are of one scale: shares are taken of models that
/// were made of the whole ([`LocalModels::gather`](crate::scene::LocalModels::gather)).
#[derive(Debug, Clone, PartialEq)]
pub struct Share {
    /// The volumes.
    pub volumes: Vec<PointVolume>,
    /// Of each volume, the number of each of these particles among those of all ranks: the order that one machine
    /// would have them in, which decides about ties of depth; of a lattice none count. `None` numbers them one rank after
    /// another.
    pub numbers: Option<Vec<Vec<u64>>>,
}

impl From<Vec<PointVolume>> for Share {
    fn from(volumes: Vec<PointVolume>) -> Self {
        Self {
            volumes,
            numbers: None,
        }
    }
}

impl Share {
    /// The volumes of all ranks in blocks, of which each has a share of the particles: the same blocks as of all particles
    /// in one place.
    ///
    /// - `small`: volumes of no more particles for each rank are built by each as a whole.
    ///
    /// # Errors
    /// Shares that are not of the same volumes, or numbers that are not one for each particle; a rank that is gone.
    pub(super) fn built(
        self,
        options: &SceneOptions,
        small: u64,
        ranks: &mut Ranks,
    ) -> Result<Vec<SharedVolume>> {
        let checked = self.check();
        let own = checked.map(|()| {
            let mut part = Vec::new();
            let mut kinds: Vec<u64> = self.volumes.iter().map(kind_of).collect();
            kinds.push(u64::from(options.level_of_detail));
            put(&mut part, &kinds);
            put(&mut part, &[u8::from(self.numbers.is_some())]);
            for volume in &self.volumes {
                let scales: Vec<[f32; 2]> = model_scales(volume).into_iter().collect();
                put(&mut part, &scales);
                put(&mut part, &[volume.particles.len() as u64]);
            }
            part
        });
        let parts = ranks.gather_to_all(own)?;
        let known = known_volumes(&parts, self.volumes.len());
        let known = ranks.agree(known)?;
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
                ranks.sums(Ok(vec![placed as u64]))?.iter().sum()
            };
            // The same on all ranks.
            total += count;
            check_count(usize::try_from(total).unwrap_or(usize::MAX))?;
            let own = if is_lattice {
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

    fn check(&self) -> Result<()> {
        self.volumes.iter().try_for_each(PointVolume::validate)?;
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

fn refused(expected: &str, found: &str) -> Error {
    let advice = "give every rank a share of the same volumes";
    Error::invalid("scene", "shares of ranks", expected, found, advice)
}

/// What ranks told of their volumes.
struct Known {
    /// Of each rank, how many particles it has of each volume.
    counts: Vec<Vec<u64>>,
    /// Of each volume the scales of its local models, where any rank has some.
    scales: Vec<Option<[f32; 2]>>,
    /// Whether any rank gives numbers.
    is_numbered: bool,
}

impl Known {
    /// Numbers of a rank that gives none, where others do.
    fn numbers(&self, v: usize, rank: usize, count: usize) -> Option<Vec<u64>> {
        self.is_numbered.then(|| self.by_rank(v, rank, count))
    }

    /// Numbers of a rank's particles, one rank after another.
    fn by_rank(&self, v: usize, rank: usize, count: usize) -> Vec<u64> {
        let first: u64 = self.counts[..rank].iter().map(|own| own[v]).sum();
        (first..first + count as u64).collect()
    }

    /// A volume whose local models have the scales of all.
    fn with_scales(&self, v: usize, mut volume: PointVolume) -> PointVolume {
        if let Some(scales) = self.scales[v] {
            volume.local_models = volume.local_models.map(|m| m.with_scales(scales));
        }
        volume
    }

    /// The particles of a volume that all ranks have, in the order of their numbers.
    fn gathered(
        &self,
        v: usize,
        volume: PointVolume,
        numbers: Option<Vec<u64>>,
        ranks: &mut Ranks,
    ) -> Result<PointVolume> {
        let by_rank = || self.by_rank(v, ranks.rank(), volume.particles.len());
        let numbers = numbers.unwrap_or_else(by_rank);
        let parts = ranks.gather_to_all(Ok(rows_of(&volume, &numbers)))?;
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
        let mut counts = Vec::with_capacity(volumes);
        for of_all in &mut known.scales {
            if let Some(scales) = take::<[f32; 2]>(&mut part)?.first().copied()
                && *of_all.get_or_insert(scales) != scales
            {
                return Err(refused("local models of one scale", "several scales"));
            }
            counts.extend(take::<u64>(&mut part)?);
        }
        known.counts.push(counts);
    }
    Ok(known)
}

#[cfg(test)]
mod tests {
    use std::ops::Range;
    use std::thread;

    use glam::DVec3;

    use super::super::ThreadRank;
    use super::*;
    use crate::blocks::{Block, BlockedParticles, BlockedScene, BlockedVolume, SceneOptions};
    use crate::scene::{
        Boundary, BoundaryPlanes, Colour, ColourIn, Strength, TransferFunction, Values, ValuesIn,
    };

    /// Points of a chunk of the tree at most.
    const CHUNK: usize = 1 << 16;

    /// Numbers without a pattern, 0 to 1.
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

    /// Several chunks of points that lie apart; more than a chunk in one place, and nearly so; a dense cluster far narrower
    /// than a cell of a curve through all.
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
        // Few by themselves: a rank of two has these alone.
        let mut lonely = vec![DVec3::splat(0.1); CHUNK + 50];
        lonely.extend(scattered(3).iter().map(|p| *p + 5.0));
        vec![spheres(crowd), coloured, even, spheres(lonely)]
    }

    /// Parts of volumes, whose particles lie in turn on several ranks or one rank after another.
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
        }
    }

    fn built(volumes: &[PointVolume], size: usize, in_turn: bool) -> Vec<Vec<SharedVolume>> {
        thread::scope(|scope| {
            let ranks = ThreadRank::group(size).into_iter().enumerate();
            let threads = ranks.map(|(rank, own)| {
                scope.spawn(move || {
                    let mut ranks = Ranks::new(Box::new(own));
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

    /// What is stored of the particles of a block.
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
        for (size, in_turn) in [(1, false), (2, true), (3, false), (7, true)] {
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
            // Crowds of one place stay together; the rest is dealt out.
            let even = 3 * CHUNK / size;
            assert!(most[2] <= even + CHUNK, "{} of {even}", most[2]);
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
                    let mut ranks = Ranks::new(Box::new(own));
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
