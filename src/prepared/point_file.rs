//! Points of a file as a stream of particles.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::blocks::ParticleStream;
use crate::error::Result;
use crate::io::{Dataset, Geometry, RowFile, Up};
use crate::sample::{SampleOptions, SampleReport, is_of_rows, nothing_left, rows};
use crate::scene::PointVolume;

/// Rows that are read at a time, and bytes of them at most.
const ROWS: usize = 1 << 18;
const BYTES: usize = 1 << 26;

/// A file of points of which each becomes a particle by itself: a stream of what [`sample::volume`](crate::sample::volume)
/// makes of all of them at once.
///
/// ```
/// use ewa_splat::prepared::{PointFile, PreparedScene};
/// use ewa_splat::{SceneOptions, sample::SampleOptions};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("balls.npy");
/// # let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
/// # let columns = ["x", "y", "z", "sigma", "mass"].map(|name| format!("('{name}', '<f4')")).join(", ");
/// # bytes.extend(format!("{{'descr': [{columns}], 'fortran_order': False, 'shape': (2,), }}").bytes());
/// # bytes.resize(127, b' ');
/// # bytes.push(b'\n');
/// # bytes.extend([0.0_f32, 0.0, 0.0, 0.5, 1.0, 1.0, 0.0, 0.0, 0.5, 1.0].iter().flat_map(|x| x.to_le_bytes()));
/// # std::fs::write(&path, bytes)?;
/// // Columns x, y, z, sigma and mass.
/// let mut balls = PointFile::open(&path, &SampleOptions::default())?.ok_or("not read by rows")?;
/// let scene = PreparedScene::of_stream(&mut balls, &SceneOptions::default(), folder.path())?;
/// assert_eq!(scene.particle_count(), 2);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct PointFile {
    path: PathBuf,
    file: RowFile,
    options: SampleOptions,
    run: usize,
    /// What was found when all were read first.
    report: Option<SampleReport>,
    corners: Option<(DVec3, DVec3)>,
}

impl PointFile {
    /// Opens a file; `None` where it is not read by rows ([`RowFile`]), or a particle depends on others than its own row
    /// ([`is_of_rows`]).
    ///
    /// # Errors
    /// A file that cannot be read; rows that say nothing of particles.
    pub fn open(path: &Path, options: &SampleOptions) -> Result<Option<Self>> {
        let Some(mut file) = RowFile::open(path)? else {
            return Ok(None);
        };
        let run = (BYTES / file.row_len()).clamp(1, ROWS);
        let head = file.read(0..file.count().min(1))?;
        let own = || Self {
            path: path.to_path_buf(),
            file,
            options: SampleOptions {
                task: None,
                ..options.clone()
            },
            run,
            report: None,
            corners: None,
        };
        Ok(is_of_rows(&head, options).then(own))
    }

    /// What was found, once all particles were asked for.
    pub fn report(&self) -> Option<&SampleReport> {
        self.report.as_ref()
    }

    /// The least and the greatest coordinates, once all particles were asked for; `None` where none is finite.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        self.corners
    }

    /// Which way is up, once all particles were asked for: [`Dataset::up`].
    pub fn up(&self) -> Up {
        // Of points it depends on their bounds.
        let positions = self.corners.map_or(Vec::new(), |(a, b)| vec![a, b]);
        let geometry = Geometry::Points { positions };
        Dataset::new(&self.path, "points", geometry, Vec::new()).up()
    }
}

impl ParticleStream for PointFile {
    fn len(&self) -> usize {
        self.file.count()
    }

    fn for_each(&mut self, each: &mut dyn FnMut(PointVolume) -> Result<()>) -> Result<()> {
        let mut report: Option<SampleReport> = None;
        let mut corners: Option<(DVec3, DVec3)> = None;
        for first in (0..self.len()).step_by(self.run) {
            let dataset = self.file.read(first..self.len().min(first + self.run))?;
            if let Some((a, b)) = dataset.bounds() {
                corners = Some(corners.map_or((a, b), |(low, high)| (low.min(a), high.max(b))));
            }
            let sampled = rows(dataset, &self.options)?;
            match &mut report {
                Some(report) => report.add(&sampled.report),
                None => report = Some(sampled.report),
            }
            each(sampled.volume)?;
        }
        let report = report.unwrap_or_default();
        if report.particle_count == 0 {
            return Err(nothing_left(&self.path, &report));
        }
        (self.report, self.corners) = (Some(report), corners);
        Ok(())
    }
}
