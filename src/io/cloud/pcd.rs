//! Reads point clouds of the Point Cloud Library (`.pcd`).
//!
//! ```text
//! # .PCD v0.7 - Point Cloud Data file format
//! VERSION 0.7
//! FIELDS x y z rgb
//! SIZE 4 4 4 4
//! TYPE F F F F
//! COUNT 1 1 1 1
//! WIDTH 213
//! HEIGHT 1
//! VIEWPOINT 0 0 0 1 0 0 0
//! POINTS 213
//! DATA ascii
//! ```
//!
//! The points follow. `ascii`: a line each. `binary`: one after the other, little-endian. `binary_compressed`:
//! the number of packed and of unpacked bytes (u32 each), then all numbers field by field, packed by LZF. `rgb`
//! and `rgba` are the bits of a u32, 0xAARRGGBB, whatever their type.
//!
//! <https://pointclouds.org/documentation/tutorials/pcd_file_format.html>

use std::borrow::Cow;
use std::path::Path;

use super::{DAMAGED, colour_fields};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, values};
use crate::io::particles::table::{dataset, scalar_field};
use crate::io::ply::table::{Member, Rows, Table};
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// Greatest number of bytes that LZF makes from one byte: 264 from three.
const LZF_RATIO: usize = 88;

/// The default viewpoint: at the origin, not rotated.
const NOWHERE: [f64; 7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// Whether a file begins as this format: with the comment of its writers, or with the version.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let mut lines = head.split(|b| *b == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"#"));
    let is_named = head.starts_with(b"# .PCD");
    is_named
        || first
            .is_some_and(|line| line.starts_with(b"VERSION .7") || line.starts_with(b"VERSION 0.7"))
}

/// Reads a cloud.
///
/// # Errors
/// A header that breaks the format's rules, or points that do not agree with it.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let header = Header::of(path, &bytes)?;
    let body = &bytes[header.end..];
    let data = match header.data.as_str() {
        "ascii" => Cow::Owned(header.parsed(body)?),
        "binary" => Cow::Borrowed(body),
        "binary_compressed" => Cow::Owned(header.unpacked(body)?),
        other => {
            let expected = "ascii, binary or binary_compressed";
            return Err(header.fault("DATA", expected, other));
        }
    };
    let rows = Rows {
        count: header.count,
        step: header.size,
        big_endian: false,
        members: header.members(),
        data,
    };
    // Rows are read by count: all must be there.
    if rows.data.len() / header.size.max(1) < header.count {
        let found = format!("{} bytes", rows.data.len());
        let expected = format!("{} points of {} bytes", header.count, header.size);
        return Err(Error::format(path, "points", expected, found, DAMAGED));
    }
    let table = Table { path, rows: &rows };
    let (positions, used) = table.positions()?;
    let used: Vec<&str> = used
        .iter()
        .map(|i| rows.members[*i].name.as_str())
        .collect();
    let mut fields = Vec::new();
    for column in &header.columns {
        if !used.contains(&column.name.as_str()) && column.name != "_" && column.count > 0 {
            fields.extend(column.fields(path, &rows)?);
        }
    }
    let mut notes = Vec::new();
    let mut placed = header.viewpoint.iter().zip(NOWHERE);
    if placed.any(|(stated, nowhere)| *stated != nowhere) {
        notes.push(
            "The viewpoint, where the sensor was, is left out: points are where their coordinates say."
                .to_owned(),
        );
    }
    Ok(Dataset {
        notes,
        ..dataset(path, "PCD point cloud", positions, fields)?
    })
}

/// A field of the points.
#[derive(Debug, Clone)]
struct Column {
    name: String,
    scalar: ScalarType,
    /// Numbers per point.
    count: usize,
    /// Offset within a point.
    offset: usize,
}

impl Column {
    fn size(&self) -> usize {
        self.scalar.size() * self.count
    }

    fn component(&self, rows: &Rows<'_>, i: usize, scalar: ScalarType) -> Option<Values> {
        let encoding = Encoding {
            scalar,
            big_endian: false,
        };
        let stride = Stride {
            first: self.offset + i,
            step: rows.step,
            count: rows.count,
        };
        values(&rows.data, encoding, stride)
    }

    fn fields(&self, path: &Path, rows: &Rows<'_>) -> Result<Vec<Field>> {
        let lost = || Error::format(path, "points", "whole points", "the end", DAMAGED);
        if matches!(self.name.as_str(), "rgb" | "rgba") && self.size() == 4 {
            // Blue comes first.
            let mut channels = [const { Vec::new() }; 3];
            for (i, channel) in channels.iter_mut().enumerate() {
                let bytes = self.component(rows, 2 - i, ScalarType::U8);
                let bytes = bytes.ok_or_else(lost)?;
                *channel = (0..bytes.len()).map(|i| bytes.get(i) / 255.0).collect();
            }
            return Ok(colour_fields(channels));
        }
        let numbers = (0..self.count)
            .map(|i| self.component(rows, i * self.scalar.size(), self.scalar))
            .collect::<Option<Vec<Values>>>();
        let mut numbers = numbers.ok_or_else(lost)?;
        Ok(vec![match numbers.len() {
            1 => scalar_field(self.name.clone(), numbers.remove(0)),
            _ => Field {
                name: self.name.clone(),
                association: Association::Nodes,
                source: FieldSource::Vector(numbers),
                unit: None,
            },
        }])
    }
}

struct Header<'p> {
    path: &'p Path,
    columns: Vec<Column>,
    /// Bytes per point.
    size: usize,
    /// Number of points.
    count: usize,
    viewpoint: [f64; 7],
    data: String,
    /// Offset of the points.
    end: usize,
}

impl<'p> Header<'p> {
    fn of(path: &'p Path, bytes: &[u8]) -> Result<Self> {
        /// Greatest number of lines before the points.
        const MOST_LINES: usize = 4096;
        let mut header = Self {
            path,
            columns: Vec::new(),
            size: 0,
            count: 0,
            viewpoint: NOWHERE,
            data: String::new(),
            end: 0,
        };
        let mut lines: Vec<(String, Vec<String>)> = Vec::new();
        for line in bytes.split_inclusive(|b| *b == b'\n').take(MOST_LINES) {
            header.end += line.len();
            let line = String::from_utf8_lossy(line);
            let mut words = line.split_whitespace().map(str::to_owned);
            let Some(key) = words.next().filter(|key| !key.starts_with('#')) else {
                continue;
            };
            let is_last = key.eq_ignore_ascii_case("DATA");
            lines.push((key.to_ascii_uppercase(), words.collect()));
            if is_last {
                break;
            }
        }
        let get = |keys: &[&str]| {
            let mut all = lines.iter();
            all.find(|(key, _)| keys.contains(&key.as_str()))
                .map(|(_, words)| words)
        };
        let Some(data) = get(&["DATA"]).and_then(|words| words.first()) else {
            return Err(header.fault("DATA", "a line with how points are stored", "none"));
        };
        header.data = data.to_ascii_lowercase();
        let none = || header.fault("FIELDS", "a line with the names of the fields", "none");
        let names = get(&["FIELDS", "COLUMNS"]).ok_or_else(none)?;
        let ones = vec!["1".to_owned(); names.len()];
        let per_field = |key: &str, otherwise: Option<&'_ Vec<String>>| {
            let words = get(&[key]).or(otherwise).cloned().unwrap_or_default();
            match words.len() == names.len() {
                true => Ok(words),
                false => {
                    let found = format!("{} of them", words.len());
                    Err(header.fault(key, "as many words as there are fields", &found))
                }
            }
        };
        let sizes = per_field("SIZE", None)?;
        let types = per_field("TYPE", None)?;
        let counts = per_field("COUNT", Some(&ones))?;
        let mut offset: usize = 0;
        let mut columns = Vec::new();
        for (((name, size), kind), count) in names.iter().zip(&sizes).zip(&types).zip(&counts) {
            let scalar = scalar_type(kind, size)
                .ok_or_else(|| header.fault("TYPE", "I, U or F of 1 to 8 bytes", kind))?;
            // Padding is counted in bytes, and is never larger than a file.
            let count: usize = count
                .parse()
                .ok()
                .filter(|n| *n <= bytes.len())
                .ok_or_else(|| header.fault("COUNT", "a whole number", count))?;
            let column = Column {
                name: name.clone(),
                scalar,
                count,
                offset,
            };
            offset += column.size();
            columns.push(column);
        }
        let whole = |key: &str| {
            let word = get(&[key]).and_then(|words| words.first())?;
            word.parse::<usize>().ok()
        };
        let by_sides = || whole("WIDTH")?.checked_mul(whole("HEIGHT")?);
        let Some(count) = whole("POINTS").or_else(by_sides) else {
            return Err(header.fault("POINTS", "a whole number", "none"));
        };
        if let Some(words) = get(&["VIEWPOINT"]) {
            let numbers: Vec<f64> = words.iter().filter_map(|w| w.parse().ok()).collect();
            header.viewpoint = numbers.try_into().unwrap_or(NOWHERE);
        }
        if offset == 0 || count.checked_mul(offset).is_none() {
            return Err(header.fault("POINTS", "points that fit into memory", "more"));
        }
        header.columns = columns;
        header.size = offset;
        header.count = count;
        Ok(header)
    }

    fn fault(&self, key: &str, expected: &str, found: &str) -> Error {
        let place = format!("header, `{key}`");
        let found = format!("`{}`", clip(found));
        Error::format(self.path, place, expected, found, DAMAGED)
    }

    /// The columns with one number per point.
    fn members(&self) -> Vec<Member> {
        let single = self.columns.iter().filter(|column| column.count == 1);
        let member = |column: &Column| Member {
            name: column.name.clone(),
            scalar: column.scalar,
            offset: column.offset,
        };
        single.map(member).collect()
    }

    /// Points from lines of text, in the layout of a binary file.
    fn parsed(&self, body: &[u8]) -> Result<Vec<u8>> {
        // Each number takes a character and a separator.
        let numbers: usize = self.columns.iter().map(|column| column.count).sum();
        let least = self.count.saturating_mul(numbers) / 2;
        if least > body.len() {
            let expected = format!("{} lines of {numbers} numbers", self.count);
            let found = format!("{} bytes", body.len());
            return Err(Error::format(self.path, "points", expected, found, DAMAGED));
        }
        let mut bytes = Vec::with_capacity(self.count * self.size);
        let text = String::from_utf8_lossy(body);
        let lines = text.lines().map(str::trim);
        let lines = lines.filter(|line| !line.is_empty() && !line.starts_with('#'));
        for (row, line) in lines.take(self.count).enumerate() {
            let mut words = line.split_whitespace();
            for column in &self.columns {
                for _ in 0..column.count {
                    let word = words.next().unwrap_or("");
                    push(&mut bytes, column, word).ok_or_else(|| {
                        let place = format!("point {}, field `{}`", row + 1, clip(&column.name));
                        let found = format!("`{}`", clip(word));
                        Error::format(self.path, place, "a number of its type", found, DAMAGED)
                    })?;
                }
            }
        }
        Ok(bytes)
    }

    /// Points from columns packed by LZF, in the layout of a binary file.
    fn unpacked(&self, body: &[u8]) -> Result<Vec<u8>> {
        let fault = |expected: String, found: String| {
            Error::format(self.path, "packed points", expected, found, DAMAGED)
        };
        let none = || fault("two sizes".to_owned(), format!("{} bytes", body.len()));
        let (sizes, packed) = body.split_at_checked(8).ok_or_else(none)?;
        let size = |at: usize| {
            let bytes = [sizes[at], sizes[at + 1], sizes[at + 2], sizes[at + 3]];
            usize::try_from(u32::from_le_bytes(bytes)).unwrap_or(usize::MAX)
        };
        let wanted = self.count * self.size;
        if size(4) != wanted || wanted > packed.len().saturating_mul(LZF_RATIO) {
            let expected = format!("{wanted} unpacked bytes, of {} points", self.count);
            return Err(fault(expected, format!("{} of {}", size(4), packed.len())));
        }
        let packed = packed.get(..size(0)).ok_or_else(|| {
            fault(
                format!("{} packed bytes", size(0)),
                packed.len().to_string(),
            )
        })?;
        let columns = unpack_lzf(packed, wanted)
            .ok_or_else(|| fault("what LZF unpacks".to_owned(), "other bytes".to_owned()))?;
        let mut points = vec![0; wanted];
        for column in &self.columns {
            let size = column.size();
            let from = column.offset * self.count;
            for i in 0..self.count {
                let to = i * self.size + column.offset;
                let source = from + i * size;
                points[to..to + size].copy_from_slice(&columns[source..source + size]);
            }
        }
        Ok(points)
    }
}

fn scalar_type(kind: &str, size: &str) -> Option<ScalarType> {
    Some(match (kind, size) {
        ("I", "1") => ScalarType::I8,
        ("I", "2") => ScalarType::I16,
        ("I", "4") => ScalarType::I32,
        ("I", "8") => ScalarType::I64,
        ("U", "1") => ScalarType::U8,
        ("U", "2") => ScalarType::U16,
        ("U", "4") => ScalarType::U32,
        ("U", "8") => ScalarType::U64,
        ("F", "4") => ScalarType::F32,
        ("F", "8") => ScalarType::F64,
        _ => return None,
    })
}

/// Converts a number in text to the bytes of its type.
fn push(bytes: &mut Vec<u8>, column: &Column, word: &str) -> Option<()> {
    use ScalarType as S;
    let size = column.scalar.size();
    match column.scalar {
        S::F16 => return None,
        S::F32 => bytes.extend(word.parse::<f32>().ok()?.to_le_bytes()),
        S::F64 => bytes.extend(word.parse::<f64>().ok()?.to_le_bytes()),
        S::I8 | S::I16 | S::I32 | S::I64 => {
            let number = word.parse::<i64>().ok()?;
            let limit = 1_i128 << (8 * size - 1);
            (-limit..limit).contains(&number.into()).then_some(())?;
            bytes.extend(&number.to_le_bytes()[..size]);
        }
        S::U8 | S::U16 | S::U32 | S::U64 => {
            let number = word.parse::<u64>().ok()?;
            (u128::from(number) < 1_u128 << (8 * size)).then_some(())?;
            bytes.extend(&number.to_le_bytes()[..size]);
        }
    }
    Some(())
}

/// Unpacks LZF to `wanted` bytes; `None` if their number differs, or a copy starts before the first byte.
///
/// A control byte n below 32 is followed by n + 1 literal bytes. Others start a copy. The upper three bits are
/// its length less two (if they are seven, the next byte is added). The lower five bits and the byte after are
/// its distance less one.
fn unpack_lzf(packed: &[u8], wanted: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(wanted);
    let mut rest = packed;
    let next = |rest: &mut &[u8]| {
        let (first, behind) = rest.split_first()?;
        *rest = behind;
        Some(usize::from(*first))
    };
    while let Some(control) = next(&mut rest) {
        if control < 32 {
            let (plain, behind) = rest.split_at_checked(control + 1)?;
            out.extend_from_slice(plain);
            rest = behind;
        } else {
            let mut len = control >> 5;
            if len == 7 {
                len += next(&mut rest)?;
            }
            let distance = ((control & 31) << 8 | next(&mut rest)?) + 1;
            let from = out.len().checked_sub(distance)?;
            for i in from..from + len + 2 {
                out.push(out[i]);
            }
        }
        if out.len() > wanted {
            return None;
        }
    }
    (out.len() == wanted).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::unpack_lzf;

    #[test]
    fn lzf_repeats_what_it_has_written() {
        // A byte, then nine copies from one byte back, which overlap the bytes that they write.
        assert_eq!(unpack_lzf(&[0, b'a', 0xe0, 0, 0], 10), Some(vec![b'a'; 10]));
        // Three bytes, and a copy from three bytes back: the shortest copy has three bytes.
        let packed = [2, b'x', b'y', b'z', 0x20, 2];
        assert_eq!(unpack_lzf(&packed, 6), Some(b"xyzxyz".to_vec()));
        // A copy from before the first byte; too many bytes; too few.
        assert_eq!(unpack_lzf(&[0, b'a', 0x20, 1], 4), None);
        assert_eq!(unpack_lzf(&packed, 5), None);
        assert_eq!(unpack_lzf(&packed, 7), None);
    }
}
