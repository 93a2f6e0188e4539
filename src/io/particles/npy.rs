//! Reads NumPy arrays of particles, and writes the header that images use.
//!
//! | bytes | content |
//! |---|---|
//! | 0..6 | `\x93NUMPY` |
//! | 6..8 | version: 1.0, 2.0 or 3.0 |
//! | 8..10 (8..12) | header length, u16 (version 1) or u32, little-endian |
//! | then | header: a Python dictionary with `descr`, `fortran_order` and `shape` |
//! | then | the numbers |
//!
//! Tables are structured arrays with named columns, or plain arrays of shape (N, 3 or more)
//! whose columns are x, y, z, `c3`, `c4`, ..., or of shape (N, 2) with x and y in a plane.
//!
//! Written headers are of version 1.0 and padded with spaces, so that the numbers start at a multiple of 64
//! bytes, as NumPy does.

use std::path::Path;

use glam::DVec3;

use super::table::{PositionColumns, dataset, position_columns};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, positions, values};

/// The first bytes of every NPY file.
pub(crate) const MAGIC: &[u8] = b"\x93NUMPY";

/// The header of a plain array of little-endian or single-byte numbers in C order, up to its
/// first number.
///
/// - `descr`: the type, such as `<f4`.
/// - `shape`: at most 16 counts, so that the header's length fits into 16 bits.
pub(crate) fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let counts: Vec<String> = shape.iter().map(usize::to_string).collect();
    // A tuple of one has a comma, too.
    let comma = if shape.len() == 1 { "," } else { "" };
    let mut text = format!(
        "{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}{comma}), }}",
        counts.join(", ")
    );
    let start = MAGIC.len() + 4;
    while !(start + text.len() + 1).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    let length = u16::try_from(text.len()).unwrap_or(u16::MAX);
    [MAGIC, &[1, 0], &length.to_le_bytes(), text.as_bytes()].concat()
}

/// The format's name for a table.
pub(in crate::io) const TABLE: &str = "NPY particle table";

/// One member of an array's element: the element itself, or a column of a structured array.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Member {
    /// The column's name; empty for a plain array.
    pub(crate) name: String,
    /// Type; `None` if it has no numbers (text, dates, padding).
    pub(crate) encoding: Option<Encoding>,
    /// Offset within the element.
    offset: usize,
    /// Number of numbers.
    components: usize,
}

/// An array whose size has been checked against the file's bytes.
#[derive(Debug)]
pub(crate) struct Array<'a> {
    pub(crate) members: Vec<Member>,
    /// Whether the elements have named members.
    pub(crate) structured: bool,
    pub(crate) shape: Vec<usize>,
    pub(crate) fortran_order: bool,
    /// Bytes per element.
    item_size: usize,
    pub(crate) data: &'a [u8],
}

/// Reads a particle table.
///
/// # Errors
/// A broken header, a size that differs from it, or no positions.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    table(input.path, TABLE, &input.read_all()?)
}

/// A particle table from the bytes of an array.
pub(crate) fn table(path: &Path, format: &'static str, bytes: &[u8]) -> Result<Dataset> {
    table_of(path, format, &parse(path, bytes)?)
}

/// A particle table of an array.
pub(in crate::io) fn table_of(
    path: &Path,
    format: &'static str,
    array: &Array<'_>,
) -> Result<Dataset> {
    let shape_error = |found: String| {
        Error::format(
            path,
            "header",
            "a structured array of shape (N,) or a plain one of shape (N, 3 or more)",
            found,
            "save the particles as rows with columns x, y, z",
        )
    };
    let broken = || shape_error(format!("shape {:?}", array.shape));

    if array.structured {
        let &[count] = array.shape.as_slice() else {
            return Err(broken());
        };
        let stride = |member: &Member, component: usize, size: usize| Stride {
            first: member.offset + component * size,
            step: array.item_size,
            count,
        };
        let numeric: Vec<(&Member, Encoding)> = array
            .members
            .iter()
            .filter(|m| m.components > 0)
            .filter_map(|m| m.encoding.map(|e| (m, e)))
            .collect();
        let xyz = position_columns(path, numeric.iter().map(|(m, _)| m.name.as_str()))?;
        let axes = xyz.axes().map(|column| {
            let (member, encoding) = numeric[column];
            (encoding, stride(member, 0, 0))
        });
        let mut positions = positions(array.data, axes).ok_or_else(broken)?;
        let flat = xyz.flatten(&mut positions);
        let mut fields = Vec::new();
        for (i, &(member, encoding)) in numeric.iter().enumerate() {
            if xyz.contains(i) {
                continue;
            }
            let size = encoding.scalar.size();
            let mut components = Vec::new();
            for c in 0..member.components {
                let column = values(array.data, encoding, stride(member, c, size));
                components.push(column.ok_or_else(broken)?);
            }
            fields.push(field(member.name.clone(), components));
        }
        let mut data = dataset(path, format, positions, fields)?;
        data.notes.extend(flat);
        return Ok(data);
    }

    let &[count, columns] = array.shape.as_slice() else {
        return Err(broken());
    };
    let encoding = array.plain_encoding(path)?;
    // Two numbers a row are positions in a plane if they are not integers and there are more rows than columns.
    let is_real = matches!(
        encoding.scalar,
        ScalarType::F16 | ScalarType::F32 | ScalarType::F64
    );
    let of_plane = columns == 2 && count > columns && is_real;
    if columns < 3 && !of_plane {
        return Err(broken());
    }
    let xyz = PositionColumns {
        x: 0,
        y: 1,
        z: (!of_plane).then_some(2),
    };
    let axis = |i: usize| {
        let stride = array.column(i, encoding).ok_or_else(broken)?;
        Ok((encoding, stride))
    };
    let [x, y, z] = xyz.axes();
    let axes = [axis(x)?, axis(y)?, axis(z)?];
    let mut positions = positions(array.data, axes).ok_or_else(broken)?;
    let flat = xyz.flatten(&mut positions);
    let mut fields = Vec::new();
    for column in 3..columns {
        let stride = array.column(column, encoding).ok_or_else(broken)?;
        let column_values = values(array.data, encoding, stride).ok_or_else(broken)?;
        fields.push(field(format!("c{column}"), vec![column_values]));
    }
    let mut data = dataset(path, format, positions, fields)?;
    data.notes.extend(flat);
    Ok(data)
}

/// Positions from their coordinates.
pub(crate) fn zip_positions(x: Vec<f64>, y: &[f64], z: &[f64]) -> Vec<DVec3> {
    x.into_iter()
        .zip(y)
        .zip(z)
        .map(|((x, &y), &z)| DVec3::new(x, y, z))
        .collect()
}

/// A field of one component or several.
pub(crate) fn field(name: String, mut components: Vec<crate::scene::Values>) -> Field {
    let source = match (components.len(), components.pop()) {
        (1, Some(values)) => FieldSource::Scalar(values),
        (_, last) => {
            components.extend(last);
            FieldSource::Vector(components)
        }
    };
    Field {
        name,
        association: Association::Nodes,
        source,
        unit: None,
    }
}

impl Array<'_> {
    /// Checks that the number of bytes after the header is that of the shape.
    pub(in crate::io) fn check_len(&self, path: &Path, len: u64) -> Result<()> {
        let counts = self.shape.iter();
        let expected = counts.copied().try_fold(self.item_size, usize::checked_mul);
        if expected.is_some_and(|n| n as u64 == len) {
            return Ok(());
        }
        let shape = &self.shape;
        Err(Error::format(
            path,
            "size",
            match expected {
                Some(n) => format!("{n} bytes after the header, for shape {shape:?}"),
                None => format!("a shape that fits into memory, not {shape:?}"),
            },
            format!("{len} bytes"),
            "the file is cut off or its header is wrong: save the array again",
        ))
    }

    /// Bytes per row, if rows are stored one after another.
    pub(in crate::io) fn row_len(&self) -> Option<usize> {
        match self.shape.as_slice() {
            [_] => Some(self.item_size),
            [_, columns] if !self.fortran_order => self.item_size.checked_mul(*columns),
            _ => None,
        }
    }

    /// The same array with `count` rows.
    pub(in crate::io) fn of_rows<'a>(&self, count: usize, data: &'a [u8]) -> Array<'a> {
        let mut shape = self.shape.clone();
        shape[0] = count;
        Array {
            members: self.members.clone(),
            shape,
            data,
            ..*self
        }
    }

    /// The type of a plain array's numbers.
    pub(crate) fn encoding(&self) -> Option<Encoding> {
        match self.members.as_slice() {
            [member] if !self.structured => member.encoding,
            _ => None,
        }
    }

    /// Columns of a plain array of shape (N,) or (N, columns).
    pub(crate) fn columns(&self) -> Option<usize> {
        match self.shape.as_slice() {
            [_] => Some(1),
            [_, columns] => Some(*columns),
            _ => None,
        }
    }

    /// The stride of one column of such an array.
    pub(crate) fn column(&self, column: usize, encoding: Encoding) -> Option<Stride> {
        let columns = self.columns().filter(|&n| column < n)?;
        let count = self.shape[0];
        let size = encoding.scalar.size();
        let [first, step] = if self.fortran_order {
            [column * count, 1]
        } else {
            [column, columns]
        };
        Some(Stride {
            first: first * size,
            step: step * size,
            count,
        })
    }

    /// The type of a plain array's numbers.
    ///
    /// # Errors
    /// The array has none.
    pub(crate) fn plain_encoding(&self, path: &Path) -> Result<Encoding> {
        match self.encoding() {
            Some(encoding) => Ok(encoding),
            None => Err(Error::format(
                path,
                "header, `descr`",
                "integers of 1 to 8 bytes, or floats of 2, 4 or 8",
                "another type",
                "convert the array with .astype('f4')",
            )),
        }
    }
}

/// Parses a header and checks it against the file's bytes.
pub(crate) fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Result<Array<'a>> {
    let (array, start) = parse_header(path, bytes)?;
    let data = &bytes[start..];
    array.check_len(path, data.len() as u64)?;
    Ok(Array { data, ..array })
}

/// An array without its numbers, and their offset.
pub(in crate::io) fn parse_header(path: &Path, bytes: &[u8]) -> Result<(Array<'static>, usize)> {
    let broken = |expected: &str, found: String| {
        Error::format(
            path,
            "header",
            expected,
            found,
            "save the array again with numpy.save",
        )
    };
    let number = |at: usize, size: usize| -> Option<usize> {
        let digits = bytes.get(at..at + size)?;
        Some(digits.iter().rev().fold(0, |n, &b| n << 8 | usize::from(b)))
    };
    let version = bytes.get(6).copied().unwrap_or(0);
    let length_size = match version {
        1 => 2,
        2 | 3 => 4,
        v => return Err(broken("NPY version 1, 2 or 3", format!("version {v}"))),
    };
    let start = 8 + length_size;
    let end = number(8, length_size).and_then(|n| start.checked_add(n));
    let Some((text, end)) = end.and_then(|end| Some((bytes.get(start..end)?, end))) else {
        return Err(broken(
            "a header within the file",
            format!("a header that ends at byte {}", end.unwrap_or(usize::MAX)),
        ));
    };
    let text = match std::str::from_utf8(text) {
        Ok(text) => text.to_owned(),
        // Versions 1 and 2 are Latin-1.
        Err(_) => text.iter().map(|&b| char::from(b)).collect(),
    };
    let Some(Literal::Dictionary(entries)) = Literal::parse(&text) else {
        return Err(broken(
            "a Python dictionary",
            text.chars().take(60).collect(),
        ));
    };
    let entry = |key: &str| {
        entries
            .iter()
            .find(|(k, _)| matches!(k, Literal::Text(k) if k == key))
            .map(|(_, value)| value)
            .ok_or_else(|| broken(&format!("a key `{key}`"), "none".to_owned()))
    };
    let fortran_order = matches!(entry("fortran_order")?, Literal::Bool(true));
    let shape = entry("shape")?
        .counts()
        .ok_or_else(|| broken("`shape` as a tuple of counts", "something else".to_owned()))?;

    let mut members = Vec::new();
    let descr = entry("descr")?;
    let structured = matches!(descr, Literal::List(_));
    let item_size = match descr {
        Literal::Text(code) => member(&mut members, String::new(), code, 1, 0),
        Literal::List(columns) => columns.iter().try_fold(0, |offset, column| {
            struct_member(&mut members, column, offset)
        }),
        _ => None,
    };
    let Some(item_size) = item_size.filter(|&n| n > 0) else {
        return Err(broken(
            "`descr` with a number type, or a list of columns of such types",
            "something else (Python objects and nested structures are not read)".to_owned(),
        ));
    };

    let array = Array {
        members,
        structured,
        shape,
        fortran_order,
        item_size,
        data: &[],
    };
    Ok((array, end))
}

/// Adds a column of a structured array, `(name, type)` or `(name, type, shape)`, and returns the offset of the
/// next one.
fn struct_member(members: &mut Vec<Member>, column: &Literal, offset: usize) -> Option<usize> {
    let Literal::List(parts) = column else {
        return None;
    };
    let name = match parts.first()? {
        Literal::Text(name) => name.clone(),
        // (title, name)
        Literal::List(names) => match names.get(1)? {
            Literal::Text(name) => name.clone(),
            _ => return None,
        },
        _ => return None,
    };
    let Literal::Text(code) = parts.get(1)? else {
        return None;
    };
    let components = match parts.get(2) {
        None => 1,
        Some(Literal::Number(n)) => *n,
        Some(shape) => shape
            .counts()?
            .iter()
            .try_fold(1_usize, |p, &n| p.checked_mul(n))?,
    };
    member(members, name, code, components, offset)
}

/// Adds a member of type `code`, such as `<f4`, and returns the offset of the next one.
fn member(
    members: &mut Vec<Member>,
    name: String,
    code: &str,
    components: usize,
    offset: usize,
) -> Option<usize> {
    use ScalarType as S;
    let big_endian = code.starts_with('>');
    let code = code.trim_start_matches(['<', '>', '|', '=']);
    let kind = code.chars().next()?;
    // Dates have their unit after the size: M8[ns].
    let digits = code[kind.len_utf8()..].split('[').next()?;
    let size: usize = digits.parse().ok()?;
    let scalar = match (kind, size) {
        ('b' | 'u', 1) => Some(S::U8),
        ('i', 1) => Some(S::I8),
        ('i', 2) => Some(S::I16),
        ('u', 2) => Some(S::U16),
        ('i', 4) => Some(S::I32),
        ('u', 4) => Some(S::U32),
        ('i', 8) => Some(S::I64),
        ('u', 8) => Some(S::U64),
        ('f', 2) => Some(S::F16),
        ('f', 4) => Some(S::F32),
        ('f', 8) => Some(S::F64),
        ('b' | 'i' | 'u' | 'f' | 'c' | 'm' | 'M' | 'S' | 'a' | 'U' | 'V', _) => None,
        _ => return None,
    };
    let item = if kind == 'U' {
        size.checked_mul(4)?
    } else {
        size
    };
    members.push(Member {
        name,
        encoding: scalar.map(|scalar| Encoding { scalar, big_endian }),
        offset,
        components,
    });
    offset.checked_add(item.checked_mul(components)?)
}

/// The part of Python's literals that NPY headers use; tuples are lists here.
#[derive(Debug, PartialEq)]
enum Literal {
    Text(String),
    Number(usize),
    Bool(bool),
    List(Vec<Literal>),
    Dictionary(Vec<(Literal, Literal)>),
}

impl Literal {
    /// Greatest depth of brackets; a structured array with sub-arrays has four levels.
    const DEEPEST: usize = 8;

    fn parse(text: &str) -> Option<Self> {
        let mut rest = text;
        let literal = Self::next(&mut rest, 0)?;
        rest.trim().is_empty().then_some(literal)
    }

    /// A tuple of counts.
    fn counts(&self) -> Option<Vec<usize>> {
        let Self::List(items) = self else {
            return None;
        };
        let count = |item: &Self| match item {
            Self::Number(n) => Some(*n),
            _ => None,
        };
        items.iter().map(count).collect()
    }

    fn next(rest: &mut &str, depth: usize) -> Option<Self> {
        *rest = rest.trim_start();
        let first = rest.chars().next()?;
        match first {
            '\'' | '"' => Self::text(rest, first),
            '0'..='9' => {
                let end = rest
                    .find(|c: char| !c.is_ascii_digit())
                    .unwrap_or(rest.len());
                let number = rest[..end].parse().ok()?;
                // Python 2 wrote long integers as 3L.
                *rest = rest[end..].trim_start_matches('L');
                Some(Self::Number(number))
            }
            'T' | 'F' => {
                for (word, value) in [("True", true), ("False", false)] {
                    if let Some(after) = rest.strip_prefix(word) {
                        *rest = after;
                        return Some(Self::Bool(value));
                    }
                }
                None
            }
            '(' | '[' | '{' if depth < Self::DEEPEST => {
                *rest = &rest[1..];
                let mut items = Vec::new();
                let mut entries = Vec::new();
                let close = match first {
                    '(' => ')',
                    '[' => ']',
                    _ => '}',
                };
                loop {
                    *rest = rest.trim_start();
                    if let Some(after) = rest.strip_prefix(close) {
                        *rest = after;
                        break;
                    }
                    let item = Self::next(rest, depth + 1)?;
                    *rest = rest.trim_start();
                    if first == '{' {
                        *rest = rest.strip_prefix(':')?;
                        entries.push((item, Self::next(rest, depth + 1)?));
                        *rest = rest.trim_start();
                    } else {
                        items.push(item);
                    }
                    match rest.strip_prefix(',') {
                        Some(after) => *rest = after,
                        None if rest.starts_with(close) => {}
                        None => return None,
                    }
                }
                Some(if first == '{' {
                    Self::Dictionary(entries)
                } else {
                    Self::List(items)
                })
            }
            _ => None,
        }
    }

    fn text(rest: &mut &str, quote: char) -> Option<Self> {
        let mut text = String::new();
        let mut chars = rest[1..].char_indices();
        while let Some((i, c)) = chars.next() {
            if c == quote {
                *rest = &rest[1 + i + c.len_utf8()..];
                return Some(Self::Text(text));
            }
            text.push(if c == '\\' { chars.next()?.1 } else { c });
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::dataset::Geometry;
    use crate::scene::Values;

    /// A version-1 file from its header dictionary and its body.
    fn npy(header: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([1, 0]);
        bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(body);
        bytes
    }

    fn read_bytes(bytes: &[u8]) -> Result<Dataset> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read(Input::of_file(file.path()))
    }

    #[test]
    fn written_headers_are_those_of_numpy() {
        // Header that numpy.save writes for np.zeros((2, 3, 4), "f4").
        let mut expected = b"\x93NUMPY\x01\0\x76\0".to_vec();
        expected.extend(b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }");
        expected.resize(127, b' ');
        expected.push(b'\n');
        assert_eq!(header("<f4", &[2, 3, 4]), expected);
        for shape in [&[7][..], &[usize::MAX; 16], &[]] {
            let bytes = header("|u1", shape);
            assert_eq!(bytes.len() % 64, 0);
            let text = std::str::from_utf8(&bytes[10..]).unwrap();
            assert_eq!(
                usize::from(bytes[8]) + 256 * usize::from(bytes[9]),
                text.len()
            );
            let Some(Literal::Dictionary(entries)) = Literal::parse(text) else {
                panic!("{text}");
            };
            assert_eq!(entries[2].1.counts().as_deref(), Some(shape), "{text}");
        }
        assert!(header("<f4", &[7]).windows(4).any(|w| w == b"(7,)"));
    }

    #[test]
    fn plain_arrays_in_both_orders() {
        let rows = [[1.0_f64, 2.0, 3.0, 9.0], [4.0, 5.0, 6.0, 8.0]];
        let by_rows: Vec<u8> = rows
            .iter()
            .flatten()
            .flat_map(|v| v.to_be_bytes())
            .collect();
        let by_columns: Vec<u8> = (0..4)
            .flat_map(|c| rows.iter().flat_map(move |r| r[c].to_be_bytes()))
            .collect();
        for (order, body) in [("False", by_rows), ("True", by_columns)] {
            let header =
                format!("{{'descr': '>f8', 'fortran_order': {order}, 'shape': (2, 4), }}  \n");
            let data = read_bytes(&npy(&header, &body)).unwrap();
            let Geometry::Points { positions } = &data.geometry else {
                panic!()
            };
            assert_eq!(positions, &[DVec3::new(1., 2., 3.), DVec3::new(4., 5., 6.)]);
            assert_eq!(data.scalar("c3").unwrap().1, Values::F32(vec![9.0, 8.0]));
        }
    }

    #[test]
    fn structured_arrays_go_by_name_and_skip_text_and_padding() {
        let header = "{'descr': [('id', '>u2'), ('', '|V2'), ('Z', '<f4'), ('y', '<f4'), \
                      ('x', '<f8'), ('tag', '<U1'), ('v', '<i2', (2,))], \
                      'fortran_order': False, 'shape': (1,)}";
        let mut body = vec![1, 2, 0, 0];
        body.extend(3.0_f32.to_le_bytes());
        body.extend(2.0_f32.to_le_bytes());
        body.extend(1.0_f64.to_le_bytes());
        body.extend([65, 0, 0, 0, 7, 0, 8, 0]);
        let data = read_bytes(&npy(header, &body)).unwrap();
        let Geometry::Points { positions } = &data.geometry else {
            panic!()
        };
        assert_eq!(positions, &[DVec3::new(1., 2., 3.)]);
        assert_eq!(data.field_names(), ["id", "v"]);
        assert_eq!(data.scalar("id").unwrap().1, Values::U16(vec![0x0102]));
        assert_eq!(data.scalar("v:y").unwrap().1, Values::I16(vec![8]));
    }

    #[test]
    fn broken_headers_are_refused() {
        let huge = "{'descr': '<f4', 'fortran_order': False, 'shape': (18446744073709551615, 3)}";
        let deep = "(".repeat(60_000);
        for bytes in [
            npy(huge, &[0; 12]),
            npy(&deep, &[]),
            npy(
                "{'descr': '|O', 'fortran_order': False, 'shape': (1, 3)}",
                &[0; 24],
            ),
            npy(
                "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)}",
                &[0; 23],
            ),
            npy(
                "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2)}",
                &[0; 16],
            ),
            npy(
                "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 3)}",
                &[],
            ),
            npy("{'descr': [], 'fortran_order': False, 'shape': (9,)}", &[]),
            npy("{'descr': '<f4', 'shape': (1, 3)}", &[0; 12]),
            b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec(),
            b"\x93NUMPY\x09".to_vec(),
            MAGIC.to_vec(),
        ] {
            let err = read_bytes(&bytes).unwrap_err();
            assert!(matches!(err, Error::Format { .. }), "{err}");
        }
    }
}
