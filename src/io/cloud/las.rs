//! Reads point clouds of laser scanners in LAS 1.0 to 1.4 (`.las`), little-endian.
//!
//! | bytes | contents |
//! |---|---|
//! | 0 to 4 | `LASF` |
//! | 24, 25 | version |
//! | 94, 96 | size of the header (u16), start of the points (u32) |
//! | 100 | number of records between header and points (u32); each has a header of 54 bytes, with an id at 18 and a length at 20 |
//! | 104, 105 | format of a point, whose upper two bits mark points packed by LAZ; bytes of a point (u16) |
//! | 107 | number of points (u32); from version 1.4 also at 247 (u64) |
//! | 131, 155 | scale and offset along x, y and z (f64) |
//!
//! A point begins with x, y, z (i32, times the scale plus the offset) and the intensity (u16). Then follow:
//!
//! | formats | returns, flags | class | angle | user, source | time | colour, infrared | bytes |
//! |---|---|---|---|---|---|---|---|
//! | 0 to 5 | 14 | 15, five bits | 16 (i8) | 17, 18 | 20: 1, 3, 4, 5 | 20: 2; 28: 3, 5 | 20, 28, 26, 34, 57, 63 |
//! | 6 to 10 | 14, 15 | 16 | 18 (i16, .006 degrees) | 17, 20 | 22 | 30: 7, 8, 10; 36: 8, 10 | 30, 36, 38, 59, 67 |
//!
//! Further bytes are user-defined fields. A record of id 4 of `LASF_Spec` describes them, 192 bytes each. Columns that
//! are 0 everywhere were not measured and are left out. Points flagged as withheld count as deleted.
//!
//! <https://www.asprs.org/wp-content/uploads/2019/07/LAS_1_4_r15.pdf>

use std::path::Path;

use glam::DVec3;

use super::{DAMAGED, colour_fields};
use crate::data::dataset::{Dataset, Field};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles, values};
use crate::io::particles::table::{dataset, scalar_field};
use crate::io::vtk::xml::clip;
use crate::math::narrowed;
use crate::scene::{Values, of_any_type};

/// First bytes of a file.
pub(in crate::io) const MAGIC: &[u8] = b"LASF";

/// Length in bytes of the header of a record between header and points.
const RECORD_HEADER: usize = 54;

/// Length in bytes of the description of a user-defined field.
const DESCRIPTION: usize = 192;

/// Length in bytes of a point in each format.
const SIZES: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Advice for LAZ files, which are refused. GPS times in LAZ may switch to another sequence any number of times within
/// a point. The decoder `laz` 0.13 recurses at each switch, so a few damaged bytes overflow the stack and end the
/// program. No check of the file's lengths prevents this.
const UNPACK: &str = "unpack them: `las2las -i in.laz -o out.las`, `pdal translate in.laz out.las`, or `laspy decompress in.laz` \
                      (of the Python package `laspy[cli,lazrs]`)";

/// Reads a point cloud.
///
/// # Errors
/// Points are packed by LAZ, their format is unknown, or there are fewer points than the header states.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let file = Las::of(path, &bytes)?;
    let mut notes = Vec::new();
    let withheld = file.withheld()?;
    let is_kept = |i: usize| withheld.as_ref().is_none_or(|withheld| !withheld[i]);
    let mut positions = file.positions()?;
    let mut fields = file.fields(&mut notes)?;
    if let Some(withheld) = &withheld {
        let count = withheld.iter().filter(|w| **w).count();
        notes.push(format!(
            "{count} points that are flagged as withheld are left out."
        ));
        let mut index = 0..;
        positions.retain(|_| index.next().is_some_and(is_kept));
        for field in &mut fields {
            if let crate::io::FieldSource::Scalar(values) = &mut field.source {
                retain(values, is_kept);
            }
        }
    }
    Ok(Dataset {
        notes,
        ..dataset(path, "LAS point cloud", positions, fields)?
    })
}

fn retain(values: &mut Values, is_kept: impl Fn(usize) -> bool) {
    fn keep<T>(values: &mut Vec<T>, is_kept: impl Fn(usize) -> bool) {
        let mut index = 0..;
        values.retain(|_| index.next().is_some_and(&is_kept));
    }
    of_any_type!(values, values => keep(values, is_kept));
}

/// File whose header agrees with its bytes.
struct Las<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    format: u8,
    /// Offset of the points, and bytes of each.
    start: usize,
    size: usize,
    count: usize,
    header: usize,
}

impl<'a> Las<'a> {
    fn of(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let fault = |place: &str, expected: String, found: String| {
            Error::format(path, place, expected, found, DAMAGED)
        };
        let short = || {
            let expected = "at least 227 bytes of header".to_owned();
            fault("header", expected, format!("{} bytes", bytes.len()))
        };
        let head = bytes.get(..227).ok_or_else(short)?;
        let word = |at: usize| usize::from(u16::from_le_bytes([head[at], head[at + 1]]));
        let long = |at: usize| word(at) | word(at + 2) << 16;
        let (major, minor) = (head[24], head[25]);
        if major != 1 || minor > 4 {
            let expected = "1.0 to 1.4".to_owned();
            return Err(fault("version", expected, format!("{major}.{minor}")));
        }
        if head[104] & 0xc0 != 0 {
            return Err(Error::format(
                path,
                "points",
                "LAS, which is not compressed",
                "points that are packed by LAZ, which are not read",
                UNPACK,
            ));
        }
        let format = head[104];
        let Some(least) = SIZES.get(usize::from(format)) else {
            let expected = "a format of points from 0 to 10".to_owned();
            return Err(fault("header, byte 104", expected, format.to_string()));
        };
        let size = word(105);
        if size < *least {
            let expected = format!("at least {least} bytes for a point of format {format}");
            return Err(fault("header, byte 105", expected, size.to_string()));
        }
        let header = word(94);
        let mut count = long(107) as u64;
        if let (4, Some(wide)) = (minor, bytes.get(247..255).filter(|_| header >= 375)) {
            let wide = wide.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b));
            // Some writers set only the old field.
            count = if wide == 0 { count } else { wide };
        }
        let start = long(96);
        let there = bytes.len().saturating_sub(start) / size;
        let is_there = start >= 227 && count <= there as u64;
        let count = usize::try_from(count).ok().filter(|_| is_there);
        let count = count.ok_or_else(|| {
            let expected = "as many points as the header says, behind it".to_owned();
            let found = format!("{there} points of {size} bytes from byte {start} on");
            fault("points", expected, found)
        })?;
        Ok(Self {
            path,
            bytes,
            format,
            start,
            size,
            count,
            header,
        })
    }

    fn double(&self, at: usize) -> f64 {
        let mut number = [0; 8];
        number.copy_from_slice(&self.bytes[at..at + 8]);
        f64::from_le_bytes(number)
    }

    fn place(&self, scalar: ScalarType, at: usize) -> (Encoding, Stride) {
        let encoding = Encoding {
            scalar,
            big_endian: false,
        };
        let stride = Stride {
            first: self.start + at,
            step: self.size,
            count: self.count,
        };
        (encoding, stride)
    }

    fn damaged(&self) -> Error {
        Error::format(self.path, "points", "whole points", "the end", DAMAGED)
    }

    fn column(&self, scalar: ScalarType, at: usize) -> Result<Values> {
        let (encoding, stride) = self.place(scalar, at);
        values(self.bytes, encoding, stride).ok_or_else(|| self.damaged())
    }

    fn numbers(&self, scalar: ScalarType, at: usize) -> Result<Vec<f64>> {
        let (encoding, stride) = self.place(scalar, at);
        doubles(self.bytes, encoding, stride).ok_or_else(|| self.damaged())
    }

    /// Reads some bits of a byte of each point.
    fn bits(&self, at: usize, shift: u32, mask: u8) -> Result<Values> {
        Ok(match self.column(ScalarType::U8, at)? {
            Values::U8(bytes) => Values::U8(bytes.iter().map(|b| b >> shift & mask).collect()),
            other => other,
        })
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        let mut positions = vec![DVec3::ZERO; self.count];
        for axis in 0..3 {
            let (scale, offset) = (self.double(131 + 8 * axis), self.double(155 + 8 * axis));
            if !(scale.is_finite() && scale != 0.0 && offset.is_finite()) {
                let place = "header, the scales and offsets";
                let found = format!("{scale} and {offset}");
                let expected = "finite numbers and no scale of 0";
                return Err(Error::format(self.path, place, expected, found, DAMAGED));
            }
            let column = self.numbers(ScalarType::I32, 4 * axis)?;
            for (position, x) in positions.iter_mut().zip(column) {
                position[axis] = x * scale + offset;
            }
        }
        Ok(positions)
    }

    /// Returns the points that count as deleted; `None` if there are none.
    fn withheld(&self) -> Result<Option<Vec<bool>>> {
        let (at, bit) = if self.format < 6 { (15, 7) } else { (15, 2) };
        let Values::U8(flags) = self.bits(at, bit, 1)? else {
            return Ok(None);
        };
        let withheld: Vec<bool> = flags.iter().map(|flag| *flag == 1).collect();
        Ok(withheld.contains(&true).then_some(withheld))
    }

    fn fields(&self, notes: &mut Vec<String>) -> Result<Vec<Field>> {
        use ScalarType as S;
        let is_new = self.format >= 6;
        let mut columns = vec![("intensity", self.column(S::U16, 12)?)];
        columns.extend(match is_new {
            false => [
                ("classification", self.bits(15, 0, 0x1f)?),
                ("return_number", self.bits(14, 0, 7)?),
                ("number_of_returns", self.bits(14, 3, 7)?),
                ("scan_angle", self.column(S::I8, 16)?),
                ("user_data", self.column(S::U8, 17)?),
                ("point_source_id", self.column(S::U16, 18)?),
            ],
            true => [
                ("classification", self.column(S::U8, 16)?),
                ("return_number", self.bits(14, 0, 15)?),
                ("number_of_returns", self.bits(14, 4, 15)?),
                ("scan_angle", degrees(self.numbers(S::I16, 18)?)),
                ("user_data", self.column(S::U8, 17)?),
                ("point_source_id", self.column(S::U16, 20)?),
            ],
        });
        if matches!(self.format, 8 | 10) {
            columns.push(("infrared", self.column(S::U16, 36)?));
        }
        let time = match self.format {
            1 | 3..=5 => Some(20),
            6..=10 => Some(22),
            _ => None,
        };
        if let Some(at) = time {
            columns.push(("gps_time", since_the_first(self.numbers(S::F64, at)?)));
        }
        let mut fields: Vec<Field> = columns
            .into_iter()
            .filter(|(_, column)| is_measured(column))
            .map(|(name, column)| scalar_field(name, column))
            .collect();
        if fields.iter().any(|field| field.name == "gps_time") {
            notes.push("Times are seconds since the first point that was measured.".to_owned());
        }
        fields.extend(self.colours()?);
        fields.extend(self.extra(notes)?);
        Ok(fields)
    }

    /// Reads the colours. All black means that they were not measured, and returns none.
    fn colours(&self) -> Result<Vec<Field>> {
        let at = match self.format {
            2 => 20,
            3 | 5 => 28,
            7 | 8 | 10 => 30,
            _ => return Ok(Vec::new()),
        };
        let mut channels = [const { Vec::new() }; 3];
        for (i, channel) in channels.iter_mut().enumerate() {
            *channel = self.numbers(ScalarType::U16, at + 2 * i)?;
        }
        let most = channels.iter().flatten().copied().fold(0.0, f64::max);
        if most == 0.0 {
            return Ok(Vec::new());
        }
        // The format prescribes 16-bit values, but many writers store 8-bit ones.
        let whole = if most <= 255.0 { 255.0 } else { 65535.0 };
        Ok(colour_fields(channels.map(|channel| {
            channel.iter().map(|x| narrowed(x / whole)).collect()
        })))
    }

    /// Reads the user-defined fields, which follow those of the format.
    fn extra(&self, notes: &mut Vec<String>) -> Result<Vec<Field>> {
        let mut at = SIZES[usize::from(self.format)];
        let mut fields = Vec::new();
        for description in self.descriptions() {
            let (kind, options) = (description[2], description[3]);
            let name = text(&description[4..36]);
            let scalar = match kind {
                1 => ScalarType::U8,
                2 => ScalarType::I8,
                3 => ScalarType::U16,
                4 => ScalarType::I16,
                5 => ScalarType::U32,
                6 => ScalarType::I32,
                7 => ScalarType::U64,
                8 => ScalarType::I64,
                9 => ScalarType::F32,
                10 => ScalarType::F64,
                0 => {
                    at += usize::from(options);
                    continue;
                }
                // The format has deprecated arrays; the offsets of the fields behind one are unknown.
                _ => {
                    let left = format!("Extra bytes from `{}` on are left out.", clip(&name));
                    notes.push(left);
                    break;
                }
            };
            if at + scalar.size() > self.size {
                notes.push("Extra bytes beyond the end of a point are left out.".to_owned());
                break;
            }
            let number = |first: usize| {
                let mut number = [0; 8];
                number.copy_from_slice(&description[first..first + 8]);
                f64::from_le_bytes(number)
            };
            let is_set = |bit: u8| options >> bit & 1 == 1;
            let column = match (is_set(3), is_set(4)) {
                (false, false) => self.column(scalar, at)?,
                (scaled, moved) => {
                    let scale = if scaled { number(112) } else { 1.0 };
                    let offset = if moved { number(136) } else { 0.0 };
                    let numbers = self.numbers(scalar, at)?;
                    let turned = numbers.iter().map(|x| x * scale + offset);
                    turned.collect::<Vec<f64>>().into()
                }
            };
            at += scalar.size();
            if is_measured(&column) {
                fields.push(scalar_field(name, column));
            }
        }
        Ok(fields)
    }

    /// Returns the descriptions of the extra bytes, one for each field.
    fn descriptions(&self) -> impl Iterator<Item = &'a [u8]> {
        let mut records = self.bytes.get(self.header..self.start).unwrap_or(&[]);
        let mut found: &[u8] = &[];
        while let Some((head, rest)) = records.split_at_checked(RECORD_HEADER) {
            let word = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
            let Some((body, rest)) = rest.split_at_checked(word(20).into()) else {
                break;
            };
            if text(&head[2..18]) == "LASF_Spec" && word(18) == 4 {
                found = body;
            }
            records = rest;
        }
        found.chunks_exact(DESCRIPTION)
    }
}

/// Returns the text up to the first zero.
fn text(bytes: &[u8]) -> String {
    let text = bytes.split(|b| *b == 0).next().unwrap_or(bytes);
    String::from_utf8_lossy(text).trim().to_owned()
}

fn is_measured(column: &Values) -> bool {
    (0..column.len()).any(|i| column.get(i) != 0.0)
}

fn degrees(steps: Vec<f64>) -> Values {
    /// Degrees per step.
    const STEP: f64 = 0.006;
    Values::F32(steps.iter().map(|n| narrowed(n * STEP)).collect())
}

/// Subtracts the earliest time. Seconds of a week, or since 1980, exceed the resolution of single precision.
fn since_the_first(times: Vec<f64>) -> Values {
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    times.iter().map(|t| t - first).collect::<Vec<f64>>().into()
}
