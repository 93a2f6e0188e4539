//! Defines a volume whose particles are partitioned among ranks.

use std::ops::Range;

use crate::blocks::build::build;
use crate::blocks::density::densities;
use crate::blocks::options::{BuildOptions, SceneOptions};
use crate::blocks::share::runs_in_turn;
use crate::blocks::volume::BlockedVolume;
use crate::collective::Collective;
use crate::error::Result;
use crate::scene::{PointVolume, Requirements};
use crate::view::Bounds;

/// A volume and its levels of detail with all blocks, whose particles are partitioned among ranks.
#[derive(Debug)]
pub(crate) struct SharedVolume {
    pub(crate) family: Vec<BlockedVolume>,
    /// Blocks whose particles are here, for each volume of the family.
    pub(crate) own: Vec<Vec<Range<u32>>>,
    /// Densities of all blocks, for each volume of the family.
    pub(crate) densities: Vec<Vec<f64>>,
    /// Boxes around the visible part.
    pub(crate) visible: Vec<Bounds>,
    /// Boxes around the visible part for a fitted camera.
    pub(crate) fitted: Vec<Bounds>,
    pub(in crate::blocks) requirements: Requirements,
}

impl SharedVolume {
    /// Number of volumes: the volume itself and its levels.
    pub(crate) fn len(&self) -> usize {
        self.family.len()
    }

    /// Builds a volume that every rank has, and keeps this rank's share of its particles.
    ///
    /// - `number`: number of the volume in its scene.
    pub(crate) fn of_whole(
        volume: PointVolume,
        options: &SceneOptions,
        number: usize,
        ranks: &dyn Collective,
    ) -> Result<Self> {
        let requirements = Requirements::of(&volume);
        let build_options = BuildOptions {
            detail: options.level_of_detail,
            ..BuildOptions::default()
        };
        let mut family = build(volume, build_options, options.task.as_ref())?;
        let base = &family[0];
        let visible = base.visible_boxes();
        let fitted = base.fitted_boxes();
        let densities = family.iter().map(densities).collect();
        let (rank, size) = (ranks.rank(), ranks.size());
        let mut own = Vec::with_capacity(family.len());
        for (level, volume) in family.iter_mut().enumerate() {
            let of_volume = runs_in_turn(volume.blocks.len(), size, rank, number + level);
            volume.keep(&of_volume)?;
            own.push(of_volume);
        }
        Ok(Self {
            family,
            own,
            densities,
            visible,
            fitted,
            requirements,
        })
    }
}
