//! Scatters volumes that one rank holds: data that ranks cannot read in parallel are read by one rank.

use bytemuck::Pod;

use super::metadata::{Metadata, decode, encode};
use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::message::unknown;
use crate::ranks::Share;
use crate::scene::columns::{Columns, Visitor};
use crate::scene::{Owned, Particles, PointVolume};

/// Bytes that the owner sends to all others at a time.
const PARCEL: usize = 1 << 26;

/// Scatters the first rank's volumes.
///
/// The other ranks receive the metadata of every volume, and all columns of lattices that store more than values.
/// Points, and lattices of values only, stay on the first rank until the ranks build blocks together.
///
/// - `own`: the volumes, on the first rank.
///
/// # Errors
/// No volumes on the first rank; metadata with numbers that are not finite; a rank that is gone.
pub(crate) fn scatter(own: Option<Vec<PointVolume>>, ranks: &mut dyn Collective) -> Result<Share> {
    let is_first = ranks.rank() == 0;
    let metadata = match (&own, is_first) {
        (_, false) => Ok(None),
        (Some(own), true) => {
            let valid = own.iter().try_for_each(PointVolume::validate);
            let metadata: Vec<Metadata> = own.iter().map(Metadata::of).collect();
            valid.and_then(|()| encode(&metadata)).map(Some)
        }
        (None, true) => Err(Error::invalid(
            "scene",
            "ranks",
            "volumes on the first rank",
            "none",
            "give the first rank the scene",
        )),
    };
    // All ranks use the metadata that the first rank sent, so that all make the same calls.
    let metadata = decode(&ranks.broadcast(0, metadata)?)?;
    let without = metadata.iter().map(Metadata::volume);
    let without: Vec<PointVolume> = without.collect::<Result<_>>()?;
    let volumes = own.filter(|_| is_first).unwrap_or(without);
    let metadata: Vec<(usize, Metadata)> = metadata
        .into_iter()
        .map(|of_volume| (0, of_volume))
        .collect();
    share_of(volumes, &metadata, ranks)
}

/// Merges the volumes of all ranks, in the order of the ranks. Each rank receives the volumes of the others as in
/// [`scatter`].
///
/// # Errors
/// Volumes that are not valid; metadata with numbers that are not finite; a rank that is gone.
pub(crate) fn distribute(own: Vec<PointVolume>, ranks: &mut dyn Collective) -> Result<Share> {
    let valid = own.iter().try_for_each(PointVolume::validate);
    let metadata: Vec<Metadata> = own.iter().map(Metadata::of).collect();
    let parts = ranks.gather_parts(valid.and_then(|()| encode(&metadata)))?;
    let mut own = own.into_iter();
    let (mut volumes, mut metadata) = (Vec::new(), Vec::new());
    for (rank, part) in parts.iter().enumerate() {
        for of_volume in decode(part)? {
            // All ranks check all metadata, so that none fails alone.
            let stand_in = of_volume.volume()?;
            let its_own = if rank == ranks.rank() {
                own.next()
            } else {
                None
            };
            volumes.push(its_own.unwrap_or(stand_in));
            metadata.push((rank, of_volume));
        }
    }
    share_of(volumes, &metadata, ranks)
}

/// Makes a share of volumes that some rank holds, and sends the lattices that every rank needs entirely.
///
/// - `metadata`: metadata of each volume, and the rank that holds it.
fn share_of(
    mut volumes: Vec<PointVolume>,
    metadata: &[(usize, Metadata)],
    ranks: &mut dyn Collective,
) -> Result<Share> {
    let mut planes = Vec::with_capacity(volumes.len());
    for (volume, (owner, of_volume)) in volumes.iter_mut().zip(metadata) {
        let Particles::Lattice { lattice, .. } = &volume.particles else {
            planes.push(Vec::new());
            continue;
        };
        let all = 0..lattice.dims[2];
        if of_volume.is_plain {
            let is_here = *owner == ranks.rank();
            planes.push(if is_here { vec![all] } else { Vec::new() });
        } else {
            let owner = *owner;
            volume.visit(&mut Sending { owner, ranks })?;
            planes.push(vec![all]);
        }
    }
    Ok(Share {
        volumes,
        numbers: None,
        planes: Some(planes),
    })
}

/// Broadcasts all columns of a lattice.
struct Sending<'a> {
    owner: usize,
    ranks: &'a mut dyn Collective,
}

impl Visitor<Owned> for Sending<'_> {
    type Error = Error;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        _: usize,
        column: &mut Vec<T>,
    ) -> Result<()> {
        send(column, self.owner, self.ranks)
    }
}

/// Broadcasts the owner's column.
fn send<T: Pod>(column: &mut Vec<T>, owner: usize, ranks: &mut dyn Collective) -> Result<()> {
    let is_here = ranks.rank() == owner;
    let count = column.len() as u64;
    let count = ranks.broadcast(owner, Ok(is_here.then(|| count.to_le_bytes().to_vec())))?;
    let count = count.first_chunk().map(|n| u64::from_le_bytes(*n));
    let count = count.and_then(|n| usize::try_from(n).ok());
    let count = count.ok_or_else(|| unknown("no count"))?;
    // Memory holds one copy for each rank at a time.
    let step = (PARCEL / ranks.size() / size_of::<T>()).max(1);
    for first in (0..count).step_by(step) {
        let own = is_here.then(|| {
            let run = &column[first..(first + step).min(count)];
            bytemuck::cast_slice(run).to_vec()
        });
        let run = ranks.broadcast(owner, Ok(own))?;
        if !is_here {
            column.extend(bytemuck::pod_collect_to_vec::<u8, T>(&run));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::thread;

    use glam::DVec3;

    use super::*;
    use crate::ranks::ThreadRank;
    use crate::scene::{Colour, Lattice, Strength, TransferFunction, Values};

    #[test]
    fn volumes_of_several_ranks_are_where_they_are_or_stood_for() {
        let points = |n: usize| {
            PointVolume::new(
                Particles::Isotropic {
                    positions: vec![DVec3::splat(n as f64); n],
                    sigmas: vec![1.0; n],
                },
                Strength::Mass(vec![0.5; n]),
            )
            .with_colour([0.25; 3])
        };
        let function = TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, [0.0, 24.0], 1.0);
        let function = function.unwrap();
        // With volumes of its own, a lattice is needed entirely on all ranks.
        let lattice = |volumes: Vec<f32>| PointVolume {
            particles: Particles::Lattice {
                lattice: Lattice::uniform([2, 3, 4], DVec3::ZERO, DVec3::ONE),
                kernel_width: 0.6,
            },
            strength: Strength::Classified { volumes },
            colour: Colour::Classified,
            values: Some(Values::U8((0..24).collect())),
            transfer_function: Some(function.clone()),
            ..points(0)
        };
        let of_ranks = [
            vec![points(3), lattice(vec![2.0; 24])],
            vec![],
            vec![lattice(Vec::new()), points(5)],
        ];
        let shares: Vec<Share> = thread::scope(|scope| {
            let ranks = ThreadRank::group(3).into_iter().zip(of_ranks.clone());
            let share = |mut own, volumes| distribute(volumes, &mut own).unwrap();
            let threads: Vec<_> = ranks
                .map(|(own, volumes)| scope.spawn(move || share(own, volumes)))
                .collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        let owners = [0, 0, 2, 2];
        let all = of_ranks.concat();
        for (rank, share) in shares.iter().enumerate() {
            let planes = share.planes.as_ref().unwrap();
            assert_eq!((share.volumes.len(), planes.len()), (4, 4));
            let each = share.volumes.iter().zip(&all).zip(planes).zip(owners);
            for (v, (((volume, whole), planes), owner)) in each.enumerate() {
                if owner == rank || v == 1 {
                    assert!(volume == whole, "{rank} {v}");
                } else {
                    assert!(
                        *volume == Metadata::of(whole).volume().unwrap(),
                        "{rank} {v}"
                    );
                }
                let has_planes = v == 1 || (v == 2 && rank == 2);
                assert_eq!(
                    planes.iter().map(std::ops::Range::len).sum::<usize>(),
                    if has_planes { 4 } else { 0 },
                    "{rank} {v}"
                );
            }
        }
        // A rank whose volume is not valid reports the error to all.
        let broken = PointVolume {
            strength: Strength::Mass(vec![0.5; 2]),
            ..points(3)
        };
        let errors: Vec<String> = thread::scope(|scope| {
            let ranks = ThreadRank::group(2).into_iter().zip([vec![], vec![broken]]);
            let share = |mut own, volumes| distribute(volumes, &mut own).unwrap_err();
            let threads: Vec<_> = ranks
                .map(|(own, volumes)| scope.spawn(move || share(own, volumes).to_string()))
                .collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert!(
            errors[0].starts_with("rank 1: ") && errors[0].ends_with(&errors[1]),
            "{errors:?}"
        );
    }
}
