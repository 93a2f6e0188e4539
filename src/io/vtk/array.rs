//! Decodes the arrays of VTK XML files.
//!
//! | `format` | location of the numbers |
//! |---|---|
//! | `ascii` | in the element, as text |
//! | `binary` | in the element, as base64 |
//! | `appended` | `offset` bytes after the `_` of `AppendedData`, raw or as base64 |
//!
//! A binary or appended array starts with words of `header_type` (UInt32 if it is not given):
//!
//! | uncompressed | compressed |
//! |---|---|
//! | byte count | block count, bytes per block, bytes of the last block (0: a full one), compressed bytes of each block |
//! | the bytes | the compressed blocks, see [`Codec`] |
//!
//! In base64, header and data may be one stream or two; both are read.
//!
//! Nothing is allocated on a header's word alone. An array must have the size that the mesh requires, and its
//! encoded bytes must be there (compressed: times [`Codec::ratio`]). All arrays together may not use more
//! encoded bytes than the file has, so that no bytes count twice.

use std::borrow::Cow;
use std::cell::Cell;
use std::path::Path;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use glam::DVec3;
use roxmltree::{Document, Node};

use super::codec::Codec;
use super::xml::{Frame, child, clip};
use crate::data::dataset::{Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::scalars::{
    Encoding, NotIntegers, ScalarType, Stride, doubles, integers, points, values,
};
use crate::memory::no_room;
use crate::scene::Values;

/// Decodes the arrays of one file.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    path: &'a Path,
    big_endian: bool,
    /// Bytes per header word: 4 or 8.
    word_size: usize,
    codec: Option<Codec>,
    appended: Option<(&'a [u8], bool)>,
    /// Encoded bytes that arrays may still use.
    budget: Cell<usize>,
}

/// A decoded array, one [`Values`] per component.
#[derive(Debug, Clone)]
pub(crate) struct Array {
    pub(crate) name: String,
    pub(crate) components: Vec<Values>,
}

impl Array {
    /// An array without values.
    pub(in crate::io) fn none_of((name, kinds): &crate::io::ArrayKey) -> Self {
        Self {
            name: name.clone(),
            components: kinds
                .iter()
                .map(|kind| Values::of_type(kind, &[]))
                .collect(),
        }
    }

    /// The values of a field; `None` if the field is derived.
    pub(crate) fn of_field(field: Field) -> Option<Self> {
        let components = match field.source {
            FieldSource::Scalar(values) => vec![values],
            FieldSource::Vector(components) => components,
            FieldSource::Derived(_) => return None,
        };
        Some(Self {
            name: field.name,
            components,
        })
    }
}

/// An array of numbers that an element declares.
#[derive(Debug)]
pub(in crate::io) struct Declared<'d> {
    node: Node<'d, 'd>,
    pub(in crate::io) name: String,
    scalar: ScalarType,
}

impl Declared<'_> {
    /// Numbers per tuple; `None` if the attribute is damaged.
    pub(in crate::io) fn component_count(&self) -> Option<usize> {
        component_count(self.node).ok()
    }

    /// No values, of the type in which a component is read.
    pub(in crate::io) fn no_values(&self) -> Values {
        let encoding = Encoding {
            scalar: self.scalar,
            big_endian: false,
        };
        let stride = Stride {
            first: 0,
            step: self.scalar.size(),
            count: 0,
        };
        values(&[], encoding, stride).unwrap_or(Values::U8(Vec::new()))
    }
}

/// The arrays of numbers that an element declares; arrays of text or bits are left out.
///
/// - `tag`: name of the arrays' elements: `DataArray`, or `PDataArray` in an index.
pub(in crate::io) fn declared<'d>(element: Node<'d, 'd>, tag: &str) -> Vec<Declared<'d>> {
    let mut all = Vec::new();
    for node in element.children().filter(|n| n.has_tag_name(tag)) {
        let Some(scalar) = node.attribute("type").and_then(scalar_type) else {
            continue;
        };
        let name = match node.attribute("Name") {
            Some(name) => name.to_owned(),
            None => format!("array {}", all.len() + 1),
        };
        all.push(Declared { node, name, scalar });
    }
    all
}

/// The reason why an array cannot be decoded: expected, found, and advice.
struct Fault(String, String, &'static str);

impl Fault {
    const SAVE_AGAIN: &'static str = "the file is damaged: copy or save it again";

    fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self(expected.into(), found.into(), Self::SAVE_AGAIN)
    }
}

impl<'a> Decoder<'a> {
    /// Reads the root's attributes.
    pub(crate) fn new(frame: &Frame<'a>, document: &Document<'_>) -> Result<Self> {
        let path = frame.path;
        let root = document.root_element();
        let error = |place: &str, expected: &str, found: &str, advice: &str| {
            Err(Error::format(
                path,
                place,
                expected,
                format!("`{}`", clip(found)),
                advice,
            ))
        };
        let big_endian = match root.attribute("byte_order") {
            Some("LittleEndian") | None => false,
            Some("BigEndian") => true,
            Some(other) => {
                let advice = "correct the attribute";
                return error(
                    "VTKFile, `byte_order`",
                    "LittleEndian or BigEndian",
                    other,
                    advice,
                );
            }
        };
        let word_size = match root.attribute("header_type") {
            Some("UInt32") | None => 4,
            Some("UInt64") => 8,
            Some(other) => {
                let advice = "correct the attribute";
                return error("VTKFile, `header_type`", "UInt32 or UInt64", other, advice);
            }
        };
        let codec = match root.attribute("compressor") {
            None | Some("") => None,
            Some(name) => {
                let codec = Codec::from_name(name);
                if codec.is_none() {
                    let advice = "save the file with one of these, or without compression";
                    return error("VTKFile, `compressor`", Codec::NAMES, name, advice);
                }
                codec
            }
        };
        let encoding = child(root, "AppendedData")
            .and_then(|node| node.attribute("encoding"))
            .unwrap_or("base64");
        let appended = match (frame.appended, encoding) {
            (None, _) => None,
            (Some(data), "raw") => Some((data, false)),
            (Some(data), "base64") => Some((data, true)),
            (Some(_), other) => {
                let advice = "correct the attribute";
                return error("AppendedData, `encoding`", "raw or base64", other, advice);
            }
        };
        Ok(Self {
            path,
            big_endian,
            word_size,
            codec,
            appended,
            budget: Cell::new(frame.len),
        })
    }

    /// Decodes all numeric arrays of a `PointData` or `CellData` element, each of `count`
    /// tuples. Arrays of text or bits are left out.
    pub(crate) fn arrays(&self, element: Node<'_, '_>, count: usize) -> Result<Vec<Array>> {
        let declared = declared(element, "DataArray").into_iter();
        declared.map(|array| self.array(array, count)).collect()
    }

    /// Decodes an array of `count` tuples.
    pub(in crate::io) fn array(&self, declared: Declared<'_>, count: usize) -> Result<Array> {
        let Declared { node, name, scalar } = declared;
        let components = self.named(node, &name, || self.values(node, scalar, count))?;
        Ok(Array { name, components })
    }

    /// The location and encoding of an array that is stored plain: one component, appended raw and not
    /// compressed. At that offset in the appended bytes is a word with the number of bytes, then the bytes.
    /// `None` for all other arrays.
    pub(in crate::io) fn plain(&self, declared: &Declared<'_>) -> Option<(u64, Encoding)> {
        let node = declared.node;
        let is_plain = self.codec.is_none()
            && matches!(self.appended, Some((_, false)))
            && node.attribute("format") == Some("appended")
            && declared.component_count() == Some(1);
        let offset = node.attribute("offset")?.trim().parse().ok();
        let encoding = Encoding {
            scalar: declared.scalar,
            big_endian: self.big_endian,
        };
        offset.filter(|_| is_plain).map(|offset| (offset, encoding))
    }

    /// Bytes per header word.
    pub(in crate::io) fn word_size(&self) -> usize {
        self.word_size
    }

    /// The value of a header word.
    pub(in crate::io) fn word(&self, bytes: &[u8]) -> u64 {
        let fold = |n: u64, &b: &u8| n << 8 | u64::from(b);
        if self.big_endian {
            bytes.iter().fold(0, fold)
        } else {
            bytes.iter().rev().fold(0, fold)
        }
    }

    /// Decodes an array of `count` positions, in double precision.
    pub(crate) fn points(&self, node: Node<'_, '_>, count: usize) -> Result<Vec<DVec3>> {
        self.named(node, "Points", || {
            let scalar = numeric(node)?;
            if component_count(node)? != 3 {
                let found = node.attribute("NumberOfComponents").unwrap_or("1");
                return Err(Fault::new("3 components", clip(found)));
            }
            let (bytes, encoding) = self.bytes(node, scalar, Some((count, 3)))?;
            points(&bytes, encoding, count).ok_or_else(|| fewer(count))
        })
    }

    /// Decodes an array of `count` numbers, in double precision.
    pub(crate) fn doubles(&self, node: Node<'_, '_>, count: usize) -> Result<Vec<f64>> {
        self.named(node, "coordinates", || {
            let scalar = numeric(node)?;
            let (bytes, encoding) = self.bytes(node, scalar, Some((count, 1)))?;
            let stride = Stride {
                first: 0,
                step: scalar.size(),
                count,
            };
            doubles(&bytes, encoding, stride).ok_or_else(|| fewer(count))
        })
    }

    /// Decodes an array of integers, `count` of them or, without it, as many as there are. `convert` returns
    /// those that are allowed, `expected` describes them.
    pub(crate) fn integers<T: Copy + Default + Send>(
        &self,
        node: Node<'_, '_>,
        count: Option<usize>,
        expected: &str,
        convert: impl Fn(i128) -> Option<T> + Sync,
    ) -> Result<Vec<T>> {
        self.named(node, "integers", || {
            let scalar = numeric(node)?;
            let (bytes, encoding) = self.bytes(node, scalar, count.map(|n| (n, 1)))?;
            integers(&bytes, encoding, convert).map_err(|found| match found {
                NotIntegers::Fractions => {
                    let kind = node.attribute("type").unwrap_or("");
                    Fault::new("an array of integers", clip(kind))
                }
                NotIntegers::Refused(at, n) => Fault::new(expected, format!("{n} as number {at}")),
            })
        })
    }

    /// Runs `work` on an array; its faults become errors that name the array.
    fn named<T>(
        &self,
        node: Node<'_, '_>,
        default: &str,
        work: impl FnOnce() -> Result<T, Fault>,
    ) -> Result<T> {
        work().map_err(|Fault(expected, found, advice)| {
            let name = node.attribute("Name").unwrap_or(default);
            let place = format!("DataArray `{}`", clip(name));
            Error::format(self.path, place, expected, found, advice)
        })
    }

    fn values(
        &self,
        node: Node<'_, '_>,
        scalar: ScalarType,
        count: usize,
    ) -> Result<Vec<Values>, Fault> {
        let component_count = component_count(node)?;
        let (bytes, encoding) = self.bytes(node, scalar, Some((count, component_count)))?;
        let size = scalar.size();
        (0..component_count)
            .map(|c| {
                let stride = Stride {
                    first: c * size,
                    step: component_count * size,
                    count,
                };
                values(&bytes, encoding, stride).ok_or_else(|| fewer(count))
            })
            .collect()
    }

    /// The bytes of an array, and their encoding. `shape`: number of tuples and of components; without it, any
    /// size.
    fn bytes(
        &self,
        node: Node<'_, '_>,
        scalar: ScalarType,
        shape: Option<(usize, usize)>,
    ) -> Result<(Cow<'a, [u8]>, Encoding), Fault> {
        let size = match shape {
            None => None,
            Some((count, component_count)) => {
                let numbers = count.checked_mul(component_count);
                let size = numbers.and_then(|n| n.checked_mul(scalar.size()));
                Some(size.ok_or_else(|| {
                    Fault::new(
                        "an array that fits into memory",
                        format!("{count} x {component_count}"),
                    )
                })?)
            }
        };
        let text = || -> Cow<'_, str> {
            let mut texts = node
                .children()
                .filter(Node::is_text)
                .filter_map(|n| n.text());
            let first = texts.next().unwrap_or("");
            texts.fold(Cow::Borrowed(first), |all, more| {
                Cow::Owned(all.into_owned() + more)
            })
        };
        let mut encoding = Encoding {
            scalar,
            big_endian: self.big_endian,
        };
        let bytes = match node.attribute("format") {
            Some("ascii") | None => {
                encoding.big_endian = false;
                Cow::Owned(ascii(&text(), scalar, size.map(|n| n / scalar.size()))?)
            }
            Some("binary") => {
                let text = text();
                let bytes = self.binary(Source::base64(text.as_bytes()), size)?;
                Cow::Owned(bytes.into_owned())
            }
            Some("appended") => {
                let (data, is_base64) = self
                    .appended
                    .ok_or_else(|| Fault::new("an AppendedData element", "none"))?;
                let offset = node.attribute("offset").unwrap_or("");
                let data = offset
                    .trim()
                    .parse()
                    .ok()
                    .and_then(|at: usize| data.get(at..))
                    .ok_or_else(|| {
                        Fault::new(
                            format!("an `offset` within {} bytes of appended data", data.len()),
                            format!("`{}`", clip(offset)),
                        )
                    })?;
                self.binary(
                    if is_base64 {
                        Source::base64(data)
                    } else {
                        Source::Raw(data)
                    },
                    size,
                )?
            }
            Some(other) => {
                return Err(Fault::new(
                    "`format` ascii, binary or appended",
                    format!("`{}`", clip(other)),
                ));
            }
        };
        if bytes.len() % scalar.size() != 0 {
            return Err(Fault::new(
                format!("numbers of {} bytes", scalar.size()),
                format!("{} bytes", bytes.len()),
            ));
        }
        Ok((bytes, encoding))
    }

    /// Decodes a binary array, which must have `size` bytes if that is given.
    fn binary<'d>(
        &self,
        mut source: Source<'d>,
        size: Option<usize>,
    ) -> Result<Cow<'d, [u8]>, Fault> {
        let before = source.remaining();
        let bytes = if let Some(codec) = self.codec {
            self.compressed(&mut source, codec, size)?
        } else {
            let found = self.words(&mut source, 1)?[0];
            source.take(checked_size(Some(found), size, || {
                format!("{found} bytes")
            })?)?
        };
        let used = before - source.remaining();
        let budget = self.budget.get().checked_sub(used).ok_or_else(|| {
            Fault::new(
                "arrays that do not overlap",
                "more encoded bytes than the file has",
            )
        })?;
        self.budget.set(budget);
        Ok(bytes)
    }

    fn compressed<'d>(
        &self,
        source: &mut Source<'d>,
        codec: Codec,
        size: Option<usize>,
    ) -> Result<Cow<'d, [u8]>, Fault> {
        let block_count = self.words(source, 1)?[0];
        if block_count == 0 {
            checked_size(Some(0), size, || "no compressed block".to_owned())?;
            return Ok(Cow::Borrowed(&[]));
        }
        let [block_size, last_size] = self.words(source, 2)?[..] else {
            return Err(Fault::new("a block size", "none"));
        };
        let last_size = if last_size == 0 {
            block_size
        } else {
            last_size
        };
        let claimed = (block_count - 1)
            .checked_mul(block_size)
            .and_then(|n| n.checked_add(last_size));
        let size = checked_size(claimed, size, || {
            format!("{block_count} blocks of {block_size} bytes, the last of {last_size}")
        })?;
        let block_count = usize::try_from(block_count)
            .map_err(|_| Fault::new("blocks that fit into memory", format!("{block_count}")))?;
        let compressed_sizes = self.words(source, block_count)?;
        let compressed_sum = compressed_sizes
            .iter()
            .try_fold(0_u64, |sum, &n| sum.checked_add(n));
        let present = compressed_sum.filter(|&n| n <= source.remaining() as u64);
        if present.is_none_or(|n| size as u64 > n.saturating_mul(codec.ratio())) {
            return Err(Fault::new(
                format!("{} data for {size} bytes", codec.name()),
                format!(
                    "{} bytes",
                    compressed_sum.map_or("too many".to_owned(), |n| n.to_string())
                ),
            ));
        }
        if let Some([expected, found]) = no_room(size as u64) {
            return Err(Fault::new(expected, found));
        }
        let mut bytes = Vec::new();
        for (i, &compressed_size) in compressed_sizes.iter().enumerate() {
            let wanted = if i + 1 == block_count {
                last_size
            } else {
                block_size
            };
            // It fits: no block is larger than all of them.
            let wanted = usize::try_from(wanted).unwrap_or(usize::MAX);
            let compressed_size = usize::try_from(compressed_size).unwrap_or(usize::MAX);
            let block = source.take(compressed_size)?;
            let start = bytes.len();
            codec.decode(&block, wanted, &mut bytes).map_err(|e| {
                let expected = format!("{} data for {wanted} bytes in block {i}", codec.name());
                Fault::new(expected, clip(&e))
            })?;
            let found = bytes.len() - start;
            if found != wanted {
                return Err(Fault::new(
                    format!("{wanted} bytes in block {i}"),
                    if found < wanted {
                        format!("{found}")
                    } else {
                        "more".to_owned()
                    },
                ));
            }
        }
        Ok(Cow::Owned(bytes))
    }

    /// Reads header words.
    fn words(&self, source: &mut Source<'_>, count: usize) -> Result<Vec<u64>, Fault> {
        let size = count
            .checked_mul(self.word_size)
            .ok_or_else(|| Fault::new("a header within the file", format!("{count} words")))?;
        let bytes = source.take(size)?;
        let words = bytes.chunks_exact(self.word_size);
        Ok(words.map(|chunk| self.word(chunk)).collect())
    }
}

/// Encoded bytes, and the position in them.
enum Source<'d> {
    Raw(&'d [u8]),
    Base64 {
        text: &'d [u8],
        /// Decoded bytes that have not been taken yet: fewer than three.
        carry: Vec<u8>,
    },
}

impl<'d> Source<'d> {
    fn base64(text: &'d [u8]) -> Self {
        Self::Base64 {
            text,
            carry: Vec::new(),
        }
    }

    /// Number of encoded bytes left.
    fn remaining(&self) -> usize {
        match self {
            Self::Raw(data) => data.len(),
            Self::Base64 { text, .. } => text.len(),
        }
    }

    /// The next `count` decoded bytes.
    fn take(&mut self, count: usize) -> Result<Cow<'d, [u8]>, Fault> {
        let cut = |found: usize| Fault::new(format!("{count} more bytes"), format!("only {found}"));
        match self {
            Self::Raw(data) => {
                let (taken, rest) = data
                    .split_at_checked(count)
                    .ok_or_else(|| cut(data.len()))?;
                *data = rest;
                Ok(Cow::Borrowed(taken))
            }
            Self::Base64 { text, carry } => {
                let present = carry.len() + text.len() / 4 * 3 + 3;
                if count > present {
                    return Err(cut(present));
                }
                let mut decoded = std::mem::take(carry);
                while decoded.len() < count {
                    let before = decoded.len();
                    decode_base64(text, count - before, &mut decoded)?;
                    if decoded.len() == before {
                        return Err(cut(before));
                    }
                }
                *carry = decoded.split_off(count);
                Ok(Cow::Owned(decoded))
            }
        }
    }
}

/// Accepts bits set beyond the last byte, as some writers leave them.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Decodes whole quads from the front of `text`: enough for `count` bytes, at most a buffer full, and not
/// beyond a padded quad, where one stream ends and the next may begin.
fn decode_base64(text: &mut &[u8], count: usize, decoded: &mut Vec<u8>) -> Result<(), Fault> {
    const MOST_QUADS: usize = 1 << 14;
    let wanted = 4 * count.div_ceil(3).min(MOST_QUADS);
    let mut quads = Vec::with_capacity(wanted);
    let mut used = 0;
    for &b in *text {
        if quads.len() == wanted || (quads.len() % 4 == 0 && quads.last() == Some(&b'=')) {
            break;
        }
        used += 1;
        if !b.is_ascii_whitespace() {
            quads.push(b);
        }
    }
    *text = &text[used..];
    BASE64
        .decode_vec(&quads, decoded)
        .map_err(|e| Fault::new("base64", e.to_string()))
}

/// Parses numbers in text, `count` of them or as many as there are, into little-endian bytes.
fn ascii(text: &str, scalar: ScalarType, count: Option<usize>) -> Result<Vec<u8>, Fault> {
    // Each number takes a character and, but for the last, a separator.
    if let Some(count) = count.filter(|&n| n > text.len() / 2 + 1) {
        return Err(Fault::new(
            format!("{count} numbers"),
            format!("{} characters", text.len()),
        ));
    }
    let mut bytes = Vec::with_capacity(count.unwrap_or(0) * scalar.size());
    let mut found = 0;
    for word in text.split_ascii_whitespace() {
        found += 1;
        if let Some(count) = count.filter(|&n| found > n) {
            return Err(Fault::new(format!("{count} numbers"), "more"));
        }
        macro_rules! push {
            ($t:ty) => {
                word.parse::<$t>()
                    .ok()
                    .map(|x| bytes.extend(x.to_le_bytes()))
            };
        }
        let parsed = match scalar {
            ScalarType::I8 => push!(i8),
            ScalarType::U8 => push!(u8),
            ScalarType::I16 => push!(i16),
            ScalarType::U16 => push!(u16),
            ScalarType::I32 => push!(i32),
            ScalarType::U32 => push!(u32),
            ScalarType::I64 => push!(i64),
            ScalarType::U64 => push!(u64),
            ScalarType::F16 => None,
            ScalarType::F32 => push!(f32),
            ScalarType::F64 => push!(f64),
        };
        if parsed.is_none() {
            return Err(Fault(
                format!("a number of the array's type as number {found}"),
                format!("`{}`", clip(word)),
                "correct it",
            ));
        }
    }
    if let Some(count) = count.filter(|&n| found < n) {
        return Err(Fault::new(format!("{count} numbers"), format!("{found}")));
    }
    Ok(bytes)
}

/// Parses `count` numbers of a type in text to little-endian bytes, for readers of other formats. The error is
/// the expectation and what was found.
pub(in crate::io) fn parsed_text(
    text: &[u8],
    scalar: ScalarType,
    count: usize,
) -> Result<Vec<u8>, [String; 2]> {
    let text = std::str::from_utf8(text).map_err(|_| {
        [
            "numbers as text".to_owned(),
            "bytes that are no text".to_owned(),
        ]
    })?;
    ascii(text, scalar, Some(count)).map_err(|Fault(expected, found, _)| [expected, found])
}

/// A header's size, if it fits into memory and equals the wanted one.
fn checked_size(
    claimed: Option<u64>,
    wanted: Option<usize>,
    found: impl FnOnce() -> String,
) -> Result<usize, Fault> {
    let size = claimed.and_then(|n| usize::try_from(n).ok());
    match (size, wanted) {
        (Some(size), None) => Ok(size),
        (Some(size), Some(wanted)) if size == wanted => Ok(size),
        (_, None) => Err(Fault::new("an array that fits into memory", found())),
        (_, Some(wanted)) => Err(Fault::new(
            format!("{wanted} bytes, as the mesh and the type ask for"),
            found(),
        )),
    }
}

fn fewer(count: usize) -> Fault {
    Fault::new(format!("{count} values"), "fewer")
}

/// The type of an array that is required.
fn numeric(node: Node<'_, '_>) -> Result<ScalarType, Fault> {
    let name = node.attribute("type").unwrap_or("");
    scalar_type(name).ok_or_else(|| Fault::new("a `type` of numbers", format!("`{}`", clip(name))))
}

fn component_count(node: Node<'_, '_>) -> Result<usize, Fault> {
    let Some(text) = node.attribute("NumberOfComponents") else {
        return Ok(1);
    };
    let count = text.trim().parse().ok().filter(|&n: &usize| n > 0);
    count.ok_or_else(|| {
        Fault::new(
            "`NumberOfComponents` of at least 1",
            format!("`{}`", clip(text)),
        )
    })
}

fn scalar_type(name: &str) -> Option<ScalarType> {
    Some(match name {
        "Int8" => ScalarType::I8,
        "UInt8" => ScalarType::U8,
        "Int16" => ScalarType::I16,
        "UInt16" => ScalarType::U16,
        "Int32" => ScalarType::I32,
        "UInt32" => ScalarType::U32,
        "Int64" => ScalarType::I64,
        "UInt64" => ScalarType::U64,
        "Float32" => ScalarType::F32,
        "Float64" => ScalarType::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_streams_may_be_joined_or_apart() {
        for text in [
            "AQIDBAUG",
            "AQ==AgMEBQY=",
            "AQI=\n AwQF Bg==\n",
            "AQIDBA==BQY=",
        ] {
            for step in 1..=6 {
                let mut source = Source::base64(text.as_bytes());
                let mut all = Vec::new();
                while all.len() < 6 {
                    let taken = source.take(step.min(6 - all.len())).ok().unwrap();
                    all.extend_from_slice(&taken);
                }
                assert_eq!(all, [1, 2, 3, 4, 5, 6]);
                assert!(source.take(1).is_err());
            }
        }
    }

    #[test]
    fn a_claim_beyond_the_text_is_refused_before_it_is_allocated() {
        assert!(Source::base64(b"AQID").take(usize::MAX).is_err());
        assert!(Source::Raw(&[1, 2]).take(3).is_err());
        assert!(ascii("1 2 3", ScalarType::F64, Some(usize::MAX)).is_err());
    }
}
