//! A scene that the first rank has, for all: what cannot be read apart one reads, and hands out.

use bytemuck::Pod;

use super::head::{Head, heard, told};
use super::message::unknown;
use super::ranks::Ranks;
use super::share::Share;
use crate::error::{Error, Result};
use crate::scene::{Colour, Particles, PointVolume, Strength, Values};

/// Bytes that the first rank sends to all others at a time.
const PARCEL: usize = 1 << 26;

/// The first rank's volumes, of which others get all but the particles: they have none of points, and no planes of a
/// lattice of which blocks can be made together. Of other lattices every rank gets all.
///
/// - `own`: of the first rank.
///
/// # Errors
/// Nothing on the first rank; numbers that are none among what volumes have besides particles; a rank that is gone.
pub(crate) fn scatter(own: Option<Vec<PointVolume>>, ranks: &mut Ranks) -> Result<Share> {
    let is_first = ranks.rank() == 0;
    let heads = match (&own, is_first) {
        (_, false) => Ok(None),
        (Some(own), true) => {
            let valid = own.iter().try_for_each(PointVolume::validate);
            let heads: Vec<Head> = own.iter().map(Head::of).collect();
            valid.and_then(|()| told(&heads)).map(Some)
        }
        (None, true) => Err(Error::invalid(
            "scene",
            "ranks",
            "volumes on the first rank",
            "none",
            "give the first rank the scene",
        )),
    };
    // What the first rank told the others is what all go by: they are asked the same way.
    let heads = heard(&ranks.of_first(heads)?)?;
    let without = heads.iter().map(Head::volume);
    let without: Vec<PointVolume> = without.collect::<Result<_>>()?;
    let mut volumes = own.filter(|_| is_first).unwrap_or(without);
    let mut planes = Vec::with_capacity(volumes.len());
    for (volume, head) in volumes.iter_mut().zip(&heads) {
        let Particles::Lattice { lattice, .. } = &volume.particles else {
            planes.push(Vec::new());
            continue;
        };
        let all = 0..lattice.dims[2];
        if head.is_plain {
            planes.push(if is_first { vec![all] } else { Vec::new() });
        } else {
            send_lattice(volume, ranks)?;
            planes.push(vec![all]);
        }
    }
    Ok(Share {
        volumes,
        numbers: None,
        planes: Some(planes),
    })
}

/// Gives every rank all that a lattice has.
fn send_lattice(volume: &mut PointVolume, ranks: &mut Ranks) -> Result<()> {
    match &mut volume.strength {
        Strength::Classified { volumes: stored }
        | Strength::Mass(stored)
        | Strength::Surface(stored)
        | Strength::Translucent(stored)
        | Strength::PeakOpacity {
            opacities: stored, ..
        } => send(stored, ranks)?,
    }
    match &mut volume.colour {
        Colour::PerParticle(colours) => send(colours, ranks)?,
        Colour::Harmonics { coefficients, .. } => send(coefficients, ranks)?,
        Colour::Classified | Colour::Uniform(_) => {}
    }
    match &mut volume.values {
        None => {}
        Some(Values::U8(values)) => send(values, ranks)?,
        Some(Values::I16(values)) => send(values, ranks)?,
        Some(Values::U16(values)) => send(values, ranks)?,
        Some(Values::F32(values)) => send(values, ranks)?,
    }
    volume
        .normals
        .as_mut()
        .map_or(Ok(()), |normals| send(normals, ranks))
}

/// Gives every rank the first one's column.
fn send<T: Pod>(column: &mut Vec<T>, ranks: &mut Ranks) -> Result<()> {
    let is_first = ranks.rank() == 0;
    let count = column.len() as u64;
    let count = ranks.of_first(Ok(is_first.then(|| count.to_le_bytes().to_vec())))?;
    let count = count.first_chunk().map(|n| u64::from_le_bytes(*n));
    let count = count.and_then(|n| usize::try_from(n).ok());
    let count = count.ok_or_else(|| unknown("no count"))?;
    // One copy for each rank lies in memory at a time.
    let step = (PARCEL / ranks.size() / size_of::<T>()).max(1);
    for first in (0..count).step_by(step) {
        let own = is_first.then(|| {
            let run = &column[first..(first + step).min(count)];
            bytemuck::cast_slice(run).to_vec()
        });
        let run = ranks.of_first(Ok(own))?;
        if !is_first {
            column.extend(bytemuck::pod_collect_to_vec::<u8, T>(&run));
        }
    }
    Ok(())
}
