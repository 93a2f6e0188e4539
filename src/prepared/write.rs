//! Writes a scene to a file.

use std::borrow::Cow;
use std::io::BufWriter;
use std::path::Path;

use glam::DVec3;

use super::about::{About, BatchHead, Function, Grid, Head, Particles, VERSION, Volume};
use super::columns::Id;
use super::file::{self, Batch, Part};
use crate::blocks::{BlockedParticles, BlockedScene, BlockedVolume};
use crate::error::{Error, Result};
use crate::io::write_atomically;
use crate::scene::columns::{ColumnBytes, Columns};
use crate::scene::headers::{ColourHeader, StrengthHeader, ValuesHeader};
use crate::view::Bounds;

/// Writes a scene; returns the number of bytes written.
pub(super) fn write(path: &Path, scene: &BlockedScene, about: &About) -> Result<u64> {
    let amplitudes = scene.amplitudes_of_volumes();
    let volumes = scene.families().iter().zip(amplitudes).enumerate();
    let volumes = volumes.map(|(i, (_, amplitudes))| {
        let family = scene.family(i);
        let base = &family[0];
        // Transfer function that classifies; a frame that classifies slabs carries values in its place.
        let transfer = scene.shown_function(i);
        Volume {
            transfer_function: transfer.map(Function::of),
            amplitudes: amplitudes.into(),
            lattice: match &base.particles {
                BlockedParticles::Lattice(grid) => {
                    let ghosts = grid.faces().map(|faces| faces.ghosts());
                    Some(Grid::of(grid.lattice(), grid.kernel_width(), ghosts))
                }
                _ => None,
            },
            batches: family.iter().map(head_of).collect(),
        }
    });
    let head = Head {
        version: VERSION,
        about: about.clone(),
        volumes: volumes.collect(),
    };
    let text = serde_json::to_string(&head).unwrap_or_default();
    if serde_json::from_str::<Head>(&text).is_err() {
        let (expected, found) = (
            "finite numbers",
            "others among colours, lengths or amplitudes",
        );
        let advice = "leave such particles out";
        return Err(Error::invalid(
            "prepared scene",
            "volumes",
            expected,
            found,
            advice,
        ));
    }
    let densities = scene.densities();
    let mut batches = Vec::new();
    for (i, range) in scene.families().iter().enumerate() {
        let visible = scene.visible_box_of_each(i);
        for (level, volume) in scene.family(i).iter().enumerate() {
            let visible = if level == 0 { &*visible } else { &[] };
            batches.push(batch_of(volume, visible, &densities[range.start + level]));
        }
    }
    write_atomically(path, |out| {
        file::write(&mut BufWriter::new(out), text, &batches)
    })
}

fn head_of(volume: &BlockedVolume) -> BatchHead {
    BatchHead {
        particles: match &volume.particles {
            BlockedParticles::Lattice(grid) => Particles::Lattice {
                cube: grid.cells_per_edge(),
            },
            BlockedParticles::Isotropic { .. } => Particles::Isotropic,
            BlockedParticles::Anisotropic { .. } => Particles::Anisotropic,
            BlockedParticles::Surfels { is_one_sided, .. } => Particles::Surfels {
                is_one_sided: *is_one_sided,
            },
        },
        strength: StrengthHeader::of(&volume.strength),
        colour: ColourHeader::of(&volume.colour),
        values: volume.values.as_ref().map(ValuesHeader::of),
        local_model_scales: volume.local_models.as_ref().map(|models| models.scales()),
        has_normals: volume.normals.is_some(),
        has_indices: volume.indices.is_some(),
        has_planes: volume.boundary.is_some(),
    }
}

/// Collects the columns of a volume or of a level of detail.
///
/// - `visible`: box of the visible part of each block.
fn batch_of<'a>(
    volume: &'a BlockedVolume,
    visible: &[Option<Bounds>],
    densities: &'a [f64],
) -> Batch<'a> {
    let mut batch = Rows {
        volume,
        batch: Batch {
            rows: volume.blocks.len(),
            parts: Vec::new(),
        },
    };
    batch.of_blocks(Id::Level, |b| [b.level]);
    batch.of_blocks(Id::Origin, |b| b.origin.to_array());
    batch.of_blocks(Id::HalfExtent, |b| b.half_extent.to_array());
    batch.of_blocks(Id::MaxSigma, |b| [b.max_sigma]);
    batch.of_blocks(Id::MinSigma, |b| [b.min_sigma]);
    batch.of_blocks(Id::MaxStrength, |b| [b.max_strength]);
    batch.of_blocks(Id::First, |b| [b.first]);
    batch.of_blocks(Id::Count, |b| [b.count]);
    batch.of_blocks(Id::ValueRange, |b| b.value_range);
    batch.of_blocks(Id::ValuesAround, |b| b.values_around);
    batch.of_blocks(Id::GreatestSpread, |b| [b.greatest_spread]);
    batch.of_blocks(Id::Parent, |b| [b.parent]);
    batch.of_blocks(Id::Crowding, |b| [b.crowding]);
    batch.push(
        Id::Density,
        Vec::new(),
        Cow::Borrowed(bytemuck::cast_slice(densities)),
    );
    let boxes: Vec<[DVec3; 2]> = visible.iter().flatten().map(|&(a, b)| [a, b]).collect();
    let seen = visible.iter().map(|own| i64::from(own.is_some()));
    let boxes = bytemuck::cast_slice(&boxes).to_vec();
    batch.list(Id::Visible, sums(seen), Cow::Owned(boxes));
    if let Some(merged) = &volume.merged {
        let one_each = sums(merged.bounds.iter().map(|_| 1));
        let bounds = bytemuck::cast_slice(&merged.bounds);
        batch.list(Id::Bounds, one_each, Cow::Borrowed(bounds));
    }
    for column in volume.columns() {
        // Values are narrowed when a volume is made.
        if let Some(id) = Id::named(column.name) {
            batch.of_particles(id, column);
        }
    }
    if let Some(boundary) = &volume.boundary {
        let words = ColumnBytes::of("cut", 1, &boundary.of_particle);
        batch.of_particles(Id::Cut, words);
        let cut = volume.blocks.iter().map(|b| {
            let members = b.first as usize..(b.first + b.count) as usize;
            let words = boundary.of_particle[members].iter();
            words.filter(|word| **word > 0).count() as i64
        });
        let planes = bytemuck::cast_slice(&boundary.edges);
        batch.list(Id::Planes, sums(cut), Cow::Borrowed(planes));
    }
    batch.batch
}

/// Returns the beginnings of lists of these lengths, and the end of the last.
fn sums(lengths: impl Iterator<Item = i64>) -> Vec<i64> {
    let sum = |sum: &mut i64, len| {
        *sum += len;
        Some(*sum)
    };
    std::iter::once(0).chain(lengths.scan(0, sum)).collect()
}

/// Builds a batch.
struct Rows<'a> {
    volume: &'a BlockedVolume,
    batch: Batch<'a>,
}

impl<'a> Rows<'a> {
    fn push(&mut self, id: Id, offsets: Vec<i64>, bytes: Cow<'a, [u8]>) {
        self.batch.parts.push(Part { id, offsets, bytes });
    }

    /// Adds a column of blocks.
    fn of_blocks<const N: usize, T: bytemuck::Pod>(
        &mut self,
        id: Id,
        of: impl Fn(&crate::blocks::Block) -> [T; N],
    ) {
        let numbers: Vec<T> = self.volume.blocks.iter().flat_map(of).collect();
        let bytes = bytemuck::cast_slice(&numbers).to_vec();
        self.push(id, Vec::new(), Cow::Owned(bytes));
    }

    /// Adds a column of lists, unless all are empty.
    fn list(&mut self, id: Id, offsets: Vec<i64>, bytes: Cow<'a, [u8]>) {
        if !bytes.is_empty() {
            self.push(id, offsets, bytes);
        }
    }

    /// Adds a column of particles: those of each block in its row. A lattice's order is not that of its blocks: its
    /// first row has all elements.
    fn of_particles(&mut self, id: Id, column: ColumnBytes<'a>) {
        let element = id.column().stride();
        let whole = (column.bytes.len() / element) as i64;
        let each = (column.size / element) as i64;
        let blocks = self.volume.blocks.iter();
        let offsets = match self.volume.particles {
            BlockedParticles::Lattice(_) => sums(
                (0..)
                    .zip(blocks)
                    .map(|(i, _)| if i == 0 { whole } else { 0 }),
            ),
            _ => sums(blocks.map(|b| i64::from(b.count) * each)),
        };
        self.list(id, offsets, column.bytes);
    }
}
