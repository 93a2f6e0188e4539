//! Parses the header of PLY files: the elements, and the properties of each.

use std::path::Path;

use crate::error::{Error, Result};
use crate::io::bytes::scalars::ScalarType;

/// The parsed header.
pub(in crate::io) struct Header {
    pub(in crate::io) format: Format,
    pub(in crate::io) elements: Vec<Element>,
    pub(in crate::io) comments: Vec<String>,
    /// Offset of the first byte after the header.
    pub(in crate::io) body: usize,
}

#[derive(Clone, Copy, PartialEq)]
pub(in crate::io) enum Format {
    Ascii,
    Binary { big_endian: bool },
}

/// A kind of row, as described in the header.
pub(in crate::io) struct Element {
    pub(in crate::io) name: String,
    /// Stated number of rows.
    pub(in crate::io) count: usize,
    pub(in crate::io) properties: Vec<Property>,
}

/// One number of a row, or a list of them.
pub(in crate::io) struct Property {
    pub(in crate::io) name: String,
    pub(in crate::io) kind: Kind,
}

#[derive(Clone, Copy)]
pub(in crate::io) enum Kind {
    Scalar(ScalarType),
    List { count: ScalarType, item: ScalarType },
}

impl Header {
    /// Parses the header.
    ///
    /// # Errors
    /// A line that breaks the format's rules, or a missing end.
    pub(in crate::io) fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let broken = |line: usize, expected: &str, found: &str| {
            Error::format(
                path,
                format!("header, line {line}"),
                expected,
                format!("`{}`", found.chars().take(60).collect::<String>()),
                "write the file again",
            )
        };
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut comments = Vec::new();
        let mut at = 0;
        for number in 1.. {
            let Some((line, next)) = line(bytes, at) else {
                return Err(Error::format(
                    path,
                    "header",
                    "a line `end_header`",
                    "the end of the file",
                    "the file is cut off: get it again",
                ));
            };
            at = next;
            let line = String::from_utf8_lossy(line);
            let mut words = line.split_ascii_whitespace();
            let word = words.next().unwrap_or_default();
            let rest: Vec<&str> = words.collect();
            match (word, rest.as_slice()) {
                ("ply", []) if number == 1 => {}
                ("end_header", []) => break,
                ("comment" | "obj_info", _) => {
                    let text = line.trim_start()[word.len()..].trim();
                    comments.push(text.to_owned());
                }
                ("", _) => {}
                ("format", [name, _]) => {
                    format = match *name {
                        "ascii" => Some(Format::Ascii),
                        "binary_little_endian" => Some(Format::Binary { big_endian: false }),
                        "binary_big_endian" => Some(Format::Binary { big_endian: true }),
                        _ => None,
                    };
                    if format.is_none() {
                        let expected = "format ascii, binary_little_endian or binary_big_endian";
                        return Err(broken(number, expected, &line));
                    }
                }
                ("element", [name, count]) => elements.push(Element {
                    name: (*name).to_owned(),
                    count: count
                        .parse()
                        .map_err(|_| broken(number, "element NAME COUNT", &line))?,
                    properties: Vec::new(),
                }),
                ("property", rest) => {
                    let property = property(rest).zip(elements.last_mut());
                    let Some((property, element)) = property else {
                        let expected = "property TYPE NAME or property list TYPE TYPE NAME, \
                                        after an element";
                        return Err(broken(number, expected, &line));
                    };
                    element.properties.push(property);
                }
                _ => {
                    let expected = "format, element, property, comment or end_header";
                    return Err(broken(number, expected, &line));
                }
            }
        }
        let Some(format) = format else {
            return Err(broken(1, "a line `format`", "none before end_header"));
        };
        Ok(Self {
            format,
            elements,
            comments,
            body: at,
        })
    }
}

/// The line that begins at `at`, without its end, and the offset of the next one. Lines end with \n, \r\n or
/// \r.
pub(in crate::io) fn line(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let rest = bytes.get(at..)?;
    let end = rest.iter().position(|&b| b == b'\n' || b == b'\r')?;
    let after = if rest[end..].starts_with(b"\r\n") {
        2
    } else {
        1
    };
    Some((&rest[..end], at + end + after))
}

fn property(words: &[&str]) -> Option<Property> {
    let (name, kind) = match words {
        ["list", count, item, name] => {
            let count = scalar_type(count)?;
            if matches!(count, ScalarType::F32 | ScalarType::F64) {
                return None;
            }
            let item = scalar_type(item)?;
            (name, Kind::List { count, item })
        }
        [scalar, name] => (name, Kind::Scalar(scalar_type(scalar)?)),
        _ => return None,
    };
    Some(Property {
        name: (*name).to_owned(),
        kind,
    })
}

/// A scalar type by its old or its new name.
fn scalar_type(name: &str) -> Option<ScalarType> {
    use ScalarType as S;
    Some(match name {
        "char" | "int8" => S::I8,
        "uchar" | "uint8" => S::U8,
        "short" | "int16" => S::I16,
        "ushort" | "uint16" => S::U16,
        "int" | "int32" => S::I32,
        "uint" | "uint32" => S::U32,
        "int64" | "longlong" => S::I64,
        "uint64" | "ulonglong" => S::U64,
        "float" | "float32" => S::F32,
        "double" | "float64" => S::F64,
        _ => return None,
    })
}
