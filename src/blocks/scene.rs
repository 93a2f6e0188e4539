//! A scene made ready: its volumes in blocks, each with its levels of detail after it.

use std::ops::Range;
#[cfg(feature = "prepared")]
use std::path::Path;
use std::sync::OnceLock;

use super::build::{BuildOptions, Exchangeable, build, check_count};
use super::density::densities;
use super::peers::SharedVolume;
#[cfg(feature = "prepared")]
use super::stream::{ParticleStream, build_stream};
use super::{AmplitudeSummary, BlockedVolume, set_transfer_function};
use crate::error::{Error, Result};
use crate::scene::{ColourIn, PointVolume, Requirements, StrengthIn, TransferFunction, Values};
use crate::task::Task;
use crate::view::Bounds;

/// How a scene is made ready.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneOptions {
    /// Whether levels of detail are made, by which [`Settings::level_of_detail`](crate::Settings::level_of_detail) draws
    /// what lies far below a pixel. Column densities, slabs, and filters that are asked for never use them; making them
    /// takes most of the time that a scene takes.
    pub level_of_detail: bool,
    /// Whether all is kept that does not depend on values, so that these can be exchanged while places and
    /// shapes stay (the next time step): once more the memory of the data.
    pub keep_shapes: bool,
    /// Whether it is kept which of the caller's particles each is: 4 bytes per particle.
    pub keep_indices: bool,
    /// Is told how far the work is, and may cancel it.
    pub task: Option<Task>,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            level_of_detail: true,
            keep_shapes: false,
            keep_indices: false,
            task: None,
        }
    }
}

/// The volumes of a scene in blocks.
#[derive(Debug, Clone)]
pub struct BlockedScene {
    /// Volumes and their levels of detail.
    volumes: Vec<BlockedVolume>,
    /// Each volume of the scene among `volumes`: itself, and its levels after it.
    families: Vec<Range<usize>>,
    requirements: Vec<Requirements>,
    /// Of the volume whose particles carry their values in place of colours: its transfer function.
    carried: Option<TransferFunction>,
    /// Of each volume its blocks' densities, once a frame asks for them.
    densities: OnceLock<Vec<Vec<f64>>>,
    /// Of each volume, where values can be exchanged.
    exchangeable: Vec<Exchangeable>,
    /// Of each volume what is known without a look at its particles.
    known: Vec<Known>,
}

/// What of a volume follows from its particles, and is known beforehand where they lie in a file.
#[derive(Debug, Clone, Default)]
struct Known {
    /// Boxes of what is visible, under the transfer function that is shown.
    visible: Option<Vec<Bounds>>,
    /// The same for a camera that is fitted, where the particles are not here.
    fitted: Option<Vec<Bounds>>,
    amplitudes: Option<AmplitudeSummary>,
}

/// What a file keeps of a volume besides its particles.
#[cfg(feature = "prepared")]
#[derive(Debug)]
pub(crate) struct KeptOfVolume {
    /// Of each block the box of what is visible.
    pub(crate) visible: Vec<Option<Bounds>>,
    /// Of the blocks of the volume, and of each level of detail.
    pub(crate) densities: Vec<Vec<f64>>,
    pub(crate) amplitudes: AmplitudeSummary,
    /// The function that is shown.
    pub(crate) transfer_function: Option<TransferFunction>,
}

impl BlockedScene {
    /// Sorts the volumes' particles into blocks.
    ///
    /// # Errors
    /// More particles than a 32-bit index can name, or a volume that says it is classified and
    /// has no values or no transfer function; work that was cancelled.
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
            carried: None,
            densities: OnceLock::new(),
            exchangeable,
        })
    }

    /// Of points that come a part at a time: a volume of them, the same as of all at once.
    ///
    /// - `folder`: where temporary files may lie, some 80 bytes for each.
    ///
    /// # Errors
    /// As [`build_stream`]; shapes that are to be kept.
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
            carried: None,
            densities: OnceLock::new(),
            exchangeable: Vec::new(),
        })
    }

    /// Volumes of which others have particles too, and of each of [`Self::volumes`] the blocks whose particles are here.
    pub(crate) fn of_shares(shares: Vec<SharedVolume>) -> (Self, Vec<Vec<Range<u32>>>) {
        let mut scene = Self {
            volumes: Vec::new(),
            families: Vec::new(),
            requirements: Vec::new(),
            carried: None,
            densities: OnceLock::new(),
            exchangeable: Vec::new(),
            known: Vec::new(),
        };
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

    /// Leaves out the particles of all blocks but some of each volume, in the order of [`Self::volumes`].
    ///
    /// # Errors
    /// None that is known: what is kept lies in memory.
    pub(crate) fn keep(&mut self, own: &[Vec<Range<u32>>]) -> Result<()> {
        // They are found of all particles.
        self.densities();
        for (volume, own) in self.volumes.iter_mut().zip(own) {
            volume.keep(own)?;
        }
        self.exchangeable.clear();
        Ok(())
    }

    /// Volumes that are in blocks already, each with its levels of detail after it, and what is known of each.
    ///
    /// # Errors
    /// More particles than a 32-bit index can name.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_families(
        mut families: Vec<Vec<BlockedVolume>>,
        kept: Vec<KeptOfVolume>,
    ) -> Result<Self> {
        let mut scene = Self {
            volumes: Vec::new(),
            families: Vec::new(),
            requirements: Vec::new(),
            carried: None,
            densities: OnceLock::new(),
            exchangeable: Vec::new(),
            known: Vec::new(),
        };
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
        Ok(scene)
    }

    /// Several scenes as one, in their order.
    ///
    /// # Errors
    /// More particles than a 32-bit index can name.
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
            all.known.extend(scene.known);
            // Of all volumes or of none.
            all.exchangeable.clear();
        }
        check_count(all.particle_count())?;
        Ok(all)
    }

    /// Volumes and their levels of detail.
    pub fn volumes(&self) -> &[BlockedVolume] {
        &self.volumes
    }

    /// Where each volume of the scene stands among [`Self::volumes`]: itself, and its levels after it.
    pub fn families(&self) -> &[Range<usize>] {
        &self.families
    }

    /// A volume of the scene, and its levels of detail after it.
    pub fn family(&self, volume: usize) -> &[BlockedVolume] {
        &self.volumes[self.families[volume].clone()]
    }

    /// The volumes themselves, without their levels of detail.
    pub fn data(&self) -> impl Iterator<Item = &BlockedVolume> {
        self.families
            .iter()
            .map(|family| &self.volumes[family.start])
    }

    /// What each volume of the scene requires.
    pub fn requirements(&self) -> &[Requirements] {
        &self.requirements
    }

    /// Blocks of all volumes and of their levels of detail.
    pub fn block_count(&self) -> usize {
        self.volumes.iter().map(|v| v.blocks.len()).sum()
    }

    /// How dense the kernels of each volume's blocks are; found once. They do not depend on transfer
    /// functions.
    pub(crate) fn densities(&self) -> &[Vec<f64>] {
        self.densities
            .get_or_init(|| self.volumes.iter().map(densities).collect())
    }

    /// How many particles all volumes have.
    pub fn particle_count(&self) -> usize {
        self.data().map(BlockedVolume::particle_count).sum()
    }

    /// Bytes kept per particle, blocks and levels of detail included, over all volumes.
    pub fn bytes_per_particle(&self) -> f64 {
        let bytes: usize = self.volumes.iter().map(BlockedVolume::bytes).sum();
        bytes as f64 / self.particle_count().max(1) as f64
    }

    /// Whether any volume is of splats, which state their opacity.
    pub fn has_splats(&self) -> bool {
        self.volumes.iter().any(BlockedVolume::is_of_splats)
    }

    /// Middles and half extents of the boxes that hold what is visible, world units.
    pub fn visible_boxes(&self) -> Vec<Bounds> {
        let of_volume = |(i, known): (usize, &Known)| match &known.visible {
            Some(boxes) => boxes.clone(),
            None => self.visible_box_of_each(i).into_iter().flatten().collect(),
        };
        self.known.iter().enumerate().flat_map(of_volume).collect()
    }

    /// The same for a camera that is fitted: without splats far from where 99.5 % of opacity times area of a set of splats
    /// lie.
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

    /// Of each block of a volume the box of what is visible of it.
    pub(crate) fn visible_box_of_each(&self, volume: usize) -> Vec<Option<Bounds>> {
        self.family(volume)[0].visible_box_of_each(self.shown_function(volume))
    }

    /// The transfer function that a volume is shown by: the one that slabs are classified by, where its particles carry
    /// their values.
    pub(crate) fn shown_function(&self, volume: usize) -> Option<&TransferFunction> {
        let own = &self.family(volume)[0];
        match &self.carried {
            Some(transfer) if !own.is_surface() => Some(transfer),
            _ => own.transfer_function.as_ref(),
        }
    }

    /// What column densities sum of a volume, where that is known without a look at its particles.
    pub(crate) fn known_amplitudes(&self, volume: usize) -> Option<AmplitudeSummary> {
        self.known[volume].amplitudes
    }

    /// What column densities sum, of each volume.
    pub(crate) fn amplitudes_of_volumes(&self) -> Vec<AmplitudeSummary> {
        let of_volume = |(known, volume): (&Known, &BlockedVolume)| match known.amplitudes {
            Some(amplitudes) => amplitudes,
            None => AmplitudeSummary::of(std::iter::once(volume)),
        };
        self.known.iter().zip(self.data()).map(of_volume).collect()
    }

    /// Middles and half extents of the boxes that hold all particles, grown by one standard
    /// deviation; world units.
    pub fn boxes(&self) -> Vec<Bounds> {
        self.data().flat_map(BlockedVolume::boxes).collect()
    }

    /// Replaces the transfer function of a volume; its particles stay as and where they are.
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

    /// Exchanges the values of a volume; places, shapes and the transfer function stay.
    ///
    /// # Errors
    /// No such volume, one without values, not as many values as particles, or a scene that did not keep
    /// its shapes ([`SceneOptions::keep_shapes`]).
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

    /// What classifies slabs, where particles carry values.
    pub fn carried(&self) -> Option<&TransferFunction> {
        self.carried.as_ref()
    }

    /// Lets the particles of the one volume with a field carry their values, or their colours again.
    /// Returns the volume whose tables changed by that, if any did.
    ///
    /// # Errors
    /// No volume with a field, or others beside it.
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
        // The same is shown.
        let visible = self.known[volume].visible.take();
        self.set_transfer_function(volume, own)?;
        self.known[volume].visible = visible;
        Ok(Some(volume))
    }
}
