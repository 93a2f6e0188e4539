//! Reads the points of a file as a stream of particles.

use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use crate::blocks::ParticleStream;
use crate::data::colour_columns::ColourNumbers;
use crate::data::particle_type::ParticleType;
use crate::data::up::Up;
use crate::error::{Error, Result};
use crate::io::{ROWS, RowFile};
use crate::sample::{
    Found, OfRows, SampleOptions, SampleReport, colour_numbers, mean_spacing, nothing_left,
    of_rows, rows, summed_function,
};
use crate::scene::PointVolume;
use crate::scene::rows::{append, kind_of};

/// A file of points, each of which becomes a particle by itself. Streams the particles that
/// [`sample::volume`](crate::sample::volume) makes of all points at once.
///
/// ```
/// use ewa_splat::prepared::{PointFile, PreparedScene};
/// use ewa_splat::{SceneOptions, sample::SampleOptions};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("balls.npy");
/// # let mut bytes = b"\x93NUMPY\x01\x00\xb6\x00".to_vec();
/// # let columns = ["x", "y", "z", "sigma", "mass"].map(|name| format!("('{name}', '<f4')")).join(", ");
/// # bytes.extend(format!("{{'descr': [{columns}], 'fortran_order': False, 'shape': (2,), }}").bytes());
/// # bytes.resize(191, b' ');
/// # bytes.push(b'\n');
/// # bytes.extend([0.0_f32, 0.0, 0.0, 0.5, 1.0, 1.0, 0.0, 0.0, 0.5, 1.0].iter().flat_map(|x| x.to_le_bytes()));
/// # std::fs::write(&path, bytes)?;
/// // Columns x, y, z, sigma and mass.
/// let balls = PointFile::open(&path, None, &SampleOptions::default())?;
/// let mut balls = balls.ok_or("not read by rows")?;
/// let scene = PreparedScene::of_stream(&mut balls, &SceneOptions::default(), folder.path())?;
/// assert_eq!(scene.particle_count(), 2);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct PointFile {
    file: RowFile,
    options: SampleOptions,
    /// Whether column densities sum values. Their range and volume need all particles.
    is_of_values: bool,
    /// Statistics of all colours' numbers, if these tell how colours are stored.
    colours: Option<ColourNumbers>,
    notes: Vec<String>,
    /// Report of the first reading of all particles.
    report: Option<SampleReport>,
    corners: Option<(DVec3, DVec3)>,
}

impl PointFile {
    /// Opens a file.
    ///
    /// Returns `None` if the file cannot be read by rows ([`RowFile`]), or if a particle depends on more than its own
    /// row: its shape or strength on neighbours, or its transfer function on values. For column densities
    /// ([`PurposeOptions::for_columns`](crate::sample::PurposeOptions::for_columns)) values are summed as they are.
    ///
    /// # Errors
    /// A file that cannot be read; rows that do not describe particles.
    pub fn open(
        path: &Path,
        particle_type: Option<ParticleType>,
        options: &SampleOptions,
    ) -> Result<Option<Self>> {
        match RowFile::open(path, particle_type)? {
            Some(file) => Self::of(file, options),
            None => Ok(None),
        }
    }

    /// Takes a file that is open already, as [`Self::open`] does.
    ///
    /// # Errors
    /// The errors of [`Self::open`].
    pub fn of(mut file: RowFile, options: &SampleOptions) -> Result<Option<Self>> {
        let Some(run) = file.runs(ROWS).into_iter().next() else {
            return Ok(None);
        };
        let head = file.read(run)?;
        let Some(kind) = of_rows(&head, options) else {
            return Ok(None);
        };
        let mut options = SampleOptions {
            task: None,
            ..options.clone()
        };
        let is_of_values = matches!(kind, OfRows::Summed(_));
        if let OfRows::Summed(name) = kind {
            options.field = Some(name);
        }
        let mut colours = None;
        if colour_numbers(&head)?.is_some() {
            for run in file.runs(ROWS) {
                let own = colour_numbers(&file.read(run)?)?;
                colours = own.into_iter().chain(colours).reduce(ColourNumbers::and);
            }
        }
        Ok(Some(Self {
            file,
            options,
            is_of_values,
            colours,
            notes: head.notes,
            report: None,
            corners: None,
        }))
    }

    /// Notes of the reader on the file.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Field that column densities sum, if the particles have one.
    pub fn field(&self) -> Option<&str> {
        self.options.field.as_deref().filter(|_| self.is_of_values)
    }

    /// Report on all particles, once all were read.
    pub fn report(&self) -> Option<&SampleReport> {
        self.report.as_ref()
    }

    /// Least and greatest coordinates, once all particles were read; `None` if none is finite.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        self.corners
    }

    /// Upward direction, once all particles were read: [`Dataset::up`](crate::io::Dataset::up).
    pub fn up(&self) -> Up {
        Up::of_points(self.corners)
    }

    /// Reads the rows of one of several readers that share the file; returns their particles and findings.
    pub(crate) fn read_part(&mut self, one: usize, of: usize) -> Result<(PointVolume, Found)> {
        let count = self.file.count();
        let part = one * count / of..(one + 1) * count / of;
        let mut read: Option<(PointVolume, u64)> = None;
        // A reader without rows returns the kind of the first row.
        let looked_at = if part.is_empty() { 0..1 } else { part.clone() };
        let path = self.file.path().to_path_buf();
        let found = self.visit(looked_at, &mut |volume| {
            let own = kind_of(&volume);
            match &mut read {
                None => read = Some((volume, own)),
                Some((all, kind)) if *kind == own => append(all, volume),
                Some(_) => {
                    let (expected, advice) = ("particles of one kind", "read its files one by one");
                    return Err(Error::format(&path, "rows", expected, "several", advice));
                }
            }
            Ok(())
        })?;
        let Some((volume, _)) = read else {
            return Err(nothing_left(&path, &found.report));
        };
        if part.is_empty() {
            return Ok((volume.emptied(), Found::none_of(&found.report)));
        }
        Ok((volume, found))
    }

    /// Keeps the findings on all particles.
    ///
    /// # Errors
    /// No particle is left.
    pub(crate) fn keep(&mut self, found: Found) -> Result<()> {
        let Found {
            mut report,
            corners,
            volume_sum,
        } = found;
        if report.particle_count == 0 {
            return Err(nothing_left(self.file.path(), &report));
        }
        let spacing = mean_spacing(volume_sum.value(), report.particle_count);
        report.unit_distance = self.options.function.unit_distance.unwrap_or(spacing);
        (self.report, self.corners) = (Some(report), corners);
        Ok(())
    }

    /// Reads some rows, and calls `each` with their particles.
    fn visit(
        &mut self,
        part: Range<usize>,
        each: &mut dyn FnMut(PointVolume) -> Result<()>,
    ) -> Result<Found> {
        let mut report: Option<SampleReport> = None;
        let mut found = Found::default();
        for run in self.file.runs_within(ROWS, &part) {
            let dataset = self.file.read(run)?;
            if let Some(corners) = dataset.bounds() {
                found.extend(corners);
            }
            let sampled = rows(dataset, &self.options, self.colours, &mut found.volume_sum)?;
            match &mut report {
                Some(report) => report.add(&sampled.report),
                None => report = Some(sampled.report),
            }
            each(sampled.volume)?;
        }
        found.report = report.unwrap_or_default();
        Ok(found)
    }

    fn visit_all(&mut self, each: &mut dyn FnMut(PointVolume) -> Result<()>) -> Result<()> {
        let found = self.visit(0..self.file.count(), each)?;
        self.keep(found)
    }
}

impl ParticleStream for PointFile {
    fn len(&self) -> usize {
        self.file.count()
    }

    fn for_each(&mut self, each: &mut dyn FnMut(PointVolume) -> Result<()>) -> Result<()> {
        if !self.is_of_values {
            return self.visit_all(each);
        }
        if self.report.is_none() {
            self.visit_all(&mut |_| Ok(()))?;
        }
        let report = self.report.clone().unwrap_or_default();
        let function = summed_function(report.value_range, report.unit_distance)?;
        self.visit_all(&mut |mut volume| {
            volume.transfer_function = Some(function.clone());
            each(volume)
        })
    }
}
