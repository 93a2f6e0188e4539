//! What a rank brings of a scene.

use super::message::{put, take};
use super::ranks::Ranks;
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
    /// The volumes of all ranks, their particles in the order of their numbers.
    ///
    /// # Errors
    /// Shares that are not of the same volumes, or numbers that are not one for each particle; a rank that is gone.
    pub(super) fn gathered(self, ranks: &mut Ranks) -> Result<Vec<PointVolume>> {
        let checked = self.check();
        let own = checked.map(|()| {
            let mut part = Vec::new();
            let kinds: Vec<u64> = self.volumes.iter().map(kind_of).collect();
            put(&mut part, &kinds);
            for volume in &self.volumes {
                let scales: Vec<[f32; 2]> = model_scales(volume).into_iter().collect();
                put(&mut part, &scales);
                put(&mut part, &[volume.particles.len() as u64]);
            }
            part
        });
        let parts = ranks.gather_to_all(own)?;
        let known = known_volumes(&parts, self.volumes.len());
        let (firsts, holders) = ranks.agree(known.map(|known| known.of_rank(ranks.rank())))?;
        let mut whole = Vec::with_capacity(self.volumes.len());
        for (v, volume) in self.volumes.into_iter().enumerate() {
            if matches!(volume.particles, Particles::Lattice { .. }) {
                whole.push(volume);
                continue;
            }
            let count = volume.particles.len() as u64;
            let numbers = match &self.numbers {
                Some(numbers) => numbers[v].clone(),
                None => (firsts[v]..firsts[v] + count).collect(),
            };
            let mut part = Vec::new();
            // The scales of local models come from a rank that has any.
            if holders[v] == Some(ranks.rank()) {
                put(
                    &mut part,
                    &model_scales(&volume).map_or(vec![], |s| vec![s]),
                );
            } else {
                put::<[f32; 2]>(&mut part, &[]);
            }
            part.extend(rows_of(&volume, &numbers));
            let parts = ranks.gather_to_all(Ok(part))?;
            let mut rows = Vec::with_capacity(parts.len());
            let mut like = volume;
            for part in &parts {
                let mut part = part.as_slice();
                for scales in take::<[f32; 2]>(&mut part)? {
                    like.local_models = like.local_models.map(|m| m.with_scales(scales));
                }
                rows.push(part);
            }
            let made = volume_of(&rows, &like);
            whole.push(ranks.agree(made)?);
        }
        Ok(whole)
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
    /// Of each volume a rank that has local models of it.
    holders: Vec<Option<usize>>,
}

impl Known {
    /// Of each volume the first number of a rank's particles; and the holders.
    fn of_rank(self, rank: usize) -> (Vec<u64>, Vec<Option<usize>>) {
        let first = |v: usize| self.counts[..rank].iter().map(|counts| counts[v]).sum();
        ((0..self.holders.len()).map(first).collect(), self.holders)
    }
}

fn known_volumes(parts: &[Vec<u8>], volumes: usize) -> Result<Known> {
    let mut known = Known {
        counts: Vec::with_capacity(parts.len()),
        holders: vec![None; volumes],
    };
    let mut scales_of = vec![None; volumes];
    let mut parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let kinds = parts.iter_mut().map(take::<u64>);
    let kinds: Vec<Vec<u64>> = kinds.collect::<Result<_>>()?;
    if let Some(rank) = kinds.iter().position(|own| *own != kinds[0]) {
        let found = format!("others on rank {rank} than on rank 0");
        return Err(refused("the same volumes on every rank", &found));
    }
    for (rank, mut part) in parts.into_iter().enumerate() {
        let mut counts = Vec::with_capacity(volumes);
        for (holder, of_all) in known.holders.iter_mut().zip(&mut scales_of) {
            if let Some(scales) = take::<[f32; 2]>(&mut part)?.first().copied() {
                if *of_all.get_or_insert(scales) != scales {
                    return Err(refused("local models of one scale", "several scales"));
                }
                holder.get_or_insert(rank);
            }
            counts.extend(take::<u64>(&mut part)?);
        }
        known.counts.push(counts);
    }
    Ok(known)
}
