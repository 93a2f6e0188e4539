//! Samples the values from which a transfer function is chosen, with the volumes that they represent.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

#[cfg(feature = "prepared")]
use super::silhouette::RECORDS;
use super::silhouette::Silhouette;
use crate::math::narrowed;
use crate::scene::lattice::Lattice;
use crate::scene::transfer_function::value_scale::ValueScale;
use crate::scene::values::Values;

/// Greatest number of values sampled; more values are sampled evenly. At 2^18 the thousandth at either end is
/// still 262 values.
const SAMPLE_LEN: usize = 1 << 18;

/// Share of the values left outside the range at either end.
const TAIL: f64 = 0.001;

/// Half the width of the column through the middle of a body, as a share of its box's.
const COLUMN_HALF_WIDTH: f64 = 0.125;

/// Least number of sampled particles in a column through the middle, for the column to represent a line.
const LEAST_IN_COLUMN: usize = 32;

/// Bounds on thickness over the cube root of the volume: data below the first are flat, data above the second
/// are not.
const FLATNESS: [f64; 2] = [0.25, 0.5];

/// Whether data include what surrounds the object that they show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Surroundings {
    /// Lattices and grids fill a box, or a channel: with air, with a free stream.
    Included,
    /// Cells of a mesh and particles are the object itself.
    Absent,
}

/// A value, the volume that it represents, and the length that this adds to lines through the middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub(super) value: f64,
    /// \[length³\]
    pub(super) volume: f64,
    /// Number of the data's values that the sample represents.
    pub(super) count: f64,
    /// Length along x, y and z that it adds to a line through the middle.
    pub(super) lengths: [f32; 3],
}

/// The finite values of a field, or 2^18 spread over them, with the volumes that they represent.
#[derive(Debug, Clone, PartialEq)]
pub struct ValueSample {
    /// In rising order.
    pub(super) samples: Vec<Sample>,
    pub(super) surroundings: Surroundings,
    /// Whether [`Sample::lengths`] are known.
    pub(super) has_lengths: bool,
    /// The area that the data cover, if it is known.
    pub(super) silhouette: Option<Silhouette>,
}

/// Whether samples with positions tile space.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tiling {
    /// Cells and nodes of grids.
    Whole,
    /// Particles may leave gaps.
    Loose,
}

impl ValueSample {
    /// A sample of a lattice or a grid, which fills its box.
    ///
    /// - `volumes`: the volume that each value represents \[length³\]; if empty, each represents a cube of
    ///   `spacing`.
    pub fn of_grid(values: &Values, volumes: &[f32], spacing: f64) -> Self {
        let volume = |i: usize| volumes.get(i).copied().map_or(spacing.powi(3), f64::from);
        Self::new(values, volume, Surroundings::Included, &[], Tiling::Whole)
    }

    /// A sample of a lattice, with the area that the lattice covers.
    ///
    /// - `spacing`: the spacing of [`Self::of_grid`].
    pub(crate) fn of_lattice(values: &Values, lattice: &Lattice, spacing: f64) -> Self {
        Self {
            silhouette: Silhouette::of_lattice(lattice),
            ..Self::of_grid(values, &[], spacing)
        }
    }

    /// A sample of kernels that tile space.
    pub(crate) fn of_cells(
        values: &Values,
        volumes: &[f32],
        positions: &[DVec3],
        surroundings: Surroundings,
    ) -> Self {
        let volume = |i: usize| volumes.get(i).copied().map_or(1.0, f64::from);
        Self::new(values, volume, surroundings, positions, Tiling::Whole)
    }

    /// The sample that [`Self::of_lattice`] returns, from values that several ranks hold.
    ///
    /// - `values`: the values of [`ValueSample::picked`], in any order.
    pub(crate) fn of_picked(values: &[f64], lattice: &Lattice, spacing: f64) -> Self {
        let count = lattice.len();
        let stands_for = count as f64 / picked(count).len().max(1) as f64;
        let row = |value: &f64| PickedRow {
            row: 0,
            position: [0.0; 3],
            volume: spacing.powi(3),
            value: *value,
        };
        let rows: Vec<PickedRow> = values.iter().map(row).collect();
        Self {
            silhouette: Silhouette::of_lattice(lattice),
            ..Self::of_sample(&rows, stands_for, Surroundings::Included, None)
        }
    }

    /// Indices of the values that are sampled out of `count`.
    pub(crate) fn picked(count: usize) -> Vec<usize> {
        picked(count)
    }

    /// A sample of cells or particles, with nothing around them.
    ///
    /// - `volumes`: the volume that each value represents \[length³\]; if empty, all represent the same.
    /// - `positions`: the position of each; if empty, a line through the data is as long as the cube root of their volume.
    pub fn of_body(values: &Values, volumes: &[f32], positions: &[DVec3]) -> Self {
        let volume = |i: usize| volumes.get(i).copied().map_or(1.0, f64::from);
        let (surroundings, tiling) = (Surroundings::Absent, Tiling::Loose);
        Self::new(values, volume, surroundings, positions, tiling)
    }

    /// Makes the sample of [`Self::of_body`] from particles made of some rows of a table.
    ///
    /// - `rows`: the rows of [`picked`](PickedRow::picked) that have particles, in their order.
    /// - `count`: number of all rows.
    pub(crate) fn of_rows(
        rows: &[PickedRow],
        count: usize,
        surroundings: Surroundings,
        tiling: Tiling,
    ) -> Self {
        let stands_for = count as f64 / picked(count).len().max(1) as f64;
        Self::of_sample(rows, stands_for, surroundings, Some(tiling))
    }

    fn new(
        values: &Values,
        volume: impl Fn(usize) -> f64,
        surroundings: Surroundings,
        positions: &[DVec3],
        tiling: Tiling,
    ) -> Self {
        let picked = picked(values.len());
        let count = values.len() as f64 / picked.len().max(1) as f64;
        let row = |i: usize| PickedRow {
            row: i as u64,
            position: positions.get(i).map_or([0.0; 3], DVec3::to_array),
            volume: volume(i),
            value: values.wide(i),
        };
        let rows: Vec<PickedRow> = picked.into_iter().map(row).collect();
        let tiling = (!positions.is_empty()).then_some(tiling);
        Self::of_sample(&rows, count, surroundings, tiling)
    }

    /// - `count`: number of values that each row represents.
    /// - `tiling`: tiling of rows that have positions.
    fn of_sample(
        rows: &[PickedRow],
        count: f64,
        surroundings: Surroundings,
        tiling: Option<Tiling>,
    ) -> Self {
        let is_sound =
            |row: &&PickedRow| row.value.is_finite() && row.volume > 0.0 && row.volume.is_finite();
        let rows: Vec<&PickedRow> = rows.iter().filter(is_sound).collect();
        let places: Vec<DVec3> = rows.iter().map(|row| row.position.into()).collect();
        let has_lines = tiling.is_some() && surroundings == Surroundings::Absent;
        let column = has_lines.then(|| Column::through(&places)).flatten();
        let volumes: Vec<f64> = rows.iter().map(|row| row.volume).collect();
        let silhouette = tiling
            .and_then(|tiling| Silhouette::of_places(&places, &volumes, tiling == Tiling::Loose));
        let mut samples: Vec<Sample> = rows
            .iter()
            .zip(places)
            .map(|(row, place)| {
                let volume = row.volume * count;
                let lengths = column
                    .as_ref()
                    .map_or([0.0; 3], |column| column.lengths(place, volume));
                Sample {
                    value: row.value,
                    volume,
                    count,
                    lengths,
                }
            })
            .collect();
        samples.sort_unstable_by(|a, b| a.value.total_cmp(&b.value));
        Self {
            samples,
            surroundings,
            has_lengths: column.is_some(),
            silhouette,
        }
    }

    /// The records that [`Self::joined`] needs: the area that the data cover, if it is known; value, volume and count of each
    /// sample; whether there are surroundings.
    #[cfg(feature = "prepared")]
    pub(crate) fn to_records(&self) -> (Vec<[f64; 3]>, bool) {
        let record = |s: &Sample| [s.value, s.volume, s.count];
        let has_surroundings = self.surroundings == Surroundings::Included;
        let silhouette = self
            .silhouette
            .map_or([[f64::NAN; 3]; RECORDS], Silhouette::to_records);
        let samples = self.samples.iter().map(record);
        (
            silhouette.into_iter().chain(samples).collect(),
            has_surroundings,
        )
    }

    /// The sample that the records of [`Self::to_records`] store, without lengths.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_records(records: &[[f64; 3]], has_surroundings: bool) -> Self {
        let sample = |&[value, volume, count]: &[f64; 3]| Sample {
            value,
            volume,
            count,
            lengths: [0.0; 3],
        };
        let (silhouette, samples) = match records.split_first_chunk::<RECORDS>() {
            Some((silhouette, samples)) => (Some(*silhouette), samples),
            None => (None, records),
        };
        let is_known = |s: &[[f64; 3]; RECORDS]| s.as_flattened().iter().all(|x| x.is_finite());
        Self {
            silhouette: silhouette.filter(is_known).map(Silhouette::of_records),
            samples: samples.iter().map(sample).collect(),
            surroundings: match has_surroundings {
                true => Surroundings::Included,
                false => Surroundings::Absent,
            },
            has_lengths: false,
        }
    }

    /// The joined samples of several data sets that show one field. They have surroundings if any of these has.
    pub fn joined(parts: impl IntoIterator<Item = Self>) -> Option<Self> {
        let mut parts = parts.into_iter();
        let mut all = parts.next()?;
        for part in parts {
            all.samples.extend(part.samples);
            all.has_lengths = false;
            let silhouettes = all.silhouette.zip(part.silhouette);
            all.silhouette = silhouettes.map(|(own, part)| own.joined(part));
            if part.surroundings == Surroundings::Included {
                all.surroundings = Surroundings::Included;
            }
        }
        all.samples
            .sort_unstable_by(|a, b| a.value.total_cmp(&b.value));
        Some(all)
    }

    /// The joined samples of time steps that show one field, with the mean of their volumes.
    #[cfg(feature = "prepared")]
    pub(crate) fn mean(steps: Vec<Self>) -> Option<Self> {
        let share = 1.0 / steps.len().max(1) as f64;
        let mut all = Self::joined(steps)?;
        for s in &mut all.samples {
            s.volume *= share;
        }
        Some(all)
    }

    /// Whether single precision cannot represent all of the values.
    pub(super) fn is_wide(&self) -> bool {
        let is_same = |s: &Sample| f64::from(narrowed(s.value)).to_bits() == s.value.to_bits();
        !self.samples.iter().all(is_same)
    }

    /// The thickness \[length\] of flat data along a view that crosses it, and their flatness, above 0 to 1;
    /// `None` if the data are not flat.
    pub(super) fn flat(&self) -> Option<(f64, f64)> {
        let volume = self.volume();
        let (thickness, volume) = self.silhouette?.thickness(volume)?;
        let [flat, full] = FLATNESS;
        let flatness = ((full - thickness / volume.cbrt()) / (full - flat)).min(1.0);
        (flatness > 0.0).then_some((thickness, flatness))
    }

    /// The volume of all samples \[length³\].
    pub(super) fn volume(&self) -> f64 {
        self.samples.iter().map(|s| s.volume).sum()
    }

    /// The range of values without a thousandth at either end; the whole range if nothing would be left. `None`
    /// if no value is finite.
    pub(super) fn trimmed_range(&self) -> Option<[f64; 2]> {
        let whole = [self.samples.first()?.value, self.samples.last()?.value];
        let trimmed = [
            self.at_share(TAIL, |s| s.count)?,
            self.at_share(1.0 - TAIL, |s| s.count)?,
        ];
        Some(if trimmed[0] < trimmed[1] {
            trimmed
        } else {
            whole
        })
    }

    /// The value below which a share of the volume lies.
    pub(super) fn at_volume(&self, share: f64) -> Option<f64> {
        self.at_share(share, |s| s.volume)
    }

    /// The value below which a share of the values lies.
    pub(super) fn at_count(&self, share: f64) -> Option<f64> {
        self.at_share(share, |s| s.count)
    }

    fn at_share(&self, share: f64, weight: impl Fn(&Sample) -> f64) -> Option<f64> {
        let wanted = share * self.samples.iter().map(&weight).sum::<f64>();
        let mut up_to = 0.0;
        let is_there = |s: &&Sample| {
            up_to += weight(s);
            up_to > wanted
        };
        let found = self.samples.iter().find(is_there);
        Some(found.or(self.samples.last())?.value)
    }

    /// The length of a line through the data, with each sample weighted by its `share`: the median of the lines
    /// along x, y and z. If these are not known, the line is as long as the volume's cube root. For flat data
    /// the line crosses them.
    pub(super) fn length_in(&self, share: impl Fn(&Sample) -> f64) -> f64 {
        let total = self.volume();
        let mean = self
            .samples
            .iter()
            .map(|s| s.volume * share(s))
            .sum::<f64>()
            / total;
        let cube = total.cbrt();
        let length = match self.has_lengths {
            false => cube * mean,
            true => {
                let along = |axis: usize| -> f64 {
                    let of = |s: &Sample| f64::from(s.lengths[axis]) * share(s);
                    self.samples.iter().map(of).sum()
                };
                let mut lengths = [0, 1, 2].map(along);
                lengths.sort_unstable_by(f64::total_cmp);
                lengths[1]
            }
        };
        match self.flat() {
            Some((thickness, flatness)) if length > 0.0 => {
                length.powf(1.0 - flatness) * (thickness * mean).powf(flatness)
            }
            _ => length,
        }
    }
}

/// A row of a table whose value is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PickedRow {
    pub(crate) row: u64,
    pub(crate) position: [f64; 3],
    /// The volume that it represents \[length³\].
    pub(crate) volume: f64,
    pub(crate) value: f64,
}

impl PickedRow {
    /// Indices of the rows that are sampled out of `count`, whether or not they have particles.
    pub(crate) fn picked(count: usize) -> Vec<usize> {
        picked(count)
    }
}

/// Indices of the values that are sampled out of `n`.
#[expect(
    clippy::cast_possible_truncation,
    reason = "an index below the count of values"
)]
fn picked(n: usize) -> Vec<usize> {
    if n <= SAMPLE_LEN {
        return (0..n).collect();
    }
    // One from each of SAMPLE_LEN equal runs, at an index chosen by hashing: a fixed stride would meet the same
    // columns of every row.
    (0..SAMPLE_LEN as u64)
        .map(|k| {
            let first = (u128::from(k) * n as u128 / SAMPLE_LEN as u128) as u64;
            let next = (u128::from(k + 1) * n as u128 / SAMPLE_LEN as u128) as u64;
            (first + split_mix(k) % (next - first).max(1)) as usize
        })
        .collect()
}

/// The output function of SplitMix64 (Steele, Lea, Flood 2014).
pub(super) fn split_mix(k: u64) -> u64 {
    let z = k.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Columns along the axes through the middle of the positions' box, a quarter of it wide.
struct Column {
    middle: DVec3,
    half: DVec3,
}

impl Column {
    /// Columns through most of the positions, without a thousandth at either end of each axis. `None` if a
    /// column has too few positions to represent a line, or no width.
    fn through(positions: &[DVec3]) -> Option<Self> {
        let mut ends = [[0.0; 2]; 3];
        for (axis, ends) in ends.iter_mut().enumerate() {
            let mut along: Vec<f64> = positions.iter().map(|p| p[axis]).collect();
            along.sort_unstable_by(f64::total_cmp);
            let last = along.len().checked_sub(1)?;
            let tail = last / 1000;
            *ends = [along[tail], along[last - tail]];
        }
        let [lo, hi] = [0, 1].map(|end| DVec3::from(ends.map(|of_axis| of_axis[end])));
        let column = Self {
            middle: 0.5 * (lo + hi),
            half: COLUMN_HALF_WIDTH * (hi - lo),
        };
        let has_enough = |axis: usize| {
            let within = |&&p: &&DVec3| column.has(p)[axis];
            positions
                .iter()
                .filter(within)
                .take(LEAST_IN_COLUMN)
                .count()
                == LEAST_IN_COLUMN
        };
        (column.half.min_element() > 0.0 && (0..3).all(has_enough)).then_some(column)
    }

    /// Whether a position lies in the columns along x, y and z.
    fn has(&self, position: DVec3) -> [bool; 3] {
        let is_near = (position - self.middle).abs().cmple(self.half);
        [0, 1, 2].map(|axis| is_near.test((axis + 1) % 3) && is_near.test((axis + 2) % 3))
    }

    /// The length that a volume at a position adds to lines along x, y and z.
    fn lengths(&self, position: DVec3, volume: f64) -> [f32; 3] {
        let is_in = self.has(position);
        [0, 1, 2].map(|axis| {
            let area = 4.0 * self.half[(axis + 1) % 3] * self.half[(axis + 2) % 3];
            #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
            let length = (volume / area) as f32;
            if is_in[axis] { length } else { 0.0 }
        })
    }
}

impl ValueSample {
    /// The same sample, with positions on a scale in place of values.
    pub(super) fn on(&self, scale: ValueScale) -> Self {
        let mut sample = self.clone();
        let least = match scale {
            ValueScale::Log => {
                let mut positions = self.samples.iter().map(|s| scale.position(s.value));
                positions.find(|p| p.is_finite())
            }
            _ => None,
        };
        for s in &mut sample.samples {
            // Values are clamped as in ValueScale::positions.
            let position = scale
                .position(s.value)
                .max(least.unwrap_or(f32::NEG_INFINITY));
            s.value = f64::from(position);
        }
        sample
    }
}
