//! Computes sizes of points from their nearest neighbours, for points that state none.

use std::path::Path;

use super::neighbours::{Groups, PointIndex, Remote};
use super::neighbours::{NEIGHBOUR_COUNT, SPACING_NEIGHBOURS};
use crate::error::{Error, Hint, Result};
use crate::math::eigen;
use crate::sample::options::{ParticleShape, SampleOptions};
use glam::DVec3;

/// Share of the points with elongated neighbourhoods from which a set is truly anisotropic, lying on surfaces
/// or along lines. A neighbourhood is elongated if its standard deviations have a ratio above [`TRUE_RATIO`]
/// over [`TRUE_NEIGHBOURS`] points. Sets that fill space in layers look flat at a few neighbours, and round at
/// many.
const TRUE_SHARE: f64 = 0.5;
/// Least ratio of standard deviations; see [`TRUE_SHARE`].
const TRUE_RATIO: f64 = 3.0;
/// Number of neighbours; see [`TRUE_SHARE`].
const TRUE_NEIGHBOURS: usize = 60;
/// Number of points that are tested.
const TRUE_SAMPLE: usize = 4096;

/// Returns the number of neighbours that a point needs.
///
/// - `number`: number of the point, among `count`.
pub(super) fn neighbours_of(number: u64, count: u64) -> usize {
    match number.is_multiple_of(step(count)) {
        true => TRUE_NEIGHBOURS,
        false => SPACING_NEIGHBOURS[1].max(NEIGHBOUR_COUNT),
    }
}

/// Returns the stride between tested points.
fn step(count: u64) -> u64 {
    count.div_ceil(TRUE_SAMPLE as u64).max(1)
}

/// Sizes and shapes from neighbours, in the order of the points.
pub(crate) struct Neighbourhoods {
    /// Volume of each point \[length³\]; NaN for points without a finite position; empty if not asked for.
    pub(crate) volumes: Vec<f64>,
    /// Covariances of the neighbours' positions, if kernels follow these.
    pub(crate) covariances: Option<Vec<[f64; 6]>>,
    /// The points' groups with their listed neighbours, if these serve local models, too.
    pub(super) groups: Option<Groups>,
}

/// Local points, followed by their remote neighbours.
pub(crate) struct Surrounded<'a> {
    pub(crate) positions: &'a [DVec3],
    /// Returns the number of a point among all points; then the number of local points, and of all.
    pub(crate) numbers: &'a dyn Fn(usize) -> u64,
    pub(crate) count: usize,
    pub(crate) of: u64,
}

impl Neighbourhoods {
    /// Returns `None` for fewer than two distinct positions.
    ///
    /// - `with_volumes`: true to compute volumes.
    pub(crate) fn of(
        points: &Surrounded<'_>,
        with_volumes: bool,
        options: &SampleOptions,
        mut remote: Option<&mut dyn Remote>,
    ) -> Result<Option<Self>> {
        let task = options.task.as_ref();
        let mut index = PointIndex::new(points.positions);
        let is_listed = options.purpose.local_models && remote.is_none();
        if let Some(index) = index.as_mut().filter(|_| is_listed) {
            index.list(task)?;
        }
        let with_covariances = match options.kernels.shape {
            ParticleShape::Covariance => true,
            ParticleShape::Automatic => {
                let own = index
                    .as_ref()
                    .map_or([0; 2], |index| long_of(index, points));
                let [long, all] = match &mut remote {
                    Some(remote) => remote.sums(own)?,
                    None => own,
                };
                long as f64 > TRUE_SHARE * all as f64
            }
            ParticleShape::Isotropic | ParticleShape::YuTurk => false,
        };
        let (count, is_alone) = (points.count, remote.is_none());
        let mut covariances = match (&index, with_covariances) {
            (_, false) => None,
            (Some(index), true) => Some(index.covariances(task, count, remote)?),
            (None, true) => {
                if let Some(remote) = remote {
                    remote.complete(Vec::new())?;
                }
                Some(Vec::new())
            }
        };
        let Some(index) = index else {
            // A rank without points agrees with the others.
            return Ok((count == 0 && !is_alone).then_some(Self {
                volumes: Vec::new(),
                covariances,
                groups: None,
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
            groups: is_listed.then(|| index.into_groups()),
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

/// Returns the number of elongated neighbourhoods among the tested points, and the number tested: see
/// [`TRUE_SHARE`].
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
