//! What the nearest neighbours say of points that say nothing of their sizes.

use std::path::Path;

use super::super::neighbours::{Elsewhere, PointIndex};
#[cfg(feature = "cli")]
use super::super::neighbours::{NEIGHBOUR_COUNT, SPACING_NEIGHBOURS};
use super::super::{ParticleShape, SampleOptions};
use crate::error::{Error, Hint, Result};
use crate::math::eigen;
use glam::DVec3;

/// A set is truly anisotropic, lying on surfaces or along lines, if the neighbourhoods of this
/// share of its points are longer than wide by [`TRUE_RATIO`], the wide ones of
/// [`TRUE_NEIGHBOURS`] points: sets that fill space look flat at a few neighbours where they lie in
/// layers, and round at many.
const TRUE_SHARE: f64 = 0.5;
/// See [`TRUE_SHARE`]; a ratio of standard deviations.
const TRUE_RATIO: f64 = 3.0;
/// See [`TRUE_SHARE`].
const TRUE_NEIGHBOURS: usize = 60;
/// Points whose neighbourhoods are looked at for it.
const TRUE_SAMPLE: usize = 4096;

/// How many neighbours of a point are looked at here.
///
/// - `number`: its own, among `count`.
#[cfg(feature = "cli")]
pub(super) fn neighbours_of(number: u64, count: u64) -> usize {
    match number.is_multiple_of(step(count)) {
        true => TRUE_NEIGHBOURS,
        false => SPACING_NEIGHBOURS[1].max(NEIGHBOUR_COUNT),
    }
}

/// Every so many of the points one is looked at.
fn step(count: u64) -> u64 {
    count.div_ceil(TRUE_SAMPLE as u64).max(1)
}

/// What the neighbours of points say of them, in the order of the points.
#[derive(Debug)]
pub(crate) struct Neighbourhoods {
    /// The space that each has to itself \[length³\]; NaN of those without a place; empty where nobody asked.
    pub(crate) volumes: Vec<f64>,
    /// Covariances of the places of their neighbours, where kernels follow these.
    pub(crate) covariances: Option<Vec<[f64; 6]>>,
}

/// Points, and behind them their neighbours that are elsewhere.
pub(crate) struct Surrounded<'a> {
    pub(crate) positions: &'a [DVec3],
    /// Of the points their numbers among all, and how many these are.
    pub(crate) numbers: &'a dyn Fn(usize) -> u64,
    pub(crate) count: usize,
    pub(crate) of: u64,
}

impl Neighbourhoods {
    /// `None` with fewer than two distinct positions.
    ///
    /// - `with_volumes`: whether these are asked for.
    pub(crate) fn of(
        points: &Surrounded<'_>,
        with_volumes: bool,
        options: &SampleOptions,
        mut elsewhere: Option<&mut dyn Elsewhere>,
    ) -> Result<Option<Self>> {
        let index = PointIndex::new(points.positions);
        let with_covariances = match options.shape {
            ParticleShape::Covariance => true,
            ParticleShape::Automatic => {
                let own = index
                    .as_ref()
                    .map_or([0; 2], |index| long_of(index, points));
                let [long, all] = match &mut elsewhere {
                    Some(elsewhere) => elsewhere.sums(own)?,
                    None => own,
                };
                long as f64 > TRUE_SHARE * all as f64
            }
            ParticleShape::Isotropic | ParticleShape::YuTurk => false,
        };
        let task = options.task.as_ref();
        let (count, is_alone) = (points.count, elsewhere.is_none());
        let mut covariances = match (&index, with_covariances) {
            (_, false) => None,
            (Some(index), true) => Some(index.covariances(task, count, elsewhere)?),
            (None, true) => {
                if let Some(elsewhere) = elsewhere {
                    elsewhere.complete(Vec::new())?;
                }
                Some(Vec::new())
            }
        };
        let Some(index) = index else {
            // One who has none of the points agrees with the others.
            return Ok((count == 0 && !is_alone).then_some(Self {
                volumes: Vec::new(),
                covariances,
            }));
        };
        let mut volumes = match with_volumes {
            true => index.volumes(task)?,
            false => Vec::new(),
        };
        volumes.truncate(count);
        if let Some(covariances) = &mut covariances {
            covariances.truncate(count);
        }
        Ok(Some(Self {
            volumes,
            covariances,
        }))
    }
}

/// Refuses points with fewer than two distinct positions.
pub(crate) fn without_spacing(path: &Path) -> Error {
    Error::format(
        path,
        "columns",
        "a shape: sigma, h, radius, vxx..vzz or scale_0..2 with rot_0..3",
        "fewer than two distinct positions to take a spacing from",
        Hint::AddSigmaOrGiveRadius,
    )
}

/// How many of some points have long neighbourhoods, and of how many: see [`TRUE_SHARE`].
fn long_of(index: &PointIndex<'_>, points: &Surrounded<'_>) -> [u64; 2] {
    let step = step(points.of);
    let is_looked_at = |i: &u32| {
        let number = (points.numbers)(*i as usize);
        number.is_multiple_of(step) && index.position(*i).is_finite()
    };
    let looked_at: Vec<u32> = (0..).take(points.count).filter(is_looked_at).collect();
    let covariances = index.covariances_of(&looked_at, TRUE_NEIGHBOURS);
    let is_long = |c: &&[f64; 6]| {
        let (spread, _) = eigen(**c);
        spread.max_element() > TRUE_RATIO * TRUE_RATIO * spread.min_element()
    };
    let long = covariances.iter().filter(is_long).count();
    [long as u64, covariances.len() as u64]
}
