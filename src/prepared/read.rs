//! Reads a scene from a file: reads the blocks, and maps the particles. Refuses parts that do not fit together, but
//! does not check the particles' numbers.

use std::path::Path;
use std::sync::Arc;

use bytemuck::Pod;
use glam::{DVec3, Vec3};

use super::about::{About, BatchHead, Grid, Head, Particles, VERSION, Volume};
use super::columns::Id;
use super::file::{self, BatchPlaces, fault};
use crate::blocks::{
    Block, BlockedParticles, BlockedScene, BlockedVolume, BrickGrid, KeptOfVolume, MergeBounds,
    Merged, NO_PARENT,
};
use crate::constants::BLOCK_CAPACITY;
use crate::error::{Error, Result};
use crate::math::MAX_HARMONICS_DEGREE;
use crate::scene::columns::{Columns as _, Visitor};
use crate::scene::headers::{ColourHeader, StrengthHeader, ValuesHeader};
use crate::scene::{BoundaryPlanesIn, Column, LocalModelsIn, Shared, SharedBytes, ValuesIn, map};

/// Maps a file.
pub(super) fn open(path: &Path) -> Result<(BlockedScene, About)> {
    let bytes = map::map(path).map_err(|e| {
        let advice = "check the path and its permissions";
        Error::io(path, "opening", e, advice)
    })?;
    of_bytes(path, bytes)
}

/// Reads a scene from a file's bytes.
pub(super) fn of_bytes(path: &Path, bytes: SharedBytes) -> Result<(BlockedScene, About)> {
    let places = file::read(path, (*bytes).as_ref())?;
    let head: Version = match serde_json::from_str(&places.about) {
        Ok(head) => head,
        Err(e) => return fault(path, "ewa_splat", "what is said of a scene", e.to_string()),
    };
    if head.version != VERSION {
        let expected = format!("version {VERSION}");
        return fault(path, "ewa_splat", &expected, head.version.to_string());
    }
    let head: Head = match serde_json::from_str(&places.about) {
        Ok(head) => head,
        Err(e) => return fault(path, "ewa_splat", "what is said of a scene", e.to_string()),
    };
    let count: usize = head.volumes.iter().map(|v| v.batches.len()).sum();
    if count != places.batches.len() || head.volumes.iter().any(|v| v.batches.is_empty()) {
        let found = places.batches.len().to_string();
        return fault(
            path,
            "batches",
            &format!("{count} of them, one per volume at least"),
            found,
        );
    }
    let mut batches = places.batches.iter().enumerate();
    let mut families = Vec::new();
    let mut kept = Vec::new();
    for volume in &head.volumes {
        let mut reading = Reading::of(path, &bytes, volume)?;
        let family = volume.batches.iter().zip(&mut batches);
        let family = family.enumerate().map(|(level, (head, (number, places)))| {
            let volume = reading.volume(head, places, level > 0);
            volume.or_else(|wrong| {
                let place = format!("batch {number}: {}", wrong.place);
                fault(path, &place, wrong.expected, wrong.found)
            })
        });
        let family = family.collect::<Result<Vec<_>>>()?;
        let merged: usize = family[1..].iter().map(|level| level.blocks.len()).sum();
        let mut parents = family
            .iter()
            .flat_map(|v| &v.blocks)
            .map(|b| b.parent as usize);
        if let Some(parent) = parents.find(|&p| p != NO_PARENT as usize && p >= merged) {
            let expected = format!("one of {merged} merged blocks");
            return fault(path, "parent", &expected, parent.to_string());
        }
        families.push(family);
        kept.push(KeptOfVolume {
            visible: reading.visible,
            densities: reading.densities,
            amplitudes: volume.amplitudes.into(),
            transfer_function: reading.transfer_function,
        });
    }
    let scene = BlockedScene::of_families(families, kept)?;
    Ok((scene, head.about))
}

/// The version alone, which can be read whatever else a version stores.
#[derive(serde::Deserialize)]
struct Version {
    version: u32,
}

/// Description of a fault.
struct Wrong {
    place: &'static str,
    expected: &'static str,
    found: String,
}

type Checked<T> = std::result::Result<T, Wrong>;

fn wrong<T>(place: &'static str, expected: &'static str, found: impl Into<String>) -> Checked<T> {
    let found = found.into();
    Err(Wrong {
        place,
        expected,
        found,
    })
}

/// State of reading a volume, batch after batch.
struct Reading<'a> {
    bytes: &'a SharedBytes,
    lattice: Option<&'a Grid>,
    /// Grid of the volume itself.
    grid: Option<BrickGrid>,
    transfer_function: Option<crate::scene::TransferFunction>,
    visible: Vec<Option<(DVec3, DVec3)>>,
    /// Densities of the blocks of each batch.
    densities: Vec<Vec<f64>>,
}

impl<'a> Reading<'a> {
    fn of(path: &Path, bytes: &'a SharedBytes, volume: &'a Volume) -> Result<Self> {
        let function = volume.transfer_function.as_ref();
        let transfer_function = match function.map(|function| function.transfer()) {
            Some(None) => {
                let (expected, found) = ("4096 finite entries over a range", "others");
                return fault(path, "transfer function", expected, found);
            }
            other => other.flatten(),
        };
        Ok(Self {
            bytes,
            lattice: volume.lattice.as_ref(),
            grid: None,
            transfer_function,
            visible: Vec::new(),
            densities: Vec::new(),
        })
    }

    /// Reads a volume or, if `is_merged`, a level of detail.
    fn volume(
        &mut self,
        head: &BatchHead,
        places: &BatchPlaces,
        is_merged: bool,
    ) -> Checked<BlockedVolume> {
        let of = Columns {
            bytes: self.bytes,
            places,
        };
        let mut blocks = of.blocks()?;
        self.densities
            .push(of.column::<f64>(Id::Density, places.rows)?.to_vec());
        let strengths = of.whole::<f32>(Id::Strength)?;
        if head.values == Some(ValuesHeader::F64) {
            return wrong("values", "single precision at most", "f64");
        }
        let mut values = head.values.map(ValuesHeader::empty);
        let count = None;
        values.visit(&mut Filling { of: &of, count })?;
        let particles = match head.particles {
            Particles::Lattice { cube } => {
                let stored = values.as_ref().map_or(strengths.len(), ValuesIn::len);
                let grid = self.grid(cube, stored, is_merged)?;
                check_bricks(&grid, &mut blocks)?;
                BlockedParticles::Lattice(Box::new(grid))
            }
            _ => of.points(head.particles, &blocks)?,
        };
        let is_lattice = matches!(particles, BlockedParticles::Lattice(_));
        let is_flat = matches!(particles, BlockedParticles::Surfels { .. });
        let count = match &particles {
            BlockedParticles::Lattice(grid) => grid.len(),
            BlockedParticles::Isotropic { offsets, .. }
            | BlockedParticles::Anisotropic { offsets, .. }
            | BlockedParticles::Surfels { offsets, .. } => offsets.len(),
        };
        let one_each = |place, len: usize| match len == count {
            true => Ok(()),
            false => wrong(place, "one for each particle", format!("{len} for {count}")),
        };
        let follows =
            is_lattice && head.strength == StrengthHeader::Classified && strengths.is_empty();
        if !follows {
            one_each("strength", strengths.len())?;
        }
        if let Some(values) = &values {
            one_each("values", values.len())?;
        }
        let is_classified =
            head.strength == StrengthHeader::Classified || head.colour == ColourHeader::Classified;
        if is_classified && (values.is_none() || self.transfer_function.is_none()) {
            return wrong("classification", "values and a transfer function", "none");
        }
        let is_area = matches!(
            head.strength,
            StrengthHeader::Surface | StrengthHeader::Translucent
        );
        if is_area && !is_flat {
            let expected = "surfels, of which alone there are areas";
            return wrong("strength", expected, "others");
        }
        if let ColourHeader::Harmonics { degree, .. } = head.colour
            && degree > MAX_HARMONICS_DEGREE
        {
            let expected = "harmonics of degree 3 at most";
            return wrong("colour", expected, degree.to_string());
        }
        let mut colour = head.colour.empty();
        colour.visit(&mut Filling {
            of: &of,
            count: Some(count),
        })?;
        let local_models = match head.local_model_scales {
            Some(scales) if !is_lattice && !is_flat && values.is_some() => {
                let codes = of.column(Id::Model, count)?;
                Some(LocalModelsIn::of_codes(codes, scales))
            }
            Some(_) => return wrong("local models", "points with values", "others"),
            None => None,
        };
        let is_ellipsoids = matches!(particles, BlockedParticles::Anisotropic { .. });
        let boundary = match head.has_planes {
            true if is_ellipsoids => Some(BoundaryPlanesIn {
                of_particle: of.column(Id::Cut, count)?,
                edges: of.whole(Id::Planes)?,
            }),
            true => return wrong("planes", "ellipsoids, which alone they cut", "others"),
            false => None,
        };
        let optional = |is_there: bool, id| match is_there {
            true => of.column::<u32>(id, count).map(Some),
            false => Ok(None),
        };
        let normals = optional(head.has_normals, Id::Normal)?;
        let indices = optional(head.has_indices && !is_lattice, Id::Index)?;
        let merged = match is_merged {
            true => Some(of.merged(count, values.is_some())?),
            false => None,
        };
        if !is_merged {
            self.visible = of.visible()?;
        }
        Ok(BlockedVolume {
            blocks,
            particles,
            strength: head.strength.with(strengths),
            colour,
            values,
            transfer_function: self.transfer_function.clone(),
            normals,
            local_models,
            lobes: None,
            boundary,
            indices,
            merged,
        })
    }

    /// Makes the grid of a batch.
    ///
    /// - `stored`: number of stored cells, checked before memory is allocated for them.
    fn grid(&mut self, cube: usize, stored: usize, is_merged: bool) -> Checked<BrickGrid> {
        let Some(own) = self.lattice else {
            return wrong("lattice", "its dimensions", "none");
        };
        let lattice = own.lattice();
        let cells = |cube: usize| {
            let mut dims = lattice.dims.iter().map(|n| n.div_ceil(cube));
            dims.try_fold(1_usize, usize::checked_mul)
        };
        if is_merged != (cube > 1) || cube == 0 || cells(cube) != Some(stored) || stored == 0 {
            let found = format!("{stored} of them for {:?}", lattice.dims);
            return wrong("lattice", "a number for each cell", found);
        }
        if let Err(e) = lattice.validate() {
            return wrong("lattice", "a lattice that rises", e.to_string());
        }
        if is_merged {
            return match &self.grid {
                Some(grid) => Ok(grid.merged(cube)),
                None => wrong("lattice", "the lattice that is merged", "none"),
            };
        }
        let fits = |a: usize, ghosts: [usize; 3]| ghosts[a] <= 1 && lattice.dims[a] > 2 * ghosts[a];
        if own
            .ghosts
            .is_some_and(|ghosts| !(0..3).all(|a| fits(a, ghosts)))
        {
            return wrong(
                "lattice",
                "ghosts around its samples",
                format!("{:?}", own.ghosts),
            );
        }
        if !(own.kernel_width > 0.0 && own.kernel_width.is_finite()) {
            return wrong(
                "lattice",
                "a positive kernel width",
                own.kernel_width.to_string(),
            );
        }
        let grid = BrickGrid::of_wide(lattice, own.kernel_width, own.ghosts);
        self.grid = Some(grid.clone());
        Ok(grid)
    }
}

/// Checks that bricks are in the order of their numbers, each with its cells.
fn check_bricks(grid: &BrickGrid, blocks: &mut [Block]) -> Checked<()> {
    if blocks.len() != grid.bricks().iter().product::<usize>() {
        return wrong("rows", "one for each brick", blocks.len().to_string());
    }
    for (number, block) in (0..).zip(blocks) {
        let cells = grid.cells(number).map(|[first, end]| end - first);
        if block.first != number || block.count as usize != cells.iter().product::<usize>() {
            let found = format!("brick {} with {} cells", block.first, block.count);
            return wrong("first", "bricks in their order", found);
        }
    }
    Ok(())
}

/// Columns of a batch.
struct Columns<'a> {
    bytes: &'a SharedBytes,
    places: &'a BatchPlaces,
}

impl Columns<'_> {
    /// Returns all of a column; empty if there is none.
    fn whole<T: Pod>(&self, id: Id) -> Checked<Column<T>> {
        let Some(place) = self.places.columns.get(&id) else {
            return Ok(Column::default());
        };
        match Column::of_part(Arc::clone(self.bytes), place.part.clone()) {
            Some(column) => Ok(column),
            None => wrong(id.column().name, "buffers at multiples of 8", "others"),
        }
    }

    /// Returns a column of `count` elements.
    fn column<T: Pod>(&self, id: Id, count: usize) -> Checked<Column<T>> {
        let column = self.whole(id)?;
        if column.len() == count {
            return Ok(column);
        }
        let found = format!("{} for {count}", column.len());
        wrong(id.column().name, "one for each", found)
    }

    fn blocks(&self) -> Checked<Vec<Block>> {
        let rows = self.places.rows;
        let numbers = |id| self.column::<f32>(id, rows);
        let words = |id| self.column::<u32>(id, rows);
        let pairs = |id| self.column::<[f32; 2]>(id, rows);
        let (level, first, count) = (words(Id::Level)?, words(Id::First)?, words(Id::Count)?);
        let (parent, crowding) = (words(Id::Parent)?, numbers(Id::Crowding)?);
        let origin = self.column::<[f64; 3]>(Id::Origin, rows)?;
        let half_extent = self.column::<[f32; 3]>(Id::HalfExtent, rows)?;
        let (max_sigma, min_sigma) = (numbers(Id::MaxSigma)?, numbers(Id::MinSigma)?);
        let max_strength = numbers(Id::MaxStrength)?;
        let (value_range, values_around) = (pairs(Id::ValueRange)?, pairs(Id::ValuesAround)?);
        let greatest_spread = numbers(Id::GreatestSpread)?;
        let block = |i: usize| Block {
            origin: DVec3::from(origin[i]),
            half_extent: Vec3::from(half_extent[i]),
            max_sigma: max_sigma[i],
            min_sigma: min_sigma[i],
            max_strength: max_strength[i],
            first: first[i],
            count: count[i],
            value_range: value_range[i],
            values_around: values_around[i],
            greatest_spread: greatest_spread[i],
            parent: parent[i],
            level: level[i],
            crowding: crowding[i],
        };
        Ok((0..rows).map(block).collect())
    }

    /// Reads points, whose blocks must be contiguous runs.
    fn points(&self, kind: Particles, blocks: &[Block]) -> Checked<BlockedParticles> {
        let mut end = 0_u32;
        for block in blocks {
            let is_run =
                block.first == end && (1..=BLOCK_CAPACITY).contains(&(block.count as usize));
            let next = end.checked_add(block.count).filter(|_| is_run);
            let Some(next) = next else {
                let found = format!("{} from {} on after {end}", block.count, block.first);
                return wrong(
                    "first",
                    "runs of at most 256 particles, one after the other",
                    found,
                );
            };
            end = next;
        }
        let count = end as usize;
        let offsets = self.column(Id::Offset, count)?;
        Ok(match kind {
            Particles::Isotropic => BlockedParticles::Isotropic {
                offsets,
                sigmas: self.column(Id::Sigma, count)?,
            },
            Particles::Surfels { is_one_sided } => BlockedParticles::Surfels {
                offsets,
                tangents: self.column(Id::Tangents, count)?,
                is_one_sided,
            },
            Particles::Anisotropic | Particles::Lattice { .. } => BlockedParticles::Anisotropic {
                offsets,
                factors: self.column(Id::Factor, count)?,
            },
        })
    }

    fn merged(&self, count: usize, has_values: bool) -> Checked<Merged> {
        let bounds = self.column::<MergeBounds>(Id::Bounds, self.places.rows)?;
        let spreads = self.column(Id::Spread, if has_values { count } else { 0 })?;
        let member_depths: Column<f32> = self.whole(Id::MemberDepth)?;
        if !member_depths.is_empty() && member_depths.len() != count {
            return wrong("member_depth", "one for each particle, or none", "others");
        }
        Ok(Merged {
            bounds: bounds.to_vec(),
            spreads,
            transfer: None,
            member_depths,
        })
    }

    /// Returns the box of the visible part of each block.
    fn visible(&self) -> Checked<Vec<Option<(DVec3, DVec3)>>> {
        let boxes: Column<[f64; 6]> = self.whole(Id::Visible)?;
        let rows = self.places.rows;
        if boxes.is_empty() {
            return Ok(vec![None; rows]);
        }
        let offsets = self
            .places
            .columns
            .get(&Id::Visible)
            .map(|place| place.offsets.clone());
        let offsets = offsets.and_then(|part| Column::<i64>::of_part(Arc::clone(self.bytes), part));
        let Some(offsets) = offsets.filter(|offsets| offsets.len() == rows + 1) else {
            return wrong("visible", "offsets of its lists", "others");
        };
        let of_row = |row: &[i64]| match row[1].checked_sub(row[0]) {
            Some(0) => Ok(None),
            Some(1) => {
                let own = usize::try_from(row[0]).ok().and_then(|i| boxes.get(i));
                let Some([a, b, c, x, y, z]) = own.copied() else {
                    return wrong("visible", "offsets within its boxes", row[0].to_string());
                };
                Ok(Some((DVec3::new(a, b, c), DVec3::new(x, y, z))))
            }
            _ => wrong("visible", "one box or none for each block", "others"),
        };
        offsets.windows(2).map(of_row).collect()
    }
}

/// Fills columns with those of a batch.
struct Filling<'a> {
    of: &'a Columns<'a>,
    /// Number of particles, if it is checked.
    count: Option<usize>,
}

impl Visitor<Shared> for Filling<'_> {
    type Error = Wrong;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        name: &'static str,
        width: usize,
        column: &mut Column<T>,
    ) -> Checked<()> {
        if let Some(id) = Id::named(name) {
            *column = match self.count {
                Some(count) => self.of.column(id, count.saturating_mul(width))?,
                None => self.of.whole(id)?,
            };
        }
        Ok(())
    }
}
