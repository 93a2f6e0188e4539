//! Prepares a scene for rendering: its volumes in blocks, each followed by its levels of detail.

use std::ops::Range;
#[cfg(feature = "prepared")]
use std::path::Path;
use std::sync::OnceLock;

use super::build::{Exchangeable, build, check_count};
use super::density::densities;
use super::options::{BuildOptions, SceneOptions};
use super::partitioned::SharedVolume;
#[cfg(feature = "prepared")]
use super::stream::{ParticleStream, build_stream};
use crate::blocks::amplitude::AmplitudeSummary;
use crate::blocks::transfer::set_transfer_function;
use crate::blocks::volume::BlockedVolume;
use crate::error::{Error, Result};
use crate::scene::{ColourIn, PointVolume, Requirements, StrengthIn, TransferFunction, Values};
use crate::task::Task;
use crate::view::Bounds;

/// The volumes of a scene in blocks.
#[derive(Debug, Clone, Default)]
pub struct BlockedScene {
    /// Volumes and their levels of detail.
    volumes: Vec<BlockedVolume>,
    /// Range of each volume of the scene in `volumes`: itself, then its levels.
    families: Vec<Range<usize>>,
    requirements: Vec<Requirements>,
    /// Whether coarser lattices may stand for the volumes' own.
    has_coarser: bool,
    /// Transfer function of the volume whose particles carry their values in place of colours.
    carried: Option<TransferFunction>,
    /// Densities of each volume's blocks, once a frame needs them.
    densities: OnceLock<Vec<Vec<f64>>>,
    /// Exchangeable form of each volume, if values can be exchanged.
    exchangeable: Vec<Exchangeable>,
    /// Data of each volume that are known without reading its particles.
    known: Vec<Known>,
}

/// Data that follow from a volume's particles, and are known beforehand if the particles are stored in a file.
#[derive(Debug, Clone, Default)]
struct Known {
    /// Boxes around the visible part, under the transfer function that is shown.
    visible: Option<Vec<Bounds>>,
    /// Boxes around the visible part for a fitted camera, if the particles are not here.
    fitted: Option<Vec<Bounds>>,
    amplitudes: Option<AmplitudeSummary>,
}

/// Data that a file stores of a volume besides its particles.
#[cfg(feature = "prepared")]
#[derive(Debug)]
pub(crate) struct KeptOfVolume {
    /// Box of the visible part of each block.
    pub(crate) visible: Vec<Option<Bounds>>,
    /// Densities of the volume's blocks, and of each level of detail.
    pub(crate) densities: Vec<Vec<f64>>,
    pub(crate) amplitudes: AmplitudeSummary,
    /// Transfer function that is shown.
    pub(crate) transfer_function: Option<TransferFunction>,
}

impl BlockedScene {
    /// Sorts the volumes' particles into blocks.
    ///
    /// # Errors
    /// More particles than 32-bit indices can number; a classified volume without values or without a transfer
    /// function; cancelled work.
    pub fn new(scene: Vec<PointVolume>, options: &SceneOptions) -> Result<Self> {
        for volume in &scene {
            volume.validate()?;
        }
        check_count(scene.iter().map(|v| v.particles.len()).sum())?;
        let requirements = scene.iter().map(Requirements::of).collect();
        let mut volumes = Vec::new();
        let mut families = Vec::new();
        let mut exchangeable = Vec::new();
        let build_options = BuildOptions {
            detail: options.level_of_detail,
            indices: options.keep_indices,
        };
        let task = options.task.as_ref();
        for volume in scene {
            let first = volumes.len();
            if options.keep_shapes {
                let kept = Exchangeable::new(&volume, build_options, task)?;
                volumes.extend(kept.with_values(volume.values, task)?);
                exchangeable.push(kept);
            } else {
                volumes.extend(build(volume, build_options, task)?);
            }
            families.push(first..volumes.len());
        }
        Ok(Self {
            known: vec![Known::default(); families.len()],
            volumes,
            families,
            requirements,
            has_coarser: options.level_of_detail,
            exchangeable,
            ..Self::default()
        })
    }

    /// Builds a scene of points that arrive a part at a time: one volume, the same as of all points at once.
    ///
    /// - `folder`: folder for temporary files, some 80 bytes for each point.
    ///
    /// # Errors
    /// The errors of [`build_stream`]; the option to keep shapes.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_stream(
        stream: &mut dyn ParticleStream,
        options: &SceneOptions,
        folder: &Path,
    ) -> Result<Self> {
        if options.keep_shapes {
            let (expected, advice) = ("all of them at once", "leave it out");
            return Err(Error::invalid(
                "scene",
                "SceneOptions::keep_shapes",
                expected,
                "a stream of particles",
                advice,
            ));
        }
        let build_options = BuildOptions {
            detail: options.level_of_detail,
            indices: options.keep_indices,
        };
        let volumes = build_stream(stream, build_options, folder, options.task.as_ref())?;
        let requirements = volumes.first().map(BlockedVolume::requirements);
        Ok(Self {
            families: std::iter::once(0..volumes.len()).collect(),
            known: vec![Known::default()],
            volumes,
            requirements: requirements.into_iter().collect(),
            ..Self::default()
        })
    }

    /// Joins the volumes of which this rank holds a share. Also returns, for each of [`Self::volumes`], the blocks
    /// whose particles are here.
    pub(crate) fn of_shares(shares: Vec<SharedVolume>) -> (Self, Vec<Vec<Range<u32>>>) {
        let mut scene = Self::default();
        let (mut own, mut densities) = (Vec::new(), Vec::new());
        for share in shares {
            let first = scene.volumes.len();
            scene.volumes.extend(share.family);
            scene.families.push(first..scene.volumes.len());
            scene.requirements.push(share.requirements);
            scene.known.push(Known {
                visible: Some(share.visible),
                fitted: Some(share.fitted),
                amplitudes: None,
            });
            own.extend(share.own);
            densities.extend(share.densities);
        }
        scene.densities = densities.into();
        (scene, own)
    }

    /// Keeps the particles of some blocks of each volume, in the order of [`Self::volumes`], and drops the rest.
    ///
    /// # Errors
    /// None that is known: the particles are kept in memory.
    pub(crate) fn keep(&mut self, own: &[Vec<Range<u32>>]) -> Result<()> {
        // Densities need all particles: find them first.
        self.densities();
        for (volume, own) in self.volumes.iter_mut().zip(own) {
            volume.keep(own)?;
        }
        self.exchangeable.clear();
        Ok(())
    }

    /// Joins volumes that are in blocks already, each followed by its levels of detail, with the data stored for each.
    ///
    /// # Errors
    /// More particles than 32-bit indices can number.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_families(
        mut families: Vec<Vec<BlockedVolume>>,
        kept: Vec<KeptOfVolume>,
    ) -> Result<Self> {
        let mut scene = Self::default();
        let mut densities = Vec::new();
        for (family, kept) in families.iter_mut().zip(kept) {
            if let Some(transfer) = &kept.transfer_function {
                set_transfer_function(family, transfer, None);
            }
            let first = scene.volumes.len();
            scene
                .requirements
                .extend(family.first().map(BlockedVolume::requirements));
            scene.volumes.append(family);
            scene.families.push(first..scene.volumes.len());
            scene.known.push(Known {
                visible: Some(kept.visible.into_iter().flatten().collect()),
                fitted: None,
                amplitudes: Some(kept.amplitudes),
            });
            densities.extend(kept.densities);
        }
        check_count(scene.particle_count())?;
        scene.densities = densities.into();
        scene.has_coarser = scene.volumes.len() > scene.families.len();
        Ok(scene)
    }

    /// Joins several scenes into one, in their order.
    ///
    /// # Errors
    /// More particles than 32-bit indices can number.
    #[cfg(feature = "prepared")]
    pub(crate) fn joined(scenes: impl IntoIterator<Item = Self>) -> Result<Self> {
        let mut scenes = scenes.into_iter();
        let Some(mut all) = scenes.next() else {
            return Self::new(Vec::new(), &SceneOptions::default());
        };
        for scene in scenes {
            let first = all.volumes.len();
            let densities = all.densities.take().zip(scene.densities.into_inner());
            all.densities = match densities {
                Some((mut own, more)) => {
                    own.extend(more);
                    own.into()
                }
                None => OnceLock::new(),
            };
            let later = scene.families.into_iter();
            all.families
                .extend(later.map(|f| f.start + first..f.end + first));
            all.volumes.extend(scene.volumes);
            all.requirements.extend(scene.requirements);
            all.has_coarser |= scene.has_coarser;
            all.known.extend(scene.known);
            // All volumes are exchangeable, or none.
            all.exchangeable.clear();
        }
        check_count(all.particle_count())?;
        Ok(all)
    }

    /// Returns the scene with each lattice replaced by one of half as many samples along each axis; `None` if it has no
    /// lattice that has a coarser one.
    ///
    /// - `least`: least number of samples of a lattice that has a coarser one.
    ///
    /// # Errors
    /// The task is cancelled.
    pub(crate) fn coarser(&self, least: usize, task: Option<&Task>) -> Result<Option<Self>> {
        // Coarser lattices are the levels of detail.
        let options = BuildOptions::default();
        let (mut volumes, mut families) = (Vec::new(), Vec::new());
        let mut is_coarser = false;
        for range in &self.families {
            let family = &self.volumes[range.clone()];
            let first = volumes.len();
            match family[0].coarser(least, task)? {
                Some(volume) => {
                    is_coarser = true;
                    volumes.extend(build(volume, options, task)?);
                }
                None => volumes.extend_from_slice(family),
            }
            families.push(first..volumes.len());
        }
        Ok(is_coarser.then(|| Self {
            known: vec![Known::default(); families.len()],
            volumes,
            families,
            requirements: self.requirements.clone(),
            ..Self::default()
        }))
    }

    /// Volumes and their levels of detail.
    pub fn volumes(&self) -> &[BlockedVolume] {
        &self.volumes
    }

    /// Range of each volume of the scene in [`Self::volumes`]: itself, then its levels.
    pub fn families(&self) -> &[Range<usize>] {
        &self.families
    }

    /// Returns a volume of the scene, followed by its levels of detail.
    pub fn family(&self, volume: usize) -> &[BlockedVolume] {
        &self.volumes[self.families[volume].clone()]
    }

    /// The volumes themselves, without their levels of detail.
    pub fn data(&self) -> impl Iterator<Item = &BlockedVolume> {
        self.families
            .iter()
            .map(|family| &self.volumes[family.start])
    }

    /// Features that a frame needs to draw each volume of the scene.
    pub fn requirements(&self) -> &[Requirements] {
        &self.requirements
    }

    /// Number of blocks of all volumes and of their levels of detail.
    pub fn block_count(&self) -> usize {
        self.volumes.iter().map(|v| v.blocks.len()).sum()
    }

    /// Densities of each volume's blocks; found once. They do not depend on transfer functions.
    pub(crate) fn densities(&self) -> &[Vec<f64>] {
        self.densities
            .get_or_init(|| self.volumes.iter().map(densities).collect())
    }

    /// Number of particles in all volumes.
    pub fn particle_count(&self) -> usize {
        self.data().map(BlockedVolume::particle_count).sum()
    }

    /// Bytes kept per particle, blocks and levels of detail included, over all volumes.
    pub fn bytes_per_particle(&self) -> f64 {
        let bytes: usize = self.volumes.iter().map(BlockedVolume::bytes).sum();
        bytes as f64 / self.particle_count().max(1) as f64
    }

    /// Whether the scene was made with levels of detail, so that coarser lattices may stand for its own.
    pub(crate) fn has_coarser(&self) -> bool {
        self.has_coarser
    }

    /// Whether any volume consists of splats, which state their opacity.
    pub fn has_splats(&self) -> bool {
        self.volumes.iter().any(BlockedVolume::is_of_splats)
    }

    /// Returns the middles and half extents of the boxes around the visible part, world units.
    pub fn visible_boxes(&self) -> Vec<Bounds> {
        let of_volume = |(i, known): (usize, &Known)| match &known.visible {
            Some(boxes) => boxes.clone(),
            None => self.visible_box_of_each(i).into_iter().flatten().collect(),
        };
        self.known.iter().enumerate().flat_map(of_volume).collect()
    }

    /// Returns the boxes for a fitted camera, without splats far from the region with 99.5 % of opacity times area of a
    /// set of splats.
    pub fn fitted_boxes(&self) -> Vec<Bounds> {
        let of_volume = |(i, known): (usize, &Known)| {
            let own = &self.family(i)[0];
            match (&known.fitted, own.is_of_splats(), &known.visible) {
                (Some(boxes), true, _) | (_, false, Some(boxes)) => boxes.clone(),
                (None, true, _) => own.fitted_boxes(),
                (_, false, None) => self.visible_box_of_each(i).into_iter().flatten().collect(),
            }
        };
        self.known.iter().enumerate().flat_map(of_volume).collect()
    }

    /// Returns the box of the visible part of each block of a volume.
    pub(crate) fn visible_box_of_each(&self, volume: usize) -> Vec<Option<Bounds>> {
        self.family(volume)[0].visible_box_of_each(self.shown_function(volume))
    }

    /// Returns the transfer function by which a volume is shown. If its particles carry their values, it is the one
    /// that classifies slabs.
    pub(crate) fn shown_function(&self, volume: usize) -> Option<&TransferFunction> {
        let own = &self.family(volume)[0];
        match &self.carried {
            Some(transfer) if !own.is_surface() => Some(transfer),
            _ => own.transfer_function.as_ref(),
        }
    }

    /// Returns the amplitudes of a volume, which column densities sum, if they are known without reading its particles.
    pub(crate) fn known_amplitudes(&self, volume: usize) -> Option<AmplitudeSummary> {
        self.known[volume].amplitudes
    }

    /// Summarises the amplitudes of each volume, which column densities sum.
    pub(crate) fn amplitudes_of_volumes(&self) -> Vec<AmplitudeSummary> {
        let of_volume = |(known, volume): (&Known, &BlockedVolume)| match known.amplitudes {
            Some(amplitudes) => amplitudes,
            None => AmplitudeSummary::of(std::iter::once(volume)),
        };
        self.known.iter().zip(self.data()).map(of_volume).collect()
    }

    /// Returns the middles and half extents of the boxes around all particles, grown by one standard deviation; world
    /// units.
    pub fn boxes(&self) -> Vec<Bounds> {
        self.data().flat_map(BlockedVolume::boxes).collect()
    }

    /// Replaces the transfer function of a volume; its particles do not change.
    ///
    /// # Errors
    /// No such volume, or one that is not classified.
    pub fn set_transfer_function(
        &mut self,
        volume: usize,
        transfer: TransferFunction,
    ) -> Result<()> {
        let count = self.families.len();
        let classified = self.requirements.get(volume).map(|r| r.classification);
        if classified != Some(true) {
            return Err(Error::invalid(
                "scene",
                format!("volume {volume}"),
                format!("a classified volume, one of {count}"),
                if classified.is_some() {
                    "one with masses and colours of its own"
                } else {
                    "none"
                },
                "give the number of a volume whose masses or colours come from values",
            ));
        }
        self.known[volume].visible = None;
        let family = &mut self.volumes[self.families[volume].clone()];
        if self.carried.is_some() && !family[0].is_surface() {
            set_transfer_function(family, &transfer.carrier(), Some(&transfer));
            self.carried = Some(transfer);
        } else {
            set_transfer_function(family, &transfer, None);
        }
        Ok(())
    }

    /// Exchanges the values of a volume; positions, shapes and the transfer function stay.
    ///
    /// # Errors
    /// No such volume, or one without values; a number of values that differs from that of the particles; a scene that
    /// did not keep its shapes ([`SceneOptions::keep_shapes`]).
    pub fn set_values(&mut self, volume: usize, values: Values) -> Result<()> {
        let refuse = |place: &str, expected: &str, found: String, advice: &str| {
            Err(Error::invalid("scene", place, expected, found, advice))
        };
        let place = format!("values of volume {volume}");
        let Some(kept) = self.exchangeable.get(volume) else {
            if volume < self.families.len() {
                let expected = "a scene that keeps its shapes";
                let advice = "make the scene with SceneOptions { keep_shapes: true, .. }";
                return refuse(&place, expected, "one that does not".into(), advice);
            }
            let expected = format!("one of {} volumes", self.families.len());
            return refuse(
                &place,
                &expected,
                "none".into(),
                "give the number of a volume",
            );
        };
        let family = self.families[volume].clone();
        if self.volumes[family.start].values.is_none() {
            let advice = "exchange values of volumes that have them";
            return refuse(&place, "a volume with values", "one without".into(), advice);
        }
        if values.len() != kept.len() {
            let expected = format!("{} values, one per particle", kept.len());
            let found = values.len().to_string();
            return refuse(&place, &expected, found, "give as many");
        }
        let mut built = kept.with_values(Some(values), None)?;
        if let Some(transfer) = self.volumes[family.start].transfer_function.clone() {
            let shown = self.carried.as_ref().filter(|_| !built[0].is_surface());
            set_transfer_function(&mut built, &transfer, shown);
        }
        let (before, after) = (family.len(), built.len());
        self.volumes.splice(family.clone(), built);
        self.families[volume] = family.start..family.start + after;
        for later in &mut self.families[volume + 1..] {
            *later = later.start - before + after..later.end - before + after;
        }
        self.densities = OnceLock::new();
        self.known[volume] = Known::default();
        Ok(())
    }

    /// Transfer function that classifies slabs, if particles carry values.
    pub fn carried(&self) -> Option<&TransferFunction> {
        self.carried.as_ref()
    }

    /// Makes the particles of the one volume with a field carry their values, or their colours again. Returns the
    /// volume whose tables changed, if any did.
    ///
    /// # Errors
    /// No volume with a field, or other volumes beside it.
    pub fn carry_values(&mut self, values: bool) -> Result<Option<usize>> {
        if values == self.carried.is_some() {
            return Ok(None);
        }
        let refuse = |found: &str| {
            Err(Error::invalid(
                "settings",
                "classification of slabs",
                "slabs and one volume with a field",
                found,
                "leave it out",
            ))
        };
        let is_field = |v: &BlockedVolume| {
            matches!(v.strength, StrengthIn::Classified { .. }) && v.colour == ColourIn::Classified
        };
        let mut volumes = (0..self.families.len())
            .filter(|&i| !self.volumes[self.families[i].start].is_surface());
        let (Some(volume), None) = (volumes.next(), volumes.next()) else {
            return refuse("none or several");
        };
        let own = &self.volumes[self.families[volume].start];
        let Some(transfer) = own.transfer_function.clone().filter(|_| is_field(own)) else {
            return refuse("masses or colours of its own");
        };
        let own = match self.carried.take() {
            Some(carried) => carried,
            None => {
                self.carried = Some(transfer.clone());
                transfer
            }
        };
        // The visible part stays the same.
        let visible = self.known[volume].visible.take();
        self.set_transfer_function(volume, own)?;
        self.known[volume].visible = visible;
        Ok(Some(volume))
    }
}
