//! Packs particles as rows of bytes: each row is a particle's number and everything a volume stores of the
//! particle.

use std::convert::Infallible;
use std::fmt::Write;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::vec;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use super::MOST_EDGES;
use super::storage::Owned;
use crate::error::{Error, Result};
use crate::scene::boundary::{Boundary, BoundaryPlanes};
use crate::scene::columns::{ColumnBytes, Columns, Visitor};
use crate::scene::local_models::LocalModels;
use crate::scene::point_volume::{Colour, Particles, PointVolume, Strength};
use crate::scene::values::Values;

/// The planes that cut a particle, or none.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Cut {
    is_cut: u32,
    edges: [[f32; 4]; MOST_EDGES],
}

/// Columns of everything that a set of points stores per particle. Planes become a column, the last.
fn columns(volume: &PointVolume) -> Vec<ColumnBytes<'_>> {
    let mut columns = volume.columns();
    if let Some(Boundary::Planes(planes)) = &volume.boundary {
        let cut = |i| match planes.of(i) {
            Some(edges) => Cut {
                is_cut: 1,
                edges: *edges,
            },
            None => Cut::zeroed(),
        };
        let cuts: Vec<Cut> = (0..planes.of_particle.len()).map(cut).collect();
        columns.push(ColumnBytes {
            name: "cut",
            size: size_of::<Cut>(),
            bytes: bytemuck::cast_slice(&cuts).to_vec().into(),
        });
    }
    columns
}

/// Packs the particles of a set of points as rows: each particle's number, then its columns.
pub(crate) fn rows_of(volume: &PointVolume, numbers: &[u64]) -> Vec<u8> {
    let mut rows = Vec::new();
    Rows::of(volume).append(&mut rows, numbers.iter().copied().enumerate());
    rows
}

/// Packer of a set of points.
pub(crate) struct Rows<'a> {
    columns: Vec<ColumnBytes<'a>>,
}

impl<'a> Rows<'a> {
    pub(crate) fn of(volume: &'a PointVolume) -> Self {
        Self {
            columns: columns(volume),
        }
    }

    /// Appends the rows of some particles, given as (index, number).
    pub(crate) fn append(
        &self,
        rows: &mut Vec<u8>,
        some: impl ExactSizeIterator<Item = (usize, u64)>,
    ) {
        let (start, stride) = (rows.len(), stride(&self.columns));
        let some: Vec<(usize, u64)> = some.collect();
        rows.resize(start + some.len() * stride, 0);
        let each = rows[start..].par_chunks_exact_mut(stride).zip(some);
        each.for_each(|(row, (i, number))| {
            let (own, mut rest) = row.split_at_mut(8);
            own.copy_from_slice(&number.to_le_bytes());
            for ColumnBytes { size, bytes, .. } in &self.columns {
                let (own, others) = rest.split_at_mut(*size);
                own.copy_from_slice(&bytes[i * size..][..*size]);
                rest = others;
            }
        });
    }
}

/// The number of a row.
pub(crate) fn number_of(row: &[u8]) -> u64 {
    row.first_chunk().map_or(0, |n| u64::from_le_bytes(*n))
}

/// The position of a row's particle.
pub(crate) fn position_of(row: &[u8]) -> DVec3 {
    bytemuck::pod_read_unaligned(&row[8..8 + size_of::<DVec3>()])
}

fn stride(columns: &[ColumnBytes<'_>]) -> usize {
    8 + columns.iter().map(|column| column.size).sum::<usize>()
}

/// Bytes per row of a volume.
pub(crate) fn row_len(volume: &PointVolume) -> usize {
    stride(&columns(volume))
}

/// Rows of a volume, in order.
struct Sorted<'a> {
    rows: Vec<&'a [u8]>,
    /// Offset of the next column.
    at: usize,
}

impl Sorted<'_> {
    /// Unpacks the next column, `each` entries of every particle.
    fn next<T: Pod + Send>(&mut self, each: usize) -> Vec<T> {
        let (at, size) = (self.at, size_of::<T>());
        self.at += each * size;
        let entries = self.rows.par_iter().flat_map_iter(|row| {
            let own = row[at..at + each * size].chunks_exact(size);
            own.map(bytemuck::pod_read_unaligned)
        });
        entries.collect()
    }
}

impl Visitor<Owned> for Sorted<'_> {
    type Error = Infallible;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        width: usize,
        column: &mut Vec<T>,
    ) -> Result<(), Infallible> {
        *column = self.next(width);
        Ok(())
    }

    fn planes(&mut self, planes: &mut BoundaryPlanes) -> Result<(), Infallible> {
        *planes = planes_of(&self.next(1));
        Ok(())
    }
}

/// Unpacks rows to a volume, in the order of their numbers. Everything but the particles is copied from `like`.
///
/// # Errors
/// A number that two particles have; rows of another kind of volume.
pub(crate) fn volume_of(parts: &[&[u8]], like: &PointVolume) -> Result<PointVolume> {
    let stride = stride(&columns(like));
    if parts.iter().any(|part| part.len() % stride != 0) {
        return Err(refused("particles of one kind", "particles of several"));
    }
    let rows = parts.iter().flat_map(|part| part.chunks_exact(stride));
    let mut rows: Vec<&[u8]> = rows.collect();
    rows.par_sort_unstable_by_key(|row| number_of(row));
    let is_twice = |w: &[&[u8]]| number_of(w[0]) == number_of(w[1]);
    if let Some(pair) = rows.windows(2).find(|w| is_twice(w)) {
        return Err(twice(number_of(pair[0])));
    }
    Ok(volume_in_order(rows, like))
}

/// The error for a number that two particles have.
pub(crate) fn twice(number: u64) -> Error {
    let found = format!("two of number {number}");
    refused("a number of its own for each particle", &found)
}

/// Unpacks rows in the given order; otherwise as [`volume_of`].
pub(crate) fn volume_in_order(rows: Vec<&[u8]>, like: &PointVolume) -> PointVolume {
    let mut volume = like.emptied();
    let Ok(()) = volume.visit(&mut Sorted { rows, at: 8 });
    volume
}

/// Appends the points of a volume to those of another of the same kind.
pub(crate) fn append(all: &mut PointVolume, part: PointVolume) {
    let planes = match &part.boundary {
        Some(Boundary::Planes(planes)) => Some(planes),
        Some(Boundary::Lattice) | None => None,
    };
    let Ok(()) = all.visit(&mut Appending {
        columns: part.columns().into_iter(),
        planes,
    });
}

/// Columns that are appended to those of a volume of the same kind.
struct Appending<'a> {
    columns: vec::IntoIter<ColumnBytes<'a>>,
    planes: Option<&'a BoundaryPlanes>,
}

impl Visitor<Owned> for Appending<'_> {
    type Error = Infallible;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        _: usize,
        column: &mut Vec<T>,
    ) -> Result<(), Infallible> {
        if let Some(own) = self.columns.next() {
            column.extend_from_slice(bytemuck::cast_slice(&own.bytes));
        }
        Ok(())
    }

    fn planes(&mut self, planes: &mut BoundaryPlanes) -> Result<(), Infallible> {
        if let Some(own) = self.planes {
            let before = u32::try_from(planes.edges.len()).unwrap_or(u32::MAX);
            let word = |&word: &u32| if word > 0 { word + before } else { 0 };
            planes.of_particle.extend(own.of_particle.iter().map(word));
            planes.edges.extend_from_slice(&own.edges);
        }
        Ok(())
    }
}

fn planes_of(cuts: &[Cut]) -> BoundaryPlanes {
    let mut planes = BoundaryPlanes::default();
    for cut in cuts {
        if cut.is_cut != 0 {
            planes.edges.push(cut.edges);
        }
        let place = u32::try_from(planes.edges.len()).unwrap_or(0);
        planes.of_particle.push(cut.is_cut * place);
    }
    planes
}

/// A hash of everything that a volume has besides its particles. Parts with the same hash can be joined to one
/// volume, on several ranks too.
///
/// If there are any particles, the hash includes the scales of local models, because the models' codes mean
/// nothing without.
pub(crate) fn kind_of(volume: &PointVolume) -> u64 {
    let mut words = String::new();
    let mut say = |what: &dyn std::fmt::Debug| {
        // Writing to a string does not fail.
        let _ = write!(words, "{what:?};");
    };
    match &volume.particles {
        Particles::Lattice {
            lattice,
            kernel_width,
        } => say(&(lattice, kernel_width)),
        Particles::Isotropic { .. } => say(&"spheres"),
        Particles::Anisotropic { .. } => say(&"ellipsoids"),
        Particles::Surfels { is_one_sided, .. } => say(&("surfels", is_one_sided)),
    }
    match &volume.strength {
        Strength::Classified { .. } => say(&"classified"),
        Strength::Mass(_) => say(&"mass"),
        Strength::Surface(_) => say(&"surface"),
        Strength::Translucent(_) => say(&"translucent"),
        Strength::PeakOpacity {
            rule, by_distance, ..
        } => say(&("opacity", rule, by_distance)),
    }
    match &volume.colour {
        Colour::Classified => say(&"classified"),
        Colour::PerParticle(_) => say(&"colours"),
        Colour::Uniform(colour) => say(colour),
        Colour::Harmonics {
            degree, is_linear, ..
        } => say(&("harmonics", degree, is_linear)),
    }
    say(&volume.values.as_ref().map(Values::type_name));
    say(&volume.transfer_function);
    match &volume.boundary {
        None => say(&"no boundary"),
        Some(Boundary::Lattice) => say(&"box"),
        Some(Boundary::Planes(_)) => say(&"planes"),
    }
    say(&volume.normals.is_some());
    say(&volume.local_models.is_some());
    let mut hasher = DefaultHasher::new();
    words.hash(&mut hasher);
    hasher.finish()
}

fn refused(expected: &str, found: &str) -> Error {
    let advice = "give parts of the same volumes";
    Error::invalid("scene", "parts of a volume", expected, found, advice)
}

/// The scales of a volume's local models, if any particles have some.
pub(crate) fn model_scales(volume: &PointVolume) -> Option<[f32; 2]> {
    let models = volume.local_models.as_ref().filter(|m| !m.is_empty());
    models.map(LocalModels::scales)
}
