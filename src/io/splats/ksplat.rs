//! Reads KSPLAT (the format of mkkellogg's viewer for three.js): sections of splats, packed or not; little-endian.
//!
//! | bytes | contents |
//! |---|---|
//! | 0, 1 | version 0, 1 |
//! | 4..8 | number of sections S that there is storage for |
//! | 16..20 | number of splats |
//! | 20..22 | mode: 0 unpacked, 1 half floats, 2 also harmonics in bytes |
//! | 36..44 | values of harmonics for bytes 0 and 255, two f32; 0 means -1.5 and 1.5 |
//! | 4096.. | S headers of 1024 bytes |
//! | then | the sections: sizes of partly filled buckets (u32 each), centres of all buckets, records |
//!
//! A section's header:
//!
//! | bytes | contents |
//! |---|---|
//! | 0..4 | number of splats N |
//! | 4..8 | number that there is storage for |
//! | 8..12 | splats of a full bucket |
//! | 12..16 | number of buckets |
//! | 16..20 | side b of a bucket, f32 |
//! | 20..22 | bytes for each bucket's centre, three f32 first |
//! | 24..28 | steps s in half a side; 0 means 32767 |
//! | 32..36, 36..40 | numbers of full and of partly filled buckets |
//! | 40..42 | degree of the harmonics, 0 to 2 |
//!
//! A record:
//!
//! | mode 0 | modes 1, 2 | contents |
//! |---|---|---|
//! | 3 f32 | 3 u16 | position; packed as centre + (n - s) b / 2s |
//! | 3 f32 | 3 halves | standard deviations |
//! | 4 f32 | 4 halves | quaternion w, x, y, z |
//! | 4 u8 | 4 u8 | red, green, blue and peak opacity |
//! | f32 | halves, bytes | degree 1: three coefficients of red, then of green, of blue; then five each of degree 2 |
//!
//! The viewer's reader and those of other programs agree on these facts. The format has no mark of anti-aliased splats.

use std::array;
use std::path::Path;

use glam::DVec3;

use crate::data::dataset::Dataset;
use crate::data::splats::{SplatCloud, constant_of_colour};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::half::half;
use crate::math::{harmonics_count, narrowed};
use crate::scene::SplatRule;

pub(super) const HEADER: usize = 4096;
pub(super) const SECTION_HEADER: usize = 1024;
/// Number of steps in half a bucket's side, if a section does not state it.
const STEPS: u32 = 32_767;
/// Harmonics in bytes range from minus this to this value, if the file states no range.
const HARMONICS_RANGE: f32 = 1.5;
pub(super) const MAX_DEGREE: u8 = 2;

/// Reads splats.
///
/// # Errors
/// The version or mode is not supported, or a section reaches beyond the file.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let file = File {
        path,
        bytes: &bytes,
    };
    let header = file.part(0, HEADER as u64, "header")?;
    let version = [header[0], header[1]];
    if version[0] != 0 || version[1] == 0 {
        return Err(file.fault(
            "header",
            "version 0.1".into(),
            format!("version {}.{}", version[0], version[1]),
        ));
    }
    let mode = Mode::of(header).ok_or_else(|| {
        let found = short(header, 20).to_string();
        file.fault("header", "compression mode 0, 1 or 2".into(), found)
    })?;
    let section_count = u64::from(word(header, 4));
    let headers_len = section_count * SECTION_HEADER as u64;
    let headers = file.part(HEADER as u64, headers_len, "section headers")?;
    let mut at = HEADER as u64 + headers_len;
    let mut cloud = SplatCloud::default();
    for (i, header) in headers.chunks_exact(SECTION_HEADER).enumerate() {
        // Unused sections have headers of zeros.
        if word(header, 0) == 0 && word(header, 4) == 0 {
            continue;
        }
        let section = Section::of(&file, &format!("section {i}"), header, mode, at)?;
        at = section.end;
        if section.count > 0 {
            cloud.append(section.splats(mode));
        }
    }
    let stated = word(header, 16) as usize;
    if cloud.positions.len() != stated {
        let found = format!("{} in its sections", cloud.positions.len());
        return Err(file.fault("header", format!("{stated} splats"), found));
    }
    cloud.dataset(path, "KSPLAT splats", Vec::new())
}

/// Bytes of a file, and its path for errors.
struct File<'a> {
    path: &'a Path,
    bytes: &'a [u8],
}

impl<'a> File<'a> {
    fn fault(&self, place: &str, expected: String, found: String) -> Error {
        let advice = "the file is cut off or damaged: get it again";
        Error::format(self.path, place, expected, found, advice)
    }

    /// Returns `len` bytes from byte `at` on.
    fn part(&self, at: u64, len: u64, place: &str) -> Result<&'a [u8]> {
        let bounds = [Some(at), at.checked_add(len)].map(|n| usize::try_from(n?).ok());
        let part = match bounds {
            [Some(start), Some(end)] => self.bytes.get(start..end),
            _ => None,
        };
        part.ok_or_else(|| {
            let found = format!("{} in the file", self.bytes.len());
            self.fault(place, format!("{len} bytes from byte {at} on"), found)
        })
    }
}

/// Packing of numbers.
#[derive(Clone, Copy)]
struct Mode {
    /// True if positions, scales and rotations are packed.
    is_packed: bool,
    /// Values of harmonics for bytes 0 and 255; `None` if harmonics are not bytes.
    harmonics: Option<[f32; 2]>,
}

impl Mode {
    fn of(header: &[u8]) -> Option<Self> {
        let range = [(36, -HARMONICS_RANGE), (40, HARMONICS_RANGE)].map(|(at, otherwise)| {
            let stated = float(header, at);
            if stated == 0.0 { otherwise } else { stated }
        });
        let (is_packed, harmonics) = match short(header, 20) {
            0 => (false, None),
            1 => (true, None),
            2 => (true, Some(range)),
            _ => return None,
        };
        Some(Self {
            is_packed,
            harmonics,
        })
    }

    /// Returns the number of bytes of a number.
    fn number_len(self) -> usize {
        if self.is_packed { 2 } else { 4 }
    }

    /// Returns the number of bytes before a record's harmonics: ten numbers and four bytes.
    fn harmonics_at(self) -> usize {
        10 * self.number_len() + 4
    }

    fn coefficient_len(self) -> usize {
        if self.harmonics.is_some() {
            1
        } else {
            self.number_len()
        }
    }

    /// Reads a float or half float at byte `at`.
    fn float(self, record: &[u8], at: usize) -> f32 {
        if self.is_packed {
            narrowed(half(short(record, at)))
        } else {
            float(record, at)
        }
    }

    fn coefficient(self, record: &[u8], k: usize) -> f32 {
        let at = self.harmonics_at() + k * self.coefficient_len();
        match self.harmonics {
            Some([least, most]) => least + f32::from(record[at]) / 255.0 * (most - least),
            None => self.float(record, at),
        }
    }
}

/// Section whose arrays lie within the file.
struct Section<'a> {
    count: usize,
    degree: u8,
    record_len: usize,
    records: &'a [u8],
    /// Number of splats in each bucket.
    bucket_sizes: Vec<u32>,
    bucket_len: usize,
    /// Centres of the buckets, `bucket_len` bytes each.
    centres: &'a [u8],
    /// Length of a step.
    step: f64,
    /// Step at the middle of a bucket.
    middle: f64,
    /// First byte behind the section.
    end: u64,
}

impl<'a> Section<'a> {
    /// - `at`: byte at which it begins.
    fn of(file: &File<'a>, place: &str, header: &[u8], mode: Mode, at: u64) -> Result<Self> {
        let number = |at: usize| u64::from(word(header, at));
        let (count, capacity) = (number(0), number(4).max(number(0)));
        let (full_size, bucket_count) = (word(header, 8), number(12));
        let (full_count, others_count) = (number(32), number(36));
        let bucket_len = u64::from(short(header, 20));
        let degree = short(header, 40);
        let known = u8::try_from(degree)
            .ok()
            .filter(|degree| *degree <= MAX_DEGREE);
        let degree = known.ok_or_else(|| {
            let expected = "harmonics of degree 0, 1 or 2".into();
            file.fault(place, expected, format!("degree {degree}"))
        })?;
        let coefficient_count = 3 * (harmonics_count(degree) - 1);
        let record_len = mode.harmonics_at() + coefficient_count * mode.coefficient_len();
        let sizes = file.part(at, 4 * others_count, place)?;
        let centres_at = at + 4 * others_count;
        let centres = file.part(centres_at, bucket_len * bucket_count, place)?;
        let records_at = centres_at + bucket_len * bucket_count;
        let records = file.part(records_at, count * record_len as u64, place)?;
        let buckets = full_count.saturating_add(others_count);
        let mut bucket_sizes = Vec::new();
        if mode.is_packed && count > 0 {
            // Each bucket has a centre in the file, which bounds their number.
            if bucket_len < 12 || buckets > bucket_count {
                let found = format!("{bucket_count} of {bucket_len} bytes");
                let expected = format!("centres of {buckets} buckets, 12 bytes each or more");
                return Err(file.fault(place, expected, found));
            }
            bucket_sizes.extend((0..full_count).map(|_| full_size));
            bucket_sizes.extend(sizes.chunks_exact(4).map(|size| word(size, 0)));
            let held: u64 = bucket_sizes.iter().map(|size| u64::from(*size)).sum();
            if held < count {
                let found = format!("{held} in its buckets");
                return Err(file.fault(place, format!("{count} splats"), found));
            }
        }
        let steps = match word(header, 24) {
            0 => STEPS,
            stated => stated,
        };
        let room = capacity.saturating_mul(record_len as u64);
        // All these lie within `bytes`, so they fit into an usize.
        let size = |x: u64| usize::try_from(x).unwrap_or(usize::MAX);
        Ok(Self {
            count: size(count),
            degree,
            record_len,
            records,
            bucket_sizes,
            bucket_len: size(bucket_len),
            centres,
            step: f64::from(float(header, 16)) / 2.0 / f64::from(steps),
            middle: f64::from(steps),
            end: records_at.saturating_add(room),
        })
    }

    fn splats(&self, mode: Mode) -> SplatCloud {
        let coefficient_count = 3 * harmonics_count(self.degree);
        let mut cloud = SplatCloud {
            positions: Vec::with_capacity(self.count),
            scales: Vec::with_capacity(self.count),
            rotations: Vec::with_capacity(self.count),
            opacities: Vec::with_capacity(self.count),
            harmonics_degree: self.degree,
            harmonics: Vec::with_capacity(coefficient_count * self.count),
            rule: SplatRule::Inria,
            ..SplatCloud::default()
        };
        let (mut bucket, mut left) = (0, self.bucket_sizes.first().copied().unwrap_or(0));
        let number_len = mode.number_len();
        for record in self.records.chunks_exact(self.record_len) {
            // Some buckets may be empty; `of` has checked that there are enough splats.
            while mode.is_packed && left == 0 {
                bucket += 1;
                left = self.bucket_sizes.get(bucket).copied().unwrap_or(u32::MAX);
            }
            left = left.saturating_sub(1);
            let position = if mode.is_packed {
                let centre = &self.centres[bucket * self.bucket_len..];
                array::from_fn(|axis| {
                    let steps = f64::from(short(record, 2 * axis)) - self.middle;
                    f64::from(float(centre, 4 * axis)) + steps * self.step
                })
            } else {
                array::from_fn(|axis| f64::from(float(record, 4 * axis)))
            };
            cloud.positions.push(DVec3::from_array(position));
            let number = |k: usize| mode.float(record, k * number_len);
            cloud.scales.push(array::from_fn(|k| number(3 + k)));
            cloud.rotations.push(array::from_fn(|k| number(6 + k)));
            let code = |k: usize| f32::from(record[10 * number_len + k]) / 255.0;
            cloud.opacities.push(code(3));
            cloud
                .harmonics
                .extend((0..3).map(|c| constant_of_colour(code(c))));
            for degree in 1..=usize::from(self.degree) {
                // Coefficients of lower degrees come first, then `count` for each channel.
                let (before, count) = (3 * (degree * degree - 1), 2 * degree + 1);
                for k in 0..count {
                    let of = |channel| mode.coefficient(record, before + channel * count + k);
                    cloud.harmonics.extend([0, 1, 2].map(of));
                }
            }
        }
        cloud
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array::from_fn(|i| bytes[at + i]))
}

fn short(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(word(bytes, at))
}
