//! Writes a scene to a file.

use std::borrow::Cow;
use std::io::BufWriter;
use std::path::Path;

use glam::DVec3;

use super::about::{
    About, BatchHead, Colour, Function, Grid, Head, Particles, Strength, VERSION, Values, Volume,
};
use super::columns::Id;
use super::file::{self, Batch, Part};
use crate::blocks::{BlockedParticles, BlockedScene, BlockedVolume};
use crate::error::{Error, Result};
use crate::io::write_atomically;
use crate::math::harmonics_count;
use crate::scene::{ColourIn, StrengthIn, ValuesIn};
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
        strength: match volume.strength {
            StrengthIn::Classified { .. } => Strength::Classified,
            StrengthIn::Mass(_) => Strength::Mass,
            StrengthIn::PeakOpacity {
                is_anti_aliased, ..
            } => Strength::PeakOpacity { is_anti_aliased },
            StrengthIn::Surface(_) => Strength::Surface,
            StrengthIn::Translucent(_) => Strength::Translucent,
        },
        colour: match volume.colour {
            ColourIn::Classified => Colour::Classified,
            ColourIn::PerParticle(_) => Colour::PerParticle,
            ColourIn::Uniform(colour) => Colour::Uniform(colour),
            ColourIn::Harmonics {
                degree, is_linear, ..
            } => Colour::Harmonics { degree, is_linear },
        },
        values: volume.values.as_ref().map(|values| match values {
            ValuesIn::U8(_) => Values::U8,
            ValuesIn::I16(_) => Values::I16,
            ValuesIn::U16(_) => Values::U16,
            ValuesIn::F32(_) | ValuesIn::F64(_) => Values::F32,
        }),
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
        batch.of_particles(Id::Spread, &merged.spreads, 1);
        batch.of_particles(Id::MemberDepth, &merged.member_depths, 1);
    }
    match &volume.particles {
        BlockedParticles::Lattice(_) => {}
        BlockedParticles::Isotropic { offsets, sigmas } => {
            batch.of_particles(Id::Offset, offsets, 1);
            batch.of_particles(Id::Sigma, sigmas, 1);
        }
        BlockedParticles::Anisotropic { offsets, factors } => {
            batch.of_particles(Id::Offset, offsets, 1);
            batch.of_particles(Id::Factor, factors, 1);
        }
        BlockedParticles::Surfels {
            offsets, tangents, ..
        } => {
            batch.of_particles(Id::Offset, offsets, 1);
            batch.of_particles(Id::Tangents, tangents, 1);
        }
    }
    batch.of_particles(Id::Strength, volume.strength.stored(), 1);
    match &volume.colour {
        ColourIn::PerParticle(colours) => batch.of_particles(Id::Colour, colours, 1),
        ColourIn::Harmonics {
            degree,
            coefficients,
            ..
        } => batch.of_particles(Id::Harmonics, coefficients, 3 * harmonics_count(*degree)),
        ColourIn::Classified | ColourIn::Uniform(_) => {}
    }
    match &volume.values {
        Some(ValuesIn::U8(values)) => batch.of_particles(Id::ValueU8, values, 1),
        Some(ValuesIn::I16(values)) => batch.of_particles(Id::ValueI16, values, 1),
        Some(ValuesIn::U16(values)) => batch.of_particles(Id::ValueU16, values, 1),
        Some(ValuesIn::F32(values)) => batch.of_particles(Id::ValueF32, values, 1),
        // A volume's values are narrowed when it is made.
        Some(ValuesIn::F64(_)) => {}
        None => {}
    }
    if let Some(models) = &volume.local_models {
        batch.of_particles(Id::Model, models.codes(), 1);
    }
    if let Some(normals) = &volume.normals {
        batch.of_particles(Id::Normal, normals, 1);
    }
    if let Some(indices) = &volume.indices {
        batch.of_particles(Id::Index, indices, 1);
    }
    if let Some(boundary) = &volume.boundary {
        batch.of_particles(Id::Cut, &boundary.of_particle, 1);
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

    /// Adds a column of `stride` elements for each particle: those of each block in its row. A lattice's order is not
    /// that of its blocks: its first row has all elements.
    fn of_particles<T: bytemuck::Pod>(&mut self, id: Id, elements: &'a [T], stride: usize) {
        let whole = elements.len() as i64;
        let blocks = self.volume.blocks.iter();
        let offsets = match self.volume.particles {
            BlockedParticles::Lattice(_) => sums(
                (0..)
                    .zip(blocks)
                    .map(|(i, _)| if i == 0 { whole } else { 0 }),
            ),
            _ => sums(blocks.map(|b| i64::from(b.count) * stride as i64)),
        };
        self.list(id, offsets, Cow::Borrowed(bytemuck::cast_slice(elements)));
    }
}
