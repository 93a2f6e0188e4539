//! Reads a file of points on all ranks, a run of rows on each; points are sampled by means of their neighbours.

use std::mem::take;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use super::function::{PartRead, found_by_all, models_of_all, show};
use super::halo::{Halo, send, send_values};
use super::planes::joined;
use crate::blocks::assign_by_position;
use crate::collective::Collective;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::Result;
use crate::io::ROWS;
use crate::io::RowFile;
use crate::ranks::Share;
use crate::sample::Found;
use crate::sample::{
    FITTED_NEIGHBOURS, Fitted, Neighbourhoods, PartitionedRows, Remote, SampleOptions, Surrounded,
    fit_partition, sample_partition, scalars, without_spacing,
};
use crate::scene::{PointVolume, Surroundings, Tiling, Values};

/// Reads a run of rows on each rank, redistributes the rows by position, and makes particles of them: the particles
/// that [`sample::volume`](crate::sample::volume) makes of the whole file.
///
/// Returns `None` if one rank must read the whole file ([`PartitionedRows::of`]), or if not all rows have the same columns.
///
/// # Errors
/// The errors of reading or sampling, on any rank; nothing that can be drawn; too little memory; a rank that is gone.
pub(crate) fn read_rows(
    file: &mut RowFile,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<Option<PartRead>> {
    let count = file.count();
    let head = file.read(0..count.min(1));
    let head = ranks.agree(head)?;
    let Some(kind) = PartitionedRows::of(&head, options) else {
        return Ok(None);
    };
    let part = ranks.rank() * count / ranks.size()..(ranks.rank() + 1) * count / ranks.size();
    let field = match &options.field {
        Some(name) => Some(name.clone()),
        None => {
            let ranges = ranges_of(file, &part, &head);
            field_of_all(ranges, &head, kind, options, ranks)?
        }
    };
    let options = SampleOptions {
        field,
        ..options.clone()
    };
    let own = Rows::read(file, part, &head, kind, options.field.as_deref());
    let own = ranks.agree(own)?;
    if ranks.any(own.is_none())? {
        return Ok(None);
    }
    let own = own.unwrap_or_default();
    particles_of(own, (head, kind, count), &options, ranks).map(Some)
}

/// Makes particles of points in memory, of which each rank holds some: the particles that
/// [`sample::volume`](crate::sample::volume) makes of all, one rank after another.
///
/// - `dataset`: this rank's points, with the same columns on every rank.
/// - `kind`: what [`PartitionedRows::of`] returns.
///
/// # Errors
/// As [`read_rows`].
pub(super) fn held_rows(
    dataset: &Dataset,
    kind: PartitionedRows,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<PartRead> {
    let head = without_rows(dataset);
    let field = match &options.field {
        Some(name) => Some(name.clone()),
        None => {
            let mut ranges = Ranges::of(&head);
            ranges.add(&head, dataset);
            field_of_all(Ok(ranges.0), &head, kind, options, ranks)?
        }
    };
    let options = SampleOptions {
        field,
        ..options.clone()
    };
    let columns = columns_of(dataset, kind, &head, options.field.as_deref());
    let columns = ranks.agree(columns)?;
    let Geometry::Points { positions } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let count = positions.len() as u64;
    let first = ranks.sum_before(Ok(count))?;
    let own = Rows {
        numbers: (first..first + count).collect(),
        positions: positions.clone(),
        columns,
    };
    let count = ranks.sum(Ok(count))? as usize;
    particles_of(own, (head, kind, count), &options, ranks)
}

/// Returns points without rows: the names and the types of their columns.
pub(super) fn without_rows(dataset: &Dataset) -> Dataset {
    let emptied = |values: &Values| Values::of_type(values.type_name(), &[]);
    let fields = dataset.fields.iter().map(|field| Field {
        name: field.name.clone(),
        association: field.association,
        source: match &field.source {
            FieldSource::Scalar(values) => FieldSource::Scalar(emptied(values)),
            FieldSource::Vector(components) => {
                FieldSource::Vector(components.iter().map(emptied).collect())
            }
            FieldSource::Derived(derive) => FieldSource::Derived(*derive),
        },
        unit: field.unit.clone(),
    });
    let geometry = Geometry::Points {
        positions: Vec::new(),
    };
    Dataset {
        notes: dataset.notes.clone(),
        smoothing: dataset.smoothing.clone(),
        volume_scale: dataset.volume_scale,
        ..Dataset::new(&dataset.path, dataset.format, geometry, fields.collect())
    }
}

/// Returns the field that is shown if none is named, which the values of all ranks determine.
///
/// - `ranges`: the range of each column on this rank.
fn field_of_all(
    ranges: Result<Vec<[f64; 2]>>,
    head: &Dataset,
    kind: PartitionedRows,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<Option<String>> {
    let all = ranks.gather_records(ranges)?;
    let varies = |name: &str| {
        let place = scalars(head).position(|(own, _)| own == name);
        let of_rank = |ranges: &Vec<[f64; 2]>| {
            let own = place.and_then(|n| ranges.get(n));
            own.copied().filter(|[lo, hi]| lo <= hi)
        };
        let all = all.iter().map(of_rank).fold(None, joined);
        all.is_some_and(|[lo, hi]| lo < hi)
    };
    Ok(kind.field(head, options, &varies))
}

/// Makes the particles of some rows on each rank.
///
/// - `head`: metadata of all rows; `count`: their number.
fn particles_of(
    own: Rows,
    (head, kind, count): (Dataset, PartitionedRows, usize),
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<PartRead> {
    let own = own.gathered(ranks)?;
    let path = head.path.clone();
    let neighbourhoods = match kind.is_bare {
        true => Some(neighbourhoods(&own, kind, count, options, ranks, &path)?),
        false => None,
    };
    let mut found = Found::default();
    let Rows {
        numbers,
        positions,
        columns,
    } = own;
    let dataset = dataset_of(&head, positions, columns);
    found.corners = dataset.bounds();
    let sum = &mut found.volume_sum;
    let sampled = sample_partition(dataset, options, neighbourhoods.as_ref(), sum);
    let sampled = ranks.agree(sampled)?;
    let picked = sampled.picked(&numbers, count);
    let kept: Vec<u64> = sampled.kept.iter().map(|&i| numbers[i as usize]).collect();
    let mut volume = sampled.volume;
    found.report = sampled.report;
    let (mut found, spacing) = found_by_all(&found, &head, &path, options, ranks)?;
    let shown = (&mut found, spacing);
    show(
        &mut volume,
        picked,
        (count, (Surroundings::Absent, Tiling::Loose)),
        shown,
        options,
        ranks,
    )?;
    fit(&mut volume, options, ranks)?;
    let corners = found.corners.into_iter();
    let geometry = Geometry::Points {
        positions: corners.flat_map(|(a, b)| [a, b]).collect(),
    };
    Ok(PartRead {
        share: Share {
            numbers: Some(vec![kept]),
            ..Share::from(vec![volume])
        },
        report: found.report,
        head: Dataset { geometry, ..head },
        corners: found.corners,
    })
}

/// Fits normals and local models to the neighbours that have particles.
fn fit(
    volume: &mut PointVolume,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<()> {
    if volume.values.is_none() || !(options.purpose.normals || options.purpose.local_models) {
        return Ok(());
    }
    let [few, most] = FITTED_NEIGHBOURS;
    let mut fitted = fitted(volume, &|_| few, options, ranks)?;
    // Some neighbourhoods are too small to fit: these particles use more neighbours.
    if ranks.any(!fitted.far.is_empty())? {
        let far = take(&mut fitted.far);
        let count = |i: u32| {
            if far.binary_search(&i).is_ok() {
                most
            } else {
                few
            }
        };
        fitted = self::fitted(volume, &count, options, ranks)?;
    }
    volume.normals = fitted.normals;
    let Some(models) = fitted.models else {
        return Ok(());
    };
    volume.local_models = Some(models_of_all(&models, ranks)?);
    Ok(())
}

/// Fits normals and local models, with `count` neighbours for each particle.
fn fitted(
    volume: &PointVolume,
    count: &(dyn Fn(u32) -> usize + Sync),
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<Fitted> {
    let positions = volume.particles.positions();
    let around = Halo::of(positions, count, ranks)?;
    let places = around.fetch(positions, ranks)?;
    let values = match &volume.values {
        None => Values::U8(Vec::new()),
        Some(own) => around.fetch_values(own, ranks)?,
    };
    let fitted = fit_partition(volume, (&places, values), options);
    ranks.agree(fitted)
}

/// Some rows of a file.
#[derive(Debug, Default)]
struct Rows {
    /// Row numbers in the whole file, ascending.
    numbers: Vec<u64>,
    positions: Vec<DVec3>,
    columns: Vec<(String, Values)>,
}

/// The least and the greatest finite value of each column of some rows; reversed infinities if a column has none.
struct Ranges(Vec<[f64; 2]>);

impl Ranges {
    /// Returns the ranges of no rows.
    fn of(head: &Dataset) -> Self {
        Self(vec![
            [f64::INFINITY, f64::NEG_INFINITY];
            scalars(head).count()
        ])
    }

    /// Adds the values of rows with the same columns, or some of them.
    fn add(&mut self, head: &Dataset, dataset: &Dataset) {
        for (name, values) in scalars(dataset) {
            let place = scalars(head).position(|(own, _)| own == name);
            if let (Some(n), Some([lo, hi])) = (place, values.finite_range()) {
                self.0[n] = [self.0[n][0].min(lo), self.0[n][1].max(hi)];
            }
        }
    }
}

/// Returns the ranges of a part's columns.
fn ranges_of(file: &mut RowFile, part: &Range<usize>, head: &Dataset) -> Result<Vec<[f64; 2]>> {
    let mut ranges = Ranges::of(head);
    for run in file.runs_within(ROWS, part) {
        ranges.add(head, &file.read(run)?);
    }
    Ok(ranges.0)
}

impl Rows {
    /// Reads the rows of a part of a file, with the columns that sampling uses and the field that is shown. Returns
    /// `None` if the rows have other columns than the first row.
    fn read(
        file: &mut RowFile,
        part: Range<usize>,
        head: &Dataset,
        kind: PartitionedRows,
        field: Option<&str>,
    ) -> Result<Option<Self>> {
        let mut own = Self {
            columns: columns_of(head, kind, head, field)?,
            ..Self::default()
        };
        own.columns
            .iter_mut()
            .for_each(|(_, values)| values.truncate(0));
        // Memory for the rows as read, as sent to the ranks near them, and as received.
        let bytes = own
            .columns
            .iter()
            .map(|(_, values)| values.bytes_per_value());
        let each = size_of::<u64>() + size_of::<DVec3>() + bytes.sum::<usize>();
        crate::memory::check(part.len(), 3 * each).map_err(|e| e.in_file(file.path()))?;
        for run in file.runs_within(ROWS, &part) {
            let mut dataset = file.read(run.clone())?;
            let columns = columns_of(&dataset, kind, head, field)?;
            let is_alike = |(own, other): (&(String, Values), &(String, Values))| {
                own.0 == other.0 && own.1.kind_name() == other.1.kind_name()
            };
            let Geometry::Points { positions } = &mut dataset.geometry else {
                return Ok(None);
            };
            let is_whole = columns
                .iter()
                .all(|(_, values)| values.len() == positions.len());
            let is_same = own.columns.len() == columns.len()
                && own.columns.iter().zip(&columns).all(is_alike);
            if !is_whole || !is_same {
                return Ok(None);
            }
            own.positions.append(positions);
            own.numbers.extend(run.map(|row| row as u64));
            for ((_, all), (_, values)) in own.columns.iter_mut().zip(columns) {
                all.append(values);
            }
        }
        Ok(Some(own))
    }

    /// Redistributes the rows of all ranks by position: returns the rows in this rank's part of space, and this rank's
    /// own rows without a finite position.
    fn gathered(self, ranks: &mut dyn Collective) -> Result<Self> {
        let (rank, size) = (ranks.rank(), ranks.size());
        let placed: Vec<u32> = (0..)
            .zip(&self.positions)
            .filter(|(_, p)| p.is_finite())
            .map(|(i, _)| i)
            .collect();
        let places: Vec<DVec3> = placed.iter().map(|&i| self.positions[i as usize]).collect();
        let owners = assign_by_position(&places, ranks)?;
        let mut of_rows = vec![rank as u32; self.positions.len()];
        for (&i, owner) in placed.iter().zip(owners) {
            of_rows[i as usize] = owner;
        }
        let mut to = vec![Vec::new(); size];
        for (i, &owner) in (0..).zip(&of_rows) {
            to[owner as usize].push(i);
        }
        let mut columns = Vec::with_capacity(self.columns.len());
        for (name, values) in self.columns {
            columns.push((name, send_values(&values, &to, ranks)?));
        }
        Ok(Self {
            // Numbers still ascend, because ranks read one run after another.
            numbers: send(&self.numbers, &to, ranks)?,
            positions: send(&self.positions, &to, ranks)?,
            columns,
        })
    }
}

/// Returns the columns that sampling uses and the field that is shown, according to the first row.
fn columns_of(
    dataset: &Dataset,
    kind: PartitionedRows,
    head: &Dataset,
    field: Option<&str>,
) -> Result<Vec<(String, Values)>> {
    let is_shown = |name: &str| field.is_some_and(|field| field.eq_ignore_ascii_case(name));
    let mut columns: Vec<(String, Values)> = scalars(dataset)
        .filter(|(name, _)| is_shown(name) || kind.uses(head, name))
        .map(|(name, values)| (name.to_owned(), values.clone()))
        .collect();
    if let Some(field) = field
        && !columns.iter().any(|(name, _)| is_shown(name))
    {
        let (association, values) = dataset.scalar(field)?;
        if association == Association::Nodes {
            columns.push((field.to_owned(), values));
        }
    }
    Ok(columns)
}

/// Returns rows as a data set, as if a reader had read these columns only.
fn dataset_of(head: &Dataset, positions: Vec<DVec3>, columns: Vec<(String, Values)>) -> Dataset {
    let fields = columns.into_iter().map(|(name, values)| Field {
        name,
        association: Association::Nodes,
        source: FieldSource::Scalar(values),
        unit: None,
    });
    let geometry = Geometry::Points { positions };
    Dataset {
        smoothing: head.smoothing.clone(),
        volume_scale: head.volume_scale,
        ..Dataset::new(&head.path, head.format, geometry, fields.collect())
    }
}

/// Finds the neighbourhoods of points without stated sizes; neighbours may be on any rank.
fn neighbourhoods(
    own: &Rows,
    kind: PartitionedRows,
    count: usize,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
    path: &Path,
) -> Result<Neighbourhoods> {
    let neighbours = |i: u32| PartitionedRows::neighbours(own.numbers[i as usize], count as u64);
    let around = Halo::of(&own.positions, &neighbours, ranks)?;
    let others = around.fetch(&own.positions, ranks)?;
    let positions = [own.positions.as_slice(), &others].concat();
    let points = Surrounded {
        positions: &positions,
        numbers: &|i| own.numbers[i],
        count: own.positions.len(),
        of: count as u64,
    };
    let mut others = Others { around, ranks };
    let found = Neighbourhoods::of(&points, kind.needs_volumes, options, Some(&mut others));
    ranks.agree(found.and_then(|found| found.ok_or_else(|| without_spacing(path))))
}

struct Others<'a> {
    around: Halo,
    ranks: &'a mut dyn Collective,
}

impl Remote for Others<'_> {
    fn sums(&mut self, own: [u64; 2]) -> Result<[u64; 2]> {
        let sums = self.ranks.sums(Ok(own.to_vec()))?;
        Ok([0, 1].map(|n| sums.get(n).copied().unwrap_or(0)))
    }

    fn complete(&mut self, mut own: Vec<[f64; 6]>) -> Result<Vec<[f64; 6]>> {
        let others = self.around.fetch(&own, self.ranks)?;
        own.extend(others);
        Ok(own)
    }
}

#[cfg(test)]
mod tests {
    use super::super::function::check_file;
    use super::*;
    use crate::breadth::some;
    use crate::ranks::ThreadRank;
    use crate::sample::{FunctionOptions, KernelOptions, PurposeOptions};
    use crate::sample::{ParticleShape, TransferChoice};
    use crate::scene::ScaleName;

    /// Returns a pseudo-random number from 0 to 1 for each `n`.
    fn random(n: usize) -> f64 {
        let hashed = (n as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let hashed = (hashed ^ (hashed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((hashed ^ (hashed >> 29)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns points in random order: a lattice, many of whose neighbours are at the same distance; a cluster;
    /// positions that several points share; a few far away; some that are not finite.
    fn places() -> Vec<DVec3> {
        let on_lattice = (0..40_usize.pow(3)).map(|i| {
            DVec3::new((i % 40) as f64, (i / 40 % 40) as f64, (i / 1600) as f64) * 0.1 + 7.0
        });
        let in_crowd = (0..90_000).map(|i| {
            let p = DVec3::new(random(3 * i), random(3 * i + 1), random(3 * i + 2)) - 0.5;
            DVec3::new(9.0, 9.5, 11.5) + p * 3.0 * p.length_squared()
        });
        let shared =
            (0..40).map(|i| DVec3::new(8.0, 9.0, 10.0) + 0.25 * DVec3::X * f64::from(i % 4));
        let far = (0..7).map(|i| DVec3::new(60.0, -20.0 * f64::from(i), 3.0));
        let nowhere = [DVec3::NAN, DVec3::new(1.0, f64::INFINITY, 0.0)];
        let all = on_lattice
            .chain(in_crowd)
            .chain(shared)
            .chain(far)
            .chain(nowhere);
        let mut all: Vec<(u64, DVec3)> = (0..)
            .map(|n| (random(7 * n) * 1e15) as u64)
            .zip(all)
            .collect();
        all.sort_unstable_by_key(|(key, _)| *key);
        all.into_iter().map(|(_, p)| p).collect()
    }

    /// Writes a table in the order of its rows.
    fn write(path: &Path, names: &[&str], rows: impl Iterator<Item = Vec<f64>>) {
        let columns: Vec<String> = names
            .iter()
            .map(|name| format!("('{name}', '<f8')"))
            .collect();
        let mut body = Vec::new();
        let mut count = 0;
        for row in rows {
            count += 1;
            body.extend(row.iter().flat_map(|x| x.to_le_bytes()));
        }
        let header = format!(
            "{{'descr': [{}], 'fortran_order': False, 'shape': ({count},), }}",
            columns.join(", ")
        );
        let width = (header.len() + 11).div_ceil(64) * 64 - 10;
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((width as u16).to_le_bytes());
        bytes.extend(format!("{header:<0$}\n", width - 1).bytes());
        bytes.extend(body);
        std::fs::write(path, bytes).unwrap();
    }

    fn temperature(i: usize, p: DVec3) -> f64 {
        match i % 50_000 {
            17 => f64::NAN,
            23 => -1.0,
            _ => 300.0 + 40.0 * (2.0 * p.x + p.y).sin() + p.z * p.z,
        }
    }

    fn check(path: &Path, options: &SampleOptions, sizes: &[usize]) -> PointVolume {
        let whole = check_file(path, options, sizes, |ranks| {
            let mut file = RowFile::open(path, None).unwrap().unwrap();
            read_rows(&mut file, options, ranks).unwrap().unwrap()
        });
        whole.volume
    }

    #[test]
    fn bare_points_have_the_neighbours_of_all_ranks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bare.npy");
        let places = places();
        let rows = || places.iter().enumerate();
        let row = |(i, p): (usize, &DVec3)| vec![p.x, p.y, p.z, temperature(i, *p)];
        write(&path, &["x", "y", "z", "temperature"], rows().map(row));
        let plain = SampleOptions {
            function: FunctionOptions {
                scale: None,
                ..FunctionOptions::default()
            },
            ..SampleOptions::default()
        };
        let found = check(&path, &plain, &some(vec![7, 1, 2, 3], 1));
        assert!(found.local_models.is_some() && found.normals.is_none());
        // Discs and needles, whose shapes depend on neighbours of neighbours too.
        let stretched = SampleOptions {
            kernels: KernelOptions {
                shape: ParticleShape::Covariance,
                ..plain.kernels
            },
            field: Some("temperature".into()),
            purpose: PurposeOptions {
                normals: true,
                ..plain.purpose
            },
            function: FunctionOptions {
                scale: Some(ScaleName::Log),
                transfer: TransferChoice::Named("plasma".into()),
                ..plain.function.clone()
            },
            ..plain.clone()
        };
        let found = check(&path, &stretched, &[3]);
        assert!(found.normals.is_some());
        // A sheet: its dimension is estimated from some of its points.
        let path = folder.path().join("sheet.npy");
        let row = |(i, p): (usize, &DVec3)| {
            vec![
                p.x,
                p.y,
                0.01 * p.x * p.y + 1e-4 * random(i),
                temperature(i, *p),
            ]
        };
        write(&path, &["x", "y", "z", "temperature"], rows().map(row));
        let found = check(&path, &plain, &[2]);
        assert!(matches!(
            found.particles,
            crate::scene::Particles::Anisotropic { .. }
        ));
    }

    #[test]
    fn smoothed_particles_show_the_field_that_one_rank_chooses() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("smoothed.npy");
        let places = places();
        // A column that is the same in all rows, as the density here, is not chosen as the field.
        let row = |(i, p): (usize, &DVec3)| {
            vec![
                p.x,
                p.y,
                p.z,
                0.02 + 0.1 * random(i),
                2.0,
                5.0,
                temperature(i, *p),
            ]
        };
        let names = ["x", "y", "z", "h", "m", "rho", "temperature"];
        write(&path, &names, places.iter().enumerate().map(row));
        let options = SampleOptions {
            function: FunctionOptions {
                scale: None,
                unit_distance: Some(0.3),
                ..FunctionOptions::default()
            },
            ..SampleOptions::default()
        };
        check(&path, &options, &some(vec![7, 1, 2], 1));
        let derived = SampleOptions {
            purpose: PurposeOptions {
                local_models: false,
                ..options.purpose
            },
            function: FunctionOptions {
                range: Some([290.0, 400.0]),
                ..options.function
            },
            ..options
        };
        check(&path, &derived, &[3]);
    }

    #[test]
    fn what_looks_at_more_than_neighbours_is_left_to_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let read = |names: &[&str], options: &SampleOptions| {
            write(&path, names, std::iter::repeat_n(vec![1.0; names.len()], 3));
            let own = ThreadRank::group(1).swap_remove(0);
            let mut ranks = own;
            let mut file = RowFile::open(&path, None).unwrap().unwrap();
            read_rows(&mut file, options, &mut ranks).map(|read| read.is_some())
        };
        let plain = SampleOptions::default();
        // Stated strengths, colours, and lengths whose overlaps make up volumes.
        for names in [
            &["x", "y", "z", "sigma", "mass"][..],
            &["x", "y", "z", "r", "g", "b"],
            &["x", "y", "z", "h"],
        ] {
            assert!(!read(names, &plain).unwrap(), "{names:?}");
        }
        let columns = SampleOptions {
            purpose: PurposeOptions {
                for_columns: true,
                ..plain.purpose
            },
            ..plain.clone()
        };
        assert!(!read(&["x", "y", "z"], &columns).unwrap());
        // Three points at one position have no spacing, on any rank.
        let error = read(&["x", "y", "z"], &plain).unwrap_err().to_string();
        assert!(error.contains("distinct"), "{error}");
        assert!(read(&["x", "y", "z", "h", "m", "rho"], &plain).unwrap());
    }
}
