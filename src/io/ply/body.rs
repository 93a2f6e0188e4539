//! Walks over the elements of PLY files, front to back: columns of scalars, and lists of faces.

use std::path::Path;

use super::header::{Element, Format, Header, Kind, Property, line};
use super::mesh::Faces;
use super::table::{Member, Rows};
use crate::error::{Error, Result};
use crate::io::bytes::scalars::{Encoding, ScalarType, double};

/// The scalars of element `wanted` as columns; `faces` stores those of faces. All elements are walked over, so
/// that a truncated body is found wherever it ends.
///
/// # Errors
/// A body shorter than the header states; numbers that do not fit their types; a face that `faces` refuses.
pub(in crate::io) fn rows<'a>(
    header: &Header,
    path: &Path,
    bytes: &'a [u8],
    wanted: usize,
    mut faces: Option<&mut Faces>,
    notes: &mut Vec<String>,
) -> Result<Rows<'a>> {
    let mut body = Body {
        format: header.format,
        bytes,
        at: header.body,
    };
    let mut rows = None;
    for (i, element) in header.elements.iter().enumerate() {
        let columns = (i == wanted).then(|| Columns::of(element, header.format));
        let first = body.at;
        let mut copied = Vec::new();
        let keep = columns.as_ref().filter(|c| c.is_copied);
        let is_face = faces.as_mut().is_some_and(|faces| faces.begin(i));
        let taker = match (keep, &mut faces) {
            (Some(_), _) => Taker::Scalars(&mut copied),
            (None, Some(faces)) if is_face => Taker::Faces(faces),
            _ => Taker::None,
        };
        body.walk(element, taker).map_err(|fault| {
            Error::format(
                path,
                format!("element `{}`, {}", element.name, fault.row),
                fault.expected,
                fault.found,
                "the file is cut off or its header is wrong: get or write it again",
            )
        })?;
        if let Some(columns) = columns {
            rows = Some(Rows {
                count: element.count,
                step: columns.step,
                big_endian: columns.big_endian,
                members: columns.members,
                data: if columns.is_copied {
                    copied.into()
                } else {
                    bytes[first..body.at].into()
                },
            });
        }
    }
    let left = body.left();
    if left > 0 {
        notes.push(format!("{left} bytes after the last element are not read"));
    }
    rows.ok_or_else(|| Error::format(path, "header", "an element `vertex`", "none", "give one"))
}

/// The layout of an element's scalars in its rows.
struct Columns {
    members: Vec<Member>,
    /// Bytes per row.
    step: usize,
    big_endian: bool,
    /// Whether rows are copied without their lists, or parsed from text, before they are read.
    is_copied: bool,
}

impl Columns {
    fn of(element: &Element, format: Format) -> Self {
        let is_list = |p: &Property| matches!(p.kind, Kind::List { .. });
        let mut members = Vec::new();
        let mut step = 0;
        for property in &element.properties {
            let Kind::Scalar(scalar) = property.kind else {
                continue;
            };
            let scalar = stored_as(scalar, format);
            members.push(Member {
                name: property.name.clone(),
                scalar,
                offset: step,
            });
            step += scalar.size();
        }
        Self {
            members,
            step,
            big_endian: format == Format::Binary { big_endian: true },
            is_copied: format == Format::Ascii || element.properties.iter().any(is_list),
        }
    }
}

/// The type of a column in memory. Text may have more digits than the header's type, and positions can use
/// them: all types but small integers are stored in double precision.
fn stored_as(scalar: ScalarType, format: Format) -> ScalarType {
    use ScalarType as S;
    match (format, scalar) {
        (Format::Ascii, S::I32 | S::U32 | S::I64 | S::U64 | S::F32) => S::F64,
        _ => scalar,
    }
}

/// Appends a number from text as `scalar`, little-endian; `None` if it is out of range.
fn append(out: &mut Vec<u8>, number: f64, scalar: ScalarType) -> Option<()> {
    use ScalarType as S;
    let [least, most] = match stored_as(scalar, Format::Ascii) {
        S::I8 => [i8::MIN.into(), i8::MAX.into()],
        S::U8 => [0, u8::MAX.into()],
        S::I16 => [i16::MIN.into(), i16::MAX.into()],
        S::U16 => [0, u16::MAX.into()],
        _ => {
            out.extend_from_slice(&number.to_le_bytes());
            return Some(());
        }
    };
    let is_there = number.fract() == 0.0 && number >= f64::from(least) && number <= f64::from(most);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "within the range of the type"
    )]
    let whole = is_there.then_some(number as i32)?;
    out.extend_from_slice(&whole.to_le_bytes()[..scalar.size()]);
    Some(())
}

/// Use of an element's numbers.
enum Taker<'t> {
    /// Skips them.
    None,
    /// Appends scalars, byte for byte; text by [`append`].
    Scalars(&'t mut Vec<u8>),
    Faces(&'t mut Faces),
}

/// The elements of a file, walked over front to back.
struct Body<'a> {
    format: Format,
    bytes: &'a [u8],
    at: usize,
}

/// A fault in a row of the body.
struct Fault {
    row: String,
    expected: String,
    found: String,
}

impl Fault {
    /// The fault of an invalid face: expected, found.
    fn of_face(row: String, (expected, found): (String, String)) -> Self {
        Self {
            row,
            expected,
            found,
        }
    }
}

impl<'a> Body<'a> {
    /// Walks over an element.
    fn walk(&mut self, element: &Element, taker: Taker<'_>) -> Result<(), Fault> {
        match self.format {
            Format::Ascii => self.walk_text(element, taker),
            Format::Binary { big_endian } => self.walk_binary(element, big_endian, taker),
        }
    }

    fn walk_binary(
        &mut self,
        element: &Element,
        big_endian: bool,
        mut taker: Taker<'_>,
    ) -> Result<(), Fault> {
        let left = self.bytes.len() - self.at;
        let short = |row: usize| Fault {
            row: format!("row {row} of {}", element.count),
            expected: "a whole row".into(),
            found: "the end of the file".into(),
        };
        // Rows of one size are skipped in one step, because a huge count may belong to empty rows.
        let size = element
            .properties
            .iter()
            .try_fold(0, |sum, p| match p.kind {
                Kind::Scalar(scalar) => Some(sum + scalar.size()),
                Kind::List { .. } => None,
            });
        if let Some(size) = size {
            let all = element.count.checked_mul(size).filter(|&n| n <= left);
            self.at += all.ok_or_else(|| short(left / size.max(1)))?;
            return Ok(());
        }
        // A row has a list, so it takes at least a byte, and the file bounds the loop.
        let mut items = Vec::new();
        for row in 0..element.count {
            for (p, property) in element.properties.iter().enumerate() {
                let (bytes, scalar) = match property.kind {
                    Kind::Scalar(scalar) => {
                        let number = self.take(scalar.size()).ok_or_else(|| short(row))?;
                        if let Taker::Scalars(copy) = &mut taker {
                            copy.extend_from_slice(number);
                        }
                        (number, scalar)
                    }
                    Kind::List { count, item } => {
                        let count = self
                            .take(count.size())
                            .map(|b| integer(b, count, big_endian));
                        let Some(count) = count else {
                            return Err(short(row));
                        };
                        let Some(count) = count else {
                            return Err(Fault {
                                expected: "lists of a length of 0 or more".into(),
                                found: "a negative length".into(),
                                ..short(row)
                            });
                        };
                        let list = count.checked_mul(item.size()).and_then(|n| self.take(n));
                        (list.ok_or_else(|| short(row))?, item)
                    }
                };
                if let Taker::Faces(faces) = &mut taker
                    && faces.wants(p)
                {
                    let encoding = Encoding { scalar, big_endian };
                    items.clear();
                    let numbers = bytes.chunks_exact(scalar.size());
                    items.extend(numbers.map(|bytes| double(bytes, encoding)));
                    let taken = faces.take(p, &items);
                    taken.map_err(|fault| Fault::of_face(short(row).row, fault))?;
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let taken = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(taken)
    }

    /// Walks over one line per row; empty lines are skipped.
    fn walk_text(&mut self, element: &Element, mut taker: Taker<'_>) -> Result<(), Fault> {
        if element.properties.is_empty() {
            return Ok(());
        }
        let mut items = Vec::new();
        for row in 0..element.count {
            let place = || format!("row {row} of {}", element.count);
            let Some(line) = self.next_text_line() else {
                return Err(Fault {
                    row: place(),
                    expected: "a line of numbers".into(),
                    found: "the end of the file".into(),
                });
            };
            let mut words = line.split_ascii_whitespace();
            let mut number = |name: &str| -> Result<f64, Fault> {
                let word = words.next().unwrap_or_default();
                word.parse().map_err(|_| Fault {
                    row: place(),
                    expected: format!("a number for `{}`", shortened(name)),
                    found: match word {
                        "" => "the end of the line".into(),
                        word => format!("`{}`", shortened(word)),
                    },
                })
            };
            for (p, property) in element.properties.iter().enumerate() {
                items.clear();
                let wanted = matches!(&taker, Taker::Faces(faces) if faces.wants(p));
                match property.kind {
                    Kind::Scalar(scalar) => {
                        let number = number(&property.name)?;
                        items.push(number);
                        if let Taker::Scalars(copy) = &mut taker {
                            append(copy, number, scalar).ok_or_else(|| Fault {
                                row: place(),
                                expected: format!("an integer of the type of `{}`", property.name),
                                found: number.to_string(),
                            })?;
                        }
                    }
                    Kind::List { .. } => {
                        let count = number(&property.name)?;
                        // Ends with the line at the latest.
                        let mut passed = 0.0;
                        while passed < count {
                            let item = number(&property.name)?;
                            if wanted {
                                items.push(item);
                            }
                            passed += 1.0;
                        }
                    }
                }
                if let (true, Taker::Faces(faces)) = (wanted, &mut taker) {
                    let taken = faces.take(p, &items);
                    taken.map_err(|fault| Fault::of_face(place(), fault))?;
                }
            }
            if let Some(word) = words.next() {
                return Err(Fault {
                    row: place(),
                    expected: "as many numbers as the header names".into(),
                    found: format!("one more, `{}`", shortened(word)),
                });
            }
        }
        Ok(())
    }

    fn next_text_line(&mut self) -> Option<String> {
        loop {
            if self.at >= self.bytes.len() {
                return None;
            }
            let (text, next) =
                line(self.bytes, self.at).unwrap_or((&self.bytes[self.at..], self.bytes.len()));
            self.at = next;
            if !text.trim_ascii().is_empty() {
                return Some(String::from_utf8_lossy(text).into_owned());
            }
        }
    }

    /// Number of bytes after the last element; white space at the end of text does not count.
    fn left(&self) -> usize {
        let rest = &self.bytes[self.at..];
        match self.format {
            Format::Ascii => rest.trim_ascii().len(),
            Format::Binary { .. } => rest.len(),
        }
    }
}

/// A list's length; `None` if it is negative.
fn integer(bytes: &[u8], scalar: ScalarType, big_endian: bool) -> Option<usize> {
    let fold = |n: u64, &b: &u8| n << 8 | u64::from(b);
    let n = if big_endian {
        bytes.iter().fold(0, fold)
    } else {
        bytes.iter().rev().fold(0, fold)
    };
    let is_signed = matches!(
        scalar,
        ScalarType::I8 | ScalarType::I16 | ScalarType::I32 | ScalarType::I64
    );
    let sign = 1_u64 << (8 * bytes.len() - 1);
    if is_signed && n & sign != 0 {
        return None;
    }
    // Beyond `usize` it is longer than any file.
    Some(usize::try_from(n).unwrap_or(usize::MAX))
}

fn shortened(word: &str) -> String {
    word.chars().take(40).collect()
}
